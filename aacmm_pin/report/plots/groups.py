"""Residuals of a diagnosis by groups: where the simulation is off, and the gain on groups that were left out."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.diagnosis.residual_tables import groups_table
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, axes_of, numbers_by_size, panels_of, whole

MODELS = {"simulation": INK, "recalibrated": GREY, "extended": BLUE}
"""The three models with their colours."""
WIDE = 40
"""Names of more letters than this do not fit side by side below one panel."""
_RANGE = re.compile(r"(-?[\d.]+(?:e[-+]?\d+)?) to (-?[\d.]+(?:e[-+]?\d+)?)(.*)")


def residuals_by_group(result: Diagnosis) -> pd.DataFrame:
    """RMS of the records by seat, joint range, time, temperature, …, by the three models, beside what is predicted.

    Predicted for the simulation: by the arm's stated uncertainties and the noise, ``S U Sᵀ + C`` (GUM, eq. 13); for the
    others the noise ``C`` alone.

    Returns:
        by, group, records, simulation_mm, predicted_mm, times_predicted, recalibrated_mm, extended_mm, noise_mm,
        times_noise (extended), in the order of the file; groups of fewer than two records are left out.
    """
    before, extended = result.before, result.extended
    model, records = before.problem.model, before.problem.measurements
    # Scatter that was found is what this asks about; it is noise only where nobody stated any.
    noise = extended.stated_noise
    turned = before.solution.point.frame.rotation @ model.sensitivity(records.q, records.conditions)
    spread = turned @ model.covariance() @ turned.transpose(0, 2, 1)
    tables = {
        "simulation": groups_table(before, noise + spread),
        "recalibrated": groups_table(result.recalibrated, noise),
        "extended": groups_table(extended, noise),
    }
    keys = ["by", "group"]
    merged = tables["simulation"].rename(columns={"rms_mm": "simulation_mm"})
    for name in ("recalibrated", "extended"):
        mine = tables[name].drop(columns="records").rename(columns={"rms_mm": f"{name}_mm"})
        mine = mine.rename(columns={"predicted_mm": "noise_mm", "times_predicted": "times_noise"})
        merged = merged.merge(mine if name == "extended" else mine[[*keys, f"{name}_mm"]], on=keys)
    return merged


def plot_groups(result: Diagnosis, ax: Axes | None = None) -> Figure:
    """RMS of the residuals in parts of all that is known of the records, by the three models, beside what is predicted.

    Args:
        result: the diagnosis.
        ax: axes whose place is divided.

    Returns:
        the figure of the panels, joints first.

    Raises:
        AacmmError: there are too few records to compare groups of them.
    """
    table = residuals_by_group(result)
    kinds = sorted(table["by"].unique(), key=lambda kind: (not kind.startswith("joint"), numbers_by_size(kind)))
    if not kinds:
        raise AacmmError("there are too few records to compare groups of them")
    columns = min(3, len(kinds))
    rows = -(-len(kinds) // columns)
    panels = panels_of(ax, (3.1 * columns, 2.2 * rows + 0.5), len(kinds), columns, share_y=True)
    for panel, kind in zip(panels, kinds, strict=True):
        mine = table[table["by"] == kind]
        mine = mine.iloc[sorted(range(len(mine)), key=lambda k: _in_order(mine["group"].iloc[k]))]
        place = np.arange(len(mine))
        panel.step(*_stairs(mine["predicted_mm"].to_numpy()), color=VERMILLION, lw=1.2, ls="--", label="predicted for it")
        panel.step(*_stairs(mine["noise_mm"].to_numpy()), color=VERMILLION, lw=1.2, ls=":", label="noise alone")
        for name, colour in MODELS.items():
            label = "as simulated" if name == "simulation" else name
            panel.plot(place, mine[f"{name}_mm"], "o-", ms=4, lw=1, color=colour, label=label)
        named = [_short(group) for group in mine["group"]]
        names = [name.replace(" to ", "\nto ") for name, _ in named]
        upright = len(mine) > 8 or sum(max(map(len, name.split("\n"))) for name in names) > WIDE
        panel.set_xticks(place, names, fontsize=7, rotation=90 if upright else 0)
        unit = named[0][1]
        panel.set_title(f"{kind} [{unit}]" if unit else kind, fontsize=9)
        panel.grid(axis="y", alpha=0.3)
    top = 1.06 * float(table[["predicted_mm", *(f"{name}_mm" for name in MODELS)]].max().max())
    for panel in panels:
        panel.set_ylim(0, top)
    for panel in panels[::columns]:
        panel.set_ylabel("RMS [mm]")
    handles, labels = panels[0].get_legend_handles_labels()
    panels[0].figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    return whole(panels)


def _ends(group: str) -> tuple[float, float, str] | None:
    """``1.5 to 90.9°`` as its ends and unit; None for a label."""
    match = _RANGE.fullmatch(group)
    return None if match is None else (float(match[1]), float(match[2]), match[3].strip())


def _in_order(group: str) -> tuple[float, list[tuple[int, str]]]:
    ends = _ends(group)
    return (0.0, numbers_by_size(group)) if ends is None else (ends[0], [])


def _short(group: str) -> tuple[str, str]:
    """A group, its ends with the same number of decimals: three digits of the larger and enough to differ; and its unit."""
    ends = _ends(group)
    if ends is None:
        return group, ""
    low, high, unit = ends
    largest, width = max(abs(low), abs(high)), abs(high - low)
    digits = [most - int(np.floor(np.log10(size))) for most, size in ((2, largest), (1, width)) if size > 0.0]
    decimals = max([0, *digits])
    while decimals and all(round(end, decimals) == round(end, decimals - 1) for end in (low, high)):
        decimals -= 1
    return f"{low:z.{decimals}f} to {high:z.{decimals}f}", unit


def place_in_words(by: str, group: str) -> str:
    """``joint 6, 89.2 to 178°``, ``seat P3``."""
    short, unit = _short(group)
    return f"{by}, {short}{'' if unit == '°' else ' '}{unit}" if unit else f"{by} {short}"


def _stairs(values: Array) -> tuple[Array, Array]:
    """A step as wide as its place for each value."""
    return np.asarray(np.repeat(np.arange(len(values) + 1.0), 2)[1:-1] - 0.5), np.repeat(values, 2)


def held_out_parts(result: Diagnosis) -> pd.DataFrame:
    """The parts left out in turn: part, records, RMS recalibrated and extended [mm], gain, what was chosen without it.

    Raises:
        AacmmError: nothing was held out.
    """
    held = result.held_out
    if held is None:
        raise AacmmError("nothing was held out, so there is nothing to show by parts")
    seats = result.extended.problem.measurements.seats() if held.kind == "seats" else {}
    rows = []
    numbers = [number for number in np.unique(held.part) if np.isfinite(held.extended[held.part == number]).any()]
    for place, number in enumerate(numbers):
        mine = (held.part == number) & np.isfinite(held.extended)
        names = sorted((s for s, records in seats.items() if mine[records].any()), key=numbers_by_size)
        sizes = [float(np.sqrt(np.mean(values[mine] ** 2))) for values in (held.recalibrated, held.extended)]
        row = {"part": ", ".join(names) or f"block {number + 1}", "records": int(mine.sum())}
        row |= {"recalibrated_mm": sizes[0] / MM, "extended_mm": sizes[1] / MM, "gain": 1 - sizes[1] / sizes[0]}
        rows.append(row | {"chosen": held.chosen[place] if len(held.chosen) == len(numbers) else ()})
    table = pd.DataFrame(rows)
    return table.iloc[sorted(range(len(table)), key=lambda k: numbers_by_size(table["part"].iloc[k]))].reset_index(drop=True)


def plot_held_out(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """RMS of each part that was left out in turn, by the arm recalibrated and extended without it.

    Raises:
        AacmmError: nothing was held out.
    """
    table, ax = held_out_parts(result), axes_of(ax, (7.0, 3.4))
    place = np.arange(len(table))
    for k, name in enumerate(("recalibrated", "extended")):
        ax.bar(place + 0.4 * k - 0.2, table[f"{name}_mm"], 0.38, color=MODELS[name], label=name)
    if not result.extended.observations.labels:  # else a part left out has the noise of its points too
        ax.axhline(result.noise / MM, color=VERMILLION, ls="--", lw=1.2, label="noise alone")
    names = [part.removeprefix("block ") for part in table["part"]]
    long = max(map(len, names), default=0) * len(names) > 70
    ax.set_xticks(place, names, fontsize=8, rotation=90 if long else 0)
    what = "seats" if any(table["part"] != [f"block {n}" for n in names]) else "block of joint space"
    ax.set(xlabel=f"{what} left out", ylabel="RMS distance [mm]")
    ax.set_ylim(top=1.25 * float(table[["recalibrated_mm", "extended_mm"]].max().max()))
    ax.legend(fontsize=8, frameon=False, ncols=3, loc="upper left")
    return ax
