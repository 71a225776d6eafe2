"""Colours, and the axes to draw on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.gridspec import GridSpec, GridSpecFromSubplotSpec
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from aacmm_pin.errors import AacmmError

BLUE, VERMILLION, GREEN, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
VOLUME_COLOURS = "viridis"
VOLUME_NAME, U_NAME = "accuracy volume", "standard uncertainty u"
VOLUME_LABEL = f"{VOLUME_NAME} [mm³]"

Panels = NDArray[np.object_]
"""Axes of the panels of one picture, (n,)."""
Grid = GridSpec | GridSpecFromSubplotSpec


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """``ax``, or axes of a new pyplot figure of that size [inches]."""
    return ax if ax is not None else plt.figure(figsize=size, layout="constrained").add_subplot()


def axes_3d(ax: Axes3D | None) -> Axes3D:
    """The same in three dimensions."""
    if ax is None:
        return plt.figure(figsize=(7.2, 6.6), layout="constrained").add_subplot(projection="3d")
    if not isinstance(ax, Axes3D):
        raise AacmmError(f"ax is {type(ax).__name__}, expected three-dimensional axes: add_subplot(projection='3d')")
    return ax


def panels_of(
    ax: Axes | Panels | None, size: tuple[float, float], count: int, columns: int, *, share_y: bool = False
) -> Panels:
    """Axes of ``count`` panels side by side in so many columns, see :func:`placed`."""
    places: list[Any] = [divmod(k, columns) for k in range(count)]
    return placed(ax, size, (-(-count // columns), columns), places, share_y=share_y)


def placed(
    ax: Axes | Panels | None,
    size: tuple[float, float],
    shape: tuple[int, int],
    places: Sequence[Any],
    *,
    share_y: bool = False,
) -> Panels:
    """Axes for a picture of several panels.

    Args:
        ax: axes, whose place is divided among the panels (they are gone then); or an array of axes, one a panel or more;
            or None for a new pyplot figure.
        size: of that figure [inches].
        shape: rows and columns of the grid.
        places: of the panels in the grid: row and column, or slices of these.
        share_y: one scale for all panels.

    Raises:
        AacmmError: too few axes, or axes that have no place in a grid.
    """
    if ax is not None and not isinstance(ax, Axes):
        given = np.asarray(ax, dtype=object).ravel()
        if len(given) < len(places):
            raise AacmmError(f"ax holds {len(given)} axes, expected {len(places)}: one a panel")
        return given[: len(places)]
    whole = axes_of(ax, size)
    spec, figure = whole.get_subplotspec(), whole.figure
    if spec is None:
        raise AacmmError("ax has no place in a grid that could be divided; expected axes such as plt.subplots() gives")
    whole.remove()
    grid: Grid = spec.subgridspec(*shape)
    panels = np.empty(len(places), dtype=object)
    for k, place in enumerate(places):
        panels[k] = figure.add_subplot(grid[place], sharey=panels[0] if share_y and k else None)
        if share_y and grid[place].colspan.start > 0:
            panels[k].tick_params(labelleft=False)
    return panels


def round_down(value: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(f for f in (1.0, 2.0, 2.5, 5.0) if f * power <= value))
