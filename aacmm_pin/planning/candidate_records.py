"""Records that could be taken: postures inside the limits, at seats or free, with the conditions of a set-up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import axis
from aacmm_pin.arm.random_postures import Room, joint_bounds
from aacmm_pin.calibration.noise_model import observations_of
from aacmm_pin.calibration.problem import Frame
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions, Labels
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.plans import Pool, seats_for
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.measurement_conditions import MeasurementConditions

STEP = 30.0
"""From one record to the next [s]."""
ROUND = 0.1 * DEG
"""Free postures are planned in steps of this, so that people can read them [rad]."""
SEATS = 8
"""Seats that are planned where there are none yet."""
EACH = 40
"""Postures at each seat from which a plan chooses, at most."""


@dataclass(frozen=True, eq=False)
class Postures:
    """Postures to choose from.

    Attributes:
        q: (n, nq) [rad].
        seat: label of the seat that the tip is at (n,), or None for free postures.
        stated: coordinates of that seat where they are stated (n, 3), NaN where not [m].
        stated_u: their standard uncertainty (n, 3) [m].
    """

    q: Array
    seat: Labels | None
    stated: Array
    stated_u: Array

    @staticmethod
    def free(arm: Arm, count: int, above: float | None, rng: np.random.Generator) -> Postures:
        """Random postures beside the stand, over the table."""
        q, _ = Room(arm, above).postures(count, rng)
        bounds = joint_bounds(arm)
        steps = np.where(arm.chain.prismatic, 1e-4, ROUND)
        q = np.clip(np.round(q / steps) * steps, bounds[:, 0], bounds[:, 1])
        return Postures(q, None, np.full((count, 3), np.nan), np.full((count, 3), np.nan))

    @staticmethod
    def at_seats(
        model: ErrorModel,
        count: int,
        above: float | None,
        existing: Measurements | None,
        frame: Frame,
        setup: Setup,
        rng: np.random.Generator,
    ) -> Postures:
        """Postures at the seats that were touched before, else at new ones whose coordinates will be stated.

        Raises:
            AacmmError: the seats cannot be touched in different postures.
        """
        steady = ErrorModel(model.arm, tuple(effect for effect in model.effects if not effect.needs))
        here = Pool.draw(Room(model.arm, above), lambda q, _: steady.state(q), EACH, rng)
        nothing = np.full(3, np.nan)
        seats: dict[str, tuple[Array, Array, Array]] = {}
        if existing is not None:
            tips = frame.apply(model.predict(existing.q, existing.conditions))
            known = observations_of(existing, setup, 0.0)
            for label, point in zip(known.labels, frame.back(known.start(tips)), strict=True):
                first = existing.seats()[label][0]
                seats[label] = (point, existing.reference[first], existing.reference_u[first])
        if not seats:
            each = max(4, min(EACH, count // SEATS))
            found = seats_for(here, SEATS, each, rng)
            seats = {f"P{k}": (place.points[0], place.points[0], nothing) for k, place in enumerate(found, start=1)}
        each = max(4, min(EACH, count // len(seats)))
        points = np.stack([place for place, _, _ in seats.values()])
        touched = here.touched(points, each)
        if not any(len(q) for q in touched):
            raise AacmmError(f"{model.arm.name}: no posture inside the limits has its tip at one of the {len(seats)} seats")
        numbers = [len(q) for q in touched]
        return Postures(
            np.concatenate(touched),
            np.repeat(np.array(list(seats), dtype=object), numbers),
            np.repeat([stated for _, stated, _ in seats.values()], numbers, axis=0),
            np.repeat([u for _, _, u in seats.values()], numbers, axis=0),
        )


def candidates(
    postures: Postures,
    set_up: MeasurementConditions,
    causes: tuple[Effect, ...],
    existing: Measurements | None,
    rng: np.random.Generator,
) -> Measurements:
    """The records that could be taken in a set-up, with the coordinates that are expected; free conditions are drawn."""
    model, n = set_up.model, len(postures.q)
    needed = {need for effect in (*causes, *model.effects) for need in effect.needs}
    known = None if existing is None else existing.conditions
    present = needed | (set() if known is None else set(known.present))
    links = known is not None and known.link_temperature is not None
    warmth: Array = _base_temperature(model.arm, known) + set_up.warmer * rng.integers(2, size=n).astype(np.float64)
    sides = np.ones((n, model.arm.nq))
    for joint in set_up.sides:
        sides[:, joint - 1] = rng.choice([-1.0, 1.0], size=n)
    after = 0.0 if known is None or known.time is None else float(known.time.max()) + STEP
    time = rng.uniform(0.0, set_up.warm_up, size=n) if set_up.warm_up else np.full(n, after)
    marker = None if known is None or known.marker is None else next((m for m in known.marker if m), "")
    conditions = Conditions(
        n,
        time=time if "time" in present else None,
        temperature=warmth if present & {"temperature", "link_temperature"} and not links else None,
        link_temperature=np.repeat(warmth[:, None], known.link_temperature.shape[1], axis=1)
        if known is not None and known.link_temperature is not None
        else None,
        approach=sides if "approach" in present else None,
        torque=_torques(model.arm, postures.q) if "torque" in needed else None,
        seat=postures.seat,
        marker=None if marker is None else np.full(n, marker, dtype=object),
    )
    expected = postures.stated if postures.seat is not None else model.predict(postures.q, conditions)
    u = postures.stated_u if np.isfinite(postures.stated_u).any() else None
    return Measurements.of(postures.q, expected, u, conditions)


def base_temperature(arm: Arm, existing: Measurements | None) -> float:
    """What the arm was at so far; its reference temperature where nobody says [°C]."""
    return _base_temperature(arm, None if existing is None else existing.conditions)


def _base_temperature(arm: Arm, known: Conditions | None) -> float:
    for values in () if known is None else (known.temperature, known.link_temperature):
        if values is not None:
            return float(np.round(values.mean(), 1))
    return arm.reference_temperature


def _torques(arm: Arm, q: Array) -> Array:
    """Torques that a drive would need to hold the weight (n, nq) [N·m]: minus the weight's moment about each axis."""
    state = State(arm, q, Conditions(len(q)), arm.chain.tip)
    found = [
        np.einsum("ni,ni->n", state.moment_at_axis(r), state.rotation[axis(r)][:, :, 2]) for r in arm.chain.moving_rows()
    ]
    return -np.stack(found, axis=1)
