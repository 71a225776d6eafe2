"""What a calibration found: residuals in space, over joint angles, by seats, against the noise; parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import binned_statistic, chi

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.report.numbers import lengths
from aacmm_pin.report.parameters import readable_parameters
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    Plane,
    axes_of,
    draw_vectors,
    magnification,
    numbers_by_size,
    panels_of,
    placed,
    plane_axes,
    whole,
)

When = Literal["before", "after"]
_BOTH: tuple[When, ...] = get_args(When)
COLOURS: dict[str, str] = {"before": GREY, "after": BLUE}
BINS = 18
"""Parts of a joint's range over which residuals are averaged."""
LEAST_IN_BIN = 4
WITHIN, UNTOLD = "#eef2f5", "#d9d9d9"
NOT_AT_ALL = 0.99
"""A parameter whose direction is so much an unknown one is not determined at all."""
NAMED = 45
"""So many parameters have room for their names at a heat map."""


def fit_of(result: Calibration, when: When) -> Fit:
    """The fit of the set-up alone, or of everything.

    Raises:
        AacmmError: ``when`` is neither ``before`` nor ``after``.
    """
    if when not in _BOTH:
        raise AacmmError(f"when is {when!r}, expected 'before' or 'after'")
    return result.fit if when == "after" else result.before


def _distance(result: Calibration, when: When) -> Array:
    return np.asarray(np.linalg.norm(fit_of(result, when).solution.system.deviation, axis=1))


def plot_residual_vectors(result: Calibration, when: When = "after", plane: Plane = "xy", ax: Axes | None = None) -> Axes:
    """Residuals as lines from each target towards the tip, projected, and magnified by the factor in the title.

    The ends of the lines, where the tips would be, have a dot; excluded records are crosses at their targets.

    Args:
        result: the calibration.
        when: by the arm as it was, or calibrated.
        plane: axes of the frame of the references that are drawn.
        ax: axes.

    Raises:
        AacmmError: no such plane, or ``when`` is something else.
    """
    fit, used, excluded = fit_of(result, when), result.fit.used, result.fit.excluded
    deviation = fit.solution.system.deviation
    target = fit.solution.point.prediction.tips - deviation
    ax = axes_of(ax, (6.0, 5.6))
    axes, factor = plane_axes(plane), magnification(target[used], deviation[used])
    ax.plot(*np.unique(target[used][:, axes] / MM, axis=0).T, "o", ms=2.5, color=INK, label="target")
    if excluded.any():
        label = f"{excluded.sum()} excluded"
        ax.plot(*target[excluded][:, axes].T / MM, "x", ms=7, mew=1.8, color=VERMILLION, label=label)
    draw_vectors(ax, target[used], deviation[used], plane, factor)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize=8, frameon=False)
    ax.set_title(f"{result.model.arm.name}: residuals {when} calibration, magnified {factor:g}×", fontsize=10)
    return ax


def plot_residual_vectors_before_and_after(result: Calibration, ax: Axes | None = None) -> Figure:
    """:func:`plot_residual_vectors` before and after, side by side.

    Args:
        result: the calibration.
        ax: axes whose place is divided.
    """
    panels = placed(ax, (10.0, 5.4), (1, 2), [(0, 0), (0, 1)])
    for when, panel in zip(_BOTH, panels, strict=True):
        plot_residual_vectors(result, when, ax=panel)
    return whole(panels)


def plot_residuals_over_joint(result: Calibration, joint: int, when: When = "after", ax: Axes | None = None) -> Axes:
    """Residual along the way that a joint moves the tip, over its angle: what an error of that angle would look like.

    Dots are records; the line is their mean in parts of the range, with its standard uncertainty. A joint whose axis goes
    through the tip has none.

    Args:
        result: the calibration.
        joint: number of the joint, from 1.
        when: by the arm as it was, or calibrated.
        ax: axes.

    Raises:
        AacmmError: no such joint, or ``when`` is something else.
    """
    arm, records = result.model.arm, result.fit.problem.measurements
    if not 1 <= joint <= arm.nq:
        raise AacmmError(f"joint is {joint}, {arm.name} has 1 to {arm.nq}")
    sliding, ax = arm.chain.prismatic[joint - 1], axes_of(ax, (5.0, 3.2))
    deviation = fit_of(result, when).solution.system.deviation
    angle, along = records.q[:, joint - 1] / (MM if sliding else DEG), _along_joint(result, deviation, joint) / UM
    there = result.fit.used & np.isfinite(along)
    angle, along = angle[there], along[there]
    ax.axhline(0.0, color=INK, lw=0.7)
    ax.plot(angle, along, ".", ms=3, color=COLOURS[when], alpha=0.8)
    if len(angle):
        _draw_means(ax, angle, along)
    else:  # its axis goes through the tip
        ax.text(0.5, 0.6, "does not move the tip", transform=ax.transAxes, ha="center", color=INK)
        ax.set_xticks([])
    ax.set(xlabel=f"joint {joint} [{'mm' if sliding else '°'}]", ylabel="residual [µm]")
    ax.grid(alpha=0.3)
    return ax


def _along_joint(result: Calibration, deviation: Array, joint: int) -> Array:
    """Residual along ∂tip/∂q of a joint (n,) [m]; nan where the joint does not move the tip."""
    records, frame = result.fit.problem.measurements, result.fit.solution.point.frame
    motion = result.model.arm.jacobian(records.q)[:, :, joint - 1] @ frame.rotation.T
    length = np.linalg.norm(motion, axis=1)
    moves = length > 1e-6
    return np.where(moves, np.einsum("ni,ni->n", deviation, motion) / np.where(moves, length, 1.0), np.nan)


def _draw_means(ax: Axes, angle: Array, values: Array) -> None:
    def of(what: str) -> Array:
        return np.asarray(binned_statistic(angle, values, what, edges)[0])

    edges = np.linspace(angle.min() - 1e-9, angle.max() + 1e-9, BINS + 1)
    count = of("count")
    full = count >= LEAST_IN_BIN
    u = of("std")[full] / np.sqrt(count[full] - 1)
    middle = (edges[:-1] + edges[1:]) / 2
    ax.errorbar(middle[full], of("mean")[full], u, color=VERMILLION, lw=1.4, elinewidth=1.0, capsize=2)


def plot_residuals_over_joints(result: Calibration, when: When = "after", ax: Axes | None = None) -> Figure:
    """:func:`plot_residuals_over_joint` for every joint, side by side on one scale.

    Args:
        result: the calibration.
        when: by the arm as it was, or calibrated.
        ax: axes whose place is divided.

    Returns:
        the figure of the panels.

    Raises:
        AacmmError: ``when`` is neither ``before`` nor ``after``.
    """
    joints = result.model.arm.nq
    columns = min(joints, 3)
    rows = -(-joints // columns)
    panels = panels_of(ax, (3.5 * columns, 2.5 * rows + 0.3), joints, columns, share_y=True)
    for number, panel in enumerate(panels, start=1):
        plot_residuals_over_joint(result, number, when, panel)
        if (number - 1) % columns:
            panel.set_ylabel("")
    title = f"{result.model.arm.name}: residual along the motion of each joint, {when} calibration"
    panels[(columns - 1) // 2].set_title(title, fontsize=10)
    return whole(panels)


def plot_residuals_by_seat(result: Calibration, ax: Axes | None = None) -> Axes:
    """Distance of tip and target of every record by its seat, before and after.

    Excluded records are crosses, or triangles at the upper edge where they are off the scale of the others.

    Raises:
        AacmmError: the records name no seat.
    """
    seats = sorted(result.fit.problem.measurements.seats().items(), key=lambda seat: numbers_by_size(seat[0]))
    if not seats:
        raise AacmmError("these records name no seat, so there is nothing to show by seats")
    ax = axes_of(ax, (min(14.0, max(5.0, 1.6 + 0.55 * len(seats))), 3.6))
    distances = [(when, _distance(result, when) / MM) for when in _BOTH]
    top = 1.15 * max(float(distance[result.fit.used].max(initial=0.0)) for _, distance in distances) or 1.0
    for k, (when, distance) in enumerate(distances):
        for place, (_, records) in enumerate(seats):
            x, own = np.linspace(-0.14, 0.14, len(records)) + place + 0.4 * k - 0.2, distance[records]
            used, excluded = result.fit.used[records], result.fit.excluded[records]
            ax.plot(x[used], own[used], ".", ms=4, color=COLOURS[when], label=None if place else f"{when} calibration")
            near, off = excluded & (own <= top), excluded & (own > top)
            ax.plot(x[near], own[near], "x", ms=6, mew=1.5, color=VERMILLION)
            ax.plot(x[off], np.full(off.sum(), 0.97 * top), "^", ms=6, color=VERMILLION)
    if result.fit.excluded.any():
        ax.plot([], [], "x", ms=6, mew=1.5, color=VERMILLION, label="excluded (▲ off the scale)")
    ax.set_xticks(range(len(seats)), [label for label, _ in seats], rotation=90 if len(seats) > 15 else 0)
    ax.set(xlabel="seat", ylabel="distance of tip and target [mm]", ylim=(0, top))
    ax.grid(axis="y", alpha=0.3)
    ax.legend(fontsize=8, frameon=False, ncols=3, loc="upper left", bbox_to_anchor=(0.0, -0.17))
    ax.set_title(f"{result.model.arm.name}: residuals by seat", fontsize=10)
    return ax


def plot_normalised_residuals(result: Calibration, ax: Axes | None = None) -> Axes:
    """Residuals over what the noise allows, against the χ distribution with three degrees of freedom.

    A residual is normalised by the covariance of its record (Mahalanobis): by the stated noise, and by the scatter that was
    found where that does not suffice.
    """
    distance = np.sqrt(result.fit.solution.system.distance[result.fit.used])
    ax = axes_of(ax, (5.4, 3.6))
    most = max(4.5, float(distance.max(initial=0.0)))
    ax.hist(
        distance, list(np.linspace(0, most, 31)), density=True, color=BLUE, alpha=0.75, label=f"{len(distance)} records used"
    )
    x = np.linspace(0, most, 300)
    ax.plot(x, chi.pdf(x, 3), color=VERMILLION, lw=1.8, label="χ, 3 degrees of freedom")
    ax.set(xlabel="normalised residual [1]", ylabel="density [1]", xlim=(0, most))
    ax.legend(fontsize=8, frameon=False)
    ax.set_title(f"{result.model.arm.name}: residuals against the noise", fontsize=10)
    return ax


def plot_parameter_changes(result: Calibration, ax: Axes | None = None) -> Axes:
    """Change of each parameter with its expanded uncertainty U (k = 2), over how far off it was said to be.

    Parameters of another colour moved farther than their stated and their new uncertainty together allow (E_n > 1); open
    ones are known only in combination with others. Where nothing was stated, changes stand in µm and µrad.

    Args:
        result: the calibration.
        ax: axes.
    """
    table = readable_parameters(result)
    stated = table["stated"].notna()
    left_out = 0
    if stated.any():
        left_out, table = int((~stated).sum()), table[stated]
    scale = table["stated"].to_numpy() if stated.any() else np.ones(len(table))
    ax = axes_of(ax, (6.4, 1.2 + 0.24 * len(table)))
    change, bar, place = table["change"].to_numpy() / scale, table["U"].to_numpy() / scale, np.arange(len(table))
    if stated.any():
        ax.axvspan(-1, 1, color=WITHIN, zorder=0)
    ax.axvline(0, color=INK, lw=0.7)
    colours = np.where(table["beyond"], VERMILLION, BLUE)
    together = table["known"] == "in combination"
    for x, y, half, colour, open_ in zip(change, place, bar, colours, together, strict=True):
        face = "white" if open_ else colour
        ax.errorbar(x, y, xerr=half, color=colour, mfc=face, fmt="o", ms=4.5, lw=1.2, capsize=2.5)
    ax.set_yticks(place, list(table["parameter"]), fontsize=8)
    ax.set_ylim(len(table) - 0.4, -0.6)
    units = ", ".join(dict.fromkeys(table["in"]))
    ax.set_xlabel(f"{'change / stated ± [1]' if stated.any() else f'change [{units}]'}; bars: U (k = 2)")
    without = f"\n{left_out} without a stated uncertainty are not shown" if left_out else ""
    open_ones = "\nopen: known only in combination with others" if together.any() else ""
    ax.set_title(f"{result.model.arm.name}: parameters{without}{open_ones}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def plot_correlation(result: Calibration, ax: Axes | None = None) -> Axes:
    """Correlation of the parameters; ±1 means that the data tell only their sum or difference, grey that they tell
    nothing.
    """
    untold = np.linalg.norm(result.fit.unknown[: len(result.correlation)], axis=1) > NOT_AT_ALL
    table = result.correlation
    values = np.ma.masked_array(table.to_numpy(), untold[:, None] | untold)
    count = len(table)
    ax = axes_of(ax, (2.6 + 0.2 * min(count, NAMED), 2.0 + 0.2 * min(count, NAMED)))
    image = ax.imshow(values, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    ax.set_facecolor(UNTOLD)
    if count <= NAMED:
        ax.set_xticks(range(count), list(table.columns), rotation=90, fontsize=7)
        ax.set_yticks(range(count), list(table.index), fontsize=7)
    else:
        ax.set(xlabel="number of the parameter", ylabel="number of the parameter")
    ax.figure.colorbar(image, ax=ax, label="correlation [1]", shrink=0.8)
    ax.set_title(f"{result.model.arm.name}: correlation of the parameters", fontsize=10)
    return ax


def plot_residual_sizes(result: Calibration, ax: Axes | None = None) -> Axes:
    """How many records are how far off, before and after, in classes of equal width on a logarithmic scale."""
    ax = axes_of(ax, (5.4, 3.6))
    table = result.residuals[result.fit.used]
    before, after = table["before_mm"].to_numpy(), table["after_mm"].to_numpy()
    largest, least = max(before.max(), after.max(), 2e-9), max(min(before.min(), after.min()), 1e-9)
    edges = list(np.geomspace(0.999 * least, 1.001 * largest, 41))
    sizes = lengths([result.rms_before, result.rms])
    for values, size, colour, when in zip((before, after), sizes, (GREY, BLUE), ("before", "after"), strict=True):
        ax.hist(values, edges, color=colour, alpha=0.75, label=f"{when}, RMS {size}")
    ax.set(xlabel="distance of tip and target [mm]", ylabel="records [1]", xscale="log")
    ax.set_ylim(top=1.25 * ax.get_ylim()[1])
    ax.legend(fontsize=8, frameon=False)
    ax.set_title(f"{result.model.arm.name}: residuals", fontsize=10)
    return ax


def plot_calibration(result: Calibration, ax: Axes | None = None) -> Figure:
    """Everything in one picture: residuals in space before and after, their sizes, beside the noise, and the parameters.

    Args:
        result: the calibration.
        ax: axes whose place is divided.

    Returns:
        the figure of the five panels.
    """
    size = (15.0, max(9.0, 2.0 + 0.2 * len(result.fit.problem.vector.parameters)))
    places = [(0, 0), (0, 1), (1, 0), (1, 1), (slice(0, 2), 2)]
    panels = placed(ax, size, (2, 3), places)
    plot_residual_vectors(result, "before", ax=panels[0])
    plot_residual_vectors(result, "after", ax=panels[1])
    plot_residual_sizes(result, panels[2])
    plot_normalised_residuals(result, panels[3])
    plot_parameter_changes(result, panels[4])
    return whole(panels)


PICTURES: dict[str, Callable[..., Axes | Figure]] = {
    "sizes": plot_residual_sizes,
    "vectors": plot_residual_vectors,
    "joints": plot_residuals_over_joints,
    "seats": plot_residuals_by_seat,
    "noise": plot_normalised_residuals,
    "parameters": plot_parameter_changes,
    "correlation": plot_correlation,
    "all": plot_calibration,
}
"""What can be drawn of a calibration, by name."""


def plot_of_calibration(result: Calibration, what: str, ax: Axes | None = None) -> Axes | Figure:
    """One of :data:`PICTURES`.

    Raises:
        UnknownNameError: no such picture.
    """
    if what not in PICTURES:
        raise UnknownNameError("picture", what, list(PICTURES))
    return PICTURES[what](result, ax=ax)
