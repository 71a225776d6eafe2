"""The papers' tables beside what is computed here, and what six printed spreads tell."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, INK, VERMILLION, axes_of, plain
from papers.sino6.table2 import Table2
from papers.sino6_table3.diagnosis import Table3Diagnosis
from papers.sino6_table3.patterns import CONTACT, DH, ECCENTRICITY, GRAVITY, NOISE
from papers.sino6_table3.selection_bias import COUNTS, MEASURED_LOGS, band
from papers.zero_offset import ERRORS_MM, RUNS, iterations, printed_postures, printed_table2

PURPLE, YELLOW, SKY = "#aa4499", "#e69f00", "#56b4e9"
"""More colours that stay apart for colour-blind readers."""
SHOWN = {
    NOISE: (VERMILLION, "D"),
    CONTACT: (PURPLE, "^"),
    ECCENTRICITY: (GREEN, "v"),
    GRAVITY: (YELLOW, "s"),
    DH: (BLUE, "_"),
}
"""Causes drawn seat by seat."""
LIMIT_MM = 0.3
"""The zero-offset paper stops when all three position errors are below this."""
LEAST_MM = 1e-7
"""What is smaller is the computer's rounding; the picture of the iterations ends here."""
WORST = -20.0
"""Logarithms of Bayes factors below this are cut off in the picture."""
BARS = {
    "five_tau_0.15": (BLUE, "seats 1 to 5, discrepancy 15 %"),
    "six_tau_0.15": (VERMILLION, "six seats, discrepancy 15 %"),
    "six_tau_0.30": (YELLOW, "six seats, discrepancy 30 %"),
}
BANDS = (
    ("before", DH, BLUE, "postures of smallest predicted volume, DH errors"),
    ("before", NOISE, GREY, "the same, encoder noise"),
    ("after", DH, GREEN, "smallest deviations after measuring, DH errors"),
    ("after", NOISE, VERMILLION, "the same, encoder noise"),
)


@plain
def plot_table2(result: Table2, ax: Axes | None = None) -> Axes:
    """Bars of the number of cells by working sectors: printed, reproduced, exact."""
    ax = axes_of(ax, (8.0, 4.2))
    counts, mean = result.counts, result.mean_flexibility
    place, width = counts["working_sectors"].to_numpy(), 0.28
    series = (
        ("paper", "printed", INK),
        ("reproduced", "reproduced", SKY),
        ("exact", "exact geometry", VERMILLION),
    )
    for number, (name, label, colour) in enumerate(series):
        cells = counts[f"{name}_cells"].to_numpy()
        bars = ax.bar(
            place + (number - 1) * width,
            cells,
            width,
            color=colour,
            label=f"{label}, mean ζ = {mean[name]:.3f}",
        )
        ax.bar_label(
            bars, [str(c) if c else "" for c in cells], fontsize=6.5, rotation=90, padding=2
        )
    ax.set_yscale("symlog", linthresh=10)
    ax.set_yticks([0, 10, 100, 1000], ["0", "10", "100", "1000"])
    ax.set_yticks([], minor=True)
    ax.set_xticks(place)
    ax.set(
        ylim=(0, 9000),
        xlabel="working sectors of 12 [1]",
        ylabel="cells of the joint-space grid, linear below 10 [1]",
    )
    distance = 100 * result.total_variation["reproduced"]
    ax.set_title(
        f"Table 2: total variation distance of printed and reproduced counts {distance:.1f} %",
        fontsize=10,
    )
    ax.legend(frameon=False, fontsize=8, loc="upper left", ncols=3)
    return ax


@plain
def plot_iterations(ax: Axes | None = None) -> Axes:
    """Largest position error of the three points after each iteration: printed, rounded to 1 mrad,
    and unrounded.
    """
    ax = axes_of(ax, (6.8, 4.2))
    start, table = printed_postures(), printed_table2()
    for run in RUNS:
        first = run == RUNS[0]
        rounded, exact = iterations(run, rounded=True), iterations(run)
        small = f"unrounded, at {LEAST_MM:g} mm if smaller"
        for rows, colour, label in (
            (exact, VERMILLION, small),
            (rounded, BLUE, "increments rounded to 1 mrad"),
        ):
            largest = np.maximum(rows[ERRORS_MM].max(axis=1), LEAST_MM)
            ax.plot(
                rows["iteration"],
                largest,
                "o-",
                ms=3.5,
                lw=1.2,
                color=colour,
                label=label if first else None,
            )
        mine = table[table["run"] == run]
        y = [
            start.loc[start["run"] == run, "position_error_mm"].max(),
            *mine[ERRORS_MM].max(axis=1),
        ]
        ax.plot(
            [0, *mine["iteration"]],
            y,
            "s",
            ms=9,
            mfc="none",
            color=INK,
            label="printed" if first else None,
        )
    ax.axhline(LIMIT_MM, color=INK, lw=0.8, ls="--", label=f"the paper stops below {LIMIT_MM:g} mm")
    ax.set(
        yscale="log",
        xlabel="iteration",
        ylabel="largest error of the three points [mm]",
        ylim=(LEAST_MM / 2, 200),
    )
    ax.set_xticks(range(5))
    ax.set_title(
        "Three runs of the paper: where the error stays, and where it would have gone", fontsize=10
    )
    ax.legend(frameon=False, fontsize=8, loc="lower left")
    return ax


@plain
def plot_spreads(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Measured spreads over what each cause predicts when seats 1 to 5 have given it its size; the
    DH band before that.
    """
    ax = axes_of(ax, (7.2, 4.4))
    shown = found.shown
    seat = shown["seat"].to_numpy()
    low, high = shown["dh_p05_mm"].to_numpy(), shown["dh_p95_mm"].to_numpy()
    ax.bar(
        seat,
        high - low,
        0.84,
        bottom=low,
        color=BLUE,
        alpha=0.12,
        label="DH errors within half-widths, 5–95 %",
    )
    for k, (cause, (colour, marker)) in enumerate(SHOWN.items()):
        place = seat + 0.11 * (k - 2)
        ax.plot(
            place,
            found.predicted.loc[cause],
            marker,
            ms=7,
            mfc="none",
            mew=1.6,
            color=colour,
            label=_sized(cause),
        )
    measured = shown["measured_mm"].to_numpy()
    error = 1.96 * measured * shown["sampling_percent"].to_numpy() / 100
    ax.errorbar(
        seat,
        measured,
        error,
        fmt="o",
        ms=5,
        color=INK,
        capsize=3,
        lw=1.2,
        label="measured, 95 % of 50 records",
    )
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


@plain
def plot_part_and_rest(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Spread of the marked part over that of the rest, with the 5–95 % bands of four ways to choose
    the part.
    """
    ax = axes_of(ax, (7.2, 4.2))
    seat = np.arange(1, len(COUNTS) + 1)
    for k, (choice, cause, colour, label) in enumerate(BANDS):
        low, middle, high = band(getattr(found.marked, choice)[cause])
        ends = np.stack([middle - low, high - middle])
        ax.errorbar(
            seat + 0.17 * (k - 1.5),
            middle,
            ends,
            fmt="_",
            ms=9,
            mew=2,
            color=colour,
            lw=3,
            alpha=0.85,
            label=label,
        )
    ax.hlines(np.exp(MEASURED_LOGS), seat - 0.42, seat + 0.42, color=INK, lw=1.6, label="printed")
    ax.axhline(1.0, color=INK, lw=0.6, ls=":")
    ax.set_xticks(seat, [f"{s}\n{n} of 50" for s, n in zip(seat, COUNTS, strict=True)])
    ax.set(
        xlabel="seat, records in the marked part",
        ylabel="spread of the marked part / of the rest [1]",
        ylim=(0, 1.85),
    )
    ax.legend(fontsize=8, frameon=False, ncols=1, loc="upper left")
    ax.set_title(
        "Marked part and rest: as printed, chosen before measuring, chosen after", fontsize=10
    )
    return ax


@plain
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
            ax.annotate(
                f"{v:.0f}",
                (WORST, y),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=6.5,
                color="white",
            )
    ax.axvline(-np.log(10.0), color=INK, lw=0.7, ls=":")
    ax.annotate(
        "1 : 10", (-np.log(10.0), len(table) - 0.5), ha="center", va="bottom", fontsize=8, color=INK
    )
    ax.set_yticks(place, table["cause"])
    cut = (
        "; bars cut off state their value"
        if (table[[*BARS]] - table[[*BARS]].max() < WORST).any(axis=None)
        else ""
    )
    ax.set(
        xlabel=f"ln Bayes factor against the best [1]{cut}",
        xlim=(WORST, 0.0),
        ylim=(-0.6, len(table) + 0.1),
    )
    ax.legend(fontsize=8, frameon=False, loc="upper left")
    ax.set_title("Evidence of each description of Table 3", fontsize=10)
    return ax
