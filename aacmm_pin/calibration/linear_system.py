"""The whitened linear system of one step, with the unknown points of the seats projected out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Prediction
from aacmm_pin.measurements.observations import Elimination


@dataclass(frozen=True, eq=False)
class System:
    """Residual ``r + A δ``, whitened: unit variance, the seats already at their best.

    Attributes:
        residual: (rows,).
        jacobian: (rows, p).
        distance: squared Mahalanobis distance of each tip from its target, (n,); NaN where it has none.
        turn_distance: the same of its turn, the tip's deviation being known (n,); NaN where no orientation is stated.
        off: tip minus target (n, 3) [m], NaN where it has none; behind it the turn from the stated orientation, zero where
            there is none (n, 6) [rad].
        free: number of rows less the number of coordinates of seats that the rows determine.
        seats: from a step of the parameters (p,) to that of the seats (s, 3) [m].
    """

    residual: Array
    jacobian: Array
    distance: Array
    turn_distance: Array
    off: Array
    free: int
    seats: Callable[[Array], Array]

    @property
    def deviation(self) -> Array:
        """Tip minus target (n, 3) [m]; NaN where it has none."""
        return self.off[:, :3]


def assemble(prediction: Prediction, noise: NoiseModel, points: Array, weights: Array) -> System:
    """The system at a prediction, with the seats at ``points`` (s, 3) [m] and weights of the records (n,), 1 for full."""
    observations = noise.observations
    says, p = observations.says, prediction.jacobian.shape[2]
    off = observations.deviations(prediction.poses, points)
    whiten = noise.whitening
    white = (whiten @ np.where(says[:, None], off, 0.0)[:, :, None])[:, :, 0]
    of_tip, of_turn = (np.einsum("ni,ni->n", part, part) for part in (white[:, :3], white[:, 3:]))
    seen = np.where(says, of_tip, np.nan), np.where(observations.counts > 3, of_turn, np.nan), off
    root = np.sqrt(np.where(says, weights, 0.0))
    whiten = whiten * root[:, None, None]
    rows = np.empty((*white.shape, p + 1))
    np.matmul(whiten, prediction.jacobian, out=rows[:, :, :p])
    rows[:, :, p] = white * root[:, None]
    free = int(observations.counts.sum())
    if not len(observations.labels):
        every = (rows if says.all() else rows[says]).reshape(-1, p + 1)
        return System(every[:, p], every[:, :p], *seen, free, _no_seats)
    seats = Elimination(observations, points, -whiten[:, :, :3])
    along, records, ties, bars = seats.eliminated(rows, residual=True)
    known = observations.known
    free += 3 * int(known.sum()) + len(observations.ends) - 3 * len(observations.labels)
    every = np.concatenate([each.reshape(-1, p + 1) for each in (records[says], ties[known], bars)])
    return System(every[:, p], every[:, :p], *seen, free, partial(_steps_of_seats, seats, along))


def _no_seats(delta: Array) -> Array:
    return np.zeros((0, 3))


def _steps_of_seats(seats: Elimination, along: Array, delta: Array) -> Array:
    p = delta.size
    return seats.step(along[:, :, p:] + (along[:, :, :p] @ delta)[:, :, None])
