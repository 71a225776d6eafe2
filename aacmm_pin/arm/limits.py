"""Joint limits and full turns."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array, Mask, wrapped
from aacmm_pin._support.display import Note

AT_LIMIT = 1e-9
"""Tolerance of limits [rad]."""
STOP_TOLERANCE = 0.02
"""Angles beyond a limit that elastic stops and zero offsets explain [rad]."""
STANDSTILL = 1e-15
"""Least motion of a joint, against division by 0 [rad]."""


def into_limits(q: Array, limits: Array) -> Array:
    """``q`` (n, nq) [rad] moved by whole revolutions inside limits (nq, 2), or least outside.

    Of several, the nearest to the middle; without finite limits within ±π.
    """
    revolution = 2 * np.pi
    finite = np.isfinite(limits).all(axis=1)
    lower, upper = np.where(finite, limits.T, [[-np.pi], [np.pi]])
    # Exact where no revolution is needed; of two equally near angles the lower one.
    revolutions = np.ceil((0.5 * (lower + upper) - q) / revolution - 0.5 - AT_LIMIT)
    return np.asarray(q + revolution * revolutions)


def outside_limits(q: Array, limits: Array) -> Mask:
    """Angles ``q`` (n, nq) [rad] outside ``limits`` (nq, 2): (n, nq)."""
    below = q < limits[:, 0] - AT_LIMIT
    above = q > limits[:, 1] + AT_LIMIT
    return below | above


def whole_turn_notes(q: Array, limits: Array, slides: Mask) -> list[Note]:
    """A note if revolute joints in ``q`` (n, nq) [rad] exceed limits (nq, 2) by whole turns."""
    nearest_turn = into_limits(q, limits)
    tolerant_limits = limits + STOP_TOLERANCE * np.array([-1.0, 1.0])
    by_whole_turns = outside_limits(q, limits) & (np.abs(nearest_turn - q) > np.pi)
    by_whole_turns &= ~outside_limits(nearest_turn, tolerant_limits) & ~slides
    joints = np.flatnonzero(by_whole_turns.any(axis=0)) + 1
    if not joints.size:
        return []
    records = int(by_whole_turns.any(axis=1).sum())
    return [
        Note("angles_outside_limits", {"records": records, "of": len(q), "joints": joints.tolist()})
    ]


def inside_part(start: Array, end: Array, limits: Array) -> tuple[Array, Array]:
    """The fractions of steps from ``start`` to ``end`` between which they are inside the limits.

    Args:
        start, end: (n, nq) [rad], less than π apart.
        limits: (nq, 2) [rad]; those of a whole revolution do not count.

    Returns:
        first, last: (n,) in [0, 1]; last <= first if nothing is inside.
    """
    half_range = 0.5 * (limits[:, 1] - limits[:, 0])
    bounded = half_range < np.pi - AT_LIMIT
    if not bounded.any():
        return np.zeros(len(start)), np.ones(len(start))
    half_width = half_range[bounded] + AT_LIMIT
    centre = limits[bounded].mean(axis=1)
    start_offset = wrapped(start[:, bounded] - centre)
    step = end[:, bounded] - start[:, bounded]
    step = np.where(np.abs(step) < STANDSTILL, STANDSTILL, step)
    limit_offsets = np.stack([-half_width, half_width])
    crossings = (limit_offsets[:, None] - start_offset) / step  # (2, n, bounded)
    first = crossings.min(axis=0).max(axis=1)
    last = crossings.max(axis=0).min(axis=1)
    return first.clip(0.0, 1.0), last.clip(0.0, 1.0)
