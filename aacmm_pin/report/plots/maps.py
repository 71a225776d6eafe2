"""Maps of the workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from aacmm_pin._support.units import MM, UM
from aacmm_pin.accuracy import Quantity, WorkspaceMap
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.postures import WRIST
from aacmm_pin.report.plots.style import U_NAME, VOLUME_COLOURS, axes_of, legend_below, plain

UNREACHABLE, OUTSIDE_LIMITS = "#d9d9d9", "#cc79a7"
FLEXIBILITY_COLOURS = "cividis"


@dataclass(frozen=True)
class _Quantity:
    """How a quantity of a map is drawn: its words with their unit, title, what of the data's unit
    makes one, colours.
    """

    label: str
    title: str
    scale: float = 1.0
    colours: str = VOLUME_COLOURS
    ends: tuple[float | None, float | None] = (None, None)


_OF_SECTORS = ", {sectors} sectors"
QUANTITIES: dict[Quantity, _Quantity] = {
    "comprehensive_mm3": _Quantity(
        "comprehensive accuracy volume [mm³]", "comprehensive accuracy volume, {method}"
    ),
    "best_mm3": _Quantity(
        "smallest accuracy volume [mm³]", "accuracy volume of the best posture, {method}"
    ),
    "worst_mm3": _Quantity(
        "largest accuracy volume [mm³]", "accuracy volume of the worst posture, {method}"
    ),
    "smallest_u_mm": _Quantity(
        f"smallest {U_NAME} [µm]", "standard uncertainty in the best posture", MM / UM
    ),
    "largest_u_mm": _Quantity(
        f"largest {U_NAME} [µm]", "standard uncertainty in the worst posture", MM / UM
    ),
    "flexibility": _Quantity(
        "flexibility ζ [1]", "flexibility" + _OF_SECTORS, 1.0, FLEXIBILITY_COLOURS, (0.0, 1.0)
    ),
    "arc_fraction": _Quantity(
        "flexibility by arc [1]", "flexibility by arc", 1.0, FLEXIBILITY_COLOURS, (0.0, 1.0)
    ),
    "working_sectors": _Quantity(
        "working sectors [1]", "working sectors" + _OF_SECTORS, 1.0, FLEXIBILITY_COLOURS
    ),
}
"""What a map can show, by the names of its data."""


@plain
def plot_map(
    map_: WorkspaceMap, quantity: Quantity = "comprehensive_mm3", ax: Axes | None = None
) -> Axes:
    """Plot one quantity over the half-plane through joint axis 1; cells out of reach are grey.

    Args:
        map_: the map.
        quantity: name in the data of the map, one of :data:`QUANTITIES`.
        ax: axes.

    Raises:
        UnknownNameError: the quantity is unknown.
    """
    if quantity not in QUANTITIES:
        raise UnknownNameError("quantity", quantity, list(QUANTITIES))
    how, data, ax = QUANTITIES[quantity], map_.data, axes_of(ax, (5.4, 6.6))
    x, z = map_.axes
    reachable = data["reachable"].values.astype(bool)
    values = np.where(reachable, how.scale * data[quantity].values, np.nan)
    low, high = how.ends
    image = ax.pcolormesh(x, z, values.T, shading="nearest", cmap=how.colours, vmin=low, vmax=high)
    ax.figure.colorbar(image, ax=ax, label=how.label)
    legend = []
    outside = reachable & np.isnan(values)
    marked = (
        (~reachable, UNREACHABLE, "out of reach"),
        (outside, OUTSIDE_LIMITS, "in reach, no posture within the joint limits"),
    )
    for cells, colour, text in marked:
        if cells.any():
            ax.pcolormesh(
                x,
                z,
                np.where(cells, 0.0, np.nan).T,
                shading="nearest",
                cmap=ListedColormap([colour]),
            )
            legend.append(Patch(color=colour, label=text))
    ax.set(xlabel=f"{x.long_name} [mm]", ylabel=f"{z.long_name} [mm]", aspect="equal")
    if legend:
        legend_below(ax, handles=legend)
    title = how.title.format(method=data.attrs["method"], sectors=map_.sectors)
    at = "wrist" if data.attrs["working_point"] == WRIST else "tip"
    ax.set_title(f"{data.attrs['arm']}, {at} in each cell:\n{title}", fontsize=10)
    return ax
