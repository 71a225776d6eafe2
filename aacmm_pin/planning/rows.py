"""What records tell of every unknown: their whitened rows, unknown seats as columns of their own."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aacmm_pin.calibration.evidence import StatedNoise, observations_of
from aacmm_pin.calibration.problem import Frame, Problem
from aacmm_pin.calibration.solver import noise_of_tips
from aacmm_pin.checks import Array, Index
from aacmm_pin.effects import Effect
from aacmm_pin.planning.causes import typical

SEAT_WIDTH = 1.0
"""A seat of unknown place is anywhere within this [m]."""


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
        counts = [len(effect.terms) for effect in causes]
        stop, total = len(problem.parameters), len(problem.scales)
        first = stop - sum(counts)
        refitted = np.concatenate([np.arange(first), np.arange(stop, total)])
        scales = np.concatenate([problem.scales[refitted], typical(causes)])
        ends = np.cumsum([0, *counts])
        blocks = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        return Layout(refitted, np.arange(first, stop), scales, seats, blocks)

    @property
    def nuisances(self) -> int:
        """Number of columns that are refitted, the seats' included."""
        return self.refitted.size + 3 * len(self.seats)

    @property
    def width(self) -> int:
        """Number of all columns."""
        return self.nuisances + self.of_causes.size

    def prior(self) -> Array:
        """What is known of the refitted columns beforehand, as rows (nuisances, width)."""
        return np.eye(self.nuisances, self.width)


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened derivatives.

    Attributes:
        records: of each record (n, 3, width); zero where a record says nothing.
        ties: what is stated of seats and bars (t, width).
    """

    records: Array
    ties: Array

    def information(self) -> Array:
        """Of all of them (width, width)."""
        flat = self.records.reshape(-1, self.records.shape[2])
        return np.asarray(flat.T @ flat + self.ties.T @ self.ties)


def rows_of(problem: Problem, layout: Layout, noise: StatedNoise, frame: Frame, stated: tuple[str, ...] = ()) -> Rows:
    """The rows of the problem's records.

    Args:
        problem: arm, unknowns, records.
        layout: the columns.
        noise: standard uncertainties; each record has its own, encoders carried to the tip.
        frame: the base in the frame of the references.
        stated: seats whose coordinates count elsewhere already.
    """
    prediction = problem.predict(problem.start, frame)
    chosen = np.concatenate([layout.refitted, layout.of_causes])
    jacobian = prediction.jacobian[:, :, chosen] * layout.scales
    n, first = len(jacobian), layout.refitted.size
    found, ties = np.zeros((n, 3, layout.width)), [np.zeros((0, layout.width))]
    tips = noise_of_tips(problem, frame, noise.encoder, 0.0)
    for observation in observations_of(problem.measurements, noise, 0.0):
        records = observation.records
        rows = np.zeros((len(records), 3, layout.width))
        rows[:, :, :first] = jacobian[records][:, :, :first]
        rows[:, :, layout.nuisances :] = jacobian[records][:, :, first:]
        values = observation.start(prediction.tips[records])
        seats = [label for label, _ in observation.points(values)]
        if seats:
            own = np.concatenate([first + 3 * layout.seats.index(label) + np.arange(3) for label in seats])
            rows[:, :, own] = -SEAT_WIDTH * observation.targets(values)[1]
            if not set(seats) <= set(stated):
                by_tie = observation.ties(values)[1]
                tie = np.zeros((len(by_tie), layout.width))
                tie[:, own] = SEAT_WIDTH * by_tie
                ties.append(tie)
        found[records] = np.linalg.inv(np.linalg.cholesky(tips[records] + observation.covariance())) @ rows
    return Rows(found, np.vstack(ties))
