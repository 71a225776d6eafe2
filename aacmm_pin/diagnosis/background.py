"""The part of the discrepancy that is too diffuse to be named, at its most probable amplitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.diagnosis.linear_model import Conditional


@dataclass(frozen=True, eq=False)
class Background:
    """Coefficients of the background's directions beside the median probability model.

    Attributes:
        model: that model.
    """

    model: Conditional

    @property
    def estimate(self) -> Array:
        """Posterior mean of the coefficients (r,)."""
        base = self.model.base
        return self.model.step[base.nuisances : len(base.factor)]

    @property
    def covariance(self) -> Array:
        """Posterior covariance of the coefficients (r, r)."""
        first = self.model.base.nuisances
        # The nuisances are eliminated.
        inverse = np.linalg.inv(self.model.base.factor[first:, first:])
        return self.model.variance * inverse.T @ inverse
