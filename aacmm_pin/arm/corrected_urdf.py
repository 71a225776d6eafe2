"""A URDF file with the placements of its joints as a calibration found them; all else stays byte for byte as it was."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.errors import AacmmError, UnsupportedArmError

_TAG = re.compile(rb"""<(?:[^>"']|"[^"]*"|'[^']*')*>""")


@dataclass
class _Joint:
    """Where a joint states its origin.

    Attributes:
        start, end: bytes of its tag ``<origin …>``; both behind the joint's own tag where it has none.
        attributes: of that tag.
        kind: type of the joint.
        child: link that it carries.
    """

    start: int
    end: int
    kind: str
    attributes: dict[str, str] | None = None
    child: str = ""


@dataclass
class _Reader:
    """Finds the joints of a URDF."""

    text: bytes
    joints: dict[str, _Joint] = field(default_factory=dict)
    path: list[str] = field(default_factory=list)

    def read(self) -> dict[str, _Joint]:
        """The joints by name.

        Raises:
            AacmmError: the text is not XML.
        """
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = lambda name: self.path.pop()
        try:
            self.parser.Parse(self.text, True)
        except expat.ExpatError as error:
            raise AacmmError(f"not XML: {error}") from None
        return self.joints

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if self.path == ["robot"] and name == "joint":
            end = self._tag(name)[1]
            self.joints[attributes.get("name", "")] = _Joint(end, end, attributes.get("type", ""))
        elif self.path == ["robot", "joint"] and self.joints:
            joint = list(self.joints.values())[-1]
            if name == "origin":
                joint.start, joint.end = self._tag(name)
                joint.attributes = attributes
            elif name == "child":
                joint.child = attributes.get("link", "")
        self.path.append(name)

    def _tag(self, name: str) -> tuple[int, int]:
        found = _TAG.match(self.text, self.parser.CurrentByteIndex)
        if found is None or not found[0].startswith(b"<" + name.encode()):
            raise AacmmError("the XML is not in an encoding whose tags are ASCII, expected UTF-8")
        return found.span()


def corrected_urdf(before: Arm, after: Arm, tip_shift: Array | None = None) -> bytes:
    """The URDF file of ``before`` with the joint placements of ``after``.

    Pinocchio gathers fixed joints into the placement of the next moving one. A correction acts behind that placement, so
    it goes into the origin of the moving joint alone: ``origin_new = origin (placement_before⁻¹ placement_after)``.

    Args:
        before: the arm as :meth:`Arm.from_urdf` made it.
        after: the same with other placements.
        tip_shift: of the tip in its own axes (3,) [m]; None where it stays.

    Raises:
        AacmmError: the file cannot be read, or does not have the joints of ``before``.
        UnsupportedArmError: the tip is to be shifted, but its link has no fixed joint of its own.
    """
    try:
        text = Path(before.source).read_bytes()
    except OSError as error:
        raise AacmmError(f"{before.source}: cannot be read: {error.strerror}") from None
    try:
        joints = _Reader(text).read()
    except AacmmError as error:
        raise AacmmError(f"{before.source}: {error}") from None
    motions = {}
    for number in range(1, before.model.njoints):
        name = before.model.names[number]
        if name not in joints:
            raise AacmmError(f"{before.source}: has no joint {name!r}; expected the file that {before.name} was made from")
        old, new = (arm.model.jointPlacements[number].homogeneous for arm in (before, after))
        motions[name] = np.linalg.solve(old, new)
    if tip_shift is not None and np.any(tip_shift):
        motions[_joint_of_tip(joints, before)] = _shift(tip_shift)
    for name in sorted(motions, key=lambda name: -joints[name].start):  # from the end, so that earlier places stay
        if np.abs(motions[name] - np.eye(4)).max() > 1e-15:
            text = _moved(text, joints[name], motions[name])
    return text


def _joint_of_tip(joints: dict[str, _Joint], arm: Arm) -> str:
    for name, joint in joints.items():
        if joint.child == arm.tip and joint.kind == "fixed":
            return name
    raise UnsupportedArmError(f"{arm.name}: {arm.tip!r} has no fixed joint of its own that could take the shift of the tip")


def _shift(shift: Array) -> Array:
    motion = np.eye(4)
    motion[:3, 3] = shift
    return motion


def _moved(text: bytes, joint: _Joint, motion: Array) -> bytes:
    """The file with the origin of one joint multiplied by ``motion`` (4, 4) from the right."""
    placement = _placement(joint.attributes or {}) @ motion
    xyz = " ".join(f"{value:.17g}" for value in placement[:3, 3])
    rpy = " ".join(f"{value:.17g}" for value in roll_pitch_yaw(placement[:3, :3]))
    closed = joint.attributes is None or text[: joint.end].endswith(b"/>")
    tag = f'<origin xyz="{xyz}" rpy="{rpy}"{"/" * closed}>'
    return text[: joint.start] + tag.encode() + text[joint.end :]


def _placement(origin: dict[str, str]) -> Array:
    x, y, z = (float(value) for value in origin.get("xyz", "0 0 0").split())
    placement = _shift(np.array([x, y, z]))
    placement[:3, :3] = from_roll_pitch_yaw(np.array([float(value) for value in origin.get("rpy", "0 0 0").split()]))
    return placement


def from_roll_pitch_yaw(angles: Array) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)`` of URDF's roll, pitch, yaw (3,) [rad], turns about fixed axes: (3, 3)."""
    roll, pitch, yaw = angles
    return _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles with ``rotation = Rz(yaw) Ry(pitch) Rx(roll)``, (3,) [rad], as exact where pitch is ±90° as elsewhere.

    There only the sum or difference of roll and yaw is told; roll is worked out for whatever yaw came out.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    rest = _about(2, -yaw) @ rotation
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw])


def _about(axis: int, angle: float) -> Array:
    """Rotation about x (0), y (1) or z (2) (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    i, k = [(1, 2), (2, 0), (0, 1)][axis]
    rotation = np.eye(3)
    rotation[i, i] = rotation[k, k] = c
    rotation[i, k], rotation[k, i] = -s, s
    return rotation
