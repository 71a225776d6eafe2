"""Which causes could be behind what a set of records shows: the library, as far as these records can carry it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.problem import OF_KIND, Problem, geometric_parameters
from aacmm_pin.effects import (
    CAUSES,
    BaseCompliance,
    BearingTilt,
    Counterbalance,
    Effect,
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    EncoderSlip,
    JointCompliance,
    JointErrorCurve,
    JointHysteresis,
    JointPeriodicError,
    LinkBending,
    ReferenceFrame,
    SeatError,
    StylusBending,
    StylusOffset,
    ThermalExpansion,
    TorsionalWindup,
    ZeroDrift,
)
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.tube import tubes
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements.records import Measurements

ORDERS = (0.5, 1.5, 2.5, *(k / 2 for k in range(6, 21)), *(float(k) for k in range(11, 33)))
"""Orders of a periodic error that are tried before the order is refined."""
SLIPS = 40
"""Times of a slip that are tried, in quantiles of the records' times, besides the middle of every pause."""
PAUSE = 5.0
"""A pause is so many times longer than the median time between records."""
WARM_UPS = (600.0, 1800.0, 5400.0)
"""Time constants of a warm-up that are tried [s]."""
CURVES = (24, 60)
"""Numbers of coefficients per turn of a free curve that are tried, before they are doubled where that is better."""
PER_COEFFICIENT = 2
"""So many records for each coefficient of a curve, at least."""
LEAST_SPREAD = 0.02
"""A joint that moves less than this cannot show anything that depends on its angle [rad]."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause that may be there, with the inner parameters that are tried.

    Attributes:
        variants: the same cause with each value of its inner parameter (order, time, …), all parameters zero.
    """

    variants: tuple[Effect, ...]

    @property
    def label(self) -> str:
        """Cause and place."""
        return self.variants[0].label

    @property
    def cause(self) -> str:
        """Name of the cause."""
        return self.variants[0].cause


def candidates(
    model: ErrorModel, measurements: Measurements, problem: Problem, extra: Sequence[Effect] = ()
) -> list[Candidate]:
    """Every cause of the library that these records could show, one for each place where it can sit.

    Args:
        model: the arm; what it is known to have is no candidate.
        measurements: the records.
        problem: what is refitted anyway; geometric values beyond what is stated of them are causes too.
        extra: causes to try besides; those with one label are variants of one candidate, which may be the library's.

    Raises:
        UnknownNameError: an extra cause is not registered.
        AacmmError: an extra cause sits on a row that the arm does not have.
    """
    conditions = measurements.conditions
    arm, known = model.arm, {effect.label for effect in model.effects}
    found: list[tuple[Effect, ...]] = []
    for number, place in enumerate(arm.chain.moving_axes()):
        row, angle = place // 2, measurements.q[:, number]
        if np.ptp(angle) >= LEAST_SPREAD and not arm.chain.prismatic[number]:
            found += _of_angle(row, angle)
        found += _of_time(row, conditions)
        if conditions.approach is not None and np.ptp(conditions.approach[:, number]) > 0:
            found.append((JointHysteresis(row),))
        found += [(effect,) for effect in _of_joint_load(arm, number, row, conditions)]
    found += [(effect,) for effect in _of_structure(arm, conditions)]
    labels = [label for label, records in measurements.seats().items() if len(records) > 1]
    if len(labels) >= 3 and measurements.known.any():
        found += [(SeatError(label),) for label in labels]
    found += [(effect,) for effect in _of_geometry(arm, measurements, problem)]
    of_label = {variants[0].label: variants for variants in found}
    for effect in extra:
        label = _checked(effect, arm).label
        of_label[label] = tuple(dict.fromkeys((*of_label.get(label, ()), effect.at(()))))
    return [Candidate(variants) for label, variants in of_label.items() if label not in known]


def _checked(effect: Effect, arm: Arm) -> Effect:
    if CAUSES.get(effect.cause) is not type(effect):
        raise UnknownNameError("cause", effect.cause, list(CAUSES), "aacmm_pin.effects.register adds one of your own")
    if effect.row is not None and not 1 <= effect.row <= arm.chain.rows:
        raise AacmmError(f"{effect.label}: {arm.name} has rows 1 to {arm.chain.rows}")
    return effect


def _of_geometry(arm: Arm, measurements: Measurements, problem: Problem) -> Iterator[Effect]:
    """Geometric values farther off than is stated, a tip or a frame of references that is not where it is said to be."""
    first, estimated = 0, {effect.label for effect in problem.estimated}
    for effect in problem.estimated:
        stated = problem.stated[first : first + len(effect.terms)]
        first += len(effect.terms)
        if stated.all() and geometric_parameters(arm, effect):
            yield effect.at(())
    if arm.dh is not None:
        exact = [OF_KIND[p.kind](joint=p.joint) for p in arm.parameters]  # type: ignore[call-arg]
        yield from (effect for effect in exact if effect.label not in estimated)
    if not any(isinstance(effect, StylusOffset) for effect in problem.estimated):
        yield StylusOffset()
    if measurements.known.any() and not problem.external:
        yield ReferenceFrame()


def _of_angle(row: int, angle: Array) -> Iterator[tuple[Effect, ...]]:
    yield (EncoderEccentricity(row),)
    yield (EncoderEllipticity(row),)
    yield (EncoderGain(row),)
    turns = np.ptp(angle) / (2 * np.pi)
    # What makes less than one period over the covered range is a gain or an offset by another name.
    orders = [order for order in ORDERS if order * turns >= 1.0]
    if orders:
        yield tuple(JointPeriodicError(row, order) for order in orders)
    margin = 1e-6 + 1e-3 * np.ptp(angle)
    low, high = float(angle.min() - margin), float(angle.max() + margin)
    counts = sorted({int(np.clip(round(per_turn * turns), 8, 120)) for per_turn in CURVES})
    if curves := tuple(JointErrorCurve(row, low, high, count) for count in counts if PER_COEFFICIENT * count <= len(angle)):
        yield curves


def _of_time(row: int, conditions: Conditions) -> Iterator[tuple[Effect, ...]]:
    time = conditions.time
    if time is None or np.ptp(time) == 0.0:
        return
    yield tuple(EncoderSlip(row, float(t)) for t in _steps(time))
    yield tuple(ZeroDrift(row, constant) for constant in WARM_UPS)


def _steps(time: Array) -> Array:
    """Times at which something may have changed: between records, and in every pause, when arms are handled."""
    taken = np.unique(time)
    between = (taken[1:] + taken[:-1]) / 2
    gaps = np.diff(taken)
    pauses = between[gaps > PAUSE * np.median(gaps)][:SLIPS]
    spread = between[np.unique(np.linspace(0.04, 0.96, SLIPS) * (len(between) - 1)).astype(int)]
    return np.union1d(spread, pauses)


def _of_joint_load(arm: Arm, number: int, row: int, conditions: Conditions) -> Iterator[Effect]:
    slides = arm.chain.prismatic[number:]
    if slides[0] or (arm.masses is None and slides.any()):
        pass  # no angle that a torque could turn; and unknown masses beyond a slide have no constant lever
    elif conditions.torque is not None:
        yield JointCompliance(row, torque="measured")
    elif arm.masses is not None:
        yield JointCompliance(row)
    else:
        yield JointCompliance(row, bodies=tuple(place // 2 for place in arm.chain.moving_axes() if place // 2 >= row))
    if arm.masses is not None:
        yield BearingTilt(row)


def _of_structure(arm: Arm, conditions: Conditions) -> Iterator[Effect]:
    if arm.masses is not None:
        yield BaseCompliance()
        for row in tubes(arm):
            yield LinkBending(row)
            yield TorsionalWindup(row)
    if arm.nq >= 2:
        yield Counterbalance(arm.chain.moving_axes()[1] // 2)
    if conditions.temperature is not None or conditions.link_temperature is not None:
        yield ThermalExpansion()
        if conditions.link_temperature is not None:
            yield from (ThermalExpansion(row) for row in tubes(arm))
    if arm.stylus_axis is not None:
        yield StylusBending()
