"""Base of the causes that yield to weight: known masses give one flexibility, unknown masses give more free parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.effects.effect import Effect, Term
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

TYPICAL_SAG = 1e-4
"""Usual turn under a moment that nobody knows [rad]."""


@dataclass(frozen=True, kw_only=True)
class GravityEffect(Effect):
    """A displacement proportional to a static moment.

    With the masses of the arm the one parameter is a flexibility. Where the arm states none, name the ``bodies`` (rows)
    that pull: the static moment is linear in their first moments, so that flexibility × first moment × |g| of each body,
    three numbers in its own axes, are the parameters; nothing is guessed. Weights farther out are gathered at the bodies'
    ends, so some of these numbers are known only together.

    Attributes:
        bodies: rows of the bodies with unknown masses; () where the arm's masses count.
    """

    bodies: tuple[int, ...] = ()
    flexibility: ClassVar[Term]
    """The parameter where the masses are known."""
    elastic: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Files have lists only."""
        object.__setattr__(self, "bodies", tuple(self.bodies))
        super().__post_init__()

    @property
    def terms(self) -> tuple[Term, ...]:
        """One flexibility, or three numbers for each body of unknown mass."""
        if not self.bodies:
            return (self.flexibility,)
        names = [f"{body}{component}" for body in self.bodies for component in "xyz"]
        return tuple(Term(name, "rad", TYPICAL_SAG, f"sag{name}_rad") for name in names)

    def moments(self, state: State, row: int) -> Array:
        """Moment about ``axis row`` per unit of each parameter, in the base: (n, 3, p).

        Raises:
            UnsupportedArmError: the arm states no masses and no ``bodies`` are named.
            AacmmError: the ``bodies`` are not those at and beyond the axis.
        """
        if not self.bodies:
            return np.asarray(state.moment_at_axis(row)[:, :, None])
        columns = state.unit_moments(row)
        beyond = tuple(place // 2 for place in state.arm.chain.moving_axes() if place // 2 >= row)
        if self.bodies != beyond:
            raise AacmmError(f"{self.label}: bodies is {self.bodies}, expected those at and beyond row {row}, {beyond}")
        return columns
