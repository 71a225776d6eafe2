"""Residuals of a diagnosis by its three models: of all records, by groups, held out."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import BudgetPart, Diagnosis
from aacmm_pin.effects import listed, name_in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import length_unit, lengths
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    axes_of,
    draw_bars,
    figure_of,
    name_places,
    numbers_by_size,
    panels_of,
    plain,
)

MODELS = {"nominal": INK, "recalibrated": GREY, "extended": BLUE}
"""The three models with their colours."""
RANGE_UNITS = {"time": "s", "temperature": "°C", "joint": "°"}
"""Units of the ranges in which records are grouped."""


def part_in_words(result: Diagnosis, part: BudgetPart) -> str:
    """The causes and places of a part of the budget, or its name."""
    effects = filter(None, map(result.cause, part.causes))
    return listed([name_in_words(effect, result.model.arm) for effect in effects]) or part.part


@plain
def plot_error_budget(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """Plot the parts of the residual of the nominal arm, as RMS displacements of the tip."""
    parts = result.budget
    ax = axes_of(ax, (6.8, 0.9 + 0.32 * len(parts)))
    names = [part_in_words(result, part) for part in parts]
    colours = [BLUE if part.causes else GREY for part in parts]
    sizes = [part.rms for part in parts]
    unit, scale = length_unit(max(sizes))
    draw_bars(ax, names, [size / scale for size in sizes], lengths(sizes), colours)
    ax.set_xlabel(f"RMS displacement of the tip [{unit}]")
    ax.locator_params(axis="x", nbins=5)
    return ax


@plain
def plot_groups(result: Diagnosis, ax: Axes | None = None) -> Figure:
    """Plot the RMS residual in groups of records by every recorded quantity, joints first, for the
    three models, with predicted values, in the area of ``ax``.

    Raises:
        AacmmError: there are too few records for groups.
    """
    table = result.residual_groups
    kinds = sorted(
        table["by"].unique(), key=lambda kind: (not kind.startswith("joint"), numbers_by_size(kind))
    )
    if not kinds:
        raise AacmmError("the records are too few to compare groups; expected two groups or more")
    columns = min(3, len(kinds))
    panels = panels_of(ax, (3.1, 2.4), len(kinds), columns, share_y=True)
    expected = {"noise": (":", "noise alone")}
    if not table["predicted_mm"].equals(table["noise_mm"]):
        expected = {"predicted": ("--", "predicted for nominal")} | expected
    for panel, kind in zip(panels, kinds, strict=True):
        _draw_groups(panel, kind, table[table["by"] == kind], expected)
    heights = table[["predicted_mm", *(f"{name}_mm" for name in MODELS)]]
    panels[0].set_ylim(0, 1.06 * float(heights.max().max()))
    for panel in panels[::columns]:
        panel.set_ylabel("RMS residual [mm]")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[0].figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure_of(panels)


def _draw_groups(
    panel: Axes, kind: str, table: pd.DataFrame, expected: dict[str, tuple[str, str]]
) -> None:
    """Draw the groups of one kind, with lines of ``expected`` values (style, label)."""
    unit = RANGE_UNITS.get(kind.split()[0], "")
    if unit:  # by the start of the range
        starts = table["group"].str.split(" to ").str[0].astype(float)
        table = table.loc[starts.sort_values().index]
    else:
        table = table.sort_values("group", key=lambda groups: groups.map(numbers_by_size))
    edges = np.arange(len(table) + 1) - 0.5
    for name, (line, label) in expected.items():
        sizes = table[f"{name}_mm"]
        panel.stairs(sizes, edges, baseline=None, color=VERMILLION, lw=1.2, ls=line, label=label)
    for name, colour in MODELS.items():
        sizes = table[f"{name}_mm"]
        panel.plot(range(len(table)), sizes, "o-", color=colour, lw=1, ms=3, label=name)
    names = [group.removesuffix(unit).strip().replace(" to ", "\nto ") for group in table["group"]]
    name_places(panel, names, letters=48, size=7)
    panel.set_title(f"{kind} [{unit}]" if unit else kind, fontsize=9)
    panel.grid(axis="y", alpha=0.3)


def place_in_words(by: str, group: str) -> str:
    """``joint 6, 89 to 178°``, ``seat P3``."""
    between = ", " if by.split()[0] in RANGE_UNITS else " "
    return by + between + group


def held_out_parts(result: Diagnosis) -> pd.DataFrame:
    """The held-out parts: part, records, recalibrated_mm, extended_mm.

    Raises:
        AacmmError: nothing was held out.
    """
    held_out = result.held_out
    if held_out is None:
        raise AacmmError("no records were held out; expected a diagnosis with hold_out=True")
    predicted = np.isfinite(held_out.extended)
    numbers = np.unique(held_out.folds[predicted])
    names = {number: f"block {number + 1}" for number in numbers}
    if held_out.kind == "seats":
        seats = result.extended.problem.measurements.seats()
        for number in numbers:
            in_part = (held_out.folds == number) & predicted
            seats_in_part = [seat for seat, rows in seats.items() if in_part[rows].any()]
            names[number] = ", ".join(sorted(seats_in_part, key=numbers_by_size)) or names[number]
    squares = {
        "recalibrated_mm": held_out.recalibrated[predicted],
        "extended_mm": held_out.extended[predicted],
    }
    groups = (pd.DataFrame(squares) / MM).pow(2).groupby(held_out.folds[predicted])
    table = groups.mean().pow(0.5)
    table.insert(0, "records", groups.size())
    table.insert(0, "part", table.index.map(names))
    return table.sort_values(
        "part", key=lambda parts: parts.map(numbers_by_size), ignore_index=True
    )


@plain
def plot_held_out(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """Plot the RMS residual of each held-out group, for recalibrated and extended arm fitted
    without it.

    Raises:
        AacmmError: the diagnosis has no held-out records.
    """
    table, ax = held_out_parts(result), axes_of(ax, (7.0, 3.4))
    place = np.arange(len(table))
    for shift, name in ((-0.2, "recalibrated"), (0.2, "extended")):
        ax.bar(place + shift, table[f"{name}_mm"], 0.38, color=MODELS[name], label=name)
    # Else a part left out has the noise of its points too.
    if not result.extended.observations.labels:
        ax.axhline(result.noise / MM, color=VERMILLION, ls="--", lw=1.2, label="noise alone")
    blocks = table["part"].str.startswith("block ").all()
    name_places(ax, list(table["part"].str.removeprefix("block ")))
    ax.set_xlabel(f"held-out {'block of joint space' if blocks else 'seats'}")
    ax.set_ylabel("RMS residual [mm]")
    ax.margins(y=0.25)
    ax.legend(ncols=3, loc="upper left")
    return ax
