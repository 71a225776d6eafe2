"""Records that could be taken."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from aacmm_pin._support.units import DEG
from aacmm_pin.arm import Arm, Room, joint_bounds
from aacmm_pin.calibration import observations_of
from aacmm_pin.effects import CONDITION_ENTRIES, Conditions, State
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, Pool, probe_directions, seats_for
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.task import Task

TIME_STEP = 30.0
"""Between records [s]."""
ANGLE_STEP = 0.1 * DEG
"""Of free postures, for readable angles [rad]."""
NEW_SEATS = 8
EACH = 40
"""Postures at each seat from which a plan chooses."""


def free_postures(
    arm: Arm, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Random postures with the tip in the room, rounded for reading."""
    q, _ = Room(arm, above).postures(count, rng)
    steps = np.where(arm.chain.prismatic, 1e-4, ANGLE_STEP)
    rounded = np.round(q / steps) * steps
    low, high = joint_bounds(arm).T
    return Measurements.of(np.clip(rounded, low, high)).with_readings(arm)


def postures_at_seats(
    task: Task, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Postures at the existing seats, else at new ones with planned coordinates."""
    pool = Pool.draw(task.model, above, EACH, rng)
    existing = task.existing
    observed = None if existing is None else observations_of(existing, task.setup)
    # A probe cannot reach the centre of a sphere, and a plane is no point.
    if existing is None or observed is None or observed.surfaces.all():
        places = seats_for(pool, NEW_SEATS, max(4, min(EACH, count // NEW_SEATS)), rng)
        labels = [f"P{k}" for k in range(1, len(places) + 1)]
        points = np.concatenate([place.points for place in places])
        stated = task.frame.apply(points)
        stated_u = np.full_like(points, np.nan)
    else:
        tips = task.frame.apply(task.model.predict(existing.q, existing.conditions))
        no_surface = np.flatnonzero(~observed.surfaces)
        points = task.frame.back(observed.first_seats(tips))[no_surface]
        labels = [observed.labels[k] for k in no_surface]
        rows = existing.seats()
        first_row = [rows[label][0] for label in labels]
        stated, stated_u = existing.reference[first_row], existing.reference_u[first_row]
    postures = pool.postures_at(points, max(4, min(EACH, count // len(labels))))
    if not any(len(q) for q in postures):
        raise AacmmError(
            f"{task.model.arm.name}: no posture within the limits reaches any of the "
            f"{len(labels)} seats; expected one or more; check the coordinates of the seats, and "
            "the joint limits"
        )
    seat = np.repeat(np.arange(len(labels)), [*map(len, postures)])
    conditions = Conditions(len(seat), seat=np.array(labels, dtype=object)[seat])
    q = np.concatenate(postures)
    records = Measurements.of(q, stated[seat], stated_u[seat], conditions)
    return records.with_readings(task.model.arm)


def candidates(
    task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
) -> Measurements:
    """Records that could be taken in a set-up, with expected coordinates and random free
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
    """Those free in the set-up at random, others as before."""
    arm = set_up.model.arm
    n = postures.n
    existing = task.conditions
    effects = (*task.causes, *set_up.model.effects)
    needed = {need for effect in effects for need in effect.needs}
    present = needed | set(existing.present)
    link_temperature = existing.link_temperature
    is_warmer = rng.integers(2, size=n).astype(np.float64)
    temperature = task.temperature + set_up.warmer * is_warmer
    approach = np.ones((n, arm.nq))
    for joint in set_up.sides:
        approach[:, joint - 1] = rng.choice([-1.0, 1.0], size=n)
    chosen: dict[str, Any] = {"seat": postures.conditions.seat}
    if existing.marker is not None:  # the first of the existing records
        first = next((label for label in existing.marker if label), "")
        chosen["marker"] = np.full(n, first, dtype=object)
    for name in existing.present:
        if CONDITION_ENTRIES[name].usual is not None:  # of the last existing record
            chosen[name] = np.repeat(getattr(existing, name)[-1:], n, axis=0)
    if "time" in present and set_up.warm_up:
        chosen["time"] = rng.uniform(0.0, set_up.warm_up, size=n)
    elif "time" in present:  # after the existing records
        time = 0.0 if existing.time is None else float(existing.time.max()) + TIME_STEP
        chosen["time"] = np.full(n, time)
    if link_temperature is not None:
        links = link_temperature.shape[1]
        chosen["link_temperature"] = np.repeat(temperature[:, None], links, axis=1)
    elif present & {"temperature", "link_temperature"}:
        chosen["temperature"] = temperature
    if "approach" in present:
        chosen["approach"] = approach
    if "torque" in needed:
        state = State(arm, postures.q, Conditions(n, **chosen), arm.chain.tip)
        rows = arm.chain.moving_rows()
        moments = [state.along_axis(row, state.moment_at_axis(row)) for row in rows]
        chosen["torque"] = -np.stack(moments, axis=1)  # of drives that hold the weight
    if "probe_direction" in needed:
        chosen["probe_direction"] = probe_directions(n, rng.spawn(1)[0])
    if chosen["seat"] is None and "seat" in needed:
        chosen["seat"] = np.full(n, "", dtype=object)
    return Conditions(n, **chosen).with_usual(needed, arm.nq)
