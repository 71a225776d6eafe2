"""What a pose demands of the joint angles: the tip's place, the direction of one of its axes, or its whole orientation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm.chain import Chain, skew
from aacmm_pin.postures.continuation import System

TINY = 1e-12
"""Sine of an angle below which a direction has arrived, or points right away from its goal."""
SERIES = 1e-3
"""Angle below which a series loses fewer digits than the closed form [rad]."""


@dataclass(frozen=True, eq=False)
class PoseConditions:
    """Conditions on the tip of a chain whose joints turn.

    Attributes:
        chain: the arm.
        point: place of the tip (3,) [m].
        tool: unit direction in the tip's frame that shall lie along ``axis`` (3,), or None.
        axis: unit direction in the base (3,), or None.
        rotation: orientation of the tip's frame in the base (3, 3), or None.
    """

    chain: Chain
    point: Array
    tool: Array | None = None
    axis: Array | None = None
    rotation: Array | None = None

    @property
    def count(self) -> int:
        """Number of conditions: 3, 5 with an axis, 6 with a rotation."""
        return 6 if self.rotation is not None else 5 if self.axis is not None else 3

    @property
    def free(self) -> int:
        """Joints beyond the conditions: the dimension of a set of postures that meets them, outside singularities."""
        return self.chain.nq - self.count

    def system(self) -> System:
        """Residual (n, count) [m, rad] and its derivative (n, count, nq), for :mod:`aacmm_pin.postures.continuation`."""
        orientation = self._orientation()

        def system(q: Array, problem: Index) -> tuple[Array, Array]:
            rotation, origin = self.chain.walk(q)
            off, (linear, angular) = origin[-1] - self.point, self.chain.jacobian(rotation, origin, origin[-1])
            if orientation is None:
                return off, linear
            f, derivative = orientation(rotation[-1])
            return np.concatenate([off, f], axis=1), np.concatenate([linear, derivative @ angular], axis=1)

        return system

    def _orientation(self) -> Callable[[Array], tuple[Array, Array]] | None:
        """From the tip's orientation (n, 3, 3): how far it is off, and the derivative of that by a turn of the tip."""
        if (rotation := self.rotation) is not None:
            return lambda turned: turned_off(turned @ rotation.T)
        if (axis := self.axis) is None or (tool := self.tool) is None:
            return None
        normals = np.linalg.svd(axis[None, :])[2][1:]

        def pointed(turned: Array) -> tuple[Array, Array]:
            direction = turned @ tool
            f, slope = pointed_off(direction, axis, normals)
            return f, -slope @ skew(direction)

        return pointed


def turned_off(m: Array) -> tuple[Array, Array]:
    """The turn of rotations ``m`` (n, 3, 3) as axis times angle (n, 3) [rad], and its derivative by a turn ω before it.

    ``φ = log m``, ``∂φ/∂ω = 1 - ½ [φ] + c [φ]²`` with c = 1/φ² - (1 + cos φ)/(2 φ sin φ) (Murray, Li, Sastry 1994, 2.3;
    the inverse of the left Jacobian). Unlike the sine of the angle it has no zero half a turn away: Newton's method from
    random starts then arrives four times as often. Half a turn away it jumps, which costs a detour.
    """
    sine = 0.5 * np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
    s, cosine = np.linalg.norm(sine, axis=1), 0.5 * (np.trace(m, axis1=1, axis2=2) - 1.0)
    straight = s < TINY
    angle, safe = np.arctan2(s, cosine), np.where(straight, 1.0, s)
    phi = sine * np.where(straight, 1.0, angle / safe)[:, None]
    phi[straight & (cosine < 0), 0] = np.pi  # any axis is as wrong as another
    near = angle < SERIES
    a = np.where(near, 1.0, angle)
    c = np.where(near, 1.0 / 12.0 + angle**2 / 720.0, 1.0 / a**2 - (1.0 + cosine) / (2.0 * a * safe))
    cross = skew(phi)
    return phi, np.eye(3) - 0.5 * cross + c[:, None, None] * (cross @ cross)


def pointed_off(direction: Array, axis: Array, normals: Array) -> tuple[Array, Array]:
    """How far unit vectors ``direction`` (n, 3) point off ``axis`` (3,): the angle along two ``normals`` (2, 3).

    The part across the axis, stretched from the sine of the angle θ to the angle: ``f = N d θ/sin θ``, for the same reason.

    Returns:
        f (n, 2) [rad] and ∂f/∂d (n, 2, 3).
    """
    across, along = direction @ normals.T, direction @ axis
    s = np.linalg.norm(across, axis=1)
    straight = s < TINY
    safe = np.where(straight, 1.0, s)
    stretch = np.where(straight, 1.0, np.arctan2(s, along) / safe)
    f = stretch[:, None] * across
    f[straight & (along < 0), 0] = np.pi
    slope = ((along - stretch) / safe**2)[:, None] * (across @ normals) - axis  # of the stretch
    slope[straight] = 0.0
    return f, stretch[:, None, None] * normals + across[:, :, None] * slope[:, None, :]
