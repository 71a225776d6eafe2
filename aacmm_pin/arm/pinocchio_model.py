"""The serial arm in a Pinocchio model: frames, joints, axes, chain."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.plausible import MOST_JOINTS
from aacmm_pin.arm.chain import Chain, end
from aacmm_pin.arm.couplings import Mimic
from aacmm_pin.errors import ArmFileError, UnknownNameError, UnsupportedArmError

if TYPE_CHECKING:
    from aacmm_pin.arm.urdf_check import Follower


STDERR = threading.Lock()
"""Held by the thread that redirects standard error."""


def built_model(text: str, path: str) -> Any:
    """Pinocchio model of a URDF named ``path`` in errors."""
    with STDERR, tempfile.TemporaryFile() as captured:
        stderr = os.dup(2)
        os.dup2(captured.fileno(), 2)
        try:
            return pin.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            captured.seek(0)
            line = captured.readline().decode(errors="replace")
            message = line.removeprefix("Error:").strip(" .\n")
            raise ArmFileError(
                path, "", f"{message or error}; expected a URDF that Pinocchio can load"
            ) from None
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


def frame_number(model: Any, name: str) -> int:
    """Number of a frame; the link, if a joint has the same name (getFrameId would raise)."""
    same = [number for number, frame in enumerate(model.frames) if frame.name == name]
    if not same:
        raise UnknownNameError("frame", name, [frame.name for frame in model.frames])
    links = [number for number in same if model.frames[number].type == pin.FrameType.BODY]
    return (links or same)[0]


def serial_part(
    model: Any, frame: str, followers: Mapping[str, Follower] = MappingProxyType({})
) -> tuple[Any, tuple[Mimic, ...]]:
    """The chain to ``frame``, and its joints that follow others; joints beside it are locked."""
    chain = model.supports[model.frames[frame_number(model, frame)].parentJoint].tolist()[1:]
    if len(chain) > MOST_JOINTS:
        raise UnsupportedArmError(
            f"{model.name}: {len(chain)} joints move the frame {frame!r}; expected at most "
            f"{MOST_JOINTS}"
        )
    names = [model.names[joint] for joint in chain]
    mimics = _mimics(names, {*model.names}, followers)
    others = [j for j in range(1, model.njoints) if j not in chain]
    model = model.copy()
    if others:
        _rename(model, others)
        model = pin.buildReducedModel(model, others, pin.neutral(model))
    wide = [name for name, joint in zip(model.names, model.joints, strict=True) if joint.nq > 1]
    if wide:
        raise UnsupportedArmError(
            f"{model.name}: joint {', '.join(wide)} has more than one coordinate; expected one; "
            "change the joint to revolute with wide limits"
        )
    if model.njoints < 2:
        raise UnsupportedArmError(
            f"{model.name}: no joint moves the frame {frame!r}; expected a frame beyond a joint"
        )
    if reason := chain_of(model, frame).beyond_reach():
        shifts = [np.linalg.norm(placement.translation) for placement in model.jointPlacements]
        farthest = int(np.argmax(shifts))
        raise UnsupportedArmError(
            f"{model.name}: joint {model.names[farthest]!r} is {shifts[farthest]:.4g} m beyond the "
            f"joint before, so that {reason}"
        )
    return model, mimics


def _mimics(
    names: list[str], joints: Collection[str], followers: Mapping[str, Follower]
) -> tuple[Mimic, ...]:
    """Joints of a chain that follow others.

    Of several that follow a joint beside the chain, the first has its reading.
    """
    mimics = []
    first_follower: dict[str, int] = {}
    for number, name in enumerate(names, start=1):
        if name not in followers:
            continue
        leader, ratio, offset, place = followers[name]
        if leader not in joints or not ratio:
            raise UnsupportedArmError(
                f"{place}; expected a joint of the robot, and a multiplier other than 0; if this "
                "joint has its own encoder, delete <mimic>"
            )
        if leader in names:
            followed = names.index(leader) + 1
        else:
            followed = first_follower.setdefault(leader, number)
        mimics.append(Mimic(number, followed, ratio, offset))
    return tuple(mimics)


def _rename(model: Any, joints: list[int]) -> None:
    """Rename fixed joints, and ``joints``, with the name of a link: Pinocchio finds frames by name
    alone.
    """
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type == pin.FrameType.FIXED_JOINT and frame.name in links:
            frame.name = f"joint {frame.name}"
    for joint in joints:
        name = model.names[joint]
        if name in links:
            frame = model.frames[model.getFrameId(name, pin.FrameType.JOINT)]
            frame.name = model.names[joint] = f"joint {name}"


def chain_of(model: Any, tip: str, mimics: Sequence[Mimic] = ()) -> Chain:
    """Chain of a Pinocchio model, joint axes along z; parameters are the twists of the placements
    in their own axes.
    """
    onto_axes = [pin.SE3(onto_z(axis), np.zeros(3)) for axis in joint_axes(model)]
    axes = [onto_axis.homogeneous for onto_axis in onto_axes]
    back = [np.eye(4), *(onto_axis.inverse().homogeneous for onto_axis in onto_axes)]
    frame = model.frames[frame_number(model, tip)]
    placements = [*model.jointPlacements.tolist()[1:], frame.placement]
    pairs = zip(back, placements, strict=True)
    ends = [before @ placement.homogeneous for before, placement in pairs]
    slides = np.asarray(~_motions(model)[:, 3:].any(axis=1))
    joints = range(model.nv)
    parameters = [(end(joint), component) for joint in joints for component in range(6)]
    return Chain.of_pieces(axes, ends, np.array(joints), slides, parameters, mimics)


def _motions(model: Any) -> Array:
    """Twist of every joint per unit of its velocity, v then ω in its own axes (nq, 6)."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    motions = np.empty((model.nv, 6))
    for joint in range(model.nv):
        jacobian = pin.getJointJacobian(model, data, joint + 1, pin.LOCAL)
        motions[joint] = jacobian.reshape(6, -1)[:, joint]
    return motions


def joint_axes(model: Any) -> Array:
    """Axis of each joint in the axes of its placement (nq, 3)."""
    motions = _motions(model)
    rotates = motions[:, 3:].any(axis=1, keepdims=True)
    return np.where(rotates, motions[:, 3:], motions[:, :3])


def onto_z(axis: Array) -> Array:
    """A rotation with ``axis`` as its third column."""
    z = np.array([0.0, 0.0, 1.0])
    rotation = pin.Quaternion.FromTwoVectors(z, axis)
    return np.array(rotation.toRotationMatrix())
