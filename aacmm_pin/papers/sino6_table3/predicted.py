"""The spreads of Table 3 beside those that errors of the DH values, or of the angles, predict; nothing is fitted.

**DH values.** One draw is one arm: 24 errors, uniform within the half-widths of Table 1, the same for all records of all
seats; the spread of each seat is that of eq. (16) with the divisor n - 1. **Angles.** White noise of one standard deviation
on every joint: ``s² = s_angle² · mean over records of Σ_j |∂p/∂θ_j|²``. **Counts.** The spread of all records and the root
mean squares of the marked part and of the rest (eqs. 16, 18, 19) share one sum of squares, ``(n - 1) s² = g ψ_marked² +
(n - g) ψ_rest²``: so g follows from the print and must be a whole number.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown, report
from aacmm_pin._support.units import ARCSEC, MM
from aacmm_pin.papers.sino6 import printed_table3
from aacmm_pin.papers.sino6_table3.seats import MEASURED, RECORDS, SIXTH, Reading, TouchedSeats, touched_seats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ANGLE_NOISE = 5.0 * ARCSEC
"""Standard deviation of the white angle noise that is tried [rad]."""
PRINTED_STEP = 1e-4 * MM
"""Last printed digit of the spreads [m]."""
DRAWS_AT_ONCE = 40


@dataclass(frozen=True, eq=False)
class Table3(Shown):
    """Table 3 as printed beside its predictions.

    Attributes:
        points: one row a seat: point, measured_mm; dh_p05_mm, dh_median_mm, dh_p95_mm of the spread under DH errors;
            measured_quantile, the share of draws below the measured spread; angle_noise_mm.
        spreads: (draws, 6) spread of every seat for every arm drawn [m].
        reading: what is at the printed coordinates.
    """

    points: pd.DataFrame
    spreads: Array
    reading: Reading

    @property
    def correlation(self) -> Array:
        """Correlation of the logarithms of the spreads between seats, over the draws (6, 6)."""
        return np.corrcoef(np.log(self.spreads).T)

    @property
    def measured_ratio(self) -> float:
        """How many times as much as seat 5 seat 6 spread."""
        return float(MEASURED[SIXTH] / MEASURED[SIXTH - 1])

    @property
    def ratio_probability(self) -> float:
        """Share of draws in which that ratio is at least as large."""
        return float((self.spreads[:, SIXTH] >= self.measured_ratio * self.spreads[:, SIXTH - 1]).mean())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Measured spreads and those predicted."""
        return cast("Axes", report().plots.plot_table3(self, ax))


def predict_table3(rng: np.random.Generator, draws: int = 2000, reading: Reading = "wrist") -> Table3:
    """The measured spreads beside those that the calibration's half-widths and white angle noise predict.

    Args:
        rng: source of the draws.
        draws: number of arms.
        reading: what is at the printed coordinates.
    """
    seats = touched_seats(reading)
    half_widths = np.array([parameter.half_width or 0.0 for parameter in seats.model.arm.parameters])
    spreads = dh_spreads(seats, half_widths * rng.uniform(-1.0, 1.0, (draws, len(half_widths))))
    noise = ANGLE_NOISE * np.sqrt(np.square(seats.levers()).sum(axis=(2, 3)).mean(axis=1))
    low, median, high = np.quantile(spreads, [0.05, 0.5, 0.95], axis=0) / MM
    points = pd.DataFrame({"point": printed_table3()["point"], "measured_mm": MEASURED / MM})
    points = points.assign(dh_p05_mm=low, dh_median_mm=median, dh_p95_mm=high)
    return Table3(
        points.assign(measured_quantile=(spreads < MEASURED).mean(axis=0), angle_noise_mm=noise / MM), spreads, reading
    )


def dh_spreads(seats: TouchedSeats, errors: Array) -> Array:
    """Spread of each seat for each arm with ``errors`` (draws, parameters), eq. (16), exact: (draws, seats) [m]."""
    spreads = np.empty((len(errors), len(seats.q)))
    for start in range(0, len(errors), DRAWS_AT_ONCE):
        part = errors[start : start + DRAWS_AT_ONCE]
        q, repeated = np.tile(seats.all_q, (len(part), 1)), np.repeat(part, len(seats.all_q), axis=0)
        positions = seats.model.arm.perturbed_positions(q, repeated, seats.at).reshape(-1, *seats.q.shape[:2], 3)
        spreads[start : start + len(part)] = np.sqrt(positions.var(axis=2, ddof=1).sum(axis=2))
    return spreads


def implied_counts(records: int = RECORDS) -> pd.DataFrame:
    """How many records the marked part of each seat must hold, if there are ``records`` in all, one row a seat.

    Columns: point; marked_count, from the printed numbers; marked_count_low and marked_count_high over all values that round
    to them; whole, whether a whole number lies between.
    """
    table = printed_table3()
    printed = table[["single_point_std_mm", "high_accuracy_part_std_mm", "rest_std_mm"]].to_numpy().T * MM  # (3, 6)
    rounding = np.array(list(product((-0.5, 0.5), repeat=3))).T[:, :, None] * PRINTED_STEP  # (3, 8, 1)
    corners = marked_count(printed[:, None] + rounding, records)
    low, high = corners.min(axis=0), corners.max(axis=0)
    counts = pd.DataFrame({"point": table["point"], "marked_count": marked_count(printed, records)})
    return counts.assign(marked_count_low=low, marked_count_high=high, whole=np.ceil(low) <= high)


def marked_count(spreads: Array, records: int) -> Array:
    """g from ``(n - 1) s² = g ψ_marked² + (n - g) ψ_rest²``; ``spreads`` is s, ψ_marked, ψ_rest (3, …) [m]."""
    total, marked, rest = spreads**2
    return np.asarray((records * rest - (records - 1) * total) / (rest - marked))
