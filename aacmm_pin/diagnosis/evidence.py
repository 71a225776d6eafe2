"""How well each candidate explains what is left, given those already admitted: evidence with priors on magnitude."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from aacmm_pin.checks import Array
from aacmm_pin.diagnosis.statistics import Block, Gram

MAGNITUDES = np.array([0.2, 0.5, 1.0, 2.0])
"""Standard deviations of a cause's parameters that its evidence averages over, in units of the typical magnitude."""
ADMITTED = 3.0
"""Parameters of an admitted cause are free within so many typical magnitudes."""


@dataclass(frozen=True, eq=False)
class Conditional:
    """What is left of every block when nuisances and admitted blocks have been refitted.

    ``residual(δ) = r + J δ``. With the nuisances at their best, block k has information S_k and gradient g_k; both are
    divided by the variance factor with which the records scatter.

    Attributes:
        gram: inner products, prior rows included.
        blocks: all blocks.
        nuisances: number of nuisance columns.
        admitted: numbers of the admitted blocks.
        variance: factor by which the records scatter more than their noise.
    """

    gram: Gram
    blocks: tuple[Block, ...]
    nuisances: int
    admitted: tuple[int, ...]
    variance: float = 1.0

    @cached_property
    def refitted(self) -> Array:
        """Numbers of the columns that are refitted."""
        columns = [np.arange(self.nuisances)]
        columns += [np.arange(self.blocks[k].columns.start, self.blocks[k].columns.stop) for k in self.admitted]
        return np.concatenate(columns)

    @cached_property
    def _factor(self) -> Array:
        inside = self.gram.products[np.ix_(self.refitted, self.refitted)].copy()
        width = np.full(self.refitted.size, 1e-9)
        width[self.nuisances :] = 1.0 / ADMITTED**2
        return np.asarray(np.linalg.cholesky(inside + np.diag(width)))

    @cached_property
    def _whitened(self) -> Array:
        """``L⁻¹ G``: (refitted, columns + 1)."""
        return np.asarray(solve_triangular(self._factor, self.gram.products[self.refitted], lower=True, check_finite=False))

    @cached_property
    def gradient(self) -> Array:
        """Of every column (columns,)."""
        white = self._whitened
        return np.asarray((self.gram.products[:-1, -1] - white[:, :-1].T @ white[:, -1]) / self.variance)

    @cached_property
    def chi2(self) -> float:
        """What is left of χ², prior rows included."""
        return float(self.gram.products[-1, -1] - self._whitened[:, -1] @ self._whitened[:, -1])

    @cached_property
    def determined(self) -> float:
        """How many of the refitted parameters the records, apart from priors, determine."""
        inverse = cho_solve((self._factor, True), np.eye(self.refitted.size), check_finite=False)
        prior = np.ones(self.refitted.size)
        prior[self.nuisances :] = 1.0 / ADMITTED**2
        return float(self.refitted.size - np.sum(np.diag(inverse) * prior))

    def solution(self) -> Array:
        """Best step of the refitted columns, in units of the design's scales."""
        right = self._whitened[:, -1]
        return np.asarray(-solve_triangular(self._factor.T, right, lower=False, check_finite=False))

    def information(self, one: slice | Array, other: slice | Array) -> Array:
        """Inner products of two sets of columns when what is refitted is at its best."""
        white = self._whitened
        left = self.gram.products[one][:, other] - white[:, one].T @ white[:, other]
        return np.asarray(left / self.variance)

    @cached_property
    def evidences(self) -> Array:
        """Log Bayes factor of each block against leaving it out (blocks,)."""
        found = np.full(len(self.blocks), -np.inf)
        sizes = np.array([b.columns.stop - b.columns.start for b in self.blocks])
        starts = np.array([b.columns.start for b in self.blocks])
        for size in np.unique(sizes):
            which = np.flatnonzero((sizes == size) & ~np.isin(np.arange(sizes.size), self.admitted))
            if which.size:
                columns = starts[which, None] + np.arange(size)
                found[which] = self._evidence_of(columns)
        return found

    def evidence(self, block: int) -> float:
        """The same of one block."""
        columns = self.blocks[block].columns
        return float(self._evidence_of(np.arange(columns.start, columns.stop)[None])[0])

    def _evidence_of(self, columns: Array) -> Array:
        """Of several blocks of one size: columns (blocks, q)."""
        white = self._whitened[:, columns]  # (refitted, blocks, q)
        inside = self.gram.products[columns[:, :, None], columns[:, None, :]]
        information = (inside - np.einsum("zbi,zbj->bij", white, white, optimize=True)) / self.variance
        return evidence_of(information, self.gradient[columns])


def evidence_of(information: Array, gradient: Array) -> Array:
    """Log Bayes factors for information (b, q, q) and gradients (b, q), or gradients (b, q, draws).

    ``½ Σ [γ² τ²/(1 + τ² λ) - log(1 + τ² λ)]`` over the eigenvalues λ, averaged over the magnitudes τ.
    """
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    drawn = gradient.ndim == 3
    along = np.einsum("bij,bi...->bj...", vectors, gradient)
    total = None
    for magnitude in MAGNITUDES**2:
        shrink = magnitude / (1.0 + magnitude * values)
        penalty = np.log1p(magnitude * values).sum(axis=1)
        gain = 0.5 * (np.einsum("bj...,bj->b...", along**2, shrink) - (penalty[:, None] if drawn else penalty))
        total = gain if total is None else np.logaddexp(total, gain)
    assert total is not None
    return np.asarray(total - np.log(len(MAGNITUDES)))


def factor(matrix: Array) -> Array:
    """A Cholesky factor of a positive semidefinite matrix, with as little added as it needs."""
    size = float(np.trace(matrix)) / max(len(matrix), 1)
    return np.asarray(cho_factor(matrix + 1e-10 * size * np.eye(len(matrix)), lower=True, check_finite=False)[0])
