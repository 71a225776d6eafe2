"""Files with a wrong unit, exchanged columns or the angles of other records are refused, and the likely mistake is named."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import EncoderEccentricity, EncoderGain
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.geometry import JointZeroOffset
from aacmm_pin.errors import MistakenFileError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements

Change = Callable[[Measurements], Measurements]

XYZ = ["x_mm", "y_mm", "z_mm"]
THETA = [f"theta{j}_deg" for j in range(1, 7)]


def counted(*joints: int) -> Change:
    return lambda d: replace(d, q=d.q * np.where(np.isin(np.arange(d.nq), joints), -1.0, 1.0))


def turned(joint: int, degrees: float) -> Change:
    """Indications that lack ``degrees``."""
    return lambda d: replace(d, q=d.q - np.deg2rad(degrees) * np.eye(d.nq)[joint])


def swapped(one: int, other: int) -> Change:
    order = np.arange(6)
    order[[one, other]] = other, one
    return lambda d: replace(d, q=d.q[:, order])


def along(order: list[int], signs: list[int]) -> Change:
    return lambda d: replace(d, reference=d.reference[:, order] * np.array(signs))


def in_unit(factor: float) -> Change:
    return lambda d: replace(d, reference=factor * d.reference)


def bars_in(factor: float) -> Change:
    return lambda d: replace(d, bar_length=None if d.bar_length is None else factor * d.bar_length)


def other_frame(d: Measurements) -> Measurements:
    return replace(d, reference=Rotation.from_rotvec([0.3, -1.0, 0.5]).apply(d.reference) + np.array([0.5, 0.02, 0.9]))


def first_and_second(d: Measurements) -> Measurements:
    return turned(1, 90.0)(counted(2)(d))


OF_ANGLES: list[tuple[Change, str]] = [
    (counted(0), "joint 1 is counted"),
    (counted(2), "joint 3 is counted"),
    (counted(4), "joint 5 is counted"),
    (counted(1, 2), "joints 2 and 3 are counted"),
    (turned(1, 90.0), "zero of joint 2 is turned: 90°"),
    (turned(2, 180.0), "zero of joint 3 is turned: 180°"),
    (turned(4, -90.0), "zero of joint 5 is turned: -90°"),
    (swapped(1, 2), "joints 2 and 3 are exchanged"),
    (first_and_second, "joint 3 is counted the other way, and the zero of joint 2"),
]
OF_COORDINATES: list[tuple[Change, str]] = [
    (along([1, 0, 2], [1, 1, 1]), "x, y, z should be y, x, z"),
    (along([0, 1, 2], [1, 1, -1]), "x, y, z should be x, y, -z"),
    (in_unit(1e-3), "coordinates are in metres"),
    (in_unit(1 / 25.4), "coordinates are in inches"),
    (other_frame, "is the reference frame external?"),
]


@pytest.fixture(scope="module", params=["sino6", "zero6", "ur5"])
def arm(request: pytest.FixtureRequest) -> Arm:
    if request.param != "ur5":
        return Arm.load(request.param)
    (urdf,) = (f for f in importlib.metadata.files("example-robot-data") or [] if f.name == "ur5_robot.urdf")
    return Arm.from_urdf(str(urdf.locate()), "tool0")


def with_gross_errors(d: Measurements, rng: np.random.Generator) -> Measurements:
    """One record in ten is far off."""
    bad = (np.arange(d.n) % 10 == 3)[:, None]
    return replace(
        d, q=d.q + bad * rng.normal(0.0, 0.05, d.q.shape), reference=d.reference + bad * rng.normal(0.0, 0.05, (d.n, 3))
    )


SETUPS = [("sino6", setup) for setup in ("base", "external", "seats", "bars")]
SETUPS += [("zero6", "external"), ("zero6", "bars"), ("ur5", "base"), ("ur5", "seats")]


@pytest.mark.parametrize(("arm", "setup"), SETUPS, indirect=["arm"])
def test_every_mistake_is_named(arm: Arm, setup: str, rng: np.random.Generator) -> None:
    options: dict[str, Any] = {"parameters": "zero-offsets" if setup == "seats" else "geometry"}
    if setup in ("base", "external"):
        data = simulate_measurements(arm, "free", 60, rng=rng)
    elif setup == "seats":
        data = simulate_measurements(arm, "seats", 60, rng=rng, seats=6, known=False)
    else:
        data = simulate_measurements(arm, "ball-bar", 60, rng=rng, seats=6, bar_length=0.3)
    mistakes = {
        "base": OF_ANGLES + OF_COORDINATES,
        "external": [*OF_ANGLES, (OF_COORDINATES[1][0], "mirror image"), *OF_COORDINATES[2:4]],
        "seats": OF_ANGLES,
        "bars": [OF_ANGLES[2], OF_ANGLES[4], (bars_in(1e-3), "bars are in metres")],  # bars are slower to fit
    }[setup]
    if setup == "external":
        turn = Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix()
        data = replace(data, reference=data.reference @ turn.T + [0.5, 0.2, 0.9])
        options["reference_frame"] = "external"
    data = with_gross_errors(data, rng)
    for mistake, name in mistakes:
        with pytest.raises(MistakenFileError) as caught:
            calibrate(arm, mistake(data), **options, hold_out=False, progress=False)
        found = caught.value
        assert any(name in said for said in (found.mistake, *found.others)), f"{name}: {found}"
        assert 0.05 < found.before < 3.0
        assert 0.0 < found.after < 1e-4
        assert f"{found.before * 1e3:.4g}" in str(found)


def test_with_stated_noise_an_unknown_target_and_in_a_diagnosis(sino6: Arm, rng: np.random.Generator) -> None:
    data = counted(3)(with_gross_errors(simulate_measurements(sino6, "free", 60, rng=rng), rng))
    stated: dict[str, Any] = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5, "probe_noise": 0.0, "hold_out": False}
    for options in (stated, {"target": "unknown", "hold_out": False}):
        for run in (calibrate, diagnose):
            with pytest.raises(MistakenFileError) as caught:
                run(sino6, data, **options, progress=False)  # type: ignore[operator]
            assert caught.value.mistake.startswith("joint 4 is counted")


def test_sound_files_pass(arm: Arm) -> None:
    causes = [
        (),
        (EncoderEccentricity(3, values=(2e-4, 1e-4)),),
        (JointZeroOffset(2, values=(2e-3,)),) if arm.dh is not None else (EncoderGain(2, values=(4e-4,)),),
    ]
    for seed in range(6):  # each with both plans
        rng = np.random.default_rng(seed)
        model = ErrorModel(arm).with_effects(*causes[seed % 3])
        plan: Any = ("free", "seats")[seed % 2]
        data = with_gross_errors(simulate_measurements(model, plan, 60, rng=rng, seats=6), rng)
        assert calibrate(arm, data, "geometry", hold_out=False, progress=False).rms < 2e-3
    far = simulate_measurements(arm, "free", 60, rng=rng)  # zeros that nobody has calibrated yet
    far = replace(far, q=far.q + np.deg2rad([3.0, -2.0, 2.5, -3.0, 2.0, 1.0]))
    assert calibrate(arm, far, "zero-offsets", hold_out=False, progress=False).rms < 2e-3
