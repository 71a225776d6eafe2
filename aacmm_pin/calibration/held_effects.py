"""Effects with many parameters, such as error curves, beside a fit that held them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.effects import Effect


@dataclass(frozen=True, eq=False)
class HeldEffects:
    """Effects beside a fit that held them.

    Attributes:
        effects: at their posterior means, with u.
        covariance: of all their parameters (q, q) [units].
        response: of the fit's estimates (p, q) [units].
    """

    effects: tuple[Effect, ...]
    covariance: Array
    response: Array

    @property
    def names(self) -> list[str]:
        """Of their parameters (q,)."""
        return [parameter.name for effect in self.effects for parameter in effect.parameters()]

    @property
    def added_covariance(self) -> Array:
        """Of the fit's estimates, by their uncertainty (p, p) [units]."""
        return self.response @ self.covariance @ self.response.T

    def of_effect(self, effect: Effect) -> Array:
        """Covariance of one (q, q) [units]."""
        ends = np.cumsum([len(held.terms) for held in self.effects])
        number = [held.label for held in self.effects].index(effect.label)
        entries = slice(ends[number] - len(effect.terms), ends[number])
        return self.covariance[entries, entries]
