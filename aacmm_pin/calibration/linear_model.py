"""The whitened linear model that calibration, diagnosis and planning share: rows, priors,
eliminated seats.

``r + A δ + B s``: A by the parameters, B by the unknown points of the seats, rows in units of their
noise. A row comes from a record, from the stated coordinates of a seat, or from a bar. The seats
are eliminated from the rows; other columns, from the normal matrix or from the triangle of the
rows, as its Schur complement.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg import null_space, solve_triangular
from scipy.sparse import csr_array

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.measurements import NOTHING_KNOWN, Observations

LEAST_INFORMATION = 0.1
"""A direction about which data and stated uncertainties together say less than this, one over its
width, is not known."""
MOVABLE = 1e-9
"""A direction with a singular value below this, of columns times their widths, is one along which
no step can be taken."""
UNEVEN = 1e-6
"""Normal equations do where every singular value, of columns of length one, is certain to be above
this: errors of the smallest are then a ten-thousandth of it, and the gradient has none."""
OPEN_CENTRE = 3e-4
"""Part of all information on a sphere or plane that is added in every direction, for contacts on a
great circle tell nothing of the centre across it."""
ROWS_AT_ONCE = 4000
"""Rows that are brought to a triangle at once: copies of all of them would take more memory than
all the rest."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the parameters beforehand.

    Attributes:
        rows: whitened, in units of the scales, the residual last (k, p + 1).
        scales: how far off each parameter may be (p,) [units].
        stated: the rows without what nobody stated (k, p + 1).
    """

    rows: Array
    scales: Array
    stated: Array


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``r + A δ`` in whitened rows, the seats eliminated, with what is known of the parameters
    beforehand.

    Attributes:
        rows: columns and, last, the residual (m, p + 1) [1/unit].
        prior: of the parameters.
    """

    rows: Array
    prior: Prior

    @property
    def jacobian(self) -> Array:
        """A (m, p)."""
        return self.rows[:, :-1]

    @property
    def residual(self) -> Array:
        """r (m,)."""
        return self.rows[:, -1]

    @property
    def cost(self) -> float:
        """χ², prior included."""
        of_prior = self.prior.rows[:, -1]
        return float(self.residual @ self.residual + of_prior @ of_prior)

    @cached_property
    def normal(self) -> NormalEquations | None:
        """Normal equations in units of the scales, prior included; None where some directions are
        hardly known.
        """
        scales = self.prior.scales
        prior = self.prior.rows
        information = self.jacobian.T @ self.jacobian
        information *= scales
        information *= scales[:, None]
        information += prior[:, :-1].T @ prior[:, :-1]
        gradient = scales * (self.residual @ self.jacobian) + prior[:, -1] @ prior[:, :-1]
        return NormalEquations.of(information, gradient)

    @cached_property
    def measured_triangle(self) -> Array:
        """R of the scaled rows with the residual last (p + 1, p + 1), or with fewer rows."""
        scales = np.append(self.prior.scales, 1.0)
        triangle = np.empty((0, scales.size))
        for first in range(0, max(len(self.rows), 1), ROWS_AT_ONCE):
            some = self.rows[first : first + ROWS_AT_ONCE]
            above = len(triangle)
            rows = np.concatenate([triangle, np.empty_like(some)])
            np.multiply(some, scales, out=rows[above:])
            triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        return triangle

    @cached_property
    def triangle(self) -> Array:
        """The same with the prior."""
        return self._with_rows(self.prior.rows)

    def _with_rows(self, rows: Array) -> Array:
        """The triangle of the measured rows and others (k, p + 1)."""
        together = np.concatenate([rows, self.measured_triangle])
        return np.asarray(np.linalg.qr(together, mode="r"))

    @cached_property
    def spectrum(self) -> Spectrum:
        """Singular values in units of the scales."""
        return Spectrum.of(self.triangle, np.ones(self.prior.scales.size))

    @cached_property
    def unknown(self) -> Array:
        """Directions of which neither the data nor stated uncertainties say anything (p, k),
        orthonormal [scales].
        """
        triangle = self._with_rows(self.prior.stated)
        informed = Spectrum.of(triangle, np.ones(self.prior.scales.size))
        return informed.directions[:, informed.values < LEAST_INFORMATION]

    @property
    def predicted_reduction(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        if self.normal is not None:
            return self.normal.predicted_reduction
        return self.spectrum.predicted_reduction(MOVABLE)

    @cached_property
    def independent_steps(self) -> Array:
        """Steps of unit variance that span all of which something is known (p, k) [units]: the
        covariance is their square.

        R⁻¹, or by the directions that can be moved along where some cannot.
        """
        scales = self.prior.scales[:, None]
        if self.normal is not None:
            return self.normal.inverse * (scales / self.normal.lengths[:, None])
        values, directions, _ = self.spectrum.above(MOVABLE)
        return scales * directions / values

    @property
    def determined(self) -> float:
        """How many parameters the rows determine: one that its prior determines costs them nothing.

        The trace of the rows' information times the inverse of all information.
        """
        steps = self.independent_steps
        scales = self.prior.scales[:, None]
        of_prior = self.prior.rows[:, :-1] @ (steps / scales)
        by_prior = np.square(of_prior).sum()
        return float(steps.shape[1] - by_prior)

    def covariance(self, unknown: Array) -> Array:
        """Covariance of the parameters (p, p) [units], zero along the ``unknown`` directions (p, k)
        [scales].
        """
        steps = self.steps(unknown)
        return steps @ steps.T

    def steps(self, unknown: Array) -> Array:
        """Steps of unit variance that span all but the ``unknown`` directions (p, p - k)
        [units].
        """
        known = null_space(unknown.T) if unknown.size else np.eye(self.prior.scales.size)
        spectrum = self.spectrum
        rows = spectrum.values[:, None] * spectrum.directions.T
        triangle = np.linalg.qr(rows @ known, mode="r")
        in_widths = known @ np.linalg.inv(triangle)
        return in_widths * self.prior.scales[:, None]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations, their columns of length one.

    A seventh of the time of a triangle by reflections. They square how unevenly directions are
    known, and serve where that leaves digits enough.

    Attributes:
        lengths: of the columns, times their scales (p,).
        inverse: ``R⁻¹`` with the upper Cholesky factor R of the information (p, p).
        along: residual along the columns of ``Q`` (p,), so that ``-R⁻¹ along`` is the Gauss–Newton
            step.
    """

    lengths: Array
    inverse: Array
    along: Array

    @staticmethod
    def of(information: Array, gradient: Array) -> NormalEquations | None:
        """Of the columns' products with one another (p, p) and with the residual (p,); None where
        some directions are hardly known.
        """
        lengths = np.sqrt(np.diagonal(information))
        if not (lengths.size and (lengths > MOVABLE).all()):
            return None
        information /= lengths
        information /= lengths[:, None]
        factor, failed = scipy.linalg.lapack.dpotrf(information.T, lower=0, clean=1, overwrite_a=1)
        if failed:
            return None
        inverse = scipy.linalg.lapack.dtrtri(factor)[0]
        # No singular value is smaller than one over this norm.
        if not np.linalg.norm(inverse) * UNEVEN < 1.0:
            return None
        return NormalEquations(lengths, inverse, inverse.T @ (gradient / lengths))

    @property
    def step(self) -> Array:
        """The Gauss–Newton step (p,), in units of the lengths."""
        return np.asarray(-(self.inverse @ self.along))

    @property
    def predicted_reduction(self) -> float:
        """How much that step lowers χ² if the problem is linear."""
        return float(self.along @ self.along)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values of rows.

    Attributes:
        values: (p,), largest first.
        directions: (p, p), columns in the units of the rows' columns.
        along: residual along each direction (p,), so that ``-along / values`` is the Gauss–Newton
            step.
    """

    values: Array
    directions: Array
    along: Array

    @staticmethod
    def of(triangle: Array, divisors: Array) -> Spectrum:
        """Of rows with the residual last (m, p + 1), their columns over ``divisors`` (p,)."""
        p = divisors.size
        left, values, right = np.linalg.svd(
            triangle[:, :-1] / divisors, full_matrices=len(triangle) < p
        )
        missing = p - values.size
        if missing > 0:  # fewer rows than parameters: the rest of the directions is unknown
            values = np.pad(values, (0, missing))
            left = np.pad(left, ((0, 0), (0, missing)))
        return Spectrum(values, right.T, left.T @ triangle[:, -1])

    def above(self, least: float) -> tuple[Array, Array, Array]:
        """Values above ``least`` (k,), with their directions (p, k) and the residual along these
        (k,).
        """
        chosen = self.values > least
        return self.values[chosen], self.directions[:, chosen], self.along[chosen]

    def predicted_reduction(self, least: float) -> float:
        """How much the Gauss–Newton step along these lowers χ² if the problem is linear."""
        return float(np.square(self.above(least)[2]).sum())


def remaining_triangle(rows: Array, nuisances: int) -> Array:
    """R (q, q) with ``RᵀR`` the Schur complement of the first columns in the normal matrix of
    ``rows`` (m, nuisances + q).

    It is what the rows say of the others when the nuisances are at their best.
    """
    missing = max(rows.shape[1] - len(rows), 0)
    triangle = np.asarray(np.linalg.qr(np.pad(rows, ((0, missing), (0, 0))), mode="r"))
    return triangle[nuisances:, nuisances:]


@dataclass(frozen=True, eq=False)
class RowBlock:
    """Rows that are used together: of some records, of the stated coordinates of some seats, and of
    some bars.

    Attributes:
        records, seats, bars: their numbers.
        unknown: number of seats that are eliminated from them.
    """

    records: Index
    seats: Index
    bars: Index
    unknown: int

    def size(self, width: int) -> int:
        """How many rows, each record having ``width`` of them."""
        of_records = width * self.records.size
        return of_records + 3 * self.seats.size + self.bars.size

    def free(self, counts: Index) -> int:
        """How many numbers are stated, by ``counts`` for each record (n,), less the coordinates of
        the seats.
        """
        of_records = int(counts[self.records].sum())
        of_seats = 3 * (self.seats.size - self.unknown)
        return of_records + of_seats + self.bars.size

    def stack(self, rows: tuple[Array, Array, Array]) -> Array:
        """The rows (m, c), of those of all records (n, 3 or 6, c), seats (s, 3, c) and bars (b,
        c).
        """
        stacked = []
        for each, chosen in zip(rows, (self.records, self.seats, self.bars), strict=True):
            own = each if chosen.size == len(each) else each[chosen]
            if own.size:
                stacked.append(own.reshape(-1, each.shape[-1]))
        if not stacked:
            return np.empty((0, rows[0].shape[-1]))
        return stacked[0] if len(stacked) == 1 else np.concatenate(stacked)


class SeatElimination:
    """Projection of whitened rows onto what no coordinates of seats can change: variable projection
    (Golub, Pereyra 1973).

    With the seats' derivative ``B = Q C`` (Q orthonormal, seat by seat) the rows become ``R - Q Qᵀ
    R``; a bar, which couples two seats, then gives one row more, see :meth:`eliminated`. No loop
    over records or seats.
    """

    def __init__(self, observations: Observations, points: Array, by_seat: Array) -> None:
        """At seats ``points`` (s, 3), with ``by_seat`` the derivative of each record's whitened
        residual by the place of the seat that it touches (n, 3 or 6, 3).
        """
        self.observations = observations
        self._touched = np.flatnonzero(observations.seat >= 0)
        self._numbers = observations.seat[self._touched]
        shape = (len(observations.labels), self._touched.size)
        ones = np.ones(self._touched.size)
        columns = np.arange(self._touched.size)
        self._sum = csr_array((ones, (self._numbers, columns)), shape=shape)
        self._orthonormal(by_seat[self._touched])
        self._bar_residual, along = observations.of_bars(points)
        self._seat_residual = observations.of_seats(points)
        inverse, (first, second) = np.linalg.inv(self._root), observations.ends.T
        self._bar_ends = along[:, None, :] @ inverse[first], -along[:, None, :] @ inverse[second]

    def _orthonormal(self, by: Array) -> None:
        """Q of the derivatives of records (touched, 3 or 6, 3) and of stated coordinates, and C.

        Cholesky QR twice: orthonormal to rounding, however uneven a seat's directions are known.
        """
        known = self.observations.known[:, None]
        count = len(self.observations.labels)
        weight = np.where(known, 1.0 / np.where(known, self.observations.stated_u, 1.0), 0.0)
        by_tie = weight[:, :, None] * np.eye(3)
        # Contacts of a sphere or plane may leave a direction of it open.
        may_be_open = self.observations.surfaces & ~self.observations.known
        leeway = np.where(may_be_open, OPEN_CENTRE, 0.0)[:, None, None] * np.eye(3)
        self._root = np.broadcast_to(np.eye(3), (count, 3, 3))
        for least in (NOTHING_KNOWN, np.where(may_be_open, np.inf, 0.5)):
            square = (
                self._seat_sums(by.transpose(0, 2, 1) @ by) + by_tie.transpose(0, 2, 1) @ by_tie
            )
            # The others have nothing to be made orthonormal.
            some = np.trace(square, axis1=1, axis2=2) > least
            square = np.where(some[:, None, None], square, np.eye(3))
            square += leeway * np.trace(square, axis1=1, axis2=2)[:, None, None]
            upper = np.linalg.cholesky(square).transpose(0, 2, 1)
            inverse = np.linalg.inv(upper)
            by, by_tie, self._root = (
                by @ inverse[self._numbers],
                by_tie @ inverse,
                upper @ self._root,
            )
        self._q, self._q_tie = by, by_tie

    def _seat_sums(self, each: Array) -> Array:
        """Sums over the records of each seat of arrays (touched, …): (s, …)."""
        shape = each.shape[1:]
        flat = each.reshape(len(each), int(np.prod(shape)))
        sums = np.asarray(self._sum @ flat)
        return sums.reshape(len(sums), *shape)

    def eliminated(self, rows: Array, residual: bool) -> tuple[Array, tuple[Array, Array, Array]]:
        """Whitened rows (n, 3 or 6, c) with the seats at their best; where ``residual``, the last
        column is the residual.

        Returns:
            ``Qᵀ R`` (s, 3, c); and the records' rows (n, 3 or 6, c), in place, the seats' own (s,
            3, c), and one for each bar (b, c).
        """
        along = self._seat_sums(self._q.transpose(0, 2, 1) @ rows[self._touched])
        ties = np.zeros_like(along)
        if residual:
            ties[:, :, -1] = self._seat_residual
            along += self._q_tie.transpose(0, 2, 1) @ ties
        rows[self._touched] -= self._q @ along[self._numbers]
        return along, (rows, ties - self._q_tie @ along, self._bar_rows(along, residual))

    def along(self, rows: Array, records: Index) -> Array:
        """``Qᵀ R`` of the whitened rows (m, 3 or 6, c) of some records: (s, 3, c)."""
        inside = np.flatnonzero(self.observations.seat[records] >= 0)
        own = records[inside]
        q = self._q[np.searchsorted(self._touched, own)]
        shape = (len(self.observations.labels), own.size)
        seats = (self.observations.seat[own], np.arange(own.size))
        each = (q.transpose(0, 2, 1) @ rows[inside]).reshape(own.size, 3 * rows.shape[2])
        sums = np.asarray(csr_array((np.ones(own.size), seats), shape=shape) @ each)
        return sums.reshape(shape[0], 3, rows.shape[2])

    def squares(self, along: Array, seats: Index, bars: Index) -> tuple[Array, Array]:
        """Rows whose squares some seats and bars add to those of the records' rows, and take from
        them, where the seats are at their best (m, c); the last column is the residual.

        Args:
            along: ``Qᵀ R`` of all records (s, 3, c).
            seats, bars: which.
        """
        ties = self._seat_residual
        along = along.copy()
        along[:, :, -1] += np.einsum("sji,sj->si", self._q_tie, ties)
        of_ties = np.zeros((1, along.shape[2]))
        of_ties[0, -1] = np.linalg.norm(ties[seats])
        of_bars = self._bar_rows(along, residual=True)[bars]
        return np.concatenate([of_ties, of_bars]), along[seats].reshape(-1, along.shape[2])

    def _bar_rows(self, along: Array, residual: bool) -> Array:
        """One row for each bar with the seats at their best (b, c): ``(1 + H Hᵀ)^-½ (t - H Qᵀ R)``,
        H of the bars.
        """
        rows = -self._by_bars(along)
        if residual:
            rows[:, -1] += self._bar_residual
        return (
            np.asarray(solve_triangular(self._bar_factor, rows, lower=True)) if len(rows) else rows
        )

    def _by_bars(self, along: Array) -> Array:
        """``H`` times vectors of the seats (s, 3, c): (b, c)."""
        first, second = self.observations.ends.T
        moved = self._bar_ends[0] @ along[first] + self._bar_ends[1] @ along[second]
        return np.asarray(moved[:, 0])

    @cached_property
    def _bar_jacobian(self) -> Array:
        """``H`` (b, 3 s)."""
        ends = self.observations.ends
        dense = np.zeros((len(ends), len(self.observations.labels), 3))
        for k, by_end in enumerate(self._bar_ends):
            dense[np.arange(len(ends)), ends[:, k]] += by_end[:, 0]
        return dense.reshape(len(ends), -1)

    @cached_property
    def _bar_factor(self) -> Array:
        outer = self._bar_jacobian @ self._bar_jacobian.T
        return np.asarray(np.linalg.cholesky(np.eye(len(outer)) + outer))

    def step(self, along: Array) -> Array:
        """Best step of the seats (s, 3) [m] for ``Qᵀ`` of the residual, its ties included (s, 3,
        1).
        """
        if not len(along):
            return np.zeros((0, 3))
        best = -along
        if len(self.observations.ends):
            rows = self._bar_residual[:, None] - self._by_bars(along)
            once = solve_triangular(self._bar_factor, rows, lower=True)
            twice = solve_triangular(self._bar_factor.T, once, lower=False)
            best = best - (self._bar_jacobian.T @ twice).reshape(best.shape)
        return np.asarray(np.linalg.solve(self._root, best)[:, :, 0])


def seat_columns(
    observations: Observations, points: Array, by_seat: Array
) -> tuple[Array, Array, Array]:
    """Derivative by the seats where these are kept as columns: of records, of stated coordinates,
    of bars.

    Args:
        observations: of n records, s seats and b bars.
        points: where the seats are (s, 3) [m].
        by_seat: see :class:`SeatElimination` (n, k, 3).

    Returns:
        (n, k, s, 3), (s, 3, s, 3), zero where nothing is stated, and (b, s, 3) [1/m].
    """
    count = len(observations.labels)
    known = observations.known
    ends = observations.ends
    touched = np.flatnonzero(observations.seat >= 0)
    bars = np.arange(len(ends))
    of_records = np.zeros((*by_seat.shape[:2], count, 3))
    of_records[touched, :, observations.seat[touched]] = by_seat[touched]
    of_seats = np.zeros((count, 3, count, 3))
    of_seats[known, :, known] = (1.0 / observations.stated_u[known])[:, :, None] * np.eye(3)
    of_bars = np.zeros((len(ends), count, 3))
    _, along = observations.of_bars(points)
    of_bars[bars, ends[:, 0]] = along
    of_bars[bars, ends[:, 1]] = -along
    return of_records, of_seats, of_bars
