"""What is uncertain of a cause beside its values, as effects of value zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin.effects.effect import Displacement, Effect, Term
from aacmm_pin.effects.state import State

OF_VALUE = 1e-4
"""Step of the derivative by a field, as a part of its value."""


def extrapolation_terms(effect: Effect) -> tuple[Effect, ...]:
    """Effects of value zero whose u is what is uncertain of an effect beside its values."""
    nonlinear = effect.nonlinear
    terms = nonlinear.extrapolation_terms(effect)
    if effect.nonlinear_u and nonlinear.prior_sd(effect):
        return (*terms, NonlinearSensitivity(of=effect, u=(effect.nonlinear_u,)))
    return terms


@dataclass(frozen=True, eq=False, kw_only=True)
class NonlinearSensitivity(Effect):
    """How far the field of a cause may be from its value, such as the time constant of a drift.

    Attributes:
        of: the cause.
    """

    cause: ClassVar[str] = "nonlinear_sensitivity"
    of: Effect

    @property
    def needs(self) -> tuple[str, ...]:
        """Those of the cause."""
        return self.of.needs

    @property
    def label(self) -> str:
        """That of the cause."""
        return self.of.label

    @property
    def key(self) -> str:
        """That of the cause."""
        return self.of.key

    @property
    def row(self) -> int | None:
        """That of the cause."""
        return self.of.row

    @property
    def terms(self) -> tuple[Term, ...]:
        """The field."""
        nonlinear = self.of.nonlinear
        name = nonlinear.field
        typical = nonlinear.value(self.of)
        return (Term(name, nonlinear.unit, typical, name),)

    def displacements(self, state: State) -> list[Displacement]:
        """The derivative by the field, at the values of the cause."""
        nonlinear = self.of.nonlinear
        values = np.array(self.of.values)
        value = nonlinear.value(self.of)
        step = OF_VALUE * value
        more = nonlinear.at(self.of, value + step).displacements(state)
        less = nonlinear.at(self.of, value - step).displacements(state)
        found = []
        for one, other in zip(more, less, strict=True):
            slope = (one.columns - other.columns) @ values / (2 * step)
            found.append(Displacement(one.place, slope[..., None]))
        return found
