"""The paper's single-point measurements (its Table 3) beside what errors of the DH values, or of the angles, predict.

The printed coordinates have two readings: the wrist (origin of frame 5) is there, as in the paper's equations, with θ3
evenly round the full circle; or the tip is there with the stylus pointing down, as in the paper's measurements, with the
elbow evenly round its circle. Fifty configurations either way: the paper does not state the angles. No number is fitted.

**DH values.** One draw is one arm: 24 errors, uniform within the half-widths of Table 1, the same for all records of all
seats. The spread of each seat (eq. 16 with the divisor n - 1) comes from exact forward kinematics.

**Angles.** White noise of one standard deviation on every joint: ``s² = s_angle² · mean over records of Σ_j |∂p/∂θ_j|²``.

**Counts.** The spread of all records and the root mean squares of the marked part and of the rest (eqs. 16, 18, 19) share
one sum of squares: ``(n - 1) s² = g ψ_marked² + (n - g) ψ_rest²``. So g follows from the print and must be a whole number.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown
from aacmm_pin._support.units import ARCSEC, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.papers.sino6.nominal import sino6_nominal
from aacmm_pin.papers.sino6.seat_configurations import WORKING_ROW, seat_configurations, tip_configurations
from aacmm_pin.papers.sino6.tables import printed_points, printed_table3

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RECORDS = 50
"""Records at each seat (section 2.4 of the paper)."""
ANGLE_NOISE = 5.0 * ARCSEC
"""Standard deviation of the white angle noise that is tried [rad]."""
PRINTED_STEP = 1e-4 * MM
"""Last printed digit of the spreads [m]."""
DRAWS_AT_ONCE = 40
DOWN = np.array([0.0, 0.0, -1.0])
"""Direction of the stylus in a seat, in the base frame."""

Reading = Literal["wrist", "tip"]


@dataclass(frozen=True, eq=False)
class Table3(Shown):
    """Table 3 as printed beside its predictions.

    Attributes:
        points: one row a seat: point, measured_mm; dh_p05_mm, dh_median_mm, dh_p95_mm of the spread under DH errors;
            measured_quantile, the share of draws below the measured spread; angle_noise_mm.
        correlation: (6, 6) correlation of the logarithms of the spreads between seats, over the draws.
        spreads: (draws, 6) spread of every seat for every arm drawn [m].
        ratio_probability: share of draws in which seat 6 spreads at least as much more than seat 5 as measured.
        measured_ratio: that measured ratio.
        marked: number of records in the marked part that the print implies, see :func:`implied_counts`.
        reading: what is at the printed coordinates, ``wrist`` or ``tip``.
    """

    points: pd.DataFrame
    correlation: Array
    spreads: Array
    ratio_probability: float
    measured_ratio: float
    marked: pd.DataFrame
    reading: Reading = "wrist"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Measured spreads and those predicted; see :func:`aacmm_pin.papers.sino6.figures.draw_table3`."""
        from aacmm_pin.papers.sino6.figures import draw_table3  # matplotlib is loaded only to draw

        return draw_table3(self, ax)


def predict_table3(
    rng: np.random.Generator,
    draws: int = 2000,
    arm: Arm | None = None,
    reading: Reading = "wrist",
) -> Table3:
    """The measured spreads beside those that the calibration's half-widths and white angle noise predict.

    Args:
        rng: source of the draws.
        draws: number of arms.
        arm: the arm; default the bundled SINO6.
        reading: what is at the printed coordinates.
    """
    arm = arm or Arm.load("sino6")
    dh = arm.require_dh("the prediction of Table 3")
    if reading == "wrist":
        q, row = seat_configurations(sino6_nominal(), dh, printed_points(), RECORDS), WORKING_ROW
    else:
        q, row = tip_configurations(arm, printed_points(), DOWN, RECORDS), dh.rows
    half_widths = np.array([parameter.half_width or 0.0 for parameter in arm.parameters])
    spreads = dh_spreads(dh, q, half_widths.reshape(dh.rows, 4) * rng.uniform(-1.0, 1.0, (draws, dh.rows, 4)), row)
    measured = printed_table3()["single_point_std_mm"].to_numpy() * MM
    low, median, high = np.quantile(spreads, [0.05, 0.5, 0.95], axis=0)
    points = pd.DataFrame(
        {
            "point": printed_table3()["point"],
            "measured_mm": measured / MM,
            "dh_p05_mm": low / MM,
            "dh_median_mm": median / MM,
            "dh_p95_mm": high / MM,
            "measured_quantile": (spreads < measured).mean(axis=0),
            "angle_noise_mm": angle_noise_spreads(dh, q, ANGLE_NOISE, row) / MM,
        }
    )
    ratio = float(measured[5] / measured[4])
    share = float((spreads[:, 5] >= ratio * spreads[:, 4]).mean())
    return Table3(points, np.corrcoef(np.log(spreads).T), spreads, share, ratio, implied_counts(), reading)


def dh_spreads(dh: DHTable, q: Array, errors: Array, row: int = WORKING_ROW) -> Array:
    """Spread of each seat for each arm, eq. (16): (draws, seats) [m].

    Args:
        dh: the table that the arms depart from.
        q: configurations (seats, records, nq) [rad].
        errors: errors of a, d, alpha, theta for each arm (draws, rows, 4) [m, m, rad, rad].
        row: frame whose origin is in the seat.
    """
    seats, records, nq = q.shape
    spreads = np.empty((len(errors), seats))
    for start in range(0, len(errors), DRAWS_AT_ONCE):
        part = errors[start : start + DRAWS_AT_ONCE]
        repeated = np.tile(q.reshape(-1, nq), (len(part), 1))
        positions = dh.positions(repeated, row, np.repeat(part, seats * records, axis=0))
        spreads[start : start + len(part)] = sample_spread(positions.reshape(len(part), seats, records, 3))
    return spreads


def sample_spread(positions: Array) -> Array:
    """√(Σ |p - mean|² / (n - 1)) over the last axis but one of (..., n, 3) [m], eqs. (16) and (17): (...) [m]."""
    return np.asarray(np.sqrt(positions.var(axis=-2, ddof=1).sum(axis=-1)))


def angle_noise_spreads(dh: DHTable, q: Array, noise: float, row: int = WORKING_ROW) -> Array:
    """Expected root-mean-square spread of each seat under white noise [rad] on every joint, to first order: (seats,) [m].

    Args:
        dh: the table.
        q: configurations (seats, records, nq) [rad].
        noise: standard deviation of each joint's angle [rad].
        row: frame whose origin is in the seat.
    """
    levers = dh.jacobian(q.reshape(-1, q.shape[2]), row)
    squared = (levers**2).sum(axis=(1, 2)).reshape(q.shape[:2])
    return np.asarray(noise * np.sqrt(squared.mean(axis=1)))


def implied_counts(records: int = RECORDS) -> pd.DataFrame:
    """How many records the marked part of each seat must hold, if there are ``records`` in all, one row a seat.

    Columns: point; marked_count, from the printed numbers; marked_count_low and marked_count_high over all values that round
    to them; whole, whether a whole number lies between.
    """
    columns = ["single_point_std_mm", "high_accuracy_part_std_mm", "rest_std_mm"]
    rounding = [np.array(signs) * PRINTED_STEP / 2 for signs in product((-1.0, 1.0), repeat=3)]
    rows = []
    for number, printed in enumerate(printed_table3()[columns].to_numpy() * MM, start=1):
        corners = [_marked_count(printed + shift, records) for shift in rounding]
        low, high = min(corners), max(corners)
        rows.append((number, _marked_count(printed, records), low, high, bool(np.ceil(low) <= high)))
    return pd.DataFrame(rows, columns=["point", "marked_count", "marked_count_low", "marked_count_high", "whole"])


def _marked_count(spreads: Array, records: int) -> float:
    """g from ``(n - 1) s² = g ψ_marked² + (n - g) ψ_rest²``; ``spreads`` is s, ψ_marked, ψ_rest (3,) [m]."""
    total, marked, rest = spreads**2
    return float((records * rest - (records - 1) * total) / (rest - marked))
