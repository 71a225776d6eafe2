"""The DH table of a URDF: by Pinocchio it is the same arm, with base, tip, masses and limits."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.file import arm_text, parse_arm_file
from aacmm_pin.arm.urdf_to_dh import dh_file
from aacmm_pin.errors import UnsupportedArmError
from tests.oracle import close

pytestmark = pytest.mark.fast


def assert_same(arm: Arm, rng: np.random.Generator) -> None:
    """Poses of base, tip and bodies: what the written table says, by Pinocchio, beside the URDF."""
    again = Arm.from_file(parse_arm_file(arm_text(dh_file(arm)).encode(), "dh.toml"))
    q = rng.uniform(-3.0, 3.0, (200, arm.nq))
    close(again.poses(q).placement, arm.poses(q).placement, 1e-12)
    assert again.dh is not None
    close(again.dh.chain.positions(q), arm.poses(q).position, 1e-12)
    np.testing.assert_array_equal(again.limits, arm.limits)
    for configuration in q[:5]:  # the weights' torques know every mass and its centre
        torques = [
            pin.computeGeneralizedGravity(a.model, a.model.createData(), configuration)
            for a in (again, arm)
        ]
        np.testing.assert_allclose(*torques, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "frame", "rows"),
    [
        ("ur5_robot.urdf", "tool0", 8),
        ("panda.urdf", "panda_hand_tcp", 7),
        ("panda.urdf", "panda_link5", 5),
        ("panda.urdf", "panda_leftfinger", 8),
    ],
)
def test_robots(name, frame, rows, robot_file, rng):
    arm = Arm.from_urdf(robot_file(name), frame)
    assert_same(arm, rng)
    file = dh_file(arm)
    assert len(file.joints) == rows
    if frame == "panda_hand_tcp":  # the table that its maker prints, in another convention
        close([row.d_mm for row in file.joints], [333, 0, 316, 0, 384, 0, 210.4], 1e-9)
        close([row.a_mm for row in file.joints], [0, 0, 82.5, -82.5, 0, 88, 0], 1e-9)


def tilted(rng: np.random.Generator) -> Array:
    """A rotation whose z is parallel to the old, or nearly so, or opposite, or across, or
    anyhow.
    """
    small = 10.0 ** rng.uniform(-16, -1)
    tilt = rng.choice([0.0, small, np.pi - small, np.pi, np.pi / 2, rng.uniform(0, np.pi)])
    about, turn = rng.uniform(-np.pi, np.pi, 2)
    return np.array(
        pin.exp3(tilt * np.array([np.cos(about), np.sin(about), 0.0]))
        @ pin.exp3(np.array([0.0, 0.0, turn]))
    )


def test_random_chains(rng):
    """Axes for which a common normal is not unique, far away or of no length are among them."""
    for _ in range(60):
        model, joint, limits = pin.Model(), 0, [np.array([v]) for v in (1.0, 1.0, -2.0, 3.0)]
        for number in range(int(rng.integers(1, 8))):
            where = pin.SE3(tilted(rng), rng.normal(size=3) * rng.integers(0, 2, 3))
            kind = pin.JointModelPZ() if rng.random() < 0.2 else pin.JointModelRZ()
            joint = model.addJoint(joint, kind, where, f"j{number}", *limits)
            body = pin.Inertia(rng.uniform(0.1, 2), rng.normal(size=3), np.eye(3))
            model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        where = pin.SE3(tilted(rng), np.array([rng.integers(0, 2), 0.0, 1.0]))
        model.addFrame(pin.Frame("tip", joint, where, pin.FrameType.OP_FRAME))
        model.name = "random"
        assert_same(Arm.from_model(model, "tip"), rng)


def test_arms_with_a_table_are_refused():
    with pytest.raises(UnsupportedArmError, match="has a DH table"):
        dh_file(Arm.load("sino6"))
