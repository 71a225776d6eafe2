"""Control charts of acceptance checks."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.units import MM
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    figure_of,
    panels_of,
    without_latex,
)
from aacmm_pin.verification import ControlChart, History, brief

NAME = 22
"""Characters of the name of an arm above a panel."""
ACROSS = 4
"""Panels in a row."""
FINEST = 1e-4
"""Least height of a panel [mm]: one digit of the table."""
NOT_COUNTED = "nonconforming or outside the limits, not counted"
LATEST_OUTSIDE = "latest check, outside the limits"
MARKS: dict[str, dict[str, Any]] = {
    "earlier check": {"marker": "o", "ms": 3, "color": INK, "ls": ""},
    NOT_COUNTED: {"marker": "x", "ms": 5, "color": VERMILLION, "ls": ""},
    "latest check": {"marker": "o", "ms": 6, "color": BLUE, "ls": ""},
    LATEST_OUTSIDE: {"marker": "D", "ms": 6, "color": VERMILLION, "ls": ""},
    "mean": {"lw": 0.7, "color": INK},
    "limits": {"lw": 0.7, "color": INK, "ls": "--"},
    "MPE": {"lw": 0.9, "color": VERMILLION, "ls": ":"},
}
"""Styles by the names in the legend."""


@without_latex()
def plot_history(history: History, ax: Axes | None = None) -> Figure:
    """Plot the test values of all checks, with the mean and the limits of the earlier checks and
    the MPE.

    Checks have equal distances, and some their date below; the latest is coloured. A characteristic
    with one check has no panel.
    """
    charts = [chart for chart in history.charts() if len(chart.values) > 1]
    panels = panels_of(ax, (9.4 / ACROSS, 1.9), max(1, len(charts)), ACROSS)
    if not charts:
        panels[0].set_title("no characteristic has two checks", fontsize=8)
    several = len({chart.arm for chart in charts}) > 1
    for panel, chart in zip(panels, charts, strict=False):
        _draw_chart(panel, chart)
        of_arm = f"\n{brief(chart.arm, NAME)}" if several else ""
        panel.set_title(chart.figure + of_arm, fontsize=8)
    for panel in panels[::ACROSS]:
        panel.set_ylabel("|value| [mm]", fontsize=8)
    for panel in panels[-ACROSS:]:
        panel.set_xlabel("date (UTC)", fontsize=8)
    line_of_label = {line.get_label(): line for panel in panels for line in panel.lines}
    handles = [line_of_label[name] for name in MARKS if name in line_of_label]
    figure = figure_of(panels)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(MARKS), fontsize=7)
    return figure


def _draw_chart(ax: Axes, chart: ControlChart) -> None:
    values = chart.values / MM
    numbers = np.arange(len(values))
    latest = LATEST_OUTSIDE if chart.is_outside else "latest check"
    ax.plot(numbers, values, "-", color=GREY, lw=0.8)
    for name, members in (("earlier check", chart.counted), (NOT_COUNTED, ~chart.counted)):
        if members.any():
            ax.plot(numbers[:-1][members], values[:-1][members], label=name, **MARKS[name])
    ax.plot(numbers[-1:], values[-1:], label=latest, **MARKS[latest])
    low, high = chart.limits
    levels = (("mean", chart.centre), ("limits", low), ("limits", high), ("MPE", chart.mpe))
    for name, level in levels:
        if np.isfinite(level):
            ax.axhline(level / MM, label=name, **MARKS[name])
    dated = np.unique(np.linspace(0, len(numbers) - 1, 3).round().astype(int))
    ax.set_xticks(dated, [f"{chart.times[k]:%Y-\n%m-%d\n%H:%M}" for k in dated])
    middle, half = np.mean(ax.get_ylim()), max(FINEST, np.ptp(ax.get_ylim())) / 2
    ax.set_ylim(middle - half, middle + half)
    ax.ticklabel_format(axis="y", useOffset=False)
    ax.tick_params(labelsize=7)
