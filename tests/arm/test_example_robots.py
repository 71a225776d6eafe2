"""Arms of example-robot-data by name."""

from __future__ import annotations

import pytest

from aacmm_pin.arm import EXAMPLE_ROBOTS, Arm
from aacmm_pin.effects import ErrorModel
from tests.oracle import close

pytestmark = pytest.mark.fast

JOINTS = {"panda": 7, "so100": 5, "so101": 5, "tiago": 8, "xarm7": 7}


@pytest.mark.parametrize("name", EXAMPLE_ROBOTS)
def test_a_robot_is_an_arm_by_name(name):
    arm = ErrorModel.load(name).arm
    q = arm.limits.clip(-1.0, 1.0).mean(axis=1)[None]
    assert (arm.nq, arm.tip) == (JOINTS.get(name, 6), EXAMPLE_ROBOTS[name][1])
    close(arm.positions(q), arm.poses(q).position, 1e-13)


def test_another_frame_and_half_widths():
    arm = Arm.from_urdf("ur5", "ee_link", translation_half_width=1e-4)
    assert (arm.tip, arm.parameters[0].half_width) == ("ee_link", 1e-4)
