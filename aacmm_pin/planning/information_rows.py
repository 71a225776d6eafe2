"""What records tell of every unknown: their whitened rows, unknown seats as columns of their own."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.calibration.problem import Frame, Problem
from aacmm_pin.calibration.solver import noise_of_tips
from aacmm_pin.calibration.stated_noise import StatedNoise, observations_of
from aacmm_pin.effects import Effect
from aacmm_pin.measurements.observations import Observations
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
    found = np.zeros((n, 3, layout.width))
    tips = noise_of_tips(problem, frame, noise.encoder, 0.0)
    known = observations_of(problem.measurements, noise, 0.0)
    rows = np.zeros((n, 3, layout.width))
    rows[:, :, :first] = jacobian[:, :, :first]
    rows[:, :, layout.nuisances :] = jacobian[:, :, first:]
    at = np.array([first + 3 * layout.seats.index(label) for label in known.labels], dtype=np.intp)
    touched = np.flatnonzero(known.seat >= 0)
    for axis in range(3):
        rows[touched, axis, at[known.seat[touched]] + axis] = -SEAT_WIDTH
    says = known.says
    found[says] = np.linalg.inv(np.linalg.cholesky(tips + known.covariance))[says] @ rows[says]
    return Rows(found, _ties(known, known.start(prediction.tips), at, layout.width, stated))


def _ties(known: Observations, points: Array, at: Index, width: int, stated: tuple[str, ...]) -> Array:
    """What is stated of the seats, whose columns begin ``at`` (s,), and of bars; but for what counts elsewhere already."""
    new = np.array([label not in stated for label in known.labels], dtype=bool)
    seats = np.flatnonzero(known.known & new)
    ties = np.zeros((len(seats), 3, width))
    for axis in range(3):
        ties[np.arange(len(seats)), axis, at[seats] + axis] = SEAT_WIDTH / known.stated_u[seats, axis]
    along = known.of_bars(points)[1]
    bars = np.zeros((len(known.ends), width))
    number = np.arange(len(bars))
    for axis in range(3):
        for end, sign in ((0, 1.0), (1, -1.0)):
            bars[number, at[known.ends[:, end]] + axis] = sign * SEAT_WIDTH * along[:, axis]
    return np.vstack([ties.reshape(-1, width), bars[new[known.ends].any(axis=1)]])
