"""Pictures of a calibration: residuals over joints, by seats, against the noise; parameters."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import MISFIT, Calibration, Repeatability, geometric_parameters
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.effects import in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import length_unit, small_unit
from aacmm_pin.report.parameter_tables import parameter_table
from aacmm_pin.report.plots.residual_vectors import model_named
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    aside,
    axes_of,
    draw_beyond,
    legend_below,
    name_places,
    name_rows,
    numbers_by_size,
    panels_of,
    plain,
    whole,
)

STATE_COLOURS = {"before": GREY, "after": BLUE}
JOINT_BINS = 18
"""Intervals of a joint's range for mean residuals."""
LEAST_IN_BIN = 4
WITHIN = "#e4e9ee"
"""Colour of stated bounds."""
CHANGE_COLUMNS = ["parameter", "unit", "change", "U", "stated", "known", "beyond"]
UNDETERMINED_COLOUR = "#d9d9d9"
NOT_AT_ALL = 0.99
"""A parameter with so much of an undetermined direction is not determined."""
NAMED = 45
"""Parameters whose names fit beside a heat map."""


@plain
def plot_residuals_over_joint(
    result: Calibration, joint: int, when: str = "after", ax: Axes | None = None
) -> Axes:
    """Plot the residual along the motion of the tip by one joint, over the angle of this joint.

    An error of the joint angle appears directly. Dots are records; the line is the mean in
    intervals of the range, with its standard uncertainty. A joint whose axis passes through the tip
    has no residual. Joints count from 1, and ``when`` is ``before`` or ``after`` calibration.

    Raises:
        AacmmError: the joint does not exist.
        UnknownNameError: ``when`` is neither ``before`` nor ``after``.
    """
    arm, fit = result.model.arm, model_named(result, when)
    if not 1 <= joint <= arm.nq:
        raise AacmmError(f"joint is {joint}; expected 1 to {arm.nq} for {arm.name}")
    slides = arm.chain.prismatic[joint - 1]
    motion = fit.by_reading[:, :3, joint - 1]
    size = np.linalg.norm(motion, axis=1)
    moved = result.fit.used & (size > 1e-6)
    way = motion[moved] / size[moved, None]
    along = np.einsum("ni,ni->n", fit.system.deviation[moved], way) / UM
    unit, one = ("mm", MM) if slides else ("°", DEG)
    angle = fit.problem.measurements.readings[moved, joint - 1] / one
    ax = axes_of(ax, (5.0, 3.2))
    ax.axhline(0.0, color=INK, lw=0.7)
    ax.plot(angle, along, ".", ms=3, color=STATE_COLOURS[when], alpha=0.8)
    if len(angle):
        parts = pd.DataFrame({"angle": angle, "value": along}).groupby(pd.cut(angle, JOINT_BINS))
        many = parts.size() >= LEAST_IN_BIN
        means, u = parts.mean()[many], parts["value"].sem()[many]
        ax.errorbar(means["angle"], means["value"], u, color=VERMILLION, capsize=2)
    else:  # its axis goes through the tip
        ax.text(0.5, 0.6, "joint does not move the tip", transform=ax.transAxes, ha="center")
        ax.set_xticks([])
    ax.set(xlabel=f"joint {joint} [{unit}]", ylabel="residual [µm]")
    ax.grid(alpha=0.3)
    return ax


@plain
def plot_residuals_over_joints(
    result: Calibration, when: str = "after", ax: Axes | None = None
) -> Figure:
    """Plot :func:`plot_residuals_over_joint` for all joints on one scale, in the area of ``ax``.

    Raises:
        UnknownNameError: ``when`` is neither ``before`` nor ``after``.
    """
    joints = result.model.arm.nq
    columns = min(joints, 3)
    panels = panels_of(ax, (3.5, 2.65), joints, columns, share_y=True)
    for number, panel in enumerate(panels, start=1):
        plot_residuals_over_joint(result, number, when, panel)
        if (number - 1) % columns:
            panel.set_ylabel("")
    title = f"{result.model.arm.name}: residual along the motion of each joint, {when} calibration"
    panels[(columns - 1) // 2].set_title(title)
    return whole(panels)


@plain
def plot_residuals_by_seat(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the residual of every record by seat, before and after calibration.

    Excluded records are crosses, or diamonds at the upper edge beyond the scale.

    Raises:
        AacmmError: the records have no seat.
    """
    seats = result.fit.problem.measurements.seats()
    if not seats:
        raise AacmmError("these records name no seat; expected labels in the column `seat`")
    names, table = sorted(seats, key=numbers_by_size), result.residuals
    ax = axes_of(ax, (min(14.0, max(5.0, 1.6 + 0.55 * len(seats))), 3.6))
    top = 1.15 * float(table.loc[result.fit.used, ["before_mm", "after_mm"]].max().max()) or 1.0
    records = np.concatenate([seats[name] for name in names])
    place = np.concatenate([k + aside(len(seats[name]), 0.28) for k, name in enumerate(names)])
    used, excluded = result.fit.used[records], result.fit.excluded[records]
    crossed: list[tuple[Array, Array, str]] = []
    for shift, (when, colour) in zip((-0.2, 0.2), STATE_COLOURS.items(), strict=True):
        x, y = place + shift, table[f"{when}_mm"].to_numpy()[records]
        ax.plot(x[used], y[used], ".", ms=4, color=colour, label=f"{when} calibration")
        crossed.append((x[excluded], y[excluded], VERMILLION))
    if excluded.any():
        x, y = np.hstack([series[:2] for series in crossed])
        near = y <= top
        ax.plot(x[near], y[near], "x", ms=6, mew=1.5, color=VERMILLION, label="excluded")
    draw_beyond(ax, crossed, (0.0, top))
    name_places(ax, names)
    ax.set(xlabel="seat", ylabel="residual [mm]")
    ax.grid(axis="y", alpha=0.3)
    legend_below(ax, columns=2)
    ax.set_title(f"{result.model.arm.name}: residuals by seat")
    return ax


@plain
def plot_normalised_residuals(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the distribution of the normalised residuals against the χ distribution with three
    degrees of freedom.

    The covariance of the noise, with an estimated scatter if the stated noise is too small,
    normalises each residual (Mahalanobis distance).
    """
    distance = np.sqrt(result.fit.system.distance[result.fit.used])
    ax, most = axes_of(ax, (5.4, 3.6)), max(4.5, float(distance.max(initial=0.0)))
    label = f"{len(distance)} records used"
    ax.hist(distance, 30, range=(0, most), density=True, color=BLUE, alpha=0.75, label=label)
    x = np.linspace(0, most, 300)
    label = "χ distribution, 3 degrees of freedom"
    ax.plot(x, stats.chi(3).pdf(x), color=VERMILLION, lw=1.8, label=label)
    ax.set(xlabel="normalised residual [1]", ylabel="density [1]", xlim=(0, most))
    ax.legend()
    ax.set_title(f"{result.model.arm.name}: residuals against the noise")
    return ax


@plain
def plot_repeats(repeats: Repeatability, ax: Axes | None = None) -> Figure:
    """Plot the deviations of repeats from the mean of their posture over time or row, with their
    drift, and the distribution of the residuals, in the area of ``ax``.
    """
    over, beside = panels_of(ax, (4.3, 3.4), 2, 2, share_y=True)
    unit, scale = length_unit(float(np.abs(repeats.residuals).max()))
    clock = repeats.clock / 3600.0 if repeats.is_timed else repeats.clock
    drift = repeats.drift
    for axis, colour in enumerate((BLUE, VERMILLION, INK)):
        deviation = repeats.deviations[:, axis] / scale
        over.plot(clock, deviation, ".", ms=3, alpha=0.5, color=colour, label="xyz"[axis])
        if drift is not None and drift.p_value < MISFIT:
            drifted = drift.change[axis] / scale * repeats.elapsed / np.ptp(repeats.clock)
            for number in range(repeats.cycles.size):
                rows = np.flatnonzero(repeats.posture == number)
                rows = rows[np.argsort(clock[rows])]
                over.plot(clock[rows], drifted[rows], color=colour, lw=1.2)
    over.set_xlabel("time [h]" if repeats.is_timed else "row of the file [1]")
    over.set_ylabel(f"tip minus target [{unit}]")
    over.set_title("repeats: deviation from the mean of the posture", fontsize=10)
    legend_below(over, columns=3)
    series = {"residuals after calibration": repeats.residuals, "repeats": repeats.deviations}
    bins = np.histogram_bin_edges(repeats.residuals / scale, 40).tolist()
    for (label, values), colour in zip(series.items(), (GREY, BLUE), strict=True):
        beside.hist(
            values.ravel() / scale,
            bins,
            density=True,
            orientation="horizontal",
            histtype="step",
            color=colour,
            label=label,
        )
    beside.set_xlabel(f"density [1/{unit}]")
    beside.set_title("repeats beside residuals", fontsize=10)
    legend_below(beside, columns=2)
    return whole([over, beside])


@plain
def plot_correlation(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the correlation matrix of the parameters.

    At ±1, the records determine only the sum or the difference of two parameters; a grey field is
    of a parameter that they do not determine.
    """
    table, count = result.correlation, len(result.correlation)
    untold = np.linalg.norm(result.fit.unknown[:count], axis=1) > NOT_AT_ALL
    ax = axes_of(ax, (2.6 + 0.2 * min(count, NAMED), 2.0 + 0.2 * min(count, NAMED)))
    values = np.ma.masked_array(table.to_numpy(), untold[:, None] | untold)
    image = ax.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    ax.set_facecolor(UNDETERMINED_COLOUR)
    if count <= NAMED:
        ax.set_xticks(range(count), list(table.columns), rotation=90, fontsize=7)
        ax.set_yticks(range(count), list(table.index), fontsize=7)
    else:
        ax.set(xlabel="number of the parameter", ylabel="number of the parameter")
    ax.figure.colorbar(image, ax=ax, label="correlation [1]", shrink=0.8)
    grey = "\ngrey: not determined" if untold.any() else ""
    ax.set_title(f"{result.model.arm.name}: correlation of the parameters{grey}")
    return ax


@plain
def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Figure:
    """Plot the change of each parameter with U (k = 2), relative to its stated half-width.

    A second colour marks changes larger than half-width and U together, open symbols parameters
    that are determined only in combination. Without stated half-widths, lengths and angles have
    separate panels in the area of ``ax``.
    """
    table = parameter_table(result)
    stated, title = table["stated"].notna(), f"{result.model.arm.name}: parameters"
    if stated.any() and not stated.all():
        title += f"\n{(~stated).sum()} without a stated uncertainty left out"
    if (table["known"] == "in combination").any():
        title += "\nopen symbols: determined only in combination with others"
    parts = [part for _, part in table.groupby("unit", sort=False)]
    if stated.any():
        parts = [table[stated]]
    height = 1.2 + 0.24 * max(map(len, parts))
    panels = panels_of(ax, (6.6 if len(parts) == 1 else 4.3, height), len(parts), len(parts))
    for panel, part in zip(panels, parts, strict=True):
        _draw_changes(part, panel)
    panels[0].set_title(title)
    return whole(panels)


@plain
def plot_geometry(result: Diagnosis, ax: Axes | None = None) -> Axes:
    """Plot the changes of geometric values that a diagnosis finds beyond their stated uncertainty.

    Raises:
        AacmmError: no geometric value changed so much.
    """
    effects = [f.effect for f in result.findings if result.geometric(f)]
    if not effects:
        raise AacmmError(
            "no geometric value differs significantly from the stated value; expected one or more"
        )
    arm, rows = result.before.problem.model.arm, []
    for effect in effects:
        parameters = geometric_parameters(arm, effect)
        for parameter, value, u in zip(parameters, effect.values, effect.u, strict=True):
            expanded = COVERAGE_FACTOR * u
            unit, factor = small_unit(parameter.unit, max(abs(value), expanded))
            what = in_words(effect, arm) if len(parameters) == 1 else parameter.name
            amount = f"{factor * value:+.1f} ± {factor * expanded:.1f} {unit}"
            stated = parameter.half_width or COVERAGE_FACTOR * parameter.u or np.nan
            rows.append((f"{what}\n{amount}", parameter.unit, value, expanded, stated, "", True))
    ax = axes_of(ax, (6.6, 1.2 + 0.24 * len(rows)))
    _draw_changes(pd.DataFrame(rows, columns=CHANGE_COLUMNS), ax)
    ax.set_title(f"{result.model.arm.name}: geometric values beyond their stated uncertainties")
    return ax


def _draw_changes(table: pd.DataFrame, ax: Axes) -> None:
    largest = np.nanmax(np.abs(table[["change", "U"]].to_numpy()))
    unit, factor = small_unit(table["unit"].iloc[0], largest)
    label, scale = f"[{unit}]", pd.Series(1 / factor, table.index)
    if table["stated"].notna().all():
        label, scale = "/ stated half-width [1]", table["stated"]
        ax.axvspan(-1, 1, color=WITHIN, zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    scaled = table.assign(change=table["change"] / scale, U=table["U"] / scale)
    columns = scaled[["change", "U", "beyond", "known"]].itertuples(index=False)
    for row, (change, bar, beyond, known) in enumerate(columns):
        colour = VERMILLION if beyond else BLUE
        face = "white" if known == "in combination" else colour
        ax.errorbar(change, row, xerr=bar, fmt="o", ms=5, color=colour, mfc=face)
    name_rows(ax, list(table["parameter"]), size=8)
    ax.set_xlabel(f"change {label}; bars: U (k = 2)")
