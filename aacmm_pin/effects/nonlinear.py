"""The nonlinear parameter of a cause: an order, a time constant, the time of a step."""

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
"""Time constants of a warm-up to try [s]."""
TIME_CONSTANTS = 15
"""Time constants to refine a found one."""
KNOWN_TO = 3.0
"""A time constant is known beforehand to a factor of about this."""


@dataclass(frozen=True)
class Nonlinear(Generic[E]):
    """The nonlinear parameter of a cause, whose value the records determine by trial.

    A search tries the values of :meth:`grid`, and refines the most probable with :meth:`refine`.
    All methods have defaults for a cause without nonlinear parameter.

    Attributes:
        field: field of the effect with the parameter; "" for none.
        above: valid values are above this number.
        words: format of the value in outputs, with ``value``, and ``minutes`` for a time; "" for
            the name of the field and the value.
    """

    field: str = ""
    unit: str = "1"
    above: float = 0.0
    words: str = ""

    def value(self, effect: E) -> float:
        """The value of an effect."""
        return float(getattr(effect, self.field))

    def at(self, effect: E, value: float) -> E:
        """The effect with another value."""
        field: dict[str, Any] = {self.field: value}
        return replace(effect, **field)

    def in_words(self, effect: E) -> str:
        """The value as text."""
        value = self.value(effect)
        if not self.words:
            return f"{self.field.replace('_', ' ')} {value:.4g}"
        return self.words.format(value=value, minutes=value / 60.0)

    def grid(self, records: Records | None) -> Sequence[float]:
        """The values to try; default none, so that ``candidates`` must state them."""
        return ()

    def refine(self, effect: E, records: Records) -> list[E]:
        """The effect with values near its own, in ascending order; default itself."""
        return [effect]

    def prior_sd(self, effect: E) -> float:
        """The prior standard deviation of the value; 0 if the cause is not smooth in it."""
        return 0.0

    def prior_probability(self, effect: E, records: Records) -> float:
        """The prior probability of the value, up to a common factor."""
        return 1.0

    def is_preferred(self, effect: E) -> bool:
        """Whether the value is common in machines, and so more probable than its neighbours."""
        return False

    def gap(self, effect: E, records: Records) -> float:
        """The time between the two records around a step; 0 for no step."""
        return 0.0

    def with_coverage_interval(self, effect: E, low: float, high: float, records: Records) -> E:
        """The effect with the 95 % interval of its value; default unchanged."""
        return effect

    def extrapolation_terms(self, effect: E) -> tuple[Effect, ...]:
        """Effects with value zero whose u is the uncertainty outside the records."""
        return ()


@dataclass(frozen=True)
class TimeConstant(Nonlinear[E]):
    """The time constant of a warm-up after the arm is switched on [s]."""

    unit: str = "s"
    above: float = 1e-3
    words: str = "time constant {minutes:.0f} min"

    def grid(self, records: Records | None) -> Sequence[float]:
        """Short and long time constants, if the records have different times."""
        time = np.arange(2) if records is None else records.conditions.time
        return WARM_UP_TIMES if time is not None and np.ptp(time) > 0.0 else ()

    def refine(self, effect: E, records: Records) -> list[E]:
        """The effect with time constants from a third to three times its own."""
        constants = self.value(effect) * np.geomspace(1 / KNOWN_TO, KNOWN_TO, TIME_CONSTANTS)
        return [self.at(effect, constant) for constant in constants.tolist()]

    def prior_sd(self, effect: E) -> float:
        """Twice the value, known beforehand to a factor of about three."""
        return 2.0 * self.value(effect)

    def prior_probability(self, effect: E, records: Records) -> float:
        """A log-normal probability, with a factor of three, outside usual time constants."""
        value = self.value(effect)
        usual = np.clip(value, WARM_UP_TIMES[0], WARM_UP_TIMES[-1])
        factors = np.log(value / usual) / np.log(KNOWN_TO)
        return float(np.exp(-0.5 * factors**2))
