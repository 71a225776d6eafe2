"""Bases of the causes that yield to weight: known masses give one flexibility, unknown masses give
more free parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm, end
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
    """Something that yields to the weights which it carries, with one flexibility.

    A load that the arm's file does not have may hang at the end of a body: ``flexibility × weight``
    is the parameter then, of a unit force downwards there. It comes on top of the flexibility that
    is known.

    Attributes:
        load_at: row of the body at whose end the load hangs; None where the arm's masses count.
    """

    load_at: int | None = None
    flexibility: ClassVar[Term]
    """The parameter where the masses are known."""
    of_load: ClassVar[Term] = Term("", "rad/m", TYPICAL_LOAD, "load_rad_per_m")
    """The parameter under a load."""
    elastic: ClassVar[bool] = True

    @property
    def terms(self) -> tuple[Term, ...]:
        """One flexibility, or that times a load."""
        return (self.flexibility if self.load_at is None else self.of_load,)

    @property
    def key(self) -> str:
        """With where the load hangs."""
        if self.load_at is None:
            return super().key
        return f"{self.label},load_at={self.load_at}"

    @property
    def details(self) -> list[str]:
        """Where the load hangs."""
        return [] if self.load_at is None else [f"load at end of body {self.load_at}"]

    def load_variants(self, arm: Arm) -> tuple[Self, ...]:
        """With a load at the end of each tube that it carries, and at the tip."""
        ends = dict.fromkeys((*tubes(arm), arm.chain.rows))
        carried = [row for row in ends if row >= (self.row or 0)]
        return tuple(replace(self, load_at=row, values=(), u=()) for row in carried)

    def unit_load(self, state: State, row: int, about: Array) -> Array:
        """Moment of a unit load about points of the base (n, 3) [m], carried by body ``row``.

        Raises:
            AacmmError: the load hangs before this body.
        """
        at = state.known_row(self.load_at or 0)
        if at < row:
            raise AacmmError(f"{self.label}: load_at is {at}; expected {row} or a later row")
        return np.cross(state.origin[end(at)] - about, state.down)


@dataclass(frozen=True, kw_only=True)
class GravityEffect(LoadedEffect):
    """A displacement proportional to a static moment.

    With the masses of the arm the one parameter is a flexibility. Where the arm states none, name
    the ``bodies`` (rows)
    that pull: the static moment is linear in their first moments, so that flexibility × first
    moment × |g| of each body, three numbers in its own axes, are the parameters; nothing is
    guessed. Weights farther out are gathered at the bodies' ends, so some of these numbers are
    known only together.

    Attributes:
        bodies: rows of the bodies with unknown masses; () where the arm's masses count.
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
        """One flexibility, or three numbers for each body of unknown mass, or one for a load."""
        if not self.bodies:
            return super().terms
        names = [f"{body}{component}" for body in self.bodies for component in "xyz"]
        return tuple(Term(name, "rad", TYPICAL_SAG, f"sag{name}_rad") for name in names)

    def load_variants(self, arm: Arm) -> tuple[Self, ...]:
        """None where the masses do not count."""
        if self.bodies or "torque" in self.needs:
            return ()
        return super().load_variants(arm)

    def moments(self, state: State, row: int) -> Array:
        """Moment about ``axis row`` per unit of each parameter, in the base: (n, 3, p).

        Raises:
            UnsupportedArmError: the arm states no masses and no ``bodies`` are named.
            AacmmError: the ``bodies`` are not those at and beyond the axis, or the load hangs
                before it.
        """
        if self.load_at is not None:
            return self.unit_load(state, row, state.origin[state.bearing(row)])[:, :, None]
        if not self.bodies:
            return state.moment_at_axis(row)[:, :, None]
        columns = state.unit_moments(row)
        beyond = tuple(k for k in state.arm.chain.joint_rows() if k >= row)
        if self.bodies != beyond:
            raise AacmmError(
                f"{self.label}: bodies is {self.bodies}; expected {beyond}, which are the bodies "
                f"at and beyond row {row}"
            )
        return columns


def load_variants(effect: Effect, arm: Arm) -> tuple[Effect, ...]:
    """The effect under loads that the arm's file does not have; none of one that bears no
    weight.
    """
    return effect.load_variants(arm) if isinstance(effect, LoadedEffect) else ()
