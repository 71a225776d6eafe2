"""Pictures of a calibration: residuals over joints and by seats, repeats, parameters."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.calibration import Calibration
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.numbers import small_unit
from aacmm_pin.report.parameter_tables import parameter_table
from aacmm_pin.report.plots.residual_vectors import model_named
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    axes_of,
    figure_of,
    legend_below,
    name_places,
    name_rows,
    numbers_by_size,
    panels_of,
    plain,
    shifts_aside,
    with_cut_off,
)

STATE_COLOURS = {"before": GREY, "after": BLUE}
JOINT_BINS = 18
"""Intervals of a joint's range for mean residuals."""
LEAST_IN_BIN = 4
WITHIN = "#e4e9ee"
"""Colour of stated bounds."""


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
    moves_tip = result.fit.used & (size > 1e-6)
    direction = motion[moves_tip] / size[moves_tip, None]
    along = np.einsum("ni,ni->n", fit.system.deviation[moves_tip], direction) / UM
    unit, scale = ("mm", MM) if slides else ("°", DEG)
    angle = fit.problem.measurements.readings[moves_tip, joint - 1] / scale
    ax = axes_of(ax, (5.0, 3.2))
    ax.axhline(0.0, color=INK, lw=0.7)
    ax.plot(angle, along, ".", ms=3, color=STATE_COLOURS[when], alpha=0.8)
    if len(angle):
        parts = pd.DataFrame({"angle": angle, "value": along}).groupby(pd.cut(angle, JOINT_BINS))
        enough = parts.size() >= LEAST_IN_BIN
        means, u = parts.mean()[enough], parts["value"].sem()[enough]
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
    return figure_of(panels)


@plain
def plot_residuals_by_seat(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the residual of every record by seat, before and after calibration.

    Excluded records are crosses; the scale is that of the used records.

    Raises:
        AacmmError: the records have no seat.
    """
    seats = result.fit.problem.measurements.seats()
    if not seats:
        raise AacmmError("these records name no seat; expected labels in the column `seat`")
    names, table = sorted(seats, key=numbers_by_size), result.residuals
    ax = axes_of(ax, (min(14.0, max(5.0, 1.6 + 0.55 * len(seats))), 3.6))
    records = np.concatenate([seats[name] for name in names])
    abscissa = np.concatenate(
        [k + shifts_aside(len(seats[name]), 0.28) for k, name in enumerate(names)]
    )
    used, excluded = result.fit.used[records], result.fit.excluded[records]
    sizes = table[["before_mm", "after_mm"]].to_numpy()[records]
    limits = 0.0, 1.15 * float(sizes[used].max()) or 1.0
    for k, (when, colour) in enumerate(STATE_COLOURS.items()):
        x, y = abscissa + 0.4 * k - 0.2, sizes[:, k]
        ax.plot(x[used], y[used], ".", ms=4, color=colour, label=f"{when} calibration")
        ax.plot(x[excluded], y[excluded], "x", ms=6, mew=1.5, color=VERMILLION)
    if excluded.any():
        label = with_cut_off("excluded", sizes[excluded], limits)
        ax.plot([], [], "x", ms=6, mew=1.5, color=VERMILLION, label=label)
    ax.set_ylim(limits)
    name_places(ax, names)
    ax.set(xlabel="seat", ylabel="residual [mm]")
    ax.grid(axis="y", alpha=0.3)
    legend_below(ax, columns=3)
    ax.set_title(f"{result.model.arm.name}: residuals by seat")
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
    return figure_of(panels)


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
