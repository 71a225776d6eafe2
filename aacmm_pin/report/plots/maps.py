"""Maps of the workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.patches import Patch
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM, UM
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.report.plots.style import U_NAME, VOLUME_COLOURS, axes_of

UNREACHABLE, OUTSIDE_LIMITS = "#d9d9d9", "#cc79a7"
FLEXIBILITY_COLOURS = "cividis"


@dataclass(frozen=True)
class _Quantity:
    """How a quantity of a map is drawn: its words with their unit, what of the data's unit makes one, colours, title."""

    label: str
    title: str
    scale: float = 1.0
    colours: str = VOLUME_COLOURS
    norm: tuple[float, float] | None = None


_OF_SECTORS = ", {sectors} sectors"
QUANTITIES = {
    "comprehensive_mm3": _Quantity("comprehensive accuracy volume [mm³]", "comprehensive accuracy, {method}"),
    "best_mm3": _Quantity("smallest accuracy volume [mm³]", "accuracy volume of the best posture, {method}"),
    "worst_mm3": _Quantity("largest accuracy volume [mm³]", "accuracy volume of the worst posture, {method}"),
    "smallest_u_mm": _Quantity(f"smallest {U_NAME} [µm]", "standard uncertainty in the best posture", MM / UM),
    "largest_u_mm": _Quantity(f"largest {U_NAME} [µm]", "standard uncertainty in the worst posture", MM / UM),
    "flexibility": _Quantity("flexibility ζ [1]", "flexibility" + _OF_SECTORS, 1.0, FLEXIBILITY_COLOURS, (0.0, 1.0)),
    "arc_fraction": _Quantity("flexibility by arc [1]", "flexibility by arc", 1.0, FLEXIBILITY_COLOURS, (0.0, 1.0)),
    "working_sectors": _Quantity("working sectors [1]", "working sectors" + _OF_SECTORS, 1.0, FLEXIBILITY_COLOURS),
}
"""What a map can show, by the names of its data."""


def plot_map(map_: WorkspaceMap, quantity: str = "comprehensive_mm3", ax: Axes | None = None) -> Axes:
    """One quantity over the half-plane through joint axis 1; cells out of reach are grey.

    Args:
        map_: the map.
        quantity: one of :data:`QUANTITIES`, by its name in the map's data.
        ax: axes.

    Raises:
        UnknownNameError: no such quantity.
    """
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, list(QUANTITIES))
    how, attrs = QUANTITIES[quantity], map_.data.attrs
    norm = None if how.norm is None else Normalize(*how.norm)
    ax = _draw_map(map_, quantity, how.colours, how.label, ax, norm, how.scale)
    title = how.title.format(method=attrs["method"], sectors=map_.sectors)
    ax.set_title(f"{attrs['arm']}: {title}", fontsize=10)
    return ax


def plot_flexibility(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Flexibility ζ over the half-plane through joint axis 1; unreachable cells are grey."""
    return plot_map(map_, "flexibility", ax)


def plot_comprehensive(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Comprehensive accuracy (eq. 15 of Xu You et al. 2019) over the half-plane through joint axis 1."""
    return plot_map(map_, "comprehensive_mm3", ax)


def plot_uncertainty(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Smallest standard uncertainty of the position [µm] that a posture gives, over the half-plane through joint axis 1."""
    return plot_map(map_, "smallest_u_mm", ax)


def _draw_map(
    map_: WorkspaceMap,
    name: str,
    colours: str,
    label: str,
    ax: Axes | None,
    norm: Normalize | None,
    scale: float,
) -> Axes:
    ax = axes_of(ax, (5.4, 6.6))
    x, z = _edges(map_.data["x_mm"].values), _edges(map_.data["z_mm"].values)
    reachable = map_.data["reachable"].values.astype(bool)
    values = np.where(reachable, scale * map_.data[name].values, np.nan)
    image = ax.pcolormesh(x, z, np.ma.masked_invalid(values).T, cmap=colours, norm=norm)
    legend = []
    for mask, colour, text in (
        (~reachable, UNREACHABLE, "out of reach"),
        (reachable & np.isnan(values), OUTSIDE_LIMITS, "in reach, no sector within limits"),
    ):
        if mask.any():
            _fill(ax, x, z, mask, ListedColormap([colour]))
            legend.append(Patch(color=colour, label=text))
    ax.figure.colorbar(image, ax=ax, label=label)
    ax.set(xlabel="distance from joint axis 1, x [mm]", ylabel="z of the base [mm]", aspect="equal")
    if legend:
        ax.legend(handles=legend, loc="upper center", bbox_to_anchor=(0.5, -0.09), fontsize=8, frameon=False)
    return ax


def _fill(ax: Axes, x: Array, z: Array, mask: NDArray[np.bool_], colour: Colormap) -> None:
    ax.pcolormesh(x, z, np.ma.masked_array(np.zeros(mask.shape), ~mask).T, cmap=colour)


def _edges(centres: Array) -> Array:
    """Edges of equal cells from their centres [mm]; a single cell is drawn 1 mm wide."""
    step = (centres[-1] - centres[0]) / (len(centres) - 1) if len(centres) > 1 else 1.0
    return np.asarray(centres[0] + (np.arange(len(centres) + 1) - 0.5) * step)
