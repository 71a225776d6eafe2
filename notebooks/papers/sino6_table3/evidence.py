"""Likelihood of observed spreads under a pattern, its size integrated; predictions from it.

For seat k the logarithm of the observed spread is normal about ``u + ln s_k``, u the logarithm of
the size, with the variance of a spread from n records plus τ². τ, the model discrepancy, is what no
prediction of this kind has right: the postures are not known exactly, contact and hand add their
own. u is uniform between the sizes thought possible, so it is integrated in closed form; draws of
the pattern are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp, ndtri_exp

from aacmm_pin._support.checks import Array, Index
from papers.sino6_table3.patterns import Pattern

DISCREPANCY = 0.15
"""Model discrepancy τ of the logarithm of a spread."""
PREDICTED = 4000
"""Draws of a prediction."""
INTERVAL = (0.025, 0.5, 0.975)
"""Quantiles of a median with its 95 % interval."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A pattern in the light of observed spreads.

    Attributes:
        pattern: the pattern.
        log_evidence: logarithm of the density of the logarithms of the observed spreads, size and
            draws integrated.
        weights: posterior probability of each draw (draws,).
        centre, width: mean and standard deviation of u in each draw before it is cut off at the
            sizes (draws,).
    """

    pattern: Pattern
    log_evidence: float
    weights: Array
    centre: Array
    width: Array

    def sampled(self, rng: np.random.Generator) -> tuple[Index, Array]:
        """Draws of the posterior: numbers of the pattern's draws (PREDICTED,), and u
        (PREDICTED,).
        """
        which = np.asarray(rng.choice(len(self.weights), PREDICTED, p=self.weights), dtype=np.intp)
        low, high = np.log(self.pattern.sizes)
        if low == high:
            return which, np.full(PREDICTED, low, dtype=np.float64)
        centre, width = self.centre[which], self.width[which]
        sign, a, b = _in_left_tail((low - centre) / width, (high - centre) / width)
        part = rng.uniform(size=PREDICTED)
        below = np.logaddexp(np.log1p(-part) + log_ndtr(a), np.log(part) + log_ndtr(b))
        return which, np.asarray(centre + sign * width * ndtri_exp(below))

    def predictive(self, pattern: Pattern, rng: np.random.Generator) -> Array:
        """Spreads to be expected by ``pattern``, the same cause at other seats, draw by draw:
        (PREDICTED, seats) [m].
        """
        which, u = self.sampled(rng)
        sd = np.sqrt(pattern.log_sd[which] ** 2 + DISCREPANCY**2)
        return np.asarray(
            np.exp(u[:, None] + pattern.log_spread[which] + sd * rng.normal(size=sd.shape))
        )


def evidence(
    pattern: Pattern, observed: ArrayLike, tau: float = DISCREPANCY, prior: Array | None = None
) -> Evidence:
    """``pattern`` in the light of the spreads ``observed`` (seats,) [m].

    ``prior`` is the relative weight of each draw by what else is known of it (draws,); by default
    all alike.
    """
    residual, variance = np.log(observed) - pattern.log_spread, pattern.log_sd**2 + tau**2
    total = (1.0 / variance).sum(axis=1)
    centre, width = (residual / variance).sum(axis=1) / total, 1.0 / np.sqrt(total)
    low, high = np.log(pattern.sizes)
    at = centre if low < high else np.full_like(centre, low)
    log = -0.5 * ((residual - at[:, None]) ** 2 / variance + np.log(2 * np.pi * variance)).sum(
        axis=1
    )
    if low < high:
        _, a, b = _in_left_tail((low - centre) / width, (high - centre) / width)
        # Of the normal density, between the sizes.
        inside = log_ndtr(b) + np.log1p(-np.exp(log_ndtr(a) - log_ndtr(b)))
        log = log + 0.5 * np.log(2 * np.pi) + np.log(width) - np.log(high - low) + inside
    weight = np.ones(len(log)) if prior is None else prior
    whole = logsumexp(log, b=weight)
    return Evidence(
        pattern, float(whole - np.log(weight.sum())), weight * np.exp(log - whole), centre, width
    )


def _in_left_tail(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Signs, and bounds with the same normal probability between them that are not both far out on
    the right.
    """
    sign = np.where(a > 0, -1.0, 1.0)
    return sign, np.where(a > 0, -b, a), np.where(a > 0, -a, b)
