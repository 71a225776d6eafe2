"""A URDF file with calibrated placements of its joints; the rest stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.urdf_check import parsed_urdf
from aacmm_pin.errors import AacmmError, UnsupportedArmError


def corrected_urdf(arm: Arm, tip_shift: Array | None = None) -> bytes:
    """The URDF of an arm with its present joint placements.

    Pinocchio gathers fixed joints into the placement of the next moving joint. A correction acts
    after it, so the origin of the moving joint becomes ``origin (placement_before⁻¹
    placement_after)``.

    Args:
        tip_shift: of the tip in its own axes (3,) [m], or None.
    """
    urdf = arm.urdf_file.urdf
    if not urdf.file:
        raise UnsupportedArmError(
            f"{arm.name}: this arm has no URDF file; expected an arm from a URDF file"
        )
    try:
        content = Path(urdf.file).read_bytes()
    except OSError as error:
        raise AacmmError(f"{urdf.file}: the file cannot be read: {error.strerror}") from None
    robot = parsed_urdf(content, urdf.file)
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    motions = {}  # of each joint's placement, in its own axes
    placements = zip(arm.nominal.jointPlacements, arm.model.jointPlacements, strict=True)
    for name, (before, after) in zip(arm.model.names, placements, strict=True):
        if before != after:
            motions[name] = before.actInv(after)
    if tip_shift is not None and np.any(tip_shift):
        carriers = [
            name
            for name, joint in joints.items()
            if joint.get("type") == "fixed" and joint.find("child").get("link") == arm.tip
        ]
        if not carriers:
            raise UnsupportedArmError(
                f"{arm.name}: no fixed joint carries the frame {arm.tip!r} alone; to shift the "
                "tip, add a fixed joint before this frame to the URDF"
            )
        motions[carriers[0]] = pin.SE3(np.eye(3), np.array(tip_shift))
    if not motions:
        return content
    for name, motion in motions.items():
        origin = joints[name].find("origin")
        if origin is None:
            origin = etree.SubElement(joints[name], "origin")
        shift, angles = (
            np.array(origin.get(key, "0 0 0").split(), dtype=np.float64) for key in ("xyz", "rpy")
        )
        corrected = pin.SE3(from_roll_pitch_yaw(angles), shift) * motion
        numbers = {"xyz": corrected.translation, "rpy": roll_pitch_yaw(corrected.rotation)}
        for key, values in numbers.items():
            origin.set(key, " ".join(f"{value:.17g}" for value in values))
    tree = robot.getroottree()
    return bytes(
        etree.tostring(tree, xml_declaration=True, encoding=tree.docinfo.encoding or "utf-8")
    )


def from_roll_pitch_yaw(angles: Array) -> Array:
    """``Rz(yaw) Ry(pitch) Rx(roll)`` of roll, pitch, yaw of URDF (3,) [rad]: (3, 3)."""
    return np.asarray(pin.rpy.rpyToMatrix(angles))


def roll_pitch_yaw(rotation: Array) -> Array:
    """Roll, pitch, yaw of URDF (3,) [rad] of a rotation (3, 3)."""
    return np.asarray(pin.rpy.matrixToRpy(rotation))
