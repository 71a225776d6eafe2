"""The marked ("green") part of the records and the rest: predicted before measuring, or chosen after?

The paper marks, at each seat, the postures whose accuracy volume its eq. (14) puts lowest, and finds them to spread
less. How many they are follows from the print (:func:`aacmm_pin.papers.sino6.implied_counts`). Here records are
simulated, by DH errors alone and by encoder noise alone, and as many are taken as the part: those with the smallest
predicted volume, or those that came out nearest the mean. Sizes cancel in the ratio of part and rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown
from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.accuracy.volume import Method, accuracy_volume
from aacmm_pin.papers.sino6 import implied_counts, printed_table3
from aacmm_pin.papers.spread import TouchedSeats, part_and_rest

HYPOTHESES = {
    "before_dh": "smallest predicted volume, DH errors",
    "before_noise": "smallest predicted volume, encoder noise",
    "after_dh": "smallest deviations after measuring, DH errors",
    "after_noise": "smallest deviations after measuring, encoder noise",
}
VOLUME: Method = "jointwise"
"""Eq. (14), read as the sum over the rows."""


@dataclass(frozen=True, eq=False)
class Contrast(Shown):
    """Part over rest at every seat, as printed and under four hypotheses.

    Attributes:
        seats: one row a seat: seat, marked_count, measured_ratio, and p05, median, p95 of the ratio under each hypothesis,
            such as ``after_noise_median``.
        ratios: of each hypothesis (draws, seats).
        summary: one row a hypothesis: hypothesis; below_one, the share of draws in which all ratios are below 1;
            all_as_small, in which all are at most those measured; inside, how many of the seats are in its 5–95 % band;
            mean_ratio, geometric mean over the seats, median of the draws; mean_as_small, the share of draws in which it is
            at most that measured.
        measured_mean_ratio: geometric mean of the measured ratios.
    """

    seats: pd.DataFrame
    ratios: dict[str, Array]
    summary: pd.DataFrame
    measured_mean_ratio: float


def contrast(seats: TouchedSeats, rng: np.random.Generator, draws: int = 2000, volume: Method = VOLUME) -> Contrast:
    """Part and rest under the four hypotheses.

    Args:
        seats: seats and postures.
        rng: for the draws.
        draws: arms, and measurements of all seats.
        volume: how the accuracy volume is found that orders the postures.
    """
    counts = [round(count) for count in implied_counts()["marked_count"]]
    printed = printed_table3()
    measured = (printed["high_accuracy_part_std_mm"] / printed["rest_std_mm"]).to_numpy()
    model = seats.model
    volumes = seats.by_seat(accuracy_volume(model, seats.all_q, at=seats.at, method=volume).volume)
    sensitivity = seats.by_seat(model.sensitivity(seats.all_q, at=seats.at))
    levers = seats.by_seat(seats.levers())
    errors = parameter_errors(model, rng, draws)
    ratios = {name: np.empty((draws, len(counts))) for name in HYPOTHESES}
    for k, count in enumerate(counts):
        order = np.argsort(volumes[k])
        by_dh = np.einsum("nip,dp->dni", sensitivity[k], errors, optimize=True)
        noise = rng.normal(size=(draws, *levers[k].shape[::2]))
        by_noise = np.einsum("nij,dnj->dni", levers[k], noise, optimize=True)
        for name, positions in (("dh", by_dh), ("noise", by_noise)):
            before, after = part_and_rest(positions, count, "before", order), part_and_rest(positions, count, "after")
            ratios[f"before_{name}"][:, k] = before[0] / before[1]
            ratios[f"after_{name}"][:, k] = after[0] / after[1]
    return _contrast(counts, measured, ratios)


def _contrast(counts: list[int], measured: Array, ratios: dict[str, Array]) -> Contrast:
    table: dict[str, ArrayLike] = {"seat": np.arange(1, len(counts) + 1), "marked_count": counts, "measured_ratio": measured}
    rows, own_mean = [], float(np.exp(np.log(measured).mean()))
    for name, values in ratios.items():
        low, middle, high = np.quantile(values, [0.05, 0.5, 0.95], axis=0)
        table |= {f"{name}_p05": low, f"{name}_median": middle, f"{name}_p95": high}
        mean = np.exp(np.log(values).mean(axis=1))
        rows.append(
            {
                "hypothesis": HYPOTHESES[name],
                "below_one": float((values < 1.0).all(axis=1).mean()),
                "all_as_small": float((values <= measured).all(axis=1).mean()),
                "inside": int(((low <= measured) & (measured <= high)).sum()),
                "mean_ratio": float(np.median(mean)),
                "mean_as_small": float((mean <= own_mean).mean()),
            }
        )
    return Contrast(pd.DataFrame(table), ratios, pd.DataFrame(rows, index=list(ratios)), own_mean)
