"""Records that could be taken: postures inside the limits, at seats or free, with the conditions of
a set-up.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.random_postures import Room, joint_bounds
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.effects import Conditions, State
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.measuring_points import Pool, seats_for
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.task import Task

STEP = 30.0
"""From one record to the next [s]."""
ROUND = 0.1 * DEG
"""Free postures are planned in steps of this, so that people can read them [rad]."""
SEATS = 8
"""Seats that are planned where there are none yet."""
EACH = 40
"""Postures at each seat from which a plan chooses, at most."""


def free_postures(
    arm: Arm, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Random postures beside the stand, over the table."""
    q, _ = Room(arm, above).postures(count, rng)
    bounds, steps = joint_bounds(arm), np.where(arm.chain.prismatic, 1e-4, ROUND)
    return Measurements.of(np.clip(np.round(q / steps) * steps, bounds[:, 0], bounds[:, 1]))


def postures_at_seats(
    task: Task, count: int, above: float | None, rng: np.random.Generator
) -> Measurements:
    """Postures at the seats that were touched before, else at new ones whose coordinates will be
    stated.

    Raises:
        AacmmError: the seats cannot be touched in different postures.
    """
    pool = Pool.draw(task.model, above, EACH, rng)
    existing, labels = task.existing, []
    if existing is not None:
        observed = observations_of(existing, task.setup)
        labels = list(observed.labels)
        tips = task.frame.apply(task.model.predict(existing.q, existing.conditions))
        points = task.frame.back(observed.start(tips))
        first = [existing.seats()[label][0] for label in labels]
        stated, stated_u = existing.reference[first], existing.reference_u[first]
    if not labels:
        places = seats_for(pool, SEATS, max(4, min(EACH, count // SEATS)), rng)
        labels = [f"P{k}" for k in range(1, len(places) + 1)]
        points = np.concatenate([place.points for place in places])
        stated, stated_u = task.frame.apply(points), np.full_like(points, np.nan)
    touched = pool.touched(points, max(4, min(EACH, count // len(labels))))
    if not any(len(q) for q in touched):
        arm = task.model.arm.name
        raise AacmmError(
            f"{arm}: no posture inside the limits has its tip at one of the {len(labels)} seats"
        )
    seat = np.repeat(np.arange(len(labels)), [len(q) for q in touched])
    at = Conditions(len(seat), seat=np.array(labels, dtype=object)[seat])
    return Measurements.of(np.concatenate(touched), stated[seat], stated_u[seat], at)


def candidates(
    task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
) -> Measurements:
    """The records that could be taken in a set-up, with the coordinates that are expected; free
    conditions are drawn.
    """
    model, n, known = set_up.model, postures.n, task.conditions
    needed = {need for effect in (*task.causes, *model.effects) for need in effect.needs}
    present, links = needed | set(known.present), known.link_temperature
    warmth = task.temperature + set_up.warmer * rng.integers(2, size=n).astype(np.float64)
    sides = np.ones((n, model.arm.nq))
    for joint in set_up.sides:
        sides[:, joint - 1] = rng.choice([-1.0, 1.0], size=n)
    after = 0.0 if known.time is None else float(known.time.max()) + STEP
    time = rng.uniform(0.0, set_up.warm_up, size=n) if set_up.warm_up else np.full(n, after)
    marker = None if known.marker is None else next((m for m in known.marker if m), "")
    at_none = np.full(n, "", dtype=object) if "seat" in needed else None
    conditions = Conditions(
        n,
        time=time if "time" in present else None,
        temperature=warmth
        if links is None and present & {"temperature", "link_temperature"}
        else None,
        link_temperature=None
        if links is None
        else np.repeat(warmth[:, None], links.shape[1], axis=1),
        approach=sides if "approach" in present else None,
        torque=_torques(model.arm, postures.q) if "torque" in needed else None,
        seat=at_none if postures.conditions.seat is None else postures.conditions.seat,
        marker=None if marker is None else np.full(n, marker, dtype=object),
    )
    if postures.conditions.seat is not None:
        return replace(postures, conditions=conditions)
    expected = task.frame.apply(model.predict(postures.q, conditions))
    return replace(postures, reference=expected, conditions=conditions)


def _torques(arm: Arm, q: Array) -> Array:
    """Torques that a drive would need to hold the weight (n, nq) [N·m]: minus the weight's moment
    about each axis.
    """
    state = State(arm, q, Conditions(len(q)), arm.chain.tip)
    return -np.stack(
        [state.along_axis(row, state.moment_at_axis(row)) for row in arm.chain.moving_rows()],
        axis=1,
    )
