"""What a calibration found: parameters, their correlation, and all of it in one picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration_findings import parameter_table
from aacmm_pin.plots.residuals import plot_normalised_residuals, plot_residual_vectors
from aacmm_pin.plots.style import BLUE, GREY, INK, VERMILLION, axes_of
from aacmm_pin.units import MM

NAMED = 45
"""So many parameters have room for their names at a heat map."""


def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Axes:
    """Change of each parameter with its expanded uncertainty U (k = 2), over how far off it was said to be.

    Parameters of another colour moved farther than their stated and their new uncertainty together allow (E_n > 1). Where
    nobody stated any, changes are shown over their own U: within ±1 they cannot be told from zero.

    Args:
        result: the calibration.
        ax: axes.
    """
    table = parameter_table(result)
    if table["stated"].notna().any():
        left_out, table = int(table["stated"].isna().sum()), table[table["stated"].notna()]
        scale, name = table["stated"].to_numpy(), "stated ± of the parameter"
    else:
        left_out, scale, name = 0, table["U"].where(table["U"] > 0).to_numpy(), "U"
    ax = axes_of(ax, (6.4, 1.2 + 0.24 * len(table)))
    change, bar = table["change"].to_numpy() / scale, table["U"].to_numpy() / scale
    place = np.arange(len(table))
    ax.axvspan(-1, 1, color="#eef2f5", zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    for beyond, colour in ((False, BLUE), (True, VERMILLION)):
        some = table["beyond"].to_numpy() == beyond
        ax.errorbar(change[some], place[some], xerr=bar[some], color=colour, fmt="o", ms=4.5, lw=1.2, capsize=2.5)
    ax.set_yticks(place, table["parameter"], fontsize=8)
    ax.set_ylim(len(table) - 0.4, -0.6)
    ax.set_xlabel(f"change / {name} [1]; bars: U (k = 2)")
    without = f" ({left_out} without a stated uncertainty are not shown)" if left_out else ""
    ax.set_title(f"{result.model.arm.name}: parameters{without}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def plot_correlation(result: Calibration, ax: Axes | None = None) -> Axes:
    """Correlation of the parameters; ±1 means that the data tell only their sum or difference."""
    table = result.correlation
    count = len(table)
    ax = axes_of(ax, (2.6 + 0.2 * min(count, NAMED), 2.0 + 0.2 * min(count, NAMED)))
    image = ax.imshow(table.to_numpy(), cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    if count <= NAMED:
        ax.set_xticks(range(count), list(table.columns), rotation=90, fontsize=7)
        ax.set_yticks(range(count), list(table.index), fontsize=7)
    else:
        ax.set(xlabel="number of the parameter", ylabel="number of the parameter")
    ax.figure.colorbar(image, ax=ax, label="correlation [1]", shrink=0.8)
    ax.set_title(f"{result.model.arm.name}: correlation of the parameters", fontsize=10)
    return ax


def plot_residual_sizes(result: Calibration, ax: Axes | None = None) -> Axes:
    """How many records are how far off, before and after."""
    ax = axes_of(ax, (5.4, 3.6))
    table = result.residuals[result.fit.used]
    before, after = table["before_mm"].to_numpy(), table["after_mm"].to_numpy()
    edges = np.linspace(0, max(before.max(), after.max()), 41)
    for values, rms, colour, when in ((before, result.rms_before, GREY, "before"), (after, result.rms, BLUE, "after")):
        label = f"{when}, RMS {rms / MM:.4f} mm"
        ax.hist(values, edges, color=colour, alpha=0.75, label=label)
    ax.set(xlabel="distance of tip and target [mm]", ylabel="records [1]", xlim=(0, None))
    ax.legend(fontsize=8, frameon=False)
    ax.set_title(f"{result.model.arm.name}: residuals", fontsize=10)
    return ax


def plot_calibration(result: Calibration) -> Figure:
    """Everything in one picture; a figure that pyplot does not know."""
    parameters = len(result.fit.problem.parameters)
    figure = Figure(figsize=(15.0, max(9.0, 2.0 + 0.2 * parameters)), layout="constrained")
    axes = figure.subplot_mosaic([["before", "after", "parameters"], ["sizes", "noise", "parameters"]])
    for when in ("before", "after"):
        plot_residual_vectors(result, when, ax=axes[when])
    plot_parameter_changes(result, axes["parameters"])
    plot_residual_sizes(result, axes["sizes"])
    plot_normalised_residuals(result, axes["noise"])
    return figure
