"""The causes that a diagnosis found, drawn over what each depends on, and what stays without a cause."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from pandas.api.types import is_numeric_dtype

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import UM
from aacmm_pin.calibration.parameter_vector import geometric_parameters
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import Effect
from aacmm_pin.effects.labels import in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.partial_residuals import PartialResidual, partial_residual
from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, INK, VERMILLION, axes_of, numbers_by_size

FEW = 12
"""A covariate with no more values than this is shown value by value."""
SHOWN = 0.98
"""Part of the records that fits into the picture; the others, which say least, are counted."""
ROOM = 0.8
"""As far beyond the curve, in heights of it, records are shown."""
LEAST_IN_BIN = 3
AXES = dict(zip("xyz", (BLUE, VERMILLION, GREEN), strict=True))


def geometric(result: Diagnosis, finding: Finding) -> bool:
    """Whether a finding is a value of the arm's own geometry."""
    return bool(geometric_parameters(result.extended.problem.model.arm, finding.effect))


def plot_cause(result: Diagnosis, finding: Finding, ax: Axes | None = None) -> Axes:
    """What the records say of a cause, everything else as fitted, over what it depends on; the fitted cause through it.

    Faint dots are records, :func:`aacmm_pin.report.plots.partial_residuals.partial_residual`; circles are their weighted
    means in parts of the range, with standard uncertainties. An error of a seat is shown seat by seat, a geometric value
    beside what was stated of it.

    Args:
        result: the diagnosis.
        finding: one of its findings.
        ax: axes.
    """
    if finding.effect.corrects_seat:
        return plot_seat_error(result, finding.effect, ax)
    if geometric(result, finding):
        return plot_geometry(result, ax)
    shown, ax = partial_residual(result, finding.effect), axes_of(ax, (6.4, 3.8))
    x = shown.x
    values = np.unique(x)
    few = len(values) <= FEW
    if few:  # side by side, so that records do not hide each other
        x = x + 0.06 * float(np.ptp(values)) * np.linspace(-1, 1, len(x))
    ax.axhline(0.0, color=INK, lw=0.6)
    ax.plot(x, shown.value, ".", ms=3, color=GREY, alpha=0.5, label="records", zorder=1)
    ax.plot(*shown.curve, "-", color=BLUE, lw=2.0, label="fitted cause", zorder=2)
    middle, mean, u = _means(shown, few)
    ax.errorbar(middle, mean, u, fmt="o", ms=4, color=VERMILLION, lw=1.2, capsize=2.5, label="means ± u", zorder=3)
    low, high = _limits(shown, mean, u)
    ax.set_ylim(low, high)
    beyond = int(((shown.value < low) | (shown.value > high)).sum())
    ax.set(xlabel=shown.x_label, ylabel=shown.y_label)
    if few:
        ax.set_xticks(values)
    _legend(ax, f"off the scale: {beyond}" if beyond else "")
    ax.set_title(f"{result.model.arm.name}: {in_words(finding.effect)}", fontsize=10)
    return ax


def _limits(shown: PartialResidual, mean: Array, u: Array) -> tuple[float, float]:
    """Room for the curve and the means, and for nearly all records as far as that does not dwarf these."""
    inner = np.array([np.nanmin([*shown.curve[1], *(mean - u)]), np.nanmax([*shown.curve[1], *(mean + u)])])
    outer = np.quantile(shown.value, [0.5 - SHOWN / 2, 0.5 + SHOWN / 2])
    room = 0.05 * float(np.ptp(inner)) or 1.0
    low, high = np.clip(outer, inner[0] - ROOM * np.ptp(inner), inner[1] + ROOM * np.ptp(inner))
    return float(min(low, inner[0])) - room, float(max(high, inner[1])) + room


def _legend(ax: Axes, note: str) -> None:
    handles, labels = ax.get_legend_handles_labels()
    if note:
        handles, labels = [*handles, ax.plot([], [], " ")[0]], [*labels, note]
    ax.legend(handles, labels, fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=4)


def _means(shown: PartialResidual, few: bool) -> tuple[Array, Array, Array]:
    """Weighted means of x and value in parts of the range, and the standard uncertainty of the latter."""
    if few:
        places = np.unique(shown.x)
        part = np.searchsorted(places, shown.x)
    else:
        bins = int(np.clip(len(shown.x) // 8, 4, shown.bins))
        edges = np.linspace(shown.x.min(), shown.x.max(), bins + 1)
        places = (edges[:-1] + edges[1:]) / 2
        part = np.clip(np.searchsorted(edges, shown.x, side="right") - 1, 0, bins - 1)
    weight = 1.0 / shown.u**2
    total = np.bincount(part, weight, len(places))
    full = np.bincount(part, minlength=len(places)) >= (1 if few else LEAST_IN_BIN)
    safe = np.where(full, total, 1.0)
    mean = np.bincount(part, weight * shown.value, len(places)) / safe
    middle = np.bincount(part, weight * shown.x, len(places)) / safe
    return middle[full], mean[full], 1.0 / np.sqrt(safe[full])


def plot_seat_error(result: Diagnosis, effect: Effect, ax: Axes | None = None) -> Axes:
    """Where each seat is beside where it is said to be, by the extended arm; the fitted error of one seat as a ring.

    Dots are weighted means over the records of a seat, with the standard uncertainty that the scatter of these gives; an
    error of the arm that is common to them is not in it.
    """
    fit, ax = result.extended, axes_of(ax, (6.8, 3.8))
    records = fit.problem.measurements
    tips, variance = fit.solution.point.prediction.tips, np.diagonal(fit.residual_noise, axis1=1, axis2=2)
    found = {e.place: np.array(e.values) for e in (*(f.effect for f in result.findings), effect) if e.corrects_seat}
    seats = [name for name in sorted(records.seats(), key=numbers_by_size) if records.known[records.seats()[name]].all()]
    ax.axhline(0.0, color=INK, lw=0.6)
    for place, name in enumerate(seats):
        own = records.seats()[name]
        own = own[fit.used[own]]
        if not own.size:
            continue
        error = found.get(name, np.zeros(3))
        off = (tips[own] + error - records.reference[own]) / UM
        weight = UM**2 / variance[own]
        mean, u = (weight * off).sum(axis=0) / weight.sum(axis=0), 1.0 / np.sqrt(weight.sum(axis=0))
        for k, (axis, colour) in enumerate(AXES.items()):
            x = place + 0.22 * (k - 1)
            ax.errorbar(x, mean[k], u[k], fmt="o", ms=4, capsize=2.5, color=colour, label=None if place else axis)
            if name in found:
                ax.plot(x, error[k] / UM, "o", ms=9, mfc="none", color=colour)
    ax.plot([], [], "o", ms=9, mfc="none", color=INK, label="fitted error")
    ax.set_xticks(range(len(seats)), seats, rotation=90 if len(seats) > 15 else 0)
    ax.set(xlabel="seat", ylabel="true place minus stated place [µm]")
    _legend(ax, "")
    ax.set_title(f"{result.model.arm.name}: {in_words(effect)}", fontsize=10)
    return ax


def plot_geometry(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """Geometric values that moved beyond what was stated of them: change with U (k = 2), the stated U as a grey band.

    Raises:
        AacmmError: no geometric value did.
    """
    found = [f for f in result.findings if geometric(result, f)]
    if not found:
        raise AacmmError("no geometric value of this diagnosis is beyond what was stated of it")
    ax = axes_of(ax, (6.4, 1.2 + 0.4 * len(found)))
    stated = stated_u(result)
    for place, finding in enumerate(found):
        effect = finding.effect
        width, change, u = 2 * stated.get(effect.label, np.nan), effect.values[0], 2 * effect.u[0]
        unit, scale = ("µm", UM) if effect.terms[0].unit == "m" else ("µrad", UM)
        ax.barh(
            place, 2 * width / scale, left=-width / scale, height=0.5, color="#d9dee3", label=None if place else "stated U"
        )
        ax.errorbar(
            change / scale, place, xerr=u / scale, fmt="o", color=VERMILLION, capsize=3, label=None if place else "found ± U"
        )
        text = f"{change / scale:+.1f} ± {u / scale:.1f} {unit}"
        ax.annotate(text, (change / scale, place), (0, 9), textcoords="offset points", ha="center", fontsize=8)
    ax.axvline(0.0, color=INK, lw=0.6)
    ax.set_yticks(range(len(found)), [in_words(f.effect) for f in found], fontsize=8)
    ax.set_ylim(len(found) - 0.4, -0.7)
    ax.set_xlabel("change beside the stated value [µm or µrad], U with k = 2")
    ax.margins(x=0.12)
    ax.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    ax.set_title(f"{result.model.arm.name}: geometry beyond its stated uncertainty", fontsize=10)
    return ax


def stated_u(result: Diagnosis) -> dict[str, float]:
    """Stated standard uncertainty of every one-valued effect that was estimated and has one, by its label [SI]."""
    problem = result.extended.problem
    single = [(effect, own.start) for effect, own in problem.vector if own.stop - own.start == 1]
    return {effect.label: float(problem.widths[k]) for effect, k in single if problem.stated[k]}


def plot_unexplained(result: Diagnosis, name: str, ax: Axes | None = None) -> Axes:
    """What no cause explains, over what it depends on: the smooth correction, and faintly what each record says of it.

    Over one covariate the correction is a line, or a bar for each label; over several its size is a colour.

    Raises:
        AacmmError: nothing depends on such a covariate.
    """
    shapes = result.unexplained.shapes
    if name not in shapes:
        raise AacmmError(f"nothing unexplained depends on {name!r}, expected one of {', '.join(shapes) or '(nothing does)'}")
    shape, ax = shapes[name], axes_of(ax, (6.8, 3.8))
    columns = [str(column) for column in shape]
    quantities = [column.removesuffix("_of_record") for column in columns if column.endswith("_of_record")]
    over = [column for column in columns if column.removesuffix("_of_record") not in quantities]
    if len(over) > 1:
        _plot_over_two(shape, over, quantities, ax)
    else:
        _plot_over_one(shape, over[0], quantities, ax)
    ax.set_title(f"{result.model.arm.name}, over {name}: {result.unexplained.acts_on[name]}", fontsize=10)
    return ax


def _plot_over_one(shape: pd.DataFrame, over: str, quantities: list[str], ax: Axes) -> None:
    labels = list(dict.fromkeys(shape[over])) if not is_numeric_dtype(shape[over]) else []
    x = shape[over].map(labels.index).to_numpy(dtype=float) if labels else shape[over].to_numpy(dtype=float)
    ax.axhline(0.0, color=INK, lw=0.6)
    for k, (quantity, colour) in enumerate(zip(quantities, AXES.values(), strict=False)):
        aside = 0.22 * (k - (len(quantities) - 1) / 2) if labels else 0.0
        spread = np.linspace(-0.07, 0.07, len(x)) if labels else 0.0
        ax.plot(x + aside + spread, shape[f"{quantity}_of_record"], ".", ms=2.5, color=colour, alpha=0.3)
        style = {"ls": "", "marker": "_", "ms": 18, "mew": 2.5} if labels else {"lw": 2}
        label = quantity[0] if len(quantities) > 1 else None
        ax.plot(x + aside, shape[quantity], color=colour, label=label, **style)
    if labels:
        ax.set_xticks(range(len(labels)), labels)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(8))
    records = shape[[f"{quantity}_of_record" for quantity in quantities]].to_numpy()
    low, high = np.quantile(records, [0.005, 0.995])
    ax.set_ylim(low - 0.15 * (high - low), high + 0.15 * (high - low))
    ax.set(xlabel=_head(over), ylabel=_head(quantities[0]) if len(quantities) == 1 else "shift of the tip [mm]")
    if len(quantities) > 1:
        _legend(ax, "")


def _plot_over_two(shape: pd.DataFrame, over: list[str], quantities: list[str], ax: Axes) -> None:
    """The size of the correction as colour over the first two covariates; records where it is largest on top."""
    one = len(quantities) == 1
    size = shape[quantities[0]] if one else np.sqrt(np.square(shape[quantities]).sum(axis=1))
    order = np.argsort(np.abs(size.to_numpy()))
    bound = float(np.abs(size).max())
    at, colours = shape.iloc[order], "RdBu_r" if one else "viridis"
    low = -bound if one else 0.0
    drawn = ax.scatter(at[over[0]], at[over[-1]], c=size.iloc[order], s=14, vmin=low, vmax=bound, cmap=colours)
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(drawn, ax=ax, label=_head(quantities[0]) if one else "shift of the tip [mm]")
    ax.set(xlabel=_head(over[0]), ylabel=_head(over[-1]))


UNIT_NAMES = {"deg": "°", "c": "°C", "urad": "µrad", "um_per_m": "µm/m", "mm": "mm", "s": "s"}


def _head(column: str) -> str:
    """``theta3_deg`` as ``theta3 [°]``; a column without a known unit as it is."""
    for ending, unit in UNIT_NAMES.items():
        if column.endswith(f"_{ending}"):
            return f"{column.removesuffix(f'_{ending}').replace('_', ' ')} [{unit}]"
    return column
