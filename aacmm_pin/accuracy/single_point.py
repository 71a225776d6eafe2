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
    """The spread of repeated measurements of one point (eqs. 16 to 19 of Xu You et al. 2019).

    Attributes:
        n: number of records.
        sigma: experimental standard deviation of the position, with the divisor n - 1 (eqs. 16, 17)
            [m].
        part: root mean square distance between the records of the high-accuracy part and the mean
            of *all* records (eqs. 18, 19) [m]; NaN without a high-accuracy part.
        rest: root mean square distance of the other records from the mean of all records [m].
        part_n: number of records in the part.
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
        indications: measured or simulated coordinates of the point ``(n, 3)`` [m].
        part: True for records in the part with the predicted high accuracy, ``(n,)`` bool. Select
            the part before you measure: a selection by measured deviations makes every arm look
            accurate.

    Raises:
        ShapeError: there are fewer than two records, a shape is wrong, a number is not finite, or a
            flag is not a boolean.
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
