"""The swivel angle: where on its circle the elbow is.

The elbow turns about the line from the shoulder to the working point. Its angle is 0 where it is
highest (against gravity) and grows by the right-hand rule about the direction shoulder → point.
Straight above or below the shoulder no direction is "highest"; the axis of the base frame that is
least along gravity (x, where gravity is along z) takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import DHTable

UPRIGHT = 1e-9
"""Sine below which the line shoulder → point counts as vertical."""


@dataclass(frozen=True)
class Swivel:
    """Swivel angles of one arm.

    Attributes:
        dh: its table.
        up: unit vector against gravity (3,).
    """

    dh: DHTable
    up: Array

    @property
    def shoulder(self) -> Array:
        """The point of joint axis 1 next to joint axis 2, (3,) [m]; it does not move."""
        rotation, origin = self.dh.chain.walk(np.zeros((1, self.dh.nq)))
        frame = self.dh.place(1)
        place = origin[frame, 0]
        if self.dh.standard:
            place = place - self.dh.a[0] * rotation[frame, 0, :, 0]
        return np.asarray(place)

    def elbow(self, q: Array) -> Array:
        """Position of the elbow, on joint axis 4, for ``q`` (n, nq): (n, 3) [m]."""
        frame = self.dh.place(3 if self.dh.standard else 4)
        return self.dh.chain.cut(frame).positions(q)

    def angle(self, q: Array, points: Array) -> Array:
        """Swivel angles of ``q`` (n, nq) with their working points (n, 3): (n,) [rad] in
        [-π, π].
        """
        return self.angle_in(self.frames(points), q)

    def frames(self, points: Array) -> Array:
        """For working points (m, 3) the directions of the swivel angles 0 and π/2 (m, 2, 3), of the
        same length.
        """
        axis = points - self.shoulder
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        axis = axis / np.maximum(length, 1e-300)
        reference = self.up - axis * (axis @ self.up)[:, None]
        upright = np.linalg.norm(reference, axis=1) < UPRIGHT
        level = np.eye(3)[np.argmin(np.abs(self.up))]
        reference[upright] = level - axis[upright] * (axis[upright] @ level)[:, None]
        return np.stack([reference, np.cross(axis, reference)], axis=1)

    def angle_in(self, frames: Array, q: Array) -> Array:
        """Swivel angles of ``q`` (n, nq) in the :meth:`frames` of their working points (n, 2, 3):
        (n,) [rad] in [-π, π].
        """
        upwards, sideways = np.einsum("nki,ni->kn", frames, self.elbow(q) - self.shoulder)
        return np.asarray(np.arctan2(sideways, upwards))
