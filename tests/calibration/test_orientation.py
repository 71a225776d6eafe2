"""Orientations beside positions: residuals against Pinocchio, stated uncertainty against Monte
Carlo, what they add.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import EncoderEccentricity, ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.arm_files import changed
from tests.few_causes import FEW
from tests.oracle import close

NOISE = {"encoder_noise": 2e-5, "reference_noise": 1.2e-5}
TURN = 3e-5
FRAME = Frame(
    Rotation.from_rotvec([0.4, -0.9, 1.1]).as_matrix(),
    np.array([1.0, 2.0, -0.5]),
    Rotation.from_rotvec([[2.0, 1.0, -0.5]]).as_matrix(),
)


@pytest.fixture
def straight() -> Arm:
    """A tip on the last axis: no position tells the zero of joint 6."""
    return changed("sino6", {6: {"a_mm": 0.0}})


def seen_from(records: Measurements, frame: Frame) -> Measurements:
    """The same by a reference in another frame, of a target that is turned in the tip."""
    turned = Rotation.from_matrix(frame.rotation) * Rotation.from_quat(
        records.orientation[:, [1, 2, 3, 0]]
    )
    quaternion = (turned * Rotation.from_matrix(frame.targets[0])).as_quat()[:, [3, 0, 1, 2]]
    return replace(records, reference=frame.apply(records.reference), orientation=quaternion)


@pytest.mark.parametrize("name", ["sino6", "zero6", "ur5_robot.urdf"])
def test_turns_and_their_derivatives_are_those_of_pinocchio(name, robot_file, rng):
    arm = Arm.from_urdf(str(robot_file(name)), "tool0") if name.endswith("urdf") else Arm.load(name)
    q = rng.uniform(-1.0, 1.0, (5, arm.nq))
    stated = Rotation.random(5, rng=rng)
    records = Measurements.of(q, np.zeros((5, 3)), orientation=-stated.as_quat()[:, [3, 0, 1, 2]])
    problem = problem_of(ErrorModel(arm), records, "zero-offsets", Setup.of(arm, "external"))
    found = problem.predict(problem.start, FRAME)
    data, number = arm.model.createData(), arm.model.getFrameId(arm.tip)
    for each, seen, poses, jacobian in zip(
        q, stated.as_matrix(), found.poses, found.jacobian, strict=True
    ):
        columns = pin.computeFrameJacobian(arm.model, data, each, number, pin.LOCAL)[3:]
        pin.framesForwardKinematics(arm.model, data, each)
        target = FRAME.targets[0]
        way = seen.T @ FRAME.rotation @ data.oMf[number].rotation @ target
        close(poses[3:], seen @ pin.log3(way), 1e-12)
        close(jacobian[3:, : arm.nq], seen @ pin.Jlog3(way) @ target.T @ columns, 1e-9)
    geometry = problem_of(ErrorModel(arm), records, "geometry", Setup.of(arm, "external"))
    exact = geometry.predict(geometry.start, FRAME).jacobian
    p = geometry.start.size
    for k, step in enumerate(1e-6 * np.eye(exact.shape[2])):
        ends = [
            geometry.poses(geometry.start + sign * step[:p], FRAME.moved(sign * step[p:]))
            for sign in (1, -1)
        ]
        close(exact[:, :, k], (ends[0] - ends[1]) / 2e-6, 1e-7)


def test_parameters_scatter_as_stated(sino6, rng):
    """χ² of the parameters over calibrations with new noise; the readings' part is common to
    position and turn.
    """
    total, runs, known = 0.0, 40, replace(FRAME, targets=np.eye(3)[None])
    for _ in range(runs):
        data = simulate_measurements(sino6, "free", 15, rng=rng, orientation_noise=TURN, **NOISE)
        found = calibrate(
            sino6,
            seen_from(data, known),
            "zero-offsets",
            target="frame",
            reference_frame="external",
            prior=False,
            hold_out=False,
            **NOISE,
        )
        off = found.fit.point.x[1:]  # the first zero is the frame's
        total += off @ np.linalg.solve(found.covariance[1:, 1:], off)
    assert 1e-3 < chi2.sf(total, 5 * runs) < 0.999


def test_what_is_not_stated_is_found_and_what_is_wrong_is_left_out(sino6, rng):
    """Frame, axes of the target and noise are unknown, a third of the orientations missing, one
    wrong.
    """
    data = simulate_measurements(sino6, "free", 90, rng=rng, orientation_noise=TURN, **NOISE)
    data = seen_from(data, FRAME)
    data.orientation[::3] = np.nan
    data.orientation[7] = data.orientation[8]
    how = {"reference_frame": "external", "encoder_noise": NOISE["encoder_noise"]}
    found = calibrate(sino6, replace(data, orientation_u=None), "geometry", **how)
    assert np.flatnonzero(found.fit.excluded).tolist() == [7]
    assert found.fit.noise.scatters.rotation == pytest.approx(TURN, rel=0.25)
    turned = Rotation.from_matrix(found.fit.point.frame.targets[0] @ FRAME.targets[0].T)
    assert turned.magnitude() < 5e-5
    assert found.turns["calibrated"] == pytest.approx(found.turns["noise"], rel=0.25)
    (by_record, _) = found.held_out
    assert np.isfinite(by_record.turn_after).sum() == 59
    assert np.nanmax(by_record.turn_after) < 4e-4
    for order, words in (
        (data.orientation[:, [1, 2, 3, 0]], "scalar"),
        (data.orientation * [1, -1, -1, -1], "reference"),
    ):
        with pytest.raises(AacmmError, match=words):
            calibrate(sino6, replace(data, orientation=order), "geometry", hold_out=False, **how)


def test_turns_tell_the_roll_of_the_wrist(straight, rng):
    data = simulate_measurements(straight, "free", 20, rng=rng, orientation_noise=TURN, **NOISE)
    for records, target, untold in (
        (replace(data, orientation=None), "frame", 1),
        (data, "tip", 1),  # it turns the target too
        (data, "frame", 0),
    ):
        options = {"target": target, "prior": False, "hold_out": False} | NOISE
        found = calibrate(straight, records, "zero-offsets", **options)
        assert len(found.undetermined) == untold
    assert found.parameters["u"].iloc[-1] == pytest.approx(
        np.hypot(TURN, 2e-5) / np.sqrt(20), rel=0.5
    )


@FEW
def test_turns_show_a_cause_in_the_wrist(straight, rng):
    hidden = ErrorModel(straight, (EncoderEccentricity(joint=6, values=(2e-4, 1e-4)),))
    data = simulate_measurements(hidden, "free", 50, rng=rng, orientation_noise=TURN, **NOISE)
    told = diagnose(straight, data, rng=rng, hold_out=False, **NOISE)
    assert [finding.label for finding in told.findings] == ["encoder_eccentricity:6"]
    assert told.verdict == "explained"
    assert told.turns["recalibrated"] > 2 * told.turns["extended"]
    bare = replace(data, orientation=None)
    assert diagnose(straight, bare, rng=rng, hold_out=False, **NOISE).findings == ()


@FEW
def test_turns_that_nothing_explains(straight, rng):
    """A target that was knocked halfway; its page shows positions."""
    data = simulate_measurements(straight, "free", 50, rng=rng, orientation_noise=TURN, **NOISE)
    knock = Rotation.from_rotvec([[0.0, 0.0, 0.0]] * 25 + [[3e-4, 0.0, 0.0]] * 25)
    knocked = (Rotation.from_quat(data.orientation[:, [1, 2, 3, 0]]) * knock).as_quat()[
        :, [3, 0, 1, 2]
    ]
    for orientation, target, verdict in (
        (data.orientation, "frame", "no-discrepancy"),
        (knocked, "tip", "unexplained"),
    ):
        told = diagnose(
            straight,
            replace(data, orientation=orientation),
            target=target,
            rng=rng,
            hold_out=False,
            **NOISE,
        )
        assert told.verdict == verdict
        assert np.isfinite(told.residual_groups["times_noise"]).all()


@pytest.mark.parametrize(
    ("change", "where", "words"),
    [
        ({"qw": 0.9}, 2, "norm"),
        ({"qw": ""}, 2, "empty"),
        ({"x_mm": "", "y_mm": "", "z_mm": ""}, 2, "without"),
        ({"u_rot_rad": 0.3}, 2, "rad"),
        ({"qw": None}, None, "missing"),
    ],
)
def test_orientations_that_are_none(change, where, words):
    row = {"theta1_deg": 10.0, "x_mm": 1.0, "y_mm": 2.0, "z_mm": 3.0, "u_rot_rad": 1e-4}
    row |= {"qw": 0.6, "qx": 0, "qy": 0, "qz": -0.8}
    changed = {name: value for name, value in (row | change).items() if value is not None}
    with pytest.raises(MeasurementFileError, match=words) as caught:
        Measurements.from_frame(pd.DataFrame([changed, changed]))
    assert caught.value.row == where
    kept = Measurements.from_frame(
        pd.DataFrame([row, row | dict.fromkeys(("qw", "qx", "qy", "qz", "u_rot_rad"), "")])
    )
    assert kept.oriented.tolist() == [True, False]
    again = Measurements.from_frame(kept.to_frame())
    np.testing.assert_array_equal(again.orientation, kept.orientation)
