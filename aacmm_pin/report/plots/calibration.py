"""What a calibration found: parameters, their correlation, and all of it in one picture."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Calibration
from aacmm_pin.report.calibration_findings import readable_parameters
from aacmm_pin.report.plots.residuals import plot_normalised_residuals, plot_residual_vectors
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, Panels, axes_of, placed

WITHIN, UNTOLD = "#eef2f5", "#d9d9d9"
NOT_AT_ALL = 0.99
"""A parameter whose direction is so much an unknown one is not told at all."""
NAMED = 45
"""So many parameters have room for their names at a heat map."""


def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Axes:
    """Change of each parameter with its expanded uncertainty U (k = 2), over how far off it was said to be.

    Parameters of another colour moved farther than their stated and their new uncertainty together allow (E_n > 1); open
    ones are known only in combination with others. Where nobody stated anything, changes stand in µm and µrad.

    Args:
        result: the calibration.
        ax: axes.
    """
    table = readable_parameters(result)
    stated = table["stated"].notna()
    left_out = 0
    if stated.any():
        left_out, table = int((~stated).sum()), table[stated]
    scale = table["stated"].to_numpy() if stated.any() else np.ones(len(table))
    ax = axes_of(ax, (6.4, 1.2 + 0.24 * len(table)))
    change, bar, place = table["change"].to_numpy() / scale, table["U"].to_numpy() / scale, np.arange(len(table))
    if stated.any():
        ax.axvspan(-1, 1, color=WITHIN, zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    colours = np.where(table["beyond"], VERMILLION, BLUE)
    together = table["known"] == "in combination"
    for x, y, half, colour, open_ in zip(change, place, bar, colours, together, strict=True):
        face = "white" if open_ else colour
        ax.errorbar(x, y, xerr=half, color=colour, mfc=face, fmt="o", ms=4.5, lw=1.2, capsize=2.5)
    ax.set_yticks(place, list(table["parameter"]), fontsize=8)
    ax.set_ylim(len(table) - 0.4, -0.6)
    units = ", ".join(dict.fromkeys(table["in"]))
    ax.set_xlabel(f"{'change / stated ± [1]' if stated.any() else f'change [{units}]'}; bars: U (k = 2)")
    without = f"\n{left_out} without a stated uncertainty are not shown" if left_out else ""
    open_ones = "\nopen: known only in combination with others" if together.any() else ""
    ax.set_title(f"{result.model.arm.name}: parameters{without}{open_ones}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def plot_correlation(result: Calibration, ax: Axes | None = None) -> Axes:
    """Correlation of the parameters; ±1 means that the data tell only their sum or difference, grey that they tell
    nothing.
    """
    untold = np.linalg.norm(result.fit.unknown[: len(result.correlation)], axis=1) > NOT_AT_ALL
    table = result.correlation
    values = np.ma.masked_array(table.to_numpy(), untold[:, None] | untold)
    count = len(table)
    ax = axes_of(ax, (2.6 + 0.2 * min(count, NAMED), 2.0 + 0.2 * min(count, NAMED)))
    image = ax.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    ax.set_facecolor(UNTOLD)
    if count <= NAMED:
        ax.set_xticks(range(count), list(table.columns), rotation=90, fontsize=7)
        ax.set_yticks(range(count), list(table.index), fontsize=7)
    else:
        ax.set(xlabel="number of the parameter", ylabel="number of the parameter")
    ax.figure.colorbar(image, ax=ax, label="correlation [1]", shrink=0.8)
    ax.set_title(f"{result.model.arm.name}: correlation of the parameters", fontsize=10)
    return ax


def plot_residual_sizes(result: Calibration, ax: Axes | None = None) -> Axes:
    """How many records are how far off, before and after, in classes of equal width on a logarithmic scale."""
    ax = axes_of(ax, (5.4, 3.6))
    table = result.residuals[result.fit.used]
    before, after = table["before_mm"].to_numpy(), table["after_mm"].to_numpy()
    largest, least = max(before.max(), after.max(), 2e-9), max(min(before.min(), after.min()), 1e-9)
    edges = list(np.geomspace(0.999 * least, 1.001 * largest, 41))
    for values, rms, colour, when in ((before, result.rms_before, GREY, "before"), (after, result.rms, BLUE, "after")):
        label = f"{when}, RMS {rms / MM:.4f} mm"
        ax.hist(values, edges, color=colour, alpha=0.75, label=label)
    ax.set(xlabel="distance of tip and target [mm]", ylabel="records [1]", xscale="log")
    ax.set_ylim(top=1.25 * ax.get_ylim()[1])
    ax.legend(fontsize=8, frameon=False)
    ax.set_title(f"{result.model.arm.name}: residuals", fontsize=10)
    return ax


def plot_calibration(result: Calibration, ax: Axes | Panels | None = None) -> Panels:
    """Everything in one picture: residuals in space before and after, their sizes, beside the noise, and the parameters.

    Args:
        result: the calibration.
        ax: axes whose place is divided, or five axes.

    Returns:
        axes of the five panels, in this order.
    """
    size = (15.0, max(9.0, 2.0 + 0.2 * len(result.fit.problem.parameters)))
    places = [(0, 0), (0, 1), (1, 0), (1, 1), (slice(0, 2), 2)]
    panels = placed(ax, size, (2, 3), places)
    plot_residual_vectors(result, "before", ax=panels[0])
    plot_residual_vectors(result, "after", ax=panels[1])
    plot_residual_sizes(result, panels[2])
    plot_normalised_residuals(result, panels[3])
    plot_parameter_changes(result, panels[4])
    return panels
