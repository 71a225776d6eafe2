"""What an encoder can do wrong: its indication differs from the angle that the joint has.

``δ`` is always joint angle minus indication [rad], as a function of the indication θ: what must be added.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, UnknownNameError

SAMPLES = 4096
"""Points of a curve of which its spectrum is taken."""
MOST_COEFFICIENTS = 1000
"""More of them than any joint has records for."""


@dataclass(frozen=True)
class _Periodic(Effect):
    """``δ = A cos(kθ - φ)``, linear in ``A cos φ`` and ``A sin φ``; files and people say amplitude A and phase φ."""

    joint: int

    @property
    def turns(self) -> float:
        """Order k: periods per turn."""
        raise NotImplementedError

    @property
    def terms(self) -> tuple[Term, ...]:
        """Cosine and sine part."""
        return (Term("cos", "rad", 1e-4, "cos_rad"), Term("sin", "rad", 1e-4, "sin_rad"))

    @property
    def amplitude(self) -> float:
        """A [rad]."""
        return float(np.hypot(self.values[0], self.values[1]))

    @property
    def phase(self) -> float:
        """φ: kθ at which δ is largest [rad]."""
        return float(np.arctan2(self.values[1], self.values[0]))

    def displacements(self, state: State) -> list[Displacement]:
        """``cos kθ`` and ``sin kθ`` about the axis."""
        angle = self.turns * state.angle(self.joint)
        return [about_axis(state, self.joint, np.stack([np.cos(angle), np.sin(angle)], axis=1))]

    def described(self) -> dict[str, float]:
        """Amplitude and phase."""
        return {"amplitude_rad": self.amplitude, "phase_rad": self.phase}

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

    @property
    def turns(self) -> float:
        """Once per turn."""
        return 1.0

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

    @property
    def turns(self) -> float:
        """Twice per turn."""
        return 2.0


@dataclass(frozen=True)
class JointPeriodicError(_Periodic):
    """Any other order: a gear, a subdivision of the scale: ``δ = A cos(kθ - φ)``, k need not be whole (gears).

    Unit rad; typical 1e-5 to 1e-4. Source: as ``encoder_ellipticity``. Needs no column. Confused with: orders so near that
    the covered range of the joint cannot tell them; beyond the sampling of the records, with its alias.
    """

    joint: int
    order: float
    cause: ClassVar[str] = "joint_periodic_error"

    def __post_init__(self) -> None:
        """Check the order."""
        super().__post_init__()
        if not (np.isfinite(self.order) and self.order > 0):
            raise AacmmError(f"{self.label}: order is {self.order}, expected a number of periods per turn above zero")

    def inner_widths(self) -> dict[str, float]:
        """The order; no record says that it is whole."""
        return {"order": 0.5}

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

    def __post_init__(self) -> None:
        """Check the range."""
        if not (-np.inf < self.lower_rad < self.upper_rad < np.inf and 4 <= self.coefficients <= MOST_COEFFICIENTS):
            raise AacmmError(
                f"{self.label}: expected lower_rad < upper_rad and 4 to {MOST_COEFFICIENTS} coefficients, "
                f"not {self.lower_rad}, {self.upper_rad}, {self.coefficients}"
            )
        super().__post_init__()

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

    def known(self, state: State) -> NDArray[np.bool_]:
        """(n,) True where the indication is in the curve's range."""
        angle = state.angle(self.joint)
        return np.asarray((angle >= self.lower_rad) & (angle <= self.upper_rad))

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
class EncoderGain(Effect):
    """A turn of the joint is not a turn of the indication: ``δ = g θ``.

    A closed disc cannot have it; a belt, a gear or an interpolator can, and a wound cable looks like it. Unit 1 (rad/rad);
    typical 2e-5 to 4e-4. Needs no column. Confused with: slow harmonics where the joint covers part of a turn.
    """

    joint: int
    cause: ClassVar[str] = "encoder_gain"

    @property
    def terms(self) -> tuple[Term, ...]:
        """The gain."""
        return (Term("", "1", 1e-4, "gain"),)

    def displacements(self, state: State) -> list[Displacement]:
        """The indication itself."""
        return [about_axis(state, self.joint, state.angle(self.joint)[:, None])]


@dataclass(frozen=True)
class EncoderSlip(Effect):
    """The disc or coupling slips once: ``δ`` from ``time_s`` on, zero before.

    Unit rad; typical 5e-5 to 5e-4. Needs ``time_s``. Confused with: ``zero_drift`` where few records are near the slip, a
    moved reference (which shifts all directions, not one joint's), a session boundary.
    """

    joint: int
    time_s: float
    cause: ClassVar[str] = "encoder_slip"
    needs: ClassVar[tuple[str, ...]] = ("time",)

    def __post_init__(self) -> None:
        """Check the time."""
        super().__post_init__()
        if not np.isfinite(self.time_s):
            raise AacmmError(f"{self.label}: time_s is {self.time_s}, expected seconds")

    @property
    def terms(self) -> tuple[Term, ...]:
        """The step."""
        return (Term("", "rad", 2e-4, "step_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """One from the time on."""
        time = state.conditions.require("time", self.label)
        return [about_axis(state, self.joint, (time >= self.time_s).astype(np.float64)[:, None])]
