"""What a calibration leaves: residuals in space, over joint angles, by seats, and against the noise."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray
from scipy.stats import binned_statistic, chi

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.calibration import Calibration
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, Panels, axes_of, panels_of, round_down

When = Literal["before", "after"]
Plane = Literal["xy", "xz", "yz"]
_BOTH: tuple[When, ...] = get_args(When)
COLOURS: dict[str, str] = {"before": GREY, "after": BLUE}
LONGEST = 0.08
"""How long nearly all residuals are drawn, as part of the picture."""
BINS = 18
"""Parts of a joint's range over which residuals are averaged."""
LEAST_IN_BIN = 4


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of one of the two fits.

    Attributes:
        target: where the tips should be, in the frame of the references (n, 3) [m].
        deviation: tip minus target (n, 3) [m]; nan where a record has none.
        used: which of them count (n,).
    """

    target: Array
    deviation: Array
    used: NDArray[np.bool_]

    @staticmethod
    def of(result: Calibration, when: When) -> Residuals:
        """Those before or after."""
        fit = fit_of(result, when)
        deviation = fit.solution.system.deviation
        return Residuals(fit.solution.point.prediction.tips - deviation, deviation, result.fit.used)

    @property
    def distance(self) -> Array:
        """Distance of tip and target, (n,) [m]."""
        return np.asarray(np.linalg.norm(self.deviation, axis=1))


def fit_of(result: Calibration, when: When) -> Fit:
    """The fit of the set-up alone, or of everything.

    Raises:
        AacmmError: ``when`` is neither ``before`` nor ``after``.
    """
    if when not in _BOTH:
        raise AacmmError(f"when is {when!r}, expected 'before' or 'after'")
    return result.fit if when == "after" else result.before


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
    if plane not in ("xy", "xz", "yz"):
        raise AacmmError(f"plane is {plane!r}, expected 'xy', 'xz' or 'yz'")
    shown = Residuals.of(result, when)
    axes = ["xyz".index(name) for name in plane]
    ax = axes_of(ax, (6.0, 5.6))
    target, deviation = shown.target[:, axes] / MM, shown.deviation[:, axes] / MM
    used = shown.used
    size = float(np.ptp(target[used], axis=0).max()) or 1.0
    longest = float(np.quantile(np.linalg.norm(deviation[used], axis=1), 0.95)) or 1e-9
    factor = round_down(LONGEST * size / longest)
    ends = target[used] + factor * deviation[used]
    ax.add_collection(LineCollection(list(np.stack([target[used], ends], axis=1)), colors=BLUE, linewidths=0.9, alpha=0.7))
    ax.plot(*ends.T, ".", ms=2.5, color=BLUE)
    ax.plot(*np.unique(target[used], axis=0).T, "o", ms=2.5, color=INK, label="target")
    excluded = result.fit.excluded
    if excluded.any():
        ax.plot(*target[excluded].T, "x", ms=7, mew=1.8, color=VERMILLION, label=f"{excluded.sum()} excluded")
    corner = target[used].min(axis=0) - np.array([0.0, 0.12 * size])
    scale_bar(ax, corner, factor, round_down(1.3 * longest))
    ax.set(xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]", aspect="equal")
    ax.margins(0.08)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, fontsize=8, frameon=False)
    name = result.model.arm.name
    ax.set_title(f"{name}: residuals {when} calibration, magnified {factor:g}×", fontsize=10)
    return ax


def scale_bar(ax: Axes, corner: Array, factor: float, length: float) -> None:
    """A line as long as a residual of ``length`` [mm] is drawn, from ``corner`` (2,) [mm] to the right."""
    end = corner[0] + factor * length
    ax.plot([corner[0], end], [corner[1]] * 2, "|-", color=INK, lw=1.2, ms=7)
    ax.annotate(f"{length:g} mm", (end, corner[1]), (5, 0), textcoords="offset points", va="center", fontsize=8, color=INK)


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
    shown, ax = Residuals.of(result, when), axes_of(ax, (5.0, 3.2))
    angle, along = records.q[:, joint - 1] / DEG, _along_joint(result, shown, joint) / UM
    there = shown.used & np.isfinite(along)
    angle, along = angle[there], along[there]
    ax.axhline(0.0, color=INK, lw=0.7)
    ax.plot(angle, along, ".", ms=3, color=COLOURS[when], alpha=0.8)
    if len(angle):
        _draw_means(ax, angle, along)
    else:  # its axis goes through the tip
        ax.text(0.5, 0.6, "does not move the tip", transform=ax.transAxes, ha="center", color=INK)
        ax.set_xticks([])
    sliding = arm.chain.prismatic[joint - 1]
    ax.set(xlabel=f"joint {joint} [{'m' if sliding else '°'}]", ylabel="residual [µm]")
    ax.grid(alpha=0.3)
    return ax


def _along_joint(result: Calibration, shown: Residuals, joint: int) -> Array:
    """Residual along ∂tip/∂q of a joint (n,) [m]; nan where the joint does not move the tip."""
    records, frame = result.fit.problem.measurements, result.fit.solution.point.frame
    motion = result.model.arm.jacobian(records.q)[:, :, joint - 1] @ frame.rotation.T
    length = np.linalg.norm(motion, axis=1)
    moves = length > 1e-6
    return np.where(moves, np.einsum("ni,ni->n", shown.deviation, motion) / np.where(moves, length, 1.0), np.nan)


def _draw_means(ax: Axes, angle: Array, values: Array) -> None:
    range_ = (angle.min() - 1e-9, angle.max() + 1e-9)
    mean, edges, _ = binned_statistic(angle, values, "mean", BINS, range_)
    count = binned_statistic(angle, values, "count", BINS, range_)[0]
    spread = binned_statistic(angle, values, "std", BINS, range_)[0]
    full = count >= LEAST_IN_BIN
    middle = (edges[:-1] + edges[1:]) / 2
    u = spread[full] / np.sqrt(count[full] - 1)
    ax.errorbar(middle[full], mean[full], u, color=VERMILLION, lw=1.4, elinewidth=1.0, capsize=2)


def plot_residuals_over_joints(result: Calibration, when: When = "after", ax: Axes | Panels | None = None) -> Panels:
    """:func:`plot_residuals_over_joint` for every joint, side by side on one scale.

    Args:
        result: the calibration.
        when: by the arm as it was, or calibrated.
        ax: axes whose place is divided, or one for each joint.

    Returns:
        axes of the joints (nq,).

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
    return panels


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
    distances = [(when, Residuals.of(result, when).distance / MM) for when in _BOTH]
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


def numbers_by_size(label: str) -> list[tuple[int, str]]:
    """S2 before S10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", label)]


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
