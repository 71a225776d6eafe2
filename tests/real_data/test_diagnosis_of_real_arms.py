"""Diagnosis of real arms, in which nobody hid anything: what it names there, and what that is worth
on held-out records.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import arms
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin import next_measurements
from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.calibration.setup import ReferenceFrame, Target
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import JointErrorCurve, strongest_waves
from aacmm_pin.measurements import Measurements
from tests.again import again

CASES: dict[str, tuple[str, Callable[[], Arm], ReferenceFrame, Target]] = {
    "ur10": ("ur10_laser_tracker", arms.ur10, "external", "unknown"),
    "panda": ("panda_socket", arms.panda, "base", "unknown"),
    "iiwa14": ("iiwa14_socket", arms.iiwa14, "base", "unknown"),
    "bad": ("panda_socket_bad_setup", arms.panda, "base", "unknown"),
}


@pytest.fixture(scope="session")
def diagnosed(real_data) -> Callable[[str], Diagnosis]:
    """The diagnosis of a case."""

    def of(name: str) -> Diagnosis:
        folder, arm_of, frame, target = CASES[name]
        arm = arm_of()
        records = Measurements.read(real_data / folder / "measurements.csv", arm.nq)
        return diagnose(arm, records, reference_frame=frame, target=target)

    return cache(of)


def labels(result: Diagnosis) -> list[str]:
    return [finding.label for finding in result.findings]


@pytest.mark.long
def test_ur10_has_free_curves_in_its_first_three_joints(real_data):
    """By every third record, which takes a sixth of the time of all; the others show what it is
    worth.
    """
    folder, arm_of, frame, target = CASES["ur10"]
    arm = arm_of()
    table = Measurements.read(real_data / folder / "measurements.csv", arm.nq).to_frame()
    third = np.arange(len(table)) % 3 == 0
    some, others = (
        Measurements.from_frame(table[rows].reset_index(drop=True)) for rows in (third, ~third)
    )
    result = diagnose(arm, some, reference_frame=frame, target=target, hold_out=False)
    has_free_curves(result)
    known = result.model.known_at(others.q).all(axis=1)
    assert known.mean() > 0.95
    measured = table.loc[~third, ["x_mm", "y_mm", "z_mm"]].to_numpy()[known] * MM
    geometry = calibrate(
        arm, some, "geometry", reference_frame=frame, target=target, hold_out=False
    ).model
    assert (
        0.40 * MM < rms(off_when_aligned(geometry.predict(others.q[known]), measured)) < 0.52 * MM
    )
    # Gross errors included.
    assert rms(off_when_aligned(result.model.predict(others.q[known]), measured)) < 0.15 * MM


@pytest.mark.long
def test_all_records_of_ur10(diagnosed):
    result = diagnosed("ur10")
    has_free_curves(result)
    assert result.held_out.kind == "blocks"
    assert 0.40 * MM < rms(result.held_out.recalibrated) < 0.52 * MM
    assert rms(result.held_out.extended) < 0.12 * MM


def has_free_curves(result: Diagnosis) -> None:
    """An eccentricity or one order is not enough: many waves, the strongest of joint 2 near 17 a
    turn.
    """
    assert set(labels(result)[:3]) == {
        "joint_error_curve:1",
        "joint_error_curve:2",
        "joint_error_curve:3",
    }
    curves = [
        finding.effect
        for finding in result.findings[:3]
        if isinstance(finding.effect, JointErrorCurve)
    ]
    assert len(curves) == 3
    assert all(len(strongest_waves(curve) or []) >= 3 for curve in curves)
    assert any(
        15.0 < order < 19.0 for curve in curves for order, _ in (strongest_waves(curve) or [])[:3]
    )


def off_when_aligned(positions: Array, measured: Array) -> Array:
    """Distances of points from measured ones, in the frame where they fit best."""
    mine, theirs = positions - positions.mean(axis=0), measured - measured.mean(axis=0)
    return np.asarray(
        np.linalg.norm(Rotation.align_vectors(theirs, mine)[0].apply(mine) - theirs, axis=1)
    )


def test_the_bad_group_is_named(diagnosed):
    result = diagnosed("bad")
    assert [group.name for group in result.unexplained.groups] == ["bar left"]
    assert result.unexplained.groups[0].records == 62
    assert result.verdict == "unexplained"
    assert "bar left" in next_measurements(result)


@pytest.mark.parametrize("name", [*map(again, ("panda", "iiwa14")), "bad"])
def test_what_is_named_survives_on_held_out_records(name, diagnosed):
    """Records that had no part in it are predicted better with the causes, or the diagnosis states
    that they are not.
    """
    result = diagnosed(name)
    if any(not np.isclose(finding.retained_fraction, 1.0) for finding in result.findings):
        assert result.held_out.gain > 0.05
        assert result.held_out.interval[0] > 0.0 or "no better" in result.doubts
    assert result.verdict == "unexplained" or all(
        finding.probability > 0.2 for finding in result.findings
    )
    if name == "panda":
        assert result.unexplained.groups == ()
