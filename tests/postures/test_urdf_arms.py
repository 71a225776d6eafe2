"""Serial arms of example-robot-data: each loads, is where Pinocchio has it, and has an accuracy;
continuous joints too.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin import accuracy_volume
from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures

pytestmark = pytest.mark.fast

ARMS = [
    ("ur3_robot.urdf", "tool0", 6),
    ("panda.urdf", "panda_hand_tcp", 7),
    (
        "panda.urdf",
        "panda_leftfinger",
        8,
    ),  # a finger slides, and is a joint of the arm that carries it
    ("panda.urdf", "panda_rightfinger", 8),  # a mimic, alone
    ("kinova.urdf", "j2s6s200_end_effector", 6),
    ("xarm7.urdf", "link_eef", 7),
    ("z1.urdf", "gripperStator", 6),
    ("so100.urdf", "gripper", 5),
]
CONTINUOUS = """\
<?xml version="1.0"?>
<robot name="endless" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <link name="base"/> <link name="one"/> <link name="two"/> <link name="wheel"/>
  <joint name="first" type="continuous">
    <parent link="base"/> <child link="one"/>
    <axis xyz="0 0.6 0.8"/> <origin xyz="0.1 0 1" rpy="0.3 0 0.2"/>
  </joint>
  <joint name="second" type="continuous">
    <parent link="one"/> <child link="two"/> <axis xyz="1 0 0"/> <origin xyz="0.5 0 0"/> {limit}
  </joint>
  <joint name="beside" type="continuous"> <parent link="base"/> <child link="wheel"/> </joint>
</robot>
"""


def by_pinocchio(path: Path, frame: str, names: list[str], q: Array) -> Array:
    """Placements (n, 4, 4) by Pinocchio's own model of the file, its continuous joints as cosine
    and sine.
    """
    model = pin.buildModelFromUrdf(str(path))
    data, number = model.createData(), model.getFrameId(frame, pin.FrameType.BODY)
    placements = []
    for row in q:
        there = pin.neutral(model)
        for name, angle in zip(names, row, strict=True):
            joint = model.joints[model.getJointId(name)]
            there[joint.idx_q : joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            )
        pin.framesForwardKinematics(model, data, there)
        placements.append(data.oMf[number].homogeneous.copy())
    return np.array(placements)


@pytest.mark.parametrize(("file", "frame", "joints"), ARMS)
def test_every_arm_loads_and_has_accuracy(
    robot_file: Callable[[str], Path], rng: np.random.Generator, file: str, frame: str, joints: int
) -> None:
    arm = Arm.from_urdf(
        robot_file(file), frame, translation_half_width=1e-4, rotation_half_width=2e-4
    )
    assert (arm.nq, arm.tip) == (joints, frame)
    assert np.isfinite(arm.limits).all()
    assert (arm.limits[:, 1] > arm.limits[:, 0]).all()
    q = random_postures(arm, 20, rng)
    expected = by_pinocchio(robot_file(file), frame, list(arm.model.names)[1:], q)
    np.testing.assert_allclose(arm.poses(q).placement, expected, rtol=0, atol=1e-12)
    accuracy = accuracy_volume(arm, q)
    assert (accuracy.u > 0).all()
    assert (accuracy.volume > 0).all()


def test_continuous_joints_turn_twice_either_way(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "endless.urdf"
    for limit in (
        "",
        '<limit effort="1" velocity="1"/>',
        '<limit lower="-1" upper="1" effort="1" velocity="1"/>',
    ):
        path.write_text(CONTINUOUS.format(limit=limit), encoding="utf-8")
        arm = Arm.from_urdf(path, "two")
        np.testing.assert_allclose(arm.limits, 2 * np.pi * np.array([[-1, 1], [-1, 1]]), rtol=1e-15)
        q = rng.uniform(*arm.limits.T, (20, 2))
        expected = by_pinocchio(path, "two", ["first", "second"], q)
        np.testing.assert_allclose(arm.poses(q).placement, expected, rtol=0, atol=1e-13)
