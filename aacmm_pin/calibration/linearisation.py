"""The linear model of the records at a point, whitened: ``r + A δ + B s``, A by the parameters, B
by the unknown points of the seats, which are eliminated.

A row comes from a record, the stated coordinates of a seat, or a relation of two seats, such as a
bar.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.calibration.least_squares import LinearModel, Prior
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Frame, Prediction
from aacmm_pin.measurements import NOTHING_KNOWN, Observations

OPEN_CENTRE = 3e-4
"""Least part of the information on a sphere or plane in each direction; a great circle has none
across it.
"""


class SeatElimination:
    """Elimination of the seats from whitened rows: variable projection (Golub, Pereyra 1973).

    With the seats' derivative ``B = Q C`` (Q orthonormal, C triangular, seat by seat) the rows M
    become ``M - Q Qᵀ M``, which no motion of a seat changes; a relation, which couples two seats,
    gives one row more.
    """

    def __init__(self, observations: Observations, points: Array, by_seat: Array) -> None:
        """At ``points`` (s, 3) of the seats; ``by_seat``: derivative of the whitened residual of
        each record with respect to its seat (n, 3 or 6, 3).
        """
        self.observations = observations
        self._at_seats = np.flatnonzero(observations.seat >= 0)
        self._seat_of_contact = observations.seat[self._at_seats]
        shape = (len(observations.labels), self._at_seats.size)
        ones = np.ones(self._at_seats.size)
        columns = np.arange(self._at_seats.size)
        self._summing = csr_array((ones, (self._seat_of_contact, columns)), shape=shape)
        self._set_orthonormal(by_seat[self._at_seats])
        self._relation_residual, by_ends = observations.relation_residuals(points)
        self._stated_residual = observations.seat_residuals(points)
        self._relation_jacobian = self._by_seats(by_ends)

    @property
    def cost(self) -> float:
        """χ² of stated coordinates and relations at these points."""
        of_seats = np.square(self._stated_residual).sum()
        of_relations = np.square(self._relation_residual).sum()
        return float(of_seats + of_relations)

    def _set_orthonormal(self, by_seat: Array) -> None:
        """Set ``Q`` of records and stated coordinates, and ``C``, by Cholesky QR twice."""
        is_stated = self.observations.is_stated[:, None]
        count = len(self.observations.labels)
        u = np.where(is_stated, self.observations.stated_u, 1.0)
        by_stated = np.where(is_stated, 1.0 / u, 0.0)[:, :, None] * np.eye(3)
        # Contacts of a sphere or plane may leave a direction of it open: for these once will do.
        may_be_open = self.observations.surfaces & ~self.observations.is_stated
        self._triangle = np.broadcast_to(np.eye(3), (count, 3, 3))
        for least in (NOTHING_KNOWN, np.where(may_be_open, np.inf, 0.5)):
            information = self._seat_sums(by_seat.transpose(0, 2, 1) @ by_seat)
            information = information + by_stated.transpose(0, 2, 1) @ by_stated
            # Seats with less stay as they are.
            has_more = np.trace(information, axis1=1, axis2=2) > least
            information = np.where(has_more[:, None, None], information, np.eye(3))
            values, directions = np.linalg.eigh(information[may_be_open])
            added = np.maximum(OPEN_CENTRE * values.sum(axis=1, keepdims=True) - values, 0.0)
            information[may_be_open] += directions * added[:, None] @ directions.transpose(0, 2, 1)
            upper = np.linalg.cholesky(information).transpose(0, 2, 1)
            inverse = np.linalg.inv(upper)
            by_seat = by_seat @ inverse[self._seat_of_contact]
            by_stated = by_stated @ inverse
            self._triangle = upper @ self._triangle
        self._q, self._q_stated = by_seat, by_stated

    def _seat_sums(self, arrays: Array, chosen: Index | None = None) -> Array:
        """Sums by seat (s, …) over touched records, or over those ``chosen``."""
        shape = arrays.shape[1:]
        flat = arrays.reshape(len(arrays), int(np.prod(shape)))
        summing = self._summing if chosen is None else self._summing[:, chosen]
        sums = np.asarray(summing @ flat)
        return sums.reshape(len(sums), *shape)

    def eliminated(self, rows: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """Whitened rows (n, 3 or 6, c), the residual last, with the seats at their best.

        Returns:
            ``Qᵀ M`` (s, 3, c); rows of the records, in place, of the seats (s, 3, c), and of
            relations (b, c).
        """
        along = self._seat_sums(self._q.transpose(0, 2, 1) @ rows[self._at_seats])
        stated = np.zeros_like(along)
        stated[:, :, -1] = self._stated_residual
        along += self._q_stated.transpose(0, 2, 1) @ stated
        rows[self._at_seats] -= self._q @ along[self._seat_of_contact]
        return along, (rows, stated - self._q_stated @ along, self._relation_rows(along))

    def along(self, rows: Array, records: Index) -> Array:
        """``Qᵀ M`` of the whitened rows (m, 3 or 6, c) of some records: (s, 3, c)."""
        touched = np.flatnonzero(self.observations.seat[records] >= 0)
        positions = np.searchsorted(self._at_seats, records[touched])
        projected = self._q[positions].transpose(0, 2, 1) @ rows[touched]
        return self._seat_sums(projected, positions)

    def squares(self, along: Array, seats: Index, relations: Index) -> tuple[Array, Array]:
        """Rows whose squares some seats and relations add to those of the records, and take from
        them (m, c). ``along``: ``Qᵀ M`` of all records (s, 3, c), the residual last.
        """
        stated = self._stated_residual
        along = along.copy()
        along[:, :, -1] += np.einsum("sji,sj->si", self._q_stated, stated)
        of_stated = np.zeros((1, along.shape[2]))
        of_stated[0, -1] = np.linalg.norm(stated[seats])
        of_relations = self._relation_rows(along)[relations]
        return np.concatenate([of_stated, of_relations]), along[seats].reshape(-1, along.shape[2])

    def _relation_rows(self, along: Array) -> Array:
        """With the seats at their best (b, c): ``(1 + H Hᵀ)^-½ (t - H Qᵀ M)``."""
        rows = -self._relation_jacobian @ along.reshape(-1, along.shape[2])
        rows[:, -1] += self._relation_residual
        if len(rows):
            rows = solve_triangular(self.relation_factor, rows, lower=True)
        return rows

    def _by_seats(self, by_ends: Array) -> Array:
        """``H`` (b, 3 s) of the whitened derivatives by both ends (b, 2, 3)."""
        ends = self.observations.ends
        inverse = np.linalg.inv(self._triangle)
        by_seats = np.zeros((len(ends), len(inverse), 3))
        for end, seats in enumerate(ends.T):
            by_seat = by_ends[:, end, None] @ inverse[seats]
            by_seats[np.arange(len(ends)), seats] += by_seat[:, 0]
        return by_seats.reshape(len(ends), 3 * len(inverse))

    @cached_property
    def relation_factor(self) -> Array:
        """``(1 + H Hᵀ)^½`` (b, b), lower triangular."""
        rows = self._relation_jacobian
        return np.asarray(np.linalg.qr(np.vstack([np.eye(len(rows)), rows.T]), mode="r")).T

    def by_relations(self, rows: Array) -> Array:
        """What relations with these ``rows`` (b, c), as :meth:`eliminated` returns them, add to the
        rows of the records (n, 3 or 6, c): ``-Q Hᵀ (1 + H Hᵀ)^-½ rows``. Relations hold the seats
        aside from where the records alone put them.
        """
        steps = self._relation_jacobian.T @ solve_triangular(self.relation_factor.T, rows)
        of_seats = steps.reshape(-1, 3, rows.shape[1])
        added = np.zeros((len(self.observations.seat), self._q.shape[1], rows.shape[1]))
        added[self._at_seats] = -self._q @ of_seats[self._seat_of_contact]
        return added

    def step(self, along: Array) -> Array:
        """Best step of the seats (s, 3) [m] for ``Qᵀ`` of the residual (s, 3, 1)."""
        if not len(along):
            return np.zeros((0, 3))
        best = -along
        if len(self.observations.ends):
            jacobian = self._relation_jacobian
            rows = self._relation_residual[:, None] - jacobian @ along.reshape(-1, 1)
            forward = solve_triangular(self.relation_factor, rows, lower=True)
            backward = solve_triangular(self.relation_factor.T, forward, lower=False)
            best = best - (jacobian.T @ backward).reshape(best.shape)
        return np.asarray(np.linalg.solve(self._triangle, best)[:, :, 0])


@dataclass(frozen=True, eq=False)
class Point:
    """Where a search stands.

    Attributes:
        x: parameters (p,).
        seats: points (s, 3) [m].
        prediction: of the records, by these parameters and this frame.
    """

    x: Array
    frame: Frame
    seats: Array
    prediction: Prediction


@dataclass(frozen=True, eq=False)
class Linearisation(LinearModel):
    """The linear model at a point.

    Attributes:
        distance: squared Mahalanobis distance of each tip from its target (n,); NaN without one.
        turn_distance: of each rotation from the stated one, given the tip's deviation (n,); NaN
            without one.
        deviations: tip minus target (n, 3) [m], NaN without one; with orientations (n, 6), then the
            rotation from the stated one [rad], zero without one.
        seats_cost: χ² with the seats at these points, without the prior.
        along_seats: what the elimination took out of the rows (s, 3, p + 1).
    """

    distance: Array
    turn_distance: Array
    deviations: Array
    seats_cost: float
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


def linearise(point: Point, prior: Prior, noise: NoiseModel, weights: Array) -> Linearisation:
    """The linear model at a point, with ``weights`` of records (n,)."""
    observations = noise.observations
    jacobian = point.prediction.jacobian
    p = jacobian.shape[2]
    has_target = observations.has_target
    deviations = observations.deviations(point.prediction.poses, point.seats)
    finite = np.where(has_target[:, None], deviations, 0.0)
    whitened = (noise.whitening @ finite[:, :, None])[:, :, 0]
    tip = whitened[:, :3]
    turn = whitened[:, 3:]
    tip_distance = np.einsum("ni,ni->n", tip, tip)
    turn_distance = np.einsum("ni,ni->n", turn, turn)
    root_weights = np.sqrt(np.where(has_target, weights, 0.0))[:, None]
    whitening = noise.whitening * root_weights[:, :, None]
    rows = np.empty((*whitened.shape, p + 1))
    np.matmul(whitening, jacobian, out=rows[:, :, :p])
    rows[:, :, p] = whitened * root_weights
    correlation = noise.correlation(whitening)
    rows = correlation.whitened(rows)
    by_seats = correlation.whitened(observations.seat_derivatives(whitening))
    elimination = SeatElimination(observations, point.seats, by_seats)
    seats_cost = float(np.square(rows[has_target, :, p]).sum()) + elimination.cost
    along_seats, (of_records, of_seats, of_relations) = elimination.eliminated(rows)
    blocks = [
        of_records if has_target.all() else of_records[has_target],
        of_seats[observations.is_stated],
        of_relations,
    ]
    filled = [block.reshape(-1, p + 1) for block in blocks if block.size]
    return Linearisation(
        rows=filled[0] if len(filled) == 1 else np.concatenate([np.empty((0, p + 1)), *filled]),
        prior=prior,
        distance=np.where(has_target, tip_distance, np.nan),
        turn_distance=np.where(observations.counts > 3, turn_distance, np.nan),
        deviations=deviations,
        seats_cost=seats_cost,
        elimination=elimination,
        along_seats=along_seats,
    )
