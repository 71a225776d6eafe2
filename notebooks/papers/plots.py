"""Figures that compare the tables of the papers with computed results."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, INK, VERMILLION, axes_of, without_latex
from papers.sino6.table2 import Table2
from papers.sino6_table3.diagnosis import Table3Diagnosis
from papers.sino6_table3.patterns import CONTACT, DH, ECCENTRICITY, GRAVITY, NOISE
from papers.sino6_table3.selection_bias import COUNTS, MEASURED_LOGS, band
from papers.zero_offset import ERRORS_MM, RUNS, iterations, printed_postures, printed_table2

PURPLE, YELLOW, SKY = "#aa4499", "#e69f00", "#56b4e9"
"""More colours that colour-blind readers distinguish."""
SHOWN = {
    NOISE: (VERMILLION, "D"),
    CONTACT: (PURPLE, "^"),
    ECCENTRICITY: (GREEN, "v"),
    GRAVITY: (YELLOW, "s"),
    DH: (BLUE, "_"),
}
"""Colour and marker of each cause in the figure of the seats."""
LIMIT_MM = 0.3
"""The zero-offset paper stops when all three position errors are below this."""
LEAST_MM = 1e-7
"""Lower end of the figure of the iterations; smaller values are rounding of the computer."""
WORST = -20.0
"""The figure cuts off logarithms of Bayes factors below this value."""
BARS = {
    "five_tau_0.15": (BLUE, "seats 1 to 5, τ = 15 %"),
    "six_tau_0.15": (VERMILLION, "six seats, τ = 15 %"),
    "six_tau_0.30": (YELLOW, "six seats, τ = 30 %"),
}
BANDS = (
    ("before", DH, BLUE, "smallest predicted volumes, DH errors"),
    ("before", NOISE, GREY, "smallest predicted volumes, encoder noise"),
    ("after", DH, GREEN, "records nearest the mean, DH errors"),
    ("after", NOISE, VERMILLION, "records nearest the mean, encoder noise"),
)


@without_latex()
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
        xlabel="number of working sectors (of 12)",
        ylabel="number of cells (linear below 10)",
    )
    distance = 100 * result.total_variation["reproduced"]
    ax.set_title(
        f"Table 2: printed and reproduced counts, total variation distance {distance:.1f} %",
        fontsize=10,
    )
    ax.legend(frameon=False, fontsize=8, loc="upper left", ncols=3)
    return ax


@without_latex()
def plot_iterations(ax: Axes | None = None) -> Axes:
    """Largest position error of the three points after each iteration: printed, rounded to 1 mrad,
    and unrounded.
    """
    ax = axes_of(ax, (6.8, 4.2))
    start, table = printed_postures(), printed_table2()
    for run in RUNS:
        first = run == RUNS[0]
        rounded, exact = iterations(run, rounded=True), iterations(run)
        small = f"without rounding (drawn at {LEAST_MM:g} mm if smaller)"
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
        xlabel="number of iterations",
        ylabel="largest error of the three points [mm]",
        ylim=(LEAST_MM / 2, 200),
    )
    ax.set_xticks(range(5))
    ax.set_title("Errors of the three runs, with and without rounding", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="lower left")
    return ax


@without_latex()
def plot_spreads(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Measured spreads, and the predictions of each cause with the size that fits seats 1 to 5.

    The band shows DH errors within their half-widths.
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
        label="DH errors within their half-widths, 5–95 %",
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
        label="measured, with 95 % interval",
    )
    ax.set_xticks(seat)
    ax.set(
        xlabel="seat",
        ylabel="spread of the positions [mm]",
        yscale="log",
        ylim=(0.6 * float(low.min()), 3.2 * float(high.max())),
    )
    ax.set_yticks([0.01, 0.02, 0.05, 0.1, 0.2], ["0.01", "0.02", "0.05", "0.1", "0.2"])
    ax.set_yticks([], minor=True)
    ax.legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
    ax.set_title("Table 3: spreads by cause, with the size that fits seats 1 to 5", fontsize=10)
    return ax


def _sized(cause: str) -> str:
    return "DH errors that fit seats 1–5" if cause == DH else cause


@without_latex()
def plot_part_and_rest(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Spread of the marked part divided by that of the rest, with the 5–95 % bands of four
    selections of the part.
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
        xlabel="seat, and number of records in the marked part",
        ylabel="spread of marked part / spread of rest [1]",
        ylim=(0, 1.85),
    )
    ax.legend(fontsize=8, frameon=False, ncols=1, loc="upper left")
    ax.set_title("Marked part and rest, by selection of the part", fontsize=10)
    return ax


@without_latex()
def plot_bayes_factors(found: Table3Diagnosis, ax: Axes | None = None) -> Axes:
    """Logarithm of the Bayes factor of each cause relative to the best, for five and six seats."""
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
        "; numbers: values of bars that are cut off"
        if (table[[*BARS]] - table[[*BARS]].max() < WORST).any(axis=None)
        else ""
    )
    ax.set(
        xlabel=f"ln Bayes factor relative to the best [1]{cut}",
        xlim=(WORST, 0.0),
        ylim=(-0.6, len(table) + 0.1),
    )
    ax.legend(fontsize=8, frameon=False, loc="upper left")
    ax.set_title("Table 3: evidence of each description", fontsize=10)
    return ax
