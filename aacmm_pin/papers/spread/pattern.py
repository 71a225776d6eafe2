"""How much a cause spreads the indications at each seat: a pattern over the seats, with a size that is free.

A spread is the experimental standard deviation of the position, ``s² = Σ|p_i - p̄|²/(n - 1)``. Its logarithm from n records
has, by the delta method, the standard deviation ``½ √((m₄/m₂² - 1)/n)``, m₂ and m₄ the mean second and fourth power of the
distance from the mean. For three equal normal components this is ``1/√(6 n)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.errors import AacmmError, ShapeError

DECADE = (0.1, 10.0)
"""Sizes that are thought possible, in units of the typical one."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """Spreads at the seats by one cause of size 1, for every way in which it may act.

    Attributes:
        name: of the cause.
        second: mean squared distance from the mean, m₂ (draws, seats) [m²].
        fourth: mean fourth power of the distance, m₄ (draws, seats) [m⁴].
        records: number of records of each seat (seats,).
        sizes: smallest and largest size that is thought possible, equal where the size is known; log-uniform between.
        unit: what size 1 is, in words.
        unit_size: size that counts as one of ``unit``.
    """

    name: str
    second: Array
    fourth: Array
    records: Array
    sizes: tuple[float, float] = DECADE
    unit: str = "× typical"
    unit_size: float = 1.0

    def __post_init__(self) -> None:
        shape = self.second.shape
        if self.second.ndim != 2 or self.fourth.shape != shape or self.records.shape != shape[1:]:
            raise ShapeError(
                f"{self.name}: second {shape}, fourth {self.fourth.shape}, records {self.records.shape}; "
                "expected (draws, seats) twice and (seats,)"
            )
        low, high = self.sizes
        if not 0 < low <= high < np.inf:
            raise AacmmError(f"{self.name}: sizes are {low:g} to {high:g}, expected 0 < low <= high")
        if not (np.isfinite(self.second).all() and (self.second >= 0).all()):
            raise AacmmError(f"{self.name}: squared spreads must be finite and not negative")

    @property
    def log_spread(self) -> Array:
        """Logarithm of the spread at size 1 (draws, seats) [ln m]; -inf where the cause does not spread."""
        return np.asarray(0.5 * np.log(self.second, out=np.full_like(self.second, -np.inf), where=self.second > 0))

    @property
    def log_sd(self) -> Array:
        """Standard deviation of the logarithm of an observed spread (draws, seats), as if postures were drawn at random."""
        square = np.where(self.second > 0, self.second, 1.0) ** 2
        excess = np.where(self.second > 0, self.fourth / square - 1.0, 0.0)
        return np.asarray(0.5 * np.sqrt(np.maximum(excess, 0.0) / self.records))

    def take(self, seats: list[int]) -> Pattern:
        """The same of some of the seats."""
        return replace(self, second=self.second[:, seats], fourth=self.fourth[:, seats], records=self.records[seats])

    def of_sizes(self, low: float, high: float) -> Pattern:
        """The same with other sizes thought possible."""
        return replace(self, sizes=(low, high))


def mixed(name: str, first: Pattern, second: Pattern, ratios: Array) -> Pattern:
    """Two independent causes at once: the size of the second is each of ``ratios`` (r,) times that of the first.

    Draws of both are paired: as many of each, or one of either, times all ratios. Sizes and unit are those of ``first``.
    The squares add; fourth powers as those of two displacements without common direction, ``m₄ + m₄' + (10/3) m₂ m₂'``.

    Raises:
        ShapeError: other numbers of draws, or of seats.
    """
    draws = {len(first.second), len(second.second)} - {1}
    if len(draws) > 1 or first.second.shape[1] != second.second.shape[1]:
        raise ShapeError(
            f"{name}: draws and seats are {first.second.shape} and {second.second.shape}, expected as many, or one draw"
        )
    ratio = np.asarray(ratios, dtype=np.float64)[:, None, None]
    one, other = first.second[None], ratio**2 * second.second[None]
    fourth = first.fourth[None] + ratio**4 * second.fourth[None] + 10.0 / 3.0 * one * other
    seats = first.second.shape[1]
    return replace(first, name=name, second=(one + other).reshape(-1, seats), fourth=fourth.reshape(-1, seats))
