"""Ball bars: seats at known distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from aacmm_pin.checks import Array
from aacmm_pin.observations.observation import Observation
from aacmm_pin.observations.same_point import SamePoint


class Length(NamedTuple):
    """A bar: its label, the numbers of its two seats, its calibrated length and that length's standard uncertainty [m]."""

    label: str
    a: int
    b: int
    length: float
    u: float


@dataclass(frozen=True, eq=False)
class KnownLength(Observation):
    """``|s_A - s_B| = length`` for one bar, or several that share seats; ``records`` are those of the seats in their order.

    Attributes:
        seats: the seats that the bars connect.
        bars: which are how far apart.
    """

    seats: tuple[SamePoint, ...]
    bars: tuple[Length, ...]

    @staticmethod
    def between(seats: list[SamePoint], bars: list[Length]) -> KnownLength:
        """Bars between seats."""
        return KnownLength(np.concatenate([seat.records for seat in seats]), tuple(seats), tuple(bars))

    @property
    def unknowns(self) -> int:
        """A point for each seat."""
        return 3 * len(self.seats)

    def start(self, tips: Array) -> Array:
        """The seats' own."""
        ends = np.cumsum([len(seat.records) for seat in self.seats])[:-1]
        parts = zip(self.seats, np.split(tips, ends), strict=True)
        return np.concatenate([seat.start(part) for seat, part in parts])

    def targets(self, nuisances: Array) -> tuple[Array, Array]:
        """Each record's own seat."""
        points, derivative, row = [], np.zeros((len(self.records), 3, self.unknowns)), 0
        for number, seat in enumerate(self.seats):
            own = slice(3 * number, 3 * number + 3)
            at, by = seat.targets(nuisances[own])
            derivative[row : row + len(at), :, own] = by
            points.append(at)
            row += len(at)
        return np.concatenate(points), derivative

    def covariance(self) -> Array:
        """The contacts."""
        return np.concatenate([seat.covariance() for seat in self.seats])

    def ties(self, nuisances: Array) -> tuple[Array, Array]:
        """What is known of the seats, then the lengths."""
        own = [seat.ties(nuisances[3 * n : 3 * n + 3]) for n, seat in enumerate(self.seats)]
        residual, derivative = [r for r, _ in own], [block_diag(*(d for _, d in own))]
        points = nuisances.reshape(-1, 3)
        for bar in self.bars:
            way = points[bar.a] - points[bar.b]
            distance = float(np.linalg.norm(way))
            along = way / distance if distance > 0 else np.zeros(3)
            row = np.zeros((len(points), 3))
            row[bar.a], row[bar.b] = along / bar.u, -along / bar.u
            residual.append(np.array([(distance - bar.length) / bar.u]))
            derivative.append(row.reshape(1, -1))
        return np.concatenate(residual), np.vstack(derivative)

    def points(self, nuisances: Array) -> list[tuple[str, Array]]:
        """The seats."""
        return [(seat.label, nuisances[3 * n : 3 * n + 3]) for n, seat in enumerate(self.seats)]
