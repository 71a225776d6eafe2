"""The linear model of what is left: causes, nuisances and a background, all integrated over.

``r = Z η + Σ G_k β_k + B d + ε`` in units of the records' noise. Nuisances η and the background d
are taken out of the inner products once for each amplitude of the background; the blocks of a set
are then conditioned on by one small Cholesky factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy.linalg.blas import dtrsm
from scipy.special import gammaln

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.diagnosis.design_matrix import Block
from aacmm_pin.diagnosis.gram_matrix import Gram, numbers_of
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

UNKNOWN = 1e-9
"""What is added to the information of a nuisance: what is known of it beforehand is among the
products already."""
HELD = 1e12
"""What is added to that of one which is held where it is stated."""
ROUNDINGS = (1e-14, 1e-12, 1e-10, 1e-8)
"""Inner products are no more certain than this part of them, the first with which they are positive
definite."""
LARGE = 6
"""From so many columns on, a Cholesky factor for each width costs less than all eigenvalues."""
LEAST_CHI2 = 1e-9
"""χ² is at least this, of data that fit without any residual."""

WIDTHS = np.array(THRESHOLDS.widths)


@dataclass(frozen=True)
class Likelihood:
    """Marginal likelihood of the residuals by their χ², the scale of the noise integrated over.

    Where the noise is not stated, ``σ`` has the prior ``1/σ``: ``χ²^(-ν/2)`` (Zellner 1971, ch. 3).
    Where it is stated, it is as stated but for a small probability, with which ``σ²`` has an
    inverse gamma prior about one.

    Attributes:
        dof: degrees of freedom ν.
        stated: whether the noise is stated.
    """

    dof: float
    stated: bool

    def log(self, chi2: Array | float) -> Array:
        """Log marginal likelihood for values of χ², up to a constant."""
        chi2 = np.maximum(chi2, LEAST_CHI2)
        if not self.stated:
            return np.asarray(-0.5 * self.dof * np.log(chi2))
        a = 0.5 * THRESHOLDS.scale_dof
        b = a + 0.5 * self.dof
        free = a * np.log(a) - gammaln(a) + gammaln(b) - b * np.log(a + 0.5 * chi2)
        share = THRESHOLDS.noise_misstated
        as_stated = np.log1p(-share) - 0.5 * chi2
        return np.asarray(np.logaddexp(as_stated, np.log(share) + free))

    def variance(self, chi2: float) -> float:
        """Factor on the variance of the noise that a value of χ² makes most probable."""
        if self.dof <= 0:
            return 1.0
        ratio = max(chi2, LEAST_CHI2) / self.dof
        as_stated = self.stated and np.log1p(-THRESHOLDS.noise_misstated) - 0.5 * chi2 > self.log(
            chi2
        ) - np.log(2.0)
        return 1.0 if as_stated else ratio


@dataclass(frozen=True, eq=False)
class Base:
    """Inner products with nuisances and the background, of one amplitude, integrated over.

    Attributes:
        gram: inner products, prior rows of the nuisances included.
        amplitude: root mean square of the background over that of the noise; 0 without it.
        as_stated: what is stated of known causes holds exactly.
    """

    gram: Gram
    amplitude: float
    as_stated: bool = False

    @property
    def nuisances(self) -> int:
        """Number of nuisance columns."""
        return self.gram.products.design.nuisances

    @cached_property
    def _products(self) -> tuple[Array, Array]:
        """Products of nuisances and background with all columns (b, columns + 1), and with one
        another (b, b).
        """
        first = slice(0, self.nuisances)
        rows = self.gram.strip(first)
        if not self.amplitude:
            return rows, rows[:, first]
        with_all, inside = self.gram.background
        across = with_all[:, first]
        whole = np.block([[rows[:, first], across.T], [across, inside]])
        return np.concatenate([rows, with_all]), whole

    @cached_property
    def prior(self) -> Array:
        """Prior precision of nuisances and background (b,)."""
        known = self.gram.products.design.known
        found = np.full(len(self._products[1]), UNKNOWN)
        found[known] = HELD if self.as_stated else UNKNOWN
        found[self.nuisances :] = 1.0 / max(self.amplitude, LEAST_CHI2) ** 2
        return found

    @cached_property
    def factor(self) -> Array:
        """Lower Cholesky factor of their precision, after the records (b, b)."""
        whole = self._products[1]
        # A frame without a prior is many metres wide: the rounding of its products may be more than
        # what is known of others.
        every = np.diag(whole) + 0.0
        every[: self.nuisances] = np.diag(
            self.gram.products.strip(None, slice(0, self.nuisances))[:, : self.nuisances]
        )
        for rounding in ROUNDINGS:
            found, failed = scipy.linalg.lapack.dpotrf(
                whole + np.diag(self.prior + rounding * every), lower=1, clean=1
            )
            if not failed:
                break
        return np.asarray(found)

    @cached_property
    def whitened(self) -> Array:
        """``L⁻¹`` times their products with all columns and the residual (b, columns + 1)."""
        return divided(self.factor, self._products[0])

    @cached_property
    def log_volume(self) -> float:
        """``½ log det(1 + a² D)`` of the background's products D, nuisances at their best."""
        own = np.diag(self.factor)[self.nuisances :]
        return float(np.log(own * self.amplitude).sum()) if own.size else 0.0

    @cached_property
    def residual(self) -> Array:
        """Products of the residual with all columns and itself (columns + 1,)."""
        explained = self.whitened[:, -1] @ self.whitened
        return self.gram.residual - explained

    @cached_property
    def _strips(self) -> dict[int, Array]:
        return {}

    def strip(self, block: int) -> Array:
        """Products of a block's columns with all and with the residual (q, columns + 1)."""
        if block not in self._strips:
            columns = self.gram.products.design.blocks[block].columns
            self._strips[block] = (
                self.gram.strip(columns) - self.whitened[:, columns].T @ self.whitened
            )
        return self._strips[block]

    def among(self, blocks: tuple[int, ...]) -> Array:
        """Products of the columns of some blocks with one another and with the residual, which is
        last (m + 1, m + 1).
        """
        design = self.gram.products.design
        strips = [design.blocks[k].columns for k in blocks]
        own = numbers_of([*strips, slice(design.width, design.width + 1)])
        whitened = self.whitened[:, own]
        products = np.concatenate(
            [*(self.gram.strip(s, own) for s in strips), self.gram.residual[None, own]]
        )
        return products - whitened.T @ whitened

    @cached_property
    def _diagonal_blocks(self) -> dict[int, Array]:
        return {}

    def diagonal_blocks(self, size: int) -> Array:
        """Products inside each block of a size (blocks, q, q)."""
        if size not in self._diagonal_blocks:
            self._diagonal_blocks[size] = self.gram.diagonal_blocks(size) - squares(
                self.gram, self.whitened, size
            )
        return self._diagonal_blocks[size]

    @cached_property
    def determined(self) -> float:
        """How many parameters of nuisances and background the records, apart from priors,
        determine.
        """
        inverse = divided(self.factor, np.eye(len(self.factor)))
        first = self.nuisances
        prior = self.gram.products.prior.rows[:, :first]
        of_nuisances = np.square(inverse[:, :first] @ prior.T).sum()
        variances = np.square(inverse[:, first:]).sum(axis=0)
        of_others = variances @ self.prior[first:]
        return float(len(self.factor) - of_nuisances - of_others)


@dataclass(frozen=True, eq=False)
class Conditional:
    """The base with the blocks of a set integrated over, each parameter ``β ~ N(0, τ²)`` in units
    of the typical magnitude.

    Attributes:
        base: nuisances and background integrated over.
        blocks: numbers of the set's blocks.
        widths: numbers of their τ.
        likelihood: of χ².
        products: of the set's columns with one another and with the residual, which is last (m + 1,
            m + 1).
    """

    base: Base
    blocks: tuple[int, ...]
    widths: tuple[int, ...]
    likelihood: Likelihood
    products: Array

    @staticmethod
    def of(
        base: Base, blocks: tuple[int, ...], widths: tuple[int, ...], likelihood: Likelihood
    ) -> Conditional:
        """The blocks, by their products beside the base."""
        return Conditional(base, blocks, widths, likelihood, base.among(blocks))

    @property
    def design_blocks(self) -> tuple[Block, ...]:
        """All blocks of the design."""
        return self.base.gram.products.design.blocks

    @cached_property
    def columns(self) -> Index:
        """Numbers of the set's columns (m,)."""
        return numbers_of([self.design_blocks[k].columns for k in self.blocks])

    @cached_property
    def places(self) -> dict[int, slice]:
        """Where each block is among the set's columns."""
        sizes = [self.design_blocks[k].size for k in self.blocks]
        ends = np.cumsum(sizes, dtype=int).tolist()
        slices = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        return dict(zip(self.blocks, slices, strict=True))

    @cached_property
    def scale(self) -> Array:
        """Prior width of each of the set's parameters (m,)."""
        sizes = [self.design_blocks[k].size for k in self.blocks]
        return np.repeat(WIDTHS[list(self.widths)], sizes)

    @cached_property
    def factor(self) -> Array:
        """Lower Cholesky factor of the parameters' precision ``G + T⁻²`` (m, m)."""
        precision = self.products[:-1, :-1].copy()
        precision.flat[:: len(precision) + 1] += self.scale**-2.0
        return np.asarray(np.linalg.cholesky(precision))

    @cached_property
    def estimate(self) -> Array:
        """Posterior mean of the set's parameters (m,), as a step."""
        if not self.blocks:
            return np.zeros(0)
        return np.asarray(
            -scipy.linalg.lapack.dpotrs(self.factor, self.products[:-1, -1], lower=1)[0]
        )

    @cached_property
    def inverse(self) -> Array:
        """Their posterior covariance for noise of unit variance (m, m)."""
        if not self.blocks:
            return np.zeros((0, 0))
        lower = scipy.linalg.lapack.dpotri(self.factor, lower=1)[0]
        whole = lower + lower.T
        whole.flat[:: len(whole) + 1] *= 0.5
        return np.asarray(whole)

    @property
    def covariance(self) -> Array:
        """Their posterior covariance (m, m), in units of the design's scales."""
        return self.variance * self.inverse

    @cached_property
    def chi2(self) -> float:
        """What is left of χ²."""
        change = self.products[:-1, -1] @ self.estimate
        return float(self.products[-1, -1] + change)

    @cached_property
    def log_volume(self) -> float:
        """``½ log det`` of set and background over their priors."""
        over_prior = np.diag(self.factor) * self.scale
        return self.base.log_volume + float(np.log(over_prior).sum())

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood, up to a constant of these records."""
        return float(self.likelihood.log(self.chi2)) - self.log_volume

    @property
    def variance(self) -> float:
        """Factor by which the records scatter more than their noise."""
        return self.likelihood.variance(self.chi2)

    @cached_property
    def dof(self) -> float:
        """Degrees of freedom that the set leaves, of all that it may use."""
        of_prior = np.diag(self.inverse) / np.square(self.scale)
        used = self.columns.size - float(of_prior.sum())
        return float(self.base.gram.free - self.base.determined - used)

    @property
    def over_widths(self) -> Array:
        """Log marginal likelihood with each width of each block, and last without it (blocks,
        widths + 1).
        """
        each = [*map(self._over_widths, self.blocks, self.widths)]
        return np.array(each).reshape(-1, WIDTHS.size + 1)

    def _over_widths(self, block: int, width: int) -> Array:
        own = self.places[block]
        precision = np.linalg.inv(self.inverse[own, own])
        information = precision - np.eye(len(precision)) / WIDTHS[width] ** 2
        gradient = precision @ self.estimate[own]
        gain, volume = gains(information[None], gradient[None, :, None])
        gain = np.append(gain, 0.0)
        volume = np.append(volume, 0.0)
        chi2 = self.chi2 + 2.0 * (gain[width] - gain)
        log_volume = self.log_volume + volume - volume[width]
        return np.asarray(self.likelihood.log(chi2) - log_volume)

    @cached_property
    def whitened(self) -> Array:
        """``L⁻¹ G`` of all columns and the residual (m, columns + 1)."""
        if not self.blocks:
            return np.zeros((0, self.base.residual.size))
        rows = np.concatenate([self.base.strip(k) for k in self.blocks])
        return divided(self.factor, rows)

    @cached_property
    def residual(self) -> Array:
        """Products of the residual with all columns and itself, the set integrated over (columns +
        1,).
        """
        explained = self.whitened[:, -1] @ self.whitened
        return self.base.residual - explained

    def of_residuals(self, products: Array) -> Array:
        """The same of other residuals, by their products with all columns (columns, draws) ->
        (columns, draws).
        """
        base = self.base
        first = self.base.nuisances
        background = np.zeros((len(base.factor) - first, products.shape[1]))
        if background.size:
            columns, weights = base.gram.products.background
            background = weights.T @ products[columns]
        of_base = divided(base.factor, np.concatenate([products[:first], background]))
        left = products - base.whitened[:, :-1].T @ of_base
        if self.blocks:
            left = left - self.whitened[:, :-1].T @ divided(self.factor, left[self.columns])
        return left

    def informations(self, size: int) -> Array:
        """Information of every block of a size, the set integrated over (blocks, q, q)."""
        if not self.blocks:
            return self.base.diagonal_blocks(size)
        return self.base.diagonal_blocks(size) - squares(self.base.gram, self.whitened, size)

    def information(self, block: int) -> Array:
        """The same of one block (q, q)."""
        return self.cross(block, block)

    def cross(self, one: int, other: int) -> Array:
        """Products of the columns of two blocks, the set integrated over (q, q')."""
        first, second = (self.design_blocks[k].columns for k in (one, other))
        beside_base = self.base.strip(one)[:, second]
        taken = self.whitened[:, first].T @ self.whitened[:, second]
        return beside_base - taken

    @cached_property
    def additions(self) -> Array:
        """Log marginal likelihood with each block more, at each width (blocks, widths); minus
        infinity for its own.
        """
        products = self.base.gram.products
        found = np.full((len(self.design_blocks), WIDTHS.size), -np.inf)
        for size, own in products.of_size.items():
            gain, volume = gains(
                self.informations(size), self.residual[products.columns[size]][:, :, None]
            )
            found[own] = (
                self.likelihood.log(self.chi2 - 2.0 * gain[:, :, 0]) - volume - self.log_volume
            )
        found[list(self.blocks)] = -np.inf
        return found

    @cached_property
    def step(self) -> Array:
        """Posterior mean step of nuisances, background and set, in this order (b + m,)."""
        whitened = self.base.whitened
        right = whitened[:, -1] + whitened[:, self.columns] @ self.estimate
        of_base = scipy.linalg.solve_triangular(self.base.factor, right, lower=True, trans=1)
        return np.concatenate([-of_base, self.estimate])

    def tips(self, rows: Index | slice = slice(None)) -> Array:
        """Tips of some records with everything at its posterior mean (n, 3), with orientations (n,
        6) [m, rad].
        """
        products = self.base.gram.products
        design = products.design
        each = [design.columns(None)[rows]]
        if self.base.amplitude:
            each.append(products.background_columns[rows])
        each += [design.columns(k)[rows] for k in self.blocks]
        return design.tips[rows] + np.concatenate(each, axis=2) @ self.step


def gains(information: Array, gradient: Array) -> tuple[Array, Array]:
    """What blocks gain in log likelihood at each width, and ``½ log det(1 + τ² S)``.

    ``½ γᵀ (S + τ⁻²)⁻¹ γ`` for informations S (b, q, q) and gradients γ (b, q, draws).

    Returns:
        (b, widths, draws) and (b, widths).
    """
    if information.shape[1] >= LARGE and gradient.shape[2] == 1:
        try:
            return _by_factors(information, gradient)
        except np.linalg.LinAlgError:  # rounding left an eigenvalue far below zero
            pass
    return _by_eigenvalues(information, gradient)


def _by_eigenvalues(information: Array, gradient: Array) -> tuple[Array, Array]:
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, 0.0)
    scaled = WIDTHS[:, None] ** 2 * values[:, None]  # (b, widths, q)
    along = vectors.transpose(0, 2, 1) @ gradient
    return 0.5 * (WIDTHS[:, None] ** 2 / (1.0 + scaled) @ np.square(along)), 0.5 * np.log1p(
        scaled
    ).sum(axis=2)


def _by_factors(information: Array, gradient: Array) -> tuple[Array, Array]:
    """The same for one draw, by ``L Lᵀ = S + τ⁻²``, with ``L⁻¹ γ`` as one row more.

    Raises:
        LinAlgError: rounding left an eigenvalue of ``S`` below the least ``-τ⁻²``.
    """
    b, q = information.shape[:2]
    whole = np.empty((b, WIDTHS.size, q + 1, q + 1))
    prior = np.eye(q) / WIDTHS[:, None, None] ** 2
    whole[:, :, :q, :q] = information[:, None] + prior
    whole[:, :, q, :q] = gradient[:, None, :, 0]  # of a symmetric matrix the lower triangle is read
    whole[:, :, q, q] = np.finfo(np.float64).max
    factor = np.linalg.cholesky(whole)
    diagonal = np.diagonal(factor, axis1=2, axis2=3)[:, :, :q]
    gain = 0.5 * np.square(factor[:, :, q:, :q]).sum(axis=3)
    volume = np.log(diagonal * WIDTHS[:, None]).sum(axis=2)
    return gain.reshape(b, -1, 1), volume


def log_sum(logs: Array) -> Array:
    """Log of the sum of exponentials over the last axis: a tenth of the time of SciPy's, for a
    handful of numbers.
    """
    return np.asarray(np.logaddexp.reduce(logs, axis=-1))


def squares(gram: Gram, rows: Array, size: int) -> Array:
    """``Rᵀ R`` of the columns of every block of a size (blocks, q, q)."""
    each = rows[:, gram.products.columns[size]].transpose(1, 0, 2)  # (blocks, rows, q)
    return each.transpose(0, 2, 1) @ each


def divided(factor: Array, right: Array) -> Array:
    """``L⁻¹ R``, row by row in memory.

    As ``Rᵀ L⁻ᵀ``, whose arrays lie in memory as BLAS wants them: half the time of LAPACK's solver
    with its copies.
    """
    rows = np.ascontiguousarray(right).T
    found = dtrsm(1.0, factor.T, rows, side=1, lower=0, overwrite_b=False)
    return np.asarray(found.T)
