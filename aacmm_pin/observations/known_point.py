"""Points whose coordinates were measured with each record, by a laser tracker for instance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin.checks import Array
from aacmm_pin.observations.observation import Observation


@dataclass(frozen=True, eq=False)
class KnownPoint(Observation):
    """``tip = reference``, record by record, each with the noise of its own reference.

    Attributes:
        reference: (m, 3) [m].
        u: standard uncertainty of each coordinate (m, 3), the contact's included [m].
    """

    reference: Array
    u: Array

    @property
    def unknowns(self) -> int:
        """None."""
        return 0

    def start(self, tips: Array) -> Array:
        """Nothing to start."""
        return np.empty(0)

    def targets(self, nuisances: Array) -> tuple[Array, Array]:
        """The references."""
        return self.reference, np.empty((len(self.records), 3, 0))

    def covariance(self) -> Array:
        """Independent coordinates."""
        return np.asarray(self.u[:, :, None] ** 2 * np.eye(3))
