"""Accuracy at a point."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures.configurations import ConfigurationCircle
from aacmm_pin.postures.general_ik import ReachingPostures
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    U_NAME,
    VERMILLION,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    VOLUME_NAME,
    axes_of,
)

COMPONENT_MARKERS = "os^DvP*h"
"""Shapes of the components that one picture shows."""
MARKERS = 18
"""Number of these markers along a component."""


def plot_accuracy_over_theta3(circle: ConfigurationCircle, accuracy: AccuracyVolume, ax: Axes | None = None) -> Axes:
    """Accuracy volume round the circle of θ3, each configuration at (cos θ3, sin θ3), as the source paper draws it.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = paired(circle, accuracy)
    ax = axes_of(ax, (6.0, 5.0))
    theta3, component = circle.theta3[inside], circle.component[inside]
    volume = accuracy.volume / MM3
    rank = np.unique(component, return_inverse=True)[1] + 1.0
    size = 60.0 / rank  # several components at one θ3 stay visible as rings within each other
    order = np.argsort(component, kind="stable")
    points = ax.scatter(
        np.cos(theta3)[order], np.sin(theta3)[order], s=size[order], c=volume[order], cmap=VOLUME_COLOURS, zorder=3
    )
    ax.figure.colorbar(points, ax=ax, label=VOLUME_LABEL)
    for angle in range(0, 360, 45):
        c, s = np.cos(angle * DEG), np.sin(angle * DEG)
        ax.plot([0.0, 0.92 * c], [0.0, 0.92 * s], color="#e6e6e6", lw=0.8, zorder=1)
        ax.text(
            0.82 * c, 0.82 * s, f"{angle}°", ha="center", va="center", fontsize=8, color="#5a5a5a", backgroundcolor="white"
        )
    if len(volume):
        _mark_extremes(ax, theta3, volume)
    ax.set(xlabel="cos θ3 [1]", ylabel="sin θ3 [1]", xlim=(-1.25, 1.25), ylim=(-1.25, 1.25), aspect="equal")
    ax.set_title(f"{circle.arm.name}: accuracy over θ3, {accuracy.method}", fontsize=10)
    return ax


def _mark_extremes(ax: Axes, theta3: Array, volume: Array) -> None:
    best, worst = int(np.argmin(volume)), int(np.argmax(volume))
    for k, marker, name in ((best, "v", "smallest"), (worst, "^", "largest")):
        label = f"{name} {volume[k]:.3g} mm³\nat θ3 = {theta3[k] / DEG % 360:.0f}°"
        ax.plot(1.13 * np.cos(theta3[k]), 1.13 * np.sin(theta3[k]), marker, color=VERMILLION, ms=8, ls="none", label=label)
    ax.legend(loc="center", fontsize=8, framealpha=0.9, edgecolor="#e6e6e6")


def plot_accuracy_over_swivel(circle: PosturesAtPoint, accuracy: AccuracyVolume, ax: Axes | None = None) -> Axes:
    """Accuracy volume (left scale) and standard uncertainty of the position (right scale) over the swivel angle.

    Where two to eight components have configurations within limits, each has markers of its own shape.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = paired(circle, accuracy)
    ax = _draw_over(circle.swivel[inside] / DEG, circle.component[inside], accuracy, ax, "the swivel angle")
    ax.set(xlabel="swivel angle of the elbow, 0 = highest [deg]", xlim=(-180, 180), xticks=range(-180, 181, 60))
    return ax


def plot_accuracy_of_postures(postures: ReachingPostures, accuracy: AccuracyVolume, ax: Axes | None = None) -> Axes:
    """The same over the way along each curve of self-motion, or over the numbers of single postures.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
    """
    inside = paired(postures, accuracy)
    component = postures.component[inside]
    if postures.single:
        ax = _draw_over(component.astype(np.float64), np.ones_like(component), accuracy, ax, "the postures", size=8.0)
        last = int(postures.component.max())
        ax.set(xlabel="number of the posture", xlim=(0.5, last + 0.5), xticks=range(1, last + 1))
    else:
        ax = _draw_over(postures.travel[inside], component, accuracy, ax, "the self-motion")
        ax.set(xlabel="way of all angles along the curve [rad]")
        ax.set_xlim(left=0.0)
    return ax


def _draw_over(
    place: Array, component: Index, accuracy: AccuracyVolume, ax: Axes | None, over: str, size: float = 3.5
) -> Axes:
    """Volume on the left, u on the right, over ``place`` (n,)."""
    ax = axes_of(ax, (7.5, 4.2))
    right_axes = ax.twinx()
    volume, u = accuracy.volume / MM3, accuracy.u / UM
    components = len(np.unique(component))
    size = size if components <= len(COMPONENT_MARKERS) else size / 3
    if 1 < components <= len(COMPONENT_MARKERS):
        legend = _draw_components(ax, right_axes, place, component, volume, u)
    else:
        legend = [
            *ax.plot(place, volume, "o", ms=size, color=BLUE, label=VOLUME_NAME),
            *right_axes.plot(place, u, "x", ms=size, mew=0.9, color=VERMILLION, label=U_NAME),
        ]
    ax.set_ylabel(VOLUME_LABEL, color=BLUE)
    right_axes.set_ylabel(f"{U_NAME} [µm]", color=VERMILLION)
    for axes in (ax, right_axes):
        axes.margins(y=0.12)
        axes.spines["top"].set_visible(False)
    ax.grid(alpha=0.3)
    columns = min(len(legend), 4)
    height = 24 + 14 * ((len(legend) - 1) // columns)
    ax.set_title(f"{accuracy.sources.arm.name}: accuracy over {over}, {accuracy.method}", fontsize=10, pad=height)
    ax.legend(handles=legend, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, fontsize=9, frameon=False)
    return ax


def _draw_components(ax: Axes, right: Axes, swivel: Array, component: Index, volume: Array, u: Array) -> list[Line2D]:
    """Both quantities with small points throughout and, now and then, a marker of the component; handles for the legend."""
    for axes, values, colour in ((ax, volume, BLUE), (right, u, VERMILLION)):
        axes.plot(swivel, values, ".", ms=1.5, color=colour)
    legend = [Line2D([], [], color=colour, lw=3, label=name) for colour, name in ((BLUE, VOLUME_NAME), (VERMILLION, U_NAME))]
    numbers = np.unique(component)
    for place, number in enumerate(numbers):
        mine = np.flatnonzero(component == number)
        mine = mine[np.argsort(swivel[mine], kind="stable")]
        step = max(1, len(mine) // MARKERS)
        some = mine[place * step // len(numbers) :: step]  # shifted, so that coincident components do not hide each other
        marker = COMPONENT_MARKERS[place]
        ax.plot(swivel[some], volume[some], marker, ms=6, color=BLUE)
        right.plot(swivel[some], u[some], marker, ms=6, mfc="none", color=VERMILLION)
        label = f"component {number}"
        legend.append(Line2D([], [], marker=marker, ms=6, color=GREY, mec=INK, ls="none", label=label))
    return legend


def plot_budget(
    accuracy: AccuracyVolume,
    by: Literal["parameter", "joint", "kind"] = "parameter",
    ax: Axes | None = None,
    most: int = 12,
) -> Axes:
    """Uncertainty budget as bars: share of the variance, with the standard uncertainty at the end of each.

    Args:
        accuracy: at one configuration or more.
        by: what the bars stand for.
        ax: axes.
        most: at most this many bars, those of the largest size (correlated parameters may have negative shares); what is
            left is one bar "rest".

    Raises:
        AacmmError: ``most`` is below 1, or ``accuracy`` has no configuration.
    """
    if most < 1 or not len(accuracy.q):
        raise AacmmError(f"most is {most} and accuracy has {len(accuracy.q)} configurations; expected at least 1 of each")
    table = _shortened(accuracy.budget(by), by, most, accuracy.sources.correlation is None)
    ax = axes_of(ax, (7.0, 0.9 + 0.32 * len(table)))
    share = 100 * table["share"].to_numpy()
    colours = [GREY if name.startswith("rest") else BLUE for name in table["name"]]
    bars = ax.barh(table["name"], share, color=colours, height=0.7)
    own = ["" if np.isnan(u) else f",  {_length_um(u * MM / UM)}" for u in table["u_mm"]]
    labels = [f"{s:.1f} %{u}" for s, u in zip(share, own, strict=True)]
    ax.bar_label(bars, labels, padding=4, fontsize=8)
    ax.invert_yaxis()
    room = 0.28 * (share.max() - min(share.min(), 0.0))  # for the labels
    ax.set_xlim(share.min() - 1.5 * room if share.min() < 0 else 0, share.max() + room)
    ax.set_xlabel("share of the variance of the position [%]; at the bars also u [µm]")
    ax.set_title(f"{accuracy.sources.arm.name} at {accuracy.sources.at}: uncertainty budget by {by}", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _shortened(budget: pd.DataFrame, by: str, most: int, independent: bool) -> pd.DataFrame:
    """Columns name, share, u_mm: the largest ``most`` rows, without those that have no part; the rest as one, without u
    (nan) where it is not the root of a sum of squares.
    """
    budget = budget[budget["share"] != 0].sort_values("share", ascending=False, key=abs, ignore_index=True, kind="stable")
    names = [("joint " if by == "joint" else "") + str(name) if pd.notna(name) else "whole arm" for name in budget[by]]
    table = pd.DataFrame({"name": names, "share": budget["share"], "u_mm": budget["u_mm"]})
    if len(table) <= most:
        return table
    kept, left = table.head(most - 1), table.iloc[most - 1 :]
    u = float(np.sqrt((left["u_mm"] ** 2).sum())) if independent else np.nan
    rest = {"name": f"rest ({len(left)})", "share": left["share"].sum(), "u_mm": u}
    return pd.concat([kept, pd.DataFrame([rest])], ignore_index=True)


def _length_um(value: float) -> str:
    return f"{value:.1f} µm" if value >= 0.1 else f"{value:.1g} µm"
