"""Accuracy at a point, and maps of the workspace."""

from __future__ import annotations

from itertools import cycle
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy import QUANTITIES, AccuracyVolume, Quantity, WorkspaceMap, paired
from aacmm_pin.effects import row_in_words
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.postures import WRIST, ConfigurationCircle, PosturesAtPoint, ReachingPostures
from aacmm_pin.report.numbers import length
from aacmm_pin.report.plots.style import (
    BLUE,
    U_NAME,
    VERMILLION,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    axes_of,
    draw_bars,
    legend_below,
    without_latex,
)

BudgetBy = Literal["parameter", "joint", "kind"]
MARKERS = "os^DvP*h"
"""Markers that distinguish components."""
NOT_THERE = "no mark: no posture within limits"
ABOVE = 1.15
"""Upper end of the axes, in largest values."""
UNREACHABLE, OUTSIDE_LIMITS = "#d9d9d9", "#cc79a7"
OUTSIDE_WORDS = "in reach, no posture within the joint limits"
MAP_UNITS = {
    "mm3": ("mm³", 1.0, VOLUME_COLOURS),
    "mm": ("µm", MM / UM, VOLUME_COLOURS),
    "1": ("1", 1.0, "cividis"),
}
"""Unit in figures, its factor, and colours, by the unit of a variable of a map."""


@without_latex()
def plot_accuracy_of_postures(
    postures: PosturesAtPoint, accuracy: AccuracyVolume, ax: Axes | None = None
) -> Axes:
    """Plot accuracy volume (left axis) and standard uncertainty (right axis) of the postures at a
    point.

    The abscissa is the swivel angle, or without an elbow the length along each curve of
    self-motion, or the number of a single posture. Each component has its own marker.

    Raises:
        ShapeError: ``accuracy`` is for other postures.
    """
    inside, ax = paired(postures, accuracy), axes_of(ax, (7.5, 4.2))
    component = postures.component[inside]
    if isinstance(postures, ConfigurationCircle):
        abscissa = postures.swivel[inside] / DEG
        ax.set(xlabel="swivel angle (elbow highest at 0°) [°]", xticks=range(-180, 181, 60))
    elif isinstance(postures, ReachingPostures) and not postures.single:
        abscissa = postures.travel[inside]
        ax.set_xlabel("distance along the curve in joint space [rad]")
    else:
        abscissa = component.astype(np.float64)
        ax.set(xlabel="number of the posture", xticks=range(1, postures.component.max() + 1))
    right = ax.twinx()
    volume, u = accuracy.volume / MM3, accuracy.u / UM
    for number, marker in zip(np.unique(component), cycle(MARKERS), strict=False):
        chosen = component == number
        style: dict[str, Any] = {"marker": marker, "ls": "", "ms": 3.5, "mfc": "none"}
        label = f"component {number}"
        ax.plot(abscissa[chosen], volume[chosen], color=BLUE, label=label, **style)
        right.plot(abscissa[chosen], u[chosen], color=VERMILLION, **style)
    # From zero, so that a change by two per cent looks like one.
    ax.set_ylim(0.0, ABOVE * volume.max(initial=0.0) or None)
    right.set_ylim(0.0, ABOVE * u.max(initial=0.0) or None)
    ax.set_ylabel(VOLUME_LABEL, color=BLUE)
    right.set_ylabel(f"{U_NAME} [µm]", color=VERMILLION)
    ax.grid(alpha=0.3)
    if component.any():
        legend_below(ax, title=None if postures.within_limits.all() else NOT_THERE)
    ax.set_title(f"{accuracy.sources.arm.name}: accuracy of the postures, {accuracy.method}")
    return ax


@without_latex()
def plot_budget(
    accuracy: AccuracyVolume,
    by: BudgetBy = "parameter",
    ax: Axes | None = None,
    most: int = 12,
) -> Axes:
    """Plot the uncertainty budget as bars: shares of the variance, with standard uncertainties as
    numbers.

    A bar is a parameter, a joint or a kind of parameter, as ``by`` states; at most ``most`` bars.

    Raises:
        AacmmError: ``most`` is below 1, or ``accuracy`` has no posture.
    """
    if most < 1 or not len(accuracy.q):
        raise AacmmError(
            f"most is {most} and accuracy has {len(accuracy.q)} postures; expected at least "
            "1 of each"
        )
    arm, budget = accuracy.sources.arm, accuracy.budget(by)
    budget = budget[budget["share"] != 0].sort_values(
        "share", ascending=False, key=abs, kind="stable"
    )
    names, labels = [], []
    for source, share, u in zip(budget[by], budget["share"], budget["u_mm"], strict=True):
        name = f"{row_in_words(source, arm)} {source}" if by == "joint" else str(source)
        names.append("whole arm" if pd.isna(source) else name)
        labels.append(f"{100 * share:.1f} %,  {length(u * MM)}")
    ax = axes_of(ax, (7.0, 0.9 + 0.32 * len(names[:most])))
    draw_bars(ax, names[:most], 100 * budget["share"].head(most), labels[:most], BLUE)
    ax.set_xlabel("share of the variance of the position [%] (labels: share, u)")
    part = f", the {most} largest of {len(names)}" if len(names) > most else ""
    ax.set_title(f"{arm.name} at {accuracy.sources.at}: uncertainty budget by {by}{part}")
    return ax


@without_latex()
def plot_map(
    map_: WorkspaceMap, quantity: Quantity = "comprehensive_mm3", ax: Axes | None = None
) -> Axes:
    """Plot one quantity over the half-plane through joint axis 1; cells out of reach are grey.

    Raises:
        UnknownNameError: the quantity is none of :data:`QUANTITIES`.
    """
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, list(QUANTITIES))
    variable, data, ax = QUANTITIES[quantity], map_.data, axes_of(ax, (5.4, 6.6))
    unit, scale, colours = MAP_UNITS[variable.unit]
    x, z = map_.axes
    reachable = data["reachable"].values.astype(bool)
    values = np.where(reachable, scale * data[quantity].values, np.nan)
    image = ax.pcolormesh(x, z, values.T, shading="nearest", cmap=colours, vmax=variable.greatest)
    if variable.greatest is not None:
        image.set_clim(vmin=0.0)
    ax.figure.colorbar(image, ax=ax, label=f"{variable.text} [{unit}]")
    for cells, colour, text in (
        (~reachable, UNREACHABLE, "out of reach"),
        (reachable & np.isnan(values), OUTSIDE_LIMITS, OUTSIDE_WORDS),
    ):
        if cells.any():
            mask = np.where(cells, 0.0, np.nan).T
            ax.pcolormesh(x, z, mask, shading="nearest", cmap=ListedColormap([colour]))
            ax.scatter([], [], marker="s", color=colour, label=text)
    ax.set(xlabel=f"{x.long_name} [mm]", ylabel=f"{z.long_name} [mm]", aspect="equal")
    if np.isnan(values).any():
        legend_below(ax)
    title = f"{variable.text}, {map_.sectors} sectors, {data.attrs['method']}"
    working_point = "wrist" if data.attrs["working_point"] == WRIST else "tip"
    ax.set_title(f"{data.attrs['arm']}, {working_point} in each cell:\n{title}")
    return ax
