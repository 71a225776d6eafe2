"""Changes of parameters with their uncertainties, beside what was stated of them: of a calibration, of a diagnosis."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration.parameter_vector import geometric_parameters
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects.labels import in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import small_unit
from aacmm_pin.report.parameters import readable_parameters
from aacmm_pin.report.plots.style import BLUE, INK, VERMILLION, axes_of, plain

WITHIN = "#e4e9ee"
"""Colour of what was stated."""


@plain
def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Axes:
    """Change of each parameter with its expanded uncertainty U (k = 2), over how far off it was said to be.

    Parameters of another colour moved farther than their stated and their new uncertainty together allow (E_n > 1); open
    ones are known only in combination with others. Where nothing was stated, changes stand in µm and µrad.

    Args:
        result: the calibration.
        ax: axes.
    """
    table = readable_parameters(result)
    stated, title = table["stated"].notna(), f"{result.model.arm.name}: parameters"
    if stated.any() and not stated.all():
        title += f"\n{(~stated).sum()} without a stated uncertainty are not shown"
    if (table["known"] == "in combination").any():
        title += "\nopen: known only in combination with others"
    ax = _draw_changes(table[stated] if stated.any() else table, ax)
    ax.set_title(title, fontsize=10)
    return ax


@plain
def plot_geometry(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """The same of the geometric values of a diagnosis that moved beyond what was stated of them.

    Raises:
        AacmmError: no geometric value did.
    """
    found = [f.effect for f in result.findings if geometric(result, f)]
    if not found:
        raise AacmmError("no geometric value of this diagnosis is beyond what was stated of it")
    arm, rows = result.before.problem.model.arm, []
    for effect in found:
        for parameter, value, u in zip(geometric_parameters(arm, effect), effect.values, effect.u, strict=True):
            unit, factor = small_unit(parameter.unit)
            change, expanded = factor * value, COVERAGE_FACTOR * factor * u
            what = in_words(effect) if len(effect.values) == 1 else parameter.name
            stated = factor * (parameter.half_width or COVERAGE_FACTOR * parameter.u or np.nan)
            numbers = {"change": change, "U": expanded, "stated": stated}
            rows.append({"parameter": f"{what}\n{change:+.1f} ± {expanded:.1f} {unit}", "in": unit, **numbers})
    ax = _draw_changes(pd.DataFrame(rows).assign(known="", beyond=True), ax)
    ax.set_title(f"{result.model.arm.name}: geometry beyond its stated uncertainty", fontsize=10)
    return ax


def geometric(result: Diagnosis, finding: Finding) -> bool:
    """Whether a finding is a value of the arm's own geometry."""
    return bool(geometric_parameters(result.extended.problem.model.arm, finding.effect))


def _draw_changes(table: pd.DataFrame, ax: Axes | None) -> Axes:
    """Columns parameter, change, U, stated, in, known, beyond: over what was stated, or where it was not in their units."""
    stated, place = bool(table["stated"].notna().all()), np.arange(len(table))
    ax = axes_of(ax, (6.6, 1.2 + 0.24 * len(table)))
    scale = table["stated"] if stated else 1.0
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
    units = "/ stated ± [1]" if stated else f"[{', '.join(table['in'].unique())}]"
    ax.set_xlabel(f"change {units}; bars: U (k = 2)")
    ax.spines[["top", "right"]].set_visible(False)
    return ax
