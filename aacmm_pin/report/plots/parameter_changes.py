"""Changes of parameters with their uncertainties, beside what was stated of them: of a calibration,
of a diagnosis.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration, geometric_parameters
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.effects import in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import small_unit
from aacmm_pin.report.parameters import parameter_table
from aacmm_pin.report.plots.style import BLUE, INK, VERMILLION, axes_of, panels_of, plain, whole

WITHIN = "#e4e9ee"
"""Colour of what was stated."""


@plain
def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Figure:
    """Plot the change of each parameter with U (k = 2), relative to its stated half-width.

    A second colour marks parameters whose change is larger than the half-width and U together. Open
    symbols mark parameters that the records determine only in combination. Without stated
    half-widths, lengths and angles have separate panels.

    Args:
        result: the calibration.
        ax: axes whose area the panels share.
    """
    table = parameter_table(result)
    stated, title = table["stated"].notna(), f"{result.model.arm.name}: parameters"
    if stated.any() and not stated.all():
        title += f"\n{(~stated).sum()} without a stated uncertainty left out"
    if (table["known"] == "in combination").any():
        title += "\nopen symbols: determined only in combination with others"
    parts = (
        [table[stated]] if stated.any() else [part for _, part in table.groupby("unit", sort=False)]
    )
    height = 1.2 + 0.24 * max(map(len, parts))
    panels = panels_of(ax, (6.6 if len(parts) == 1 else 4.3, height), len(parts), len(parts))
    for panel, part in zip(panels, parts, strict=True):
        _draw_changes(part, panel)
    panels[0].set_title(title, fontsize=10)
    return whole(panels)


@plain
def plot_geometry(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """Plot the changes of geometric values that a diagnosis finds beyond their stated uncertainty.

    Raises:
        AacmmError: no geometric value changed so much.
    """
    found = [f.effect for f in result.findings if result.geometric(f)]
    if not found:
        raise AacmmError(
            "no geometric value differs significantly from the stated value; expected one or more"
        )
    arm, rows = result.before.problem.model.arm, []
    for effect in found:
        for parameter, value, u in zip(
            geometric_parameters(arm, effect), effect.values, effect.u, strict=True
        ):
            expanded = COVERAGE_FACTOR * u
            unit, factor = small_unit(parameter.unit, max(abs(value), expanded))
            what = in_words(effect, arm) if len(effect.values) == 1 else parameter.name
            numbers = {
                "parameter": f"{what}\n{factor * value:+.1f} ± {factor * expanded:.1f} {unit}",
                "stated": parameter.half_width or COVERAGE_FACTOR * parameter.u or np.nan,
            }
            rows.append({"unit": parameter.unit, "change": value, "U": expanded} | numbers)
    ax = axes_of(ax, (6.6, 1.2 + 0.24 * len(rows)))
    _draw_changes(pd.DataFrame(rows).assign(known="", beyond=True), ax)
    ax.set_title(
        f"{result.model.arm.name}: geometric values beyond their stated uncertainties", fontsize=10
    )
    return ax


def _draw_changes(table: pd.DataFrame, ax: Axes) -> None:
    """Columns parameter, unit, change, U, stated, known, beyond: over what was stated, or in a
    small unit of the first.
    """
    stated, place = bool(table["stated"].notna().all()), np.arange(len(table))
    largest = np.nanmax(np.abs(table[["change", "U"]].to_numpy()))
    unit, factor = small_unit(table["unit"].iloc[0], largest)
    scale, per = (
        (table["stated"], "/ stated half-width [1]") if stated else (1 / factor, f"[{unit}]")
    )
    change, bar = table["change"] / scale, table["U"] / scale
    if stated:
        ax.axvspan(-1, 1, color=WITHIN, zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    colours = np.where(table["beyond"], VERMILLION, BLUE)
    faces = np.where(table["known"] == "in combination", "white", colours)
    ax.hlines(place, change - bar, change + bar, colors=list(colours), lw=1.4)
    ax.scatter(change, place, 24, facecolors=list(faces), edgecolors=list(colours), zorder=3)
    ax.set_yticks(place, list(table["parameter"]), fontsize=8)
    ax.set_ylim(len(table) - 0.4, -0.6)
    ax.set_xlabel(f"change {per}; bars: U (k = 2)")
    ax.spines[["top", "right"]].set_visible(False)
