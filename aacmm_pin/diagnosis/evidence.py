"""How well each candidate explains what is left, given those already admitted: evidence with priors on magnitude."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from aacmm_pin.checks import Array
from aacmm_pin.diagnosis.design import Block
from aacmm_pin.diagnosis.products import Gram

MAGNITUDES = np.array([0.2, 0.5, 1.0, 2.0, 10.0])
"""Standard deviations of a cause's parameters that its evidence averages over, in units of the typical magnitude."""
ADMITTED = 10.0
"""Parameters of an admitted cause are free within so many typical magnitudes …"""
SMOOTH = 2.0
"""… and where they are many, the coefficients of something smooth, within so many: some may be told by few records."""
MANY = 8
"""From so many parameters on."""


def freedom(parameters: int) -> float:
    """Within how many typical magnitudes each parameter of an admitted cause is free."""
    return ADMITTED if parameters < MANY else SMOOTH


ROUNDING = 1e-14
"""Inner products are no more certain than this part of them."""


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
        return np.concatenate([np.arange(s.start, s.stop) for s in self._slices])

    @cached_property
    def _slices(self) -> list[slice]:
        return [slice(0, self.nuisances), *(self.blocks[k].columns for k in self.admitted)]

    @cached_property
    def _strips(self) -> Array:
        """Products of what is refitted with all columns (refitted, columns + 1)."""
        return np.concatenate([self.gram.strip(s) for s in self._slices])

    @cached_property
    def _factor(self) -> Array:
        # A frame without a prior is many metres wide: the rounding of its products may be more than what is known of others.
        every = [np.diag(self.gram.products.strip(None, s)[:, s]) for s in self._slices]
        inside = self._strips[:, self.refitted] + np.diag(self._prior + ROUNDING * np.concatenate(every))
        return np.asarray(np.linalg.cholesky(inside))

    @cached_property
    def _prior(self) -> Array:
        """What is added to the information of the refitted columns; that of the nuisances has theirs already."""
        sizes = [self.blocks[k].size for k in self.admitted]
        own = [np.full(size, 1.0 / freedom(size) ** 2) for size in sizes]
        return np.concatenate([np.full(self.nuisances, 1e-9), *own])

    @cached_property
    def _whitened(self) -> Array:
        """``L⁻¹ G``: (refitted, columns + 1)."""
        return np.asarray(solve_triangular(self._factor, self._strips, lower=True, check_finite=False))

    @cached_property
    def gradient(self) -> Array:
        """Of every column (columns,)."""
        white = self._whitened
        return np.asarray((self.gram.residual[:-1] - white[:, :-1].T @ white[:, -1]) / self.variance)

    def gradients(self, products: Array) -> Array:
        """The same for other residuals, given by their products with all columns (columns, draws)."""
        white = solve_triangular(self._factor, products[self.refitted], lower=True, check_finite=False)
        return np.asarray((products - self._whitened[:, :-1].T @ white) / self.variance)

    @cached_property
    def chi2(self) -> float:
        """What is left of χ², prior rows included."""
        return float(self.gram.residual[-1] - self._whitened[:, -1] @ self._whitened[:, -1])

    @cached_property
    def determined(self) -> float:
        """How many of the refitted parameters the records, apart from priors, determine."""
        inverse = np.diag(self.covariance) / self.variance
        prior = np.concatenate([np.ones(self.nuisances), self._prior[self.nuisances :]])
        return float(self.refitted.size - np.sum(inverse * prior))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the refitted columns, in units of the design's scales (refitted, refitted)."""
        return np.asarray(self.variance * cho_solve((self._factor, True), np.eye(self.refitted.size), check_finite=False))

    def solution(self) -> Array:
        """Best step of the refitted columns, in units of the design's scales."""
        right = self._whitened[:, -1]
        return np.asarray(-solve_triangular(self._factor.T, right, lower=False, check_finite=False))

    def information(self, block: Block) -> Array:
        """Inner products of a block's columns when what is refitted is at its best (q, q)."""
        white = self._whitened[:, block.columns]
        return np.asarray((self.gram.inside(block) - white.T @ white) / self.variance)

    def cross(self, one: Block, other: Block) -> Array:
        """The same of the columns of two blocks (q, q')."""
        white = self._whitened
        left = self.gram.strip(one.columns)[:, other.columns] - white[:, one.columns].T @ white[:, other.columns]
        return np.asarray(left / self.variance)

    def whole(self, block: Block) -> Array:
        """Inner products of a block's columns as they are, nothing refitted (q, q)."""
        return np.asarray(self.gram.inside(block) / self.variance)

    @cached_property
    def evidences(self) -> Array:
        """Log Bayes factor of each block against leaving it out; minus infinity for the admitted (blocks,)."""
        found = np.full(len(self.blocks), -np.inf)
        sizes = np.array([b.size for b in self.blocks])
        for size in np.unique(sizes):
            found[sizes == size] = self._evidences_of(int(size))
        found[list(self.admitted)] = -np.inf
        return found

    def evidence(self, block: int) -> float:
        """The same of one block."""
        b = self.blocks[block]
        return float(evidence_of(self.information(b)[None], self.gradient[b.columns][None])[0])

    def _evidences_of(self, size: int) -> Array:
        """Of all blocks of one size."""
        columns = self.gram.products.columns_of_size(size)
        white = self._whitened[:, columns].transpose(1, 0, 2)  # (blocks, refitted, q)
        information = (self.gram.insides(size) - white.transpose(0, 2, 1) @ white) / self.variance
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
