"""Inner products of whitened residuals, nuisances and candidate columns, computed when they are
needed.

Everything that choosing among causes needs, a projection, a score, an evidence, a held-out
prediction, is arithmetic on these inner products, so that trying another set of causes, or leaving
out a part of the records, costs next to nothing. The nuisances are the parameters that are
refitted in any case: geometry with its prior, the reference frame; the unknown points of the
observations are projected out of the rows.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.calibration import RowBlock, SeatElimination
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.held_postures import RecordNoise
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import Observations

MOST_DOUBLE = 10_000_000
"""More numbers than this are held in single precision: 6e-8 of a column is far below the noise of
any record."""
ROWS_OF_A_PRODUCT = 400
"""Rows in one matrix product."""
RANK = 150
"""Directions of the background of all covariates: they keep about 0.6 of its mean square."""
LEAST_TRACE = 1e-12
"""Least trace of a block of columns, so that a block of zeros can be divided by it."""


def numbers_of(columns: Sequence[slice]) -> Index:
    """Numbers of some columns (m,)."""
    numbers = [np.arange(column_range.start, column_range.stop) for column_range in columns]
    return np.concatenate([np.empty(0, np.intp), *numbers])


@dataclass(frozen=True, eq=False)
class PartRows:
    """Whitened rows of records that are left out together.

    Attributes:
        rows: columns and, last, the residual (m, columns + 1).
        free: rows less the unknown points that were projected out.
    """

    rows: Array
    free: int

    def strip(self, columns: Index) -> Array:
        """Products of some columns with all, and with the residual (q, columns + 1)."""
        found = np.zeros((columns.size, self.rows.shape[1]))
        for rows in self._exact():
            found += rows[:, columns].T @ rows
        return found

    def drawn(self, draws: int, rng: np.random.Generator) -> Array:
        """Products of all columns with residuals that are noise alone (columns, draws)."""
        found = np.zeros((self.rows.shape[1] - 1, draws))
        for rows in self._exact():
            found += rows[:, :-1].T @ rng.standard_normal((len(rows), draws))
        return found

    def combined(self, columns: Index, weights: Array) -> tuple[Array, Array]:
        """Products of combinations of some columns, ``weights`` (columns, r).

        Returns:
            With all columns and the residual (r, columns + 1), and with one another (r, r).
        """
        with_all = np.zeros((weights.shape[1], self.rows.shape[1]))
        with_own = np.zeros((weights.shape[1],) * 2)
        for rows in self._exact():
            combinations = rows[:, columns] @ weights
            with_all += combinations.T @ rows
            with_own += combinations.T @ combinations
        return with_all, with_own

    def squared(self, columns: Index, weights: Array) -> Array:
        """``Rᵀ R`` of some columns times ``weights`` (columns, r), to the precision of the rows
        (columns, r).
        """
        found = np.zeros(weights.shape)
        single = weights.astype(self.rows.dtype)
        for first in range(0, len(self.rows), ROWS_OF_A_PRODUCT):
            rows = self.rows[first : first + ROWS_OF_A_PRODUCT, columns]
            found += rows.T @ (rows @ single)
        return found

    def diagonal_blocks(self, columns: Mapping[int, Index]) -> dict[int, Array]:
        """Products of the columns of each block with one another, for columns (blocks, q) of each
        size q: (blocks, q, q).
        """
        found = {
            size: np.zeros((*block_columns.shape, size)) for size, block_columns in columns.items()
        }
        for rows in self._exact():
            for size, block_columns in columns.items():
                block_rows = rows.T[block_columns]
                found[size] += block_rows @ block_rows.transpose(0, 2, 1)
        return found

    def _exact(self) -> Iterator[Array]:
        """Blocks of rows in double precision, so that products of rounded columns are exact."""
        for first in range(0, max(len(self.rows), 1), ROWS_OF_A_PRODUCT):
            yield self.rows[first : first + ROWS_OF_A_PRODUCT].astype(np.float64, copy=False)


class Products:
    """Inner products of the columns of a design, by part and over all, cached.

    The rows, by far the largest arrays of a diagnosis, are computed again if they are needed after
    :meth:`release`.

    Args:
        design: the columns.
        read: computes the rows of each part.
        noise: of the records.

    Attributes:
        free: of each part, see :class:`PartRows`.
        of_size: numbers of the blocks of each size.
        columns: of these blocks, for each size q (blocks, q).
        place: size of a block, by its id, and its number among those of that size.
    """

    def __init__(
        self, design: Design, read: Callable[[], list[PartRows]], noise: RecordNoise
    ) -> None:
        self.design = design
        self._read = read
        self.noise = noise
        self._combined: dict[int, tuple[Array, Array]] = {}
        self.free = [each.free for each in self.parts]
        prior = np.zeros((len(design.prior), design.width + 1))
        prior[:, : design.nuisances] = design.prior[:, :-1]
        prior[:, -1] = design.prior[:, -1]
        self.prior = PartRows(prior, 0)
        self._strips: dict[tuple[int | None, int, int], Array] = {}
        sizes = np.array([b.size for b in design.blocks], dtype=np.intp)
        starts = np.array([b.columns.start for b in design.blocks], dtype=np.intp)
        self.of_size = {int(q): np.flatnonzero(sizes == q) for q in np.unique(sizes)}
        self.columns = dict[int, Index]()
        self.place = dict[int, tuple[int, int]]()
        for size, own in self.of_size.items():
            self.columns[size] = starts[own][:, None] + np.arange(size)
            for number, block in enumerate(own.tolist()):
                self.place[id(design.blocks[block])] = size, number
        self._diagonal_blocks: dict[int | None, dict[int, Array]] = {}

    @cached_property
    def parts(self) -> list[PartRows]:
        """The rows."""
        return self._read()

    def release(self) -> None:
        """Free the memory of the rows; computed products stay."""
        self.__dict__.pop("parts", None)

    def strip(self, part: int | None, columns: slice) -> Array:
        """Products of some columns with all, and with the residual (q, columns + 1): of one part,
        or of all with prior.
        """
        key = (part, columns.start, columns.stop)
        if key not in self._strips:
            self.prepare(part, [columns])
        return self._strips[key]

    def prepare(self, part: int | None, strips: Iterable[slice]) -> None:
        """Compute several strips that will be needed, in one pass over the rows."""
        wanted = {(s.start, s.stop) for s in strips if (part, s.start, s.stop) not in self._strips}
        if wanted:
            columns = np.concatenate([np.arange(*ends) for ends in wanted])
            parts = [self.prior, *self.parts] if part is None else [self.parts[part]]
            found = parts[0].strip(columns)
            for each in parts[1:]:
                found += each.strip(columns)
            last = np.cumsum([stop - start for start, stop in wanted])
            for ends, strip in zip(wanted, np.split(found, last[:-1]), strict=True):
                self._strips[part, *ends] = strip

    def diagonal_blocks(self, part: int | None) -> dict[int, Array]:
        """Products of the columns of each block with one another: size -> (blocks of that size, q,
        q).
        """
        if part not in self._diagonal_blocks:
            if part is None:
                each = [self.diagonal_blocks(k) for k in range(len(self.free))]
                self._diagonal_blocks[part] = {
                    size: np.sum([one[size] for one in each], axis=0) for size in self.columns
                }
            else:
                self._diagonal_blocks[part] = self.parts[part].diagonal_blocks(self.columns)
        return self._diagonal_blocks[part]

    @cached_property
    def background(self) -> tuple[Index, Array]:
        """All covariates together in few directions: their columns, and weights of these (columns,
        :data:`RANK`).

        Each covariate block counts with the same mean square, and all together with that of the
        noise; but no parameter is larger than the largest width, or an arm that shrinks to a point
        would meet every unknown seat. The directions span about the largest of these columns' right
        singular vectors: one step of a randomised range finder (Halko, Martinsson, Tropp 2011, SIAM
        Review 53), whose start depends on the names of the covariates and on no order.
        """
        blocks = [b for b in self.design.blocks if b.candidate >= self.design.causes]
        columns = numbers_of([block.columns for block in blocks])
        free = sum(self.free)
        of_size = self.diagonal_blocks(None)
        places = [self.place[id(block)] for block in blocks]
        traces = np.array([np.trace(of_size[size][k]) for size, k in places])
        each = np.sqrt(free / (np.maximum(traces, LEAST_TRACE) * len(blocks)))
        largest = max(THRESHOLDS.widths)
        scale = np.repeat(np.minimum(each, largest), [block.size for block in blocks])[:, None]
        rank = min(RANK, columns.size, free)
        start = np.vstack([np.empty((0, rank)), *(self._start(block, rank) for block in blocks)])
        along = sum(part.squared(columns, scale * start) for part in self.parts)
        directions = np.linalg.qr(scale * along)[0]
        return columns, scale * directions

    def _start(self, block: Block, rank: int) -> Array:
        """Random numbers for a covariate block, by its name (q, rank)."""
        carrier = block.source.carrier if isinstance(block.source, Carried) else ""
        words = f"{self.design.names[block.candidate]} {carrier} {block.variant} {block.size}"
        rng = np.random.default_rng(zlib.crc32(words.encode()))
        return rng.standard_normal((block.size, rank))

    @cached_property
    def background_columns(self) -> Array:
        """Displacement of each record by each direction of the background (n, 3 or 6, r) [m,
        rad].
        """
        return self.design.combined(*self.background)

    def combined(self, part: int) -> tuple[Array, Array]:
        """Products of the background of one part with all columns (r, columns + 1), and inside it
        (r, r).
        """
        if part not in self._combined:
            self._combined[part] = self.parts[part].combined(*self.background)
        return self._combined[part]

    def drawn(self, draws: int, rng: np.random.Generator) -> Array:
        """Products of all columns with residuals that are noise alone (columns, draws)."""
        parts = (self.prior, *self.parts)
        return np.asarray(sum(part.drawn(draws, rng) for part in parts))


@dataclass(frozen=True, eq=False)
class Gram:
    """The products of all records, or of all but some parts.

    Attributes:
        products: where they come from.
        left_out: numbers of the parts that do not count.
    """

    products: Products
    left_out: frozenset[int] = frozenset()

    def without(self, part: int) -> Gram:
        """The products without this part too."""
        return Gram(self.products, self.left_out | {part})

    @property
    def parts(self) -> list[int]:
        """Numbers of the parts that count and have degrees of freedom."""
        every = enumerate(self.products.free)
        return [k for k, free in every if k not in self.left_out and free > 0]

    @property
    def free(self) -> int:
        """Rows less the unknown points that were projected out."""
        return sum(self.products.free[k] for k in self.parts)

    def prepare(self, blocks: Iterable[int]) -> None:
        """Compute in one pass what is needed to add each of ``blocks``."""
        strips = [self.products.design.blocks[k].columns for k in blocks]
        for part in (None, *self.left_out):
            self.products.prepare(part, strips)

    def strip(self, columns: slice, others: slice | Index = slice(None)) -> Array:
        """Products of some columns with others, or with all and with the residual (q, columns +
        1).
        """
        total = self.products.strip(None, columns)[:, others]
        for part in self.left_out:
            total = total - self.products.strip(part, columns)[:, others]
        return total

    @property
    def residual(self) -> Array:
        """Products of the residual with all columns and itself (columns + 1,)."""
        last = self.products.design.width
        return np.asarray(self.strip(slice(last, last + 1))[0])

    @property
    def background(self) -> tuple[Array, Array]:
        """Products of the background with all columns and the residual (r, columns + 1), and inside
        it (r, r).
        """
        of_parts = map(self.products.combined, self.parts)
        with_all, with_own = zip(*of_parts, strict=True)
        return np.sum(with_all, axis=0), np.sum(with_own, axis=0)

    def diagonal_blocks(self, size: int) -> Array:
        """Products inside each block of a size (blocks, q, q)."""
        total = self.products.diagonal_blocks(None)[size]
        for part in self.left_out:
            total = total - self.products.diagonal_blocks(part)[size]
        return total

    def diagonal_block(self, block: Block) -> Array:
        """Products inside one block (q, q)."""
        size, number = self.products.place[id(block)]
        return np.asarray(self.diagonal_blocks(size)[number])


def products_of(design: Design, part: Index, noise: RecordNoise | None = None) -> Products:
    """Products of the used records; a seat with records in several parts has its own coordinates in
    each.

    Args:
        design: the columns.
        part: number of the part of each record, from 0 (n,).
        noise: of the records; None for the noise of the fit, without an error that records share.
    """
    known = noise or RecordNoise.of_fit(design.fit)
    return Products(design, partial(_parts_of, design, part, known), known)


def _parts_of(design: Design, part: Index, noise: RecordNoise) -> list[PartRows]:
    """Whitened rows of each part."""
    fit = design.fit
    held = noise.postures
    width = design.width
    used = fit.used & fit.observations.has_target
    part = np.where(used, part, -1)
    observations, old, of_seat = fit.observations.divided(part)
    points = fit.point.seats[old]
    whitening = noise.whitening * used[:, None, None]
    elimination = SeatElimination(
        observations, points, held.whitened(observations.by_seats(whitening))
    )
    blocks = _row_blocks(observations, part, of_seat)
    deviations = np.where(used[:, None], observations.deviations(design.tips, points), 0.0)
    kind = np.float64 if deviations.size * width <= MOST_DOUBLE else np.float32
    found = [np.empty((block.size(whitening.shape[1]), width + 1), dtype=kind) for block in blocks]
    residual = slice(width, width + 1), deviations[:, :, None]
    for columns, strip in chain(design.column_blocks(), [residual]):
        whitened = held.whitened(whitening @ strip)
        _, rows = elimination.eliminated(whitened, residual=columns.start == width)
        for into, block in zip(found, blocks, strict=True):
            into[:, columns] = block.stack(rows)
    free = [max(block.free(observations.counts), 0) for block in blocks]
    return [PartRows(rows, count) for rows, count in zip(found, free, strict=True)]


def _row_blocks(observations: Observations, part: Index, of_seat: Index) -> list[RowBlock]:
    """The rows of each part, by the part of each record (n,) and of each seat (s,), -1 of those
    that do not count.
    """
    known = observations.known
    of_bar = of_seat[observations.ends[:, 0]]
    blocks = []
    for k in range(int(part.max(initial=0)) + 1):
        seats = of_seat == k
        stated = np.flatnonzero(seats & known)
        bars = np.flatnonzero(of_bar == k)
        blocks.append(RowBlock(np.flatnonzero(part == k), stated, bars, int(seats.sum())))
    return blocks
