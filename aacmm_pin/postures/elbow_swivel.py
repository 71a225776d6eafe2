"""The swivel angle: the place of the elbow on its circle about the line shoulder → working point.

It is 0 if the elbow is highest, and grows by the right-hand rule about shoulder → point. If this
line is vertical, the base axis least along gravity replaces "up".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import DHTable

UPRIGHT = 1e-9
"""Sine below which this line is vertical."""


@dataclass(frozen=True)
class Swivel:
    """Swivel angles of an arm; ``up`` is the unit vector against gravity (3,)."""

    dh: DHTable
    up: Array

    @property
    def shoulder(self) -> Array:
        """The fixed point of joint axis 1 closest to joint axis 2, (3,) [m]."""
        rotation, origin = self.dh.chain.at_zero
        frame = self.dh.place(1)
        place = origin[frame]
        if self.dh.standard:
            place = place - self.dh.a[0] * rotation[frame, :, 0]
        return np.asarray(place)

    def elbow(self, q: Array) -> Array:
        """Elbow, on joint axis 4, at ``q`` (n, nq): (n, 3) [m]."""
        frame = self.dh.place(3 if self.dh.standard else 4)
        return self.dh.chain.cut(frame).positions(q)

    def angle(self, q: Array, point: Array) -> Array:
        """Swivel at ``q`` (n, nq) with one working point (3,): (n,) [rad] in [-π, π]."""
        return self.angle_in(self.frames(point[None, :]), q)

    def frames(self, points: Array) -> Array:
        """Directions of the angles 0 and π/2 (m, 2, 3), of equal length, at points (m, 3)."""
        axis = points - self.shoulder
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        axis = axis / np.maximum(length, 1e-300)
        reference = self.up - axis * (axis @ self.up)[:, None]
        upright = np.linalg.norm(reference, axis=1) < UPRIGHT
        level = np.eye(3)[np.argmin(np.abs(self.up))]
        reference[upright] = level - axis[upright] * (axis[upright] @ level)[:, None]
        return np.stack([reference, np.cross(axis, reference)], axis=1)

    def angle_in(self, frames: Array, q: Array) -> Array:
        """Swivel (n,) [rad] at ``q`` (n, nq) in the :meth:`frames` of their points (n or 1, 2,
        3).
        """
        upwards, sideways = np.einsum("nki,ni->kn", frames, self.elbow(q) - self.shoulder)
        return np.asarray(np.arctan2(sideways, upwards))
