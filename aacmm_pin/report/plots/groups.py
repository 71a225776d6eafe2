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
    without_latex,
)

MODELS = {"nominal": INK, "recalibrated": GREY, "extended": BLUE}
"""The three models with their colours."""
PREDICTED_LINES = {
    "predicted_mm": ("--", "predicted for nominal"),
    "noise_mm": (":", "noise alone"),
}
"""Lines of expected values: style and name."""


def part_in_words(result: Diagnosis, part: BudgetPart) -> str:
    """The causes and places of a part of the budget, or its name."""
    effects = filter(None, map(result.cause, part.causes))
    return listed([name_in_words(effect, result.model.arm) for effect in effects]) or part.part


@without_latex()
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


@without_latex()
def plot_groups(result: Diagnosis, ax: Axes | None = None) -> Figure:
    """Plot the RMS residual in groups of records by every recorded quantity, joints first, for the
    three models, with predicted values, in the area of ``ax``.

    Raises:
        AacmmError: there are too few records for groups.
    """
    table = result.residual_groups.sort_index()
    kinds = table.groupby("by", sort=False)
    if not len(kinds):
        raise AacmmError("the records are too few to compare groups; expected two groups or more")
    columns = min(3, len(kinds))
    panels = panels_of(ax, (3.1, 2.4), len(kinds), columns, share_y=True)
    for panel, (kind, groups) in zip(panels, kinds, strict=True):
        places = range(len(groups))
        for name, (line, label) in PREDICTED_LINES.items():
            panel.step(places, groups[name], line, where="mid", color=VERMILLION, label=label)
        for name, colour in MODELS.items():
            sizes = groups[f"{name}_mm"]
            panel.plot(places, sizes, "o-", color=colour, lw=1, ms=3, label=name)
        names = [group.replace(" to ", "\nto ") for group in groups["group"]]
        name_places(panel, names, letters=48, size=7)
        panel.set_title(str(kind), fontsize=9)
        panel.grid(axis="y", alpha=0.3)
    panels[0].set_ylim(bottom=0.0)
    for panel in panels[::columns]:
        panel.set_ylabel("RMS residual [mm]")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[0].figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure_of(panels)


def held_out_parts(result: Diagnosis) -> pd.DataFrame:
    """The held-out parts: part, records, recalibrated_mm, extended_mm.

    Raises:
        AacmmError: nothing was held out.
    """
    held_out = result.held_out
    if held_out is None:
        raise AacmmError("no records were held out; expected a diagnosis with hold_out=True")
    conditions = result.extended.problem.measurements.conditions
    seats = conditions.labels("seat") if held_out.kind == "seats" else ""
    sizes = {"recalibrated_mm": held_out.recalibrated, "extended_mm": held_out.extended}
    squares = pd.DataFrame({name: np.square(size / MM) for name, size in sizes.items()})
    predicted = squares.assign(seat=seats)[np.isfinite(held_out.extended)]
    groups = predicted.groupby(held_out.folds[predicted.index])
    table = groups[[*sizes]].mean().pow(0.5)
    table.insert(0, "records", groups.size())
    names = []
    for fold in table.index.tolist():
        seats_of_fold = {*groups["seat"].get_group(fold)} - {""}
        names.append(", ".join(sorted(seats_of_fold, key=numbers_by_size)) or f"block {fold + 1}")
    table.insert(0, "part", names)
    return table.sort_values(
        "part", key=lambda parts: parts.map(numbers_by_size), ignore_index=True
    )


@without_latex()
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
