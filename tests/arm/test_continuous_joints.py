"""Continuous joints are where Pinocchio has them, by cosine and sine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm
from tests.oracle import close

pytestmark = pytest.mark.fast

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


def test_continuous_joints_turn_twice_either_way(tmp_path, rng):
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
        close(arm.poses(q).placement, expected, 1e-13)
