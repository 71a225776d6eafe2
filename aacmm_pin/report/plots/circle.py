"""The arm at a point."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import colormaps
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
    some_of,
)

TUBE_WIDTH = 4.5
"""Width of tubes [points]."""
TUBE_COLOURS = colormaps["Blues"]
BASE_LINE = 0.4
"""Half length of joint axis 1, in lengths of the longest tube."""


@plain
def plot_circle(
    circle: ConfigurationCircle,
    accuracy: AccuracyVolume | None = None,
    postures: int = 5,
    ax: Axes3D | None = None,
) -> Axes3D:
    """Plot the path of the elbow around the point, and the arm in some postures.

    Args:
        accuracy: of the postures within limits, for the colours of the path.
        postures: number of postures to draw, within limits if possible.

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
    drawn = [_draw_base(ax, circle), circle.point[None]]
    reach = "out of reach"
    if len(circle):
        reach = f"{circle.within_limits.sum()} of {len(circle)} postures within limits"
        chosen = some_of(inside if len(inside) else np.arange(len(circle)), postures)
        drawn += [*_draw_postures(ax, circle, chosen), circle.components.swivel.elbow(circle.q)]
        _draw_elbow(ax, circle, inside, accuracy)
    point = circle.point[:, None] / MM
    ax.plot(*point, "*", ms=16, mfc=VERMILLION, mec="white", label="working point", zorder=10)
    ax.auto_scale_xyz(*np.concatenate(drawn).T / MM)
    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ax.set_aspect("equal", adjustable="box")
    ax.locator_params(nbins=5)
    ax.tick_params(labelsize=8)
    x, y, z = circle.point / MM
    toward = circle.point - circle.components.swivel.shoulder
    # The camera looks past the point to the shoulder.
    ax.view_init(elev=18, azim=float(np.arctan2(toward[1], toward[0])) / DEG + 35)
    ax.set_title(
        f"{circle.arm.name}: {circle.at} at ({x:.1f}, {y:.1f}, {z:.1f}) mm\n{reach}", pad=-14
    )
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3)
    return ax


def neighbours(circle: PosturesAtPoint, members: Index) -> Index:
    """Numbers of the postures at both ends of each piece of the path, (pieces, 2)."""
    pairs = [np.empty((0, 2), dtype=np.intp)]
    curves = getattr(circle, "curves", ())
    if isinstance(circle, ConfigurationCircle):
        curves = circle.components.curves
    for number in np.unique(circle.component[members]):
        along = members[circle.component[members] == number]
        if curves and curves[number - 1].closed:
            along = np.append(along, along[0])
        pairs.append(np.column_stack([along[:-1], along[1:]]))
    return np.concatenate(pairs)


def _draw_base(ax: Axes3D, circle: ConfigurationCircle) -> Array:
    """Draw joint axis 1 and the shoulder; return the ends of the line."""
    dh, shoulder = circle.components.swivel.dh, circle.components.swivel.shoulder
    rotation, _ = dh.chain.at_zero
    axis = rotation[dh.chain.moving_axes()[0], :, 2]
    along = BASE_LINE * float(np.abs([dh.a, dh.d]).max()) * axis
    line = np.array([shoulder - along, shoulder + along])
    ax.plot(*line.T / MM, color=INK, lw=1.0, ls="-.", zorder=3, label="joint axis 1")
    ax.plot(*shoulder[:, None] / MM, "s", ms=7, color=INK, zorder=5, label="base (shoulder)")
    return np.asarray(line)


def _draw_postures(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> list[Array]:
    """Draw the arm from base to point, from light to dark; return its corners."""
    shades, lines = TUBE_COLOURS(np.linspace(0.3, 0.75, len(chosen))), []
    for k, corners in enumerate(ArmLines(circle.arm).corners(circle.q[chosen])):
        at_point = int(np.linalg.norm(corners - circle.point, axis=1).argmin())
        line = corners[: at_point + 1]
        ax.plot(
            *line.T / MM,
            "o-",
            color=shades[k],
            lw=TUBE_WIDTH,
            solid_capstyle="round",
            ms=3.5,
            mfc=INK,
            mec=INK,
            label="arm to the point" if k == len(chosen) // 2 else None,
            zorder=4,
        )
        lines.append(line)
    return lines


def _draw_elbow(
    ax: Axes3D, circle: ConfigurationCircle, inside: Index, accuracy: AccuracyVolume | None
) -> None:
    elbow = circle.components.swivel.elbow(circle.q)
    pairs = neighbours(circle, np.arange(len(circle)))
    pieces, values = elbow[pairs] / MM, np.full(len(circle), np.nan)
    values[inside] = 0.0 if accuracy is None else accuracy.volume / MM3
    value = values[pairs].mean(axis=1)
    works = np.isfinite(value)
    if works.any():
        label = "elbow, within limits"
        colour = BLUE if accuracy is None else None
        path = Line3DCollection(pieces[works], colors=colour, linewidths=3.5, zorder=6, label=label)
        ax.add_collection3d(path)
        if accuracy is not None:
            path.set(array=value[works], cmap=VOLUME_COLOURS)
            ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
    if not works.all():
        label = "elbow, outside limits"
        path = Line3DCollection(pieces[~works], colors=GREY, linewidths=1.0, zorder=2, label=label)
        ax.add_collection3d(path)
