"""Evidence of observed spreads under a pattern with unknown size, and predictions.

For seat k, the logarithm of the observed spread is normal with mean ``u + ln s_k``, where u is the
logarithm of the size. Its variance is that of a spread of n records plus τ². The model discrepancy
τ contains errors of the prediction: unknown postures, contact and hand. u is uniform between the
possible sizes and integrated in closed form. The evidence is the mean over the draws of the
pattern.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, logsumexp, ndtri_exp

from aacmm_pin._support.arrays import Array, Index
from papers.sino6_table3.patterns import Pattern

DISCREPANCY = 0.15
"""Model discrepancy τ of the logarithm of a spread."""
PREDICTED = 4000
"""Draws of a prediction."""
INTERVAL = (0.025, 0.5, 0.975)
"""Quantiles of a 95 % interval and its median."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The posterior of a pattern after observed spreads.

    Attributes:
        pattern: the pattern.
        log_evidence: logarithm of the evidence: density of the logarithms of the observed spreads,
            integrated over size and draws.
        weights: posterior probability of each draw (draws,).
        centre, width: mean and standard deviation of u in each draw (draws,), before the limits of
            the sizes apply.
    """

    pattern: Pattern
    log_evidence: float
    weights: Array
    centre: Array
    width: Array

    def sampled(self, rng: np.random.Generator) -> tuple[Index, Array]:
        """Posterior draws (PREDICTED,): indices of draws of the pattern, and values of u."""
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
        """Draws of the spreads at the seats of ``pattern``, which has the same cause: (PREDICTED,
        seats) [m].
        """
        which, u = self.sampled(rng)
        sd = np.sqrt(pattern.log_sd[which] ** 2 + DISCREPANCY**2)
        return np.asarray(
            np.exp(u[:, None] + pattern.log_spread[which] + sd * rng.normal(size=sd.shape))
        )


def evidence(
    pattern: Pattern, observed: ArrayLike, tau: float = DISCREPANCY, prior: Array | None = None
) -> Evidence:
    """The posterior of ``pattern`` after the spreads ``observed`` (seats,) [m].

    ``prior`` is the relative weight of each draw (draws,); by default all weights are equal.
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
        # normal probability between the limits of the size
        inside = log_ndtr(b) + np.log1p(-np.exp(log_ndtr(a) - log_ndtr(b)))
        log = log + 0.5 * np.log(2 * np.pi) + np.log(width) - np.log(high - low) + inside
    weight = np.ones(len(log)) if prior is None else prior
    whole = logsumexp(log, b=weight)
    return Evidence(
        pattern, float(whole - np.log(weight.sum())), weight * np.exp(log - whole), centre, width
    )


def _in_left_tail(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Signs, and bounds with the same normal probability, not both far to the right."""
    sign = np.where(a > 0, -1.0, 1.0)
    return sign, np.where(a > 0, -b, a), np.where(a > 0, -a, b)
