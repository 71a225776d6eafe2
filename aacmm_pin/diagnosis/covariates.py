"""What residuals may depend on in a way that no cause of the library has, and where it may act."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.shared_exclusions import MOST_LABELS, as_numbers
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.discrepancy import Carrier
from aacmm_pin.effects.encoder import LEAST_SPREAD
from aacmm_pin.effects.smooth_functions import Bumps, Cosines, Smooth, Waves, product_of
from aacmm_pin.effects.state import State
from aacmm_pin.measurements.records import Measurements

SMOOTH = (5, 20)
"""Numbers of cosines over the ranks of a covariate: a slow change; one with many turns, where it may shift the tip."""
LATER = 3
"""Number of cosines over the ranks of the time with which an error of a joint changes."""
SLOPES = 2
"""Powers of the time since the middle of a session with which the tip may shift inside it."""
DECIMALS = 9
"""Angles are ordered by so many decimals [rad]."""
CENTRES = 24
"""So many places at most in the room round which a field may have its own shift …"""
NARROWEST = 0.1
"""… and it does not change within this distance [m]."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Smooth functions of a covariate, and what they act on.

    Attributes:
        functions: (n, m), root mean square one, the constant first: whatever depends on something also has a mean.
        carrier: name of a :class:`aacmm_pin.effects.discrepancy.Carrier`; the axes of ``room`` are those of the references.
        smooth: the same functions at any records, but for their ``size``; None of what new records do not have.
        size: root mean square of each at these records (m,).
    """

    functions: Array
    carrier: str
    smooth: tuple[Smooth, ...] | None = None
    size: Array = field(default_factory=lambda: np.ones(1))

    @staticmethod
    def of(smooth: tuple[Smooth, ...], carrier: str, state: State) -> Carried:
        """Functions that new records have too."""
        values = product_of(smooth, state)
        return Carried(_of_size_one(values), carrier, smooth, _size(values))

    @property
    def acts_on(self) -> str:
        """The carrier in words."""
        return Carrier(self.carrier).in_words

    @property
    def quantities(self) -> dict[str, float]:
        """What it changes: names with unit, and how many SI units one of them is."""
        return Carrier(self.carrier).quantities


@dataclass(frozen=True, eq=False)
class Covariate:
    """Something that residuals may depend on.

    Attributes:
        name: ``joint 4``, ``joint 2 × joint 4``, ``time``, ``temperature``, ``place``, ``bar left``, or an unknown column.
        depends_on: the single covariates in it: ``joint 2``, ``time``, ``x``, …
        variants: ways in which it may act.
        values: the covariates themselves, n rows; a column of numbers has its unit in its name, others are labels.
    """

    name: str
    depends_on: tuple[str, ...]
    variants: tuple[Carried, ...]
    values: pd.DataFrame


def covariates(arm: Arm, measurements: Measurements) -> list[Covariate]:
    """Everything known of the records that residuals may depend on."""
    state = State(arm, measurements.q, measurements.conditions, arm.chain.tip)
    rows = arm.chain.moving_rows()
    joints = [(j, row) for j, row in enumerate(rows) if np.ptp(state.q[:, j]) > LEAST_SPREAD]
    single = [_of(f"joint {row}", state.q[:, j], [f"before {row}"], state) for j, row in joints]
    single += _of_columns(measurements, state, rows)
    found = [_with_time(covariate, state.conditions) for covariate in single if covariate is not None]
    found += [_product(state, *pair) for pair in itertools.combinations(joints, 2)]
    time = state.conditions.time
    if time is not None and np.ptp(time) > 0.0:
        found += [_over_time(state, j, row, time) for j, row in joints]
    sliding = [row for row, slides in zip(rows, arm.chain.prismatic, strict=True) if slides]
    of_joints = (_along(covariate, sliding) for covariate in found)
    return [*of_joints, _place(state), _scale(state), *_groups(measurements)]


def _of_columns(measurements: Measurements, state: State, rows: Sequence[int]) -> Iterator[Covariate | None]:
    """Recorded conditions, the operator and unknown columns."""
    conditions = state.conditions
    turning = ["room", *(f"angle {row}" for row in rows)]
    anywhere = [*turning, "lengths"]
    for name in ("time", "temperature"):
        if (numbers := getattr(conditions, name)) is not None:
            yield _of(name, numbers, anywhere, state)
    if conditions.session is not None:
        yield _of("session", conditions.session, anywhere)
    if conditions.torque is not None:
        for j, row in enumerate(rows):
            yield _of(f"torque {row}", conditions.torque[:, j], turning)
    if measurements.operator is not None:
        yield _of("operator", measurements.operator, turning)
    for column in measurements.extra:
        yield _of(str(column), measurements.extra[column], anywhere)


def _of(name: str, values: Iterable[object], carriers: Sequence[str], state: State | None = None) -> Covariate | None:
    """A column of numbers or labels that may act on each of the carriers; numbers of a ``state`` new records have too."""
    numbers = as_numbers(values)
    if numbers is None:
        return _of_labels(name, pd.Series(values).astype(str), carriers)
    slow, quick = (Cosines.over(name, numbers, count) for count in SMOOTH)
    variants = [_carried(slow, numbers, carrier, state) for carrier in carriers]
    if carriers[0] == "room" and len(numbers) > 3 * SMOOTH[1]:
        variants.append(_carried(quick, numbers, "room", state))
    return Covariate(name, (name,), tuple(variants), _table(name, numbers.to_numpy(dtype=np.float64)))


def _of_labels(name: str, labels: pd.Series, carriers: Sequence[str]) -> Covariate | None:
    """A column of labels; None with a single one, or with too many."""
    if not 2 <= labels.nunique() <= MOST_LABELS:
        return None
    dummies = _of_size_one(pd.get_dummies(labels, dtype=float).to_numpy())
    variants = tuple(Carried(dummies, carrier) for carrier in carriers)
    return Covariate(name, (name,), variants, pd.DataFrame({_column(name)[0]: labels.to_numpy()}))


def _carried(cosines: Cosines, numbers: pd.Series, carrier: str, state: State | None) -> Carried:
    """Cosines on a carrier."""
    if state is None:
        return Carried(_of_size_one(cosines.of_values(numbers)), carrier)
    return Carried.of((cosines,), carrier, state)


def _along(covariate: Covariate, sliding: Sequence[int]) -> Covariate:
    """The covariate with the positions of joints that slide, and errors of these, as such."""
    values = covariate.values.copy()
    for row in sliding:
        name = f"theta{row}_deg"
        if name in values and pd.api.types.is_numeric_dtype(values[name]):
            values[name] *= DEG / MM
            values = values.rename(columns={name: f"joint{row}_mm"})
    angles = {f"angle {row}": f"slide {row}" for row in sliding}
    variants = [replace(way, carrier=angles.get(way.carrier, way.carrier)) for way in covariate.variants]
    return replace(covariate, values=values, variants=tuple(variants))


UNITS = {"time": ("time_s", 1.0), "temperature": ("temperature_c", 1.0)}


def _column(name: str) -> tuple[str, float]:
    """Name of a covariate's column with its unit, and how many SI units one of it is."""
    what, _, row = name.partition(" ")
    if what == "joint":
        return f"theta{row}_deg", DEG
    return UNITS.get(name, (name, 1.0))


def _table(name: str, values: Array) -> pd.DataFrame:
    """The covariate as a column with its unit in its name."""
    column, unit = _column(name)
    return pd.DataFrame({column: values / unit})


def _with_time(covariate: Covariate, conditions: Conditions) -> Covariate:
    """Sessions and time belong together: time may go on anew in each session, and one session is later than the other."""
    session, time = conditions.session, conditions.time
    if session is None or time is None or covariate.name not in ("time", "session"):
        return covariate
    if covariate.name == "session":
        return replace(covariate, depends_on=("session", "time"))
    inside = pd.get_dummies(pd.Series(session), dtype=float).to_numpy()
    if not 2 <= inside.shape[1] <= MOST_LABELS:
        return covariate
    middle = (inside * time[:, None]).sum(axis=0) / inside.sum(axis=0)
    since = (time[:, None] - middle) / max(np.ptp(time), 1e-9)
    powers = [inside * since**k for k in range(1 + SLOPES)]
    anew = Carried(_of_size_one(np.hstack(powers)), "room")
    return replace(covariate, variants=(*covariate.variants, anew))


def _product(state: State, one: tuple[int, int], other: tuple[int, int]) -> Covariate:
    """The angle of one of two joints depends on where both stand."""
    (j, row), (k, further) = one, other
    names = f"joint {row}", f"joint {further}"
    waves = tuple(Waves(name, constant=True) for name in names)
    variants = tuple(Carried.of(waves, f"angle {at}", state) for at in (row, further))
    values = _table(names[0], state.q[:, j])
    values = values.join(_table(names[1], state.q[:, k]))
    return Covariate(" × ".join(names), names, variants, values)


def _over_time(state: State, number: int, row: int, time: Array) -> Covariate:
    """The angle of a joint is off by where it stands, and otherwise later: an encoder that was knocked midway."""
    name = f"joint {row}"
    waves = Waves(name), Cosines.over("time", time, LATER)
    values = _table(name, state.q[:, number]).join(_table("time", time))
    way = Carried.of(waves, f"angle {row}", state)
    return Covariate(f"{name} × time", (name, "time"), (way,), values)


def _place(state: State) -> Covariate:
    """Where the tip is: a field of shifts in the room, as a table that bends or a tracker's own error would give."""
    tip = state.position
    values = pd.DataFrame(tip / MM, columns=["tip_x_mm", "tip_y_mm", "tip_z_mm"])
    way = Carried.of((_bumps(state),), "room", state)
    return Covariate("place", ("x", "y", "z"), (way,), values)


def _bumps(state: State) -> Bumps:
    """Round centres among the tips, as many as these are apart."""
    order = np.lexsort(np.round(state.q, DECIMALS).T)  # so that the order of the records does not matter
    tip = state.position[order]
    apart = np.unique(np.round(tip / NARROWEST), axis=0)
    count = int(np.clip(len(apart) // 2, 1, CENTRES))
    rng = np.random.default_rng(count)
    centres, nearest = scipy.cluster.vq.kmeans2(tip, count, minit="++", rng=rng)
    squares = np.square(tip - centres[nearest]).sum(axis=1)
    spread = float(np.sqrt(squares.mean()))
    places = tuple((x, y, z) for x, y, z in centres.tolist())
    return Bumps(places, max(1.5 * spread, NARROWEST))


def _scale(state: State) -> Covariate:
    """All lengths are too long or too short by one factor: a wrong unit, another reference temperature."""
    distance = np.linalg.norm(state.position, axis=1)
    way = Carried.of((), "lengths", state)
    return Covariate("scale", ("scale",), (way,), pd.DataFrame({"distance_mm": distance / MM}))


def _groups(measurements: Measurements) -> Iterator[Covariate]:
    """One group of records, a bar or else a seat of unknown place, in which the target sat elsewhere on the arm."""
    what, labels = "bar", measurements.bar
    if labels is None:
        what, labels = "seat", measurements.conditions.seat
    if labels is None or measurements.known.any():
        return
    counts = {label: np.sum(labels == label) for label in dict.fromkeys(labels) if label}
    large = [label for label, count in counts.items() if count > THRESHOLDS.fewest_records]
    column = pd.DataFrame({what: labels})
    for label in large if len(large) >= THRESHOLDS.fewest_groups else []:
        inside = (labels == label).astype(np.float64)[:, None]
        name, way = f"{what} {label}", Carried(_of_size_one(inside), "target")
        yield Covariate(name, (name,), (way,), column)


def _of_size_one(functions: Array) -> Array:
    return np.asarray(functions / _size(functions))


def _size(functions: Array) -> Array:
    """Root mean square of each function (n, m): (m,)."""
    squares = np.square(functions).mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(squares, 1e-12)))
