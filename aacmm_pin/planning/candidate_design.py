"""One set-up with its pool of records, and the information of a choice from it together with the
existing records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.calibration import (
    Frame,
    NoiseModel,
    ParameterVector,
    Problem,
    Scatters,
    observations_of,
    remaining_triangle,
    seat_columns,
)
from aacmm_pin.effects import Effect
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.candidate_records import candidates
from aacmm_pin.planning.detection_power import Power, Size, power_of
from aacmm_pin.planning.measurement_conditions import MeasurementConditions
from aacmm_pin.planning.task import Task

LOOSE = 1e-6
"""Prior information of an unknown cause: it is within a thousand times its typical magnitude."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns of the unknowns: first the parameters of every fit, then three for each seat, then
    the causes.

    Attributes:
        order: numbers of the columns in the problem's Jacobian: geometry, target and frame, then
            the causes.
        scales: unit of each of these: prior u of a parameter; typical magnitude of a cause.
        refitted: how many of them are not causes.
        seats: labels of the seats.
        blocks: which columns each cause has, counted from the first of the causes.
    """

    order: Index
    scales: Array
    refitted: int
    seats: tuple[str, ...]
    blocks: tuple[slice, ...]

    @staticmethod
    def of(problem: Problem, causes: tuple[Effect, ...], seats: tuple[str, ...]) -> Layout:
        """The columns of a problem whose last effects are the ``causes``."""
        vector = ParameterVector(problem.model.arm, causes)
        stop = problem.vector.size
        total = len(problem.scales)
        start = stop - vector.size
        refitted = np.r_[:start, stop:total]
        order = np.r_[refitted, start:stop]
        scales = np.r_[problem.scales[refitted], vector.typical]
        return Layout(order, scales, refitted.size, seats, vector.slices)

    @property
    def nuisances(self) -> int:
        """Number of columns that are refitted, the seats' included."""
        return self.refitted + 3 * len(self.seats)

    @property
    def width(self) -> int:
        """Number of all columns."""
        return self.order.size + 3 * len(self.seats)

    def columns(self, cause: int) -> Index:
        """The columns of one cause."""
        of_causes = np.arange(self.nuisances, self.width)
        return of_causes[self.blocks[cause]]

    def seat_columns(self, columns: Array, labels: Sequence[str]) -> Array:
        """Columns by seats of certain ``labels`` (…, s, 3) as those of all seats (…, 3 seats)."""
        shape = columns.shape[:-2]
        places = [self.seats.index(label) for label in labels]
        found = np.zeros((*shape, len(self.seats), 3))
        found[..., places, :] = columns
        return found.reshape(*shape, 3 * len(self.seats))


@dataclass(frozen=True, eq=False)
class Situation:
    """A set-up and its pool.

    Attributes:
        set_up: how the arm stands.
        pool: records that could be taken.
        layout: the unknowns.
        known: rows of what is there already: priors, stated seats, existing records (m, width).
        rows: whitened, of each record of the pool (n, 3, width).
        before: number of existing records among the known rows.
    """

    set_up: MeasurementConditions
    pool: Measurements
    layout: Layout
    known: Array
    rows: Array
    before: int

    @staticmethod
    def of(
        task: Task, set_up: MeasurementConditions, postures: Measurements, rng: np.random.Generator
    ) -> Situation:
        """The rows of everything in this set-up; another arm file is measured and judged by
        itself.
        """
        existing = None if set_up.changes_arm else task.existing
        pool = candidates(task, set_up, postures, rng)
        old = () if existing is None else observations_of(existing, task.setup).labels
        seats = {*old, *observations_of(pool, task.setup).labels}
        problem = task.problem(set_up.model, pool if existing is None else existing)
        layout = Layout.of(problem, task.causes, tuple(sorted(seats)))
        # Of what is refitted, its prior; seats are within a metre.
        known = [np.eye(layout.nuisances, layout.width)]
        if existing is not None:
            measured, ties = rows_of(problem, layout, task.frame)
            known += [measured.reshape(-1, layout.width), ties]
        rows, ties = rows_of(problem.of(pool), layout, task.frame, old)
        return Situation(
            set_up,
            pool,
            layout,
            np.vstack([*known, ties]),
            rows,
            0 if existing is None else existing.n,
        )

    @property
    def start(self) -> Array:
        """Information of what is known, with next to nothing about each cause (width, width)."""
        causes = np.zeros(self.layout.width)
        causes[self.layout.nuisances :] = LOOSE
        return self.known.T @ self.known + np.diag(causes)

    def power(
        self,
        chosen: list[int] | None,
        pair: tuple[int, int],
        sizes: tuple[Size, Size],
        draws: int,
        times: float = 1.0,
    ) -> Power:
        """How well a choice distinguishes two of the causes; with the same ``draws``, probabilities
        differ only by the records.
        """
        one, other = pair
        blocks = self.layout.blocks[one], self.layout.blocks[other]
        triangle = self.triangle(chosen, times)
        return power_of(triangle, blocks, sizes, np.random.default_rng(draws))

    def triangle(self, chosen: list[int] | None, times: float = 1.0) -> Array:
        """Information of a choice (None: the whole pool), taken so many ``times``, about the
        causes, with all other parameters refitted: R with ``S = RᵀR``.
        """
        records = self.rows if chosen is None else self.rows[chosen]
        rows = np.sqrt(times) * records.reshape(-1, self.layout.width)
        every = np.vstack([self.known, rows])
        return remaining_triangle(every, self.layout.nuisances)


def rows_of(
    problem: Problem, layout: Layout, frame: Frame, stated: tuple[str, ...] = ()
) -> tuple[Array, Array]:
    """Whitened derivatives of each of the problem's records (n, 3, width), zero where it has no
    target; and of what is stated of seats and bars (t, width), but for seats whose coordinates are
    ``stated`` elsewhere; ``frame`` is the base's.
    """
    prediction = problem.predict(problem.start, frame)
    noise = NoiseModel.of(problem, problem.start, frame, Scatters())
    observations = noise.observations
    labels = observations.labels
    whitening = noise.whitening * observations.has_target[:, None, None]
    jacobian = prediction.jacobian[:, :, layout.order] * layout.scales
    refitted, causes = np.split(whitening @ jacobian, [layout.refitted], axis=2)
    start = observations.start(prediction.tips)
    of_records, of_seats, of_bars = seat_columns(
        observations, start, observations.by_seats(whitening)
    )
    seats = layout.seat_columns(of_records, labels)
    rows = np.concatenate([refitted, seats, causes], axis=2)
    new = np.array([label not in stated for label in labels], dtype=bool)
    own_seats = of_seats[observations.known & new]
    own_bars = of_bars[new[observations.ends].any(axis=1)]
    ties = layout.seat_columns(np.concatenate([*own_seats, own_bars]), labels)
    around = (layout.refitted, causes.shape[2])
    return rows, np.pad(ties, ((0, 0), around))
