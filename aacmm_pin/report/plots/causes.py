"""The causes that a diagnosis found, drawn over what each depends on, and what stays without a
cause.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from pandas.api.types import is_numeric_dtype

from aacmm_pin._support.units import UM, count
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import Effect, corrects_seat, in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.groups import plot_rms
from aacmm_pin.report.plots.parameter_changes import plot_geometry
from aacmm_pin.report.plots.partial_residuals import (
    PartialResidual,
    is_constant,
    partial_residual,
    state_of,
)
from aacmm_pin.report.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILLION,
    aside,
    axes_of,
    draw_beyond,
    legend_below,
    name_places,
    numbers_by_size,
    plain,
)

FEWEST_COVARIATE_VALUES = 12
"""A covariate with no more values than this is shown value by value."""
SHOWN_QUANTILES = (0.01, 0.99)
"""Records between these quantiles fit into the figure; the others are marked at its edge.
"""
ROOM_BEYOND_CURVE = 0.8
"""As far beyond the curve, in heights of it, records are shown."""
FEWEST_IN_PART = 3
AXIS_COLOURS = dict(zip("xyz", (BLUE, VERMILLION, GREEN), strict=True))
COLUMN_UNITS = {"deg": "°", "c": "°C", "urad": "µrad", "um_per_m": "µm/m", "mm": "mm", "s": "s"}
"""Units by the endings of the names of columns."""


@plain
def plot_diagnosis(result: Diagnosis, finding: int = 0, ax: Axes | None = None) -> Axes:
    """Plot the strongest cause with the partial residuals of the records.

    Without causes, the plot shows the covariate of the residuals. Without a covariate, or if the
    cause displaces all records alike, the plot shows the residuals of the three models.

    Args:
        result: the diagnosis.
        finding: index of the finding, from 0 (the strongest cause).
        ax: axes.

    Raises:
        AacmmError: the diagnosis has no finding with this index.
    """
    if not result.findings and not finding:
        unexplained = [*result.unexplained.shapes]
        return plot_unexplained(result, unexplained[0], ax) if unexplained else plot_rms(result, ax)
    if not 0 <= finding < len(result.findings):
        raise AacmmError(
            f"finding is {finding}; expected a number from 0 below {len(result.findings)}, the "
            "number of findings"
        )
    found = result.findings[finding]
    over_something = corrects_seat(found.effect) or result.geometric(found)
    if not over_something and is_constant(found.effect, state_of(result.extended)):
        return plot_rms(result, ax)
    return plot_cause(result, found, ax)


@plain
def plot_cause(result: Diagnosis, finding: Finding, ax: Axes | None = None) -> Axes:
    """Plot the partial residuals of a cause over its covariate, with the fitted cause as a line.

    Faint dots are records (:func:`aacmm_pin.report.plots.partial_residuals.partial_residual`).
    Circles are weighted means in intervals of the covariate, with standard uncertainties. For an
    error of a seat, the plot shows the seat; for a geometric value, the plot shows the stated and
    the estimated value.

    Args:
        result: the diagnosis.
        finding: a finding of the diagnosis.
        ax: axes.
    """
    if corrects_seat(finding.effect):
        return _plot_seat_error(result, finding.effect, ax)
    if result.geometric(finding):
        return plot_geometry(result, ax)
    shown, ax = partial_residual(result, finding.effect), axes_of(ax, (6.4, 3.8))
    x, values = shown.x, np.unique(shown.x)
    if few := len(values) <= FEWEST_COVARIATE_VALUES:
        x = x + aside(len(x), 0.12 * float(np.ptp(values)))
        ax.set_xticks(values)
    means = _means(shown, few)
    ax.axhline(0.0, color=INK, lw=0.6)
    ax.plot(x, shown.value, ".", ms=3, color=GREY, alpha=0.5, label="records", zorder=1)
    gap = " (gap: no record near)" if np.isnan(shown.curve[1]).any() else ""
    ax.plot(*shown.curve, "-", color=BLUE, lw=2.0, label=f"fitted cause{gap}", zorder=2)
    style: dict[str, Any] = {
        "fmt": "o",
        "ms": 4,
        "color": VERMILLION,
        "lw": 1.2,
        "capsize": 2.5,
        "zorder": 3,
    }
    of = "" if few else f" of {FEWEST_IN_PART} or more records"
    ax.errorbar(means["x"], means["value"], means["u"], label=f"means{of} ± u", **style)
    draw_beyond(ax, [(x, shown.value, GREY)], _limits(shown, means))
    ax.set(xlabel=shown.x_label, ylabel=shown.y_label)
    legend_below(ax, columns=2)
    ax.set_title(
        f"{result.model.arm.name}: {in_words(finding.effect, result.model.arm)}", fontsize=10
    )
    return ax


def _means(shown: PartialResidual, few: bool) -> pd.DataFrame:
    """Weighted means of x and value in parts of the range, or at each x, and the standard
    uncertainty u of the latter.
    """
    if few:
        parts, least = shown.x, 1
    else:
        bins = int(np.clip(len(shown.x) // 8, 4, shown.bins))
        parts, least = np.asarray(pd.cut(shown.x, bins, labels=False), float), FEWEST_IN_PART
    weight = 1.0 / shown.u**2
    weighted = pd.DataFrame(
        {"weight": weight, "x": weight * shown.x, "value": weight * shown.value}
    )
    groups = weighted.groupby(parts)
    sums = groups.sum()[groups.size() >= least]
    means = sums[["x", "value"]].div(sums["weight"], axis=0)
    return means.assign(u=sums["weight"] ** -0.5)


def _limits(shown: PartialResidual, means: pd.DataFrame) -> tuple[float, float]:
    """Room for the curve and the means, and for nearly all records as far as that does not dwarf
    these.
    """
    value, u = means["value"], means["u"]
    inner = np.concatenate([shown.curve[1], value - u, value + u])
    low, high = float(np.nanmin(inner)), float(np.nanmax(inner))
    height = high - low
    room = ROOM_BEYOND_CURVE * height
    least, most = np.clip(np.quantile(shown.value, SHOWN_QUANTILES), low - room, high + room)
    margin = 0.05 * height or 1.0
    return min(low, least) - margin, max(high, most) + margin


def _plot_seat_error(result: Diagnosis, effect: Effect, ax: Axes | None = None) -> Axes:
    """Distance of each seat from its stated place, by the extended arm; the fitted error of one
    seat as a ring.

    Dots are weighted means over the records of a seat, with the standard uncertainty that the
    scatter of these gives; an error of the arm that is common to them is not in it. Seats without a
    stated place are counted.
    """
    fit, ax = result.extended, axes_of(ax, (6.8, 3.8))
    records, tips = fit.problem.measurements, fit.point.prediction.tips
    weight = UM**2 / np.diagonal(fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    effects = [*(finding.effect for finding in result.findings), effect]
    found = {each.place: np.array(each.values) for each in effects if corrects_seat(each)}
    seats = {
        name: own[fit.used[own]]
        for name, own in records.seats().items()
        if records.known[own].all()
    }
    names = sorted((name for name, own in seats.items() if own.size), key=numbers_by_size)
    total = np.array([weight[seats[name]].sum(axis=0) for name in names])
    off = weight * (tips - records.reference) / UM
    mean = np.array([off[seats[name]].sum(axis=0) for name in names]) / total
    error = np.array([found.get(name, np.full(3, np.nan)) for name in names]) / UM
    mean += np.nan_to_num(error)
    ax.axhline(0.0, color=INK, lw=0.6)
    for k, (axis, colour) in enumerate(AXIS_COLOURS.items()):
        x = np.arange(len(names)) + 0.22 * (k - 1)
        ax.errorbar(
            x, mean[:, k], total[:, k] ** -0.5, fmt="o", ms=4, capsize=2.5, color=colour, label=axis
        )
        ax.plot(x, error[:, k], "o", ms=9, mfc="none", color=colour)
    ax.plot([], [], "o", ms=9, mfc="none", color=INK, label="fitted error")
    name_places(ax, names)
    without = len(records.seats()) - len(names)
    missing = f" (not shown: {count(without, 'seat')} without coordinates)" if without else ""
    ax.set_xlabel(f"seat{missing}")
    ax.set_ylabel("true minus stated coordinates [µm]")
    legend_below(ax)
    ax.set_title(f"{result.model.arm.name}: {in_words(effect, result.model.arm)}", fontsize=10)
    return ax


@plain
def plot_unexplained(result: Diagnosis, name: str, ax: Axes | None = None) -> Axes:
    """Plot the structure without a cause over its covariates: the smooth correction and faint
    partial residuals.

    Over one covariate, the correction is a line, or one bar for each label. Over several
    covariates, a colour shows the size of the correction.

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
    columns = [str(column) for column in shape]
    quantities = [
        column.removesuffix("_of_record") for column in columns if column.endswith("_of_record")
    ]
    over = [column for column in columns if column.removesuffix("_of_record") not in quantities]
    label = _head(quantities[0]) if len(quantities) == 1 else "displacement of the tip [mm]"
    draw = _plot_over_two if len(over) > 1 else _plot_over_one
    draw(shape, over, quantities, label, ax)
    ax.set_title(
        f"{result.model.arm.name}, over {name}: {result.unexplained.acts_on[name]}", fontsize=10
    )
    return ax


def _plot_over_one(
    shape: pd.DataFrame, over: list[str], quantities: list[str], label: str, ax: Axes
) -> None:
    """Each quantity of the correction over one covariate."""
    numbers = is_numeric_dtype(shape[over[0]])
    codes, names = pd.factorize(shape[over[0]])
    x = (shape[over[0]] if numbers else pd.Series(codes)).to_numpy(dtype=float)
    step, spread = (0.0, 0.0) if numbers else (0.22, aside(len(x), 0.14))
    style: dict[str, Any] = (
        {"lw": 2} if numbers else {"ls": "", "marker": "_", "ms": 18, "mew": 2.5}
    )
    several, series = len(quantities) > 1, []
    ax.axhline(0.0, color=INK, lw=0.6)
    for k, (quantity, colour) in enumerate(zip(quantities, AXIS_COLOURS.values(), strict=False)):
        at = x + step * (k - (len(quantities) - 1) / 2)
        series.append((at + spread, shape[f"{quantity}_of_record"].to_numpy(), colour))
        ax.plot(*series[-1][:2], ".", ms=2.5, color=colour, alpha=0.3)
        ax.plot(at, shape[quantity], color=colour, label=quantity[0] if several else None, **style)
    if not numbers:
        name_places(ax, [str(name) for name in names])
    low, high = np.quantile(
        shape[[f"{quantity}_of_record" for quantity in quantities]], [0.005, 0.995]
    )
    room, curve = 0.15 * (high - low), shape[quantities].to_numpy()
    draw_beyond(ax, series, (min(low, curve.min()) - room, max(high, curve.max()) + room))
    ax.set(xlabel=_head(over[0]), ylabel=label)
    if ax.get_legend_handles_labels()[0]:
        legend_below(ax)


def _plot_over_two(
    shape: pd.DataFrame, over: list[str], quantities: list[str], label: str, ax: Axes
) -> None:
    """The size of the correction as colour over the first and the last covariate; records where it
    is largest on top.
    """
    if len(quantities) == 1:
        size = shape[quantities[0]]
        bound = float(np.abs(size).max())
        low, colours = -bound, "RdBu_r"
    else:
        size = np.sqrt(np.square(shape[quantities]).sum(axis=1))
        bound = float(size.max())
        low, colours = 0.0, "viridis"
    at = shape.assign(size=size).sort_values("size", key=np.abs)
    drawn = ax.scatter(
        at[over[0]], at[over[-1]], c=at["size"], s=14, vmin=low, vmax=bound, cmap=colours
    )
    ax.figure.colorbar(drawn, ax=ax, label=label)
    ax.set(xlabel=_head(over[0]), ylabel=_head(over[-1]))


def _head(column: str) -> str:
    """``theta3_deg`` as ``theta3 [°]``; a column without a known unit as it is."""
    for ending, unit in COLUMN_UNITS.items():
        if column.endswith(f"_{ending}"):
            return f"{column.removesuffix(f'_{ending}').replace('_', ' ')} [{unit}]"
    return column
