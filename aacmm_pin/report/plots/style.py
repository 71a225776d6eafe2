"""Style of all pictures: colours, text, axes, labels, bars, legends."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.errors import AacmmError

BLUE, VERMILLION, GREEN, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
VOLUME_COLOURS = "viridis"
U_NAME, VOLUME_LABEL = "standard uncertainty u", "accuracy volume [mm³]"
STYLE: dict[str, Any] = {
    "text.usetex": False,
    "text.parse_math": False,
    "axes.titlesize": 10,
    "legend.fontsize": 8,
    "legend.title_fontsize": 8,
    "legend.frameon": False,
}
"""Settings of matplotlib."""
LONGEST_AT_ROW, LONGEST_AT_PLACE = 48, 24
"""Most characters of a name beside a row, and of one below the axes, which may stand upright."""


@contextmanager
def without_latex() -> Iterator[None]:
    """Use the style, and plain text: LaTeX may be missing, and names are no commands or formulas.

    The end restores only these settings: a backend may set others at the first figure.
    """
    settings: Any = plt.rcParams
    former_settings = {name: settings[name] for name in STYLE}
    settings.update(STYLE)
    try:
        yield
    finally:
        settings.update(former_settings)


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """``ax``, or axes of a new pyplot figure of that size [inches]."""
    return ax if ax is not None else plt.figure(figsize=size, layout="constrained").add_subplot()


def panels_of(
    ax: Axes | None,
    panel_size: tuple[float, float],
    count: int,
    columns: int,
    *,
    share_y: bool = False,
) -> list[Axes]:
    """Axes of ``count`` panels, row by row.

    Args:
        ax: axes whose area the panels take; None for a new pyplot figure.
        panel_size: width and height of a panel of a new figure [inches].

    Raises:
        AacmmError: the axes have no place in a grid.
    """
    rows = -(-count // columns)
    width, height = panel_size
    area = axes_of(ax, (width * columns, height * rows))
    spec = area.get_subplotspec()
    if spec is None:
        raise AacmmError("ax is not in a grid; expected axes of plt.subplots()")
    area.remove()
    grid = spec.subgridspec(rows, columns).subplots(sharey=share_y, squeeze=False)
    panels = list(grid.flat)
    for empty_panel in panels[count:]:
        empty_panel.remove()
    return panels[:count]


def figure_of(panels: Sequence[Axes]) -> Figure:
    """The figure that contains the panels."""
    return cast(Figure, panels[0].figure)


def legend_below(ax: Axes, columns: int = 4, **more: Any) -> None:
    """The legend in rows below the axes and their label."""
    ax.legend(
        loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=5.0, ncols=columns, **more
    )


def draw_bars(
    ax: Axes, names: Sequence[str], sizes: Iterable[float], labels: Sequence[str], colours: Any
) -> None:
    """Horizontal bars, the first on top, with names and labels."""
    bars = ax.barh(range(len(names)), [*sizes], color=colours, height=0.65)
    ax.bar_label(bars, labels, padding=4, fontsize=8)
    ax.margins(x=0.28)
    name_rows(ax, names)


def name_rows(ax: Axes, names: Sequence[str], size: float = 9.0) -> None:
    """Names of the rows 0, 1, 2, …, the first on top."""
    ax.set_yticks(range(len(names)), shortened(names, LONGEST_AT_ROW), fontsize=size)
    ax.invert_yaxis()


def name_places(ax: Axes, names: Sequence[str], letters: int = 80, size: float = 8.0) -> None:
    """Names of the places 0, 1, 2, …; upright if longer than ``letters``, only some if three times
    as long.
    """
    names = shortened(names, LONGEST_AT_PLACE)
    width = sum(2 + max(map(len, name.split("\n"))) for name in names)
    named = slice(None, None, -(-3 * len(names) // letters))
    rotation = 90 if width > letters else 0
    ax.set_xticks(range(len(names))[named], names[named], fontsize=size, rotation=rotation)


def shortened(names: Iterable[str], most: int) -> list[str]:
    """The names, with an ellipsis in the middle of those of more than ``most`` characters."""
    half = most // 2
    return [f"{name[:half]}…{name[-half:]}" if len(name) > most else name for name in names]


def with_cut_off(name: str, values: Array, limits: tuple[float, float]) -> str:
    """Name of a series for the legend, with the number of ``values`` beyond the ``limits`` of y."""
    low, high = limits
    beyond = int(((values < low) | (values > high)).sum())
    return f"{name} ({beyond} beyond the scale)" if beyond else name


def shifts_aside(count: int, width: float) -> Array:
    """Shifts within ``width`` that separate records of one place (count,)."""
    part = np.arange(count) * 0.618 % 1.0
    return np.asarray(width * (part - 0.5))


def numbers_by_size(label: str) -> list[tuple[int, str]]:
    """A key that sorts S2 before S10."""
    parts = re.split(r"(\d+)", label)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def round_down(value: float) -> float:
    """The largest of 1, 2, 2.5, 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = power * np.array([1.0, 2.0, 2.5, 5.0])
    return float(steps[steps <= value].max())


def evenly_selected(members: Index, most: int) -> Index:
    """At most so many of the members, evenly selected."""
    return members[:: max(1, -(-len(members) // most))]
