"""The nonlinear parameter of a cause, such as an order, a time constant, or the time of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from aacmm_pin.effects.conditions import Records

if TYPE_CHECKING:
    from aacmm_pin.effects.effect import Effect

E = TypeVar("E", bound="Effect")

WARM_UP_TIMES = (600.0, 1800.0, 5400.0)
"""Time constants of a warm-up that are tried [s]."""
TIME_CONSTANTS = 15
"""Time constants that are tried around one that was found."""


@dataclass(frozen=True)
class Nonlinear(Generic[E]):
    """The nonlinear parameter of a cause, whose value records determine by trial; none if ``field``
    is "".

    A search tries the values of :meth:`grid`, and refines the likeliest by :meth:`refine`.

    Attributes:
        field: field of the effect that holds the parameter; "" for a cause that is linear in all
            that is estimated of it.
        unit: SI unit of the value.
        above: what is not above this is no value.
        words: the value for people, with ``value``, and ``minutes`` of a time; "" for the name of
            the field and the value.
    """

    field: str = ""
    unit: str = "1"
    above: float = 0.0
    words: str = ""

    def value(self, effect: E) -> float:
        """The value that an effect has."""
        return float(getattr(effect, self.field))

    def at(self, effect: E, value: float) -> E:
        """The effect with another value."""
        field: dict[str, Any] = {self.field: value}
        return replace(effect, **field)

    def in_words(self, effect: E) -> str:
        """The value for people."""
        value = self.value(effect)
        if not self.words:
            return f"{self.field.replace('_', ' ')} {value:.4g}"
        return self.words.format(value=value, minutes=value / 60.0)

    def grid(self, records: Records | None) -> Sequence[float]:
        """Values to try; here none, and a class states them in its ``candidates``."""
        return ()

    def refine(self, effect: E, records: Records) -> list[E]:
        """The effect with values near its own, in their order; here itself."""
        return [effect]

    def special_cases(self, effect: E) -> Sequence[Effect]:
        """Causes with fewer parameters that it may be, to be tried in its place; here none."""
        return ()

    def prior_sd(self, effect: E) -> float:
        """How far off the value may be before records tell; 0 where the cause is not smooth
        in it.
        """
        return 0.0

    def prior_probability(self, effect: E, records: Records) -> float:
        """Probability of the value beside others that are tried, up to a factor; here all alike."""
        return 1.0

    def is_preferred(self, effect: E) -> bool:
        """Whether machines are made with this value, so that it is likelier than those near it."""
        return False

    def gap(self, effect: E, records: Records) -> float:
        """Distance of the two records between which the cause steps; 0 where it does not step."""
        return 0.0

    def with_coverage_interval(self, effect: E, low: float, high: float, records: Records) -> E:
        """The effect, whose value ``records`` determine from ``low`` to ``high`` (95 %)."""
        return effect

    def extrapolation_terms(self, effect: E) -> tuple[Effect, ...]:
        """Effects of value zero whose u is what is uncertain where no record was; here none."""
        return ()


@dataclass(frozen=True)
class TimeConstant(Nonlinear[E]):
    """Time from switching on over which a cause comes to rest [s]."""

    unit: str = "s"
    above: float = 1e-3
    words: str = "time constant {minutes:.0f} min"

    def grid(self, records: Records | None) -> Sequence[float]:
        """Quick and slow, where time goes on."""
        time = np.arange(2) if records is None else records.conditions.time
        return WARM_UP_TIMES if time is not None and np.ptp(time) > 0.0 else ()

    def refine(self, effect: E, records: Records) -> list[E]:
        """From a third to three times as slow."""
        constants = self.value(effect) * np.geomspace(1 / 3, 3, TIME_CONSTANTS)
        return [self.at(effect, constant) for constant in constants.tolist()]

    def prior_sd(self, effect: E) -> float:
        """It is known to a factor of three or so."""
        return 2.0 * self.value(effect)
