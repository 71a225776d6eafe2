"""Every configuration of the nominal arm whose elbow stands at a given swivel angle, without the paper's steps in θ2.

The swivel is the angle of the elbow E about the line from the shoulder O to the working point P; 0 is the highest elbow in
the sense of :mod:`aacmm_pin.papers.sino6.equations` (greatest Z, least z_DH), π the lowest.

With θ3 held, |OE| is known, so the triangle O, E, P and with the swivel E itself is known; θ2 follows from the height of E
in closed form (two branches), θ1 from its azimuth. What remains is one condition: P lies in the plane through E at right
angles to the axis of joint 4. Its zeros over θ3 round the full circle are all configurations. θ1 and θ3 are free here;
limits are for the caller to check.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, batch
from aacmm_pin.papers.sino6.nominal import NominalArm

SAMPLES = 180
"""Places round the circle of θ3 between which the condition is looked at for a change of sign."""
HALVINGS = 50
"""Bisections of such a gap, which is below 4°: what is left is below the spacing of floating-point numbers near 1."""
AT_ONCE = 512
"""Pairs of point and swivel handled at once: their samples stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class SwivelConfigurations:
    """Configurations found, one a row.

    Attributes:
        point: number of the point, (m,).
        swivel: number of the swivel angle, (m,).
        q: θ1 to θ4, (m, 4) [rad], θ1 and θ3 within a turn.
    """

    point: NDArray[np.int64]
    swivel: NDArray[np.int64]
    q: Array


def elbow_swivel(points: Array, elbows: Array) -> Array:
    """Swivel of the elbows (n, 3) [m] about the lines from the base origin to the points (n, 3) [m]: (n,) [rad].

    It counts from the direction square to the line that is nearest to -z_DH, right-handed about the line.
    """
    _, up, side = _line_axes(points)
    return np.asarray(np.arctan2(np.sum(elbows * side, axis=1), np.sum(elbows * up, axis=1)))


def configurations_at_swivel(arm: NominalArm, points: Array, swivels: Array) -> SwivelConfigurations:
    """All configurations that reach ``points`` (n, 3) [m] with the elbow at each of ``swivels`` (s,) [rad].

    Two configurations of one branch between neighbouring samples of θ3 (0.2° to 4° apart) may escape: the search sees
    changes of sign.

    Raises:
        ShapeError: ``points`` is not a finite (n, 3) array.
    """
    points = batch(points, 3, "points", "m")
    _, up, side = _line_axes(points)
    point, swivel = (index.ravel() for index in np.indices((len(points), len(swivels))))
    turn = np.asarray(swivels)[swivel][:, None]
    outward = np.cos(turn) * up[point] + np.sin(turn) * side[point]
    parts = [
        _search(arm, points[point[part]].T, outward[part].T, part)
        for part in np.array_split(np.arange(point.size), 1 + point.size // AT_ONCE)
    ]
    pair, q = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return SwivelConfigurations(point[pair], swivel[pair], q)


def _line_axes(points: Array) -> tuple[Array, Array, Array]:
    """Unit vectors (n, 3): along OP, square to it and nearest to -z_DH, and the third of the right-handed triad."""
    along = points / np.linalg.norm(points, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, -1.0]) + along[:, 2:] * along
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    return along, up, np.cross(along, up)


def _search(arm: NominalArm, point: Array, outward: Array, pairs: NDArray[np.int64]) -> tuple[Array, Array]:
    """Numbers of the pairs (m,) and configurations (m, 4) for points and outward directions (3, len(pairs))."""
    samples = _samples()
    found_pairs, found_q = [], []
    for branch in (-1.0, 1.0):
        condition = _upper_arm(arm, point[..., None], outward[..., None], samples, branch)[0]
        pair, low, high = _gaps(arm, point, outward, branch, samples, condition)
        here, there = point[:, pair], outward[:, pair]
        theta3 = _bisect(arm, here, there, branch, low, high)
        q = _configuration(arm, here, there, theta3, branch)
        sound = np.isfinite(q).all(axis=1)
        found_pairs.append(pairs[pair[sound]])
        found_q.append(q[sound])
    return np.concatenate(found_pairs), np.concatenate(found_q)


def _samples() -> Array:
    """Values of θ3 round the circle, (SAMPLES + 1,) [rad], closer together near 0 and π.

    An elbow near the base axis can be reached near those two only. They start half a step off, so that the planar
    configurations at 0 and π lie between samples.
    """
    even = (np.arange(SAMPLES + 1) + 0.5) * 2.0 * np.pi / SAMPLES - np.pi
    return even - 0.45 * np.sin(2.0 * even)


def _gaps(
    arm: NominalArm, point: Array, outward: Array, branch: float, samples: Array, condition: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Numbers of the pairs and θ3 on both sides of each change of sign, all (m,); also between a sample and the reach's end.

    Where E goes out of reach the two branches meet, often with a zero on one of them just before.
    """
    pair, left = np.nonzero(condition[:, :-1] * condition[:, 1:] <= 0.0)
    exists = np.isfinite(condition)
    edge_pair, edge = np.nonzero(exists[:, :-1] != exists[:, 1:])
    inside = np.where(exists[edge_pair, edge], edge, edge + 1)
    reachable, beyond = samples[inside], samples[2 * edge + 1 - inside]
    here, there = point[:, edge_pair], outward[:, edge_pair]
    for _ in range(HALVINGS):
        middle = 0.5 * (reachable + beyond)
        within = np.isfinite(_upper_arm(arm, here, there, middle, branch)[0])
        reachable, beyond = np.where(within, middle, reachable), np.where(within, beyond, middle)
    at_end = _upper_arm(arm, here, there, reachable, branch)[0]
    changes = condition[edge_pair, inside] * at_end <= 0.0
    return (
        np.concatenate([pair, edge_pair[changes]]),
        np.concatenate([samples[left], samples[inside][changes]]),
        np.concatenate([samples[left + 1], reachable[changes]]),
    )


def _bisect(arm: NominalArm, point: Array, outward: Array, branch: float, low: Array, high: Array) -> Array:
    """θ3 where the condition changes its sign between ``low`` and ``high`` (m,) [rad]."""
    start = _upper_arm(arm, point, outward, low, branch)[0]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = _upper_arm(arm, point, outward, middle, branch)[0] * start > 0.0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def _upper_arm(arm: NominalArm, point: Array, outward: Array, theta3: Array, branch: float) -> tuple[Array, Array, Array]:
    """Condition, θ1 and t = -θ2 for given θ3, swivel (as ``outward``) and branch [m, rad, rad]; NaN where E is out of reach.

    In the arm's own vertical plane E stands at ``(reach cos t + d3 sin t, reach sin t - d3 cos t)`` with
    ``reach = l3 cos θ3 - l2``, and beside it at ``l3 sin θ3``. The condition is ``P·(-x2 sin θ3 + y2 cos θ3) - l2 sin θ3``.
    """
    cosine, sine = np.cos(theta3), np.sin(theta3)
    reach, aside = arm.l3 * cosine - arm.l2, arm.l3 * sine
    elbow = _elbow(point, outward, reach**2 + arm.d3**2 + aside**2, arm.d5)
    ahead = branch * _root_or_nan(reach**2 + arm.d3**2 - elbow[2] ** 2)
    t = np.arctan2(elbow[2], ahead) + np.arctan2(arm.d3, reach)
    theta1 = np.arctan2(elbow[1], elbow[0]) - np.arctan2(aside, ahead)
    forward, sideways = _in_arm_plane(point, theta1)
    across = np.cos(t) * forward + np.sin(t) * point[2]  # P · x2
    return cosine * sideways - sine * (across + arm.l2), theta1, t


def _elbow(point: Array, outward: Array, span_squared: Array, d5: float) -> Array:
    """E at |OE| = √span_squared and |EP| = d5 on the side ``outward`` of the line OP, (3, ...) [m]."""
    reach_squared = np.sum(point**2, axis=0)
    along = (span_squared + reach_squared - d5**2) / (2.0 * reach_squared)
    height = _root_or_nan(span_squared - along**2 * reach_squared)
    return np.asarray(along * point + height * outward)


def _configuration(arm: NominalArm, point: Array, outward: Array, theta3: Array, branch: float) -> Array:
    """θ1 to θ4 for θ3 that satisfy the condition, (m, 4) [rad]; θ4 from where P stands beyond E."""
    _, theta1, t = _upper_arm(arm, point, outward, theta3, branch)
    forward, sideways = _in_arm_plane(point, theta1)
    offset = (np.cos(t) * forward + np.sin(t) * point[2] + arm.l2) * np.cos(theta3) + sideways * np.sin(theta3)
    along_tube = np.sin(t) * forward - np.cos(t) * point[2]
    theta4 = -np.arctan2(offset - arm.l3, along_tube - arm.d3)
    theta1, theta2 = (np.pi - np.mod(np.pi - angle, 2.0 * np.pi) for angle in (theta1, -t))
    return np.column_stack([theta1, theta2, theta3, theta4])


def _in_arm_plane(point: Array, theta1: Array) -> tuple[Array, Array]:
    """Horizontal components of P along x1 and square to it [m]."""
    cosine, sine = np.cos(theta1), np.sin(theta1)
    return cosine * point[0] + sine * point[1], cosine * point[1] - sine * point[0]


def _root_or_nan(squared: Array) -> Array:
    """Square root, NaN where there is no real one."""
    return np.sqrt(squared, out=np.full_like(squared, np.nan), where=squared >= 0.0)
