"""Angles and full turns."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array


def wrapped(angles: Array) -> Array:
    """The same directions as angles in [-π, π) [rad]."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)
