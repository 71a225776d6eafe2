"""The arm at a point."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import colormaps
from mpl_toolkits.mplot3d import Axes3D

from aacmm_pin._support.checks import Index
from aacmm_pin._support.units import DEG, MM, MM3
from aacmm_pin.accuracy import AccuracyVolume, paired
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures import ConfigurationCircle
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import (
    BLUE,
    GREY,
    INK,
    VERMILLION,
    VOLUME_COLOURS,
    VOLUME_LABEL,
    evenly_selected,
    plain,
)

TUBE_WIDTH = 4.5
"""Width of tubes [points]."""
TUBE_COLOURS = colormaps["Blues"]


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
    reach = "out of reach"
    if len(circle):
        reach = f"{len(inside)} of {len(circle)} postures within limits"
        eligible = inside if len(inside) else np.arange(len(circle))
        _draw_postures(ax, circle, evenly_selected(eligible, postures))
        _draw_elbow(ax, circle, accuracy)
    shoulder, point = circle.components.swivel.shoulder / MM, circle.point / MM
    ax.plot(*shoulder[:, None], "s", ms=7, color=INK, zorder=5, label="base (shoulder)")
    ax.plot(
        *point[:, None], "*", ms=16, mfc=VERMILLION, mec="white", zorder=10, label="working point"
    )
    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ax.set_aspect("equal", adjustable="box")
    ax.locator_params(nbins=5)
    ax.tick_params(labelsize=8)
    # The camera looks past the point to the shoulder.
    x, y, _ = point - shoulder
    ax.view_init(elev=18, azim=float(np.arctan2(y, x)) / DEG + 35)
    place = ", ".join(f"{coordinate:.1f}" for coordinate in point)
    ax.set_title(f"{circle.arm.name}: {circle.at} at ({place}) mm\n{reach}", pad=-14)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3)
    return ax


def _draw_postures(ax: Axes3D, circle: ConfigurationCircle, chosen: Index) -> None:
    """Draw the arm from base to point in ``chosen`` postures, the last one darkest."""
    shades = TUBE_COLOURS(np.linspace(0.3, 0.75, len(chosen)))
    for k, corners in enumerate(ArmLines(circle.arm).corners(circle.q[chosen])):
        at_point = int(np.linalg.norm(corners - circle.point, axis=1).argmin())
        ax.plot(
            *corners[: at_point + 1].T / MM,
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


def _draw_elbow(ax: Axes3D, circle: ConfigurationCircle, accuracy: AccuracyVolume | None) -> None:
    """Draw the elbow in all postures, within limits in the colour of the accuracy."""
    elbow, within = circle.components.swivel.elbow(circle.q) / MM, circle.within_limits
    style: dict[str, Any] = {"depthshade": False, "zorder": 2}
    if not within.all():
        ax.scatter(*elbow[~within].T, s=2, color=GREY, label="elbow, outside limits", **style)
    style |= {"s": 14, "label": "elbow, within limits", "zorder": 6}
    if accuracy is None:
        ax.scatter(*elbow[within].T, color=BLUE, **style)
    else:
        volume = accuracy.volume / MM3
        path = ax.scatter(*elbow[within].T, c=volume, cmap=VOLUME_COLOURS, **style)
        ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
