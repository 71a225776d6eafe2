"""A kinematic seat: one physical point, touched in many postures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin.checks import Array
from aacmm_pin.observations.observation import Observation, isotropic


@dataclass(frozen=True, eq=False)
class SamePoint(Observation):
    """``tip = s`` with one unknown point s; if the seat was measured, s is known as well as that, once for all records.

    An error of the seat's stated coordinates is common to its records: it does not average out over them.

    Attributes:
        label: of the seat.
        contact: standard uncertainty of each coordinate of one contact [m].
        reference: stated coordinates (3,), or None [m].
        u: their standard uncertainty (3,) [m].
    """

    label: str
    contact: float
    reference: Array | None = None
    u: Array | None = None

    @property
    def unknowns(self) -> int:
        """The point."""
        return 3

    def start(self, tips: Array) -> Array:
        """The stated coordinates, or the medians."""
        return np.median(tips, axis=0) if self.reference is None else self.reference.copy()

    def targets(self, nuisances: Array) -> tuple[Array, Array]:
        """The point, for every record."""
        shape = (len(self.records), 3)
        return np.broadcast_to(nuisances, shape), np.broadcast_to(np.eye(3), (*shape, 3))

    def covariance(self) -> Array:
        """One contact."""
        return isotropic(self.contact**2, len(self.records))

    def ties(self, nuisances: Array) -> tuple[Array, Array]:
        """The stated coordinates."""
        if self.reference is None or self.u is None:
            return super().ties(nuisances)
        return (nuisances - self.reference) / self.u, np.diag(1.0 / self.u)

    def points(self, nuisances: Array) -> list[tuple[str, Array]]:
        """The seat."""
        return [(self.label, nuisances)]
