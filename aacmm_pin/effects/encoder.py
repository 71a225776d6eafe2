"""What an encoder can do wrong: its indication differs from the angle that the joint has.

``δ`` is always joint angle minus indication [rad], as a function of the indication θ: what must be added.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import LARGEST_ANGLE, LATEST
from aacmm_pin._support.units import DEG
from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Reading, Records, Term, about_axis
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, UnknownNameError

SAMPLES = 4096
"""Points of a curve of which its spectrum is taken."""
MOST_COEFFICIENTS = 1000
"""More of them than any joint has records for."""
LEAST_SPREAD = 0.02
"""A joint that moves less than this cannot show anything that depends on its angle [rad], or its way [m]."""
ORDERS = (0.5, 1.5, 2.5, *(k / 2 for k in range(6, 21)), *(float(k) for k in range(11, 33)))
"""Orders of a periodic error that are tried before the order is refined."""
FINE = 15
"""Steps in half an order in which an order is refined around the one that was tried."""
SLIPS = 40
"""Times of a slip that are tried, in quantiles of the records' times, besides the middle of every pause."""
AT_ENDS = 3
"""Fewer records before or behind a slip than this are not asked whether it was there: they may be gross errors."""
NEAR = 60
"""Gaps between records around a time of a slip to which it is refined."""
PAUSE = 5.0
"""A pause is so many times longer than the median time between records."""
WHOLE = 0.03
"""An order that is found to be whole may be off by this. Where records tell it to 0.07, the phase of one that is whole has
a rms error of 0.7 u with this, and of 1.9 u where it is 7.08; with 0.5 the first is 0.4 u."""
CURVES = (24, 60)
"""Numbers of coefficients per turn of a free curve that are tried, before they are doubled where that is better."""
PER_COEFFICIENT = 2
"""So many records for each coefficient of a curve, at least."""


@dataclass(frozen=True)
class _OfAngle(Effect):
    """A function of the angle of one joint; a free curve can be it too."""

    joint: int
    contained_in: ClassVar[tuple[str, ...]] = ("joint_error_curve",)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every joint that turns, by enough to show it."""
        yield from ((cls(row),) for row, _ in _turning(arm, records))


def _moving(arm: Arm, records: Records | None) -> Iterator[tuple[int, Array]]:
    """Rows whose joints move by enough in the records, and the angles (n,); one whole turn without records."""
    for number, row in enumerate(arm.chain.moving_rows()):
        angle = np.array([-np.pi, np.pi]) if records is None else records.q[:, number]
        if np.ptp(angle) >= LEAST_SPREAD:
            yield row, angle


def _turning(arm: Arm, records: Records | None) -> Iterator[tuple[int, Array]]:
    """Those that turn."""
    slides = dict(zip(arm.chain.moving_rows(), arm.chain.prismatic, strict=True))
    yield from ((row, angle) for row, angle in _moving(arm, records) if not slides[row])


@dataclass(frozen=True)
class _Periodic(_OfAngle):
    """``δ = A cos(kθ - φ)``, linear in ``A cos φ`` and ``A sin φ``; files and people say amplitude A and phase φ."""

    @property
    def turns(self) -> float:
        """Order k: periods per turn."""
        raise NotImplementedError

    terms: ClassVar[tuple[Term, ...]] = (Term("cos", "rad", 1e-4, "cos_rad"), Term("sin", "rad", 1e-4, "sin_rad"))

    @property
    def amplitude(self) -> float:
        """A [rad]."""
        return float(np.hypot(self.values[0], self.values[1]))

    @property
    def phase(self) -> float:
        """φ: kθ at which δ is largest [rad]."""
        return float(np.arctan2(self.values[1], self.values[0]))

    @property
    def magnitude_alone(self) -> bool:
        """With a phase of exactly zero: it was not stated."""
        return self.phase == 0.0

    def displacements(self, state: State) -> list[Displacement]:
        """``cos kθ`` and ``sin kθ`` about the axis."""
        angle = self.turns * state.angle(self.joint)
        return [about_axis(state, self.joint, np.stack([np.cos(angle), np.sin(angle)], axis=1))]

    def described(self) -> dict[str, float]:
        """Amplitude and phase."""
        return {"amplitude_rad": self.amplitude, "phase_rad": self.phase}

    def readings(self) -> dict[str, Reading]:
        """Amplitude and phase."""
        return {"amplitude_rad": Reading("amplitude", "µrad", 1e6), "phase_rad": Reading("phase", "°", 1.0 / DEG)}

    def described_jacobian(self) -> Array:
        """∂(A, φ)/∂(A cos φ, A sin φ); of no meaning at A = 0, where there is no phase."""
        c, s = np.cos(self.phase), np.sin(self.phase)
        return np.array([[c, s], [-s, c] / np.maximum(self.amplitude, 1e-300)])

    def values_from(self, parameters: Mapping[str, float]) -> tuple[float, ...]:
        """From amplitude and phase, or from the linear parts."""
        if set(parameters) <= {"cos_rad", "sin_rad"}:
            return super().values_from(parameters)
        for key in parameters:
            if key not in ("amplitude_rad", "phase_rad"):
                raise UnknownNameError(f"parameter of {self.label}", key, ["amplitude_rad", "phase_rad"])
        amplitude, phase = parameters.get("amplitude_rad", 0.0), parameters.get("phase_rad", 0.0)
        if abs(phase) > LARGEST_ANGLE:
            raise AacmmError(f"{self.label}: phase_rad is {phase:g}, expected at most {LARGEST_ANGLE:g}")
        return (amplitude * np.cos(phase), amplitude * np.sin(phase))


@dataclass(frozen=True)
class EncoderEccentricity(_Periodic):
    """The disc turns about a point that is not its centre, with one reading head: ``δ = arcsin(A cos(θ - φ))``.

    A is the eccentricity over the radius of the track. Derivation: in the triangle of axis, disc centre and head the law
    of sines gives ``sin δ = A cos(θ - φ)`` exactly, θ the indication. Two opposite heads cancel it. Unit rad; typical
    2e-5 to 3e-4. Needs no column. Confused with: ``joint_compliance`` and ``counterbalance`` of a joint that tilts against
    gravity, ``encoder_ellipticity`` and ``encoder_gain`` where the joint covers part of a turn.
    """

    cause: ClassVar[str] = "encoder_eccentricity"
    turns: ClassVar[float] = 1.0

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """The arcsine.

        Raises:
            AacmmError: an eccentricity as large as the disc.
        """
        if self.amplitude >= 1.0:
            raise AacmmError(f"{self.label}: amplitude is {self.amplitude:g}, expected less than 1, the radius of the disc")
        return [(place, np.arcsin(linear)) for place, linear in super().exact(state)]


@dataclass(frozen=True)
class EncoderEllipticity(_Periodic):
    """Twice per turn: an oval disc, or what two opposite heads leave of an eccentricity: ``δ = A cos(2θ - φ)``.

    Unit rad; typical 1e-5 to 2e-4. Source: harmonic analysis of circle divisions (Watanabe et al. 2001, CIRP Annals 50).
    Needs no column. Confused with: the neighbouring orders where the joint covers part of a turn.
    """

    cause: ClassVar[str] = "encoder_ellipticity"
    words: ClassVar[str] = "encoder ellipticity (twice per turn)"
    turns: ClassVar[float] = 2.0


@dataclass(frozen=True)
class JointPeriodicError(_Periodic):
    """Any other order: a gear, a subdivision of the scale: ``δ = A cos(kθ - φ)``, k need not be whole (gears).

    Unit rad; typical 1e-5 to 1e-4. Source: as ``encoder_ellipticity``. Needs no column. Confused with: orders so near that
    the covered range of the joint cannot tell them; beyond the sampling of the records, with its alias.
    """

    order: float
    cause: ClassVar[str] = "joint_periodic_error"
    words: ClassVar[str] = "periodic error"
    inner: ClassVar[tuple[str, ...]] = ("order",)

    def inner_in_words(self) -> list[str]:
        """The order."""
        return [f"{self.order:.4g} periods per turn"]

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Orders at every joint; what makes less than one period over the covered range is a gain or an offset."""
        for row, angle in _turning(arm, records):
            if orders := [order for order in ORDERS if order * np.ptp(angle) / (2 * np.pi) >= 1.0]:
                yield tuple(cls(row, order) for order in orders)

    def refined(self, records: Records) -> list[Self]:
        """Orders up to half a period per turn away, and the nearest whole one."""
        steps = self.order + np.linspace(-0.5, 0.5, 2 * FINE + 1)
        orders = {round(float(order), 4) for order in (*steps, round(self.order)) if order > 0.3}
        return [replace(self, order=order) for order in sorted(orders)]

    @property
    def exceptional(self) -> bool:
        """A whole number of periods per turn is what teeth and gratings have."""
        return self.order == round(self.order)

    @property
    def period(self) -> float | None:
        """Waves of a higher order than the third are shown over one period; over a whole turn they would be a band."""
        return 2 * np.pi / self.order if self.order > 3.0 else None

    def inner_widths(self) -> dict[str, float]:
        """The order: half a period to either side, or next to nothing where it is whole, as those of machines are."""
        return {"order": WHOLE if self.exceptional else 0.5}

    @property
    def turns(self) -> float:
        """The order."""
        return self.order


@dataclass(frozen=True)
class JointErrorCurve(Effect):
    """Any repeatable function of one joint's angle: a cubic spline with uniform knots from ``lower_rad`` to ``upper_rad``.

    ``δ(θ) = Σ c_i B_i(θ)`` with cubic B-splines (de Boor 1978). Unit rad; typical 1e-5 to 3e-4. Needs no column. Confused
    with: everything else at that joint that depends on its angle alone; gravity where only this joint moves the load.
    """

    joint: int
    lower_rad: float
    upper_rad: float
    coefficients: int
    cause: ClassVar[str] = "joint_error_curve"
    words: ClassVar[str] = "error curve"
    usual: ClassVar[float] = 0.3
    bins: ClassVar[int] = 72

    def __post_init__(self) -> None:
        """Check the range."""
        in_order = -LARGEST_ANGLE <= self.lower_rad < self.upper_rad <= LARGEST_ANGLE
        if not (in_order and 4 <= self.coefficients <= MOST_COEFFICIENTS):
            raise AacmmError(
                f"{self.label}: expected lower_rad < upper_rad and 4 to {MOST_COEFFICIENTS} coefficients, "
                f"not {self.lower_rad}, {self.upper_rad}, {self.coefficients}"
            )
        super().__post_init__()

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Over the range that the records cover, with coarser and finer knots."""
        for row, angle in _turning(arm, records) if records is not None else ():
            margin = 1e-6 + 1e-3 * np.ptp(angle)
            low, high = float(angle.min() - margin), float(angle.max() + margin)
            counts = sorted({int(np.clip(round(per_turn * np.ptp(angle) / (2 * np.pi)), 8, 120)) for per_turn in CURVES})
            if curves := tuple(cls(row, low, high, count) for count in counts if PER_COEFFICIENT * count <= len(angle)):
                yield curves

    def refined(self, records: Records) -> list[Self]:
        """With twice as many knots, if there are records enough."""
        counts = [self.coefficients, 2 * self.coefficients]
        return [replace(self, values=(), u=(), coefficients=c) for c in counts if PER_COEFFICIENT * c <= len(records.q)]

    def special_cases(self) -> list[JointPeriodicError]:
        """A single wave, of orders a quarter of a period over the range apart, as far as the knots follow it."""
        turns = (self.upper_rad - self.lower_rad) / (2 * np.pi)
        return [JointPeriodicError(self.joint, quarters / (4 * turns)) for quarters in range(4, 2 * self.coefficients)]

    @classmethod
    def completed(cls, structure: Mapping[str, Any], arm: Arm, present: tuple[str, ...]) -> dict[str, Any]:
        """Over the range of the joint, where none is typed."""
        from aacmm_pin.arm.random_postures import joint_bounds

        rows = arm.chain.moving_rows()
        low, high = joint_bounds(arm)[rows.index(structure["joint"])] if structure.get("joint") in rows else (-np.pi, np.pi)
        return {"lower_rad": float(low) - 0.01, "upper_rad": float(high) + 0.01, "coefficients": CURVES[0]} | dict(structure)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The coefficients."""
        return tuple(Term(f"c{i}", "rad", 1e-4, f"c{i}_rad") for i in range(1, self.coefficients + 1))

    def displacements(self, state: State) -> list[Displacement]:
        """The B-splines at the indications.

        Raises:
            AacmmError: an indication is outside the range on which the curve is known.
        """
        angle, outside = state.angle(self.joint), ~self.known(state)
        if outside.any():
            raise AacmmError(
                f"{self.label}: {outside.sum()} of {state.n} records are outside the curve's range, "
                f"{self.lower_rad:g} to {self.upper_rad:g} rad; the first is at {angle[outside][0]:g} rad"
            )
        if not state.n:  # SciPy wants at least one point
            return [about_axis(state, self.joint, np.zeros((0, self.coefficients)))]
        return [about_axis(state, self.joint, scipy.interpolate.BSpline.design_matrix(angle, self._knots, 3).toarray())]

    @property
    def known_range(self) -> tuple[float, float]:
        """The curve's range."""
        return self.lower_rad, self.upper_rad

    @property
    def _knots(self) -> Array:
        inner = np.linspace(self.lower_rad, self.upper_rad, self.coefficients - 2)
        return np.concatenate([np.full(3, self.lower_rad), inner, np.full(3, self.upper_rad)])

    def spectrum(self, peaks: int = 6) -> list[tuple[float, float]]:
        """Orders [per turn] and amplitudes [rad] of the strongest waves in the curve, strongest first.

        Peaks of the periodogram over the covered range (Hann window): waves closer than two periods over that range are
        one peak, and what makes less than one period is not told.
        """
        angle = np.linspace(self.lower_rad, self.upper_rad, SAMPLES)
        turns = (self.upper_rad - self.lower_rad) / (2 * np.pi)
        curve = scipy.interpolate.BSpline(self._knots, np.array(self.values), 3)(angle)
        order, power = scipy.signal.periodogram(
            curve, SAMPLES / turns, "hann", nfft=8 * SAMPLES, detrend="linear", scaling="spectrum"
        )
        tops = [k for k in scipy.signal.find_peaks(power, height=1e-2 * power.max())[0] if order[k] * turns >= 1.0]
        strongest = sorted(tops, key=lambda k: -power[k])[:peaks]
        return [(float(order[k]), float(np.sqrt(2 * power[k]))) for k in strongest]


@dataclass(frozen=True)
class EncoderGain(_OfAngle):
    """A turn of the joint is not a turn of the indication: ``δ = g θ``.

    A closed disc cannot have it; a belt, a gear or an interpolator can, and a wound cable looks like it. Of a joint that
    slides, the error of its scale. Unit 1 (rad/rad, m/m); typical 2e-5 to 4e-4. Needs no column. Confused with: slow
    harmonics where the joint covers part of a turn.
    """

    cause: ClassVar[str] = "encoder_gain"
    terms: ClassVar[tuple[Term, ...]] = (Term("", "1", 1e-4, "gain"),)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every joint that moves by enough to show it."""
        yield from ((cls(row),) for row, _ in _moving(arm, records))

    def displacements(self, state: State) -> list[Displacement]:
        """The indication itself."""
        return [about_axis(state, self.joint, state.angle(self.joint)[:, None])]


@dataclass(frozen=True)
class EncoderSlip(Effect):
    """The disc or coupling slips once: ``δ`` from ``time_s`` on, zero before.

    Unit rad; typical 5e-5 to 5e-4. Needs ``time_s``. Confused with: ``zero_drift`` where few records are near the slip, a
    moved reference (which shifts all directions, not one joint's), a session boundary.

    Between the two times ``between_s`` nobody knows whether it has slipped yet: half of ``δ`` is taken there, and ``δ/2`` is
    the standard uncertainty of that (JCGM 100:2008, 4.3: two values, equally probable). The times are by the clock of the
    ``sessions``; records of another, which is a later one, have all of ``δ``.
    """

    joint: int
    time_s: float
    between_s: tuple[float, ...] = ()
    sessions: tuple[str, ...] = ()
    cause: ClassVar[str] = "encoder_slip"
    needs: ClassVar[tuple[str, ...]] = ("time",)
    inner: ClassVar[tuple[str, ...]] = ("time_s",)
    least_inner: ClassVar[float] = -LATEST
    terms: ClassVar[tuple[Term, ...]] = (Term("", "rad", 2e-4, "step_rad"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        gap = self.between_s
        if gap and not (len(gap) == 2 and gap[0] <= self.time_s <= gap[1]):
            raise AacmmError(f"{self.label}: between_s is {gap}, expected two times, time_s, {self.time_s:g}, between them")

    @property
    def identity(self) -> tuple[object, ...]:
        """That of the joint and the time."""
        return (self.cause, self.joint, self.time_s)

    def inner_in_words(self) -> list[str]:
        """The time."""
        return [f"at {self.time_s / 60:.1f} min"]

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Times between records, and in every pause, when arms are handled."""
        taken = np.zeros(0) if records is None else records.conditions.times
        if taken.size < 2:
            return
        between, gaps = (taken[1:] + taken[:-1]) / 2, np.diff(taken)
        pauses = between[gaps > PAUSE * np.median(gaps)][:SLIPS]
        first = min(AT_ENDS, (len(between) + 1) // 2) - 1
        spread = between[np.unique(np.linspace(first, len(between) - 1 - first, SLIPS).astype(int))]
        times = np.union1d(spread, pauses)
        yield from (tuple(cls(row, float(t)) for t in times) for row in arm.chain.moving_rows())

    def refined(self, records: Records) -> list[Self]:
        """Every gap between records near it."""
        times = records.conditions.times
        between = np.array([*times[:1], *(times[1:] + times[:-1]) / 2])
        first = max(int(np.searchsorted(between, self.time_s)) - NEAR // 2, 0)  # by their number: a pause is far in time
        return [replace(self, time_s=float(t), between_s=(), sessions=()) for t in between[first : first + NEAR]]

    def told_between(self, low: float, high: float, records: Records) -> Self:
        """From the last record that is surely before it to the first that is surely behind it."""
        times, labels = records.conditions.times, records.conditions.session
        low, high = min(low, self.time_s), max(high, self.time_s)  # other causes may have moved the likeliest gap since
        before, behind = times[times < low].max(initial=-LATEST), times[times > high].min(initial=LATEST)
        sessions = ("",) if labels is None else tuple(sorted({*labels.tolist()}))
        return replace(self, between_s=(float(before), float(behind)), sessions=sessions)

    def share(self, records: Records) -> float:
        """Half by the records, as when it is knocked in use, half by the time of the gap, as when it is carried around."""
        times = records.conditions.times
        if times.size < 2:  # of one that is known
            return 1.0
        return 1.0 / min(times.size - 1, SLIPS) + self.step_width(records) / float(np.ptp(times))

    def step_width(self, records: Records) -> float:
        """Width of the gap between two times of records in which it is [s]."""
        times = records.conditions.times
        behind = int(np.searchsorted(times, self.time_s))
        return float(times[behind] - times[behind - 1]) if 0 < behind < times.size else 0.0

    def to_be_told(self, conditions: Conditions) -> list[str]:
        """That records are before it, by a clock that may be another; and that some count as later by their session."""
        found = []
        if self.sessions and (before := int((self.part(conditions) == 0.0).sum())):
            found.append(
                f"{before} of {conditions.n} records are before {self.label} by the clock of the session in which it "
                f"slipped ({self.time_s:.4g} s); a later session needs a label of its own in the column session"
            )
        if (later := self._of_later_session(conditions)).any():
            own = ", ".join(map(repr, dict.fromkeys(conditions.require("session", self.label)[later])))
            found.append(f"{later.sum()} of {conditions.n} records are later than {self.label} by their session, {own}")
        return found

    @property
    def open_questions(self) -> tuple[Effect, ...]:
        """Whether a reading between the two times is of before or after."""
        if not (self.between_s and any(self.values)):
            return ()
        fields = (self.joint, self.time_s, self.between_s, self.sessions)
        return (_SlippedYet(*fields, u=(abs(self.values[0]) / 2.0,)),)

    def part(self, conditions: Conditions) -> Array:
        """(n,) 0 before it, 1 after it, a half where nobody knows."""
        later = self._of_later_session(conditions)
        if conditions.n and later.all():
            return np.ones(conditions.n)
        or_else = " (or, in a later session, a label of its own in the column session)" if self.sessions else ""
        time, (low, high) = conditions.require("time", self.label + or_else), self.between_s or (self.time_s, self.time_s)
        return np.where(later | (time >= high), 1.0, np.where((low < time) & (time < high), 0.5, time >= self.time_s))

    def _of_later_session(self, conditions: Conditions) -> NDArray[np.bool_]:
        """(n,) True where the label of the session is none of its own; a record without a label goes by the clock."""
        labels = conditions.session if self.sessions else None
        if labels is None:
            return np.zeros(conditions.n, dtype=bool)
        return np.asarray((labels != "") & ~np.isin(labels.astype(str), self.sessions))

    def displacements(self, state: State) -> list[Displacement]:
        """One from the time on; a half where it is not known."""
        return [about_axis(state, self.joint, self.part(state.conditions)[:, None])]


@dataclass(frozen=True)
class _SlippedYet(EncoderSlip):
    """What is missing of a slip, or too much, between the two times."""

    terms: ClassVar[tuple[Term, ...]] = (Term("in_gap", "rad", 2e-4, "in_gap_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """One between the two times."""
        return [about_axis(state, self.joint, (self.part(state.conditions) == 0.5).astype(np.float64)[:, None])]
