"""Pictures of a calibration: residuals over joints and by seats, repeats, parameters."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration
from aacmm_pin.errors import AacmmError
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
    shifts_aside,
    without_latex,
)
from aacmm_pin.report.residual_tables import model_named

STATE_COLOURS = {"before": GREY, "after": BLUE}
JOINT_BINS = 18
"""Intervals of a joint's range for mean residuals."""
LEAST_IN_BIN = 4
WITHIN = "#e4e9ee"
"""Colour of stated bounds."""


@without_latex()
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
    unit, scale = ("mm", MM) if arm.chain.prismatic[joint - 1] else ("°", DEG)
    motion = fit.by_reading[:, :3, joint - 1]
    size = np.linalg.norm(motion, axis=1)
    moves_tip = result.fit.used & (size > 1e-6)
    along = np.einsum("ni,ni->n", fit.system.deviation, motion)[moves_tip] / size[moves_tip] / UM
    angle = fit.problem.measurements.readings[moves_tip, joint - 1] / scale
    ax = axes_of(ax, (5.0, 3.2))
    ax.axhline(0.0, color=INK, lw=0.7)
    ax.plot(angle, along, ".", ms=3, color=STATE_COLOURS[when], alpha=0.8)
    if len(angle):
        parts = pd.DataFrame({"angle": angle, "value": along}).groupby(pd.cut(angle, JOINT_BINS))
        enough = parts.size() >= LEAST_IN_BIN
        means, u = parts.mean()[enough], parts["value"].sem()[enough]
        ax.errorbar(means["angle"], means["value"], u, color=VERMILLION, capsize=2)
    ax.set(xlabel=f"joint {joint} [{unit}]", ylabel="residual [µm]")
    ax.grid(alpha=0.3)
    return ax


@without_latex()
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


@without_latex()
def plot_residuals_by_seat(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the residual of every used record by seat, before and after calibration.

    Raises:
        AacmmError: the records have no seat.
    """
    seats = result.fit.problem.measurements.seats()
    if not seats:
        raise AacmmError("these records name no seat; expected labels in the column `seat`")
    names = sorted(seats, key=numbers_by_size)
    rows_of_seats = [seats[name][result.fit.used[seats[name]]] for name in names]
    places = [place + shifts_aside(len(rows), 0.28) for place, rows in enumerate(rows_of_seats)]
    x, rows = np.concatenate(places), np.concatenate(rows_of_seats)
    ax = axes_of(ax, (min(14.0, max(5.0, 1.6 + 0.55 * len(seats))), 3.6))
    for shift, (when, colour) in zip((-0.2, 0.2), STATE_COLOURS.items(), strict=True):
        sizes = result.residuals[f"{when}_mm"].to_numpy()[rows]
        ax.plot(x + shift, sizes, ".", ms=4, color=colour, label=f"{when} calibration")
    ax.set_ylim(bottom=0.0)
    name_places(ax, names)
    ax.set(xlabel="seat", ylabel="residual [mm]")
    ax.grid(axis="y", alpha=0.3)
    legend_below(ax, columns=3)
    ax.set_title(f"{result.model.arm.name}: residuals by seat")
    return ax


def parameter_table(result: Calibration) -> pd.DataFrame:
    """:attr:`Calibration.parameters` with the ``stated`` half-width, or k u of a cause, k = 2, and
    ``beyond``: the change exceeds stated + U.

    A half-width is a bound and does not add in quadrature: √(stated² + U²) would mark some
    parameter of 14 in 40 arms drawn within their half-widths.
    """
    table, vector = result.parameters, result.fit.problem.vector
    parameters = zip(vector.arm_parameters, vector.parameters, strict=True)
    sources = [of_arm or of_effect for of_arm, of_effect in parameters]
    stated = np.array([p.half_width or COVERAGE_FACTOR * p.u or np.nan for p in sources])
    stated /= np.where(table["unit"] == "mm", MM, 1.0)
    return table.assign(stated=stated, beyond=np.abs(table["change"]) > stated + table["U"])


@without_latex()
def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Axes:
    """Plot the change of each parameter with U (k = 2), relative to its stated half-width, or to U
    if no half-widths are stated.

    A second colour marks changes larger than half-width and U together. Parameters without a stated
    half-width, or that are determined only in combination, are left out.
    """
    table, words = parameter_table(result), "stated half-width"
    scale = table["stated"]
    if scale.isna().all():
        scale, words = table["U"], "U"
    table = table[["change", "U"]].div(scale, axis=0).join(table[["parameter", "beyond"]]).dropna()
    ax = axes_of(ax, (6.6, 1.2 + 0.24 * len(table)))
    ax.axvspan(-1, 1, color=WITHIN, zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    for place, row in enumerate(table.to_dict("records")):
        colour = VERMILLION if row["beyond"] else BLUE
        ax.errorbar(row["change"], place, xerr=row["U"], fmt="o", ms=5, color=colour)
    name_rows(ax, list(table["parameter"]), size=8)
    ax.set_xlabel(f"change / {words} [1]; bars: U (k = 2)")
    ax.set_title(f"{result.model.arm.name}: parameters")
    return ax
