"""The linear model of the records at a point: predictions and derivatives there, whitened, with the
seats eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.linear_model import LinearModel, Prior, RowBlock, SeatElimination
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Prediction


@dataclass(frozen=True, eq=False)
class Linearisation(LinearModel):
    """The linear model at a point.

    Attributes:
        distance: squared Mahalanobis distance of each tip from its target, (n,); NaN where it has
            none.
        turn_distance: squared Mahalanobis distance of each rotation from the stated orientation,
            given the deviation of the tip (n,); NaN where no orientation is stated.
        deviations: tip minus target (n, 3) [m], NaN where it has none; with orientations (n, 6),
            the last three the rotation from the stated one [rad], zero where none is stated.
        free: number of rows less the number of coordinates of seats that the rows determine.
        elimination: of the seats.
        along_seats: what the elimination took out of the rows (s, 3, p + 1).
    """

    distance: Array
    turn_distance: Array
    deviations: Array
    free: int
    elimination: SeatElimination
    along_seats: Array

    @property
    def deviation(self) -> Array:
        """Tip minus target (n, 3) [m]; NaN where it has none."""
        return self.deviations[:, :3]

    def seat_step(self, step: Array) -> Array:
        """Best step of the seats (s, 3) [m] for a ``step`` of the parameters (p,) [units]."""
        by_parameters, residual = np.split(self.along_seats, [-1], axis=2)
        along = residual + (by_parameters @ step)[:, :, None]
        return self.elimination.step(along)


def linearise(
    prediction: Prediction, prior: Prior, noise: NoiseModel, points: Array, weights: Array
) -> Linearisation:
    """The linear model at a prediction.

    Args:
        prediction: of the records.
        prior: of its parameters.
        noise: of the records.
        points: where the seats are (s, 3) [m].
        weights: of the records (n,), 1 for full.
    """
    observations = noise.observations
    p = prediction.jacobian.shape[2]
    has_target = observations.has_target
    deviations = observations.deviations(prediction.poses, points)
    stated = np.where(has_target[:, None], deviations, 0.0)
    whitened = (noise.whitening @ stated[:, :, None])[:, :, 0]
    tip = whitened[:, :3]
    turn = whitened[:, 3:]
    tip_distance = np.einsum("ni,ni->n", tip, tip)
    turn_distance = np.einsum("ni,ni->n", turn, turn)
    root_weights = np.sqrt(np.where(has_target, weights, 0.0))[:, None]
    whitening = noise.whitening * root_weights[:, :, None]
    rows = np.empty((*whitened.shape, p + 1))
    np.matmul(whitening, prediction.jacobian, out=rows[:, :, :p])
    rows[:, :, p] = whitened * root_weights
    correlation = noise.correlation(whitening)
    rows = correlation.whitened(rows)
    by_seats = correlation.whitened(observations.by_seats(whitening))
    elimination = SeatElimination(observations, points, by_seats)
    along_seats, all_rows = elimination.eliminated(rows, residual=True)
    records = np.flatnonzero(has_target)
    seats = np.flatnonzero(observations.known)
    bars = np.arange(len(observations.ends))
    block = RowBlock(records, seats, bars, len(observations.labels))
    return Linearisation(
        rows=block.stack(all_rows),
        prior=prior,
        distance=np.where(has_target, tip_distance, np.nan),
        turn_distance=np.where(observations.counts > 3, turn_distance, np.nan),
        deviations=deviations,
        free=block.free(observations.counts),
        elimination=elimination,
        along_seats=along_seats,
    )
