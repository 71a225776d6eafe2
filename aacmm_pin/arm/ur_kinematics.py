"""Kinematics of one robot of Universal Robots, as its maker calibrated it: the file of the ROS
description, and the Denavit–Hartenberg table of the controller.
"""

from __future__ import annotations

import configparser
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.urdf import fixed_link, moving_link
from aacmm_pin.errors import ArmFileError, UnknownNameError, UnsupportedArmError

UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
UR_LIMITS = (-2.0 * np.pi, 2.0 * np.pi)
UR_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
UR_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
UR_ROBOTS = {
    "ur3": ((-0.24365, -0.21325), (0.1519, 0.11235, 0.08535, 0.0819)),
    "ur5": ((-0.425, -0.39225), (0.089159, 0.10915, 0.09465, 0.0823)),
    "ur10": ((-0.612, -0.5723), (0.1273, 0.163941, 0.1157, 0.0922)),
    "ur3e": ((-0.24355, -0.2132), (0.15185, 0.13105, 0.08535, 0.0921)),
    "ur5e": ((-0.425, -0.3922), (0.1625, 0.1333, 0.0997, 0.0996)),
    "ur10e": ((-0.6127, -0.57155), (0.1807, 0.17415, 0.11985, 0.11655)),
    "ur16e": ((-0.4784, -0.36), (0.1807, 0.17415, 0.11985, 0.11655)),
    "ur20": ((-0.862, -0.7287), (0.2363, 0.201, 0.1593, 0.1543)),
    "ur30": ((-0.637, -0.5037), (0.2363, 0.201, 0.1593, 0.1543)),
}
"""Lengths a of rows 2 and 3, and d of rows 1, 4, 5 and 6, by the maker's table [m]; all other
lengths are zero."""
UR_FILES = (".yaml", ".yml", ".conf")
"""Ends of the names of such files."""


def ur_urdf(path: str | Path, robot: str = "") -> str:
    """URDF of a robot of Universal Robots by its own calibration, from ``base`` to ``tool0``.

    Args:
        path: kinematics file of the ROS description (``.yaml``), or ``calibration.conf`` of the
            controller, whose ``delta_…`` are added to the maker's table.
        robot: name in :data:`UR_ROBOTS`, such as ``ur5e``; only ``calibration.conf`` needs it.

    Raises:
        ArmFileError: the file cannot be read, or lacks a value.
        UnknownNameError: no such robot.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ArmFileError(str(path), "", f"the file cannot be read: {error}") from None
    if Path(path).suffix == ".conf":
        name, placements = robot, placements_of_dh(_table(text, str(path), robot))
    else:
        name, placements = _of_yaml(text, str(path))
    root = ET.Element("robot", name=name)
    link = ET.SubElement(root, "link", name="base")
    for joint, child, placement in zip(UR_JOINTS, UR_LINKS, placements, strict=False):
        names = f"{child}_link", f"{joint}_joint"
        link = moving_link(root, link, *names, "revolute", UR_LIMITS, *_xyz_rpy(placement))
    fixed_link(root, link, "tool0", *_xyz_rpy(placements[-1]))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def ur_kinematics(arm: Arm) -> str:
    """The kinematics file of the ROS description for an arm from :func:`ur_urdf`.

    A placement of the tip is not part of the file. The robot's name in the URDF becomes the hash.

    Raises:
        UnsupportedArmError: the joints are not those of a robot of Universal Robots.
    """
    expected = [f"{joint}_joint" for joint in UR_JOINTS]
    if list(arm.joint_names) != expected:
        raise UnsupportedArmError(
            f"{arm.name}: joints {', '.join(arm.joint_names)}; expected {', '.join(expected)}"
        )
    kinematics: dict[str, Any] = {}
    for link, placement in zip(UR_LINKS, arm.model.jointPlacements[1:7], strict=True):
        xyz, rpy = _xyz_rpy(placement.homogeneous)
        kinematics[link] = dict(zip(UR_KEYS, (*xyz, *rpy), strict=True))
    kinematics["hash"] = arm.model.name
    return str(yaml.safe_dump({"kinematics": kinematics}, sort_keys=False))


def placements_of_dh(table: Array) -> list[Array]:
    """Placement of each joint in the link before it, and of the tool in the last (7 of (4, 4)) [m].

    The axes of joints 2 to 4 are nearly parallel, and the controller's d of these rows may be
    hundreds of metres. Frames of joints 2 and 3 may stand anywhere along their axes and have any
    angle about it: joint 2 where row 1 ends, joint 3 in the plane through it perpendicular to axis
    2, turned no more than the axis is. The tip stays at every posture.

    Args:
        table: theta, d, a, alpha of standard Denavit–Hartenberg rows (4, 6) [rad, m].
    """
    frames = []
    ends = [np.eye(4)]
    for theta, d, a, alpha in table.T:
        frames.append(ends[-1] @ _placement([0.0, 0.0, d], [0.0, 0.0, theta]))
        ends.append(frames[-1] @ _placement([a, 0.0, 0.0], [alpha, 0.0, 0.0]))
    second, axis = ends[1], frames[2][:3, 2]
    normal = second[:3, 2]
    beyond = normal @ (frames[2][:3, 3] - second[:3, 3]) / (normal @ axis)
    turn, _ = Rotation.align_vectors(axis, normal)
    third = np.eye(4)
    third[:3, :3] = turn.as_matrix() @ second[:3, :3]
    third[:3, 3] = frames[2][:3, 3] - beyond * axis
    chain = [np.eye(4), frames[0], second, third, *frames[3:], ends[-1]]
    return [np.linalg.solve(before, after) for before, after in itertools.pairwise(chain)]


def _placement(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """By the numbers of a URDF (4, 4)."""
    placement = np.eye(4)
    placement[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    placement[:3, 3] = xyz
    return placement


def _xyz_rpy(placement: Array) -> tuple[list[float], list[float]]:
    """The numbers of a URDF for a placement (4, 4)."""
    rpy = Rotation.from_matrix(placement[:3, :3]).as_euler("xyz")
    return placement[:3, 3].tolist(), rpy.tolist()


def _table(text: str, place: str, robot: str) -> Array:
    """Theta, d, a, alpha of the maker's table with the deltas of a controller (4, 6)."""
    if robot not in UR_ROBOTS:
        raise UnknownNameError("robot", robot, list(UR_ROBOTS))
    (a2, a3), (d1, d4, d5, d6) = UR_ROBOTS[robot]
    nominal: dict[str, tuple[float, ...]] = {
        "theta": 6 * (0.0,),
        "d": (d1, 0.0, 0.0, d4, d5, d6),
        "a": (0.0, a2, a3, 0.0, 0.0, 0.0),
        "alpha": UR_ALPHA,
    }
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise ArmFileError(place, "", str(error)) from None
    stated = {key: value for section in parser.values() for key, value in section.items()}
    rows = []
    for name, values in nominal.items():
        try:
            deltas = json.loads(stated.get(f"delta_{name}", "null"))
        except json.JSONDecodeError:
            deltas = stated[f"delta_{name}"]
        rows.append(_numbers(deltas, place, f"delta_{name}") + np.array(values))
    return np.array(rows)


def _of_yaml(text: str, place: str) -> tuple[str, list[Array]]:
    """Hash and placements of a kinematics file, the tool in the last link."""
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ArmFileError(place, "", str(error)) from None
    kinematics = content.get("kinematics") if isinstance(content, dict) else None
    if not isinstance(kinematics, dict):
        raise ArmFileError(
            place, "kinematics", f"missing; expected the links {', '.join(UR_LINKS)}"
        )
    placements = []
    for link in UR_LINKS:
        values = kinematics.get(link)
        stated = [values.get(key) for key in UR_KEYS] if isinstance(values, dict) else values
        numbers = _numbers(stated, place, f"kinematics.{link}")
        placements.append(_placement(numbers[:3].tolist(), numbers[3:].tolist()))
    return str(kinematics.get("hash", "robot")), [*placements, np.eye(4)]


def _numbers(values: object, place: str, key: str) -> Array:
    """Six finite numbers."""
    numbers = values if isinstance(values, list) else []
    if len(numbers) != 6 or not all(isinstance(v, int | float) for v in numbers):
        raise ArmFileError(place, key, f"{values!r}; expected six numbers")
    if not np.isfinite(numbers).all():
        raise ArmFileError(place, key, f"{values!r}; expected finite numbers")
    return np.array(numbers, dtype=np.float64)
