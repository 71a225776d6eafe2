"""From where a scene is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG

OUTERMOST = 60
"""Directions in which the points that have to be seen are looked for."""


@dataclass(frozen=True, eq=False)
class View:
    """What has to be seen, and from which side; the page finds the distance that its own shape needs.

    Attributes:
        points: (n, 3) [m], all of them inside the picture.
        azimuth: of the camera, from +x towards +y [rad].
        elevation: of the camera above the horizontal [rad].
        room: so much is seen beyond the points, for what is thick [m].
    """

    points: Array
    azimuth: float
    elevation: float = 18 * DEG
    room: float = 0.0

    @property
    def direction(self) -> Array:
        """From what is seen towards the camera, unit (3,)."""
        level = np.cos(self.elevation)
        return np.array([level * np.cos(self.azimuth), level * np.sin(self.azimuth), np.sin(self.elevation)])

    @property
    def outermost(self) -> Array:
        """Those of the points that are farthest out, which stand for all (m, 3) [m]."""
        turn = np.arange(OUTERMOST) * np.pi * (3.0 - np.sqrt(5.0))  # evenly over the sphere (Fibonacci)
        height = 1.0 - (2 * np.arange(OUTERMOST) + 1) / OUTERMOST
        level = np.sqrt(1.0 - height**2)
        directions = np.column_stack([level * np.cos(turn), level * np.sin(turn), height])
        return np.asarray(self.points[np.unique((directions @ self.points.T).argmax(axis=1))])
