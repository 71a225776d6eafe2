"""Accuracy at a point."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy import AccuracyVolume, ErrorSources, paired
from aacmm_pin.arm import Arm
from aacmm_pin.effects import row_in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import ConfigurationCircle, PosturesAtPoint, ReachingPostures
from aacmm_pin.report.numbers import length
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    U_NAME,
    VERMILLION,
    VOLUME_LABEL,
    VOLUME_NAME,
    axes_of,
    legend_below,
    plain,
)

COMPONENT_MARKERS = "os^DvP*h"
"""Shapes of the markers that distinguish closed curves."""
NOT_THERE = "no mark: no posture within limits"
GAP, MISSED = 6.0, 3.0
"""A gap is seen in the curves where no posture is for so many degrees, and for so many usual steps.
"""
ABOVE = 1.15
"""The axes end at so many times the largest value."""
MARKERS = 18
"""Number of these markers along a component."""


@plain
def plot_accuracy_of_postures(
    postures: PosturesAtPoint, accuracy: AccuracyVolume, ax: Axes | None = None
) -> Axes:
    """Plot the accuracy volume (left axis) and the standard uncertainty (right axis) of the
    postures at a point.

    The abscissa is the swivel angle. For an arm without elbow, the abscissa is the length along
    each curve of self-motion, or the number of a single posture. If two to eight components have
    postures within limits, each component has its own marker.

    Raises:
        ShapeError: ``accuracy`` is for other postures.
    """
    inside, ax = paired(postures, accuracy), axes_of(ax, (7.5, 4.2))
    left_out = not postures.within_limits.all()
    component = postures.component[inside]
    if isinstance(postures, ConfigurationCircle):
        left_out = _has_gap(postures.swivel[inside] / DEG)
        _draw_over(postures.swivel[inside] / DEG, component, accuracy, ax, left_out)
        ax.set(
            xlabel="swivel angle (elbow highest at 0°) [°]",
            xlim=(-180, 180),
            xticks=range(-180, 181, 60),
        )
    elif isinstance(postures, ReachingPostures) and not postures.single:
        _draw_over(postures.travel[inside], component, accuracy, ax, left_out)
        ax.set(xlabel="distance along the curve in joint space [rad]")
        ax.set_xlim(left=0.0)
    else:
        _draw_over(component.astype(np.float64), np.ones_like(component), accuracy, ax, left_out)
        last = int(postures.component.max())
        ax.set(xlabel="number of the posture", xlim=(0.5, last + 0.5), xticks=range(1, last + 1))
    ax.set_title(
        f"{accuracy.sources.arm.name}: accuracy of the postures, {accuracy.method}", fontsize=10
    )
    return ax


def _has_gap(swivel: Array) -> bool:
    """Whether there is a gap between swivel angles (n,) [°] somewhere in the turn, or none
    of them.
    """
    if len(swivel) < 2:
        return True
    usual = float(np.median(np.abs(np.diff(swivel))))
    ordered = np.sort(swivel)
    return bool(np.diff(ordered, append=ordered[0] + 360).max() > max(GAP, MISSED * usual))


def _draw_over(
    place: Array, component: Index, accuracy: AccuracyVolume, ax: Axes, left_out: bool
) -> None:
    """Volume on the left, u on the right, over ``place`` (n,); what is not there is explained if
    some is ``left_out``.
    """
    right, numbers = ax.twinx(), np.unique(component)
    apart = numbers if 1 < len(numbers) <= len(COMPONENT_MARKERS) else numbers[:0]
    size = 1.5 if len(numbers) > 1 else 4.0 if len(place) > 20 else 8.0
    (of_volume,) = ax.plot(
        place, accuracy.volume / MM3, "o", ms=size, color=BLUE, label=VOLUME_NAME
    )
    (of_u,) = right.plot(
        place, accuracy.u / UM, "x", ms=size, mew=0.9, color=VERMILLION, label=U_NAME
    )
    # The scales have the colours of what they are of.
    handles = [] if len(apart) else [of_volume, of_u]
    for k, number in enumerate(apart):
        mine = np.flatnonzero(component == number)
        mine = mine[np.argsort(place[mine], kind="stable")]
        step = max(1, len(mine) // MARKERS)
        # Shifted, so that coincident components do not hide each other.
        some = mine[k * step // len(numbers) :: step]
        style: dict[str, Any] = {
            "marker": COMPONENT_MARKERS[k],
            "ms": 6,
            "ls": "",
            "label": f"component {number}",
        }
        handles += ax.plot(place[some], accuracy.volume[some] / MM3, color=BLUE, **style)
        right.plot(place[some], accuracy.u[some] / UM, color=VERMILLION, mfc="none", **style)
    ax.set_ylabel(VOLUME_LABEL, color=BLUE)
    right.set_ylabel(f"{U_NAME} [µm]", color=VERMILLION)
    # From zero, so that a change by two per cent looks like one.
    ax.set_ylim(0.0, ABOVE * accuracy.volume.max(initial=0.0) / MM3 or None)
    right.set_ylim(0.0, ABOVE * accuracy.u.max(initial=0.0) / UM or None)
    ax.grid(alpha=0.3)
    legend_below(ax, handles=handles, title=NOT_THERE if left_out else None, title_fontsize=8)


@plain
def plot_budget(
    accuracy: AccuracyVolume,
    by: Literal["parameter", "joint", "kind"] = "parameter",
    ax: Axes | None = None,
    most: int = 12,
) -> Axes:
    """Plot the uncertainty budget as bars: shares of the variance, with the standard uncertainties
    as numbers.

    Args:
        accuracy: the accuracy volume of at least one posture.
        by: whether a bar is a parameter, a joint or a kind of parameter.
        ax: axes.
        most: largest number of bars, selected by absolute share; one more bar "rest" has all
            others.

    Raises:
        AacmmError: ``most`` is below 1, or ``accuracy`` has no posture.
    """
    if most < 1 or not len(accuracy.q):
        raise AacmmError(
            f"most is {most} and accuracy has {len(accuracy.q)} postures; expected at least "
            "1 of each"
        )
    table = _shortened(accuracy.budget(by), by, most, accuracy.sources)
    ax = axes_of(ax, (7.0, 0.9 + 0.32 * len(table)))
    share = 100 * table["share"]
    colours = [GREY if name.startswith("rest") else BLUE for name in table["name"]]
    bars = ax.barh(table["name"], share, color=colours, height=0.7)
    own = ["" if np.isnan(u) else f",  {length(u * MM)}" for u in table["u_mm"]]
    ax.bar_label(
        bars, [f"{s:.1f} %{u}" for s, u in zip(share, own, strict=True)], padding=4, fontsize=8
    )
    ax.invert_yaxis()
    room = 0.28 * (share.max() - min(share.min(), 0.0))  # for the labels
    ax.set_xlim(share.min() - 1.5 * room if share.min() < 0 else 0, share.max() + room)
    ax.set_xlabel("share of the variance of the position [%] (labels: share, u)")
    ax.set_title(
        f"{accuracy.sources.arm.name} at {accuracy.sources.at}: uncertainty budget by {by}",
        fontsize=10,
    )
    ax.spines[["top", "right"]].set_visible(False)
    return ax


def _shortened(budget: pd.DataFrame, by: str, most: int, sources: ErrorSources) -> pd.DataFrame:
    """Columns name, share, u_mm: the largest ``most`` rows, without those that have no part; the
    rest as one, without u (nan) where it is not the root of a sum of squares.
    """
    budget = budget[budget["share"] != 0].sort_values(
        "share", ascending=False, key=abs, ignore_index=True, kind="stable"
    )
    names = [_source_name(source, by, sources.arm) for source in budget[by]]
    table = pd.DataFrame({"name": names, "share": budget["share"], "u_mm": budget["u_mm"]})
    if len(table) <= most:
        return table
    largest, others = table.head(most - 1), table.iloc[most - 1 :]
    u = float(np.sqrt((others["u_mm"] ** 2).sum())) if sources.correlation is None else np.nan
    share = others["share"].sum()
    rest = pd.DataFrame({"name": [f"rest ({len(others)})"], "share": [share], "u_mm": [u]})
    return pd.concat([largest, rest], ignore_index=True)


def _source_name(source: Any, by: str, arm: Arm) -> str:
    """What a bar stands for: a parameter, a kind, a joint with its word; <NA> is what moves the
    whole arm.
    """
    if pd.isna(source):
        return "whole arm"
    return f"{row_in_words(source, arm)} {source}" if by == "joint" else str(source)
