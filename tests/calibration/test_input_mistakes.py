"""Files with a wrong unit, exchanged columns or the angles of other records are refused, and the
likely mistake is named.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin import perturbed_model
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointZeroOffset,
    StylusOffset,
)
from aacmm_pin.errors import MistakenFileError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.again import again
from tests.arm_files import by_table, changed

Change = Callable[[Measurements], Measurements]


def angles(factor: float, *joints: int) -> Change:
    """All angles, or those of these joints (from 0), times ``factor``."""
    return lambda d: replace(
        d, q=d.q * np.where(not joints or np.isin(np.arange(d.nq), joints), factor, 1.0)
    )


def counted(*joints: int) -> Change:
    return angles(-1.0, *joints)


def turned(joint: int, degrees: float) -> Change:
    """Indications that lack ``degrees``."""
    return lambda d: replace(d, q=d.q - np.deg2rad(degrees) * np.eye(d.nq)[joint])


def swapped(d: Measurements) -> Measurements:
    return replace(d, q=d.q[:, [0, 2, 1, 3, 4, 5]])


def coordinates(*factors: float, order: Sequence[int] = (0, 1, 2)) -> Change:
    return lambda d: replace(d, reference=d.reference[:, order] * factors)


def bars_in_metres(d: Measurements) -> Measurements:
    return replace(d, bar_length=1e-3 * d.bar_length)


def other_frame(d: Measurements) -> Measurements:
    shift = np.array([0.5, 0.02, 0.9])
    turn = Rotation.from_rotvec([0.3, -1.0, 0.5])
    return replace(d, reference=turn.apply(d.reference) + shift)


OF_ANGLES: list[tuple[Change, str]] = [
    (counted(0), "joint 1 have"),
    (counted(2), "joint 3 have"),
    (counted(4), "joint 5 have"),
    (counted(1, 2), "joints 2 and 3 have"),
    (turned(1, 90.0), "zero of joint 2 is wrong; add 90°"),
    (turned(2, 180.0), "zero of joint 3 is wrong; add 180°"),
    (turned(4, -90.0), "zero of joint 5 is wrong; add -90°"),
    (swapped, "joints 2 and 3 are exchanged"),
    (angles(1 / 0.9), "angles are in gon"),
    (angles(np.pi / 180, 2), "joint 3 alone are in radians"),
    (angles(1 / 0.9, 1), "joint 2 alone are in gon"),
    (angles(180 / np.pi, 3), "joint 4 alone are in degrees"),
    (
        lambda d: turned(1, 90.0)(counted(2)(d)),
        "joint 3 have the opposite sign, and the zero of joint 2",
    ),
]
OF_COORDINATES: list[tuple[Change, str]] = [
    (coordinates(1, 1, 1, order=(1, 0, 2)), "by y, x, z"),
    (coordinates(1, 1, -1), "by x, y, -z"),
    (coordinates(1e-3), "coordinates are in metres"),
    (coordinates(1 / 25.4), "coordinates are in inches"),
    (coordinates(1.0, 1.0, 1e-3), "z coordinates are in metres"),
    (other_frame, "--reference-frame external"),
]
MISTAKES = {
    "base": [
        *(OF_ANGLES[k] for k in (3, 11)),
        *(OF_COORDINATES[k] for k in (1, 2, 4)),
        (angles(60.0), "minutes of arc"),
    ],
    "base, others like them": [
        *(OF_ANGLES[k] for k in (1, 4, 6, 8, 10)),
        *(OF_COORDINATES[k] for k in (0, 3, 5)),
        (angles(1 / 360), "in turns"),
    ],
    "external": [*OF_ANGLES, (OF_COORDINATES[1][0], "mirrored"), *OF_COORDINATES[2:4]],
    "seats": [*OF_ANGLES[5:], *OF_ANGLES[:5]],
    "bars": [(bars_in_metres, "are in metres"), OF_ANGLES[2]],
}


@pytest.fixture(scope="module", params=["sino6", "ur5", again("zero6")])
def arm(request) -> Arm:
    if request.param != "ur5":
        return Arm.load(request.param)
    (urdf,) = (
        f
        for f in importlib.metadata.files("example-robot-data") or []
        if f.name == "ur5_robot.urdf"
    )
    return Arm.from_urdf(str(urdf.locate()), "tool0")


def with_gross_errors(d: Measurements, rng: np.random.Generator) -> Measurements:
    """One record in ten is far off."""
    bad = (np.arange(d.n) % 10 == 3)[:, None]
    return replace(
        d,
        q=d.q + bad * rng.normal(0.0, 0.05, d.q.shape),
        reference=d.reference + bad * rng.normal(0.0, 0.05, (d.n, 3)),
    )


SETUPS = [
    ("sino6", "base", 1),
    ("sino6", "external", 9),
    ("sino6", "seats", 7),
    ("sino6", "bars", 2),
]
SETUPS += [
    again("sino6", "bars", 1),
    again("sino6", "base, others like them", 1),
    again("zero6", "external", 6),
    again("ur5", "base", 9),
    again("ur5", "seats", 4),
]


@pytest.mark.parametrize(("arm", "setup", "every"), SETUPS, indirect=["arm"])
def test_every_mistake_is_named(arm, setup, every, rng):
    """Each of them on one arm, most with coordinates in its base."""
    options = {"parameters": "zero-offsets" if setup == "seats" else "geometry"}
    if setup == "external" or setup.startswith("base"):
        data = simulate_measurements(arm, "free", 60, rng=rng)
    elif setup == "seats":
        data = simulate_measurements(arm, "seats", 60, rng=rng, seats=6, known=False)
    else:
        data = simulate_measurements(arm, "ball-bar", 36, rng=rng, seats=6, bar_length=0.3)
    if setup == "external":
        turn = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
        data = replace(data, reference=data.reference @ turn.T + [0.5, 0.2, 0.9])
        options["reference_frame"] = "external"
    data = with_gross_errors(data, rng)
    for mistake, name in MISTAKES[setup][::every]:
        with pytest.raises(MistakenFileError) as caught:
            calibrate(arm, mistake(data), **options, hold_out=False)
        found = caught.value
        assert any(name in said for said in (found.mistake, *found.others)), f"{name}: {found}"
        assert 0.03 < found.before < 3.0
        assert 0.0 < found.after < 1e-4
        assert f"{found.before * 1e3:.4g}" in str(found)


def test_with_stated_noise_an_unknown_target_and_in_a_diagnosis(sino6, rng):
    data = counted(3)(with_gross_errors(simulate_measurements(sino6, "free", 60, rng=rng), rng))
    stated = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5, "probe_noise": 0.0}
    with pytest.raises(MistakenFileError) as caught:
        diagnose(sino6, data, **stated, target="unknown", hold_out=False)
    assert caught.value.mistake.startswith("the angles of joint 4 have")


@pytest.mark.parametrize("frame", ["base", again("session"), again("external")])
def test_a_mistake_in_one_session_is_named_with_the_session(sino6, frame, rng):
    """The other session fits, whatever the references of the first are in."""
    data = simulate_measurements(sino6, "free", 40, rng=rng)
    second = np.arange(data.n) >= data.n // 2
    wrong = {"y, x, z" if frame == "base" else "mirrored": OF_COORDINATES[0][0](data)}
    wrong["joint 3 have"] = counted(2)(data)
    for name, mistaken in wrong.items():
        mixed = replace(
            data,
            q=np.where(second[:, None], mistaken.q, data.q),
            reference=np.where(second[:, None], mistaken.reference, data.reference),
            conditions=replace(data.conditions, session=np.where(second, "second", "first")),
        )
        with pytest.raises(MistakenFileError) as caught:
            calibrate(sino6, mixed, "geometry", reference_frame=frame, hold_out=False)
        assert name in caught.value.mistake
        assert caught.value.source.endswith("session second")


def test_sound_files_pass(arm):
    causes = [
        (),
        (EncoderEccentricity(3, values=(2e-4, 1e-4)),),
        (JointZeroOffset(2, values=(2e-3,)),)
        if arm.dh is not None
        else (EncoderGain(2, values=(4e-4,)),),
    ]
    for seed in range(3):  # both plans
        rng = np.random.default_rng(seed)
        model = ErrorModel(arm).with_effects(*causes[seed % 3])
        plan = ("free", "seats")[seed % 2]
        data = with_gross_errors(simulate_measurements(model, plan, 60, rng=rng, seats=6), rng)
        assert calibrate(arm, data, "geometry", hold_out=False).rms < 2e-3
    far = simulate_measurements(arm, "free", 60, rng=rng)  # zeros that nobody has calibrated yet
    far = replace(far, q=far.q + np.deg2rad([3.0, -2.0, 2.5, -3.0, 2.0, 1.0]))
    assert calibrate(arm, far, "zero-offsets", prior=False, hold_out=False).rms < 2e-3


# --- options, and the arm's numbers


def table(*rows: tuple[float, float, float, float]) -> Arm:
    return by_table("robot", rows, 150.0)


ROBOT = table(
    (0, 290, -90, 0),
    (270, 0, 0, -90),
    (70, 0, -90, 0),
    (0, 302, 90, 0),
    (0, 0, -90, 0),
    (0, 72, 0, 180),
)
"""Its last axis goes through the tip, which the last joint does not move."""
SEVEN = table(
    (0, 340, -90, 0),
    (0, 0, 90, 0),
    (0, 400, 90, 0),
    (0, 0, -90, 0),
    (0, 400, -90, 0),
    (0, 0, 90, 0),
    (30, 126, 0, 0),
)
SEEDS = [0, *(again(seed) for seed in (1, 2))]
FRAME_OPTION, TARGET_OPTION = "--reference-frame external", "--target unknown"


def assembled(arm: Arm, rng: np.random.Generator) -> Arm:
    """An arm whose geometry is off as that of a robot."""
    values = arm.dh.values()
    values += rng.normal(0.0, [3e-4, 3e-4, 1e-3, 1e-3], values.shape)
    return table(*(values * [1e3, 1e3, 180 / np.pi, 180 / np.pi]).tolist())


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("target", "away", "named"),
    [
        ((0.0, 0.0, 0.0), True, {FRAME_OPTION}),
        again((0.0, -0.03, 0.118), True, {FRAME_OPTION, TARGET_OPTION}),
        ((0.0, 0.0, 0.122), False, {TARGET_OPTION}),
    ],
)
def test_an_option_that_was_left_out_is_named(target, away, named, seed):
    """Not a sign of the last joint, which hardly moves the tip."""
    rng = np.random.default_rng(seed)
    model = ErrorModel(assembled(ROBOT, rng), (StylusOffset(values=target),))
    data = simulate_measurements(model, "free", 90, rng=rng, reference_noise=5e-5)
    with pytest.raises(MistakenFileError) as caught:
        calibrate(ROBOT, other_frame(data) if away else data, hold_out=False)
    assert {
        option for option in (FRAME_OPTION, TARGET_OPTION) if option in caught.value.mistake
    } == named
    assert "joint" not in caught.value.mistake
    options = {"reference_frame": "external" if away else "base"}
    options["target"] = "unknown" if TARGET_OPTION in named else "tip"
    found = calibrate(ROBOT, other_frame(data) if away else data, **options, hold_out=False)
    assert found.rms < 2e-4


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tip_that_geometry_takes_up_is_no_mistake(seed):
    """15 mm beyond the stated one, as of a robot's tool of which the length is known roughly."""
    rng = np.random.default_rng(seed)
    model = ErrorModel(assembled(ROBOT, rng), (StylusOffset(values=(0.003, 0.0, 0.014)),))
    data = simulate_measurements(model, "free", 90, rng=rng, reference_noise=5e-5)
    assert calibrate(ROBOT, data, hold_out=False).rms < 2e-4


def shown_with(other: int, joint: int, sign: float) -> Change:
    """The angle that is shown of a joint has that of another in it."""
    return lambda d: replace(d, q=d.q + sign * np.outer(d.q[:, other], np.eye(d.nq)[joint]))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["sino6", again("seven"), again("robot")])
def test_convention_and_sums_of_angles_are_named(name, sino6, seed):
    rng = np.random.default_rng(seed)
    arm = {"sino6": sino6, "robot": ROBOT, "seven": SEVEN}[name]
    truth = perturbed_model(arm, rng).arm if name == "sino6" else assembled(arm, rng)
    data = simulate_measurements(truth, "free", 60, rng=rng, reference_noise=5e-5)
    misread = changed(arm.file, convention="modified-dh")
    mistakes = [
        (misread, lambda d: d, "standard-dh"),
        (arm, shown_with(1, 2, 1.0), "the sum of the angles"),
        (arm, shown_with(1, 2, -1.0), "minus the angle of joint 2"),
    ]
    for given, mistake, words in mistakes:
        with pytest.raises(MistakenFileError) as caught:
            calibrate(given, mistake(data), hold_out=False)
        assert words in caught.value.mistake
        assert caught.value.after < 1e-3
