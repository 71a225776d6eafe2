"""Likelihood of observed spreads under a pattern, its size integrated; predictions for a seat from the other seats.

For seat k the logarithm of the observed spread is normal about ``u + ln s_k``, u the logarithm of the size, with the
variance of a spread from n records plus τ². τ, the model discrepancy, is what no prediction of this kind has right: the
postures are not known exactly, contact and hand add their own. u is uniform between the sizes thought possible, so it is
integrated in closed form; draws of the pattern are averaged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import logsumexp
from scipy.stats import norm, truncnorm

from aacmm_pin._support.checks import Array, Index, vector
from aacmm_pin.errors import AacmmError
from aacmm_pin.papers.spread.pattern import Pattern

DISCREPANCY = 0.15
"""Model discrepancy τ of the logarithm of a spread where nothing is stated."""
PREDICTED = 4000
"""Draws of a prediction."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A pattern in the light of observed spreads.

    Attributes:
        pattern: the pattern.
        log_evidence: logarithm of the density of the logarithms of the observed spreads, size and draws integrated.
        weights: posterior probability of each draw (draws,).
        centre, width: mean and standard deviation of u in each draw before it is cut off at the sizes (draws,).
    """

    pattern: Pattern
    log_evidence: float
    weights: Array
    centre: Array
    width: Array

    @property
    def effective_draws(self) -> float:
        """``1/Σ w²``: how many draws the answer rests on."""
        return float(1.0 / np.square(self.weights).sum())

    def sampled(self, rng: np.random.Generator, count: int = PREDICTED) -> tuple[Index, Array]:
        """Draws of the posterior: numbers of the pattern's draws (count,), and u (count,)."""
        which = np.asarray(rng.choice(len(self.weights), count, p=self.weights), dtype=np.intp)
        low, high = np.log(self.pattern.sizes)
        if low == high:
            return which, np.full(count, low, dtype=np.float64)
        centre, width = self.centre[which], self.width[which]
        u = truncnorm.rvs((low - centre) / width, (high - centre) / width, centre, width, random_state=rng)
        return which, np.asarray(u)

    def size(self, rng: np.random.Generator) -> Array:
        """Posterior 2.5 %, 50 % and 97.5 % of the size (3,), in the pattern's unit."""
        return np.asarray(np.exp(np.quantile(self.sampled(rng)[1], [0.025, 0.5, 0.975])) / self.pattern.unit_size)


def evidence(pattern: Pattern, observed: ArrayLike, tau: float = DISCREPANCY, prior: ArrayLike | None = None) -> Evidence:
    """``pattern`` in the light of the spreads ``observed`` (seats,) [m].

    Args:
        pattern: the pattern.
        observed: one spread a seat.
        tau: model discrepancy.
        prior: relative weight of each draw by what else is known of it (draws,); default all alike.

    Raises:
        ShapeError, AacmmError: a spread is not a number above zero, there are not as many as seats, the pattern does not
            spread at some seat, or τ is negative, or zero where a spread is without error.
    """
    y, mean, variance = _checked(pattern, observed, tau)
    residual, precision = y - mean, 1.0 / variance
    total = precision.sum(axis=1)
    centre, width = (precision * residual).sum(axis=1) / total, 1.0 / np.sqrt(total)
    low, high = np.log(pattern.sizes)
    at = np.full_like(centre, low) if low == high else centre
    log = norm.logpdf(residual, at[:, None], np.sqrt(variance)).sum(axis=1)
    if low < high:
        log = log + 0.5 * np.log(2 * np.pi) + np.log(width) - np.log(high - low) + _log_inside(low, high, centre, width)
    weight = np.ones(len(log)) if prior is None else vector(prior, len(log), "prior", "1")
    if (weight < 0).any() or not weight.any():
        raise AacmmError(f"{pattern.name}: prior weights must not be negative, and not all zero")
    whole = logsumexp(log, b=weight)
    if not np.isfinite(whole):
        raise AacmmError(f"{pattern.name}: the observed spreads are impossible under it")
    return Evidence(pattern, float(whole - np.log(weight.sum())), weight * np.exp(log - whole), centre, width)


def _checked(pattern: Pattern, observed: ArrayLike, tau: float) -> tuple[Array, Array, Array]:
    """Logarithms of observed spreads (seats,), of predicted ones (draws, seats), and their variances."""
    spreads = vector(observed, len(pattern.records), "observed spreads", "m")
    if (spreads <= 0).any():
        raise AacmmError(f"observed spreads are {spreads} m, expected numbers above zero")
    if not (pattern.second > 0).all():
        raise AacmmError(f"{pattern.name}: does not spread at every seat; mix it with a cause that does")
    variance = pattern.log_sd**2 + tau**2
    if not (np.isfinite(tau) and tau >= 0 and (variance > 0).all()):
        raise AacmmError(f"tau is {tau:g}, expected a number that is not negative, above zero where a spread has no error")
    return np.log(spreads), pattern.log_spread, variance


def _log_inside(low: float, high: float, centre: Array, width: Array) -> Array:
    """Logarithm of the part of a normal distribution between ``low`` and ``high``."""
    a, b = (low - centre) / width, (high - centre) / width
    flip = a > 0  # both tails by the one in which the difference keeps its digits
    upper, lower = norm.logcdf(np.where(flip, -a, b)), norm.logcdf(np.where(flip, -b, a))
    with np.errstate(divide="ignore"):  # a part too small for a number
        return np.asarray(upper + np.log(-np.expm1(np.minimum(lower - upper, 0.0))))


def probabilities(found: Sequence[Evidence]) -> Array:
    """Posterior probability of each pattern among these, equally probable before: (patterns,)."""
    log = np.array([one.log_evidence for one in found])
    return np.asarray(np.exp(log - logsumexp(log)))


def predictive(found: Evidence, pattern: Pattern, tau: float, rng: np.random.Generator, count: int = PREDICTED) -> Array:
    """Spreads that are to be expected when ``found`` is known: (count, seats) [m].

    Args:
        found: what some seats said.
        pattern: the same cause at all seats that are to be predicted, draw by draw.
        tau: model discrepancy.
        rng: for size, draw, sampling error and discrepancy.
        count: number of draws.
    """
    which, u = found.sampled(rng, count)
    sd = np.sqrt(pattern.log_sd[which] ** 2 + tau**2)
    return np.asarray(np.exp(u[:, None] + pattern.log_spread[which] + sd * rng.normal(size=sd.shape)))


def left_out(
    pattern: Pattern,
    observed: ArrayLike,
    rng: np.random.Generator,
    tau: float = DISCREPANCY,
    count: int = PREDICTED,
    prior: Callable[[list[int]], Array] | None = None,
) -> pd.DataFrame:
    """Each seat predicted from the others, one row a seat.

    ``prior`` gives the weight of each draw by what else is known of the seats (numbered from 0) that are not left out.

    Columns: seat (from 1); observed_mm; predicted_mm (median); predicted_p025_mm, predicted_p975_mm; log_ratio, the
    logarithm of observed over predicted; share_below, the predictive probability of a smaller spread.
    """
    spreads = vector(observed, len(pattern.records), "observed spreads", "m")
    rows = []
    for k in range(len(spreads)):
        others = [j for j in range(len(spreads)) if j != k]
        known = evidence(pattern.take(others), spreads[others], tau, None if prior is None else prior(others))
        drawn = predictive(known, pattern.take([k]), tau, rng, count)[:, 0]
        low, middle, high = np.quantile(drawn, [0.025, 0.5, 0.975]) * 1e3
        below = float((drawn < spreads[k]).mean())
        rows.append((k + 1, spreads[k] * 1e3, middle, low, high, np.log(spreads[k] * 1e3 / middle), below))
    columns = ["seat", "observed_mm", "predicted_mm", "predicted_p025_mm", "predicted_p975_mm", "log_ratio", "share_below"]
    return pd.DataFrame(rows, columns=columns)
