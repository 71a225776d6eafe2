"""Joint limits and full turns."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.notes import Note

AT_LIMIT = 1e-9
"""An angle this little beyond a limit is on it [rad]."""
STOP_TOLERANCE = 0.02
"""Stops give way, and zeros are offset, by so much at most [rad]."""


def into_limits(q: Array, limits: Array) -> Array:
    """The same configurations, each angle turned by whole turns to where it is inside its limits or
    least outside.

    Of several places inside, which limits wider than a turn have, the one nearest to their middle.

    Args:
        q: (n, nq) [rad].
        limits: (nq, 2) [rad]; a joint without finite limits is put within half a turn of zero.
    """
    turn = 2 * np.pi
    finite = np.isfinite(limits).all(axis=1)
    lower, upper = np.where(finite, limits.T, [[-np.pi], [np.pi]])
    # In [lower, lower + 2π); exact where no turn is needed.
    first = q + turn * np.ceil((lower - AT_LIMIT - q) / turn)
    previous = first - turn
    outside = first > upper + AT_LIMIT
    nearer_below = outside & (lower - previous < first - upper)
    more = np.floor((upper + AT_LIMIT - first) / turn)
    to_middle = np.ceil((0.5 * (lower + upper) - first) / turn - 0.5 - AT_LIMIT)
    inside = first + turn * np.clip(to_middle, 0.0, np.maximum(more, 0.0))
    return np.asarray(np.where(nearer_below, previous, inside))


def broken_limits(q: Array, limits: Array) -> Mask:
    """Which angles of ``q`` (n, nq) [rad], as they stand, are outside ``limits`` (nq, 2):
    (n, nq).
    """
    below = q < limits[:, 0] - AT_LIMIT
    above = q > limits[:, 1] + AT_LIMIT
    return below | above


def other_turns(q: Array, limits: Array, slides: Mask) -> list[Note]:
    """That turning joints have angles ``q`` (n, nq) [rad] that are whole turns outside their limits
    (nq, 2).
    """
    turned = into_limits(q, limits)
    lost = (
        broken_limits(q, limits)
        & ~broken_limits(turned, limits + STOP_TOLERANCE * np.array([-1.0, 1.0]))
        & ~slides
    )
    lost &= np.abs(turned - q) > np.pi
    joints = np.flatnonzero(lost.any(axis=0)) + 1
    if not joints.size:
        return []
    records = int(lost.any(axis=1).sum())
    return [
        Note("angles_outside_limits", {"records": records, "of": len(q), "joints": joints.tolist()})
    ]


def inside_part(start: Array, end: Array, limits: Array) -> tuple[Array, Array]:
    """Which part of the way from ``start`` to ``end``, along a straight line, is inside the limits.

    Args:
        start, end: (n, nq) [rad], any turns; less than half a turn apart.
        limits: (nq, 2) [rad]; joints that can make a full turn have no limit that matters here.

    Returns:
        first, last: (n,) in [0, 1]; nothing is inside where last <= first.
    """
    half = 0.5 * (limits[:, 1] - limits[:, 0])
    bounded = half < np.pi - AT_LIMIT
    if not bounded.any():
        return np.zeros(len(start)), np.ones(len(start))
    half = half[bounded] + AT_LIMIT
    centre = limits[bounded].mean(axis=1)
    off = wrapped(start[:, bounded] - centre)
    way = end[:, bounded] - start[:, bounded]
    way = np.where(np.abs(way) < 1e-15, 1e-15, way)
    ends = np.stack([(-half - off) / way, (half - off) / way])
    first = ends.min(axis=0).max(axis=1)
    last = ends.max(axis=0).min(axis=1)
    return first.clip(0.0, 1.0), last.clip(0.0, 1.0)
