"""What is left of the inner products when nuisances and admitted blocks have been refitted, by one Cholesky factor.

Trying another set of causes costs a triangular solve over all columns, nearly all of what a diagnosis costs. So it is done
once a set, for those columns alone that are asked for, and not again where one of the blocks is taken out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg import cho_solve, qr, solve_triangular
from scipy.linalg.blas import dtrsm

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.diagnosis.design_matrix import Block
from aacmm_pin.diagnosis.gram_matrix import Gram

ADMITTED = 10.0
"""Parameters of an admitted cause are free within so many typical magnitudes …"""
SMOOTH = 2.0
"""… and where they are many, the coefficients of something smooth, within so many: some may be told by few records."""
MANY = 8
"""From so many parameters on."""
UNKNOWN = 1e-9
"""What is added to the information of a nuisance: what is known of it beforehand is among the products already."""
HELD = 1e12
"""What is added to that of one which is held where it is stated."""
ROUNDINGS = (1e-14, 1e-12, 1e-10, 1e-8)
"""Inner products are no more certain than this part of them, the first with which they are positive definite."""

Columns = slice | Index


def freedom(parameters: int) -> float:
    """Within how many typical magnitudes each parameter of an admitted cause is free."""
    return ADMITTED if parameters < MANY else SMOOTH


@dataclass(frozen=True, eq=False)
class Projection:
    """The inner products with some blocks refitted: ``G_rest - Wᵀ W`` with ``W = L⁻¹ G`` and ``L Lᵀ`` the refitted ones.

    Attributes:
        gram: inner products, prior rows included.
        admitted: numbers of the admitted blocks.
        as_stated: what is stated of known causes holds exactly, so that only the admitted blocks change them.
    """

    gram: Gram
    admitted: tuple[int, ...]
    as_stated: bool = False

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks."""
        return self.gram.products.design.blocks

    @property
    def nuisances(self) -> int:
        """Number of nuisance columns."""
        return self.gram.products.design.nuisances

    @property
    def dof(self) -> float:
        """Degrees of freedom of χ²."""
        return self.gram.free - self.determined

    @cached_property
    def refitted(self) -> Index:
        """Numbers of the columns that are refitted."""
        return np.concatenate([np.arange(s.start, s.stop) for s in self._slices])

    @cached_property
    def _slices(self) -> list[slice]:
        return [slice(0, self.nuisances), *(self.blocks[k].columns for k in self.admitted)]

    @cached_property
    def places(self) -> dict[int, slice]:
        """Where each admitted block is among what is refitted."""
        ends = self.nuisances + np.cumsum([0, *(self.blocks[k].size for k in self.admitted)])
        return {k: slice(int(a), int(b)) for k, a, b in zip(self.admitted, ends[:-1], ends[1:], strict=True)}

    def _strips(self, columns: Columns) -> Array:
        """Products of what is refitted with these columns (refitted, …)."""
        return np.concatenate([self.gram.strip(s, columns) for s in self._slices])

    @cached_property
    def _added(self) -> Array:
        """What is added to the information of the refitted columns (refitted,)."""
        # A frame without a prior is many metres wide: the rounding of its products may be more than what is known of others.
        every = np.concatenate([np.diag(self.gram.products.strip(None, s)[:, s]) for s in self._slices])
        rounding = next((r for r in ROUNDINGS if self._definite(self._prior + r * every)), ROUNDINGS[-1])
        return np.asarray(self._prior + rounding * every)

    def _definite(self, added: Array) -> bool:
        return bool(scipy.linalg.lapack.dpotrf(self._own + np.diag(added), lower=1)[1] == 0)

    @cached_property
    def _own(self) -> Array:
        return self._strips(self.refitted)

    @cached_property
    def _factor(self) -> Array:
        return np.asarray(np.linalg.cholesky(self._own + np.diag(self._added)))

    @cached_property
    def _prior(self) -> Array:
        sizes = [self.blocks[k].size for k in self.admitted]
        own = [np.full(size, 1.0 / freedom(size) ** 2) for size in sizes]
        of_nuisances = np.full(self.nuisances, UNKNOWN)
        of_nuisances[self.gram.products.design.known] = HELD if self.as_stated else UNKNOWN
        return np.concatenate([of_nuisances, *own])

    @cached_property
    def _all(self) -> Array:
        return divided(self._factor, self._strips(slice(None)))

    def whitened(self, columns: Columns = slice(None)) -> Array:
        """``L⁻¹ G`` of some columns, by themselves unless that of all is there (refitted, …)."""
        every = isinstance(columns, slice) and columns == slice(None)
        if every or "_all" in self.__dict__:
            return np.asarray(self._all[:, columns])
        return divided(self._factor, self._strips(columns))

    @cached_property
    def of_residual(self) -> Array:
        """The same of the residual (refitted,)."""
        return self.whitened(slice(-1, None))[:, 0]

    def of(self, products: Array) -> Array:
        """The same of other residuals, given by their products with all columns (columns, draws) -> (refitted, draws)."""
        return divided(self._factor, products[self.refitted])

    @cached_property
    def chi2(self) -> float:
        """What is left of χ², prior rows included."""
        return float(self.gram.residual[-1] - self.of_residual @ self.of_residual)

    @cached_property
    def determined(self) -> float:
        """How many of the refitted parameters the records, apart from priors, determine."""
        # Trace of (covariance) (information of the priors), which are rows of the nuisances and numbers of the others.
        inverse, first = divided(self._factor, np.eye(self.refitted.size)), self.nuisances
        of_nuisances = np.square(inverse[:, :first] @ self.gram.products.prior.rows[:, :first].T).sum()
        of_others = np.square(inverse[:, first:]).sum(axis=0) @ self._prior[first:]
        return float(self.refitted.size - of_nuisances - of_others)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the refitted columns, in units of the design's scales (refitted, refitted)."""
        return np.asarray(cho_solve((self._factor, True), np.eye(self.refitted.size), check_finite=False))

    def solution(self) -> Array:
        """Best step of the refitted columns, in units of the design's scales."""
        return np.asarray(-solve_triangular(self._factor.T, self.of_residual, lower=False, check_finite=False))

    def along(self, columns: slice) -> Array:
        """By how much the refitted columns give way per unit of others (refitted, q), in units of the design's scales."""
        return np.asarray(-solve_triangular(self._factor.T, self.whitened(columns), lower=False, check_finite=False))

    def gradient(self, columns: Columns) -> Array:
        """Products of some columns with the residual, both as they are left."""
        return np.asarray(self.gram.residual[columns] - self.whitened(columns).T @ self.of_residual)

    def information(self, block: Block) -> Array:
        """Products of a block's columns as they are left (q, q)."""
        size, number = self.gram.products.place[id(block)]
        if size in self._informations:
            return np.asarray(self._informations[size][number])
        white = self.whitened(block.columns)
        return np.asarray(self.gram.inside(block) - white.T @ white)

    def cross(self, one: Block, other: Block) -> Array:
        """The same of the columns of two blocks (q, q')."""
        left = self.whitened(one.columns).T @ self.whitened(other.columns)
        return np.asarray(self.gram.strip(one.columns, other.columns) - left)

    def informations(self, size: int) -> Array:
        """Information of every block of a size (blocks, q, q); kept."""
        if size not in self._informations:
            self._informations[size] = self.gram.insides(size) - self._squares(self.whitened(), size)
        return self._informations[size]

    @cached_property
    def _informations(self) -> dict[int, Array]:
        return {}

    def _squares(self, rows: Array, size: int) -> Array:
        """``Rᵀ R`` of the columns of every block of a size."""
        each = rows[:, self.gram.products.columns[size]].transpose(1, 0, 2)  # (blocks, rows, q)
        return np.asarray(each.transpose(0, 2, 1) @ each)

    def one_by_one(self) -> list[tuple[Array, Array, float]]:
        """Information and gradient of each admitted block beside the nuisances and the admitted ones before it, and by how
        much it lowers χ² there.

        They are in the factor: its part on the diagonal is that of what the blocks before have left, their own prior added.
        """
        found = []
        for own in self.places.values():
            factor = self._factor[own, own]
            along = self.of_residual[own]
            found.append((factor @ factor.T - np.diag(self._added[own]), factor @ along, float(along @ along)))
        return found

    def rows_of(self, block: int) -> Array:
        """What taking one admitted block out gives back, as rows: ``Vᵀ V`` is more in all products (q, columns + 1).

        With the block's rows taken out of ``L``, there are q directions ``N`` on which nothing else stands:
        ``L_rest N = 0``. They are spanned by ``L⁻¹ E``, ``E`` the unit vectors of the block; turned into them,
        ``W = (W_rest, V)``, so that ``V = Nᵀ W`` and ``Wᵀ W = W_restᵀ W_rest + Vᵀ V``.
        """
        first = self.places[block].start  # L⁻¹ E is zero above it
        unit = np.eye(self.refitted.size - first, self.blocks[block].size)
        directions = qr(divided(self._factor[first:, first:], unit), mode="economic", check_finite=False)[0]
        return np.asarray(directions.T @ self.whitened()[first:])

    def informations_without(self, rows: Array, size: int) -> Array:
        """Information of every block of a size when the block that gave these rows is taken out (blocks, q, q)."""
        return self.informations(size) + self._squares(rows, size)


def divided(factor: Array, right: Array) -> Array:
    """``L⁻¹ R``, row by row in memory.

    As ``Rᵀ L⁻ᵀ``, whose arrays lie in memory as BLAS wants them: half the time of LAPACK's solver with its copies.
    """
    return np.asarray(dtrsm(1.0, factor.T, np.ascontiguousarray(right).T, side=1, lower=0, overwrite_b=False).T)
