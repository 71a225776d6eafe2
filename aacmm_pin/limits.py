"""Joint limits and full turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aacmm_pin.checks import Array

AT_LIMIT = 1e-9
"""An angle this little beyond a limit is on it [rad]."""


def into_limits(q: Array, limits: Array) -> Array:
    """The same configurations, each angle turned by whole turns to where it is inside its limits or least outside.

    Args:
        q: (n, nq) [rad].
        limits: (nq, 2) [rad].
    """
    lower, upper = limits[:, 0], limits[:, 1]
    turns = np.ceil((lower - AT_LIMIT - q) / (2 * np.pi))
    first = q + 2 * np.pi * turns  # in [lower, lower + 2π); exact where no turn is needed
    outside = first > upper + AT_LIMIT
    nearer_below = outside & (lower - (first - 2 * np.pi) < first - upper)
    return np.asarray(np.where(nearer_below, first - 2 * np.pi, first))


def broken_limits(q: Array, limits: Array) -> NDArray[np.bool_]:
    """Which angles of ``q`` (n, nq) [rad], as they stand, are outside ``limits`` (nq, 2): (n, nq)."""
    return np.asarray((q < limits[:, 0] - AT_LIMIT) | (q > limits[:, 1] + AT_LIMIT))


def margin(q: Array, limits: Array) -> Array:
    """Distance to the nearest limit, negative outside, for ``q`` as :func:`into_limits` leaves it: (n,) [rad].

    Joints that can make a full turn have no limit that matters here.
    """
    bounded = limits[:, 1] - limits[:, 0] < 2 * np.pi - AT_LIMIT
    if not bounded.any():
        return np.full(len(q), np.inf)
    q, limits = q[:, bounded], limits[bounded]
    return np.asarray(np.minimum(q - limits[:, 0], limits[:, 1] - q).min(axis=1))
