"""Any serial arm as a chain of constant transforms and turning joints: DH tables of both
conventions, and URDF.

Row i is ``before[i] Rz(angle i) after[i]``. Nothing here knows of errors or loads.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np
import yourdfpy
from numpy.typing import NDArray

from blind.kinematics import Array, identity, rotation, shift_x, turn_x, turn_z_shift

SINO6 = Path(__file__).parents[2] / "aacmm_pin" / "arm" / "bundled" / "sino6.toml"
KINDS = ("a", "d", "alpha", "theta_offset")
Pieces = tuple[Array, Array]
TUBE_M = 0.3


@dataclass(frozen=True, eq=False)
class Chain:
    """R rows, nq of them with a joint, in SI units.

    Attributes:
        name: of the arm.
        pieces: ``before`` and ``after`` (R, 4, 4) of given deviations of the geometry (R, P) from
            what the file says.
        half_width: bounds of these deviations as the file states them (R, P) [m or rad]; zero where
            exact.
        typical: deviations of a usual arm (R, P) [m or rad]; zero where there is no such parameter.
        moving: (R,) True where the row has a joint.
        limits: (nq, 2) [rad].
        mass: (R,) [kg].
        com: centre of mass of each body in the axes of its joint, turned with it (R, 3) [m].
        stylus: axis of the stylus in the last frame (3,).
    """

    name: str
    pieces: Callable[[Array], Pieces]
    half_width: Array
    typical: Array
    moving: NDArray[np.bool_]
    limits: Array
    mass: Array
    com: Array
    stylus: Array
    gravity: Array
    reference_temperature: float = 20.0

    @property
    def rows(self) -> int:
        return len(self.moving)

    @property
    def exact(self) -> Array:
        """No deviation."""
        return np.zeros_like(self.typical)

    def spans(self) -> Array:
        """From each axis to the end of its body, in the axes of the joint (R, 3) [m]."""
        return self.pieces(self.exact)[1][:, :3, 3]

    def tubes(self) -> list[int]:
        """Rows (from 1) of the bodies longer than 0.3 m."""
        return [int(i) + 1 for i in np.flatnonzero(np.linalg.norm(self.spans(), axis=1) > TUBE_M)]

    def all_angles(self, q: Array) -> Array:
        """(n, nq) -> (n, R): zero in rows that have no joint."""
        angles = np.zeros((len(q), self.rows))
        angles[:, self.moving] = q
        return angles

    def walk(self, q: Array, deviations: Array | None = None) -> tuple[Array, Array]:
        """Frames on the axes (n, R, 4, 4), and the last one (n, 4, 4), of the rigid arm."""
        before, after = self.pieces(self.exact if deviations is None else deviations)
        frame, axes = identity(len(q)), []
        for i, angle in enumerate(self.all_angles(q).T):
            axes.append(frame @ before[i] @ turn_z_shift(angle, np.zeros(len(q))))
            frame = axes[-1] @ after[i]
        return np.stack(axes, axis=1), frame

    def tips(self, q: Array) -> Array:
        """Places of the tip (n, 3) [m]."""
        return self.walk(q)[1][:, :3, 3]

    def jacobian(self, q: Array, deviations: Array | None = None) -> Array:
        """Velocity of the tip per joint rate, (n, 3, nq) [m/rad]."""
        axes, last = self.walk(q, deviations)
        levers = last[:, None, :3, 3] - axes[:, :, :3, 3]
        return np.cross(axes[:, :, :3, 2], levers)[:, self.moving].transpose(0, 2, 1)


def _one(transform: Callable[..., Array], *values: float) -> Array:
    return transform(*(np.array([value]) for value in values))[0]


def dh_pieces(values: Array, standard: bool) -> Callable[[Array], Pieces]:
    """Of DH values (R, 4): a, d, alpha, theta offset."""

    def pieces(deviations: Array) -> Pieces:
        v = values + deviations
        turns = [_one(turn_z_shift, offset, 0.0) for offset in v[:, 3]]
        slides = [_one(turn_z_shift, 0.0, d) for d in v[:, 1]]
        tilts = [_one(shift_x, a) @ _one(turn_x, alpha) for a, alpha in v[:, [0, 2]]]
        # A body is d and what stands behind it: a and alpha of its row, or of the next.
        behind = tilts if standard else [*tilts[1:], np.eye(4)]
        after = np.stack([s @ t for s, t in zip(slides, behind, strict=True)])
        return np.stack(turns if standard else [tilts[0] @ turns[0], *turns[1:]]), after

    return pieces


def of_table(table: Mapping[str, Any]) -> Chain:
    """From the contents of an arm file; its centres of mass are in the frames of the rows."""
    rows, standard = table["joints"], table["convention"] == "standard-dh"
    values = np.array([_row(row) for row in rows])
    pieces = dh_pieces(values, standard)
    after = pieces(np.zeros_like(values))[1]
    com = 1e-3 * np.array([row.get("com_mm", [0.0, 0.0, 0.0]) for row in rows])
    moving = np.array([not row.get("fixed", False) for row in rows])
    stylus = np.array(table.get("stylus", {}).get("axis", [1.0, 0.0, 0.0]))
    return Chain(
        name=table["name"],
        pieces=pieces,
        half_width=np.array([_row(row.get("uncertainty", {})) for row in rows]),
        typical=np.tile([2e-4, 2e-4, 5e-4, 5e-4], (len(rows), 1)),
        moving=moving,
        limits=np.array(
            [
                row.get("limits_rad", [-np.pi, np.pi])
                for row, m in zip(rows, moving, strict=True)
                if m
            ]
        ),
        mass=np.array([row.get("mass_kg", 0.0) for row in rows]),
        com=np.einsum("rij,rj->ri", after[:, :3, :3], com) + after[:, :3, 3]
        if standard
        else com + values[:, [1]] * [0.0, 0.0, 1.0],
        stylus=stylus / np.linalg.norm(stylus),
        gravity=np.array(table["gravity_m_s2"]),
        reference_temperature=float(table.get("reference_temperature_c", 20.0)),
    )


def _row(row: Mapping[str, Any]) -> list[float]:
    units = {"a_mm": 1e-3, "d_mm": 1e-3, "alpha_rad": 1.0, "theta_offset_rad": 1.0}
    return [unit * float(row.get(name, 0.0)) for name, unit in units.items()]


def read(path: Path = SINO6) -> Chain:
    """The arm of an arm file; the bundled one."""
    return of_table(tomllib.loads(path.read_text(encoding="utf-8")))


# a [mm], d [mm], alpha [rad], theta offset [rad], mass [kg], centre of mass [mm], limits [rad]
SEVEN: dict[str, Sequence[tuple[float, ...]]] = {
    "standard-dh": (
        (0.0, 260.0, -np.pi / 2, 0.0, 1.6, 0.0, 60.0, 0.0, -3.1, 3.1),
        (45.0, 0.0, np.pi / 2, 0.0, 0.9, 0.0, 0.0, 0.0, -1.9, 1.9),
        (0.0, 620.0, -np.pi / 2, 0.0, 1.3, 0.0, 280.0, 0.0, -3.1, 3.1),
        (-40.0, 0.0, np.pi / 2, 0.0, 0.7, 0.0, 0.0, 0.0, -2.4, 2.4),
        (0.0, 480.0, -np.pi / 2, 0.0, 0.8, 0.0, 210.0, 0.0, -3.1, 3.1),
        (0.0, 0.0, np.pi / 2, 0.0, 0.4, 0.0, 0.0, 0.0, -2.0, 2.0),
        (90.0, 130.0, 0.0, 0.0, 0.3, -50.0, 0.0, -40.0, -3.1, 3.1),
    ),
    "modified-dh": (
        (0.0, 333.0, 0.0, 0.0, 2.9, 0.0, 0.0, -60.0, -2.9, 2.9),
        (0.0, 0.0, -np.pi / 2, 0.0, 0.6, 0.0, -30.0, 0.0, -1.7, 1.7),
        (0.0, 316.0, np.pi / 2, 0.0, 2.2, 30.0, 40.0, -60.0, -2.9, 2.9),
        (82.5, 0.0, np.pi / 2, 0.0, 1.9, -50.0, 100.0, 30.0, -3.0, -0.1),
        (-82.5, 384.0, -np.pi / 2, 0.0, 1.2, 0.0, 40.0, -40.0, -2.9, 2.9),
        (0.0, 0.0, np.pi / 2, 0.0, 1.1, 60.0, -10.0, -10.0, 0.0, 3.7),
        (88.0, 210.0, np.pi / 2, 0.0, 0.5, 0.0, 0.0, -100.0, -2.9, 2.9),
        (110.0, 0.0, 0.0, 0.0, 0.1, -50.0, 0.0, 0.0, 0.0, 0.0),
    ),
}
"""A measuring arm of seven joints, and one laid out as a Panda whose last row is a rigid stylus."""
BOUNDS = (3e-5, 3e-5, 5e-5, 8e-5)
"""Half-widths of a stated table of seven joints [m, m, rad, rad]."""


def seven(convention: str, stated: bool) -> Chain:
    """An arm of seven joints by its table."""
    return of_table(tomllib.loads(seven_text(convention, stated, masses=True)))


def seven_text(convention: str, stated: bool, masses: bool) -> str:
    """The arm file of :func:`seven`."""
    lines = ['schema = "aacmm-pin/arm/1"', 'name = "seven"', f'convention = "{convention}"']
    lines += [
        "gravity_m_s2 = [0.0, 0.0, -9.81]",
        "reference_temperature_c = 20.0",
        "[stylus]",
        "axis = [1.0, 0.0, 0.0]",
    ]
    for row in np.array(SEVEN[convention]).tolist():
        a, d, alpha, offset, mass, *com, low, high = row
        lines += [
            "[[joints]]",
            f"a_mm = {a!r}",
            f"d_mm = {d!r}",
            f"alpha_rad = {alpha!r}",
            f"theta_offset_rad = {offset!r}",
        ]
        lines.append(f"limits_rad = [{low!r}, {high!r}]" if low < high else "fixed = true")
        if masses:
            lines += [f"mass_kg = {mass!r}", f"com_mm = {com!r}"]
        if stated:
            units = zip(
                ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"),
                BOUNDS,
                (1e3, 1e3, 1.0, 1.0),
                strict=True,
            )
            lines.append(
                "uncertainty = { "
                + ", ".join(f"{name} = {u * unit:.6g}" for name, u, unit in units)
                + " }"
            )
    return "\n".join(lines) + "\n"


# --- URDF

ROBOTS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
}
"""File and frame of the tip."""


def robot_file(name: str) -> Path:
    """The URDF file of a robot of example-robot-data."""
    robots = distribution("example-robot-data").locate_file(
        "cmeel.prefix/share/example-robot-data/robots"
    )
    return Path(str(robots)) / ROBOTS[name][0]


def robot(name: str, translation_m: float, rotation_rad: float) -> Chain:
    """A robot by its URDF, every joint placement within the given bounds (zero: nothing is
    stated).
    """
    urdf = yourdfpy.URDF.load(
        str(robot_file(name)), build_scene_graph=False, load_meshes=False
    ).robot
    parents = {joint.child: joint for joint in urdf.joints}
    placements, joints, here = [np.eye(4)], [], ROBOTS[name][1]
    while here in parents:  # from the tip to the base; what is fixed goes to the body before
        joint = parents[here]
        here = joint.parent
        if joint.type == "fixed":
            placements[0] = _placed(joint) @ placements[0]
        else:
            joints.insert(0, joint)
            placements.insert(0, _placed(joint))
    bodies = {joint.child: number for number, joint in enumerate(joints)}
    mass, first = np.zeros(len(joints)), np.zeros((len(joints), 3))
    for link in urdf.links:
        at, owner = np.eye(4), link.name
        while owner not in bodies and owner in parents:
            at, owner = _placed(parents[owner]) @ at, parents[owner].parent
        if link.inertial is not None and owner in bodies:
            mass[bodies[owner]] += link.inertial.mass
            first[bodies[owner]] += link.inertial.mass * (at @ _placed(link.inertial))[:3, 3]
    aligned = np.stack(
        [_axis_frame(np.array([1.0, 0.0, 0.0]) if j.axis is None else j.axis) for j in joints]
    )

    def pieces(deviations: Array) -> Pieces:  # `aligned` turns only: its transpose is its inverse
        placed = [p @ _screw(d) for p, d in zip(placements[:-1], deviations, strict=True)] + [
            placements[-1]
        ]
        before = [placed[0] @ aligned[0], *aligned[1:]]
        return np.stack(before), np.stack(
            [a.T @ p for a, p in zip(aligned, placed[1:], strict=True)]
        )

    shape = (len(joints), 1)
    return Chain(
        name=name,
        pieces=pieces,
        half_width=np.tile([translation_m] * 3 + [rotation_rad] * 3, shape),
        typical=np.tile([2e-4] * 3 + [5e-4] * 3, shape),
        moving=np.ones(len(joints), dtype=bool),
        limits=np.array([_limits(joint) for joint in joints]),
        mass=mass,
        com=np.einsum("rji,rj->ri", aligned[:, :3, :3], first / np.maximum(mass, 1e-12)[:, None]),
        stylus=np.array([0.0, 0.0, 1.0]),
        gravity=np.array([0.0, 0.0, -9.81]),
    )


def _limits(joint: yourdfpy.Joint) -> tuple[float, float]:
    if joint.limit is None or joint.type == "continuous":
        return -np.pi, np.pi
    return max(joint.limit.lower, -np.pi), min(joint.limit.upper, np.pi)


def _placed(element: yourdfpy.Joint | yourdfpy.Inertial) -> Array:
    return np.eye(4) if element.origin is None else np.asarray(element.origin)


def _axis_frame(axis: Array) -> Array:
    """A turn that takes z to the axis."""
    out, z = np.eye(4), axis / np.linalg.norm(axis)
    turn = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(turn))
    if sine > 1e-12:
        out[:3, :3] = rotation(turn / sine * np.arctan2(sine, z[2]))
    elif z[2] < 0.0:
        out[:3, :3] = np.diag([1.0, -1.0, -1.0])
    return out


def _screw(deviation: Array) -> Array:
    """Shift and turn (6,) about the axes of a placement, as a transform."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation(deviation[3:]), deviation[:3]
    return out
