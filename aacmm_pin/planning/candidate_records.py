"""Records that could be taken: postures, free or at seats, with the conditions of a set-up."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG
from aacmm_pin.arm import Arm, Room, joint_bounds
from aacmm_pin.calibration import observations_of
from aacmm_pin.effects import CONDITION_ENTRIES, Conditions, State
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, Pool, probe_directions, seats_for
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.task import Task

TIME_STEP = 30.0
"""From one record to the next [s]."""
ANGLE_STEP = 0.1 * DEG
"""Step of free postures, for readable angles [rad]."""
NEW_SEATS = 8
"""Number of seats to plan if there are none."""
EACH = 40
"""Postures at each seat from which a plan chooses, at most."""


def free_postures(
    arm: Arm, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Random postures with the tip beside the stand and over the table, rounded for reading."""
    q, _ = Room(arm, above).postures(count, rng)
    steps = np.where(arm.chain.prismatic, 1e-4, ANGLE_STEP)
    rounded = np.round(q / steps) * steps
    low, high = joint_bounds(arm).T
    return Measurements.of(np.clip(rounded, low, high)).with_readings(arm)


def postures_at_seats(
    task: Task, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Postures at the seats of the existing records, else at new seats with planned coordinates.

    Raises:
        AacmmError: the tip reaches none of the seats.
    """
    pool = Pool.draw(task.model, above, EACH, rng)
    seats = _existing_seats(task) or _new_seats(task, pool, count, rng)
    touched = pool.touched(seats.points, max(4, min(EACH, count // len(seats.labels))))
    if not any(len(q) for q in touched):
        arm = task.model.arm.name
        number = len(seats.labels)
        raise AacmmError(
            f"{arm}: no posture within the limits reaches any of the {number} seats; expected one "
            "or more; check the coordinates of the seats, and the joint limits"
        )
    seat = np.repeat(np.arange(len(seats.labels)), [*map(len, touched)])
    labels = np.array(seats.labels, dtype=object)[seat]
    at = Conditions(len(seat), seat=labels)
    q = np.concatenate(touched)
    records = Measurements.of(q, seats.stated[seat], seats.stated_u[seat], at)
    return records.with_readings(task.model.arm)


class _Seats(NamedTuple):
    """Seats by their labels.

    Attributes:
        points: seats in the frame of the base (n, 3) [m].
        stated, stated_u: coordinates in the frame of the references, and u (n, 3) [m].
    """

    labels: list[str]
    points: Array
    stated: Array
    stated_u: Array


def _existing_seats(task: Task) -> _Seats | None:
    existing = task.existing
    if existing is None:
        return None
    observed = observations_of(existing, task.setup)
    tips = task.frame.apply(task.model.predict(existing.q, existing.conditions))
    points = task.frame.back(observed.start(tips))
    rows = existing.seats()
    # A probe cannot reach the centre of a sphere, and a plane is no point.
    reached = np.flatnonzero(~observed.surfaces)
    if not reached.size:
        return None
    labels = [observed.labels[k] for k in reached]
    first = [rows[label][0] for label in labels]
    return _Seats(labels, points[reached], existing.reference[first], existing.reference_u[first])


def _new_seats(task: Task, pool: Pool, count: int, rng: np.random.Generator) -> _Seats:
    postures = max(4, min(EACH, count // NEW_SEATS))
    places = seats_for(pool, NEW_SEATS, postures, rng)
    labels = [f"P{k}" for k in range(1, len(places) + 1)]
    points = np.concatenate([place.points for place in places])
    unknown = np.full_like(points, np.nan)
    return _Seats(labels, points, task.frame.apply(points), unknown)


def candidates(
    task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
) -> Measurements:
    """The records that could be taken in a set-up, with expected coordinates and random free
    conditions.
    """
    conditions = _conditions(task, set_up, postures, rng)
    if postures.conditions.seat is not None:
        return replace(postures, conditions=conditions)
    expected = task.frame.apply(set_up.model.predict(postures.q, conditions))
    return replace(postures, reference=expected, conditions=conditions)


def _conditions(
    task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
) -> Conditions:
    """The conditions that the causes or the existing records need; free ones are random."""
    arm = set_up.model.arm
    n = postures.n
    known = task.conditions
    effects = (*task.causes, *set_up.model.effects)
    needed = {need for effect in effects for need in effect.needs}
    present = needed | set(known.present)
    links = known.link_temperature
    warmth = task.temperature + set_up.warmer * rng.integers(2, size=n).astype(np.float64)
    sides = np.ones((n, arm.nq))
    for joint in set_up.sides:
        sides[:, joint - 1] = rng.choice([-1.0, 1.0], size=n)
    time = _times(known, set_up, n, rng)
    chosen: dict[str, Any] = {"seat": postures.conditions.seat}
    if known.marker is not None:  # the first of the existing records
        first = next((label for label in known.marker if label), "")
        chosen["marker"] = np.full(n, first, dtype=object)
    for name in known.present:
        if CONDITION_ENTRIES[name].usual is not None:  # of the last existing record
            chosen[name] = np.repeat(getattr(known, name)[-1:], n, axis=0)
    if "time" in present:
        chosen["time"] = time
    if links is not None:
        chosen["link_temperature"] = np.repeat(warmth[:, None], links.shape[1], axis=1)
    elif present & {"temperature", "link_temperature"}:
        chosen["temperature"] = warmth
    if "approach" in present:
        chosen["approach"] = sides
    if "torque" in needed:
        chosen["torque"] = _torques(arm, postures.q, Conditions(n, **chosen))
    if "probe_direction" in needed:
        chosen["probe_direction"] = probe_directions(n, rng.spawn(1)[0])
    if chosen["seat"] is None and "seat" in needed:
        chosen["seat"] = np.full(n, "", dtype=object)
    return Conditions(n, **chosen).with_usual(needed, arm.nq)


def _times(
    known: Conditions, set_up: MeasurementConditions, n: int, rng: np.random.Generator
) -> Array:
    """Times of planned records (n,) [s]: during a warm-up, or after the existing records."""
    if set_up.warm_up:
        return rng.uniform(0.0, set_up.warm_up, size=n)
    after = 0.0 if known.time is None else float(known.time.max()) + TIME_STEP
    return np.full(n, after)


def _torques(arm: Arm, q: Array, conditions: Conditions) -> Array:
    """Torques of drives that hold the weight (n, nq) [N·m]: minus its moment about each axis."""
    state = State(arm, q, conditions, arm.chain.tip)
    rows = arm.chain.moving_rows()
    moments = [state.along_axis(row, state.moment_at_axis(row)) for row in rows]
    return -np.stack(moments, axis=1)
