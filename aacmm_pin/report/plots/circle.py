"""The arm at a point."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.postures.configurations import ConfigurationCircle
from aacmm_pin.report.plots.style import BLUE, GREY, INK, VERMILLION, VOLUME_COLOURS, VOLUME_LABEL, axes_3d, round_down

TUBE_WIDTH = 4.5
"""Width at which tubes of the arm are drawn [points]."""
TUBE_COLOURS = colormaps["Blues"]
BASE_LINE = 0.4
"""Half the length at which joint axis 1 is drawn, in lengths of the longest tube."""


def plot_circle(
    circle: ConfigurationCircle, accuracy: AccuracyVolume | None = None, postures: int = 5, ax: Axes3D | None = None
) -> Axes3D:
    """The path of the elbow round the working point, and the arm in a few of its postures.

    Args:
        circle: every configuration at the point.
        accuracy: colours the path; for the configurations within limits.
        postures: number of postures drawn, evenly among the configurations within limits (or among all, where none is).
        ax: three-dimensional axes.

    Raises:
        ShapeError: ``accuracy`` was worked out for other configurations.
        AacmmError: ``ax`` is not three-dimensional.
    """
    ax = axes_3d(ax)
    ax.computed_zorder = False
    inside = np.flatnonzero(circle.within_limits) if accuracy is None else paired(circle, accuracy)
    pool = inside if len(inside) else np.arange(len(circle))
    chosen = pool[np.unique(np.linspace(0, len(pool), postures, endpoint=False, dtype=np.intp))] if len(pool) else pool
    drawn = _draw_base(ax, circle)
    if len(circle):
        volume = None if accuracy is None else accuracy.volume / MM3
        drawn += [_draw_postures(ax, circle, chosen), *_draw_elbow(ax, circle, inside, volume)]
    drawn.append(_draw_point(ax, circle))
    _frame(ax, circle, chosen)
    ax.set_title(_title(circle), fontsize=10, pad=-6)
    ax.legend(handles=drawn, loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3, fontsize=8, frameon=False)
    return ax


def _title(circle: ConfigurationCircle) -> str:
    x, y, z = circle.point / MM
    where = f"{circle.arm.name}: {circle.at} at ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    if not len(circle):
        return f"{where}\nout of reach"
    return f"{where}\n{circle.within_limits.sum()} of {len(circle)} configurations within limits"


def _frame(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> None:
    """Labels, one scale for all axes, and room for all that is drawn; the camera looks past the point to the shoulder."""
    shoulder = circle.components.swivel.shoulder
    points = [circle.components.swivel.elbow(circle.q), circle.point[None, :], _base_line(circle)]
    points += [_skeleton(circle, q)[1] for q in circle.q[chosen]]
    low, high = (extreme(np.concatenate(points) / MM, axis=0) for extreme in (np.min, np.max))
    half = np.maximum((high - low) / 2, 0.3 * (high - low).max()) + 10.0
    middle, step = (low + high) / 2, round_down(2 * float(half.max()) / 4)
    for name, m, h in zip("xyz", middle, half, strict=True):
        getattr(ax, f"set_{name}lim")(m - h, m + h)
        getattr(ax, f"{name}axis").set_major_locator(MultipleLocator(step))
        getattr(ax, f"set_{name}label")(f"{name} [mm]", labelpad=8)
    ax.set_box_aspect(half, zoom=0.98)
    ax.tick_params(labelsize=8)
    x, y, _ = circle.point - shoulder
    ax.view_init(elev=18, azim=float(np.arctan2(y, x)) / DEG + 35)


def _base_line(circle: ConfigurationCircle) -> Array:
    """Two points of joint axis 1, about the shoulder, (2, 3) [m]."""
    dh = circle.components.swivel.dh
    _, _, z, _ = dh.axes(np.zeros((1, dh.nq)), row=1)
    length = BASE_LINE * max(float(np.abs(dh.a).max()), float(np.abs(dh.d).max()))
    along = z[0 if dh.standard else 1, :, 0]
    return np.asarray(circle.components.swivel.shoulder + np.array([[-length], [length]]) * along)


def _draw_base(ax: Axes3D, circle: ConfigurationCircle) -> list[Line2D]:
    """Joint axis 1 and the shoulder on it."""
    axis: Line2D
    shoulder: Line2D
    (axis,) = ax.plot(*_base_line(circle).T / MM, color=INK, lw=1.0, ls="-.", zorder=3, label="joint axis 1")
    place = circle.components.swivel.shoulder[:, None] / MM
    (shoulder,) = ax.plot(*place, marker="s", ms=7, color=INK, ls="none", zorder=5, label="base (shoulder)")
    return [axis, shoulder]


def _draw_point(ax: Axes3D, circle: ConfigurationCircle) -> Line2D:
    style: dict[str, Any] = {"marker": "*", "ms": 16, "mfc": VERMILLION, "mec": "white", "ls": "none"}
    point: Line2D
    (point,) = ax.plot(*circle.point[:, None] / MM, **style, zorder=10, label="working point")
    return point


def _draw_postures(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> Line2D:
    """Tubes from light to dark, so that each posture can be followed; the artist of the legend."""
    round_: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round"}
    shades = TUBE_COLOURS(np.linspace(0.3, 0.75, len(chosen)))
    for q, shade in zip(circle.q[chosen], shades, strict=True):
        joints, corners = _skeleton(circle, q)
        ax.plot(*corners.T / MM, color=shade, lw=TUBE_WIDTH, zorder=4, **round_)
        ax.plot(*joints.T / MM, color=INK, marker="o", ms=3.5, ls="none", zorder=5)
    middle = shades[len(shades) // 2]
    return Line2D([], [], color=middle, lw=TUBE_WIDTH, marker="o", ms=3.5, mfc=INK, mec=INK, label="arm to the point")


def _skeleton(circle: ConfigurationCircle, q: Array) -> tuple[Array, Array]:
    """Origins of the frames from the base to the working point, and the corners of the line along every d and a [m]."""
    dh = circle.components.swivel.dh
    row = circle.arm.dh_row(circle.at) or dh.rows
    x, _, z, o = (axis[:, :, 0] for axis in dh.axes(q[None, :], row=row))
    corners = [o[0]]
    for i in range(row):
        corners += [o[i] + (dh.d[i] * z[i] if dh.standard else dh.a[i] * x[i]), o[i + 1]]
    return o, np.array(corners)


def _draw_elbow(ax: Axes3D, circle: ConfigurationCircle, inside: Index, volume: Array | None) -> list[Line2D]:
    """The elbow's path: coloured by ``volume`` (n,) [mm³] between configurations within limits, elsewhere grey."""
    elbow = circle.components.swivel.elbow(circle.q) / MM
    start, end = _neighbours(circle)
    pieces = np.stack([elbow[start], elbow[end]], axis=1)
    values = np.full(len(circle), np.nan)
    values[inside] = 0.0 if volume is None else volume
    value = (values[start] + values[end]) / 2
    works = np.isfinite(value)
    legend = []
    if works.any():
        style: dict[str, Any] = {"colors": BLUE} if volume is None else {"cmap": VOLUME_COLOURS, "array": value[works]}
        path = Line3DCollection(pieces[works], linewidths=3.5, zorder=6, **style)
        ax.add_collection3d(path)
        colour = BLUE if volume is None else path.get_cmap()(0.5)
        legend.append(Line2D([], [], color=colour, lw=3.5, label="elbow, within limits"))
        if volume is not None:
            ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
    if not works.all():
        ax.add_collection3d(Line3DCollection(pieces[~works], colors=GREY, linewidths=1.0, zorder=2))
        legend.append(Line2D([], [], color=GREY, lw=1.0, label="elbow, outside limits"))
    return legend


def _neighbours(circle: ConfigurationCircle) -> tuple[Index, Index]:
    """Numbers of the configurations at both ends of every piece of the components, closed or open."""
    start, end = [], []
    for number, curve in enumerate(circle.components.curves, start=1):
        mine = np.flatnonzero(circle.component == number)
        pieces = len(mine) if curve.closed else len(mine) - 1
        start.append(mine[:pieces])
        end.append(np.roll(mine, -1)[:pieces])
    return np.concatenate(start), np.concatenate(end)
