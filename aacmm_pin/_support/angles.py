"""Angles and full turns."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array


def wrapped(angles: Array) -> Array:
    """The same directions in [-π, π) [rad]."""
    within_turn = (angles + np.pi) % (2 * np.pi)
    return within_turn - np.pi


def spread_angles(count: int, joints: int) -> Array:
    """Evenly spread angles (count, joints) in [-π, π) [rad], without randomness.

    Additive recurrence with the powers of the root of x^(d+1) = x + 1 (M. Roberts, 2018).
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (joints + 1))
    steps = root ** -np.arange(1.0, joints + 1)
    return (np.arange(1, count + 1)[:, None] * steps % 1.0) * (2 * np.pi) - np.pi
