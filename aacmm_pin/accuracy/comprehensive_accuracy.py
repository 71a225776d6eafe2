"""Weights of postures, and comprehensive accuracy (eq. 15 of Xu You et al. 2019)."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array, Index, wrapped


def preferred_theta3(point: Array) -> Array:
    """Angle of joint 3 that the paper prefers, ``atan(Z/ρ) + π/2`` [rad], at points (3,) or (n, 3)
    [m].

    Z = -z of the DH base: with this sign the planar posture of the paper has θ3 = 0.
    """
    x, y, z = point.T
    elevation = np.arctan2(-z, np.hypot(x, y))
    return np.asarray(elevation + np.pi / 2)


def configuration_weights(theta3: Array, point: Array, group: Index | None = None) -> Array:
    """Return the weight c_i of each posture at a point, ``(n,)`` [1], with the sum 1.

    A posture weighs more if the angle of joint 3 is nearer to :func:`preferred_theta3`: ``c_i = (1
    - x_i/Σx)/(n - 1)`` with ``x_i = ||θ3_i| - θ3k|`` (eq. 15 of Xu You et al. 2019). The printed
    factor 1/2 would make the sum not 1. Weights differ little: for n = 12 by a factor of at most
    about 1.2.

    Args:
        theta3: ``(n,)`` [rad]; whole revolutions have no effect.
        point: ``(3,)`` [m] in the DH base, or one for each posture ``(n, 3)``.
        group: number of the point of each posture ``(n,)``; the weights of each point sum to 1.
    """
    group = np.zeros(len(theta3), dtype=np.intp) if group is None else group
    count = np.bincount(group)[group]
    deviation = np.abs(np.abs(wrapped(theta3)) - preferred_theta3(point))
    total = np.bincount(group, deviation)[group]
    share = np.divide(deviation, total, out=1.0 / count, where=total > 0)
    return np.where(count > 1, (1.0 - share) / np.maximum(count - 1, 1), 1.0)


def comprehensive_accuracy(volumes: Array, theta3: Array, point: Array) -> float:
    """Return ``σ = Σ c_i V_i`` of a point, in the unit of ``volumes``; NaN without posture.

    Source: eq. 15 of Xu You et al. 2019, with c_i of :func:`configuration_weights`.
    """
    if len(volumes) == 0:
        return float("nan")
    return float(configuration_weights(theta3, point) @ volumes)
