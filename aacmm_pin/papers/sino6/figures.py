"""Pictures of the paper's Tables 2 and 3 beside what is computed here; each function draws on ``ax`` and returns it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from aacmm_pin._support.units import MM

if TYPE_CHECKING:
    from aacmm_pin.papers.sino6.table2 import Table2
    from aacmm_pin.papers.sino6.table3 import Table3

PAPER, REPRODUCED, EXACT = "#4d4d4d", "#56b4e9", "#d55e00"


def draw_table2(result: Table2, ax: Axes | None = None) -> Axes:
    """Bars of the number of cells by working sectors: printed, reproduced, exact."""
    ax = _axes_or_new(ax, (8.0, 4.2))
    counts, mean = result.counts, result.mean_flexibility
    place, width = counts["working_sectors"].to_numpy(), 0.28
    series = (("paper", "printed", PAPER), ("reproduced", "reproduced", REPRODUCED), ("exact", "exact geometry", EXACT))
    for number, (name, label, colour) in enumerate(series):
        cells = counts[f"{name}_cells"].to_numpy()
        bars = ax.bar(place + (number - 1) * width, cells, width, color=colour, label=f"{label}, mean ζ = {mean[name]:.3f}")
        ax.bar_label(bars, [str(c) if c else "" for c in cells], fontsize=6.5, rotation=90, padding=2)
    ax.set_yscale("symlog", linthresh=10)
    ax.set_ylim(0, 9000)
    ax.set_yticks([0, 10, 100, 1000], ["0", "10", "100", "1000"])
    ax.set_yticks([], minor=True)
    ax.set_xticks(place)
    ax.set_xlabel("working sectors of 12 [1]")
    ax.set_ylabel("cells of the joint-space grid, linear below 10 [1]")
    distance = 100 * result.total_variation
    ax.set_title(f"Table 2: total variation distance of printed and reproduced counts {distance:.1f} %", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="upper left", ncols=3)
    _bare(ax)
    return ax


def draw_table3(result: Table3, ax: Axes | None = None) -> Axes:
    """Measured spread of each seat over the 5–95 % band that errors of the DH values predict, and the angle-noise law."""
    ax = _axes_or_new(ax, (6.4, 4.2))
    points = result.points
    place = points["point"].to_numpy()
    arms = np.quantile(result.spreads.mean(axis=1), np.linspace(0.05, 0.95, 10), method="nearest")
    for one in result.spreads[np.isin(result.spreads.mean(axis=1), arms)]:
        ax.plot(place, one / MM, color=REPRODUCED, lw=0.7, zorder=1)
    ax.plot([], [], color=REPRODUCED, lw=0.7, label="ten of these arms")
    low, median, high = (points[f"dh_{name}_mm"].to_numpy() for name in ("p05", "median", "p95"))
    ax.bar(
        place, high - low, 0.5, bottom=low, color=REPRODUCED, alpha=0.25, label="DH errors within Table 1, 5–95 % of arms"
    )
    ax.hlines(median, place - 0.25, place + 0.25, color=REPRODUCED, lw=2.5, label="their median")
    ax.plot(place, points["angle_noise_mm"], "D", color=EXACT, mfc="none", ms=8, label="white angle noise, 5″ on each joint")
    ax.plot(place, points["measured_mm"], "o", color=PAPER, ms=5, label="measured (printed)")
    ax.set_xticks(place)
    ax.set_ylim(0.0, 1.45 * float(np.max(high)))
    ax.set_xlabel("seat")
    ax.set_ylabel("spread of 50 records about their mean [mm]")
    ax.set_title("Table 3: the bands of the six seats move together: each arm is a flat line", fontsize=10)
    ax.legend(frameon=False, fontsize=8, loc="upper left", ncols=2)
    _bare(ax)
    return ax


def _axes_or_new(ax: Axes | None, size: tuple[float, float]) -> Axes:
    return ax if ax is not None else plt.subplots(figsize=size, layout="constrained")[1]


def _bare(ax: Axes) -> None:
    ax.spines[["top", "right"]].set_visible(False)
