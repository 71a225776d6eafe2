"""A URDF file with the placements of its joints as a calibration found them; all else stays byte for byte as it was."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np
import pinocchio as pin

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.errors import AacmmError, UnsupportedArmError

_TAG = re.compile(rb"""<(?:[^>"']|"[^"]*"|'[^']*')*>""")


@dataclass
class _Joint:
    """Where a joint states its origin.

    Attributes:
        kind: type of the joint.
        start, end: bytes of its tag ``<origin …>``; both behind the joint's own tag where it has none.
        closed: True where the tag has no end tag of its own.
        origin: attributes of that tag.
        child: link that it carries.
    """

    kind: str
    start: int
    end: int
    closed: bool = True
    origin: dict[str, str] = field(default_factory=dict)
    child: str = ""


def corrected_urdf(arm: Arm, tip_shift: Array | None = None) -> bytes:
    """The URDF file that an arm came from, with the joint placements that the arm has now.

    Pinocchio gathers fixed joints into the placement of the next moving one. A correction acts behind that placement, so
    it goes into the origin of the moving joint alone: ``origin_new = origin (placement_before⁻¹ placement_after)``.

    Args:
        arm: the arm.
        tip_shift: of the tip in its own axes (3,) [m]; None where it stays.

    Raises:
        AacmmError: the file cannot be read, or was changed since the arm was made from it.
        UnsupportedArmError: the arm did not come as a URDF file; or the tip is to be shifted, but its link has no fixed
            joint of its own.
    """
    urdf = arm.urdf_file.urdf
    if not urdf.file:
        raise UnsupportedArmError(f"{arm.name}: was made from no file that could be corrected; a pipe is none")
    try:
        text = Path(urdf.file).read_bytes()
        if hashlib.sha256(text).hexdigest() != urdf.sha256:
            raise AacmmError(f"it was changed since {arm.name} was made from it")
        joints = _joints(text)
    except OSError as error:
        raise AacmmError(f"{urdf.file}: cannot be read: {error.strerror}") from None
    except (AacmmError, expat.ExpatError) as error:
        raise AacmmError(f"{urdf.file}: cannot be corrected: {error}") from None
    motions = {}
    for number, name in enumerate(arm.joint_names, start=1):
        old, new = (model.jointPlacements[number] for model in (arm.nominal, arm.model))
        if old != new:
            motions[name] = old.actInv(new)
    if tip_shift is not None and np.any(tip_shift):
        motions[_joint_of_tip(joints, arm)] = pin.SE3(np.eye(3), np.array(tip_shift))
    for name in sorted(motions, key=lambda name: -joints[name].start):  # from the end, so that earlier places stay
        text = _moved(text, joints[name], motions[name])
    return text


def _joints(text: bytes) -> dict[str, _Joint]:
    """The joints of a URDF by name."""
    joints: dict[str, _Joint] = {}
    path: list[str] = []
    parser = expat.ParserCreate()

    def span(name: str) -> tuple[int, int]:
        tag = _TAG.match(text, parser.CurrentByteIndex)
        if tag is None or not tag[0].startswith(b"<" + name.encode()):
            raise AacmmError("its encoding has tags that are not ASCII, expected UTF-8")
        return tag.span()

    def start(name: str, attributes: dict[str, str]) -> None:
        if path == ["robot"] and name == "joint":
            behind = span(name)[1]
            joints[attributes.get("name", "")] = _Joint(attributes.get("type", ""), behind, behind)
        elif path == ["robot", "joint"] and name in ("origin", "child"):
            joint = list(joints.values())[-1]
            if name == "child":
                joint.child = attributes.get("link", "")
            else:
                joint.start, joint.end = span(name)
                joint.origin, joint.closed = attributes, text[: joint.end].endswith(b"/>")
        path.append(name)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: path.pop()
    parser.Parse(text, True)
    return joints


def _joint_of_tip(joints: dict[str, _Joint], arm: Arm) -> str:
    for name, joint in joints.items():
        if joint.child == arm.tip and joint.kind == "fixed":
            return name
    raise UnsupportedArmError(f"{arm.name}: {arm.tip!r} has no fixed joint of its own that could take the shift of the tip")


def _moved(text: bytes, joint: _Joint, motion: Any) -> bytes:
    """The file with the origin of one joint multiplied by ``motion`` from the right."""
    xyz, rpy = (np.array([float(v) for v in joint.origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
    placement = pin.SE3(from_roll_pitch_yaw(rpy), xyz) * motion
    xyz, rpy = placement.translation, pin.rpy.matrixToRpy(placement.rotation)
    numbers = (" ".join(f"{value:.17g}" for value in values) for values in (xyz, rpy))
    tag = '<origin xyz="{}" rpy="{}"{}>'.format(*numbers, "/" * joint.closed)
    return text[: joint.start] + tag.encode() + text[joint.end :]


def from_roll_pitch_yaw(angles: Array) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)`` of URDF's roll, pitch, yaw (3,) [rad], turns about fixed axes: (3, 3)."""
    return np.asarray(pin.rpy.rpyToMatrix(angles))
