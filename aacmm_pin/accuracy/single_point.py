"""Spread of repeated measurements of one point (eqs. 16 to 19 of Xu You et al. 2019)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support.checks import Mask, batch
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import MM
from aacmm_pin.errors import ShapeError


@dataclass(frozen=True)
class SinglePoint(Shown):
    """Spread of repeated measurements of one point (eqs. 16 to 19 of Xu You et al. 2019).

    Attributes:
        n: number of records.
        sigma: experimental standard deviation of the position, divisor n - 1 (eqs. 16, 17) [m].
        part: RMS distance of the high-accuracy part from the mean of *all* records (eqs. 18, 19)
            [m]; NaN without such a part.
        rest: the same of the other records [m].
        part_n: its number of records.
    """

    n: int
    sigma: float
    part: float
    rest: float
    part_n: int

    def __str__(self) -> str:
        text = f"The standard deviation of {self.n} records is {self.sigma / MM:.4f} mm"
        if self.part_n:
            text += (
                f"; the RMS distance is {self.part / MM:.4f} mm for {self.part_n} records in "
                f"accurate postures, {self.rest / MM:.4f} mm for the others"
            )
        return text


def single_point_statistics(indications: ArrayLike, part: ArrayLike | None = None) -> SinglePoint:
    """Compute the spread of repeated measurements of one point about their mean.

    Args:
        indications: measured coordinates ``(n, 3)`` [m].
        part: True for records with predicted high accuracy, ``(n,)`` bool. Select them before you
            measure: a selection by deviations makes every arm look accurate.

    Raises:
        ShapeError: fewer than two records, a wrong shape, not finite, or flags not boolean.
    """
    points = batch(indications, 3, "indications", "m")
    if len(points) < 2:
        raise ShapeError(f"indications has {len(points)} records; expected at least 2")
    flags = np.zeros(len(points), dtype=bool) if part is None else np.asarray(part)
    if flags.shape != (len(points),) or flags.dtype != np.bool_:
        raise ShapeError(
            f"part has type {flags.dtype} and shape {flags.shape}; expected one boolean for each "
            f"of {len(points)} records"
        )
    squares = np.square(points - points.mean(axis=0)).sum(axis=1)
    sigma = float(np.sqrt(squares.sum() / (len(points) - 1)))
    others = np.zeros_like(flags) if part is None else ~flags
    return SinglePoint(
        len(points), sigma, _rms(squares, flags), _rms(squares, others), int(flags.sum())
    )


def _rms(squares: NDArray[np.float64], flags: Mask) -> float:
    if not flags.any():
        return np.nan
    return float(np.sqrt(squares[flags].mean()))
