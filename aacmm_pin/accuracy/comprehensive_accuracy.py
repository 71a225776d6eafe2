"""Weights of configurations and the comprehensive accuracy of a working point (eq. 15 of Xu You et
al. 2019).
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, Index


def preferred_theta3(point: Array) -> Array:
    """Angle of joint 3 at which the paper finds SINO6 handiest: ``atan(Z/ρ) + π/2`` [rad].

    Z is drawn downward in the paper, Z = -z of the DH base, which is the reading that goes with its
    θ3 = 0 for one of the two planar configurations. ``point`` (3,) or (n, 3) [m] in the DH base.
    """
    x, y, z = point.T
    elevation = np.arctan2(-z, np.hypot(x, y))
    return np.asarray(elevation + np.pi / 2)


def configuration_weights(theta3: Array, point: Array, group: Index | None = None) -> Array:
    """Weights c_i of the configurations at a point, nearer to :func:`preferred_theta3` heavier:
    (n,) [1], sum 1.

    ``c_i = (1 - x_i/Σx)/(n - 1)`` with ``x_i = ||θ3_i| - θ3k|``. The print has an extra factor 1/2,
    with which the weights would not sum to one. The weights differ little by construction: with n =
    12 by a factor of about 1.2 at most.

    Args:
        theta3: (n,) [rad], any turn; its size is taken of the angle in (-π, π].
        point: working point (3,) [m] in the DH base, or that of each configuration (n, 3).
        group: where there are many points, their numbers (n,); the weights of each sum to 1.
    """
    group = np.zeros(len(theta3), dtype=np.intp) if group is None else group
    count = np.bincount(group)[group]
    away = np.abs(np.abs(wrapped(theta3)) - preferred_theta3(point))
    total = np.bincount(group, away)[group]
    share = np.divide(away, total, out=1.0 / count, where=total > 0)
    return np.where(count > 1, (1.0 - share) / np.maximum(count - 1, 1), 1.0)


def comprehensive_accuracy(volumes: Array, theta3: Array, point: Array) -> float:
    """``σ = Σ c_i V_i`` over the working configurations of a point; nan where there is none. In the
    unit of ``volumes``.
    """
    if len(volumes) == 0:
        return float("nan")
    return float(configuration_weights(theta3, point) @ volumes)
