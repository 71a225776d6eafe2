"""One set-up with its pool of records, and what a choice from it would tell together with the records that exist."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.calibration.noise_model import NoiseModel, observations_of
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.effects import Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.observations import Observations
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.candidate_records import Postures, candidates
from aacmm_pin.planning.detection_power import Power, Size, power_of, triangle
from aacmm_pin.planning.measurement_conditions import MeasurementConditions

SEAT_WIDTH = 1.0
"""A seat of unknown place is anywhere within this [m]."""
LOOSE = 1e-6
"""A cause of which nobody knows anything is within a thousand times its typical size: information in that unit."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What a plan is for.

    Attributes:
        model: the arm.
        causes: causes to tell apart, all parameters zero.
        existing: records that will be judged together with the new ones.
        setup: how records are taken; the noise of readings, references, contacts is complete.
    """

    model: ErrorModel
    causes: tuple[Effect, ...]
    existing: Measurements | None
    setup: Setup

    def problem(self, model: ErrorModel, records: Measurements) -> Problem:
        """Geometry and the causes unknown; effects of the model that are no such causes stay."""
        asked = {effect.identity for effect in self.causes}
        rest = ErrorModel(model.arm, tuple(e for e in model.effects if e.identity not in asked))
        return problem_of(rest, records, ["geometry", *self.causes], self.setup)

    @cached_property
    def frame(self) -> Frame:
        """Where the base is in the frame of the references, as far as the existing records say."""
        if not self.setup.external or self.existing is None or self.existing.known.sum() < 3:
            return Frame.identity()
        known = self.existing.take(self.existing.known)
        return registered(self.model.predict(known.q, known.conditions), known.reference)


@dataclass(frozen=True, eq=False)
class Layout:
    """Which column stands for what: first what is refitted anyway, then the causes.

    Attributes:
        refitted: parameters of geometry, target and frame, the numbers of their columns in the problem's Jacobian.
        of_causes: the same of the causes.
        scales: what one unit of each of these columns is, refitted first: how far off it may be; typical size of a cause.
        seats: labels of the seats, each of which has three columns between the two.
        blocks: which columns each cause has, counted from the first of the causes.
    """

    refitted: Index
    of_causes: Index
    scales: Array
    seats: tuple[str, ...]
    blocks: tuple[slice, ...]

    @staticmethod
    def of(problem: Problem, causes: tuple[Effect, ...], seats: tuple[str, ...]) -> Layout:
        """The columns of a problem whose last effects are the ``causes``."""
        vector = ParameterVector(problem.model.arm, causes)
        stop, total = problem.vector.size, len(problem.scales)
        first = stop - vector.size
        refitted = np.concatenate([np.arange(first), np.arange(stop, total)])
        scales = np.concatenate([problem.scales[refitted], vector.typical])
        return Layout(refitted, np.arange(first, stop), scales, seats, vector.slices)

    @property
    def nuisances(self) -> int:
        """Number of columns that are refitted, the seats' included."""
        return self.refitted.size + 3 * len(self.seats)

    @property
    def width(self) -> int:
        """Number of all columns."""
        return self.nuisances + self.of_causes.size


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
    def of(asked: Asked, set_up: MeasurementConditions, postures: Postures, rng: np.random.Generator) -> Situation:
        """The rows of everything in this set-up; another arm file is measured and judged by itself."""
        existing = None if set_up.changes_arm else asked.existing
        pool = candidates(postures, set_up, asked.causes, asked.existing, rng)
        first = asked.problem(set_up.model, pool if existing is None else existing)
        seats = _labels(pool, asked.setup) | (set() if existing is None else _labels(existing, asked.setup))
        layout = Layout.of(first, asked.causes, tuple(sorted(seats)))
        known = [np.eye(layout.nuisances, layout.width)]  # of what is refitted, its prior
        stated: tuple[str, ...] = ()
        if existing is not None:
            old, ties = rows_of(first, layout, asked.frame)
            known += [old.reshape(-1, layout.width), ties]
            stated = tuple(_labels(existing, asked.setup))
        if asked.setup.external and postures.seat is None:
            pool = replace(pool, reference=asked.frame.apply(pool.reference))
        rows, ties = rows_of(first.of(pool), layout, asked.frame, stated)
        return Situation(set_up, pool, layout, np.vstack([*known, ties]), rows, 0 if existing is None else existing.n)

    @property
    def start(self) -> Array:
        """Information of what is known, with next to nothing about each cause (width, width)."""
        causes = np.zeros(self.layout.width)
        causes[self.layout.nuisances :] = LOOSE
        return np.asarray(self.known.T @ self.known + np.diag(causes))

    def power(
        self, chosen: list[int] | None, pair: tuple[int, int], sizes: tuple[Size, Size], draws: int, times: float = 1.0
    ) -> Power:
        """How well a choice tells two of the causes apart; the same ``draws`` make odds differ by what is measured alone."""
        one, other = (self.layout.blocks[k] for k in pair)
        return power_of(self.triangle(chosen, times), one, other, sizes, np.random.default_rng(draws))

    def triangle(self, chosen: list[int] | None, times: float = 1.0) -> Array:
        """What a choice (None: the whole pool), taken so many ``times``, tells of the causes, see ``triangle``."""
        new = np.sqrt(times) * (self.rows if chosen is None else self.rows[chosen])
        return triangle(np.vstack([self.known, new.reshape(-1, self.layout.width)]), self.layout.nuisances)


def _labels(records: Measurements, setup: Setup) -> set[str]:
    return set(observations_of(records, setup, 0.0).labels)


def rows_of(problem: Problem, layout: Layout, frame: Frame, stated: tuple[str, ...] = ()) -> tuple[Array, Array]:
    """Whitened derivatives of each of the problem's records (n, 3, width), zero where it says nothing; and of what is stated
    of seats and bars (t, width).

    Args:
        problem: arm, unknowns, records.
        layout: the columns.
        frame: the base in the frame of the references.
        stated: seats whose coordinates count elsewhere already.
    """
    prediction = problem.predict(problem.start, frame)
    chosen = np.concatenate([layout.refitted, layout.of_causes])
    jacobian = prediction.jacobian[:, :, chosen] * layout.scales
    noise, first = NoiseModel.of(problem, frame, 0.0), layout.refitted.size
    known = noise.observations
    rows = np.zeros((len(jacobian), 3, layout.width))
    rows[:, :, :first] = jacobian[:, :, :first]
    rows[:, :, layout.nuisances :] = jacobian[:, :, first:]
    at = np.array([first + 3 * layout.seats.index(label) for label in known.labels], dtype=np.intp)
    touched, axes = np.flatnonzero(known.seat >= 0)[:, None], np.arange(3)
    rows[touched, axes, at[known.seat[touched]] + axes] = -SEAT_WIDTH
    says = known.says
    rows[~says] = 0.0
    rows[says] = np.linalg.inv(np.linalg.cholesky(noise.of_residuals))[says] @ rows[says]
    return rows, _ties(known, known.start(prediction.tips), at, layout.width, stated)


def _ties(known: Observations, points: Array, at: Index, width: int, stated: tuple[str, ...]) -> Array:
    """What is stated of the seats, whose columns begin ``at`` (s,), and of bars; but for what counts elsewhere already."""
    new = np.array([label not in stated for label in known.labels], dtype=bool)
    seats, axes = np.flatnonzero(known.known & new), np.arange(3)
    ties = np.zeros((len(seats), 3, width))
    ties[np.arange(len(seats))[:, None], axes, at[seats][:, None] + axes] = SEAT_WIDTH / known.stated_u[seats]
    along = SEAT_WIDTH * known.of_bars(points)[1]
    bars, number = np.zeros((len(known.ends), width)), np.arange(len(known.ends))[:, None]
    for end, sign in ((0, 1.0), (1, -1.0)):
        bars[number, at[known.ends[:, [end]]] + axes] = sign * along
    return np.vstack([ties.reshape(-1, width), bars[new[known.ends].any(axis=1)]])
