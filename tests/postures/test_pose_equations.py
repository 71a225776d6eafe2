"""Equations of a pose: derivatives by differences, angles by SciPy, none zero half a turn away;
what cannot be asked.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.errors import AacmmError, ShapeError, UnsupportedArmError
from aacmm_pin.postures.general_ik import reaching_postures
from aacmm_pin.postures.pose_equations import Equations
from tests.oracle import close, derivative

pytestmark = pytest.mark.fast

ANGLES = [0.0, 1e-13, 1e-7, 9e-4, 1.1e-3, 0.5, 2.0, 3.1, np.pi - 1e-5]
SLIDING = """\
<robot name="slide"> <link name="base"/> <link name="tool"/>
  <joint name="rail" type="prismatic">
    <parent link="base"/> <child link="tool"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/> </joint>
</robot>
"""


def by_differences(equations: Equations, q: Array) -> Array:
    """Derivatives (k, joints) at ``q`` (joints,)."""
    zero = np.zeros(1, dtype=np.intp)
    return derivative(lambda q: equations(q[None], zero)[0][0], q)


@pytest.mark.parametrize("angle", ANGLES)
def test_turns_are_the_logarithm_and_pointing_is_an_angle(sino6, rng, angle):
    zero = np.zeros(1, dtype=np.intp)
    for q in rng.uniform(-np.pi, np.pi, (20, 6)):
        pose = sino6.poses(q[None]).placement[0]
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        wanted = Rotation.from_rotvec(-angle * axis).as_matrix() @ pose[:3, :3]
        across = np.cross(pose[:3, 1], axis)
        across /= np.linalg.norm(across)
        goal = Rotation.from_rotvec(angle * across).as_matrix() @ pose[:3, 1]
        links, place = sino6.chain.links(), pose[None, :3, 3]
        off = Equations.of_pose(links, place, wanted)
        pointing = Equations.of_axis(links, place, np.array([0.0, 1.0, 0.0]), goal)
        within = 1e-14 + 1e-9 * angle
        close(wanted @ off(q[None], zero)[0][0, 3:], angle * axis, within)
        assert np.linalg.norm(pointing(q[None], zero)[0][0, 3:]) == pytest.approx(
            angle, rel=1e-9, abs=1e-14
        )
        if angle < 3.14:
            for equations in (off, pointing):
                close(equations(q[None], zero)[1][0], by_differences(equations, q), 2e-7)


# --- what is refused


def test_unusable_conditions(sino6, robot_file, tmp_path):
    up, free = (
        {"axis": [0, 0, 1]},
        "6 joints at a point; expected 3 or 4 for a point, 5 or 6 for a point and an axis",
    )
    asked: list[tuple[dict[str, Any], type[AacmmError], str]] = [
        ({}, UnsupportedArmError, free),
        ({"axis": [0, 0, 0]}, AacmmError, r"axis is \[0, 0, 0\]; expected a direction"),
        ({"tool": [0, 0, 1]}, AacmmError, "tool requires axis"),
        (up | {"rotation": np.eye(3)}, AacmmError, "expected one of the two"),
        ({"rotation": np.eye(4)}, ShapeError, r"rotation has shape \(16,\)"),
        ({"rotation": 1.1 * np.eye(3)}, ShapeError, "1.0e-01"),
        ({"rotation": -np.eye(3)}, ShapeError, "right-handed"),
    ]
    for given, error, said in asked:
        with pytest.raises(error, match=said):
            reaching_postures(sino6, [0.3, 0.2, 0.1], **given)
    (tmp_path / "slide.urdf").write_text(SLIDING, encoding="utf-8")
    with pytest.raises(UnsupportedArmError, match="slide: joint 1 "):
        reaching_postures(Arm.from_urdf(tmp_path / "slide.urdf", "tool"), [0, 0, 0])
    five = Arm.from_urdf(robot_file("so101.urdf"), "gripper_frame_link")
    with pytest.raises(
        UnsupportedArmError,
        match="5 joints at a full pose; expected 3 or 4 for a point, 5 or 6 for a point and an",
    ):
        reaching_postures(five, [0.1, 0, 0.1], rotation=np.eye(3))
