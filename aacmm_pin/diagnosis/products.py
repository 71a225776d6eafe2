"""Inner products of whitened residuals, nuisances and candidate columns, worked out as far as they are asked for.

Everything that choosing among causes needs, a projection, a score, an evidence, a held-out prediction, is arithmetic on
these inner products, so that trying another set of causes, or leaving out a part of the records, costs next to nothing.
The nuisances are what is refitted anyway: geometry with its prior, the reference frame; the unknown points of the
observations are projected out of the rows.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import orth

from aacmm_pin.checks import Array, Index
from aacmm_pin.diagnosis.design import Block, Design
from aacmm_pin.observations import Observation


@dataclass(frozen=True, eq=False)
class Part:
    """Whitened rows of records that are left out together.

    Attributes:
        rows: columns and, last, the residual (m, columns + 1).
        free: rows less the unknown points that were projected out.
    """

    rows: Array
    free: int


class Products:
    """Inner products of the columns of a design, by part and over all; kept once they are worked out."""

    def __init__(self, design: Design, parts: list[Part]) -> None:
        self.design, self.parts = design, parts
        self._prior = _prior_of(design)
        self._strips: dict[tuple[int | None, int, int], Array] = {}
        by_size: dict[int, list[Block]] = defaultdict(list)
        for block in design.blocks:
            by_size[block.size].append(block)
        self._columns = {q: np.array([b.columns.start for b in some])[:, None] + np.arange(q) for q, some in by_size.items()}
        self._place = {id(b): (q, k) for q, some in by_size.items() for k, b in enumerate(some)}
        self._insides: dict[int | None, dict[int, Array]] = {}

    def strip(self, part: int | None, columns: slice) -> Array:
        """Products of some columns with all, and with the residual (q, columns + 1): of one part, or of all with prior."""
        key = (part, columns.start, columns.stop)
        if key not in self._strips:
            if part is None:
                found = self._prior[columns].copy()
                for rows in (p.rows for p in self.parts):
                    found += rows[:, columns].T @ rows
            else:
                found = self.parts[part].rows[:, columns].T @ self.parts[part].rows
            self._strips[key] = found
        return self._strips[key]

    def insides(self, part: int | None) -> dict[int, Array]:
        """Products of the columns of each block with one another: size -> (blocks of that size, q, q)."""
        if part not in self._insides:
            each = [self.insides(k) for k in range(len(self.parts))] if part is None else []
            found = {}
            for size, columns in self._columns.items():
                if part is None:
                    found[size] = np.sum([one[size] for one in each], axis=0)
                else:
                    mine = self.parts[part].rows.T[columns]
                    found[size] = mine @ mine.transpose(0, 2, 1)
            self._insides[part] = found
        return self._insides[part]

    def drawn(self, draws: int, rng: np.random.Generator) -> Array:
        """Products of all columns with residuals that are noise alone (columns, draws)."""
        own = np.sqrt(np.diag(self._prior)[:-1])[:, None]  # 1 where a nuisance has a prior row, else 0
        total = own * rng.standard_normal((len(own), draws))
        for part in self.parts:
            total += part.rows[:, :-1].T @ rng.standard_normal((len(part.rows), draws))
        return np.asarray(total)

    def columns_of_size(self, size: int) -> Index:
        """Columns of each block of a size (blocks, q)."""
        return self._columns[size]

    def place(self, block: Block) -> tuple[int, int]:
        """Size of a block, and its number among those of that size."""
        return self._place[id(block)]


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
        """All but this part too."""
        return Gram(self.products, self.left_out | {part})

    @property
    def parts(self) -> list[int]:
        """Numbers of the parts that count and have something to say."""
        return [k for k, part in enumerate(self.products.parts) if k not in self.left_out and part.free > 0]

    @property
    def free(self) -> int:
        """Rows less the unknown points that were projected out."""
        return sum(self.products.parts[k].free for k in self.parts)

    def strip(self, columns: slice, others: slice | Index = slice(None)) -> Array:
        """Products of some columns with others, or with all and with the residual (q, columns + 1)."""
        total = self.products.strip(None, columns)[:, others]
        for part in self.left_out:
            total = total - self.products.strip(part, columns)[:, others]
        return total

    @property
    def residual(self) -> Array:
        """Products of the residual with all columns and itself (columns + 1,)."""
        last = self.products.design.jacobian.shape[2]
        return np.asarray(self.strip(slice(last, last + 1))[0])

    def insides(self, size: int) -> Array:
        """Products inside each block of a size (blocks, q, q)."""
        total = self.products.insides(None)[size]
        for part in self.left_out:
            total = total - self.products.insides(part)[size]
        return total

    def inside(self, block: Block) -> Array:
        """Products inside one block (q, q)."""
        size, number = self.products.place(block)
        return np.asarray(self.insides(size)[number])


def products_of(design: Design, part: Index) -> Products:
    """Whitened rows of the used records; an observation with unknown points in several parts has them anew in each.

    Args:
        design: the columns.
        part: number of the part of each record, from 0 (n,).
    """
    fit = design.fit
    rows: list[list[Array]] = [[] for _ in range(int(part.max(initial=0)) + 1)]
    unknowns = [0] * len(rows)
    for observation, values in zip(fit.observations, fit.solution.point.nuisances, strict=True):
        used = fit.used[observation.records]
        if not used.any():
            continue
        whiten = np.linalg.inv(np.linalg.cholesky(fit.noise[observation.records] + observation.covariance()))
        if observation.unknowns:
            for number in np.unique(part[observation.records[used]]):
                mine = used & (part[observation.records] == number)
                found, count = _projected(design, observation, values, whiten, mine)
                rows[number].append(found)
                unknowns[number] += count
            continue
        off = _off(design, observation, values)
        for number in range(len(rows)):
            mine = used & (part[observation.records] == number)
            if mine.any():
                rows[number].append(_rows(design, observation.records[mine], whiten[mine], off[mine]))
    empty = np.zeros((0, design.jacobian.shape[2] + 1))
    stacked = [some[0] if len(some) == 1 else np.concatenate([empty, *some]) for some in rows]
    return Products(design, [Part(r, max(len(r) - k, 0)) for r, k in zip(stacked, unknowns, strict=True)])


def _prior_of(design: Design) -> Array:
    """What is known of the nuisances beforehand, as products (columns + 1, columns + 1)."""
    problem, x = design.fit.problem, design.fit.solution.point.x
    own = design.kept[design.kept < x.size]
    total = np.zeros((design.jacobian.shape[2] + 1,) * 2)
    total[: own.size, : own.size] = np.eye(own.size)
    off = ((x - problem.start) / problem.widths)[own]
    total[-1, : own.size] = total[: own.size, -1] = off
    total[-1, -1] = off @ off
    return total


def _off(design: Design, observation: Observation, values: Array) -> Array:
    return np.asarray(design.tips[observation.records] - observation.targets(values)[0])


def _rows(design: Design, records: Index, whiten: Array, off: Array) -> Array:
    """Whitened columns and residual of some records (3 m, columns + 1)."""
    found = np.empty((len(records), 3, design.jacobian.shape[2] + 1))
    np.matmul(whiten, design.jacobian[records], out=found[:, :, :-1])
    found[:, :, -1] = np.einsum("nij,nj->ni", whiten, off)
    return found.reshape(3 * len(records), -1)


def _projected(
    design: Design, observation: Observation, values: Array, whiten: Array, used: NDArray[np.bool_]
) -> tuple[Array, int]:
    """The same with the observation's unknown points at their best, whatever the columns do; how many these determine.

    Where only a part of its records is used, they have points of their own.
    """
    records = observation.records[used]
    rows = _rows(design, records, whiten[used], _off(design, observation, values)[used])
    tie, by_tie = observation.ties(values)
    tied = np.zeros((tie.size, rows.shape[1]))
    tied[:, -1] = tie
    rows = np.vstack([rows, tied])
    by = np.vstack([-(whiten[used] @ observation.targets(values)[1][used]).reshape(-1, values.size), by_tie])
    q = orth(by, rcond=1e-9)
    return np.asarray(rows - q @ (q.T @ rows)), q.shape[1]
