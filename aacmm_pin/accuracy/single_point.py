"""Single-point statistics: repeated measurements of one point in many configurations (eqs. 16-19 of
Xu You et al. 2019).
"""

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
    """Spread of repeated indications of one point.

    Attributes:
        n: number of records.
        sigma: experimental standard deviation of the position, all records, divisor n - 1 (eqs.
            16, 17) [m].
        part: root mean square distance of the records of the high-accuracy part from the mean of
            *all* records, divisor g (eqs. 18, 19) [m]; nan where no part was given or it is empty.
        rest: the same of the other records [m].
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
    """Spread of ``indications`` (n, 3) [m] of one point about their mean, and that of a part
    against the rest.

    Args:
        indications: measured or simulated coordinates of the same point (n, 3) [m].
        part: which records belong to the predicted high-accuracy part (n,) bool. Choosing them by
            their deviations after measuring would make the part look good whatever the arm does.

    Raises:
        ShapeError: fewer than two records, wrong shapes, numbers that are not finite, flags that
            are not booleans.
    """
    points = batch(indications, 3, "indications", "m")
    if len(points) < 2:
        raise ShapeError(f"indications has {len(points)} records; expected at least 2")
    flags = np.zeros(len(points), dtype=bool) if part is None else np.asarray(part)
    if flags.shape != (len(points),) or flags.dtype != np.bool_:
        raise ShapeError(
            f"part is {flags.dtype} of shape {flags.shape}; expected one boolean for each of "
            f"{len(points)} records"
        )
    squares = np.square(points - points.mean(axis=0)).sum(axis=1)
    sigma = float(np.sqrt(squares.sum() / (len(points) - 1)))
    rest = np.zeros_like(flags) if part is None else ~flags
    return SinglePoint(
        len(points), sigma, _rms(squares, flags), _rms(squares, rest), int(flags.sum())
    )


def _rms(squares: NDArray[np.float64], flags: Mask) -> float:
    if not flags.any():
        return np.nan
    return float(np.sqrt(squares[flags].mean()))
