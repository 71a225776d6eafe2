"""Inner products of whitened residuals, nuisances and candidate columns: one pass over the records.

A projection, a score, an evidence, a held-out prediction are arithmetic on these, whatever the
number of records. Nuisances are refitted in any case: geometry with its prior, the reference frame;
unknown points are projected out.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dsyrk

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin.calibration import SeatElimination
from aacmm_pin.diagnosis.design_matrix import Design, Family
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

RANK = 150
"""Directions of the background of all covariates: they keep about 0.6 of its mean square."""
ROWS_OF_A_GROUP = 1500
"""Rows of the records whose columns are worked out at once."""
LEAST_TRACE = 1e-12
"""Least trace of a block of columns, by which zeros can be divided."""


@dataclass(frozen=True, eq=False)
class Gram:
    """Inner products of some records.

    Attributes:
        matrix: products of all columns and, last, the residual (columns + 1, columns + 1).
        free: rows less the unknown points that were projected out.
        origin: products of all records, which give the background its directions; None for these.
    """

    design: Design
    noise: RecordNoise
    matrix: Array
    free: int
    origin: Gram | None = None

    @property
    def chi2(self) -> float:
        """Products of the residual with itself."""
        return float(self.matrix[-1, -1])

    def products(self, block: int) -> Array:
        """Products of a block's parameters with all columns and the residual (q, columns + 1)."""
        return self.design.blocks[block].in_parameters(self.matrix).T

    def of_family(self, family: Family) -> tuple[Array, Array]:
        """Information (b, q, q) and products with the residual (b, q) of the blocks of a family."""
        gradient = family.in_parameters(self.matrix[-1:, family.columns])[:, 0]
        return family.information(self.matrix), gradient

    @cached_property
    def along_directions(self) -> Array:
        """Products of the directions with all columns and the residual (r, columns + 1)."""
        return np.asarray(self.directions.T @ self.matrix[-1 - len(self.directions) : -1])

    @cached_property
    def directions(self) -> Array:
        """Directions of the background: all covariates, whose columns are the last ones, together
        in few (columns of covariates, r).

        Each covariate block counts with the same mean square, all together with that of the
        noise; but no parameter is larger than the largest width, or an arm that shrinks to a point
        would meet every unknown seat. The directions span about the largest right singular vectors:
        one step of a randomised range finder (Halko, Martinsson, Tropp 2011, SIAM Review 53), whose
        start depends on the covariates' names alone.
        """
        if self.origin is not None:
            return self.origin.directions
        blocks = [b for b in self.design.blocks if b.candidate >= self.design.causes]
        blocks.sort(key=lambda block: block.columns.start)
        first = blocks[0].columns.start if blocks else self.design.width
        of_covariates = slice(first, self.design.width)
        sizes = np.array([block.size for block in blocks], dtype=np.intp)
        squares = np.diag(self.matrix)
        traces = np.array([squares[block.columns].sum() for block in blocks])
        block_scales = np.sqrt(self.free / (np.maximum(traces, LEAST_TRACE) * max(len(blocks), 1)))
        scale = np.repeat(np.minimum(block_scales, max(THRESHOLDS.widths)), sizes)[:, None]
        rank = min(RANK, self.design.width - first, self.free)
        names = self.design.names
        starts = [np.empty((0, rank))]
        for block in blocks:
            words = f"{names[block.candidate]} {block.variant} {block.size}"
            rng = np.random.default_rng(zlib.crc32(words.encode()))
            starts.append(rng.standard_normal((block.size, rank)))
        products = self.matrix[of_covariates, of_covariates]
        in_range = scale * (products @ (scale * np.concatenate(starts)))
        orthonormal, _ = np.linalg.qr(in_range)
        return np.asarray(scale * orthonormal)

    def without(self, part: Gram) -> Gram:
        """The products of the other records than those of ``part``, whose memory they take, with
        the same background.
        """
        matrix = np.subtract(self.matrix, part.matrix, out=part.matrix)
        return replace(self, matrix=matrix, free=self.free - part.free, origin=self.origin or self)


def gram_of(design: Design, noise: RecordNoise, folds: Sequence[Mask] | None = None) -> Gram:
    """Inner products of the used records; with ``folds``, the sum of those of each fold (n,), in
    which a seat has coordinates of its own. The prior is added if these are all used records.

    What records of one posture share is taken out with all of them: the products of folds add up.
    """
    used = design.fit.used
    parts = [used] if folds is None else [used & fold for fold in folds]
    upper = np.zeros((design.width + 1, design.width + 1), order="F")
    free = sum(_add_records(upper, design, noise, part) for part in parts)
    for k in range(len(upper)):
        upper[k + 1 :, k] = upper[k, k + 1 :]
    matrix = upper.T  # row by row in memory
    has_all = np.array_equal(np.any(parts, axis=0), used)
    if has_all:
        nuisances_and_residual = np.append(np.arange(design.nuisances), design.width)
        entries = np.ix_(nuisances_and_residual, nuisances_and_residual)
        matrix[entries] += design.prior.T @ design.prior
    return Gram(design, noise, matrix, free)


def _add_records(upper: Array, design: Design, noise: RecordNoise, chosen: Mask) -> int:
    """Add the products of some of the used records to the upper triangle; return their rows less
    the unknown points.
    """
    fit = design.fit
    used = fit.used
    part = np.where(chosen, 0, -1)
    observations, old_seats, part_of_seat = fit.observations.divided(part)
    points = fit.point.seats[old_seats]
    whitening = noise.whitening * chosen[:, None, None]
    by_seat = noise.decorrelated(observations.seat_derivatives(whitening))
    elimination = SeatElimination(observations, points, by_seat)
    whole_groups = noise.with_whole_groups(chosen, used)
    deviations = np.where(used[:, None], observations.deviations(design.tips, points), 0.0)
    along_seats = np.zeros((len(observations.labels), 3, design.width + 1))
    most_records = max(ROWS_OF_A_GROUP // design.tips.shape[1], 1)
    for group in noise.divided(np.flatnonzero(whole_groups), most_records):
        columns = np.concatenate([design.rows(group), deviations[group, :, None]], axis=2)
        inside = chosen[group]
        rows = noise.take(group).whitened(columns)[inside]
        along_seats += elimination.along(rows, group[inside])
        _add_squares(upper, rows, 1.0)
    seats = np.flatnonzero(part_of_seat == 0)
    part_of_relation = part_of_seat[observations.ends[:, 0]]
    relations = np.flatnonzero(part_of_relation == 0)
    added_rows, taken_rows = elimination.squares(along_seats, seats, relations)
    _add_squares(upper, added_rows, 1.0)
    _add_squares(upper, taken_rows, -1.0)
    unknown = int((~observations.is_stated[seats]).sum())
    counted = int(observations.counts[chosen].sum()) + relations.size
    return max(counted - 3 * unknown, 0)


def _add_squares(upper: Array, rows: Array, factor: float) -> None:
    """Add ``Rᵀ R`` of rows (…, columns), times a factor, to the upper triangle in place."""
    flat = np.ascontiguousarray(rows.reshape(-1, len(upper)))
    if len(flat):
        dsyrk(factor, flat.T, beta=1.0, c=upper, overwrite_c=True)
