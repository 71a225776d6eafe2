"""χ², F and beta by scipy.special: importing scipy.stats takes as long as all else."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc, betaincinv, chdtr, chdtrc, chdtri

from aacmm_pin._support.arrays import Array


def chi2_cdf(value: ArrayLike, dof: ArrayLike) -> Array:
    """Probability that χ² is at most ``value``."""
    return np.asarray(chdtr(dof, value))


def chi2_sf(value: ArrayLike, dof: ArrayLike) -> Array:
    """Probability that χ² exceeds ``value``."""
    return np.asarray(chdtrc(dof, value))


def chi2_isf(probability: ArrayLike, dof: ArrayLike) -> Array:
    """The value that χ² exceeds with a probability."""
    return np.asarray(chdtri(dof, probability))


def beta_sf(share: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """Probability that a beta distributed share, of these two parameters, is larger."""
    return np.asarray(betainc(second, first, 1.0 - np.asarray(share)))


def f_sf(value: ArrayLike, dof: ArrayLike, other: ArrayLike) -> Array:
    """Probability that F, a ratio of mean squares with ``dof`` above and ``other`` below, exceeds
    ``value``.
    """
    above, below = np.asarray(dof), np.asarray(other)
    beta = below / (below + above * np.asarray(value))
    return np.asarray(betainc(below / 2, above / 2, beta))


def f_isf(probability: ArrayLike, dof: ArrayLike, other: ArrayLike) -> Array:
    """The value that F, see :func:`f_sf`, exceeds with a probability."""
    above, below = np.asarray(dof), np.asarray(other)
    beta = betaincinv(below / 2, above / 2, probability)
    return np.asarray(below * (1.0 - beta) / (above * beta))
