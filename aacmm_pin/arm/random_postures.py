"""Random postures: inside limits, beside the stand, above a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, Mask, spread_angles
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.errors import AacmmError, UnsupportedArmError

MARGIN = 1e-3
"""Distance from the limits, for noise and small errors [rad, m]."""
CLEAR = 0.1
"""Distance of tips from joint axis 1, where the stand is [m]."""
MOST_DRAWS = 20


def joint_bounds(arm: Arm) -> Array:
    """The limits less :data:`MARGIN`, (nq, 2) [rad, m]; ±π for wider limits."""
    limits = arm.limits.copy()
    slides = arm.chain.prismatic
    endless = _endless(arm)
    if (endless & slides).any():
        joint = int(np.flatnonzero(endless & slides)[0]) + 1
        raise UnsupportedArmError(
            f"{arm.name}: the prismatic joint {joint} has no limits; expected limits, because "
            "random postures lie between them"
        )
    limits[endless] = (-np.pi, np.pi)
    margin = np.minimum(MARGIN, 0.01 * (limits[:, 1] - limits[:, 0]))
    return np.asarray(limits + margin[:, None] * np.array([1.0, -1.0]))


def random_postures(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Postures uniform between the bounds: (count, nq) [rad, m]."""
    bounds = joint_bounds(arm)
    return rng.uniform(bounds[:, 0], bounds[:, 1], size=(count, arm.nq))


def spread_postures(arm: Arm, count: int, q: Array) -> Array:
    """Deterministic postures spread evenly between the limits: (count, nq) [rad, m].

    A revolute joint without limits makes one revolution; a prismatic one has the range of ``q`` (n,
    nq).
    """
    slides = arm.chain.prismatic
    endless = _endless(arm)
    low, high = arm.limits.T
    low = np.where(endless, np.where(slides, q.min(axis=0), -np.pi), low)
    high = np.where(endless, np.where(slides, q.max(axis=0), np.pi), high)
    fraction = spread_angles(count, arm.nq) / (2 * np.pi) + 0.5
    return low + (high - low) * fraction


def _endless(arm: Arm) -> Mask:
    """Joints without limits, or with limits several revolutions apart: (nq,)."""
    unlimited = ~np.isfinite(arm.limits).all(axis=1)
    farthest = np.abs(arm.limits).max(axis=1)
    many_revolutions = farthest > plausible.MOST_TURNS * 2 * np.pi
    revolute = ~arm.chain.prismatic
    return np.asarray(unlimited | many_revolutions & revolute)


@dataclass(frozen=True, eq=False)
class Room:
    """Places for a part beside an arm: :data:`CLEAR` of joint axis 1, not below ``above``.

    Collisions of the arm with itself or the table do not count.

    Attributes:
        above: height of the table over the base origin, against gravity [m], or None.
    """

    arm: Arm
    above: float | None = None

    def __post_init__(self) -> None:
        if self.above is not None:
            plausible.COORDINATE.check(self.above, "above")

    def admits(self, tips: Array) -> Mask:
        """Which of the ``tips`` (n, 3) [m] are in the room: (n,)."""
        rotation, origin = self.arm.chain.at_zero
        first = self.arm.chain.moving_axes()[0]
        lever = np.cross(tips - origin[first], rotation[first, :, 2])
        distance_from_axis_1 = np.linalg.norm(lever, axis=1)
        inside: Mask = distance_from_axis_1 >= CLEAR
        if self.above is not None:
            inside &= tips @ self.arm.up >= self.above
        return inside

    def postures(self, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Random postures (count, nq) [rad], uniform in the joints, with tips (count, 3) [m] in the
        room.
        """
        admitted_q = []
        admitted_tips = []
        admitted = 0
        for _ in range(MOST_DRAWS):
            q = random_postures(self.arm, count, rng)
            tips = self.arm.positions(q)
            in_room = self.admits(tips)
            admitted_q.append(q[in_room])
            admitted_tips.append(tips[in_room])
            admitted += int(in_room.sum())
            if admitted >= count:
                return np.concatenate(admitted_q)[:count], np.concatenate(admitted_tips)[:count]
        high = "" if self.above is None else f" and {self.above / MM:g} mm above the base"
        raise AacmmError(
            f"{self.arm.name}: {admitted} of {MOST_DRAWS * count} random postures have the tip at "
            f"least {CLEAR / MM:g} mm from the axis of joint 1{high}; expected at least "
            f"{count}; check the lengths and joint limits of the arm, and the height of the table"
        )
