"""Causes that depend on time: drifts and steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.display import Note
from aacmm_pin._support.plausible import LATEST
from aacmm_pin.arm import Parameter
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.effect import (
    Displacement,
    Effect,
    Nonlinear,
    Term,
    TimeConstant,
    UncertaintyOf,
    about_axis,
    encoder_displacements,
)
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

TIMES_OF_STEP = 40
"""Times of a step to try, in quantiles of the times, besides every long pause."""
AT_ENDS = 3
"""No step is tried with fewer records before or after it: they may be gross errors."""
GAPS_NEAR = 60
PAUSE_RATIO = 5.0
"""A pause is so many median intervals between records."""


@dataclass(frozen=True)
class _TimeOfDrift(TimeConstant["ZeroDrift"]):
    """The time constant of a drift, which records may show as little more than a slope."""

    def refine(self, effect: ZeroDrift, records: Records) -> list[ZeroDrift]:
        return super().refine(replace(effect, until_s=None), records)

    def with_coverage_interval(
        self, effect: ZeroDrift, low: float, high: float, records: Records
    ) -> ZeroDrift:
        """Known until the last record, unless the records show the end of the drift."""
        last = float(records.conditions.times[-1])
        if low > 0.0 and effect.time_constant_s < last:
            return effect
        return replace(effect, until_s=last)

    def extrapolation_terms(self, effect: ZeroDrift) -> tuple[Effect, ...]:
        if effect.until_s is None or not any(effect.values):
            return ()
        tau = effect.time_constant_s
        until = effect.until_s
        rate = float(abs(effect.values[0] / tau * np.exp(-until / tau)))
        return (_DriftExtrapolation(effect.joint, tau, until, u=(rate,)),)


@dataclass(frozen=True)
class ZeroDrift(Effect):
    """The zero of an encoder drifts while it warms up: ``δ = A (1 - exp(-t/τ))``, 0 before t = 0.

    t counts from switching on. Typical magnitude: 5e-5 to 3e-4 rad, with τ from a quarter of an
    hour to two hours. After ``until_s``, the time of the last record, the standard uncertainty of
    the rate is the rate at ``until_s``. Source: first-order heating. Needs ``time_s``. Aliases:
    ``encoder_slip``, if the time constant is short; ``thermal_expansion``, if the room warms up at
    the same rate.
    """

    joint: int
    time_constant_s: float
    until_s: float | None = None
    cause = "zero_drift"
    function_of = "time"
    of_fit = ("until_s",)
    words = "drift of the zero"
    needs = ("time",)
    nonlinear = _TimeOfDrift("time_constant_s")
    terms = (Term("", "rad", 2e-4, "drift_rad"),)

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """A note about records that are later than ``until_s``."""
        time = conditions.require("time", self.label)
        later = 0 if self.until_s is None else int((time > self.until_s).sum())
        data = {"records": later, "of": conditions.n, "cause": self.label, "until": self.until_s}
        return [Note("after_drift", data)] if later else []

    def displacements(self, state: State) -> list[Displacement]:
        """The completed part of the warm-up as a rotation."""
        time = np.maximum(state.conditions.require("time", self.label), 0.0)
        part = -np.expm1(-time / self.time_constant_s)
        return [about_axis(state, self.joint, part[:, None])]


@dataclass(frozen=True)
class _DriftExtrapolation(ZeroDrift):
    """Deviation of the rate of a drift after ``until_s``."""

    terms = (Term("later", "rad/s", 1e-7, "later_rad_per_s"),)

    def displacements(self, state: State) -> list[Displacement]:
        time = state.conditions.require("time", self.label)
        later = np.maximum(time - (self.until_s or 0.0), 0.0)
        return [about_axis(state, self.joint, later[:, None])]


def midpoints(times: Array) -> Array:
    """The middles of neighbouring times (n,) [s]: (n - 1,)."""
    return (times[1:] + times[:-1]) / 2


@dataclass(frozen=True)
class TimeOfStep(Nonlinear["StepInTime"]):
    """The time of a step, of which records determine the two before and after it."""

    unit: str = "s"
    above: float = -LATEST
    words: str = "at {minutes:.1f} min"
    tried: int = TIMES_OF_STEP

    def grid(self, records: Records | None) -> Sequence[float]:
        """Times between records, and in every pause, in which arms are handled."""
        times = np.zeros(0) if records is None else records.conditions.times
        if times.size < 2:
            return ()
        middles = midpoints(times)
        gaps = np.diff(times)
        pauses = middles[gaps > PAUSE_RATIO * np.median(gaps)][: self.tried]
        first = min(AT_ENDS, (len(middles) + 1) // 2) - 1
        chosen = np.linspace(first, len(middles) - 1 - first, self.tried).astype(int)
        times_to_try: list[float] = np.union1d(middles[np.unique(chosen)], pauses).tolist()
        return times_to_try

    def refine(self, effect: StepInTime, records: Records) -> list[StepInTime]:
        """Times in every gap between records nearby, counted in records."""
        times = records.conditions.times
        middles = np.concatenate([times[:1], midpoints(times)])
        number = int(np.searchsorted(middles, effect.when))
        first = max(number - GAPS_NEAR // 2, 0)
        near = middles[first : first + GAPS_NEAR]
        unknown_gap = replace(effect, between_s=(), sessions=())
        return [self.at(unknown_gap, time) for time in near.tolist()]

    def gap(self, effect: StepInTime, records: Records) -> float:
        """Width of the gap between two records in which the step is [s]."""
        times = records.conditions.times
        after = int(np.searchsorted(times, self.value(effect)))
        return float(times[after] - times[after - 1]) if 0 < after < times.size else 0.0

    def prior_probability(self, effect: StepInTime, records: Records) -> float:
        """Half by the records (knocked in use), half by the duration of the gap (moved in a
        pause).
        """
        times = records.conditions.times
        if times.size < 2:  # these records show no step
            return 1.0
        by_duration = self.gap(effect, records) / float(np.ptp(times))
        return 1.0 / min(times.size - 1, self.tried) + by_duration

    def with_coverage_interval(
        self, effect: StepInTime, low: float, high: float, records: Records
    ) -> StepInTime:
        """From the last record before the interval to the first after it."""
        times = records.conditions.times
        labels = records.conditions.session
        # Other causes may have moved the likeliest gap since.
        low = min(low, effect.when)
        high = max(high, effect.when)
        before = float(times[times < low].max(initial=-LATEST))
        after = float(times[times > high].min(initial=LATEST))
        sessions = ("",) if labels is None else tuple(sorted({*labels.tolist()}))
        return replace(effect, between_s=(before, after), sessions=sessions)

    def extrapolation_terms(self, effect: StepInTime) -> tuple[Effect, ...]:
        """Whether a reading between the two times is before or after the step."""
        if effect.of_reference or not (effect.between_s and any(effect.values)):
            return ()
        return (_InGap(base=effect, u=tuple(abs(value) / 2.0 for value in effect.values)),)


@dataclass(frozen=True, kw_only=True)
class StepInTime(Effect):
    """A cause that is zero before ``time_s``, and constant from then on.

    A subclass has the fields of its place and ``time_s``. The step is between the two times
    ``between_s``; there, half of the values act, with the other half as standard uncertainties
    (JCGM 100:2008, 4.3: two equally probable values). The times are by the clock of the
    ``sessions``. Records of other sessions count as later.
    """

    between_s: tuple[float, ...] = ()
    sessions: tuple[str, ...] = ()
    function_of = "time"
    of_fit = ("between_s", "sessions")
    needs: ClassVar[tuple[str, ...]] = ("time",)
    nonlinear = TimeOfStep("time_s")

    @property
    def when(self) -> float:
        """The time of the step [s]."""
        return self.nonlinear.value(self)

    def __post_init__(self) -> None:
        super().__post_init__()
        gap = self.between_s
        if gap and not (len(gap) == 2 and gap[0] <= self.when <= gap[1]):
            expected = f"expected two times around time_s ({self.when:g})"
            raise AacmmError(f"{self.label}: between_s is {gap}; {expected}")

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """Notes on records before the step, and of later sessions."""
        notes = []
        data = {"of": conditions.n, "cause": self.label}
        before = int(np.sum(self.part(conditions) == 0.0)) if self.sessions else 0
        if before:
            notes.append(Note("before_slip", {"records": before, **data, "time": self.when}))
        later = self._is_of_later_session(conditions)
        if later.any():
            sessions = [*dict.fromkeys(conditions.require("session", self.label)[later])]
            data |= {"records": int(later.sum()), "sessions": sessions}
            notes.append(Note("after_slip", data))
        return notes

    def part(self, conditions: Conditions) -> Array:
        """The part of the step in each record, ``(n,)``: 0 before, 1 after, 0.5 between the two
        times.
        """
        later = self._is_of_later_session(conditions)
        if conditions.n and later.all():
            return np.ones(conditions.n)
        alternative = " without the column `session`" if self.sessions else ""
        time = conditions.require("time", self.label + alternative)
        low, high = self.between_s or (self.when, self.when)
        is_between = (low < time) & (time < high)
        by_clock = np.where(is_between, 0.5, time >= self.when)
        return np.where(later | (time >= high), 1.0, by_clock)

    def _is_of_later_session(self, conditions: Conditions) -> Mask:
        """(n,) True for another label; without a label the clock counts."""
        labels = conditions.session if self.sessions else None
        if labels is None:
            return np.zeros(conditions.n, dtype=bool)
        return np.asarray((labels != "") & ~np.isin(labels.astype(str), self.sessions))


@dataclass(frozen=True, eq=False, kw_only=True)
class _InGap(UncertaintyOf):
    """Deviation from half of a step between the two times."""

    base: StepInTime

    @property
    def terms(self) -> tuple[Term, ...]:
        names = [f"in_gap_{term.name}".rstrip("_") for term in self.base.terms]
        pairs = zip(self.base.terms, names, strict=True)
        return tuple(replace(term, name=name) for term, name in pairs)

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(replace(p, kind=self.base.cause) for p in super().parameters())

    def displacements(self, state: State) -> list[Displacement]:
        """The whole step between the two times, where the model has half of it."""
        factors = 2.0 * (self.base.part(state.conditions) == 0.5)[:, None, None]
        steps = self.base.displacements(state)
        return [Displacement(step.place, step.columns * factors) for step in steps]


@dataclass(frozen=True)
class EncoderSlip(StepInTime):
    """The disc or coupling slips once: ``δ`` from ``time_s`` on, zero before.

    The slip is between the two times ``between_s``. Typical magnitude: 5e-5 to 5e-4 rad. Needs
    ``time_s``. Aliases: ``zero_drift``, if few records are near the slip; ``frame_shift`` for joint
    1, and ``stylus_shift`` for the last joints.
    """

    joint: int
    time_s: float
    cause = "encoder_slip"
    terms = (Term("", "rad", 2e-4, "step_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """The part of the slip in each record as an error of the reading."""
        part = self.part(state.conditions)
        return encoder_displacements(state, self.joint, part[:, None])
