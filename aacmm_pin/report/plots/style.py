"""Colours, the axes to draw on, and residuals as vectors."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Literal, cast, get_args

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM, UM
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import IN_MM

BLUE, VERMILLION, GREEN, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
VOLUME_COLOURS = "viridis"
VOLUME_NAME, U_NAME = "accuracy volume", "standard uncertainty u"
VOLUME_LABEL = f"{VOLUME_NAME} [mm³]"

Plane = Literal["xy", "xz", "yz"]
LONGEST = 0.08
"""How long nearly all residuals are drawn, as part of the picture."""


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


def panels_of(ax: Axes | None, size: tuple[float, float], count: int, columns: int, *, share_y: bool = False) -> list[Axes]:
    """Axes of ``count`` panels side by side in so many columns, see :func:`placed`."""
    places = [divmod(k, columns) for k in range(count)]
    return placed(ax, size, (-(-count // columns), columns), places, share_y=share_y)


def placed(
    ax: Axes | None, size: tuple[float, float], shape: tuple[int, int], places: Sequence[Any], *, share_y: bool = False
) -> list[Axes]:
    """Axes for a picture of several panels.

    Args:
        ax: axes, whose place is divided among the panels (they are gone then); or None for a new pyplot figure.
        size: of that figure [inches].
        shape: rows and columns of the grid.
        places: of the panels in the grid: row and column, or slices of these.
        share_y: one scale for all panels.

    Raises:
        AacmmError: axes that have no place in a grid.
    """
    whole = axes_of(ax, size)
    spec, figure = whole.get_subplotspec(), whole.figure
    if spec is None:
        raise AacmmError("ax has no place in a grid that could be divided; expected axes such as plt.subplots() gives")
    whole.remove()
    grid: Any = spec.subgridspec(*shape)
    panels: list[Axes] = []
    for place in places:
        panels.append(figure.add_subplot(grid[place], sharey=panels[0] if share_y and panels else None))
        if share_y and grid[place].colspan.start > 0:
            panels[-1].tick_params(labelleft=False)
    return panels


def whole(panels: Sequence[Axes]) -> Figure:
    """The figure of several panels, which the functions that draw them return."""
    return cast(Figure, panels[0].figure)


def plane_axes(plane: str) -> list[int]:
    """Numbers of the two axes of a plane.

    Raises:
        AacmmError: no such plane.
    """
    if plane not in get_args(Plane):
        raise AacmmError(f"plane is {plane!r}, expected 'xy', 'xz' or 'yz'")
    return ["xyz".index(name) for name in plane]


def magnification(target: Array, deviation: Array) -> float:
    """With which residuals (n, 3) are nearly all shorter than a fixed part of the picture of their targets (n, 3) [m]."""
    size = float(np.ptp(target, axis=0).max()) or 1.0
    return round_down(LONGEST * size / (float(np.quantile(np.linalg.norm(deviation, axis=1), 0.95)) or 1e-12))


def draw_vectors(ax: Axes, target: Array, deviation: Array, plane: str, factor: float) -> None:
    """Residuals (n, 3) [m] as lines from their targets, with dots at their ends, magnified; with a bar of known length."""
    axes = plane_axes(plane)
    start, off = target[:, axes] / MM, deviation[:, axes] / MM
    ends = start + factor * off
    ax.add_collection(
        LineCollection(list(np.stack([start, ends], axis=1)), colors=BLUE, linewidths=0.9, alpha=0.75, zorder=2)
    )
    ax.plot(*ends.T, ".", ms=2.3, color=BLUE, zorder=2)
    low, size = start.min(axis=0), float(np.ptp(start, axis=0).max()) or 1.0
    bar = round_down(0.12 * size / factor)
    x, y = low[0], low[1] - 0.11 * size
    ax.plot([x, x + factor * bar], [y, y], "|-", color=INK, lw=1.2, ms=7)
    text = f"{bar:g} mm" if bar >= IN_MM / MM else f"{bar * MM / UM:g} µm"
    ax.annotate(text, (x + factor * bar, y), (5, 0), textcoords="offset points", va="center", fontsize=8, color=INK)
    ax.set(xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]", aspect="equal")
    ax.margins(0.08)


def numbers_by_size(label: str) -> list[tuple[int, str]]:
    """S2 before S10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", label)]


def round_down(value: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(f for f in (1.0, 2.0, 2.5, 5.0) if f * power <= value))
