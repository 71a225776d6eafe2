"""Control charts of acceptance checks."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from aacmm_pin._support.units import MM
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, axes_of, panels_of, plain, whole
from aacmm_pin.verification import ControlChart, History

NAME = 22
"""Characters of the name of an arm above a panel."""
MOST = 12
"""Panels in all, in two rows of up to six."""


def charts_drawn(history: History) -> list[ControlChart]:
    """The charts that :func:`plot_history` draws: of two checks at least, first those with an MPE."""
    charts = [chart for chart in history.charts() if len(chart.values) > 1]
    return sorted(charts, key=lambda chart: bool(np.isnan(chart.mpe)))[:MOST]


@plain
def plot_history(history: History, ax: Axes | None = None) -> Figure:
    """The figures of all checks, the latest in colour, with the mean and the limits of the earlier ones and the MPE."""
    charts = charts_drawn(history)
    across = 4 if len(charts) <= 8 else MOST // 2
    if not charts:
        ax = axes_of(ax, (4.0, 1.0))
        ax.text(0.5, 0.5, "no figure of two checks", ha="center", va="center")
        ax.set_axis_off()
        return whole([ax])
    panels = panels_of(ax, (9.4, 0.35 + 1.5 * -(-len(charts) // across)), len(charts), across)
    several = len({chart.arm for chart in charts}) > 1
    for k, (panel, chart) in enumerate(zip(panels, charts, strict=True)):
        _draw(panel, chart, several)
        if k % across == 0:
            panel.set_ylabel("|value| [mm]", fontsize=8)
        if k + across >= len(charts):
            panel.set_xlabel("number of the check", fontsize=8)
    return whole(panels)


def _draw(ax: Axes, chart: ControlChart, several: bool) -> None:
    values = chart.values / MM
    number = np.arange(1, len(values) + 1)
    ax.plot(number, values, "-", color=GREY, lw=0.8)
    ax.plot(number[:-1][chart.counted], values[:-1][chart.counted], "o", color=INK, ms=3)
    ax.plot(number[:-1][~chart.counted], values[:-1][~chart.counted], "x", color=VERMILLION, ms=5)
    ax.plot(number[-1:], values[-1:], "D" if chart.left else "o", color=VERMILLION if chart.left else BLUE, ms=6)
    if np.isfinite(chart.centre):
        ax.axhline(chart.centre / MM, color=INK, lw=0.7)
    for limit in chart.limits:
        if np.isfinite(limit):
            ax.axhline(limit / MM, color=INK, lw=0.7, ls="--")
    if np.isfinite(chart.mpe):
        ax.axhline(chart.mpe / MM, color=VERMILLION, lw=0.9, ls=":")
    arm = chart.arm if len(chart.arm) <= NAME else f"…{chart.arm[1 - NAME :]}"
    ax.set_title(f"{chart.figure}\n{arm}" if several else chart.figure, fontsize=8)
    ax.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    ax.tick_params(labelsize=7)
    ax.spines[["top", "right"]].set_visible(False)
