"""How well each candidate explains what is left, given those already admitted: evidence with priors on magnitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.diagnosis.design_matrix import Block
from aacmm_pin.diagnosis.gram_matrix import Gram
from aacmm_pin.diagnosis.nuisance_projection import Projection

SCATTER = 1e-3
"""χ² less likely than this means that the records scatter more than their noise; their variance is then taken from them."""
MAGNITUDES = np.array([0.2, 0.5, 1.0, 2.0, 10.0])
"""Standard deviations of a cause's parameters that its evidence averages over, in units of the typical magnitude."""
LARGE = 6
"""From so many columns on, a Cholesky factor for each magnitude costs less than all eigenvalues."""
WHOLE = 1.0 - 1e-12
"""The largest part of χ² that a cause may take: all of it, but for rounding."""


@dataclass(frozen=True, eq=False)
class Conditional:
    """What is left of every block when nuisances and admitted blocks have been refitted.

    ``residual(δ) = r + J δ``. With the nuisances at their best, block k has information S_k and gradient g_k; both are
    divided by the variance factor with which the records scatter. Where that factor comes from these records themselves,
    evidences are those of Student's t, see :func:`evidence_of`.

    Attributes:
        projection: the same without the variance factor.
        variance: factor by which the records scatter more than their noise.
        dof: degrees of freedom from which the factor was taken; infinite where the noise is known.
    """

    projection: Projection
    variance: float = 1.0
    dof: float = np.inf

    @staticmethod
    def of(gram: Gram, admitted: tuple[int, ...], stated: bool) -> Conditional:
        """With the variance factor that the records show: where the noise is stated, only if they surely scatter more."""
        bare = Projection(gram, admitted)
        if bare.dof <= 0:
            return Conditional(bare)
        ratio = bare.chi2 / bare.dof
        scatters = ratio > 1.0 and chi2_sf(bare.chi2, bare.dof) < SCATTER
        if stated and not scatters:
            return Conditional(bare)
        return Conditional(bare, max(ratio, 1.0) if stated else ratio, bare.dof)

    @cached_property
    def gradient(self) -> Array:
        """Of every column (columns,)."""
        return self.projection.gradient(slice(None))[:-1] / self.variance

    def gradients(self, products: Array) -> Array:
        """The same for other residuals, given by their products with all columns (columns, draws)."""
        white = self.projection.of(products)
        return np.asarray((products - self.projection.whitened()[:, :-1].T @ white) / self.variance)

    @property
    def covariance(self) -> Array:
        """Covariance of the refitted columns, in units of the design's scales (refitted, refitted)."""
        return self.variance * self.projection.covariance

    def information(self, block: Block) -> Array:
        """Inner products of a block's columns when what is refitted is at its best (q, q)."""
        return self.projection.information(block) / self.variance

    def cross(self, one: Block, other: Block) -> Array:
        """The same of the columns of two blocks (q, q')."""
        return self.projection.cross(one, other) / self.variance

    @cached_property
    def evidences(self) -> Array:
        """Log Bayes factor of each block against leaving it out; minus infinity for the admitted (blocks,)."""
        return self._evidences(self.projection.informations, self.gradient, self.projection.chi2, self.projection.admitted)

    def evidences_without(self, block: int) -> Array:
        """The same with one of the admitted blocks taken out, by the variance that is left with it (blocks,)."""
        projection, rows = self.projection, self.projection.rows_of(block)
        gradient = self.gradient + rows[:, :-1].T @ rows[:, -1] / self.variance
        chi2, rest = projection.chi2 + float(rows[:, -1] @ rows[:, -1]), [k for k in projection.admitted if k != block]
        return self._evidences(lambda size: projection.informations_without(rows, size), gradient, chi2, rest)

    def _evidences(
        self, informations: Callable[[int], Array], gradient: Array, chi2: float, admitted: Sequence[int]
    ) -> Array:
        products = self.projection.gram.products
        found = np.full(len(products.design.blocks), -np.inf)
        for size, own in products.of_size.items():
            information = informations(size) / self.variance
            found[own] = evidence_of(information, gradient[products.columns[size]], self.scatter(chi2))
        found[list(admitted)] = -np.inf
        return found

    def evidence(self, block: int) -> float:
        """The same of one block."""
        b = self.projection.blocks[block]
        gradient = self.projection.gradient(b.columns) / self.variance
        return float(evidence_of(self.information(b)[None], gradient[None], self.scatter(self.projection.chi2))[0])

    def of_admitted(self) -> float:
        """Log Bayes factor of all admitted blocks together against none: of each beside those before it, added up."""
        each = self.projection.one_by_one()
        total, chi2 = 0.0, self.projection.chi2 + sum(lower for _, _, lower in each)
        for s, g, lower in each:
            total += float(evidence_of(s[None] / self.variance, g[None] / self.variance, self.scatter(chi2))[0])
            chi2 -= lower
        return total

    def scatter(self, chi2: float) -> Scatter:
        """What the records tell of their scatter where χ² is ``chi2`` (its variance factor not taken out)."""
        return Scatter(chi2 / self.variance, self.dof)


class Scatter(NamedTuple):
    """What is left of χ² without a block, and the degrees of freedom of the noise; infinite if it is known."""

    chi2: float
    dof: float


KNOWN = Scatter(np.inf, np.inf)
"""Of noise that is known."""


def evidence_of(information: Array, gradient: Array, scatter: Scatter = KNOWN) -> Array:
    """Log Bayes factors for information (b, q, q) and gradients (b, q), or gradients (b, q, draws).

    ``½ Σ [γ² τ²/(1 + τ² λ) - log(1 + τ² λ)]`` over the eigenvalues λ, averaged over the magnitudes τ. Noise that is taken
    from the records with ν degrees of freedom is integrated over (Zellner 1971, ch. 3): a gain of 2 G in χ² then counts as
    ``-ν/2 log(1 - 2 G/χ²)`` instead of G.
    """
    gradients = gradient if gradient.ndim == 3 else gradient[:, :, None]
    try:
        large = information.shape[1] >= LARGE and gradients.shape[2] == 1
        gain, penalty = (_by_factors if large else _by_eigenvalues)(information, gradients)
    except np.linalg.LinAlgError:  # rounding left an eigenvalue far below zero
        gain, penalty = _by_eigenvalues(information, gradients)
    if np.isfinite(scatter.dof):
        gain = -0.5 * scatter.dof * np.log1p(-np.minimum(2.0 * gain / scatter.chi2, WHOLE))
    gain -= penalty[:, :, None]
    total = np.logaddexp.reduce(gain, axis=1) - np.log(len(MAGNITUDES))
    return np.asarray(total if gradient.ndim == 3 else total[:, 0])


def _by_eigenvalues(information: Array, gradients: Array) -> tuple[Array, Array]:
    """``½ γᵀ (S + τ⁻²)⁻¹ γ`` (b, magnitudes, draws) and ``½ log det(1 + τ² S)`` (b, magnitudes)."""
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    scaled = MAGNITUDES[:, None] ** 2 * values[:, None]  # (b, magnitudes, q)
    # As products of matrices, which BLAS does: (b, magnitudes, q) @ (b, q, draws)
    along = vectors.transpose(0, 2, 1) @ gradients
    return 0.5 * (MAGNITUDES[:, None] ** 2 / (1.0 + scaled) @ np.square(along)), 0.5 * np.log1p(scaled).sum(axis=2)


def _by_factors(information: Array, gradients: Array) -> tuple[Array, Array]:
    """The same for one draw, by ``L Lᵀ = S + τ⁻²``, with ``L⁻¹ γ`` as one row more.

    Raises:
        LinAlgError: rounding left an eigenvalue of ``S`` below the least ``-τ⁻²``.
    """
    b, q = information.shape[:2]
    whole = np.empty((b, MAGNITUDES.size, q + 1, q + 1))
    whole[:, :, :q, :q] = information[:, None] + np.eye(q) / MAGNITUDES[:, None, None] ** 2
    whole[:, :, q, :q] = gradients[:, None, :, 0]  # of a symmetric matrix the lower triangle is read
    whole[:, :, q, q] = np.finfo(np.float64).max
    factor = np.linalg.cholesky(whole)
    diagonal = np.diagonal(factor, axis1=2, axis2=3)[:, :, :q]
    gain = 0.5 * np.square(factor[:, :, q:, :q]).sum(axis=3)
    return gain, np.log(diagonal * MAGNITUDES[:, None]).sum(axis=2)
