"""Arm files that name a URDF: what is written comes back to the last bit, and what does not belong
together is refused.
"""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from aacmm_pin.arm import Arm
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.calibration import calibrate
from aacmm_pin.effects import ErrorModel, JointCompliance
from aacmm_pin.errors import ArmFileError
from aacmm_pin.measurements.simulation import simulate_measurements
from tests.oracle import close

pytestmark = pytest.mark.fast

HALF_WIDTHS = {"translation_half_width": 3e-4, "rotation_half_width": 7e-4}
FRAMES = {"ur5_robot.urdf": "tool0", "panda.urdf": "panda_hand_tcp"}


def calibrated(path: Path, frame: str, rng: np.random.Generator) -> ErrorModel:
    """By records of an arm that is off and yields, in two steps, so that corrections are joined;
    the noise is stated.
    """
    arm = Arm.from_urdf(path, frame, **HALF_WIDTHS)
    real = arm.with_placements(rng.uniform(-3e-4, 3e-4, (arm.nq, 6)), None)
    records = simulate_measurements(
        ErrorModel(real, (JointCompliance(2, values=(1e-5,)),)), "free", 60, rng=rng
    )
    once = calibrate(
        arm, records, ["geometry", JointCompliance(2)], encoder_noise=8e-6, hold_out=False
    ).model
    return calibrate(once, records, encoder_noise=8e-6, hold_out=False).model


@pytest.mark.parametrize("name", FRAMES)
def test_all_comes_back_to_the_last_bit(name, robot_file, tmp_path, rng):
    (tmp_path / "robots").mkdir()
    (tmp_path / "kept").mkdir()
    urdf = Path(shutil.copy(robot_file(name), tmp_path / "robots"))
    model = calibrated(urdf, FRAMES[name], rng)
    model.save(tmp_path / "kept" / "cal.toml")
    moved = tmp_path.rename(tmp_path.with_name(f"{tmp_path.name}-moved"))  # both files together
    again = ErrorModel.load(moved / "kept" / "cal.toml")
    assert [p.name for p in again.parameters] == [p.name for p in model.parameters]
    for attribute in ("half_width", "u", "value"):
        assert [getattr(p, attribute) for p in again.parameters] == [
            getattr(p, attribute) for p in model.parameters
        ]
    np.testing.assert_array_equal(again.covariance(), model.covariance())
    assert again.effects == model.effects
    q = rng.uniform(-2.0, 2.0, (50, model.arm.nq))
    np.testing.assert_array_equal(again.predict(q), model.predict(q))
    np.testing.assert_array_equal(again.sensitivity(q), model.sensitivity(q))
    np.testing.assert_array_equal(again.arm.encoder_noise, model.arm.encoder_noise)
    assert again.arm.source == model.arm.source
    assert again.text() == model.text()


def test_corrections_are_joined(rng):
    """One after the other as Pinocchio's placements have them, which a file holds as one twist."""
    arm = Arm.from_urdf("ur5")
    first, second = rng.normal(scale=0.1, size=(2, 6, 6))
    both = arm.with_placements(first, None).with_placements(second, None)
    for number in range(1, 7):
        expected = arm.with_placements(first, None).model.jointPlacements[number]
        expected = expected * arm.model.jointPlacements[number].actInv(
            arm.with_placements(second, None).model.jointPlacements[number]
        )
        close(both.model.jointPlacements[number], expected, 1e-14)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[urdf]", "[urdf]\nmesh = 1", r"urdf\.mesh: unknown key"),
        (
            "[[joints]]",
            "[[joints]]\na_mm = 1.0",
            r"joints\[1\]\.a_mm: unknown key; .*encoder",
        ),
        ('"tool0"', '"tool9"', r"urdf\.frame: unknown frame 'tool9'"),
        (
            '"tool0"',
            '"forearm_link"',
            r"joints: shoulder.*'forearm_link'",
        ),
        ('"tool0"', '"base_link"', r"urdf\.frame: .*no joint moves"),
        ("sha256 = ", "# ", r"urdf\.sha256 is missing"),
        ('sha256 = "', 'sha256 = "x', r"urdf\.sha256: 'x"),
        ("shift_mm = [\n", "shift_mm = [\n    nan,\n", r"joints\[1\]\.shift_mm"),
        ('file = "', 'file = "no/', r"urdf\.file: .*no such file"),
        ('name = "elbow_joint"', 'name = "elbow"', "joints: .*elbow"),
        ('"rx1"', '"rx9"', r"covariance\.parameters: .*'rx9'"),
    ],
)
def test_what_is_refused(old, new, said, calibrated_ur5, robot_file, tmp_path):
    shutil.copy(robot_file("ur5_robot.urdf"), tmp_path)
    assert old in calibrated_ur5
    (tmp_path / "cal.toml").write_text(calibrated_ur5.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ArmFileError, match=rf"(?s)cal\.toml.*{said}"):
        ErrorModel.load(tmp_path / "cal.toml")


@pytest.fixture(scope="module")
def calibrated_ur5(robot_file) -> str:
    """As it is saved beside its URDF."""
    return calibrated(robot_file("ur5_robot.urdf"), "tool0", np.random.default_rng(1)).text()


def test_a_file_without_a_hash_belongs_to_the_urdf_that_was_read(robot_file, tmp_path):
    urdf = Path(shutil.copy(robot_file("ur5_robot.urdf"), tmp_path))
    bare = tmp_path / "bare.toml"
    bare.write_text(
        'schema = "aacmm-pin/arm/1"\nname = "bare"\n'
        '[urdf]\nfile = "ur5_robot.urdf"\nframe = "tool0"\n'
    )
    arm = Arm.load(bare)
    assert arm.urdf_file.urdf.sha256 == hashlib.sha256(urdf.read_bytes()).hexdigest()
    assert corrected_urdf(arm) == urdf.read_bytes()
    moved = arm.with_placements(np.full((6, 6), 1e-3), None)
    ErrorModel(moved).save(tmp_path / "moved.toml")
    q = np.ones((1, 6))
    close(Arm.load(tmp_path / "moved.toml").positions(q), moved.positions(q), 1e-15)
    urdf.write_bytes(urdf.read_bytes() + b" ")
    with pytest.raises(ArmFileError, match=r"moved\.toml: urdf\.sha256: .* was changed"):
        Arm.load(tmp_path / "moved.toml")


def test_another_urdf_is_refused(calibrated_ur5, robot_file, tmp_path):
    (tmp_path / "cal.toml").write_text(calibrated_ur5, encoding="utf-8")
    urdf = tmp_path / "ur5_robot.urdf"
    urdf.write_bytes(robot_file("ur5_robot.urdf").read_bytes().replace(b"0.425", b"0.426"))
    with pytest.raises(
        ArmFileError, match=r"cal\.toml: urdf\.sha256: .*ur5_robot\.urdf was changed"
    ):
        ErrorModel.load(tmp_path / "cal.toml")
