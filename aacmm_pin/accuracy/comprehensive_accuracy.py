"""Weights of configurations and the comprehensive accuracy of a working point (eq. 15 of Xu You et al. 2019)."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array


def preferred_theta3(point: Array) -> float:
    """Angle of joint 3 at which the paper finds SINO6 handiest: ``atan(Z/ρ) + π/2`` [rad].

    Z is drawn downward in the paper, Z = -z of the DH base, which is the reading that goes with its θ3 = 0 for one of the
    two planar configurations. ``point`` (3,) [m] in the DH base.
    """
    return float(np.arctan2(-point[2], np.hypot(point[0], point[1])) + np.pi / 2)


def configuration_weights(theta3: Array, point: Array) -> Array:
    """Weights c_i of the configurations at a point, nearer to :func:`preferred_theta3` heavier: (n,) [1], sum 1.

    ``c_i = (1 - x_i/Σx)/(n - 1)`` with ``x_i = ||θ3_i| - θ3k|``. The print has an extra factor 1/2, with which the weights
    would not sum to one. The weights differ little by construction: with n = 12 by a factor of about 1.2 at most.

    Args:
        theta3: (n,) [rad], any turn; its size is taken of the angle in (-π, π].
        point: working point (3,) [m] in the DH base.
    """
    n = len(theta3)
    if n == 0:
        return np.empty(0)
    if n == 1:
        return np.ones(1)
    folded = np.abs(wrapped(theta3))
    away = np.abs(folded - preferred_theta3(point))
    total = away.sum()
    share = away / total if total > 0 else np.full(n, 1.0 / n)
    return np.asarray((1.0 - share) / (n - 1))


def comprehensive_accuracy(volumes: Array, theta3: Array, point: Array) -> float:
    """``σ = Σ c_i V_i`` over the working configurations of a point; nan where there is none. In the unit of ``volumes``."""
    if len(volumes) == 0:
        return float("nan")
    return float(configuration_weights(theta3, point) @ volumes)
