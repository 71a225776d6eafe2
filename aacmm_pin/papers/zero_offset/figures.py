"""Pictures of the paper's iterations; each function draws on ``ax`` and returns it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from aacmm_pin.papers.zero_offset.gauss_newton import ERRORS_MM, MRAD, RUNS, iterations, rounding_residuals
from aacmm_pin.papers.zero_offset.tables import printed_postures, printed_table2

ROUNDED, UNROUNDED, PRINTED = "#0072b2", "#d55e00", "#4d4d4d"
LIMIT_MM = 0.3
"""The paper stops when all three position errors are below this."""
LEAST_MM = 1e-7
"""What is smaller is the computer's rounding; the picture ends here."""


def draw_iterations(ax: Axes | None = None) -> Axes:
    """Largest position error of the three points after each iteration: printed, rounded to 1 mrad, and unrounded."""
    ax = ax if ax is not None else plt.subplots(figsize=(6.8, 4.2), layout="constrained")[1]
    start, table = printed_postures(), printed_table2()
    for run in RUNS:
        first = run == RUNS[0]
        rounded, exact = iterations(run, MRAD, keying_slip=True), iterations(run)
        for rows, colour, label in ((exact, UNROUNDED, "unrounded"), (rounded, ROUNDED, "increments rounded to 1 mrad")):
            largest = np.maximum(rows[ERRORS_MM].max(axis=1), LEAST_MM)
            ax.plot(rows["iteration"], largest, "o-", ms=3.5, lw=1.2, color=colour, label=label if first else None)
        mine = table[table["run"] == run]
        x = [0, *mine["iteration"]]
        y = [start.loc[start["run"] == run, "position_error_mm"].max(), *mine[ERRORS_MM].max(axis=1)]
        ax.plot(x, y, "s", ms=9, mfc="none", color=PRINTED, label="printed" if first else None)
    ax.axhline(LIMIT_MM, color=PRINTED, lw=0.8, ls="--", label=f"the paper stops below {LIMIT_MM:g} mm")
    ax.set(yscale="log", xlabel="iteration", ylabel="largest error of the three points [mm]", ylim=(LEAST_MM / 2, 200))
    ax.set_xticks(range(5))
    ax.set_title("Three runs of the paper: where the error stays, and where it would have gone", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="lower left")
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def draw_rounding(ax: Axes | None = None) -> Axes:
    """Position error that stays over the rounding of the increments, for each run, beside what is expected of it."""
    ax = ax if ax is not None else plt.subplots(figsize=(6.0, 3.8), layout="constrained")[1]
    table = rounding_residuals((1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5))
    for run, mine in table.groupby("run"):
        (line,) = ax.plot(mine["rounding_mrad"], mine["rms_error_mm"], "o", ms=5, label=f"run {run}")
        ax.plot(mine["rounding_mrad"], mine["expected_rms_error_mm"], "-", lw=1.0, color=line.get_color())
    ax.plot([], [], "-", lw=1.0, color=PRINTED, label="expected: rounding/√12 · ‖G‖/√3")
    ax.set(xscale="log", yscale="log", xlabel="increments rounded to [mrad]", ylabel="error that stays, RMS [mm]")
    ax.set_title("The residual is the rounding's", fontsize=10)
    ax.legend(frameon=False, fontsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    return ax
