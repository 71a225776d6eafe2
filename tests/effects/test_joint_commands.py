"""Commands are checked by the error model they are meant for, and the arm's own Pinocchio model
where it has no effects.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin import Arm, ErrorModel
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration import calibrate
from aacmm_pin.effects import EncoderEccentricity, JointCompliance
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.joint_commands import joint_commands
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from tests.oracle import close, jacobian_of, with_dh_errors

pytestmark = pytest.mark.fast

HALF_WIDTHS = {"translation_half_width": 5e-4, "rotation_half_width": 1e-3}


@pytest.mark.parametrize(
    ("name", "frame"), [("ur5_robot.urdf", "tool0"), ("panda.urdf", "panda_hand")]
)
def test_the_tip_comes_where_the_nominal_arm_has_it(name, frame, robot_file, rng):
    nominal = Arm.from_urdf(robot_file(name), frame)
    moved = nominal.with_placements(rng.normal(scale=1e-3, size=(nominal.nq, 6)), None)
    effects = (JointCompliance(2, values=(2e-5,)), EncoderEccentricity(3, values=(1e-3, 5e-4)))
    middle, width = nominal.limits.mean(axis=1), np.ptp(nominal.limits, axis=1)
    q = middle + 0.3 * width * rng.uniform(-1, 1, (30, nominal.nq))
    # Next to a singular posture a place may be out of the real arm's reach.
    q = q[np.linalg.svd(jacobian_of(nominal.poses(q)), compute_uv=False)[:, -1] > 0.03]
    assert len(q) > 15
    wanted = nominal.poses(q)
    for model in (ErrorModel(moved), ErrorModel(moved, effects)):
        commands, arrived = joint_commands(model, nominal, q)
        assert arrived.all()
        assert 1e-4 < np.abs(commands - q).max() < 0.2
        close(model.predict(commands), wanted.position, 1e-9)
        if not model.effects:
            close(moved.poses(commands).placement, wanted.placement, 2e-9)


def test_a_place_out_of_reach_is_not_reached(sino6):
    larger = with_dh_errors(sino6.file, sino6.dh.values() * [1, 1, 0, 0])
    q = np.array([[0.3, -1.57, 0.2, 0.0, 0.1, 0.2]])
    _, arrived = joint_commands(sino6, larger, q)
    assert not arrived.any()


def test_a_tip_that_is_a_target_gets_no_commands(robot_file, rng):
    """With a marker its commands are within the flange's own u."""
    text = robot_file("ur5_robot.urdf").read_text(encoding="utf-8")
    place = '<origin xyz="0.02 -0.03 0.06" rpy="0 0 0"/><parent link="tool0"/><child link="smr"/>'
    joint = f'<link name="smr"/><joint name="to_smr" type="fixed">{place}</joint>'
    with_target = robot_file("ur5_robot.urdf").with_name("with_target.urdf")
    with_target.write_text(text.replace("</robot>", f"{joint}</robot>"), encoding="utf-8")
    flange, target = (
        Arm.from_urdf(with_target, frame, **HALF_WIDTHS) for frame in ("tool0", "smr")
    )
    off = rng.normal(scale=1e-4, size=(6, 6))
    true, true_flange = (arm.with_placements(off, None) for arm in (target, flange))
    q = random_postures(flange, 60, rng)
    q = q[np.linalg.svd(jacobian_of(flange.poses(q)), compute_uv=False)[:, -1] > 0.05]
    points = true.positions(q) + 1e-6 * rng.normal(size=(len(q), 3))
    marker = Conditions(len(q), marker=np.full(len(q), "smr", dtype=object))
    noise = {"encoder_noise": 1e-7, "reference_noise": 1e-6, "hold_out": False}

    unknown = calibrate(flange, Measurements.of(q, points), target="unknown", **noise).model  # type: ignore[arg-type]
    with pytest.raises(AacmmError, match="marker"):
        joint_commands(unknown, flange, q)
    by_marker = calibrate(flange, Measurements.of(q, points, conditions=marker), **noise).model  # type: ignore[arg-type]
    commands, arrived = joint_commands(by_marker, flange, q)
    assert arrived.all()
    reached = np.linalg.norm(true_flange.positions(commands) - flange.positions(q), axis=1)
    assert reached.max() < 5e-4
