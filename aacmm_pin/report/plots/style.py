"""Colours, axes to draw on, names below places, and orders of names and of magnitude."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FuncFormatter

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.text_escaping import printable
from aacmm_pin.errors import AacmmError

BLUE, VERMILLION, GREEN, GREY, INK = "#0072b2", "#d55e00", "#009e73", "#9a9a9a", "#262626"
"""Colours that stay apart for colour-blind readers (Okabe and Ito)."""
VOLUME_COLOURS = "viridis"
VOLUME_NAME, U_NAME = "accuracy volume", "standard uncertainty u"
VOLUME_LABEL = f"{VOLUME_NAME} [mm³]"


P = ParamSpec("P")
Drawn = TypeVar("Drawn", Axes, Figure)
OF_NAMES = (FixedFormatter, FuncFormatter)
LONGEST_NAME, LONGEST_LINE = 48, 96
"""Characters of a name at a tick or in a legend, and of a line of a title, lest they leave the axes
no place.
"""
EDGE = 0.03
"""How far from the edge of the scale a mark for a value beyond it stands, in heights of the scale.
"""
LONGEST_UPRIGHT = 24
"""Characters of a name that stands upright."""


def plain(draw: Callable[P, Drawn]) -> Callable[P, Drawn]:
    """The function that draws, with names in its picture as they are, but for their length.

    Matplotlib takes text between $ for formulas, and leaves axes no place beside long names.
    """

    @wraps(draw)
    def drawn(*args: P.args, **named: P.kwargs) -> Drawn:
        latex = plt.rcParams["text.usetex"]
        with without_latex():
            picture = draw(*args, **named)
            place: Any = picture
            panels = place.axes if isinstance(place, Figure) else [place]
            _write_names(picture, [axis for panel in panels for axis in (panel.xaxis, panel.yaxis)])
            if latex:  # ticks are made where they are drawn first
                place.figure.canvas.figure.draw_without_rendering()
        return picture

    return drawn


def _write_names(picture: Any, axes: Sequence[Axis]) -> None:
    """All text of a picture as it stands there, shortened; but numbers at the ``axes`` stay
    formulas.
    """
    numbers, in_legends = set[Text](), set[Text]()
    for axis in axes:
        names = axis.get_major_formatter()
        if isinstance(names, OF_NAMES):
            axis.set_major_formatter(_short_names(names))
        else:
            numbers.update(_tick_labels(axis))
    for legend in picture.findobj(Legend):
        in_legends.update(legend.get_texts())
    for text in picture.findobj(Text):
        text.set_usetex(False)
        if text not in numbers:
            most = LONGEST_NAME if text in in_legends else LONGEST_LINE
            text.set_parse_math(False)
            text.set_text(short(printable(text.get_text()), most))


def _tick_labels(axis: Axis) -> Iterator[Text]:
    for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
        yield tick.label1
        yield tick.label2


@contextmanager
def without_latex() -> Iterator[None]:
    """While matplotlib alone draws text, whatever its settings: LaTeX may not be there, or take
    names for commands.

    Only this setting is put back: a backend that the first figure loads, such as Jupyter's, makes
    settings of its own.
    """
    latex = plt.rcParams["text.usetex"]
    plt.rcParams["text.usetex"] = False
    try:
        yield
    finally:
        plt.rcParams["text.usetex"] = latex


def short(text: str, most: int) -> str:
    """The text with lines of at most so many characters, the middle of longer ones left out."""
    return "\n".join(_short_line(line, most) for line in text.split("\n"))


def _short_line(line: str, most: int) -> str:
    if len(line) <= most:
        return line
    half = most // 2
    return f"{line[:half]}…{line[half + 1 - most :]}"


def _short_names(names: Callable[..., str]) -> Callable[[float, float], str]:
    def short_name(value: float, place: float) -> str:
        return short(names(value, place), LONGEST_NAME)

    return short_name


def axes_of(ax: Axes | None, size: tuple[float, float]) -> Axes:
    """``ax``, or axes of a new pyplot figure of that size [inches]."""
    return ax if ax is not None else plt.figure(figsize=size, layout="constrained").add_subplot()


def panels_of(
    ax: Axes | None, each: tuple[float, float], count: int, columns: int, *, share_y: bool = False
) -> list[Axes]:
    """Axes of ``count`` panels, row by row.

    Args:
        ax: axes, whose place is divided among the panels (they are gone then); or None for a new
            pyplot figure.
        each: width and height of a panel of that figure [inches].
        count: number of panels.
        columns: panels side by side.
        share_y: one scale for all panels.

    Raises:
        AacmmError: axes that have no place in a grid.
    """
    rows = -(-count // columns)
    width, height = each
    place = axes_of(ax, (width * columns, height * rows))
    spec = place.get_subplotspec()
    if spec is None:
        raise AacmmError("ax is not in a grid; expected axes of plt.subplots()")
    place.remove()
    grid = spec.subgridspec(rows, columns).subplots(sharey=share_y, squeeze=False)
    panels = list(grid.flat)
    for left_over in panels[count:]:
        left_over.remove()
    return panels[:count]


def whole(panels: Sequence[Axes]) -> Figure:
    """The figure of several panels, which the functions that draw them return."""
    return cast(Figure, panels[0].figure)


def legend_below(ax: Axes, columns: int = 4, **more: Any) -> None:
    """The legend in rows below the axes and their label."""
    place: dict[str, Any] = {
        "loc": "upper center",
        "bbox_to_anchor": (0.5, 0.0),
        "borderaxespad": 5.0,
    }
    ax.legend(fontsize=8, frameon=False, ncols=columns, **place, **more)


def draw_beyond(
    ax: Axes, series: Iterable[tuple[Array, Array, str]], limits: tuple[float, float]
) -> None:
    """Sets the limits of y; triangles at their edge stand for the values beyond, and the legend
    counts these.

    Args:
        ax: axes.
        series: x (n,), y (n,) and the colour of each series of values.
        limits: of y.
    """
    low, high = limits
    edge, number = EDGE * (high - low), 0
    for x, y, colour in series:
        for off, at, marker in ((y < low, low + edge, "v"), (y > high, high - edge, "^")):
            ax.plot(x[off], np.full(off.sum(), at), marker, ms=5, color=colour)
            number += int(off.sum())
    if number:
        ax.plot([], [], "^", ms=5, color=INK, label=f"{number} beyond the scale, at its edge")
    ax.set_ylim(low, high)


def name_places(ax: Axes, names: Sequence[str], letters: int = 80, size: float = 8.0) -> None:
    """Names below the places 0, 1, 2, …, where so many ``letters`` stand side by side, or a third
    as many names upright.
    """
    names = [printable(name) for name in names]
    widths = [2 + max(map(len, name.split("\n"))) for name in names]
    rotation = 0
    if sum(widths) > letters:
        rotation = 90
        names = [short(name, LONGEST_UPRIGHT) for name in names]
    step = -(-3 * len(names) // letters)
    places = range(len(names))
    ax.set_xticks(places[::step], names[::step], fontsize=size, rotation=rotation)


def aside(count: int, width: float) -> Array:
    """Shifts within ``width`` that set records of one place side by side, so that they do not hide
    each other (count,).
    """
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


def some_of(members: Index, most: int) -> Index:
    """At most so many of the members, every so-manieth."""
    return members[:: max(1, -(-len(members) // most))]
