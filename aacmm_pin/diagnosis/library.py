"""Which causes could be behind what a set of records shows: the library, as far as these records can carry it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin.arm import Arm
from aacmm_pin.chain import axis, end
from aacmm_pin.checks import Array
from aacmm_pin.conditions import Conditions
from aacmm_pin.effects import (
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
    SeatError,
    StylusBending,
    ThermalExpansion,
    TorsionalWindup,
    ZeroDrift,
)
from aacmm_pin.measurements import Measurements

TUBE = 0.15
"""Bodies longer than this are tubes that bend [m]."""
ORDERS = (0.5, 1.5, 2.5, *(k / 2 for k in range(6, 21)), *(float(k) for k in range(11, 33)))
"""Orders of a periodic error that are tried before the order is refined."""
SLIPS = 24
"""Times of a slip that are tried, in quantiles of the records' times."""
WARM_UPS = (600.0, 1800.0, 5400.0)
"""Time constants of a warm-up that are tried [s]."""
CURVES = (24, 60)
"""Numbers of coefficients per turn of a free curve that are tried."""
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


def candidates(arm: Arm, measurements: Measurements) -> list[Candidate]:
    """Every cause of the library that these records could show, one for each place where it can sit."""
    conditions = measurements.conditions
    found: list[tuple[Effect, ...]] = []
    for number, place in enumerate(arm.chain.moving_axes()):
        row, angle = place // 2, measurements.q[:, number]
        if np.ptp(angle) >= LEAST_SPREAD:
            found += _of_angle(row, angle)
        found += _of_time(row, conditions)
        if conditions.approach is not None and np.ptp(conditions.approach[:, number]) > 0:
            found.append((JointHysteresis(row),))
        found += [(effect,) for effect in _of_joint_load(arm, row, conditions)]
    found += [(effect,) for effect in _of_structure(arm, conditions)]
    labels = [label for label, records in measurements.seats().items() if len(records) > 1]
    if len(labels) >= 3 and measurements.known.any():
        found += [(SeatError(label),) for label in labels]
    return [Candidate(variants) for variants in found]


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
    yield tuple(JointErrorCurve(row, low, high, count) for count in counts if 3 * count <= len(angle))


def _of_time(row: int, conditions: Conditions) -> Iterator[tuple[Effect, ...]]:
    time = conditions.time
    if time is None or np.ptp(time) == 0.0:
        return
    quantiles = np.unique(np.quantile(time, np.linspace(0.04, 0.96, SLIPS)))
    yield tuple(EncoderSlip(row, float(t)) for t in quantiles)
    yield tuple(ZeroDrift(row, constant) for constant in WARM_UPS)


def _of_joint_load(arm: Arm, row: int, conditions: Conditions) -> Iterator[Effect]:
    if conditions.torque is not None:
        yield JointCompliance(row, torque="measured")
    elif arm.masses is not None:
        yield JointCompliance(row)
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


def tubes(arm: Arm) -> list[int]:
    """Rows of the bodies that are long enough to bend."""
    _, origin = arm.chain.walk(np.zeros((1, arm.nq)))
    spans = [np.linalg.norm(origin[end(row)] - origin[axis(row)]) for row in range(1, arm.chain.rows + 1)]
    return [row for row, span in enumerate(spans, start=1) if span > TUBE]


@dataclass(frozen=True, eq=False)
class Covariate:
    """Something that residuals may depend on in a way that no cause of the library has.

    Attributes:
        name: ``joint 4``, ``time``, ``temperature``, or the name of an unknown column.
        functions: smooth functions of it at the records, or one for each label (n, m), mean zero, root mean square one.
        values: the covariate itself (n,), numbers or labels.
        of_target: True where it would shift the target on the last body instead of the point in the room.
    """

    name: str
    functions: Array
    values: NDArray[Any]
    of_target: bool = False


def covariates(measurements: Measurements) -> list[Covariate]:
    """Everything known of the records that residuals may depend on."""
    conditions = measurements.conditions
    angles = enumerate(measurements.q.T, start=1)
    found: list[tuple[str, Iterable[object]]] = [(f"joint {j}", a) for j, a in angles if np.ptp(a) > LEAST_SPREAD]
    for name in ("time", "temperature", "session"):
        if (known := getattr(conditions, name)) is not None:
            found.append((name, known))
    if measurements.operator is not None:
        found.append(("operator", measurements.operator))
    found += [(str(name), measurements.extra[name]) for name in measurements.extra]
    made = [_covariate(name, pd.Series(values)) for name, values in found]
    return [covariate for covariate in made if covariate is not None] + _groups(measurements)


FEWEST = 3
"""With fewer groups than this nobody can say which one is the odd one out."""


def _groups(measurements: Measurements) -> list[Covariate]:
    """One group of records, a bar or else a seat of unknown place, in which the target sat elsewhere on the arm."""
    labels = measurements.bar if measurements.bar is not None else measurements.conditions.seat
    what = "bar" if measurements.bar is not None else "seat"
    if labels is None or measurements.known.any():
        return []
    names = [name for name in dict.fromkeys(labels) if name and np.sum(labels == name) > FEWEST]
    if len(names) < FEWEST:
        return []
    inside = [(name, (labels == name).astype(np.float64)[:, None]) for name in names]
    return [Covariate(f"{what} {name}", _normalised(mine), labels, of_target=True) for name, mine in inside]


MOST_LABELS = 12
FUNCTIONS = 6


def _covariate(name: str, values: pd.Series) -> Covariate | None:
    numbers = pd.to_numeric(values, errors="coerce")
    if numbers.notna().all() and numbers.nunique() > MOST_LABELS:
        x = 2 * (numbers.rank(method="average").to_numpy() - 0.5) / len(numbers) - 1
        functions = np.cos(np.pi * np.arange(1, FUNCTIONS + 1) * (x[:, None] + 1) / 2)
        return Covariate(name, _normalised(functions), numbers.to_numpy(dtype=np.float64))
    labels = values.astype(str)
    if not 2 <= labels.nunique() <= MOST_LABELS:
        return None
    dummies = pd.get_dummies(labels, dtype=float).to_numpy()[:, 1:]
    return Covariate(name, _normalised(dummies), labels.to_numpy())


def _normalised(functions: Array) -> Array:
    centred = functions - functions.mean(axis=0)
    return np.asarray(centred / np.sqrt(np.square(centred).mean(axis=0)))
