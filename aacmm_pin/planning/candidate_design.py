"""One set-up with its pool, and the information of chosen and existing records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.calibration import (
    Frame,
    NoiseModel,
    ParameterVector,
    Problem,
    Scatters,
    observations_of,
    remaining_triangle,
)
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.candidate_records import candidates
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.separability import Pair, Power, Separation, power_of
from aacmm_pin.planning.task import Task


@dataclass(frozen=True, eq=False)
class Situation:
    """A set-up and its pool, as rows linear in the unknowns.

    Columns: parameters of every fit, three for each seat, causes.

    Attributes:
        pool: records that could be taken.
        scales: unit of each parameter, its prior u.
        nuisances: columns before those of causes.
        blocks: columns of each cause, from the first cause on.
        known: priors, stated seats and existing records (m, width).
        rows: whitened, of the pool (n, 3, width).
        before: existing records among the known rows.
    """

    set_up: MeasurementConditions
    pool: Measurements
    scales: Array
    nuisances: int
    blocks: tuple[slice, ...]
    known: Array
    rows: Array
    before: int

    @staticmethod
    def of(
        task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
    ) -> Situation:
        """Existing records do not count if the set-up changes the arm file."""
        existing = None if set_up.changes_arm else task.existing
        pool = candidates(task, set_up, postures, rng)
        old_seats = () if existing is None else observations_of(existing, task.setup).labels
        seats = sorted({*old_seats, *observations_of(pool, task.setup).labels})
        problem = task.problem(set_up.model, pool if existing is None else existing)
        causes = ParameterVector(problem.model.arm, task.causes)
        of_causes = np.arange(problem.vector.size - causes.size, problem.vector.size)
        scales = problem.scales
        scales[of_causes] = causes.typical
        nuisances = np.delete(np.arange(scales.size + 3 * len(seats)), of_causes)
        order = np.r_[nuisances, of_causes]
        # Of what is refitted, its prior; seats are within a metre.
        prior = np.eye(nuisances.size, order.size)
        known_rows = [prior]
        if existing is not None:
            measured, ties = whitened_rows(problem, scales, seats, task.frame)
            known_rows += [measured.reshape(-1, order.size)[:, order], ties[:, order]]
        rows, ties = whitened_rows(problem.of(pool), scales, seats, task.frame, old_seats)
        return Situation(
            set_up,
            pool,
            np.delete(scales, of_causes),
            nuisances.size,
            causes.slices,
            np.vstack([*known_rows, ties[:, order]]),
            rows[:, :, order],
            0 if existing is None else existing.n,
        )

    @property
    def information(self) -> Array:
        """(width, width)."""
        return self.known.T @ self.known

    def power(
        self, chosen: list[int] | None, pair: Pair, sizes: Sequence[Array], times: float = 1.0
    ) -> Power:
        """How well a choice distinguishes two causes."""
        blocks = [self.blocks[cause] for cause in pair]
        return power_of(self.triangle(chosen, times), blocks, [sizes[cause] for cause in pair])

    def separation(self, chosen: list[int] | None, sizes: Sequence[Array]) -> Separation:
        """How far a choice separates all causes."""
        return Separation.of(self.triangle(chosen), self.blocks, sizes)

    def triangle(self, chosen: list[int] | None, times: float = 1.0) -> Array:
        """R of the information ``S = RᵀR`` about the causes, all else refitted.

        The chosen records (None: the whole pool) are each taken ``times``.
        """
        records = self.rows if chosen is None else self.rows[chosen]
        rows = np.sqrt(times) * records.reshape(-1, records.shape[2])
        return remaining_triangle(np.vstack([self.known, rows]), self.nuisances)


def whitened_rows(
    problem: Problem, scales: Array, seats: list[str], frame: Frame, stated: tuple[str, ...] = ()
) -> tuple[Array, Array]:
    """Whitened derivatives of records, and those of ties: stated seats, and relations of seats.

    Args:
        problem, scales: records, and unit of each parameter.
        seats: labels whose columns are the last.
        frame: base in the frame of the references.
        stated: seats stated elsewhere, without row here.

    Returns:
        (n, 3, width), zero for a record without target; and (t, width).
    """
    prediction = problem.predict(problem.start, frame)
    noise = NoiseModel.of(problem, problem.start, frame, Scatters())
    observations = noise.observations
    labels = observations.labels
    whitening = noise.whitening * observations.has_target[:, None, None]
    width = scales.size + 3 * len(seats)
    unit = np.eye(width)
    of_seat = [scales.size + 3 * seats.index(label) + np.arange(3) for label in labels]
    rows = np.zeros((problem.measurements.n, 3, width))
    rows[:, :, : scales.size] = whitening @ (prediction.jacobian * scales)
    by_seat = observations.seat_derivatives(whitening)
    for record in np.flatnonzero(observations.seat >= 0):
        rows[record][:, of_seat[observations.seat[record]]] = by_seat[record]
    is_new = np.array([label not in stated for label in labels], dtype=bool)
    ties = [np.zeros((0, width))]
    for seat in np.flatnonzero(observations.is_stated & is_new):
        ties.append(unit[of_seat[seat]] / observations.stated_u[seat][:, None])
    _, by_ends = observations.relation_residuals(observations.first_seats(prediction.tips))
    for (one, other), by_both in zip(observations.ends, by_ends, strict=True):
        if is_new[one] or is_new[other]:
            ties.append(by_both[:1] @ unit[of_seat[one]] + by_both[1:] @ unit[of_seat[other]])
    return rows, np.concatenate(ties)
