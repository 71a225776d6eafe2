"""Pictures of causes of a diagnosis over their covariates, and of structure without a cause."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from pandas.api.types import is_numeric_dtype

from aacmm_pin._support.arrays import Array
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.groups import plot_error_budget
from aacmm_pin.report.plots.partial_residuals import PartialResidual, partial_residual, varies
from aacmm_pin.report.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILLION,
    VOLUME_COLOURS,
    axes_of,
    legend_below,
    with_cut_off,
    without_latex,
)
from aacmm_pin.report.residual_tables import OF_RECORD

SHOWN_QUANTILES = (0.01, 0.99)
"""Quantiles of the records in the figure; the others may be cut off."""
ROOM_BEYOND_CURVE = 0.8
"""Room for records beyond the curve, in heights of the curve."""
FEWEST_IN_PART = 3
AXIS_COLOURS = (BLUE, VERMILLION, GREEN)
MOST_PARTS = 24
"""Intervals of a covariate for means, at most."""


@without_latex()
def plot_diagnosis(result: Diagnosis, finding: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the strongest cause; see :func:`plot_cause`.

    Without causes, the plot shows structure without a cause, and without structure the parts of the
    residual of the nominal arm. ``finding``: index from 0 (the strongest cause).

    Raises:
        AacmmError: the diagnosis has no finding with this index.
    """
    if not result.findings and not finding:
        for name in result.unexplained.shapes:
            return plot_unexplained(result, name, ax)
        return plot_error_budget(result, ax)
    if not 0 <= finding < len(result.findings):
        raise AacmmError(
            f"finding is {finding}; expected a number from 0 below {len(result.findings)}, the "
            "number of findings"
        )
    return plot_cause(result, result.findings[finding], ax)


@without_latex()
def plot_cause(result: Diagnosis, finding: Finding, ax: Axes | None = None) -> Axes:
    """Plot the partial residuals of a cause over its covariate, with the fitted cause as a line.

    Faint dots are records (:func:`aacmm_pin.report.plots.partial_residuals.partial_residual`);
    circles are weighted means in intervals of the covariate, with standard uncertainties. For a
    geometric value, an error of a seat, or another cause that displaces all records equally, it
    shows the parts of the residual of the nominal arm.
    """
    if not varies(result, finding):
        return plot_error_budget(result, ax)
    amounts, ax = partial_residual(result, finding.effect), axes_of(ax, (6.4, 3.8))
    parts = pd.cut(amounts.x, int(np.clip(len(amounts.x) // 8, 4, MOST_PARTS)), labels=False)
    means = _weighted_means(amounts, parts)
    label = f"means of {FEWEST_IN_PART} or more records ± u"
    ends = [means["value"] - means["u"], means["value"] + means["u"]]
    limits = _axis_limits(np.concatenate([amounts.fitted, *ends]), amounts.value)
    records = with_cut_off("records", amounts.value, limits)
    ax.axhline(0.0, color=INK, lw=0.6)
    ax.plot(amounts.x, amounts.value, ".", ms=3, color=GREY, alpha=0.5, label=records, zorder=1)
    curve = pd.Series(amounts.fitted, amounts.x).sort_index()
    ax.plot(curve, "-", color=BLUE, lw=2.0, label="fitted cause", zorder=2)
    bars: dict[str, Any] = {"fmt": "o", "ms": 4, "lw": 1.2, "capsize": 2.5, "zorder": 3}
    ax.errorbar(means["x"], means["value"], means["u"], color=VERMILLION, label=label, **bars)
    ax.set(xlabel=amounts.x_label, ylabel=amounts.y_label, ylim=limits)
    legend_below(ax, columns=3)
    ax.set_title(f"{result.model.arm.name}: {in_words(finding.effect, result.model.arm)}")
    return ax


def _weighted_means(amounts: PartialResidual, parts: Any) -> pd.DataFrame:
    """Weighted means of x and value in ``parts`` (n,), and u of the value."""
    weight = amounts.u**-2.0
    table = pd.DataFrame({"weight": weight, "x": weight * amounts.x})
    groups = table.assign(value=weight * amounts.value).groupby(parts)
    sums = groups.sum()[groups.size() >= FEWEST_IN_PART]
    return sums.div(sums["weight"], axis=0).assign(u=sums["weight"] ** -0.5)


def _axis_limits(curve: Array, records: Array) -> tuple[float, float]:
    """Ends of an axis for the curve, and for nearly all records if they do not dwarf the curve."""
    low, high = float(np.nanmin(curve)), float(np.nanmax(curve))
    room = ROOM_BEYOND_CURVE * (high - low)
    least, most = np.clip(np.quantile(records, SHOWN_QUANTILES), low - room, high + room)
    margin = 0.05 * (high - low) or 1.0
    return min(low, least) - margin, max(high, most) + margin


@without_latex()
def plot_unexplained(result: Diagnosis, name: str, ax: Axes | None = None) -> Axes:
    """Plot the structure without a cause over its covariates: smooth correction and faint partial
    residuals.

    Over one covariate, the correction is a line, or a bar for each label; over several, a colour
    shows its size.

    Raises:
        AacmmError: the diagnosis has no structure over this covariate.
    """
    shapes = result.unexplained.shapes
    if name not in shapes:
        raise AacmmError(
            f"no structure depends on {name!r}; expected one of "
            f"{', '.join(shapes) or '(nothing does)'}"
        )
    shape, ax = shapes[name], axes_of(ax, (6.8, 3.8))
    names = shape.columns.tolist()
    quantities = [name.removesuffix(OF_RECORD) for name in names if OF_RECORD in name]
    over = [name for name in names if name.removesuffix(OF_RECORD) not in quantities]
    label = quantities[0] if len(quantities) == 1 else "displacement of the tip [mm]"
    if len(over) > 1:
        size = np.linalg.norm(shape[quantities], axis=1)
        points = ax.scatter(shape[over[0]], shape[over[-1]], c=size, s=14, cmap=VOLUME_COLOURS)
        ax.figure.colorbar(points, ax=ax, label=label)
        ax.set(xlabel=over[0], ylabel=over[-1])
    else:
        _plot_over_one(shape, over[0], quantities, ax)
        ax.set(xlabel=over[0], ylabel=label)
    ax.set_title(f"{result.model.arm.name}, over {name}: {result.unexplained.acts_on[name]}")
    return ax


def _plot_over_one(shape: pd.DataFrame, over: str, quantities: list[str], ax: Axes) -> None:
    """Draw a correction over one covariate, or as marks at each label."""
    x: Any = shape[over]
    style: dict[str, Any] = {"lw": 2}
    if not is_numeric_dtype(x):
        style = {"ls": "", "marker": "_", "ms": 18, "mew": 2.5}
        ax.tick_params(axis="x", labelrotation=90)
    ax.axhline(0.0, color=INK, lw=0.6)
    for quantity, colour in zip(quantities, AXIS_COLOURS, strict=False):
        ax.plot(x, shape[quantity + OF_RECORD], ".", ms=2.5, color=colour, alpha=0.3)
        ax.plot(x, shape[quantity], color=colour, label=f"correction, {quantity}", **style)
    records = shape[[quantity + OF_RECORD for quantity in quantities]].to_numpy()
    limits = _axis_limits(shape[quantities].to_numpy(), records)
    ax.plot([], [], ".", color=GREY, label=with_cut_off("records", records, limits))
    ax.set_ylim(limits)
    legend_below(ax)
