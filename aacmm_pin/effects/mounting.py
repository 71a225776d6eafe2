"""What the arm stands on, and what it is compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import BASE
from aacmm_pin.effects.conditions import Records
from aacmm_pin.effects.effect import Displacement, Effect, Term, shifts, turns, twist
from aacmm_pin.effects.gravity import GravityEffect
from aacmm_pin.effects.state import State

LEAST_SEATS = 3
"""With fewer seats nothing tells which of them is off."""


@dataclass(frozen=True)
class BaseCompliance(GravityEffect):
    """The stand tilts under the moment of the whole arm: ``δφ = c m``, m about the base origin, always level.

    Unit rad/(N·m); typical 5e-6 to 2e-5 (magnetic base, tripod). Source: rotational stiffness of the mount. Needs no
    column. Confused with: ``bearing_tilt:1``, ``joint_compliance:2``, an eccentricity of joint 2.
    """

    cause: ClassVar[str] = "base_compliance"
    words: ClassVar[str] = "tilting stand (base compliance)"
    flexibility: ClassVar[Term] = Term("", "rad/(N·m)", 1e-5, "compliance_rad_per_nm", positive=True)

    def displacements(self, state: State) -> list[Displacement]:
        """The moment about the origin of the base."""
        whole = not self.bodies and self.load_at is None
        moments = state.moment(1, np.zeros((state.n, 3)))[:, :, None] if whole else self.moments(state, 1)
        return [Displacement(BASE, twist(angular=moments))]


@dataclass(frozen=True)
class SeatError(Effect):
    """One seat is not where it is said to be: true place = stated place + e. The arm itself is right.

    Unit m; typical 1e-5 (worn, dirty, moved). Source: seats of single-point tests, ASME B89.4.22-2004. Needs ``seat``.
    Confused with: any smooth error of the arm where a seat is touched in one posture.
    """

    seat: str
    cause: ClassVar[str] = "seat_error"
    words: ClassVar[str] = "error of the stated place"
    needs: ClassVar[tuple[str, ...]] = ("seat",)
    of_reference: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = shifts(2e-5)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every seat, where there are others that tell where it should be."""
        seats = list(super().candidates(arm, records))
        if records is not None and len(seats) >= LEAST_SEATS and records.known.any():
            yield from seats

    def displacements(self, state: State) -> list[Displacement]:
        """The stated coordinates are those of the tip minus e, in records of this seat."""
        touched = state.conditions.require("seat", self.label) == self.seat
        return [Displacement(BASE, twist(-np.eye(3) * touched[:, None, None]))]


@dataclass(frozen=True)
class ReferenceFrame(Effect):
    """The references stand in a frame that is off from the base by a small shift and turn.

    A twist (v, ω) at the base: ``p_reference = exp(v, ω) p_base``. Units m, rad; any size that is left after the two
    frames have been fitted. Source: rigid registration. Needs no column. Confused with: a zero offset of joint 1 and d of
    row 1, which move the whole arm alike.
    """

    cause: ClassVar[str] = "reference_frame"
    words: ClassVar[str] = "error of the reference frame"
    of_reference: ClassVar[bool] = True
    refitted: ClassVar[bool] = True
    prior_weight: ClassVar[float] = 0.2
    terms: ClassVar[tuple[Term, ...]] = (*shifts(1e-3), *turns(1e-3))

    def displacements(self, state: State) -> list[Displacement]:
        """Unit twists of the base."""
        return [Displacement(BASE, np.eye(6)[None])]
