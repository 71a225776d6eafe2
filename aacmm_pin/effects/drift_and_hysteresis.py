"""What depends on when, and on how the joint came: warm-up and hysteresis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Records, Term, about_axis
from aacmm_pin.effects.state import State

WARM_UPS = (600.0, 1800.0, 5400.0)
"""Time constants of a warm-up that are tried [s]."""
FINE = 15
"""Steps in which a time constant is refined around the one that was tried."""


@dataclass(frozen=True)
class ZeroDrift(Effect):
    """The zero of one encoder wanders while it warms up: ``δ = A (1 - exp(-t/τ))``, t from switching on, 0 before.

    Unit rad; typical 5e-5 to 3e-4, τ a quarter to two hours. Source: first-order heating. Needs ``time_s``. Confused with:
    ``encoder_slip`` where τ is short, ``thermal_expansion`` where the room warms up alike.

    Records that it was found from may show hardly more than a slope. Where they end, at ``until_s``, it may then stop or go
    on as it was: its rate there is the standard uncertainty of its rate from then on.
    """

    joint: int
    time_constant_s: float
    until_s: float | None = None
    cause: ClassVar[str] = "zero_drift"
    words: ClassVar[str] = "drift of the zero"
    needs: ClassVar[tuple[str, ...]] = ("time",)
    inner: ClassVar[tuple[str, ...]] = ("time_constant_s",)
    least_inner: ClassVar[float] = 1e-3
    terms: ClassVar[tuple[Term, ...]] = (Term("", "rad", 2e-4, "drift_rad"),)

    @property
    def identity(self) -> tuple[object, ...]:
        """That of the joint and the time constant."""
        return (self.cause, self.joint, self.time_constant_s)

    def inner_in_words(self) -> list[str]:
        """The time constant."""
        return [f"time constant {self.time_constant_s / 60:.0f} min"]

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every joint, quick and slow, where time goes on."""
        time = np.arange(2) if records is None else records.conditions.time
        if time is not None and np.ptp(time) > 0.0:
            yield from (tuple(cls(row, constant) for constant in WARM_UPS) for row in arm.chain.moving_rows())

    def refined(self, records: Records) -> list[Self]:
        """From a third to three times as slow."""
        constants = self.time_constant_s * np.geomspace(1 / 3, 3, FINE)
        return [replace(self, time_constant_s=float(constant), until_s=None) for constant in constants]

    def told_between(self, low: float, high: float, records: Records) -> Self:
        """Until the last record, where that is before the time constant or records do not tell this from one without end."""
        end = float(records.conditions.times[-1])
        return self if low > 0.0 and self.time_constant_s < end else replace(self, until_s=end)

    def to_be_told(self, conditions: Conditions) -> list[str]:
        """That readings are later than what was seen of it."""
        time, until = conditions.require("time", self.label), self.until_s
        if until is None or not (later := int((time > until).sum())):
            return []
        return [
            f"{later} of {conditions.n} records are after {until:.4g} s, up to which {self.label} was seen, as little more "
            "than a slope: u has it that it may stop there or go on"
        ]

    @property
    def open_questions(self) -> tuple[Effect, ...]:
        """How fast it goes on after what was seen of it."""
        if self.until_s is None or not any(self.values):
            return ()
        rate = self.values[0] / self.time_constant_s * np.exp(-self.until_s / self.time_constant_s)
        return (_GoesOn(self.joint, self.time_constant_s, self.until_s, u=(float(abs(rate)),)),)

    @property
    def settling_time(self) -> float | None:
        """The time constant."""
        return self.time_constant_s

    def inner_widths(self) -> dict[str, float]:
        """The time constant, known to a factor of three or so."""
        return {"time_constant_s": 2.0 * self.time_constant_s}

    def displacements(self, state: State) -> list[Displacement]:
        """How far the warm-up has come; nothing before 0."""
        time = np.maximum(state.conditions.require("time", self.label), 0.0)
        return [about_axis(state, self.joint, -np.expm1(-time / self.time_constant_s)[:, None])]


@dataclass(frozen=True)
class _GoesOn(ZeroDrift):
    """By how much faster or slower than thought a drift goes on after what was seen of it."""

    terms: ClassVar[tuple[Term, ...]] = (Term("later", "rad/s", 1e-7, "later_rad_per_s"),)

    def displacements(self, state: State) -> list[Displacement]:
        """The time since then."""
        later = state.conditions.require("time", self.label) - (self.until_s or 0.0)
        return [about_axis(state, self.joint, np.maximum(later, 0.0)[:, None])]


@dataclass(frozen=True)
class JointHysteresis(Effect):
    """Friction, a cable or a coupling holds the joint back on the side that it came from: ``δ = h s``, s = -1, 0, 1.

    Unit rad, half of the reversal error, of either sign, as the encoder sits before or behind what gives; typical 2e-5 to
    2e-4. Source: reversal value, ISO 230-2:2014. Needs ``approachN``.
    Confused with: hysteresis of neighbours that always move together.
    """

    joint: int
    cause: ClassVar[str] = "joint_hysteresis"
    words: ClassVar[str] = "hysteresis"
    needs: ClassVar[tuple[str, ...]] = ("approach",)
    terms: ClassVar[tuple[Term, ...]] = (Term("", "rad", 1e-4, "half_width_rad"),)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every joint that came from more than one side."""
        approach = np.stack([-np.ones(arm.nq), np.ones(arm.nq)]) if records is None else records.conditions.approach
        for number, row in enumerate(arm.chain.moving_rows()):
            if approach is not None and np.ptp(approach[:, number]) > 0:
                yield (cls(row),)

    def displacements(self, state: State) -> list[Displacement]:
        """The sign of the last motion."""
        approach = state.conditions.require("approach", self.label)
        return [about_axis(state, self.joint, approach[:, state.joint(self.joint), None])]
