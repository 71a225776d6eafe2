"""What surrounds every scene: background, light, a grid of known size, the axes of the base."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.report.scenes.legend import Swatch
from aacmm_pin.report.scenes.meshes import flat, lines, rod
from aacmm_pin.report.scenes.scene import Scene

CELL = 0.1
"""Side of a cell of the grid [m]."""
MOST_CELLS = 40
"""Cells along a side of the grid; where more would be needed, each is ten times as long."""
AXIS = 0.1
"""Length of the drawn axes, in sizes of the scene."""
AXES = {"x": "#d62728", "y": "#2ca02c", "z": "#1f5fbf"}


def set_stage(scene: Scene, points: Array) -> list[Swatch]:
    """Draw the surroundings of ``points`` (n, 3) [m].

    Returns:
        What they are, for the legend.
    """
    scene["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    scene["/Background"].set_property("bottom_color", [0.90, 0.92, 0.94])
    scene["/Axes"].set_property("visible", False)
    scene["/Grid"].set_property("visible", False)
    cell = _draw_grid(scene, points)
    _draw_axes(scene, AXIS * float(np.ptp(points, axis=0).max()))
    stripes = ", ".join(f"{colour} {33 * i}% {33 * (i + 1)}%" for i, colour in enumerate(AXES.values()))
    return [
        Swatch("#b4bac2", f"base plane z = 0, one cell {cell / MM:g} mm", "line"),
        Swatch(f"linear-gradient(to right, {stripes})", "axes x, y, z of the base", "line"),
    ]


def _draw_grid(scene: Scene, points: Array) -> float:
    """Lines in the plane z = 0 below and above all points; the side of a cell [m]."""
    flat_points = np.vstack([points[:, :2], np.zeros((1, 2))])
    cell = CELL
    while np.ptp(flat_points, axis=0).max() / cell > MOST_CELLS:
        cell *= 10
    low, high = np.floor(flat_points.min(axis=0) / cell), np.ceil(flat_points.max(axis=0) / cell)
    pairs = []
    for along in (0, 1):
        for at in np.arange(low[1 - along], high[1 - along] + 1):
            pair = np.zeros((2, 3))
            pair[:, 1 - along] = at
            pair[:, along] = low[along], high[along]
            pairs.append(pair)
    scene["stage/grid"].set_object(lines(cell * np.array(pairs), "#9aa3ad", 0.55))
    return cell


def _draw_axes(scene: Scene, length: float) -> None:
    for axis, (name, colour) in zip(np.eye(3), AXES.items(), strict=True):
        for part, start, end, radius, tip in (
            ("shaft", 0.0, 0.8, 0.025, 0.025),
            ("head", 0.8, 1.0, 0.07, 0.0),
        ):
            shape, placement = rod(length * start * axis, length * end * axis, length * radius, length * tip)
            path = f"stage/base {name}/{part}"
            scene[path].set_object(shape, flat(colour))
            scene[path].set_transform(placement)
