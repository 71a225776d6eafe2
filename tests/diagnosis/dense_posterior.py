"""The posterior over sets of blocks by plain algebra on explicit matrices; it shares no code with
the package.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import norm

Array = NDArray[np.float64]
Blocks = tuple[int, ...]
WIDTHS = np.array([0.2, 0.5, 1.0, 2.0, 10.0])
"""Prior standard deviations of a parameter, equally probable."""
AMPLITUDES = (0.0, 0.1, 0.3, 1.0, 3.0)
"""Of the background, equally probable."""
MISSTATED = 0.05
"""Probability that a stated noise is not the noise. Its variance then is inverse gamma, of shape
and scale one.
"""
NEARLY_FLAT = 1e-9
"""Prior precision of a nuisance of which nothing is known."""
STEPS = np.arange(-8.0, 14.0, 0.5)
"""Log of the scale of the noise, over which is integrated, from its most probable value in units of
its u.
"""


@dataclass(frozen=True, eq=False)
class Dense:
    """Rows of unit noise, ``r = Z η + Σ G β + B d + ε``; r is how far off the arm is, so that a
    parameter is ``-β``.

    Attributes:
        nuisances: Z (n, z).
        columns: G of each block (n, q).
        residual: r (n,).
        log_odds: log prior odds of each block.
        stated: whether the noise is stated.
        background: B (n, b).
        prior: rows ``P η + p`` of unit noise, p last (m, z + 1).
        owners: candidate of each block; None: each is one.
        places: place of each candidate; None: each has its own.
        alone: candidates beside which no other of their place stands.
        positive: blocks whose only parameter is above zero.
    """

    nuisances: Array
    columns: Sequence[Array]
    residual: Array
    log_odds: Array
    stated: bool
    background: Array
    prior: Array
    owners: Sequence[int] | None = None
    places: Sequence[int] | None = None
    alone: frozenset[int] = frozenset()
    positive: frozenset[int] = frozenset()

    @property
    def amplitudes(self) -> tuple[float, ...]:
        return AMPLITUDES if self.background.shape[1] else AMPLITUDES[:1]

    # --- what the nuisances cannot imitate: all rows, priors' included, in directions that are
    # orthogonal to theirs

    @cached_property
    def _whole(self) -> Array:
        z = self.nuisances.shape[1]
        return np.concatenate(
            [self.nuisances, self.prior[:, :-1], np.sqrt(NEARLY_FLAT) * np.eye(z)]
        )

    @cached_property
    def _directions(self) -> Array:
        every, _ = np.linalg.qr(self._whole, mode="complete")
        return every[:, self._whole.shape[1] :]

    def _across(self, rows: Array) -> Array:
        return self._directions[: len(rows)].T @ rows

    @cached_property
    def _residual(self) -> Array:
        return self._across(np.concatenate([self.residual, self.prior[:, -1]]))

    @cached_property
    def _columns(self) -> list[Array]:
        return [self._across(own) for own in self.columns]

    @cached_property
    def _background(self) -> Array:
        return self._across(self.background)

    @cached_property
    def dof(self) -> float:
        """Rows less the nuisances that they determine."""
        own = np.linalg.solve(self._whole.T @ self._whole, self.nuisances.T @ self.nuisances)
        return len(self.residual) - float(np.trace(own))

    # --- one set

    def log_posterior(
        self, blocks: Sequence[int], widths: Sequence[float], amplitude: float
    ) -> float:
        """Up to a constant, by the covariance matrix of the residuals."""
        covariance = (
            np.eye(len(self._residual)) + amplitude**2 * self._background @ self._background.T
        )
        for block, width in zip(blocks, widths, strict=True):
            covariance += width**2 * self._columns[block] @ self._columns[block].T
        chi2 = np.array([self._residual @ np.linalg.solve(covariance, self._residual)])
        log_likelihood = log_over_scale(chi2, self.dof, self.stated)[0]
        found = log_likelihood - 0.5 * np.linalg.slogdet(covariance)[1] + self._log_prior(blocks)
        for block, width in zip(blocks, widths, strict=True):
            if block in self.positive:
                along = np.linalg.solve(covariance, self._columns[block][:, 0])
                mean = -(width**2) * along @ self._residual
                variance = width**2 - width**4 * along @ self._columns[block][:, 0]
                variance *= variance_of_noise(chi2, self.dof, self.stated)[0]
                found += norm.logcdf(mean / np.sqrt(variance)) + np.log(2.0)
        return float(found)

    def _log_prior(self, blocks: Sequence[int]) -> float:
        shares = len(blocks) * np.log(WIDTHS.size) + np.log(len(self.amplitudes))
        return float(self.log_odds[list(blocks)].sum() - shares)

    # --- all of them

    def sets(self, most: int) -> Iterator[Blocks]:
        """Sets of at most so many blocks in which a candidate stands once, and one that stands
        alone has its place for itself.
        """
        count = len(self.columns)
        owners = range(count) if self.owners is None else self.owners
        places = range(count) if self.places is None else self.places
        for size in range(most + 1):
            for blocks in itertools.combinations(range(count), size):
                own = [owners[k] for k in blocks]
                at = [places[c] for c in own]
                crowded = any(at.count(places[c]) > 1 for c in own if c in self.alone)
                if len(set(own)) == size and not crowded:
                    yield blocks

    def summed(self, blocks: Blocks) -> float:
        """Log posterior of a set, all widths and amplitudes summed over."""
        widths = np.array(list(itertools.product(WIDTHS, repeat=len(blocks))))
        sizes = np.array([self.columns[k].shape[1] for k in blocks], dtype=int)
        scale = np.repeat(widths, sizes, axis=1)
        own = np.concatenate(
            [np.zeros((len(self._residual), 0)), *(self._columns[k] for k in blocks)], axis=1
        )
        ends = np.cumsum(sizes)
        above = [int(end) - 1 for k, end in zip(blocks, ends, strict=True) if k in self.positive]
        each = []
        for amplitude in self.amplitudes:
            rest = (
                np.eye(len(self._residual)) + amplitude**2 * self._background @ self._background.T
            )
            both = np.column_stack([own, self._residual])
            products = both.T @ np.linalg.solve(rest, both)
            inside = (
                np.eye(scale.shape[1]) + scale[:, :, None] * products[:-1, :-1] * scale[:, None, :]
            )
            right = scale * products[:-1, -1]
            inverse = np.linalg.inv(inside)
            mean = -(inverse @ right[:, :, None])[:, :, 0]
            gain = -np.einsum("kq,kq->k", right, mean)
            volume = 0.5 * (np.linalg.slogdet(inside)[1] + np.linalg.slogdet(rest)[1])
            chi2 = products[-1, -1] - gain
            log_likelihood = log_over_scale(chi2, self.dof, self.stated) - volume
            factor = variance_of_noise(chi2, self.dof, self.stated) if above else np.ones(1)
            for place in above:
                deviation = np.sqrt(factor * inverse[:, place, place])
                log_likelihood += norm.logcdf(mean[:, place] / deviation) + np.log(2.0)
            each.append(log_likelihood)
        return float(logsumexp(np.concatenate(each)) + self._log_prior(blocks))

    def inclusion(self, most: int) -> tuple[Array, float]:
        """Probability of each block by all sets of at most so many blocks, and that of the largest
        of these sets.
        """
        values = {blocks: self.summed(blocks) for blocks in self.sets(most)}
        total = logsumexp(list(values.values()))
        found, largest = np.zeros(len(self.columns)), 0.0
        for blocks, value in values.items():
            found[list(blocks)] += np.exp(value - total)
            largest += np.exp(value - total) * (len(blocks) == most)
        return found, largest


def log_over_scale(chi2: Array, dof: float, stated: bool) -> Array:
    """Log of ``σ^-ν exp(-χ²/2σ²)``, integrated over what the scale σ of the noise may be (k,); up
    to a constant.
    """
    as_stated, integral = _by_noise(chi2, dof, stated)
    return np.logaddexp(as_stated, integral) if stated else integral


def variance_of_noise(chi2: Array, dof: float, stated: bool) -> Array:
    """Factor on the variance of the noise (k,): one where it is more probably as stated than not,
    else what the residuals have.
    """
    as_stated, integral = _by_noise(chi2, dof, stated)
    return np.where(stated & (as_stated > integral), 1.0, chi2 / dof)


def _by_noise(chi2: Array, dof: float, stated: bool) -> tuple[Array, Array]:
    """Of noise as stated, and integrated over its scale."""
    most_probable = (chi2 + 2.0) / (dof + 2.0) if stated else chi2 / dof
    step = 1.0 / np.sqrt(2.0 * dof)
    log_scale = 0.5 * np.log(most_probable)[:, None] + step * STEPS
    log_density = -dof * log_scale - 0.5 * chi2[:, None] * np.exp(-2.0 * log_scale)
    if stated:
        log_density += _log_inverse_gamma(log_scale) + np.log(MISSTATED)
    integral = logsumexp(log_density, axis=1) + np.log(step * (STEPS[1] - STEPS[0]))
    return np.log(1.0 - MISSTATED) - 0.5 * chi2, integral


def _log_inverse_gamma(log_scale: Array) -> Array:
    """Log density of log σ, where σ² is inverse gamma distributed with shape and scale one."""
    return np.asarray(np.log(2.0) - 2.0 * log_scale - np.exp(-2.0 * log_scale))


def by_quadrature(dense: Dense, blocks: Sequence[int], widths: Sequence[float]) -> float:
    """Log posterior of a set without background: the sum over a grid of every parameter and of the
    scale of the noise.

    Nuisances have a flat prior; prior widths of the others scale with the noise. The grid follows
    the least squares fit, one standard deviation apart, which is exact to 1e-7 of a normal
    integrand.
    """
    own = [np.zeros((len(dense.residual), 0)), *(dense.columns[k] for k in blocks)]
    design = np.concatenate([dense.nuisances, *own], axis=1)
    z, width = dense.nuisances.shape[1], np.repeat(widths, [c.shape[1] for c in own[1:]])
    precision = np.concatenate([np.zeros(z), width**-2.0])
    information = design.T @ design + np.diag(precision)
    centre = np.linalg.solve(information, design.T @ dense.residual)
    apart = np.linalg.inv(np.linalg.cholesky(information)).T
    grid = np.array(list(itertools.product(np.arange(-6.0, 7.0), repeat=len(centre))))
    volume = np.linalg.slogdet(apart)[1]
    normal = -np.log(width).sum() - 0.5 * width.size * np.log(2.0 * np.pi)

    def at(log_scale: float) -> float:
        scale = np.exp(log_scale)
        parameters = centre + scale * grid @ apart.T
        left = dense.residual - parameters @ design.T
        exponent = np.square(left).sum(axis=1) + np.square(parameters) @ precision
        prior = normal - width.size * log_scale
        cell = volume + len(centre) * log_scale
        return float(logsumexp(-0.5 * exponent / scale**2) - len(left.T) * log_scale + prior + cell)

    log_scales = np.arange(-2.0, 4.0, 0.15)
    likelihood = np.array([at(log_scale) for log_scale in log_scales])
    if dense.stated:
        elsewhere = logsumexp(likelihood + _log_inverse_gamma(log_scales)) + np.log(0.15)
        total = np.logaddexp(np.log(1.0 - MISSTATED) + at(0.0), np.log(MISSTATED) + elsewhere)
    else:
        total = logsumexp(likelihood) + np.log(0.15)
    return float(total + dense._log_prior(blocks))
