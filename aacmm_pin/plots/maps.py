"""Maps of the workspace."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.patches import Patch
from numpy.typing import NDArray

from aacmm_pin.checks import Array
from aacmm_pin.plots.style import U_NAME, VOLUME_COLOURS, axes_of
from aacmm_pin.units import MM, UM
from aacmm_pin.workspace import WorkspaceMap

UNREACHABLE, OUTSIDE_LIMITS = "#d9d9d9", "#cc79a7"
FLEXIBILITY_COLOURS = "cividis"


def plot_flexibility(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Flexibility ζ over the half-plane through joint axis 1; unreachable cells are grey."""
    ax = _draw_map(map_, "flexibility", FLEXIBILITY_COLOURS, "flexibility ζ [1]", ax, Normalize(0.0, 1.0))
    ax.set_title(f"{map_.data.attrs['arm']}: flexibility, {map_.sectors} sectors", fontsize=10)
    return ax


def plot_comprehensive(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Comprehensive accuracy (eq. 15 of Xu You et al. 2019) over the half-plane through joint axis 1."""
    ax = _draw_map(map_, "comprehensive_mm3", VOLUME_COLOURS, "comprehensive accuracy volume [mm³]", ax, None)
    ax.set_title(f"{map_.data.attrs['arm']}: comprehensive accuracy, {map_.data.attrs['method']}", fontsize=10)
    return ax


def plot_uncertainty(map_: WorkspaceMap, ax: Axes | None = None) -> Axes:
    """Smallest standard uncertainty of the position [µm] that a posture gives, over the half-plane through joint axis 1."""
    label = f"smallest {U_NAME} [µm]"
    ax = _draw_map(map_, "smallest_u_mm", VOLUME_COLOURS, label, ax, None, scale=MM / UM)
    ax.set_title(f"{map_.data.attrs['arm']}: standard uncertainty in the best posture", fontsize=10)
    return ax


def _draw_map(
    map_: WorkspaceMap,
    name: str,
    colours: str,
    label: str,
    ax: Axes | None,
    norm: Normalize | None,
    scale: float = 1.0,
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
