"""What six printed spreads tell: by seat and cause, part and rest, evidence, and what the records would add."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from aacmm_pin.papers.table3 import Table3Diagnosis
from aacmm_pin.papers.table3.causes import CONTACT, DH, ECCENTRICITY, GRAVITY, NOISE
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, axes_of

GREEN, PURPLE, YELLOW = "#009e73", "#aa4499", "#e69f00"
"""More colours that stay apart for colour-blind readers."""
SHOWN = {
    NOISE: (VERMILLION, "D"),
    CONTACT: (PURPLE, "^"),
    ECCENTRICITY: (GREEN, "v"),
    GRAVITY: (YELLOW, "s"),
    DH: (BLUE, "_"),
}
"""Causes drawn seat by seat."""
WORST = -20.0
"""Logarithms of Bayes factors below this are cut off in the picture."""
BARS = {
    "five_tau_0.15": (BLUE, "seats 1 to 5, discrepancy 15 %"),
    "six_tau_0.15": (VERMILLION, "six seats, discrepancy 15 %"),
    "six_tau_0.30": (YELLOW, "six seats, discrepancy 30 %"),
}
BANDS = {
    "before_dh": (BLUE, "postures of smallest predicted volume, DH errors"),
    "before_noise": (GREY, "the same, encoder noise"),
    "after_dh": (GREEN, "smallest deviations after measuring, DH errors"),
    "after_noise": (VERMILLION, "the same, encoder noise"),
}


def plot_spreads(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Measured spreads over what each cause predicts when seats 1 to 5 have given it its size; the DH band before that."""
    ax = axes_of(ax, (7.2, 4.4))
    shown = found.shown
    seat = shown["seat"].to_numpy()
    low, high = shown["dh_p05_mm"].to_numpy(), shown["dh_p95_mm"].to_numpy()
    ax.bar(seat, high - low, 0.84, bottom=low, color=BLUE, alpha=0.12, label="DH errors within half-widths, 5–95 %")
    for k, (cause, (colour, marker)) in enumerate(SHOWN.items()):
        place = seat + 0.11 * (k - 2)
        ax.plot(place, found.predicted.loc[cause], marker, ms=7, mfc="none", mew=1.6, color=colour, label=_sized(cause))
    measured = shown["measured_mm"].to_numpy()
    error = 1.96 * measured * shown["sampling_percent"].to_numpy() / 100
    ax.errorbar(seat, measured, error, fmt="o", ms=5, color=INK, capsize=3, lw=1.2, label="measured, 95 % of 50 records")
    ax.set_xticks(seat)
    ax.set(
        xlabel="seat",
        ylabel="spread about the mean [mm]",
        yscale="log",
        ylim=(0.6 * float(low.min()), 3.2 * float(high.max())),
    )
    ax.set_yticks([0.01, 0.02, 0.05, 0.1, 0.2], ["0.01", "0.02", "0.05", "0.1", "0.2"])
    ax.set_yticks([], minor=True)
    ax.legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
    ax.set_title("Table 3 by cause, each of the size that seats 1 to 5 give it", fontsize=10)
    return ax


def _sized(cause: str) -> str:
    return "DH errors, seats 1–5 known" if cause == DH else cause


def plot_part_and_rest(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Spread of the marked part over that of the rest, with the 5–95 % bands of four ways to choose the part."""
    ax = axes_of(ax, (7.2, 4.2))
    table = found.contrast.seats
    seat = table["seat"].to_numpy()
    for k, (name, (colour, label)) in enumerate(BANDS.items()):
        middle = table[f"{name}_median"].to_numpy()
        ends = np.stack([middle - table[f"{name}_p05"], table[f"{name}_p95"] - middle])
        ax.errorbar(seat + 0.17 * (k - 1.5), middle, ends, fmt="_", ms=9, mew=2, color=colour, lw=3, alpha=0.85, label=label)
    ax.hlines(table["measured_ratio"], seat - 0.42, seat + 0.42, color=INK, lw=1.6, label="printed")
    ax.axhline(1.0, color=INK, lw=0.6, ls=":")
    ax.set_xticks(seat, [f"{s}\n{n} of 50" for s, n in zip(seat, table["marked_count"], strict=True)])
    ax.set(xlabel="seat, records in the marked part", ylabel="spread of the marked part / of the rest [1]", ylim=(0, 1.85))
    ax.legend(fontsize=8, frameon=False, ncols=1, loc="upper left")
    ax.set_title("Marked part and rest: as printed, chosen before measuring, chosen after", fontsize=10)
    return ax


def plot_bayes_factors(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Logarithm of the Bayes factor of every cause against the best, by five seats and by six."""
    ax = axes_of(ax, (7.6, 5.4))
    table = found.evidences.sort_values("six_tau_0.15", ignore_index=True)
    place, height = np.arange(len(table)), 0.26
    for k, (column, (colour, label)) in enumerate(BARS.items()):
        value = (table[column] - table[column].max()).to_numpy()
        at = place + (1 - k) * height
        ax.barh(at, np.maximum(value, WORST), height, color=colour, label=label)
        for y, v in zip(at[value < WORST], value[value < WORST], strict=True):
            ax.annotate(f"{v:.0f}", (WORST, y), (3, 0), textcoords="offset points", va="center", fontsize=6.5, color="white")
    ax.axvline(-np.log(10.0), color=INK, lw=0.7, ls=":")
    ax.annotate("1 : 10", (-np.log(10.0), len(table) - 0.5), ha="center", va="bottom", fontsize=8, color=INK)
    ax.set_yticks(place, table["cause"])
    ax.set(xlabel="ln Bayes factor against the best [1]", xlim=(WORST, 0.0), ylim=(-0.6, len(table) + 0.1))
    ax.legend(fontsize=8, frameon=False, loc="upper left")
    ax.set_title("Evidence of each description of Table 3", fontsize=10)
    return ax


def plot_expected_of_records(table: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Expected logarithm of the Bayes factor of the true cause (row) against another (column), from all records."""
    ax = axes_of(ax, (7.8, 5.2))
    values = table.to_numpy()
    ax.imshow(np.log10(np.maximum(values, 1.0)), cmap="Blues", vmin=0.0, vmax=5.0, aspect="auto")
    for (i, k), value in np.ndenumerate(values):
        same = table.index[i] == table.columns[k]
        dark = value > 1e3
        ax.text(k, i, "–" if same else f"{value:.0f}", ha="center", va="center", fontsize=8, color="white" if dark else INK)
    ax.set_xticks(range(values.shape[1]), list(table.columns), rotation=35, ha="right", fontsize=8)
    ax.set_yticks(range(values.shape[0]), list(table.index), fontsize=8)
    ax.set(xlabel="assumed instead", ylabel="true cause")
    ax.set_title("Expected ln Bayes factor [1] from the 300 records themselves", fontsize=10)
    return ax
