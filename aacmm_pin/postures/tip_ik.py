"""All postures with the tip at a place and the stylus along an axis, as closed curves.

Five conditions for six joints. Seeds are from wrist curves (:mod:`aacmm_pin.postures.wrist_ik`) for
many turns of the body about the stylus, and spread.
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.angles import spread_angles
from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm import DHTable, exp, screws
from aacmm_pin.postures.pose_equations import Equations, rotation_between
from aacmm_pin.postures.solution_curves import Curves, all_curves, degenerate, following
from aacmm_pin.postures.wrist_ik import FEW_PER_TURN, POSITIONING, Wrist, with_spread, wrist_curves

SPREAD = 600
DIRECTIONS = 48
"""Turns of the body about the stylus."""


def tip_curves(dh: DHTable, points: Array, stylus: Array, axis: Array) -> Curves:
    """Curves of six joints with the tip at one of ``points`` (m, 3) [m] and the stylus along
    ``axis``.

    Each rotation of the last body about the stylus determines the place of the wrist. A seed is
    where joint axes 5 and 6 have the angle of row 5.

    Args:
        dh: table with exactly six joints, the first six rows.
        stylus: unit direction in the last frame (3,).
        axis: its wanted unit direction in the base (3,).
    """
    equations = Equations.of_axis(dh.chain.links(), points, stylus, axis)
    seeds, problem = with_spread(*_tip_seeds(dh, points, stylus, axis), len(points), SPREAD)
    seeds, good = equations.polish(seeds, problem)
    flat = len(points) > 0 and degenerate(equations, spread_angles(DIRECTIONS, dh.nq))
    return all_curves(equations, seeds[good], problem[good], flat)


def _tip_seeds(dh: DHTable, points: Array, stylus: Array, axis: Array) -> tuple[Array, Index]:
    """Start angles (n, 6) [rad] near solutions, and the number of the point of each (n,).

    Each point has a wrist position for each rotation of the body about the stylus.
    """
    links = dh.chain.links()
    to_tip = links[6]
    angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
    rotations = np.zeros((DIRECTIONS, 6))
    rotations[:, 3:] = angles[:, None] * axis
    # Orientations of the body after joint 6 with the stylus along the axis.
    bodies = exp(rotations)[:, :3, :3] @ rotation_between(to_tip[:3, :3] @ stylus, axis)
    # The wrist is taken as the origin of joint 6: seeds need only be near, and in modified DH the
    # two differ by the length of row 6.
    wrist_to_tip = bodies @ to_tip[:3, 3]
    wrist = Wrist.of(dh)
    places = (points[:, None, :] - wrist_to_tip).reshape(-1, 3)
    curves = wrist_curves(wrist, places, FEW_PER_TURN).curves
    if not curves:
        return np.empty((0, dh.nq)), np.empty(0, dtype=np.intp)
    wrists = [c.problem for c in curves]
    point, body = np.divmod(np.repeat(wrists, [len(c.q) for c in curves]), DIRECTIONS)
    q = wrist.full(np.concatenate([c.q for c in curves]))
    seeds, vertex = _wrist_angles(q, following(curves), bodies[body], links)
    return seeds, point[vertex]


def _wrist_angles(q: Array, after: Index, body: Array, links: Array) -> tuple[Array, Index]:
    """Angles (m, 6) [rad] at vertices of wrist curves where joint 6 can carry ``body`` (n, 3, 3),
    and their numbers.

    In the axes of joint 5 that of joint 6 is ``Rz(θ5) L5 e_z``. Its z component does not depend on
    θ5: a condition on joints 1 to 4. ``after`` is the next vertex on the curve (n,).
    """
    rotation = np.broadcast_to(links[0][:3, :3], (len(q), 3, 3))
    for joint in range(POSITIONING):
        rotation = rotation @ _rotations(q[:, joint]) @ links[joint + 1][:3, :3]
    wanted = np.einsum("nji,nj->ni", rotation, body[:, :, 2])  # axis 6 in the axes of joint 5
    possible = links[5][:3, 2]  # the same at θ5 = 0
    gap = wanted[:, 2] - possible[2]
    size, size_after = np.abs(gap), np.abs(gap[after])
    # Between vertices the gap may touch zero without a change of sign.
    almost_zero = (size < 0.05) & (size <= size_after)
    almost_zero[after] &= size_after <= size
    vertex = np.flatnonzero((gap * gap[after] <= 0) | almost_zero)
    seeds = q[vertex].copy()
    wanted_angle = np.arctan2(wanted[vertex, 1], wanted[vertex, 0])
    seeds[:, 4] = wanted_angle - np.arctan2(possible[1], possible[0])
    before_joint_6 = rotation[vertex] @ _rotations(seeds[:, 4]) @ links[5][:3, :3]
    remaining = np.einsum("nji,njk->nik", before_joint_6, body[vertex])
    seeds[:, 5] = np.arctan2(remaining[:, 1, 0], remaining[:, 0, 0])
    return seeds, vertex


def _rotations(angles: Array) -> Array:
    return screws(angles, 0.0, 2)[:, :3, :3]
