"""The DH table of exactly the arm of a URDF.

A row of standard DH, ``Rz(θ) Tz(d) Tx(a) Rx(α)``, leads from z along one axis to z along the next,
with x along the common normal (Denavit, Hartenberg 1955). The rows:

- from z of the base to the first joint axis: a fixed row, if they are not one line;
- from each joint axis to the next: the row of the joint; parallel axes have d = 0. The common
  normal of nearly parallel axes is far away and amplifies rounding: a fixed row, by an axis across
  both, is inserted;
- from the last joint axis to z of the tip, and perhaps a fixed row ``Rz(θ) Tz(d)`` to the tip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import axis, screws
from aacmm_pin.arm.file import ArmFile, UrdfArmFile, validated
from aacmm_pin.errors import UnsupportedArmError

PARALLEL = 1e-13
"""Smallest angle of axes that are not parallel: rounding [rad]."""
NEARLY_PARALLEL = 1e-2
"""Below it, the place of the common normal is rounding divided by the angle [rad]."""
SAME = 1e-14
"""Smaller lengths and angles are rounding [m, rad]."""


class StandardRow(NamedTuple):
    """One row of standard DH [m, rad]."""

    a: float
    d: float
    alpha: float
    theta: float


def dh_file(arm: Arm) -> ArmFile:
    """Arm file, by standard DH, of an arm from a URDF: masses and limits, no half-widths."""
    file = arm.urdf_file
    chain = arm.chain
    if arm.mimics:
        followers = ", ".join(arm.joint_names[mimic.joint - 1] for mimic in arm.mimics)
        raise UnsupportedArmError(
            f"{arm.name}: joint {followers} mimics another joint; expected independent joints for "
            "a DH table"
        )
    rotation, origin = chain.at_zero
    rows = []  # each with the number of its joint, from 0, or None
    frame = np.eye(4)
    frames = []
    # Rows that begin at the axis of a joint lead to the next axis.
    for joint, place in enumerate([*chain.moving_axes(), chain.tip], start=-1):
        for number, exact in enumerate(_onto_axis(frame, rotation[place][:, 2], origin[place])):
            row = StandardRow(*(value if abs(value) > SAME else 0.0 for value in exact))
            joint_of_row = joint if number == 0 and joint >= 0 else None
            if joint_of_row is not None or any(row):
                rows.append((row, joint_of_row))
                frame = frame @ _motion(row)
                frames.append(frame)
    to_tip = frame[:3, :3].T @ rotation[-1]
    shift = frame[:3, :3].T @ (origin[-1] - frame[:3, 3])
    remaining = StandardRow(0.0, float(shift[2]), 0.0, math.atan2(to_tip[1, 0], to_tip[0, 0]))
    last, joint_of_last = rows[-1]
    if last.a == last.alpha == 0.0:
        joined = StandardRow(0.0, last.d + remaining.d, 0.0, last.theta + remaining.theta)
        rows[-1] = joined, joint_of_last
        frames[-1] = frame @ _motion(remaining)
    elif np.abs(remaining).max() > SAME:
        rows.append((remaining, None))
        frames.append(frame @ _motion(remaining))
    return _file_of_rows(arm, file, rows, frames)


def _file_of_rows(
    arm: Arm, file: UrdfArmFile, rows: list[tuple[StandardRow, int | None]], frames: list[Array]
) -> ArmFile:
    """The arm file of ``rows``, each with its joint or None; ``frames`` (4, 4) are those of the
    rows at zero joint values.
    """
    axes = [axis(number) for number in arm.chain.moving_rows()]
    rotation, origin = (part[axes] for part in arm.chain.at_zero)
    joints = []
    for (row, joint), frame in zip(rows, frames, strict=True):
        entry: dict[str, Any] = {"a_mm": row.a / MM, "d_mm": row.d / MM}
        entry |= {"alpha_rad": row.alpha, "theta_offset_rad": row.theta}
        if joint is None:
            entry["fixed"] = True
        else:
            slides = bool(arm.chain.prismatic[joint])
            unit, scale = ("mm", MM) if slides else ("rad", 1.0)
            entry["kind"] = "prismatic" if slides else "revolute"
            entry[f"limits_{unit}"] = (arm.limits[joint] / scale).tolist()
            entry[f"encoder_noise_{unit}"] = (
                None if arm.encoder_noise is None else float(arm.encoder_noise[joint] / scale)
            )
            if arm.masses is not None and arm.masses[joint]:
                centre = rotation[joint] @ arm.centres_of_mass[joint] + origin[joint]
                entry["mass_kg"] = float(arm.masses[joint])
                entry["com_mm"] = (frame[:3, :3].T @ (centre - frame[:3, 3]) / MM).tolist()
        joints.append(entry)
    content = file.model_dump(
        by_alias=True,
        exclude={"urdf", "joints", "couplings", "effects", "discrepancy", "covariance"},
    )
    row_of_joint = [number for number, (_, joint) in enumerate(rows, start=1) if joint is not None]
    content["couplings"] = [
        {
            "joint": row_of_joint[coupling.joint - 1],
            "of": row_of_joint[coupling.of - 1],
            "ratio": coupling.ratio,
        }
        for coupling in file.couplings
    ]
    content["source"] = f"DH table of: {file.source or file.name}"
    content["convention"] = "standard-dh"
    content["joints"] = joints
    return validated(ArmFile, content, file.name)


def _onto_axis(frame: Array, z: Array, point: Array) -> Iterator[StandardRow]:
    """One or two rows from a frame (4, 4) to the axis along z (3,) through a point (3,) [m]."""
    z, point = _seen_from(frame, z, point)
    angle = math.hypot(z[0], z[1])
    if PARALLEL < angle < NEARLY_PARALLEL:
        # The common normal may be far away. So first onto the line through the origin at right
        # angles to z and to the direction of the next axis, which then passes this line closely.
        towards = point[:2] if np.hypot(*point[:2]) > SAME else np.array([1.0, 0.0])
        line = np.array([-towards[1], towards[0], 0.0]) / np.hypot(*towards)
        onto_line = _row(line, np.zeros(3))
        yield onto_line
        yield _row(*_seen_from(_motion(onto_line), z, point))
    else:
        yield _row(z, point)


def _seen_from(frame: Array, z: Array, point: Array) -> tuple[Array, Array]:
    """Direction z (3,) and point (3,) [m] in a frame (4, 4)."""
    rotation = frame[:3, :3].T
    return rotation @ z, rotation @ (point - frame[:3, 3])


def _row(z: Array, point: Array) -> StandardRow:
    """The row to the axis along z (3,) through a point (3,) [m], both in its first frame."""
    sine = math.hypot(z[0], z[1])
    if sine < PARALLEL:
        a = math.hypot(point[0], point[1])
        theta = math.atan2(point[1], point[0]) if a > SAME else 0.0
        return StandardRow(a, 0.0, 0.0 if z[2] > 0 else math.pi, theta)
    # x = ±(e_z × z)/sin α is the common normal: the sign with the smaller |theta| is taken.
    theta = math.atan2(z[0], -z[1])
    alpha = math.atan2(sine, z[2])
    if abs(theta) > math.pi / 2:
        theta = theta - math.copysign(math.pi, theta)
        alpha = -alpha
    x = np.array([math.cos(theta), math.sin(theta), 0.0])
    y = np.array([-x[1], x[0], 0.0])
    # point = d e_z + a x + s z, with z = -sin α y + cos α e_z
    s = -float(point @ y) / math.sin(alpha)
    return StandardRow(float(point @ x), float(point[2] - s * math.cos(alpha)), alpha, theta)


def _motion(row: StandardRow) -> Array:
    (about_z,) = screws(np.array([row.theta]), row.d, 2)
    (about_x,) = screws(np.array([row.alpha]), row.a, 0)
    return np.asarray(about_z @ about_x)
