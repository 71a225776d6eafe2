"""How well each candidate explains what is left, given those already admitted: evidence with priors on magnitude."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin.checks import Array, Index
from aacmm_pin.diagnosis.design import Block
from aacmm_pin.diagnosis.products import Gram
from aacmm_pin.diagnosis.projection import Projection

MAGNITUDES = np.array([0.2, 0.5, 1.0, 2.0, 10.0])
"""Standard deviations of a cause's parameters that its evidence averages over, in units of the typical magnitude."""


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
        known: the projection, where that has been worked out.
    """

    gram: Gram
    blocks: tuple[Block, ...]
    nuisances: int
    admitted: tuple[int, ...]
    variance: float = 1.0
    known: Projection | None = None

    @cached_property
    def projection(self) -> Projection:
        """The same without the variance factor."""
        return self.known or Projection(self.gram, self.blocks, self.nuisances, self.admitted)

    def scattering(self, variance: float) -> Conditional:
        """The same with another variance factor."""
        return replace(self, variance=variance, known=self.projection)

    @property
    def refitted(self) -> Index:
        """Numbers of the columns that are refitted."""
        return self.projection.refitted

    @cached_property
    def gradient(self) -> Array:
        """Of every column (columns,)."""
        return self.projection.gradient(slice(None))[:-1] / self.variance

    def gradients(self, products: Array) -> Array:
        """The same for other residuals, given by their products with all columns (columns, draws)."""
        white = self.projection.of(products)
        return np.asarray((products - self.projection.whitened()[:, :-1].T @ white) / self.variance)

    @property
    def chi2(self) -> float:
        """What is left of χ², prior rows included."""
        return self.projection.chi2

    @property
    def determined(self) -> float:
        """How many of the refitted parameters the records, apart from priors, determine."""
        return self.projection.determined

    @property
    def covariance(self) -> Array:
        """Covariance of the refitted columns, in units of the design's scales (refitted, refitted)."""
        return self.variance * self.projection.covariance

    def solution(self) -> Array:
        """Best step of the refitted columns, in units of the design's scales."""
        return self.projection.solution()

    def information(self, block: Block) -> Array:
        """Inner products of a block's columns when what is refitted is at its best (q, q)."""
        return self.projection.information(block) / self.variance

    def cross(self, one: Block, other: Block) -> Array:
        """The same of the columns of two blocks (q, q')."""
        return self.projection.cross(one, other) / self.variance

    def whole(self, block: Block) -> Array:
        """Inner products of a block's columns as they are, nothing refitted (q, q)."""
        return np.asarray(self.gram.inside(block) / self.variance)

    @cached_property
    def evidences(self) -> Array:
        """Log Bayes factor of each block against leaving it out; minus infinity for the admitted (blocks,)."""
        found = np.full(len(self.blocks), -np.inf)
        for size, own in self.gram.products.of_size.items():
            columns = self.gram.products.columns_of_size(size)
            found[own] = evidence_of(self.projection.informations(size) / self.variance, self.gradient[columns])
        found[list(self.admitted)] = -np.inf
        return found

    def evidences_without(self, block: int) -> Array:
        """The same with one of the admitted blocks taken out, by the variance that is left with it (blocks,)."""
        rows = self.projection.rows_of(block)
        gradient = self.gradient + rows[:, :-1].T @ rows[:, -1] / self.variance
        found = np.full(len(self.blocks), -np.inf)
        for size, own in self.gram.products.of_size.items():
            columns = self.gram.products.columns_of_size(size)
            information = self.projection.informations_without(rows, size) / self.variance
            found[own] = evidence_of(information, gradient[columns])
        found[[k for k in self.admitted if k != block]] = -np.inf
        return found

    def evidence(self, block: int) -> float:
        """The same of one block."""
        b = self.blocks[block]
        gradient = self.projection.gradient(b.columns) / self.variance
        return float(evidence_of(self.information(b)[None], gradient[None])[0])

    def of_admitted(self) -> float:
        """Log Bayes factor of all admitted blocks together against none: of each beside those before it, added up."""
        each = self.projection.one_by_one()
        return sum(float(evidence_of(s[None] / self.variance, g[None] / self.variance)[0]) for s, g in each)


def evidence_of(information: Array, gradient: Array) -> Array:
    """Log Bayes factors for information (b, q, q) and gradients (b, q), or gradients (b, q, draws).

    ``½ Σ [γ² τ²/(1 + τ² λ) - log(1 + τ² λ)]`` over the eigenvalues λ, averaged over the magnitudes τ.
    """
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    scaled = MAGNITUDES[:, None, None] ** 2 * values  # (magnitudes, b, q)
    shrink, penalty = MAGNITUDES[:, None, None] ** 2 / (1.0 + scaled), np.log1p(scaled).sum(axis=2)
    # As products of matrices, which BLAS does: (b, magnitudes, q) @ (b, q, draws)
    along = vectors.transpose(0, 2, 1) @ (gradient if gradient.ndim == 3 else gradient[:, :, None])
    gain = 0.5 * (shrink.transpose(1, 0, 2) @ np.square(along) - penalty.T[:, :, None])
    total = np.logaddexp.reduce(gain, axis=1) - np.log(len(MAGNITUDES))
    return np.asarray(total if gradient.ndim == 3 else total[:, 0])
