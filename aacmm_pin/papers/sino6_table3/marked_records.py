"""The marked ("green") part of the records and the rest: predicted before measuring, or chosen after?

The paper marks, at each seat, the postures whose accuracy volume its eq. (14) puts lowest, and finds them to spread
less. How many they are follows from the print (:func:`implied_counts`). Here records are simulated, by DH errors alone and
by encoder noise alone, and as many are taken as the part: those with the smallest predicted volume, or those that came out
nearest the mean. Sizes cancel in the ratio of part and rest.

**However the part was chosen,** no choice of g records of a seat spreads less than the g nearest the mean. Records that a
systematic cause moves along a closed curve are nearly all as far from their mean, and even the nearest spread nearly as much
as the rest; records that scatter have near ones. So a printed part that spreads little says that records scatter; as long as
the postures go round the circle. On an arc of it a systematic cause may have near records too: by the half about θ3 = π DH
errors alone reach what is printed in nine arms of ten. ``touched_seats(arc=…, start=…)`` tries it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.accuracy.volume import Method, accuracy_volume
from aacmm_pin.papers.sino6 import printed_table3
from aacmm_pin.papers.sino6_table3.causes import DH, NOISE, systematic
from aacmm_pin.papers.sino6_table3.patterns import drawn_values
from aacmm_pin.papers.sino6_table3.predicted import implied_counts
from aacmm_pin.papers.sino6_table3.seats import SIXTH, TouchedSeats

HYPOTHESES = {
    "before_dh": "smallest predicted volume, DH errors",
    "before_noise": "smallest predicted volume, encoder noise",
    "after_dh": "smallest deviations after measuring, DH errors",
    "after_noise": "smallest deviations after measuring, encoder noise",
}
COUNTS = [round(count) for count in implied_counts()["marked_count"]]
"""Records in the marked part of each seat."""
MEASURED_LOGS = np.log((printed_table3()["high_accuracy_part_std_mm"] / printed_table3()["rest_std_mm"]).to_numpy())
"""Logarithms of the printed ratios of part and rest (6,)."""
SHARES = np.linspace(0.0, 1.0, 11)
"""Shares of the variance that are random."""
LEAST = 0.05
"""A share is possible if the printed contrast is reached at least this often."""


def log_ratio(positions: Array, size: int, order: Index | None = None) -> Array:
    """Logarithm of the root mean square distance from the mean of all, of a part over the rest (eqs. 18, 19): (draws,).

    Args:
        positions: indications of one seat in each draw (draws, n, 3) [m].
        size: number of records in the part.
        order: numbers of the records, those of the part first; by default those nearest the mean are the part.
    """
    squares = np.square(positions - positions.mean(axis=1, keepdims=True)).sum(axis=2)
    squares = np.sort(squares, axis=1) if order is None else squares[:, order]
    return np.asarray(0.5 * np.log(squares[:, :size].mean(axis=1) / squares[:, size:].mean(axis=1)))


@dataclass(frozen=True, eq=False)
class Contrast:
    """Part over rest at every seat, as printed and under four hypotheses.

    Attributes:
        seats: one row a seat: seat, marked_count, measured_ratio, and p05, median, p95 of the ratio under each hypothesis,
            such as ``after_noise_median``.
        summary: one row a hypothesis: hypothesis; below_one, the share of draws in which all ratios are below 1;
            all_as_small, in which all are at most those measured; inside, how many of the seats are in its 5–95 % band;
            mean_ratio, geometric mean over the seats, median of the draws; mean_as_small, the share of draws in which it is
            at most that measured.
        measured_mean_ratio: geometric mean of the measured ratios.
    """

    seats: pd.DataFrame
    summary: pd.DataFrame
    measured_mean_ratio: float


def contrast(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000, volume: Method = "jointwise") -> Contrast:
    """Part and rest under the four hypotheses; ``volume`` is how the accuracy volume is found that orders the postures."""
    volumes = accuracy_volume(seats.model, seats.all_q, at=seats.at, method=volume).volume.reshape(seats.q.shape[:2])
    sensitivity, levers, errors = seats.sensitivity(), seats.levers(), parameter_errors(seats.model, rng, draws)
    logs = {name: np.empty((draws, len(COUNTS))) for name in HYPOTHESES}
    for k, count in enumerate(COUNTS):
        noise = rng.normal(size=(draws, *levers.shape[1::2]))
        moved = {
            "dh": np.einsum("nip,dp->dni", sensitivity[k], errors, optimize=True),
            "noise": np.einsum("nij,dnj->dni", levers[k], noise, optimize=True),
        }
        for name, positions in moved.items():
            logs[f"before_{name}"][:, k] = log_ratio(positions, count, np.argsort(volumes[k]))
            logs[f"after_{name}"][:, k] = log_ratio(positions, count)
    measured = np.exp(MEASURED_LOGS)
    table = pd.DataFrame({"seat": np.arange(1, len(COUNTS) + 1), "marked_count": COUNTS, "measured_ratio": measured})
    rows = []
    for name, log in logs.items():
        low, middle, high = np.quantile(np.exp(log), [0.05, 0.5, 0.95], axis=0)
        table = table.assign(**{f"{name}_p05": low, f"{name}_median": middle, f"{name}_p95": high})
        rows.append(
            {
                "hypothesis": HYPOTHESES[name],
                "below_one": float((log < 0.0).all(axis=1).mean()),
                "all_as_small": float((log <= MEASURED_LOGS).all(axis=1).mean()),
                "inside": int(((low <= measured) & (measured <= high)).sum()),
                "mean_ratio": float(np.median(np.exp(log.mean(axis=1)))),
                "mean_as_small": float((log.mean(axis=1) <= MEASURED_LOGS.mean()).mean()),
            }
        )
    return Contrast(table, pd.DataFrame(rows, index=list(logs)), float(np.exp(MEASURED_LOGS.mean())))


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

    def logs_of(positions: Array) -> Array:
        return np.stack([log_ratio(positions[:, k], COUNTS[k]) for k in range(SIXTH)], axis=1)

    def by(sensitivity: Array, values: Array) -> Array:
        return np.asarray(np.einsum("snip,dp->dsni", sensitivity, values, optimize=True))

    def reached(logs: Array) -> tuple[float, float]:
        mean = logs.mean(axis=1)
        return float(np.exp(np.median(mean))), float((mean <= MEASURED_LOGS[:SIXTH].mean()).mean())

    def of_unit_size(moved: Array) -> Array:
        return np.asarray(moved / np.sqrt(moved.var(axis=2).sum(axis=2).mean(axis=1))[:, None, None, None])

    by_dh = by(five.sensitivity(), parameter_errors(five.model, rng, draws))
    by_noise = np.einsum("snij,dsnj->dsni", five.levers(), rng.normal(size=(draws, *five.q.shape)), optimize=True)
    logs = {DH: logs_of(by_dh), NOISE: logs_of(by_noise)}
    for name, effects in systematic().items():
        logs[name] = logs_of(by(five.sensitivity(effects), drawn_values(effects, rng, draws)))
    one, other = of_unit_size(by_dh), of_unit_size(by_noise)
    of_shares = np.stack([logs_of(np.sqrt(1 - share) * one + np.sqrt(share) * other) for share in SHARES])
    causes = [(name, *reached(log)) for name, log in logs.items()]
    shares = [(share, *reached(log)) for share, log in zip(SHARES, of_shares, strict=True)]
    columns = ["ratio_median", "reached"]
    return StrictPick(
        pd.DataFrame(causes, columns=["cause", *columns]),
        pd.DataFrame(shares, columns=["random_share", *columns]),
        of_shares,
    )
