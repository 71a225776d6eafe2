"""What residuals may depend on in a way that no cause of the library has, and where it may act."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.shared_exclusions import MOST_LABELS, as_numbers
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.discrepancy import Carrier
from aacmm_pin.effects.encoder import LEAST_SPREAD
from aacmm_pin.effects.smooth_functions import Bumps, Cosines, Smooth, Waves, product_of
from aacmm_pin.effects.state import State
from aacmm_pin.measurements.records import Measurements

FEWEST_GROUPS = 3
"""With fewer groups than this nobody can say which one is the odd one out."""
FEWEST_RECORDS = 3
"""A group has more records than this, or its own shift explains them whatever they are."""
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
    conditions = measurements.conditions
    state = State(arm, measurements.q, conditions, arm.chain.tip)
    rows = [place // 2 for place in arm.chain.moving_axes()]
    angles = [f"angle {row}" for row in rows]
    numbers = [(j, row) for j, row in enumerate(rows) if np.ptp(measurements.q[:, j]) > LEAST_SPREAD]
    found = [_of(f"joint {row}", measurements.q[:, j], [f"before {row}"], state) for j, row in numbers]
    named: list[tuple[str, Iterable[object], list[str], State | None]] = []
    for name in ("time", "temperature", "session"):
        if (known := getattr(conditions, name)) is not None:
            named.append((name, known, ["room", *angles, "lengths"], None if name == "session" else state))
    if conditions.torque is not None:
        named += [(f"torque {row}", conditions.torque[:, j], ["room", *angles], None) for j, row in enumerate(rows)]
    if measurements.operator is not None:
        named.append(("operator", measurements.operator, ["room", *angles], None))
    named += [(str(name), measurements.extra[name], ["room", *angles, "lengths"], None) for name in measurements.extra]
    found += [_of(*each) for each in named]
    products = [_product(state, one, other) for one, other in itertools.combinations(numbers, 2)]
    if conditions.time is not None and np.ptp(conditions.time) > 0.0:
        products += [_over_time(state, j, row) for j, row in numbers]
    single = [_with_time(c, conditions) for c in found if c is not None]
    sliding = [row for row, slides in zip(rows, arm.chain.prismatic, strict=True) if slides]
    of_joints = [_along(covariate, sliding) for covariate in (*single, *products)]
    return [*of_joints, _place(state), _scale(state), *_groups(measurements)]


def _of(name: str, values: Iterable[object], carriers: Sequence[str], state: State | None) -> Covariate | None:
    """A column of numbers or labels that may act on each of the carriers; numbers of a ``state`` new records have too."""
    if (numbers := as_numbers(values)) is not None:
        slow, quick = (Cosines.over(name, numbers, count) for count in SMOOTH)
        variants = [_carried(slow, numbers, carrier, state) for carrier in carriers]
        if carriers[0] == "room" and len(numbers) > 3 * SMOOTH[1]:
            variants.append(_carried(quick, numbers, "room", state))
        return Covariate(name, (name,), tuple(variants), _table(name, numbers.to_numpy(dtype=np.float64)))
    labels = pd.Series(values).astype(str)
    if not 2 <= labels.nunique() <= MOST_LABELS:
        return None
    dummies = _of_size_one(pd.get_dummies(labels, dtype=float).to_numpy())
    return Covariate(
        name, (name,), tuple(Carried(dummies, carrier) for carrier in carriers), _table(name, labels.to_numpy())
    )


def _carried(cosines: Cosines, numbers: pd.Series, carrier: str, state: State | None) -> Carried:
    """Cosines on a carrier."""
    if state is None:
        return Carried(_of_size_one(cosines.of_values(numbers)), carrier)
    return Carried.of((cosines,), carrier, state)


def _along(covariate: Covariate, sliding: Sequence[int]) -> Covariate:
    """The covariate with the positions of joints that slide, and errors of these, as such."""
    values, variants = covariate.values, covariate.variants
    for row in sliding:
        if (name := f"theta{row}_deg") in values and pd.api.types.is_numeric_dtype(values[name]):
            values = values.assign(**{name: values[name] * (DEG / MM)}).rename(columns={name: f"joint{row}_mm"})
        variants = tuple(replace(v, carrier=f"slide {row}") if v.carrier == f"angle {row}" else v for v in variants)
    return replace(covariate, values=values, variants=variants)


UNITS = {"time": ("time_s", 1.0), "temperature": ("temperature_c", 1.0)}


def _table(name: str, values: NDArray[Any]) -> pd.DataFrame:
    """The covariate as a column with its unit in its name."""
    what, _, row = name.partition(" ")
    column, unit = (f"theta{row}_deg", DEG) if what == "joint" else UNITS.get(name, (name, 1.0))
    return pd.DataFrame({column: values / unit if np.issubdtype(values.dtype, np.number) else values})


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
    since = time[:, None] - (inside * time[:, None]).sum(axis=0) / inside.sum(axis=0)
    powers = [inside * (since / max(np.ptp(time), 1e-9)) ** k for k in range(1 + SLOPES)]
    return replace(covariate, variants=(*covariate.variants, Carried(_of_size_one(np.hstack(powers)), "room")))


def _product(state: State, one: tuple[int, int], other: tuple[int, int]) -> Covariate:
    """The angle of one of two joints depends on where both stand."""
    (j, row), (k, further) = one, other
    names = (f"joint {row}", f"joint {further}")
    waves = tuple(Waves(name, constant=True) for name in names)
    variants = [Carried.of(waves, f"angle {at}", state) for at in (row, further)]
    values = _table(names[0], state.q[:, j]).join(_table(names[1], state.q[:, k]))
    return Covariate(" × ".join(names), names, tuple(variants), values)


def _over_time(state: State, number: int, row: int) -> Covariate:
    """The angle of a joint is off by where it stands, and otherwise later: an encoder that was knocked midway."""
    name, time = f"joint {row}", state.conditions.require("time", "a change with time")
    waves = Waves(name), Cosines.over("time", time, LATER)
    values = _table(name, state.q[:, number]).join(_table("time", time))
    return Covariate(f"{name} × time", (name, "time"), (Carried.of(waves, f"angle {row}", state),), values)


def _place(state: State) -> Covariate:
    """Where the tip is: a field of shifts in the room, as a table that bends or a tracker's own error would give."""
    tip = state.position
    apart = len(np.unique(np.round(tip / NARROWEST), axis=0))
    count = int(np.clip(apart // 2, 1, CENTRES))
    ordered = tip[np.lexsort(np.round(state.q, DECIMALS).T)]  # so that the order of the records does not matter
    centres, nearest = scipy.cluster.vq.kmeans2(ordered, count, minit="++", rng=np.random.default_rng(count))
    width = max(1.5 * float(np.sqrt(np.square(ordered - centres[nearest]).sum(axis=1).mean())), NARROWEST)
    bumps = Bumps(tuple((float(x), float(y), float(z)) for x, y, z in centres), width)
    values = pd.DataFrame(tip / MM, columns=["tip_x_mm", "tip_y_mm", "tip_z_mm"])
    return Covariate("place", ("x", "y", "z"), (Carried.of((bumps,), "room", state),), values)


def _scale(state: State) -> Covariate:
    """All lengths are too long or too short by one factor: a wrong unit, another reference temperature."""
    values = pd.DataFrame({"distance_mm": np.linalg.norm(state.position, axis=1) / MM})
    return Covariate("scale", ("scale",), (Carried.of((), "lengths", state),), values)


def _groups(measurements: Measurements) -> list[Covariate]:
    """One group of records, a bar or else a seat of unknown place, in which the target sat elsewhere on the arm."""
    labels = measurements.bar if measurements.bar is not None else measurements.conditions.seat
    what = "bar" if measurements.bar is not None else "seat"
    if labels is None or measurements.known.any():
        return []
    names = [name for name in dict.fromkeys(labels) if name and np.sum(labels == name) > FEWEST_RECORDS]
    if len(names) < FEWEST_GROUPS:
        return []
    inside = [(f"{what} {name}", (labels == name).astype(np.float64)[:, None]) for name in names]
    column = pd.DataFrame({what: labels})
    return [Covariate(name, (name,), (Carried(_of_size_one(mine), "target"),), column) for name, mine in inside]


def _of_size_one(functions: Array) -> Array:
    return np.asarray(functions / _size(functions))


def _size(functions: Array) -> Array:
    """Root mean square of each function (n, m): (m,)."""
    return np.asarray(np.sqrt(np.maximum(np.square(functions).mean(axis=0), 1e-12)))
