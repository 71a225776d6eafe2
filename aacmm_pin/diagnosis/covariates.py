"""Covariates: what residuals may depend on as no cause of the library does."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration.shared_exclusions import MOST_LABELS, as_numbers
from aacmm_pin.effects import (
    LEAST_SPREAD,
    RECORDED,
    Bumps,
    Carrier,
    Cosines,
    Moment,
    Smooth,
    State,
    Waves,
    product_of,
    tubes,
)
from aacmm_pin.measurements import Measurements

SMOOTH = (5, 20)
"""Cosines over the ranks of a covariate: for slow changes; for quick changes of the tip alone."""
ORDERS = (1, 2, 3)
"""Waves per revolution of a joint that another joint's error may have."""
GEAR_ORDERS = (2, 3, 4, 6)
"""Waves per revolution of a gear's error that a load may change."""
LEAST_MOMENT = 0.1
"""Least change of a joint's moment by others with which it is a covariate [N·m]."""
COSINES_OF_TIME = 3
"""Cosines over the ranks of the time with which a joint's error may change."""
DECIMALS = 9
"""Decimals of angles [rad] by which records are ordered."""
CENTRES = 24
"""Most places in the room around which a field may have its own shift."""
NARROWEST = 0.1
"""Distance within which the field of shifts does not change [m]."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Smooth functions of a covariate, and what they act on.

    Attributes:
        functions: (n, m), root mean square 1, the constant first: every dependence has a mean.
        carrier: name of a :class:`aacmm_pin.effects.smooth_discrepancy.Carrier`.
        smooth: these functions at any records, but for their ``size``; None for covariates that new
            records do not have.
        size: root mean square of each function at these records (m,).
        decay: prior amplitudes of the functions, relative to one another (m,), or (1,).
    """

    functions: Array
    carrier: str
    smooth: tuple[Smooth, ...] | None = None
    size: Array = field(default_factory=lambda: np.ones(1))
    decay: Array = field(default_factory=lambda: np.ones(1))

    @staticmethod
    def of(smooth: tuple[Smooth, ...], carrier: str, state: State) -> Carried:
        """The product of ``smooth`` at the records of ``state``, for covariates that new records
        have.
        """
        values = product_of(smooth, state)
        return Carried(_of_size_one(values), carrier, smooth, _size(values))

    @property
    def acts_on(self) -> str:
        """The carrier in words."""
        return Carrier(self.carrier).in_words

    @property
    def quantities(self) -> dict[str, float]:
        """What the carrier changes: names with unit, and SI units per unit."""
        return Carrier(self.carrier).quantities


@dataclass(frozen=True, eq=False)
class Covariate:
    """A quantity that residuals may depend on.

    Attributes:
        name: ``joint 4``, ``joint 2 × joint 4``, ``time``, ``temperature``, ``place``, or an
            unknown column.
        depends_on: its single covariates: ``joint 2``, ``time``, ``x``, …
        values: the covariates themselves, n rows; numbers have a unit in the name, others are
            labels.
    """

    name: str
    depends_on: tuple[str, ...]
    variants: tuple[Carried, ...]
    values: pd.DataFrame


class Joint(NamedTuple):
    """A joint: its number from 0, its row, and whether it slides."""

    number: int
    row: int
    slides: bool

    @property
    def name(self) -> str:
        """Name of the joint as a covariate."""
        return f"joint {self.row}"

    @property
    def error(self) -> str:
        """Carrier of the joint's error."""
        return f"slide {self.row}" if self.slides else f"angle {self.row}"

    def table(self, state: State) -> pd.DataFrame:
        """The joint's readings, as a column with its unit."""
        readings = state.q[:, self.number]
        if self.slides:
            return pd.DataFrame({f"joint{self.row}_mm": readings / MM})
        return pd.DataFrame({f"theta{self.row}_deg": readings / DEG})


def covariates(arm: Arm, measurements: Measurements) -> list[Covariate]:
    """All covariates of the records."""
    state = State(arm, measurements.q, measurements.conditions, arm.chain.tip)
    joints = [*map(Joint, itertools.count(), arm.chain.moving_rows(), arm.chain.prismatic)]
    spread = np.ptp(state.q, axis=0)
    moving = [joint for joint in joints if spread[joint.number] > LEAST_SPREAD]
    single = [*_joint_covariates(state, moving), *_column_covariates(measurements, state, joints)]
    of_joints = [*_pair_and_time_covariates(state, moving), *_load_covariates(state, moving)]
    return [*single, *of_joints, _place(state), _scale(state)]


def _joint_covariates(state: State, joints: Sequence[Joint]) -> Iterator[Covariate]:
    """Each joint, which may shift the tip along the body before it, or change another's error."""
    for joint in joints:
        readings = state.q[:, joint.number]
        covariate = _covariate(joint.name, readings, [f"before {joint.row}"], state)
        if covariate is None:
            continue
        waves = [] if joint.slides else [Waves(joint.name, constant=True, order=k) for k in ORDERS]
        other_errors = [other.error for other in joints if other != joint]
        of_others = [Carried.of((wave,), error, state) for wave in waves for error in other_errors]
        variants = (*covariate.variants, *of_others)
        yield replace(covariate, variants=variants, values=joint.table(state))


def _column_covariates(
    measurements: Measurements, state: State, joints: Sequence[Joint]
) -> Iterator[Covariate]:
    """Each column of the file that may be a covariate, on the carriers that its entry allows; new
    records have only :data:`RECORDED` columns.
    """
    shifts_and_joints = ["room", "target", *(joint.error for joint in joints)]
    lengths = ["lengths", "tubes", *(f"tube {row}" for row in tubes(state.arm))]
    carriers = {"anywhere": [*shifts_and_joints, *lengths], "joints": shifts_and_joints}
    for column in measurements.covariate_columns():
        acts_on = carriers.get(column.entry.covariate)
        if acts_on is None:
            continue
        name = column.quantity
        recorded_state = state if name in RECORDED else None
        covariate = _covariate(name, column.values, acts_on, recorded_state)
        if covariate is not None:
            values = covariate.values.set_axis([column.name], axis=1)
            yield replace(covariate, values=values)


def _covariate(
    name: str, values: Iterable[object], carriers: Sequence[str], state: State | None
) -> Covariate | None:
    """A column of numbers or labels that may act on each of the carriers; with a ``state``, new
    records have its numbers too. None with one label, or too many.
    """
    numbers = as_numbers(values)
    if numbers is None:
        labels = pd.Series(values).astype(str)
        if not 2 <= labels.nunique() <= MOST_LABELS:
            return None
        dummies = _of_size_one(pd.get_dummies(labels, dtype=float).to_numpy())
        frame = ["frame"] if "lengths" in carriers else []
        variants = [Carried(dummies, carrier) for carrier in (*carriers, *frame)]
        return Covariate(name, (name,), tuple(variants), labels.to_frame(name))
    slow, quick = (Cosines.over(name, numbers, count) for count in SMOOTH)
    variants = [_cosines_on_carrier(slow, numbers, carrier, state) for carrier in carriers]
    if carriers[0] == "room" and len(numbers) > 3 * SMOOTH[1]:
        variants.append(_cosines_on_carrier(quick, numbers, "room", state))
    return Covariate(name, (name,), tuple(variants), numbers.astype(float).to_frame(name))


def _cosines_on_carrier(
    cosines: Cosines, numbers: pd.Series, carrier: str, state: State | None
) -> Carried:
    """Cosines on a carrier; the amplitude of ``cos kπp`` falls as 1/k (bounded variation)."""
    if state is None:
        carried = Carried(_of_size_one(cosines.of_values(numbers)), carrier)
    else:
        carried = Carried.of((cosines,), carrier, state)
    return replace(carried, decay=1.0 / np.maximum(np.arange(cosines.count + 1), 1.0))


def _pair_and_time_covariates(state: State, joints: Sequence[Joint]) -> Iterator[Covariate]:
    """Two joints: the error of either depends on the first orders of both angles; or a wave of a
    gear's order changes with the other angle, as by its load, and has a mean of zero over it: a
    wave that does not change is a cause. A joint and the time: its error depends on its angle and
    changes, as of an encoder that was knocked midway.
    """
    for pair in itertools.combinations(joints, 2):
        names = tuple(joint.name for joint in pair)
        first_orders = tuple(Waves(name, constant=True) for name in names)
        variants = [Carried.of(first_orders, joint.error, state) for joint in pair]
        for joint, other in (pair, reversed(pair)):
            variants += _gear_waves(joint, Waves.about_mean(other.name, state), state)
        values = pd.concat([joint.table(state) for joint in pair], axis=1)
        yield Covariate(" × ".join(names), names, tuple(variants), values)
    time = state.conditions.time
    if time is None or np.ptp(time) == 0.0:
        return
    of_time = Cosines.over("time", time, COSINES_OF_TIME)
    for joint in joints:
        carried = Carried.of((Waves(joint.name), of_time), joint.error, state)
        values = joint.table(state).assign(time_s=time)
        yield Covariate(f"{joint.name} × time", (joint.name, "time"), (carried,), values)


def _load_covariates(state: State, joints: Sequence[Joint]) -> Iterator[Covariate]:
    """The error of a gear depends on the part of the weight's moment on it that only other joints
    change.
    """
    if state.arm.masses is None:
        return
    for joint in joints:
        if joint.slides:
            continue
        change = Moment.beyond_own_angle(joint.name, state)
        if np.ptp(change.values(state)) < LEAST_MOMENT:
            continue
        load = f"moment {joint.row}"
        moment = Moment(joint.name).values(state)[:, 0]
        values = joint.table(state).assign(**{f"moment{joint.row}_nm": moment})
        yield Covariate(
            f"{joint.name} × {load}", (joint.name, load), _gear_waves(joint, change, state), values
        )


def _gear_waves(joint: Joint, change: Smooth, state: State) -> tuple[Carried, ...]:
    """The error of a joint's gear, whose waves change with something; none of a sliding joint."""
    orders = () if joint.slides else GEAR_ORDERS
    waves = [Waves(joint.name, order=order) for order in orders]
    return tuple(Carried.of((wave, change), joint.error, state) for wave in waves)


def _place(state: State) -> Covariate:
    """A field of shifts in the room, as by a table that bends or a tracker's own error: bumps
    around centres among the tips, more of them in a larger volume.
    """
    # Sorted, so that the order of the records does not matter.
    order = np.lexsort(np.round(state.q, DECIMALS).T)
    tips = state.position[order]
    cells = np.unique(np.round(tips / NARROWEST), axis=0)
    count = int(np.clip(len(cells) // 2, 1, CENTRES))
    rng = np.random.default_rng(count)
    centres, nearest = scipy.cluster.vq.kmeans2(tips, count, minit="++", rng=rng)
    squares = np.square(tips - centres[nearest]).sum(axis=1)
    spread = float(np.sqrt(squares.mean()))
    bump_centres = tuple((x, y, z) for x, y, z in centres.tolist())
    bumps = Bumps(bump_centres, max(1.5 * spread, NARROWEST))
    values = pd.DataFrame(state.position / MM, columns=["tip_x_mm", "tip_y_mm", "tip_z_mm"])
    carried = Carried.of((bumps,), "room", state)
    return Covariate("place", ("x", "y", "z"), (carried,), values)


def _scale(state: State) -> Covariate:
    """All lengths are wrong by one factor: a wrong unit, another reference temperature."""
    distance = np.linalg.norm(state.position, axis=1)
    carried = Carried.of((), "lengths", state)
    return Covariate("scale", ("scale",), (carried,), pd.DataFrame({"distance_mm": distance / MM}))


def _of_size_one(functions: Array) -> Array:
    """Functions (n, m), each divided by its root mean square."""
    return functions / _size(functions)


def _size(functions: Array) -> Array:
    """Root mean square of each function (n, m): (m,)."""
    squares = np.square(functions).mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(squares, 1e-12)))
