"""All configurations that bring a point of the arm to given places, as closed curves; limits play no part here.

Seeds come from the closed form of :mod:`aacmm_pin.three_revolutes` with each of the joints 1 to 4 held in turn at many
angles: no single joint will do, because near the base axis the curves run at almost constant θ3, and on it θ1 is free.
Newton's method then moves every candidate to the nearest solution, and continuation follows each curve once round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin.checks import Array, Index
from aacmm_pin.continuation import Curve, System, all_curves, polish
from aacmm_pin.dh import DHTable
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.three_revolutes import candidates

POSITIONING = 4
"""Number of joints that place the wrist."""
WRIST_ROW = 5
"""The wrist is the origin of this frame."""
COLLINEAR = 1e-9
NEAR = 0.1
"""Candidates of the closed form that miss the point by more solve one of its two equations only [m]."""
SPREAD = 600
"""Evenly spread starts for the curves of the tip."""


@dataclass(frozen=True)
class Wrist:
    """The origin of frame 5 as a function of joints 1 to 4, the others held.

    Attributes:
        table: rows 1 to 5 with the fifth fixed at its held angle.
        rest: held angles of the joints after the fourth, (nq - 4,) [rad].
    """

    table: DHTable
    rest: Array

    @staticmethod
    def of(dh: DHTable, rest: Array) -> Wrist:
        """Hold joints 5 and up at ``rest``.

        Raises:
            UnsupportedArmError: fewer than five rows, or one of the first five has no joint.
        """
        if dh.rows < WRIST_ROW or not dh.moving[:WRIST_ROW].all():
            raise UnsupportedArmError("configurations need an arm whose first five DH rows are joints")
        offsets = dh.theta_offset[:WRIST_ROW].copy()
        offsets[-1] += rest[0]
        moving = np.array([True] * POSITIONING + [False])
        first = slice(0, WRIST_ROW)
        return Wrist(DHTable(dh.a[first], dh.d[first], dh.alpha[first], offsets, moving, dh.convention), rest)

    def full(self, q: Array) -> Array:
        """All joints from the first four: (n, nq) [rad]."""
        return np.column_stack([q, np.broadcast_to(self.rest, (len(q), len(self.rest)))])


def wrist_system(wrist: Wrist, points: Array) -> System:
    """The wrist's distance (n, 3) [m] from its point among ``points`` (m, 3), as a function of joints 1 to 4."""

    def system(q: Array, problem: Index) -> tuple[Array, Array]:
        position, jacobian = wrist.table.position_and_jacobian(q)
        return position - points[problem], jacobian

    return system


def wrist_curves(wrist: Wrist, points: Array, per_turn: int) -> list[Curve]:
    """Curves of joints 1 to 4 on which the wrist is at ``points`` (m, 3) [m], sorted by the number of the point.

    Args:
        wrist: which point of the arm.
        points: where it shall be (m, 3) [m].
        per_turn: angles at which each of the joints 1 to 4 is held to find seeds.
    """
    system = wrist_system(wrist, points)
    seeds, problem = _held_seeds(wrist.table, points, per_turn)
    spread = spread_angles(4 * per_turn, POSITIONING)
    seeds = np.concatenate([seeds, np.tile(spread, (len(points), 1))])
    problem = np.concatenate([problem, np.repeat(np.arange(len(points)), len(spread))])
    seeds, good = polish(system, seeds, problem)
    return all_curves(system, seeds[good], problem[good])


def spread_angles(count: int, joints: int) -> Array:
    """Evenly spread configurations (count, joints) [rad]: starts for Newton's method where a curve is so small that no held
    angle meets it, as at the ends of the reach.

    Additive recurrence with the powers of the root of x^(d+1) = x + 1 (M. Roberts, 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (joints + 1))
    steps = root ** -np.arange(1.0, joints + 1)
    return np.asarray((np.arange(1, count + 1)[:, None] * steps % 1.0) * (2 * np.pi) - np.pi)


def _held_seeds(table: DHTable, points: Array, per_turn: int) -> tuple[Array, Index]:
    """Candidates with each joint held in turn: (n, 4) [rad] and the number of their point (n,)."""
    links = table.links()
    angles = np.linspace(-np.pi, np.pi, per_turn, endpoint=False) + 0.37  # off the symmetric angles 0 and ±π
    seeds, numbers = [], []
    for held in range(POSITIONING):
        (b0, b1, b2), c = _chain_with_held(links, held, angles)
        which, angle = (grid.ravel() for grid in np.meshgrid(np.arange(len(points)), np.arange(per_turn), indexing="ij"))
        found, who = candidates(b0[angle], b1[angle], b2[angle], c[angle], points[which])
        free = [joint for joint in range(POSITIONING) if joint != held]
        q = np.empty((len(found), POSITIONING))
        q[:, free], q[:, held] = found, angles[angle[who]]
        seeds.append(q)
        numbers.append(which[who])
    q, number = np.concatenate(seeds), np.concatenate(numbers)
    near = np.linalg.norm(table.positions(q) - points[number], axis=1) < NEAR
    return q[near], number[near]


def _chain_with_held(links: Array, held: int, angles: Array) -> tuple[list[Array], Array]:
    """Constants B0, B1, B2 (n, 4, 4) and the point c (n, 3) of the three joints that stay free."""
    turns = _turns_about_z(angles)
    constants = [np.broadcast_to(links[0], turns.shape)]
    for joint in range(POSITIONING):
        if joint == held:
            constants[-1] = constants[-1] @ turns @ links[joint + 1]
        else:
            constants.append(np.broadcast_to(links[joint + 1], turns.shape))
    return constants[:3], np.ascontiguousarray(constants[3][:, :3, 3])


def _turns_about_z(angles: Array) -> Array:
    """Rz of each angle (n,) [rad]: (n, 4, 4)."""
    turns = np.zeros((len(angles), 4, 4))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0] = np.sin(angles)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = turns[:, 3, 3] = 1.0
    return turns


def tip_curves(dh: DHTable, point: Array, stylus: Array, axis: Array, per_turn: int, directions: int = 48) -> list[Curve]:
    """Curves of six joints on which the tip is at ``point`` and the stylus points along ``axis``.

    The body behind joint 6 may still turn about the stylus. For each of many such turns the wrist's place is known; where
    along its circle joint axis 5 makes the angle with joint axis 6 that row 5 demands, there is a seed.

    Args:
        dh: table with exactly six joints, the first six rows.
        point: (3,) [m].
        stylus: unit direction of the stylus in the last frame (3,).
        axis: unit direction that it shall have in the base (3,).
        per_turn: see :func:`wrist_curves`.
        directions: number of turns about the stylus that are tried.

    Raises:
        UnsupportedArmError: the arm has not six joints in its first six rows.
    """
    if dh.nq != 6 or not dh.moving[:6].all():
        raise UnsupportedArmError("configurations of the tip need an arm with six joints in its first six DH rows")
    system = tip_system(dh, point, stylus, axis)
    seeds = np.concatenate([_tip_seeds(dh, point, stylus, axis, per_turn, directions), spread_angles(SPREAD, dh.nq)])
    problem = np.zeros(len(seeds), dtype=np.intp)
    seeds, good = polish(system, seeds, problem)
    towards = np.einsum("nij,j,i->n", dh.placements(seeds)[:, -1, :3, :3], stylus, axis) > 0
    return all_curves(system, seeds[good & towards], problem[good & towards])


def tip_system(dh: DHTable, point: Array, stylus: Array, axis: Array) -> System:
    """Residual (n, 5): the tip's place [m] and the stylus across two directions normal to ``axis`` [1]."""
    normals = np.linalg.svd(axis[None, :])[2][1:]
    joints = np.flatnonzero(dh.moving)

    def system(q: Array, problem: Index) -> tuple[Array, Array]:
        x, y, z, o = dh.axes(q)
        direction = stylus[0] * x[-1] + stylus[1] * y[-1] + stylus[2] * z[-1]
        f = np.concatenate([o[-1] - point[:, None], normals @ direction]).T
        jacobian = np.empty((len(q), 5, len(joints)))
        for column, i in enumerate(joints):
            frame = i if dh.standard else i + 1
            jacobian[:, :3, column] = np.cross(z[frame], o[-1] - o[frame], axis=0).T
            jacobian[:, 3:, column] = (normals @ np.cross(z[frame], direction, axis=0)).T
        return f, jacobian

    return system


def _tip_seeds(dh: DHTable, point: Array, stylus: Array, axis: Array, per_turn: int, directions: int) -> Array:
    """Starting values (n, 6) [rad], near solutions."""
    links = dh.links()
    behind = links[6]  # from joint 6 to the tip
    stylus_in_6 = behind[:3, :3] @ stylus
    bodies = _bodies_about(axis, stylus_in_6, directions)
    places = point - bodies @ behind[:3, 3]  # origin of frame 5 lies where the axes of joint 6 start
    wrist = Wrist.of(dh, np.zeros(dh.nq - POSITIONING))
    places = places - np.einsum("nij,j->ni", bodies, _wrist_in_6(dh, links))
    seeds = []
    for curve in wrist_curves(wrist, places, per_turn):
        seeds.append(_wrist_angles(wrist.full(curve.q), bodies[curve.problem], links))
    return np.concatenate(seeds) if seeds else np.empty((0, 6))


def _wrist_in_6(dh: DHTable, links: Array) -> Array:
    """Origin of frame 5 seen from the axes of joint 6 before it turns: zero for standard DH (the frames coincide)."""
    return np.zeros(3) if dh.standard else -links[5][:3, 3]


def _bodies_about(axis: Array, stylus: Array, count: int) -> Array:
    """Orientations (n, 3, 3) of the body behind joint 6 that have ``stylus`` along ``axis``."""
    start = _rotation_between(stylus, axis)
    angles = np.arange(count) * (2 * np.pi / count)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angles)[:, None, None] * cross + (1 - np.cos(angles))[:, None, None] * (cross @ cross)
    return np.asarray(turn @ start)


def _rotation_between(u: Array, v: Array) -> Array:
    """A rotation that takes the unit vector u to the unit vector v."""
    frames = []
    for direction in (u, v):
        other = np.eye(3)[np.argmin(np.abs(direction))]
        second = np.cross(direction, other)
        second /= np.linalg.norm(second)
        frames.append(np.column_stack([direction, second, np.cross(direction, second)]))
    return np.asarray(frames[1] @ frames[0].T)


def _wrist_angles(q: Array, body: Array, links: Array) -> Array:
    """Of one wrist curve, the places where joint 6 can carry ``body``, with θ5 and θ6: (n, 6) [rad].

    In the axes of joint 5 joint 6's axis is ``Rz(θ5) L5 e_z``; its z component does not depend on θ5, which gives the
    condition on joints 1 to 4.
    """
    before = _rotation_before_5(q, links)
    axis = np.einsum("nji,j->ni", before, body[:, 2])
    wanted = links[5][:3, 2]
    gap = axis[:, 2] - wanted[2]
    following = np.roll(gap, -1)
    size = np.abs(gap)
    least = (size <= np.roll(size, 1)) & (size <= np.abs(following)) & (size < 0.05)
    pick = np.flatnonzero((gap * following <= 0) | least)
    seeds = q[pick].copy()
    seeds[:, 4] = np.arctan2(axis[pick, 1], axis[pick, 0]) - np.arctan2(wanted[1], wanted[0])
    rest = np.einsum("nji,jk->nik", before[pick] @ _turns_about_z(seeds[:, 4])[:, :3, :3] @ links[5][:3, :3], body)
    seeds[:, 5] = np.arctan2(rest[:, 1, 0], rest[:, 0, 0])
    return seeds


def _rotation_before_5(q: Array, links: Array) -> Array:
    rotation = np.broadcast_to(links[0][:3, :3], (len(q), 3, 3))
    for joint in range(POSITIONING):
        rotation = rotation @ _turns_about_z(q[:, joint])[:, :3, :3] @ links[joint + 1][:3, :3]
    return np.asarray(rotation)
