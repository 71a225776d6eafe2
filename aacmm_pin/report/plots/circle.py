"""The arm at a point."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import colormaps
from mpl_toolkits.mplot3d import Axes3D

from aacmm_pin._support.arrays import Index
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
    without_latex,
)

TUBE_COLOURS = colormaps["Blues"]


@without_latex()
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
    point = circle.point / MM
    if len(circle):
        eligible = inside if len(inside) else np.arange(len(circle))
        arms = ArmLines(circle.arm).corners(circle.q[evenly_selected(eligible, postures)]) / MM
        shades = TUBE_COLOURS(np.linspace(0.3, 0.75, len(arms)))
        for corners, shade in zip(arms, shades, strict=True):
            at_point = int(np.linalg.norm(corners - point, axis=1).argmin())
            ax.plot(*corners[: at_point + 1].T, "o-", color=shade, lw=4.5, ms=3.5, mfc=INK, mec=INK)
        _draw_elbow(ax, circle, inside, accuracy)
    shoulder = circle.components.swivel.shoulder / MM
    ax.plot(*shoulder[:, None], "s", ms=7, color=INK, label="base (shoulder)")
    ax.plot(*point[:, None], "*", ms=16, mfc=VERMILLION, mec="white", label="working point")
    ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    ax.set_aspect("equal", adjustable="box")
    ax.locator_params(nbins=5)
    ax.tick_params(labelsize=8)
    # The camera looks past the point to the shoulder.
    x, y, _ = point - shoulder
    ax.view_init(elev=18, azim=float(np.arctan2(y, x)) / DEG + 35)
    place = ", ".join(f"{coordinate:.1f}" for coordinate in point)
    reach = "" if len(circle) else ", out of reach"
    ax.set_title(f"{circle.arm.name}: {circle.at} at ({place}) mm{reach}", pad=-14)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.05), ncols=3)
    return ax


def _draw_elbow(
    ax: Axes3D, circle: ConfigurationCircle, inside: Index, accuracy: AccuracyVolume | None
) -> None:
    """Draw the elbow in all postures, in the colour of the accuracy in those within limits."""
    elbow = circle.components.swivel.elbow(circle.q) / MM
    outside = np.delete(elbow, inside, axis=0)
    if len(outside):
        ax.scatter(*outside.T, s=2, color=GREY, label="elbow, outside limits")
    style: dict[str, Any] = {"s": 14, "label": "elbow, within limits"}
    if accuracy is None:
        ax.scatter(*elbow[inside].T, color=BLUE, **style)
    else:
        volume = accuracy.volume / MM3
        path = ax.scatter(*elbow[inside].T, c=volume, cmap=VOLUME_COLOURS, **style)
        ax.figure.colorbar(path, ax=ax, label=VOLUME_LABEL, shrink=0.6, pad=0.1)
