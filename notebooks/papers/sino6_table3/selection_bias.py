"""The marked ("green") part of the records and the rest, for two selections of the part.

At each seat, the paper marks the postures with the smallest accuracy volume by its eq. (14), and
states that their records spread less. The printed numbers determine the number g of marked records:
the spread of all records and the root mean squares of the marked part and of the rest (eqs. 16, 18,
19) share one sum of squares, ``(n - 1) s² = g ψ_marked² + (n - g) ψ_rest²``. This module simulates
records with one cause at a time, and selects g records: those with the smallest predicted volume,
or those nearest the mean. The size of the cause cancels in the ratio of part and rest.

**A limit for every selection.** No g records of a seat spread less than the g records nearest the
mean. A systematic cause moves the records along a closed curve, so that nearly all have the same
distance from the mean, and even the nearest records spread nearly as much as the rest. Random
records also lie near the mean. A printed part with a small spread is therefore evidence for random
errors, if the postures cover the full circle. On an arc of the circle, a systematic cause may also
have records near the mean: on the half circle about θ3 = π, DH errors alone reach the printed
contrast in most arms. ``touched_seats(arc=…, start=…)`` selects such an arc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.accuracy.volume import accuracy_volume
from papers.sino6.tables import printed_table3
from papers.sino6_table3.patterns import DH, NOISE, drawn_values, systematic
from papers.sino6_table3.simulated_touches import RECORDS, SIXTH, TouchedSeats

PRINTED_STEP = 1e-4
"""Last printed digit of the spreads [mm]."""
MEASURED_LOGS = np.log(
    (printed_table3()["high_accuracy_part_std_mm"] / printed_table3()["rest_std_mm"]).to_numpy()
)
"""Logarithms of the printed ratios of marked part and rest (6,)."""
FIVE = list(range(SIXTH))
"""Seats that determine a cause; seat 6 is special, and its count is no integer."""
SHARES = np.linspace(0.0, 1.0, 11)
"""Random shares of the variance."""
LEAST = 0.05
"""A share is possible if it reaches the printed contrast with at least this probability."""


def implied_counts(records: int = RECORDS) -> pd.DataFrame:
    """Number of marked records of each seat, one row for each seat, if a seat has ``records``.

    Columns: point; marked_count, from the printed numbers; marked_count_low and marked_count_high,
    over all values that round to the printed numbers; whole, whether an integer lies between.
    """
    table = printed_table3()
    # (3, 6).
    printed = (
        table[["single_point_std_mm", "high_accuracy_part_std_mm", "rest_std_mm"]].to_numpy().T
    )
    # (3, 8, 1).
    rounding = np.array(list(product((-0.5, 0.5), repeat=3))).T[:, :, None] * PRINTED_STEP
    corners = marked_count(printed[:, None] + rounding, records)
    low, high = corners.min(axis=0), corners.max(axis=0)
    counts = pd.DataFrame({"point": table["point"], "marked_count": marked_count(printed, records)})
    return counts.assign(marked_count_low=low, marked_count_high=high, whole=np.ceil(low) <= high)


def marked_count(spreads: Array, records: int) -> Array:
    """g; ``spreads`` is s, ψ_marked, ψ_rest (3, …), in one unit."""
    total, marked, rest = spreads**2
    return np.asarray((records * rest - (records - 1) * total) / (rest - marked))


COUNTS = [round(count) for count in implied_counts()["marked_count"]]
"""Records in the marked part of each seat."""


def from_mean(positions: Array) -> Array:
    """Positions in each draw (draws, seats, n, 3) [m] minus the mean of their seat."""
    return np.asarray(positions - positions.mean(axis=2, keepdims=True))


def log_ratios(squares: Array, order: Index | None = None, counts: Sequence[int] = COUNTS) -> Array:
    """Logarithms of the ratio of part and rest (draws, seats), by eqs. (18) and (19).

    The ratio is that of the RMS distances from the mean of all records.

    Args:
        squares: squared distances from the mean in each draw (draws, seats, n) [m²].
        order: indices of the records of each seat (seats, n), the part first; by default in the
            order of the distance from the mean.
        counts: number of records in the part of each seat.
    """
    squares = (
        np.sort(squares, axis=2)
        if order is None
        else np.take_along_axis(squares, order[None], axis=2)
    )
    of_seats = zip(squares.swapaxes(0, 1), counts, strict=False)
    ratios = [one[:, :count].mean(axis=1) / one[:, count:].mean(axis=1) for one, count in of_seats]
    return np.asarray(0.5 * np.log(ratios).T)


@dataclass(frozen=True, eq=False)
class MarkedPart:
    """Logarithms of the ratio of part and rest in simulated records (draws, seats).

    Attributes:
        before: by cause; the part has the postures with the smallest predicted volume.
        after: by cause; the part has the records nearest the mean.
        together: as ``after``, for DH errors with encoder noise, for each of SHARES.
    """

    before: dict[str, Array]
    after: dict[str, Array]
    together: list[Array]

    @property
    def causes(self) -> pd.DataFrame:
        """One row for each cause, about the geometric mean of the ratios over seats 1 to 5.

        before_ratio, after_ratio: medians of the draws. before_reached, after_reached: share of
        draws with a ratio of at most the printed ratio.
        """
        columns = ["before_ratio", "before_reached", "after_ratio", "after_reached"]
        rows = {
            cause: (*_of_mean(self.before[cause]), *_of_mean(after))
            for cause, after in self.after.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("cause")

    @property
    def shares(self) -> pd.DataFrame:
        """ratio and reached for the records nearest the mean, by random_share, the share of noise
        in the variance.
        """
        rows = [_of_mean(logs) for logs in self.together]
        return pd.DataFrame(
            rows, index=pd.Index(SHARES, name="random_share"), columns=["ratio", "reached"]
        )

    @property
    def least_random_share(self) -> float:
        """Smallest random share that reaches the printed contrast in one of twenty draws."""
        return float(np.interp(LEAST, np.maximum.accumulate(self.shares["reached"]), SHARES))

    def chance(self, share: Array, seats: Sequence[int] = tuple(FIVE)) -> Array:
        """Probability (n,) that each random ``share`` (n,) reaches the printed contrast at
        ``seats``.

        This is the likelihood of a share if the selection of the part is unknown, because no
        selection spreads less than the records nearest the mean.
        """
        reached = [_of_mean(logs, seats)[1] for logs in self.together]
        return np.asarray(np.interp(share, SHARES, np.maximum.accumulate(reached)))


def _of_mean(logs: Array, seats: Sequence[int] = tuple(FIVE)) -> tuple[float, float]:
    """Median of the geometric mean of the ratios over ``seats``, and the share of draws with at
    most the printed mean.
    """
    keep = list(seats)
    mean = logs[:, keep].mean(axis=1)
    return float(np.exp(np.median(mean))), float((mean <= MEASURED_LOGS[keep].mean()).mean())


def band(logs: Array) -> Array:
    """Quantiles 5 %, 50 % and 95 % of the ratios at each seat: (3, seats)."""
    return np.asarray(np.quantile(np.exp(logs), [0.05, 0.5, 0.95], axis=0))


def marked_part(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000) -> MarkedPart:
    """Simulate records of the six seats, and select parts by the accuracy volume of eq. (14) and by
    the distance from the mean.
    """
    volumes = accuracy_volume(seats.model, seats.all_q, at=seats.at, method="jointwise").volume
    order = np.argsort(volumes.reshape(seats.q.shape[:2]), axis=1)
    readings = rng.normal(size=(draws, *seats.q.shape))
    moved = {
        DH: _moved_by(seats.sensitivity(), parameter_errors(seats.model, rng, draws)),
        NOISE: np.einsum("snij,dsnj->dsni", seats.levers(), readings, optimize=True),
    }
    for name, effects in systematic().items():
        moved[name] = _moved_by(seats.sensitivity(effects), drawn_values(effects, rng, draws))
    off = {name: from_mean(each) for name, each in moved.items()}
    squares = {name: np.square(each).sum(axis=3) for name, each in off.items()}
    # both relative to the RMS of their spreads at seats 1 to 5
    of_dh, of_noise = (
        np.sqrt(squares[name][:, FIVE].mean(axis=(1, 2)))[:, None, None] for name in (DH, NOISE)
    )
    dh, noise = squares[DH] / of_dh**2, squares[NOISE] / of_noise**2
    both = 2.0 * np.einsum("dsni,dsni->dsn", off[DH], off[NOISE]) / (of_dh * of_noise)
    return MarkedPart(
        before={name: log_ratios(each, order) for name, each in squares.items()},
        after={name: log_ratios(each) for name, each in squares.items()},
        together=[
            log_ratios((1 - share) * dh + share * noise + np.sqrt(share * (1 - share)) * both)
            for share in SHARES
        ],
    )


def _moved_by(sensitivity: Array, values: Array) -> Array:
    """Displacements (draws, seats, n, 3) for ``values`` (draws, p)."""
    return np.asarray(np.einsum("snip,dp->dsni", sensitivity, values, optimize=True))
