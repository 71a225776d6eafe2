"""What an observation is: some records that say where the tip was, perhaps by way of points that nobody knows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from aacmm_pin.checks import Array, Index


@dataclass(frozen=True, eq=False)
class Observation(ABC):
    """Records whose tips should be at ``targets``, which may depend on a few unknown numbers (nuisances).

    The residual of a record is tip - target, so that its derivative with respect to the tip is one; what is known of the
    nuisances themselves, such as the distance of two seats, comes as further residuals, the ``ties``.

    Attributes:
        records: numbers of the records (m,).
    """

    records: Index

    @property
    @abstractmethod
    def unknowns(self) -> int:
        """Number of nuisances, k."""

    @abstractmethod
    def start(self, tips: Array) -> Array:
        """First values of the nuisances (k,) from the predicted tips (m, 3) [m]; a few wild tips must not spoil them."""

    @abstractmethod
    def targets(self, nuisances: Array) -> tuple[Array, Array]:
        """Where the tips should be (m, 3) [m], and the derivative (m, 3, k)."""

    @abstractmethod
    def covariance(self) -> Array:
        """Covariance of each record's own target, apart from the arm (m, 3, 3) [m²]."""

    def ties(self, nuisances: Array) -> tuple[Array, Array]:
        """What is known of the nuisances: residuals over their standard uncertainty (t,), and the derivative (t, k)."""
        return np.empty(0), np.empty((0, self.unknowns))

    def points(self, nuisances: Array) -> list[tuple[str, Array]]:
        """The unknown points (3,) [m] by the labels of their seats."""
        return []


def isotropic(variance: float, count: int) -> Array:
    """``count`` covariances with the same variance in every direction (count, 3, 3)."""
    return np.broadcast_to(variance * np.eye(3), (count, 3, 3))
