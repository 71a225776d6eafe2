"""Errors of encoders.

``δ`` is joint angle minus reading [rad], as a function of the reading θ. With couplings, an error
of an encoder moves every joint whose angle contains its reading; causes named after a joint are
errors of its angle.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.plausible import LARGEST_ANGLE
from aacmm_pin._support.units import DEG
from aacmm_pin.arm import Arm
from aacmm_pin.effects.conditions import Records
from aacmm_pin.effects.effect import (
    Displacement,
    Effect,
    Nonlinear,
    Reading,
    Term,
    about_axis,
    encoder_displacements,
    is_row,
    require_names,
)
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

SAMPLES = 4096
"""For the spectrum of a curve."""
DEGREE = 3
MOST_CURVE_COEFFICIENTS = 1000
"""More than any joint has records for."""
LEAST_SPREAD = 0.02
"""A joint that moves less shows nothing that depends on its angle [rad] or position [m]."""
HIGHEST_ORDER = 50.0
"""[periods per turn]"""
ORDER_STEP = 0.1
"""Step of orders to try, in periods over the range: a wave in between loses 0.8 % of its mean
square.
"""
OWN_ORDERS = (1.0, 2.0)
"""Orders of eccentricity and ellipticity, which a periodic error would repeat …"""
OWN_WITHIN = 0.2
"""… also within this distance, in periods over the range."""
ORDERS_NEAR = 15
"""Steps in half an order to refine an order."""
LEAST_ORDER = 0.3
WHOLE_ORDER_SD = 0.03
"""Prior standard deviation of a whole order. If records determine it to 0.07, its phase has an RMS
error of 0.7 u (with 0.5: 0.4 u), and that of the order 7.08 1.9 u.
"""
INTERVALS_PER_TURN = 200
"""Intervals of the finest curve, four for each period of the highest order. With 100, two of five
simulated robots with up to 45 periods per turn were described too coarsely.
"""
COARSER = (8, 4, 2, 1)
"""Lengths of the intervals of the curves to try, in intervals of the finest."""
FEWEST_COEFFICIENTS = 8
"""A curve with fewer coefficients is too stiff."""
DEFAULT_COEFFICIENTS = 24
CURVE_MARGIN = 0.01
"""Of a curve beyond the limits of its joint [rad]."""
POINTS_PER_INTERVAL = 4
"""Angles in each interval to represent a function by splines."""
PER_COEFFICIENT = 2
"""Records for each coefficient of a curve, at least."""
MOST_WAVES = 6


@dataclass(frozen=True)
class OfAngle(Effect):
    """An error that is a function of the angle of one joint.

    A subclass states :meth:`function`, and ``of_reading`` if the reading of the encoder has the
    error. All such errors of a joint are forms of one place, where ``diagnose`` compares them.
    """

    joint: int
    function_of = "angle"
    of_reading: ClassVar[bool] = False
    """True if the reading of the encoder has the error, and not the joint."""
    of_slides: ClassVar[bool] = False
    """True if a prismatic joint can have the error too."""

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for every joint that moves far enough to show the cause."""
        for row, _ in _moving(arm, records, cls.of_slides):
            yield (cls(row),)

    @abstractmethod
    def function(self, angle: Array) -> Array:
        """The error per unit of each parameter, ``(n, p)``, at angles ``(n,)`` [rad]."""

    def displacements(self, state: State) -> list[Displacement]:
        """The error as a rotation about the axis of the joint."""
        if self.of_reading:
            errors = self.function(state.reading(self.joint))
            return encoder_displacements(state, self.joint, errors)
        return [about_axis(state, self.joint, self.function(state.angle(self.joint)))]

    def basis(self, arm: Arm, records: Records) -> Effect | None:
        """The finest error curve over the range of the joint; None for a reading that moves several
        joints.
        """
        rows = arm.chain.moving_rows()
        if self.joint not in rows:
            return None
        number = rows.index(self.joint)
        ratios = arm.chain.drive.matrix @ arm.coupling_matrix[:, number]
        of_this_joint_alone = np.array(arm.chain.joint_rows()) == self.joint
        if self.of_reading and not np.array_equal(ratios, of_this_joint_alone):
            return None
        low, high = _range_of(records.q[:, number])
        return JointErrorCurve(self.joint, low, high, _finest(low, high))

    def in_basis(self, basis: Effect) -> Array:
        """Coefficients of the basis ``(b, p)`` that represent the functions, by least squares."""
        assert isinstance(basis, JointErrorCurve)
        angle, inverse = _fitting(basis.lower_rad, basis.upper_rad, basis.coefficients)
        return inverse @ self.function(angle)


@cache
def _coefficients(count: int) -> tuple[Term, ...]:
    names = [f"c{i}" for i in range(1, count + 1)]
    return tuple(Term(name, "rad", 1e-4, f"{name}_rad") for name in names)


@cache
def _fitting(low: float, high: float, coefficients: int) -> tuple[Array, Array]:
    """Angles inside the range of a curve (m,) [rad], and pseudoinverse of its splines
    (coefficients, m).
    """
    count = POINTS_PER_INTERVAL * coefficients
    angle = np.linspace(low, high, count + 1)[:-1] + 0.5 * (high - low) / count
    curve = JointErrorCurve(1, low, high, coefficients)
    return angle, np.asarray(np.linalg.pinv(curve.function(angle)), np.float64)


def _range_of(angle: Array) -> tuple[float, float]:
    """The range of angles (n,), slightly extended [rad]."""
    margin = 1e-6 + 1e-3 * np.ptp(angle)
    return float(angle.min() - margin), float(angle.max() + margin)


def _finest(low: float, high: float) -> int:
    """Coefficients of the finest curve over a range, whose intervals can be joined by eight."""
    intervals = (high - low) / (2 * np.pi) * INTERVALS_PER_TURN
    eights = max(round(intervals / COARSER[0]), 1)
    return COARSER[0] * eights + DEGREE


def _moving(
    arm: Arm, records: Records | None, of_slides: bool = False
) -> Iterator[tuple[int, Array]]:
    """Rows whose joints move enough, and their angles (n,); one turn without records."""
    for number, row in enumerate(arm.chain.moving_rows()):
        angle = np.array([-np.pi, np.pi]) if records is None else records.q[:, number]
        rotates = not arm.chain.prismatic[number]
        if (rotates or of_slides) and np.ptp(angle) >= LEAST_SPREAD:
            yield row, angle


@dataclass(frozen=True)
class _Periodic(OfAngle):
    """A periodic error ``δ = A cos(kθ - φ)``, linear in ``A cos φ`` and ``A sin φ``."""

    terms = (
        Term("cos", "rad", 1e-4, "cos_rad"),
        Term("sin", "rad", 1e-4, "sin_rad"),
    )

    @property
    def periods_per_turn(self) -> float:
        raise NotImplementedError

    def function(self, angle: Array) -> Array:
        phase = self.periods_per_turn * angle
        return np.stack([np.cos(phase), np.sin(phase)], axis=1)

    def file_values(self) -> dict[str, float]:
        """Amplitude and phase [rad]; the phase is kθ at which δ is largest."""
        cos, sin = self.values
        amplitude = float(np.hypot(cos, sin))
        return {"amplitude_rad": amplitude, "phase_rad": float(np.arctan2(sin, cos))}

    def file_jacobian(self) -> Array:
        """∂(A, φ)/∂(A cos φ, A sin φ); undefined at A = 0."""
        amplitude, phase = self.file_values().values()
        c = np.cos(phase)
        s = np.sin(phase)
        of_phase = [-s, c] / np.maximum(amplitude, 1e-300)
        return np.array([[c, s], of_phase])

    def from_file(self, file_values: Mapping[str, float]) -> tuple[float, ...]:
        """Values from amplitude and phase."""
        keys = ["amplitude_rad", "phase_rad"]
        require_names(file_values, keys, f"parameter of {self.label}")
        amplitude, phase = (file_values.get(key, 0.0) for key in keys)
        return (amplitude * np.cos(phase), amplitude * np.sin(phase))

    def readings(self) -> dict[str, Reading]:
        amplitude = Reading("amplitude", "µrad", 1e6)
        phase = Reading("phase", "°", 1.0 / DEG)
        return {"amplitude_rad": amplitude, "phase_rad": phase}

    @property
    def phase_is_free(self) -> bool:
        """Whether the phase is exactly zero: not stated."""
        return self.file_values()["phase_rad"] == 0.0


@dataclass(frozen=True)
class EncoderEccentricity(_Periodic):
    """The disc rotates beside the centre of its track: ``δ = arcsin(A cos(θ - φ))``.

    The encoder has one reading head; two opposite heads cancel the error. A is the eccentricity
    over the radius of the track. The law of sines in the triangle of axis, disc centre and head
    gives the formula exactly, with the reading θ. Typical magnitude: 2e-5 to 3e-4 rad. Aliases:
    ``joint_compliance`` and ``counterbalance`` of the same joint, if its axis is not vertical;
    ``encoder_ellipticity`` and ``encoder_gain``, if the joint covers only a part of a turn.
    """

    cause = "encoder_eccentricity"
    of_reading = True
    periods_per_turn = 1.0

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """The rotation with the arcsine.

        Raises:
            AacmmError: the eccentricity is as large as the radius of the track.
        """
        amplitude = math.hypot(*self.values)
        if amplitude >= 1.0:
            raise AacmmError(
                f"{self.label}: amplitude is {amplitude:g}; expected less than 1, the radius of "
                "the disc"
            )
        waves = self.function(state.reading(self.joint))
        errors = np.arcsin(waves @ np.array(self.values))
        rotations = encoder_displacements(state, self.joint, errors[:, None])
        return [(rotation.place, rotation.columns[:, :, 0]) for rotation in rotations]


@dataclass(frozen=True)
class EncoderEllipticity(_Periodic):
    """The disc is oval, which gives an error twice per turn: ``δ = A cos(2θ - φ)``.

    With two opposite heads, the rest of an eccentricity has the same form. Typical magnitude: 1e-5
    to 2e-4 rad. Source: harmonic analysis of circle divisions (Watanabe et al. 2001, CIRP Annals
    50). Aliases: ``encoder_eccentricity``, and ``joint_periodic_error`` of a similar order, if the
    joint covers only a part of a turn.
    """

    cause = "encoder_ellipticity"
    of_reading = True
    words = "encoder ellipticity (twice per turn)"
    periods_per_turn = 2.0


@dataclass(frozen=True)
class _Order(Nonlinear["JointPeriodicError"]):
    """An order; whole numbers, of teeth and gratings, are more probable."""

    words: str = "{value:.4g} periods per turn"

    def refine(self, effect: JointPeriodicError, records: Records) -> list[JointPeriodicError]:
        near = effect.order + np.linspace(-0.5, 0.5, 2 * ORDERS_NEAR + 1)
        orders = np.union1d(np.round(near, 4), round(effect.order))
        return [self.at(effect, order) for order in orders[orders > LEAST_ORDER].tolist()]

    def prior_sd(self, effect: JointPeriodicError) -> float:
        return WHOLE_ORDER_SD if self.is_preferred(effect) else 0.5

    def is_preferred(self, effect: JointPeriodicError) -> bool:
        return effect.order == round(effect.order)


@dataclass(frozen=True)
class JointPeriodicError(_Periodic):
    """A periodic error of any order k > 0, as of a gear or a scale: ``δ = A cos(kθ - φ)``.

    Typical magnitude: 1e-5 to 1e-4 rad. Source: harmonic analysis of circle divisions (Watanabe et
    al. 2001, CIRP Annals 50). Aliases: ``joint_periodic_error`` of another order, if the joint
    covers a short range, or if the records are too few for waves of this order.
    """

    order: float
    cause = "joint_periodic_error"
    words = "periodic error"
    nonlinear = _Order("order")

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """For every joint, orders with at least one period in its range, in small steps, and all
        whole orders; a longer period is similar to :class:`EncoderGain`.
        """
        for row, angle in _moving(arm, records):
            revolutions = float(np.ptp(angle)) / (2 * np.pi)
            periods = np.arange(1.0, HIGHEST_ORDER * revolutions, ORDER_STEP)
            is_other = np.ones(len(periods), dtype=bool)
            for order in OWN_ORDERS:
                is_other &= np.abs(periods - order * revolutions) >= OWN_WITHIN
            whole = np.setdiff1d(np.arange(1.0, HIGHEST_ORDER), OWN_ORDERS)
            has_period = whole * revolutions >= 1.0
            orders = np.union1d(periods[is_other] / revolutions, whole[has_period])
            if orders.size:
                yield tuple(cls(row, order) for order in np.round(orders, 4).tolist())

    @property
    def periods_per_turn(self) -> float:
        """The order."""
        return self.order


@dataclass(frozen=True)
class SecondPeriodicError(JointPeriodicError):
    """A further periodic error of a joint that has one, of any order k > 0: ``δ = A cos(kθ - φ)``.

    Typical magnitude: 1e-5 to 1e-4 rad. Source: as of :class:`JointPeriodicError`. Aliases: as of
    ``joint_periodic_error``; ``joint_error_curve``, which has periodic errors of many orders.
    """

    cause = "second_periodic_error"
    words = "second periodic error"
    follows = "joint_periodic_error"


@dataclass(frozen=True)
class JointErrorCurve(OfAngle):
    """A repeatable error of one joint as any smooth function of its angle.

    ``δ(θ) = Σ c_i B_i(θ)``, with cubic B-splines on uniform knots from ``lower_rad`` to
    ``upper_rad`` (de Boor 1978). Typical magnitude: 1e-5 to 3e-4 rad. Aliases: every other cause
    that depends only on the angle of the same joint; causes of load, if only the same joint moves
    the load.
    """

    lower_rad: float
    upper_rad: float
    coefficients: int
    cause = "joint_error_curve"
    words = "error curve"
    prior_weight = 0.3
    free_form = True

    def __post_init__(self) -> None:
        is_range = -LARGEST_ANGLE <= self.lower_rad < self.upper_rad <= LARGEST_ANGLE
        if not (is_range and 4 <= self.coefficients <= MOST_CURVE_COEFFICIENTS):
            raise AacmmError(
                f"{self.label}: lower_rad, upper_rad and coefficients are {self.lower_rad}, "
                f"{self.upper_rad} and {self.coefficients}; expected lower_rad < upper_rad, and 4 "
                f"to {MOST_CURVE_COEFFICIENTS} coefficients"
            )
        super().__post_init__()

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Curves over the range of the records for every joint, from coarse to fine."""
        for row, angle in _moving(arm, records) if records is not None else ():
            low, high = _range_of(angle)
            intervals = _finest(low, high) - DEGREE
            counts = [intervals // length + DEGREE for length in COARSER]
            most = len(angle) // PER_COEFFICIENT
            possible = [count for count in counts if FEWEST_COEFFICIENTS <= count <= most]
            if possible:
                yield tuple(cls(row, low, high, count) for count in possible)

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """The limits of the joint, with a margin, as the range of the curve."""
        from aacmm_pin.arm import joint_bounds

        rows = arm.chain.moving_rows()
        joint = stated.get("joint")
        bounds = joint_bounds(arm)[rows.index(joint)] if joint in rows else (-np.pi, np.pi)
        low, high = map(float, bounds)
        return {
            "lower_rad": low - CURVE_MARGIN,
            "upper_rad": high + CURVE_MARGIN,
            "coefficients": DEFAULT_COEFFICIENTS,
        }

    @property
    def terms(self) -> tuple[Term, ...]:
        """The coefficients of the spline."""
        return _coefficients(self.coefficients)

    def function(self, angle: Array) -> Array:
        """The values of the B-splines.

        Raises:
            AacmmError: an angle is outside the range of the curve.
        """
        outside = ~((angle >= self.lower_rad) & (angle <= self.upper_rad))
        if outside.any():
            raise AacmmError(
                f"{self.label}: {outside.sum()} of {angle.size} angles are outside the curve, such "
                f"as {angle[outside][0]:g} rad; expected {self.lower_rad:g} rad to "
                f"{self.upper_rad:g} rad"
            )
        if not angle.size:  # SciPy wants at least one point
            return np.zeros((0, self.coefficients))
        splines = scipy.interpolate.BSpline.design_matrix(angle, self.knots, DEGREE)
        return np.asarray(splines.toarray())

    @property
    def known_range(self) -> tuple[float, float]:
        """The range of the curve [rad]."""
        return self.lower_rad, self.upper_rad

    @property
    def knots(self) -> Array:
        """The knots of the spline [rad]."""
        low = self.lower_rad
        high = self.upper_rad
        inner = np.linspace(low, high, self.coefficients - DEGREE + 1)
        return np.concatenate([DEGREE * [low], inner, DEGREE * [high]])


@dataclass(frozen=True)
class EncoderGain(OfAngle):
    """The error is proportional to the angle: ``δ = g θ``.

    A coupling ratio c for the own reading of the joint becomes ``c (1 + g)``. A closed disc cannot
    have this error; a belt, a gear or an interpolator can, and a wound cable acts similarly. For a
    prismatic joint, g is the error of its scale. Typical magnitude: 2e-5 to 4e-4 rad/rad or m/m.
    Aliases: ``encoder_eccentricity`` and ``encoder_ellipticity`` of the same joint, if the joint
    covers only a part of a turn.
    """

    cause = "encoder_gain"
    of_reading = True
    of_slides = True
    terms = (Term("", "1", 1e-4, "gain"),)

    def function(self, angle: Array) -> Array:
        """The angle itself."""
        return angle[:, None]


@dataclass(frozen=True)
class JointCoupling(Effect):
    """The angle of a joint contains a part of the reading of another encoder: ``δ = r θ_of``.

    A gear, belt or parallelogram has another ratio than stated, or another joint winds a cable. The
    true ratio is the ratio in ``[[couplings]]``, or 0, plus r. Typical magnitude: 1e-4 to 3e-3
    rad/rad. Aliases: ``joint_error_curve`` of the joint ``of``, if the axes of the two joints are
    parallel and near each other; causes of load, if the joint ``of`` lifts the other joint.
    """

    joint: int
    of: int
    cause = "joint_coupling"
    words = "coupling"
    load = "reading of the other joint"
    prior_weight = 0.3
    terms = (Term("", "1", 1e-3, "ratio_change"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_row(self.of) or self.of == self.joint:
            raise AacmmError(
                f"{self.label}: of is {self.of!r}; expected the number of another row; for the "
                f"ratio of the joint's own encoder, use encoder_gain:{self.joint}"
            )

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Every revolute joint with the previous joint, and every mimic joint with its own, if the
        other joint rotates far enough.
        """
        rows = arm.chain.moving_rows()
        mimicked = [(m.of, m.joint) for m in arm.mimics if m.of != m.joint]
        prismatic = np.array(arm.chain.joint_rows())[arm.chain.slides]
        rotating = [row for row, _ in _moving(arm, records)]
        for other, joint in (*pairwise(rows), *mimicked):
            if other in rotating and joint not in prismatic:
                yield (cls(joint, other),)

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """The joint before as the default of ``of``."""
        before = [row for row in arm.chain.moving_rows() if row < stated.get("joint", 0)]
        return {"of": before[-1]} if before else {}

    @property
    def key(self) -> str:
        """The label with the other joint."""
        return f"{self.label},of={self.of}"

    @property
    def details(self) -> list[str]:
        """The other joint as text."""
        return [f"with joint {self.of}"]

    def displacements(self, state: State) -> list[Displacement]:
        """The rotation, proportional to the reading of the other joint."""
        reading = state.reading(self.of)
        return [about_axis(state, self.joint, reading[:, None])]


@dataclass(frozen=True)
class JointHysteresis(Effect):
    """Friction, a cable or a coupling holds the joint back towards its last position: ``δ = h s``.

    s = -1, 0 or 1 is the sign of the last motion of the joint; h is half of the reversal error. The
    sign of h depends on whether the encoder is before or after the elastic part. Typical magnitude:
    2e-5 to 2e-4 rad. Source: reversal value, ISO 230-2:2014. Needs ``approachN``. Aliases:
    ``joint_hysteresis`` of a neighbouring joint, if both joints always move together.
    """

    joint: int
    cause = "joint_hysteresis"
    function_of = "approach"
    words = "hysteresis"
    needs = ("approach",)
    terms = (Term("", "rad", 1e-4, "half_width_rad"),)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for every joint with records of different approach."""
        approach = None if records is None else records.conditions.approach
        for number, row in enumerate(arm.chain.moving_rows()):
            if records is None or (approach is not None and np.ptp(approach[:, number]) > 0):
                yield (cls(row),)

    def displacements(self, state: State) -> list[Displacement]:
        """The sign of the last motion as a rotation about the axis."""
        approach = state.conditions.require("approach", self.label)
        return [about_axis(state, self.joint, approach[:, state.joint(self.joint), None])]


def strongest_waves(effect: Effect) -> list[tuple[float, float]] | None:
    """Orders [per turn] and amplitudes [rad] of the strongest waves in an error curve; None for
    other effects.

    They are peaks of the periodogram over the range of the curve (Hann window), strongest first,
    with at least one period. Waves less than two periods apart over this range form one peak.
    """
    if not isinstance(effect, JointErrorCurve):
        return None
    angle = np.linspace(effect.lower_rad, effect.upper_rad, SAMPLES)
    revolutions = (effect.upper_rad - effect.lower_rad) / (2 * np.pi)
    curve = scipy.interpolate.BSpline(effect.knots, np.array(effect.values), 3)(angle)
    options = {"nfft": 8 * SAMPLES, "detrend": "linear", "scaling": "spectrum"}
    order, power = scipy.signal.periodogram(curve, SAMPLES / revolutions, "hann", **options)
    peaks, _ = scipy.signal.find_peaks(power, height=1e-2 * power.max())
    whole_periods = [k for k in peaks if order[k] * revolutions >= 1.0]
    strongest = sorted(whole_periods, key=lambda k: -power[k])[:MOST_WAVES]
    return [(float(order[k]), float(np.sqrt(2 * power[k]))) for k in strongest]
