"""The marked ("green") part of the records and the rest: predicted before measuring, or chosen after?

The paper marks, at each seat, the postures whose accuracy volume its eq. (14) puts lowest, and finds them to spread
less. How many they are follows from the print: the spread of all records and the root mean squares of the marked part and of
the rest (eqs. 16, 18, 19) share one sum of squares, ``(n - 1) s² = g ψ_marked² + (n - g) ψ_rest²``. Here records are
simulated, by DH errors alone and by encoder noise alone, and g are taken as the part: those with the smallest predicted
volume, or those that came out nearest the mean. Sizes cancel in the ratio of part and rest.

**However the part was chosen,** no choice of g records of a seat spreads less than the g nearest the mean. Records that a
systematic cause moves along a closed curve are nearly all as far from their mean, and even the nearest spread nearly as much
as the rest; records that scatter have near ones. So a printed part that spreads little says that records scatter; as long as
the postures go round the circle. On an arc of it a systematic cause may have near records too: by the half about θ3 = π DH
errors alone reach what is printed in most arms. ``touched_seats(arc=…, start=…)`` tries it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.accuracy.volume import Method, accuracy_volume
from aacmm_pin.papers.sino6 import printed_table3
from aacmm_pin.papers.sino6_table3.patterns import DH, NOISE, drawn_values, systematic
from aacmm_pin.papers.sino6_table3.seats import RECORDS, SIXTH, TouchedSeats

HYPOTHESES = {
    "before_dh": "smallest predicted volume, DH errors",
    "before_noise": "smallest predicted volume, encoder noise",
    "after_dh": "smallest deviations after measuring, DH errors",
    "after_noise": "smallest deviations after measuring, encoder noise",
}
PRINTED_STEP = 1e-4
"""Last printed digit of the spreads [mm]."""
MEASURED_LOGS = np.log((printed_table3()["high_accuracy_part_std_mm"] / printed_table3()["rest_std_mm"]).to_numpy())
"""Logarithms of the printed ratios of part and rest (6,)."""
SHARES = np.linspace(0.0, 1.0, 11)
"""Shares of the variance that are random."""
LEAST = 0.05
"""A share is possible if the printed contrast is reached at least this often."""


def implied_counts(records: int = RECORDS) -> pd.DataFrame:
    """How many records the marked part of each seat must hold, if there are ``records`` in all, one row a seat.

    Columns: point; marked_count, from the printed numbers; marked_count_low and marked_count_high over all values that round
    to them; whole, whether a whole number lies between.
    """
    table = printed_table3()
    printed = table[["single_point_std_mm", "high_accuracy_part_std_mm", "rest_std_mm"]].to_numpy().T  # (3, 6)
    rounding = np.array(list(product((-0.5, 0.5), repeat=3))).T[:, :, None] * PRINTED_STEP  # (3, 8, 1)
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


def log_ratios(positions: Array, order: Index | None = None, counts: Sequence[int] = COUNTS) -> Array:
    """Logarithms of the RMS distance from the mean of all, of a part over the rest (eqs. 18, 19): (draws, seats).

    Args:
        positions: indications in each draw (draws, seats, n, 3) [m].
        order: numbers of the records of each seat (seats, n), those of the part first; by default by distance from the mean.
        counts: number of records in the part of each seat.
    """
    squares = np.square(positions - positions.mean(axis=2, keepdims=True)).sum(axis=3)
    squares = np.sort(squares, axis=2) if order is None else np.take_along_axis(squares, order[None], axis=2)
    parts = [
        (squares[:, k, :g].mean(axis=1), squares[:, k, g:].mean(axis=1)) for k, g in enumerate(counts[: squares.shape[1]])
    ]
    return np.stack([0.5 * np.log(part / rest) for part, rest in parts], axis=1)


def moved_by(sensitivity: Array, values: Array) -> Array:
    """Displacements (draws, seats, n, 3) by ``values`` (draws, p), or anew in every record by (draws, seats, n, p)."""
    each = "dsnp" if values.ndim == 4 else "dp"
    return np.asarray(np.einsum(f"snip,{each}->dsni", sensitivity, values, optimize=True))


@dataclass(frozen=True, eq=False)
class Contrast:
    """Part over rest at every seat, as printed and under four hypotheses.

    Attributes:
        seats: one row a seat: seat, marked_count, measured_ratio, and p05, median, p95 of the ratio under each hypothesis,
            such as ``after_noise_median``.
        summary: one row a hypothesis: hypothesis; inside, how many of the seats are in its 5–95 % band;
            mean_ratio, geometric mean over the seats, median of the draws; mean_as_small, the share of draws in which it is
            at most that measured.
        measured_mean_ratio: geometric mean of the measured ratios.
    """

    seats: pd.DataFrame
    summary: pd.DataFrame
    measured_mean_ratio: float


def contrast(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000, volume: Method = "jointwise") -> Contrast:
    """Part and rest under the four hypotheses; ``volume`` is how the accuracy volume is found that orders the postures."""
    volumes = accuracy_volume(seats.model, seats.all_q, at=seats.at, method=volume).volume
    order = np.argsort(volumes.reshape(seats.q.shape[:2]), axis=1)
    by_dh = moved_by(seats.sensitivity(), parameter_errors(seats.model, rng, draws))
    noise = rng.normal(size=(len(seats.q), draws, *seats.q.shape[1:]))
    by_noise = moved_by(seats.levers(), noise.swapaxes(0, 1))
    logs = [log_ratios(by_dh, order), log_ratios(by_noise, order), log_ratios(by_dh), log_ratios(by_noise)]
    measured = np.exp(MEASURED_LOGS)
    table = pd.DataFrame({"seat": np.arange(1, len(COUNTS) + 1), "marked_count": COUNTS, "measured_ratio": measured})
    rows = []
    for name, log in zip(HYPOTHESES, logs, strict=True):
        low, middle, high = np.quantile(np.exp(log), [0.05, 0.5, 0.95], axis=0)
        table = table.assign(**{f"{name}_p05": low, f"{name}_median": middle, f"{name}_p95": high})
        rows.append(
            {
                "hypothesis": HYPOTHESES[name],
                "inside": ((low <= measured) & (measured <= high)).sum(),
                "mean_ratio": np.median(np.exp(log.mean(axis=1))),
                "mean_as_small": (log.mean(axis=1) <= MEASURED_LOGS.mean()).mean(),
            }
        )
    return Contrast(table, pd.DataFrame(rows, index=list(HYPOTHESES)), float(np.exp(MEASURED_LOGS.mean())))


@dataclass(frozen=True, eq=False)
class StrictPick:
    """Smallest possible ratios of part and rest at seats 1 to 5, and how often they reach those printed.

    Attributes:
        causes: one row a cause alone: cause; ratio_median, of the geometric mean over the seats; reached, the share of draws
            in which it is at most that printed.
        shares: the same for DH errors and encoder noise together by random_share, the share of noise in the variance.
        logs: logarithms of the ratios behind ``shares`` (shares, draws, 5).
    """

    causes: pd.DataFrame
    shares: pd.DataFrame
    logs: Array

    @property
    def least_random_share(self) -> float:
        """The random share from which on the printed contrast is reached in one of twenty draws."""
        return float(np.interp(LEAST, np.maximum.accumulate(self.shares["reached"]), self.shares["random_share"]))

    def chance(self, share: Array, seats: Sequence[int] = tuple(range(SIXTH))) -> Array:
        """How often the contrast printed for some of the ``seats`` 1 to 5 (from 0) is reached, by random share (n,): (n,).

        The likelihood of a share when nothing is known of how the part was chosen but that it was not better than strictly.
        """
        keep = list(seats)
        reached = (self.logs[:, :, keep].mean(axis=2) <= MEASURED_LOGS[keep].mean()).mean(axis=1)
        return np.asarray(np.interp(share, SHARES, np.maximum.accumulate(reached)))


def strict_pick(seats: TouchedSeats, rng: np.random.Generator, draws: int = 1000) -> StrictPick:
    """Pick strictly among records simulated by each cause alone, and by DH errors and encoder noise together."""
    five = replace(seats, q=seats.q[:SIXTH])
    by_dh = moved_by(five.sensitivity(), parameter_errors(five.model, rng, draws))
    by_noise = moved_by(five.levers(), rng.normal(size=(draws, *five.q.shape)))
    logs = {DH: log_ratios(by_dh), NOISE: log_ratios(by_noise)}
    for name, effects in systematic().items():
        logs[name] = log_ratios(moved_by(five.sensitivity(effects), drawn_values(effects, rng, draws)))
    one, other = (
        moved / np.sqrt(moved.var(axis=2).sum(axis=2).mean(axis=1))[:, None, None, None] for moved in (by_dh, by_noise)
    )
    of_shares = {share: log_ratios(np.sqrt(1 - share) * one + np.sqrt(share) * other) for share in SHARES}
    return StrictPick(_reached(logs, "cause"), _reached(of_shares, "random_share"), np.stack(list(of_shares.values())))


def _reached(logs: dict[str, Array] | dict[float, Array], name: str) -> pd.DataFrame:
    means = {key: log.mean(axis=1) for key, log in logs.items()}
    printed = MEASURED_LOGS[:SIXTH].mean()
    rows = [(key, np.exp(np.median(mean)), (mean <= printed).mean()) for key, mean in means.items()]
    return pd.DataFrame(rows, columns=[name, "ratio_median", "reached"])
