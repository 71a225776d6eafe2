"""Arms of example-robot-data by name: URDF, and frame of the tip."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

from aacmm_pin.errors import AacmmError

PACKAGE = "example-robot-data"
EXAMPLE_ROBOTS = {
    "kinova": ("kinova.urdf", "j2s6s200_end_effector"),
    "panda": ("panda.urdf", "panda_hand_tcp"),
    "so100": ("so100.urdf", "gripper"),
    "so101": ("so101.urdf", "gripper_frame_link"),
    "talos_arm": ("talos_left_arm.urdf", "arm_left_7_link"),
    "tiago": ("tiago.urdf", "arm_tool_link"),
    "ur3": ("ur3_robot.urdf", "tool0"),
    "ur5": ("ur5_robot.urdf", "tool0"),
    "ur10": ("ur10_robot.urdf", "tool0"),
    "xarm7": ("xarm7.urdf", "link_eef"),
    "z1": ("z1.urdf", "link06"),
}
"""URDF, and default frame of the tip."""


def urdf_of_robot(name: str) -> Path:
    """Path of the URDF of one of :data:`EXAMPLE_ROBOTS`."""
    wanted, _ = EXAMPLE_ROBOTS[name]
    try:
        files = importlib.metadata.distribution(PACKAGE).files or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == wanted:
            return Path(str(file.locate()))
    raise AacmmError(
        f"{name}: the file {wanted} is missing; install the package {PACKAGE} from PyPI"
    )
