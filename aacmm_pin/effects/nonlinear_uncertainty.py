"""Uncertainty of a cause that its values do not carry: its nonlinear parameter, and times without
records; as effects of value zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin.effects.effect import Displacement, Effect, Term
from aacmm_pin.effects.state import State

RELATIVE_STEP = 1e-4
"""Step of the derivative by a nonlinear parameter, over its value."""


def extra_uncertainty_effects(effect: Effect) -> tuple[Effect, ...]:
    """Return effects with value zero whose u describes the uncertainty of ``effect`` beyond the u
    of its values.
    """
    nonlinear = effect.nonlinear
    terms = nonlinear.extrapolation_terms(effect)
    if effect.nonlinear_u and nonlinear.prior_sd(effect):
        return (*terms, NonlinearSensitivity(base=effect, u=(effect.nonlinear_u,)))
    return terms


@dataclass(frozen=True, eq=False, kw_only=True)
class NonlinearSensitivity(Effect):
    """Deviation of the nonlinear parameter of a cause from its value, such as of the time constant
    of a drift.

    Attributes:
        base: the cause.
    """

    cause: ClassVar[str] = "nonlinear_sensitivity"
    base: Effect

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions that the cause needs."""
        return self.base.needs

    @property
    def label(self) -> str:
        """Label of the cause."""
        return self.base.label

    @property
    def key(self) -> str:
        """Key of the cause."""
        return self.base.key

    @property
    def row(self) -> int | None:
        """DH row of the cause."""
        return self.base.row

    @property
    def terms(self) -> tuple[Term, ...]:
        """The nonlinear parameter."""
        nonlinear = self.base.nonlinear
        name = nonlinear.field
        typical = nonlinear.value(self.base)
        return (Term(name, nonlinear.unit, typical, name),)

    def displacements(self, state: State) -> list[Displacement]:
        """Derivative by the nonlinear parameter, at the values of the cause."""
        nonlinear = self.base.nonlinear
        values = np.array(self.base.values)
        value = nonlinear.value(self.base)
        step = RELATIVE_STEP * value
        above = nonlinear.at(self.base, value + step).displacements(state)
        below = nonlinear.at(self.base, value - step).displacements(state)
        found = []
        for upper, lower in zip(above, below, strict=True):
            slope = (upper.columns - lower.columns) @ values / (2 * step)
            found.append(Displacement(upper.place, slope[..., None]))
        return found
