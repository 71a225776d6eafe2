"""Bases of the causes that yield to weight: known masses give one flexibility, unknown masses give
more free parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm, end
from aacmm_pin.effects.conditions import Records
from aacmm_pin.effects.effect import Effect, Term
from aacmm_pin.effects.state import State
from aacmm_pin.effects.tube import tubes
from aacmm_pin.errors import AacmmError

TYPICAL_SAG = 5e-4
"""Usual turn under a moment that nobody knows [rad]: measuring arms have 1e-4, the joints of robots
up to 5e-3.
"""
TYPICAL_LOAD = 1e-4
"""Usual turn under a load of one metre's lever [rad/m]."""


@dataclass(frozen=True, kw_only=True)
class LoadedEffect(Effect):
    """The base class of elastic causes with one compliance.

    A load that the arm file does not state may act at the end of a body. The parameter is then
    compliance times weight, for a unit force downwards. The load acts in addition to the known
    masses.

    Attributes:
        load_at: row of the body at whose end the load acts; None for the masses of the arm.
    """

    load_at: int | None = None
    flexibility: ClassVar[Term]
    """The parameter if the masses are known."""
    of_load: ClassVar[Term] = Term("", "rad/m", TYPICAL_LOAD, "load_rad_per_m")
    """The parameter for an unknown load."""
    elastic: ClassVar[bool] = True

    @property
    def terms(self) -> tuple[Term, ...]:
        """The compliance, or the compliance times a load."""
        return (self.flexibility if self.load_at is None else self.of_load,)

    @property
    def key(self) -> str:
        """The label with the place of the load."""
        if self.load_at is None:
            return super().key
        return f"{self.label},load_at={self.load_at}"

    @property
    def details(self) -> list[str]:
        """The place of the load as text."""
        return [] if self.load_at is None else [f"load at end of body {self.load_at}"]

    def load_variants(self, arm: Arm) -> tuple[Self, ...]:
        """Return variants with a load at the end of each tube that the cause carries, and at the
        tip.
        """
        ends = dict.fromkeys((*tubes(arm), arm.chain.rows))
        carried = [row for row in ends if row >= (self.row or 0)]
        return tuple(replace(self, load_at=row, values=(), u=()) for row in carried)

    def unit_load(self, state: State, row: int, about: Array) -> Array:
        """Return the moment of a unit load about points ``(n, 3)`` [m] in the base, if body ``row``
        carries the load.

        Raises:
            AacmmError: the load is at a body before ``row``.
        """
        at = state.known_row(self.load_at or 0)
        if at < row:
            raise AacmmError(f"{self.label}: load_at is {at}; expected {row} or a later row")
        return np.cross(state.origin[end(at)] - about, state.down)


@dataclass(frozen=True, kw_only=True)
class GravityEffect(LoadedEffect):
    """The base class of causes that are proportional to a static moment.

    If the arm has masses, the only parameter is a compliance. If not, ``bodies`` names the rows
    whose weight acts. The static moment is linear in the first moments of these bodies. The
    parameters are then compliance × first moment × |g|: three numbers for each body, in its own
    axes. Weights farther out act at the ends of the bodies, so that records determine some
    parameters only in combination.

    Attributes:
        bodies: rows of the bodies with unknown masses, from the row of the axis on; () for the
            masses of the arm. The last body includes all bodies that it carries.
    """

    bodies: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Files have lists only; a load and unknown masses exclude each other."""
        object.__setattr__(self, "bodies", tuple(self.bodies))
        super().__post_init__()
        if self.bodies and self.load_at is not None:
            raise AacmmError(
                f"{self.label}: load_at and bodies are both stated; expected one of the two"
            )

    @property
    def terms(self) -> tuple[Term, ...]:
        """The compliance, three numbers for each body of unknown mass, or one number for a load."""
        if not self.bodies:
            return super().terms
        names = [f"{body}{component}" for body in self.bodies for component in "xyz"]
        return tuple(Term(name, "rad", TYPICAL_SAG, f"sag{name}_rad") for name in names)

    def basis(self, arm: Arm, records: Records) -> Effect | None:
        """Return the effect with all bodies of unknown mass; None with the masses of the arm."""
        if not self.bodies:
            return None
        return replace(self, bodies=bodies_beyond(arm, self.bodies[0]), values=(), u=())

    def load_variants(self, arm: Arm) -> tuple[Self, ...]:
        """Return the variants with a load; none if the cause does not use the masses of the arm."""
        if self.bodies or "torque" in self.needs:
            return ()
        return super().load_variants(arm)

    def moments(self, state: State, row: int) -> Array:
        """Return the moment about the bearing of ``row`` per unit of each parameter, in the base:
        ``(n, 3, p)``.

        Raises:
            UnsupportedArmError: the arm has no masses and ``bodies`` is empty.
            AacmmError: ``bodies`` are not the first bodies at and beyond this axis, or the load is
                before the axis.
        """
        if self.load_at is not None:
            return self.unit_load(state, row, state.origin[state.bearing(row)])[:, :, None]
        if not self.bodies:
            return state.moment_at_axis(row)[:, :, None]
        beyond = bodies_beyond(state.arm, row)
        count = len(self.bodies)
        if self.bodies != beyond[:count]:
            raise AacmmError(
                f"{self.label}: bodies is {self.bodies}; expected {beyond}, which are the bodies "
                f"at and beyond row {row}, or the first of them"
            )
        return state.unit_moments(row)[:, :, : 3 * count]


def bodies_beyond(arm: Arm, row: int) -> tuple[int, ...]:
    """Return the rows of the bodies at and beyond an axis."""
    return tuple(k for k in arm.chain.joint_rows() if k >= row)


def load_variants(effect: Effect, arm: Arm) -> tuple[Effect, ...]:
    """Return the variants of an effect with an unknown load; none for an effect without weights."""
    return effect.load_variants(arm) if isinstance(effect, LoadedEffect) else ()
