"""Calibrated kinematics of Universal Robots: file of the ROS description, DH table of the
controller.
"""

from __future__ import annotations

import configparser
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import BaseModel, Field, FiniteFloat, Json

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import screws, skew
from aacmm_pin.arm.corrected_urdf import from_roll_pitch_yaw, roll_pitch_yaw
from aacmm_pin.arm.dh_to_urdf import link_text, robot_text
from aacmm_pin.arm.file import validated
from aacmm_pin.arm.pinocchio_model import built_model
from aacmm_pin.errors import ArmFileError, UnknownNameError, UnsupportedArmError

UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
UR_BASES = ("base_link_inertia", "base")
"""Frames of the first link."""
UR_LIMITS = (-2.0 * np.pi, 2.0 * np.pi)
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
"""a of rows 2 and 3, and d of rows 1, 4, 5 and 6, by the maker [m]; others are zero."""
FAR_FROM_TABLE = 0.05
"""A link farther off is wrong, not calibrated [m]."""
LONGEST_LINK = 3.0
"""Between two joints [m]."""

Length = Annotated[float, Field(ge=-LONGEST_LINK, le=LONGEST_LINK)]
Turn = Annotated[float, Field(ge=-2.0 * np.pi, le=2.0 * np.pi)]
SixNumbers = Json[Annotated[list[FiniteFloat], Field(min_length=6, max_length=6)]]


class LinkInRosFile(BaseModel):
    """The placement of a joint in the link before [m, rad]."""

    x: Length
    y: Length
    z: Length
    roll: Turn
    pitch: Turn
    yaw: Turn


class LinksInRosFile(BaseModel):
    """The links, and the name of the calibration."""

    shoulder: LinkInRosFile
    upper_arm: LinkInRosFile
    forearm: LinkInRosFile
    wrist_1: LinkInRosFile
    wrist_2: LinkInRosFile
    wrist_3: LinkInRosFile
    hash: Any = None


class RosFile(BaseModel):
    """A kinematics file of the ROS description."""

    kinematics: LinksInRosFile


class ControllerFile(BaseModel):
    """Differences from the table of the maker in ``calibration.conf`` [rad, m]."""

    delta_theta: SixNumbers
    delta_d: SixNumbers
    delta_a: SixNumbers
    delta_alpha: SixNumbers


@dataclass(frozen=True, eq=False)
class UrKinematics:
    """The placements of a robot of Universal Robots.

    Attributes:
        name: hash of the calibration, or name of the robot.
        placements: of each joint (axis z), and of the tool, in the link before (7, 4, 4) [m].
    """

    name: str
    placements: list[Array]

    @staticmethod
    def read(path: str | Path, robot: str = "") -> UrKinematics:
        """Read a kinematics file of the ROS description (``.yaml``), or ``calibration.conf`` of the
        controller.

        Args:
            robot: name in :data:`UR_ROBOTS`, such as ``ur5e``, to whose table ``calibration.conf``
                adds.

        Raises:
            ArmFileError: the file cannot be read, or a value is missing or invalid.
            UnknownNameError: no such robot.
        """
        place = str(path)
        try:
            text = Path(path).read_text(encoding="utf-8-sig")
        except (OSError, UnicodeDecodeError) as error:
            raise ArmFileError(place, "", f"the file cannot be read: {error}") from None
        if place.lower().endswith(".conf"):
            return _kinematics_of_controller(text, place, robot.lower())
        try:
            content = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ArmFileError(place, "", str(error)) from None
        content = content if isinstance(content, dict) else {}
        kinematics = validated(RosFile, content, place).kinematics.model_dump()
        placements = []
        for link in UR_LINKS:
            x, y, z, roll, pitch, yaw = kinematics[link].values()
            placement = np.eye(4)
            placement[:3, :3] = from_roll_pitch_yaw(np.array([roll, pitch, yaw]))
            placement[:3, 3] = x, y, z
            placements.append(placement)
        return UrKinematics(str(kinematics["hash"] or "robot"), [*placements, np.eye(4)])

    @staticmethod
    def of(arm: Arm) -> UrKinematics:
        """Kinematics of an arm whose URDF has the links of such a robot.

        Raises:
            UnsupportedArmError: it has other joints, or joint axes other than z.
        """
        expected = [f"{joint}_joint" for joint in UR_JOINTS]
        if list(arm.joint_names) != expected:
            names = ", ".join(arm.joint_names)
            raise UnsupportedArmError(f"{arm.name}: joints {names}; expected {', '.join(expected)}")
        model = arm.model
        if any(joint.shortname() != "JointModelRZ" for joint in list(model.joints)[1:]):
            raise UnsupportedArmError(
                f"{arm.name}: joints about x or y; expected joints about z, as in the present ROS "
                "description of Universal Robots"
            )
        frames = {frame.name: frame.placement.homogeneous for frame in model.frames}
        base = next((frames[name] for name in UR_BASES if name in frames), np.eye(4))
        placements = [placement.homogeneous for placement in list(model.jointPlacements)[1:]]
        placements[0] = np.linalg.solve(base, placements[0])
        return UrKinematics(model.name, [*placements, frames[arm.tip]])

    @property
    def tool_moved(self) -> bool:
        """Whether the tool is not at the last link, unlike in the ROS file."""
        return not np.allclose(self.placements[-1], np.eye(4), rtol=0.0, atol=1e-9)

    def urdf(self) -> str:
        """The URDF from ``base`` to ``tool0``."""
        parts = ['<link name="base"/>']
        parent = "base"
        for joint, child, placement in zip(UR_JOINTS, UR_LINKS, self.placements, strict=False):
            name = f"{child}_link"
            parts.append(
                link_text(
                    name,
                    parent,
                    *_xyz_rpy(placement),
                    joint=f"{joint}_joint",
                    kind="revolute",
                    limits=UR_LIMITS,
                )
            )
            parent = name
        parts.append(link_text("tool0", parent, *_xyz_rpy(self.placements[-1])))
        return robot_text(self.name, parts)

    def arm(self) -> Arm:
        """Return the arm with its tip at ``tool0``."""
        return Arm.from_model(built_model(self.urdf(), self.name), "tool0")

    def text(self) -> str:
        """The kinematics file of the ROS description, without the tool."""
        kinematics: dict[str, Any] = {}
        for link, placement in zip(UR_LINKS, self.placements, strict=False):
            xyz, rpy = _xyz_rpy(placement)
            kinematics[link] = dict(zip(LinkInRosFile.model_fields, (*xyz, *rpy), strict=True))
        kinematics["hash"] = self.name
        return str(yaml.safe_dump({"kinematics": kinematics}, sort_keys=False))


def placements_of_dh(table: Array) -> list[Array]:
    """Placements of the joints and the tool in the link before, 7 of (4, 4) [m].

    ``table`` (4, 6) [rad, m] has theta, d, a, alpha of standard DH. Axes 2 to 4 are nearly
    parallel, and d of the controller may be hundreds of metres: joint 2 is put where row 1 ends,
    joint 3 in the plane through it perpendicular to axis 2. The tip stays in every posture.
    """
    theta, d, a, alpha = table
    frames = []
    ends = [np.eye(4)]
    for along_z, along_x in zip(screws(theta, d, 2), screws(alpha, a, 0), strict=True):
        frames.append(ends[-1] @ along_z)
        ends.append(frames[-1] @ along_x)
    second = ends[1]
    second_axis, third_axis = second[:3, 2], frames[2][:3, 2]
    cosine = second_axis @ third_axis
    beyond_plane = second_axis @ (frames[2][:3, 3] - second[:3, 3]) / cosine
    # The smallest rotation of axis 2 into axis 3, by Rodrigues' formula.
    across = skew(np.cross(second_axis, third_axis)[None])[0]
    rotation = np.eye(3) + across + across @ across / (1.0 + cosine)
    third = np.eye(4)
    third[:3, :3] = rotation @ second[:3, :3]
    third[:3, 3] = frames[2][:3, 3] - beyond_plane * third_axis
    chain = [np.eye(4), frames[0], second, third, *frames[3:], ends[-1]]
    return [np.linalg.solve(before, after) for before, after in itertools.pairwise(chain)]


def _xyz_rpy(placement: Array) -> tuple[list[float], list[float]]:
    return placement[:3, 3].tolist(), roll_pitch_yaw(placement[:3, :3]).tolist()


def _kinematics_of_controller(text: str, place: str, robot: str) -> UrKinematics:
    """From ``calibration.conf``, which has deltas (theta, d, a, alpha) to the maker's table."""
    if robot not in UR_ROBOTS:
        hint = f"state the robot of {place} with --ur-robot"
        raise UnknownNameError("robot", robot, list(UR_ROBOTS), hint)
    parser = configparser.ConfigParser(
        strict=False, interpolation=None, inline_comment_prefixes=("#", ";")
    )
    try:
        parser.read_string(f"[file]\n{text}")
    except configparser.Error as error:
        raise ArmFileError(place, "", " ".join(str(error).split())) from None
    stated = {key: value for section in parser.values() for key, value in section.items()}
    deltas = np.array([*validated(ControllerFile, stated, place).model_dump().values()])
    (a2, a3), (d1, d4, d5, d6) = UR_ROBOTS[robot]
    theta = np.zeros(6)
    d = np.array([d1, 0.0, 0.0, d4, d5, d6])
    a = np.array([0.0, a2, a3, 0.0, 0.0, 0.0])
    by_maker = np.stack([theta, d, a, UR_ALPHA])
    expected_placements = placements_of_dh(by_maker)
    placements = placements_of_dh(by_maker + deltas)
    for link, placement, expected in zip(UR_LINKS, placements, expected_placements, strict=False):
        distance = float(np.linalg.norm(placement[:3, 3] - expected[:3, 3]))
        if distance > FAR_FROM_TABLE:
            raise ArmFileError(
                place,
                link,
                f"{distance:.3g} m from where the table of {robot} has it; expected less than "
                f"{FAR_FROM_TABLE} m: check --ur-robot, and that lists are in m and rad",
            )
    return UrKinematics(robot, placements)
