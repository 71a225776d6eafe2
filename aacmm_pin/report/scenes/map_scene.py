"""A map of the workspace in its half-plane, with the arm reaching into its cells."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from meshcat.geometry import TriangularMeshGeometry

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy import WorkspaceMap
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.accuracy_plots import OUTSIDE_LIMITS, QUANTITIES
from aacmm_pin.report.plots.style import VOLUME_COLOURS, some_of
from aacmm_pin.report.scenes.scene import ColourBar, Frames, Scene, View
from aacmm_pin.report.scenes.stage import (
    ROOM_ROUND_ARM,
    Bodies,
    draw_ball,
    flat,
    joint_texts,
    moving,
    on_slider,
    placed_at,
    stage,
)

MOST_MAP_FRAMES = 240
"""Cells on the slider, evenly selected."""
PER_SECOND = 4.0
"""Cells per second: postures of successive cells differ widely."""
SIDE, HEIGHT = -55 * DEG, 14 * DEG
"""Azimuth and elevation of the camera; x grows to the right."""


def map_scene(workspace_map: WorkspaceMap, model: GivenModel) -> Scene:
    """Make a scene of the half-plane with cells coloured by comprehensive accuracy; the wrist moves
    from cell to cell.

    Raises:
        AacmmError: the map is of another arm, or no cell has a posture within limits.
    """
    arm, data = ErrorModel.arm_of(model), workspace_map.data
    if data.attrs["arm"] != arm.name or data.sizes["joint"] != arm.nq:
        raise AacmmError(
            f"the map is of {data.attrs['arm']} with {data.sizes['joint']} joints, and the arm "
            f"is {arm}; expected the arm of the map"
        )
    reachable = data["reachable"].values.astype(bool)
    values = np.where(reachable, data["comprehensive_mm3"].values, np.nan)
    q_of_cells = data["best_theta_deg"].values * DEG
    works = np.isfinite(q_of_cells).all(axis=2) & np.isfinite(values)
    if not works.any():
        raise AacmmError(
            f"{workspace_map}: no cell has a posture within limits; expected one or more"
        )
    bar = ColourBar.of(QUANTITIES["comprehensive_mm3"].label, values, VOLUME_COLOURS)
    x, z = np.nonzero(works)
    in_turn = np.lexsort([np.where(x % 2, -z, z), x])  # column by column, up and down by turns
    cells = tuple(index[some_of(in_turn, MOST_MAP_FRAMES)] for index in (x, z))
    q, points, bodies = q_of_cells[cells], _centres(workspace_map)[cells], Bodies(arm)

    corners, outline = _corners(workspace_map), bodies.outline(q)
    everything = np.vstack([corners[reachable].reshape(-1, 3), outline])
    scene = stage(
        f"{arm.name}: comprehensive accuracy volume",
        _caption(workspace_map),
        bodies,
        everything,
        points,
    )
    scene.view = View(everything, SIDE, HEIGHT, ROOM_ROUND_ARM * bodies.radius)
    scene.bar = bar
    shown = "cells with a posture within the joint limits, column by column"
    scene.notes.insert(0, on_slider(len(q), len(x), shown))
    draw_ball(scene, "point", "wrist at the centre of a cell", 0.75 * bodies.radius, points[0])
    inside, outside = np.isfinite(values), reachable & np.isnan(values)
    _draw_cells(scene, "cells", corners[inside], bar.colours(values[inside]))
    if outside.any():
        pink = np.tile(to_rgb(OUTSIDE_LIMITS), (outside.sum(), 1))
        _draw_cells(scene, "outside limits", corners[outside], pink)
        scene.explain(OUTSIDE_LIMITS, "in reach, no posture within the joint limits", "area")
    texts = {
        "x of the cell": [f"{x / MM:.1f} mm" for x in points[:, 0]],
        "z of the cell": [f"{z / MM:.1f} mm" for z in points[:, 2]],
        "comprehensive": [f"{value:.4g} mm³" for value in values[cells]],
        **joint_texts(arm, q),
    }
    scene.frames = Frames(
        moving(bodies, q, scene) | {"point": placed_at(points)},
        texts,
        bar.colours(values[cells]),
        start=int(np.nanargmin(values[cells])),
        per_second=PER_SECOND,
    )
    return scene


def _caption(map_: WorkspaceMap) -> str:
    x, z = map_.axes
    left_out = ", ".join(map_.not_included)
    without = f" The accuracy does not include {left_out}." if left_out else ""
    return (
        "The map covers positions of the wrist in the half-plane y = 0, with "
        f"{x.size} × {z.size} cells of {map_.sectors} sectors. The scene "
        "does not show cells that the arm cannot reach. In each cell, the arm has the posture with "
        f"the smallest accuracy volume.{without}"
    )


def _centres(map_: WorkspaceMap) -> Array:
    """Centres of the cells (nx, nz, 3) [m]."""
    x, z = np.meshgrid(*map_.axes, indexing="ij")
    return np.stack([x, np.zeros_like(x), z], axis=2) * MM


def _corners(map_: WorkspaceMap) -> Array:
    """Corners of the cells in order (nx, nz, 4, 3) [m]."""
    x0, x1, z0, z1 = map_.data.attrs["extent_mm"]
    x, z = map_.axes
    width = (x1 - x0) / x.size
    height = (z1 - z0) / z.size
    half = np.array([width, 0.0, height]) * MM / 2
    square = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    return np.asarray(_centres(map_)[:, :, None] + half * square)


def _draw_cells(scene: Scene, name: str, corners: Array, colours: Array) -> None:
    first = 4 * np.arange(len(corners))
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + first[:, None, None]
    painted = np.repeat(colours, 4, axis=0)
    mesh = TriangularMeshGeometry(corners.reshape(-1, 3), faces.reshape(-1, 3), painted)
    scene[f"map/{name}"].set_object(mesh, flat(opacity=0.94, by_vertex=True))
