"""The arm at a point."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy import AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import ConfigurationCircle, PosturesAtPoint
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    plain,
)

TUBE_WIDTH = 4.5
"""Width at which tubes of the arm are drawn [points]."""
TUBE_COLOURS = colormaps["Blues"]
BASE_LINE = 0.4
"""Half the length at which joint axis 1 is drawn, in lengths of the longest tube."""
NEXT = 3.0
"""The ends of a line that nothing calls closed are joined where they are no farther apart than so
many usual steps.
"""


@plain
def plot_circle(
    circle: ConfigurationCircle,
    accuracy: AccuracyVolume | None = None,
    postures: int = 5,
    ax: Axes3D | None = None,
) -> Axes3D:
    """Plot the path of the elbow around the point, and the arm in some postures.

    Args:
        circle: the configuration circle.
        accuracy: accuracy of the postures within limits, for the colours of the path.
        postures: number of postures to draw, evenly spaced among the postures within limits; if
            none is within limits, among all.
        ax: three-dimensional axes.

    Raises:
        ShapeError: ``accuracy`` is for other postures.
        AacmmError: ``ax`` is not three-dimensional.
    """
    if ax is None:
        ax = plt.figure(figsize=(7.2, 6.6), layout="constrained").add_subplot(projection="3d")
    if not isinstance(ax, Axes3D):
        raise AacmmError(
            f"ax is {type(ax).__name__}; expected three-dimensional axes: "
            "add_subplot(projection='3d')"
        )
    ax.computed_zorder = False
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    elbow = circle.components.swivel.elbow(circle.q)
    drawn = [_draw_base(ax, circle), elbow, circle.point[None]]
    if len(circle):
        drawn.append(
            _draw_postures(
                ax, circle, evenly(inside if len(inside) else np.arange(len(circle)), postures)
            )
        )
        _draw_elbow(ax, circle, elbow, inside, None if accuracy is None else accuracy.volume / MM3)
    star: dict[str, Any] = {
        "marker": "*",
        "ms": 16,
        "mfc": VERMILLION,
        "mec": "white",
        "ls": "none",
        "zorder": 10,
    }
    ax.plot(*circle.point[:, None] / MM, label="working point", **star)
    _frame(ax, circle, np.concatenate(drawn) / MM)
    x, y, z = circle.point / MM
    found = (
        f"{circle.within_limits.sum()} of {len(circle)} postures within limits"
        if len(circle)
        else "out of reach"
    )
    ax.set_title(
        f"{circle.arm.name}: {circle.at} at ({x:.1f}, {y:.1f}, {z:.1f}) mm\n{found}",
        fontsize=10,
        pad=-14,
    )
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3, fontsize=8, frameon=False)
    return ax


def evenly(members: Index, count: int) -> Index:
    """So many of the members, evenly spread."""
    places = np.linspace(0, len(members), count, endpoint=False, dtype=np.intp)
    return members[np.unique(places)]


def neighbours(circle: PosturesAtPoint, members: Index, path: Array) -> Index:
    """Numbers of the configurations at both ends of every piece of the ``path`` (n, 3) through the
    members: (pieces, 2).
    """
    pairs = [np.empty((0, 2), dtype=np.intp)]
    for number in np.unique(circle.component[members]):
        along = members[circle.component[members] == number]
        if _closed(circle, int(number), path[along]):
            along = np.append(along, along[0])
        pairs.append(np.column_stack([along[:-1], along[1:]]))
    return np.concatenate(pairs)


def _closed(circle: PosturesAtPoint, number: int, line: Array) -> bool:
    if isinstance(circle, ConfigurationCircle):
        return bool(circle.components.curves[number - 1].closed)
    if len(line) <= 2:
        return False
    usual = np.median(np.linalg.norm(np.diff(line, axis=0), axis=1))
    return bool(np.linalg.norm(line[-1] - line[0]) <= NEXT * usual)


def _frame(ax: Axes3D, circle: ConfigurationCircle, points: Array) -> None:
    """Labels, one scale for all axes, and room for the points [mm]; the camera looks past the point
    to the shoulder.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2, high - low
    half = np.maximum(extent / 2, 0.3 * extent.max()) + 10.0
    ticks = np.maximum(2, np.round(5 * half / half.max()).astype(int))
    for k, name in enumerate("xyz"):
        getattr(ax, f"set_{name}lim")(middle[k] - half[k], middle[k] + half[k])
        getattr(ax, f"set_{name}label")(f"{name} [mm]", labelpad=8)
        getattr(ax, f"{name}axis").set_major_locator(MaxNLocator(ticks[k]))
    ax.set_box_aspect(half, zoom=0.98)
    ax.tick_params(labelsize=8)
    x, y, _ = circle.point - circle.components.swivel.shoulder
    azimuth = float(np.arctan2(y, x)) / DEG
    ax.view_init(elev=18, azim=azimuth + 35)


def _draw_base(ax: Axes3D, circle: ConfigurationCircle) -> Array:
    """Joint axis 1 and the shoulder on it; the ends of the line (2, 3) [m]."""
    dh, shoulder = circle.components.swivel.dh, circle.components.swivel.shoulder
    rotation, _ = dh.chain.walk(np.zeros((1, dh.nq)))
    axis = rotation[dh.chain.moving_axes()[0], 0, :, 2]
    length = BASE_LINE * float(np.abs([dh.a, dh.d]).max())
    along = length * axis
    line = np.array([shoulder - along, shoulder + along])
    ax.plot(*line.T / MM, color=INK, lw=1.0, ls="-.", zorder=3, label="joint axis 1")
    ax.plot(
        *shoulder[:, None] / MM,
        marker="s",
        ms=7,
        color=INK,
        ls="none",
        zorder=5,
        label="base (shoulder)",
    )
    return np.asarray(line)


def _draw_postures(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> Array:
    """The arm from the base to the working point, from light to dark, so that each posture can be
    followed; its corners.
    """
    lines = ArmLines(circle.arm)
    last = circle.arm.dh_row(circle.at) or circle.components.swivel.dh.rows
    joints = lines.placements(circle.q[chosen])[1 : last + 1, :, :3, 3]
    style: dict[str, Any] = {
        "lw": TUBE_WIDTH,
        "zorder": 4,
        "solid_capstyle": "round",
        "solid_joinstyle": "round",
    }
    shades, drawn = TUBE_COLOURS(np.linspace(0.3, 0.75, len(chosen))), []
    for k, corners in enumerate(lines.corners(circle.q[chosen])):
        at_point = int(np.linalg.norm(corners - circle.point, axis=1).argmin())
        line = corners[: at_point + 1]
        label = "arm to the point" if k == len(chosen) // 2 else None
        ax.plot(*line.T / MM, color=shades[k], label=label, **style)
        drawn.append(line)
        ax.plot(*joints[:, k].T / MM, color=INK, marker="o", ms=3.5, ls="none", zorder=5)
    return np.concatenate(drawn)


def _draw_elbow(
    ax: Axes3D, circle: ConfigurationCircle, elbow: Array, inside: Index, volume: Array | None
) -> None:
    """The elbow's path: coloured by ``volume`` (n,) [mm³] between configurations within limits,
    elsewhere grey.
    """
    pairs = neighbours(circle, np.arange(len(circle)), elbow)
    pieces, values = elbow[pairs] / MM, np.full(len(circle), np.nan)
    values[inside] = 0.0 if volume is None else volume
    value = values[pairs].mean(axis=1)
    works = np.isfinite(value)
    if works.any():
        style: dict[str, Any] = (
            {"colors": BLUE} if volume is None else {"cmap": VOLUME_COLOURS, "array": value[works]}
        )
        path = Line3DCollection(
            pieces[works], linewidths=3.5, zorder=6, label="elbow, within limits", **style
        )
        ax.add_collection3d(path)
        if volume is not None:
            ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
    if not works.all():
        style = {"colors": GREY, "linewidths": 1.0, "zorder": 2, "label": "elbow, outside limits"}
        ax.add_collection3d(Line3DCollection(pieces[~works], **style))
