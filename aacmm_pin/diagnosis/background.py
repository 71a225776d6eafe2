"""The part of the discrepancy that is too diffuse to be named, at its most probable amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.diagnosis.linear_model import Conditional


@dataclass(frozen=True, eq=False)
class Background:
    """Coefficients of the background's directions beside the median probability model.

    Attributes:
        left: what is left beside that model.
    """

    left: Conditional

    @property
    def estimate(self) -> Array:
        """Posterior mean of the coefficients (r,)."""
        base = self.left.base
        return self.left.step[base.nuisances : len(base.factor)]

    @cached_property
    def _factor(self) -> Array:
        """Lower triangular factor of the posterior precision, all nuisances eliminated (r, r)."""
        first = self.left.base.nuisances
        return self.left.base.factor[first:, first:]

    @property
    def covariance(self) -> Array:
        """Posterior covariance of the coefficients (r, r)."""
        inverse = np.linalg.inv(self._factor)
        return np.asarray(self.left.variance * inverse.T @ inverse)
