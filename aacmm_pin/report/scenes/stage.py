"""What scenes share: shapes and materials, ground, grid and axes, and texts of a posture."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from meshcat.geometry import (
    Cylinder,
    MeshBasicMaterial,
    MeshPhongMaterial,
    Sphere,
    TriangularMeshGeometry,
)
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, outside_limits
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import VERMILLION
from aacmm_pin.report.scenes.scene import Scene

TIP_COLOUR = "#a3123a"
AXES_GRADIENT = "linear-gradient(to right, red 33%, lime 33% 66%, blue 66%)"
ELEVATION, ANGLED = 18 * DEG, 35 * DEG
"""Of the camera: above the horizontal, and beside the direction in which the arm reaches."""
SIGHT_DIRECTIONS = np.array([*product(range(-2, 3), repeat=3)])
"""Directions in which to search for the outermost points (125, 3)."""
ROOM_ROUND_ARM = 5.0
"""Margin in radii of a tube around the arm's lines, for joints, foot and meshes."""
CELL, CELLS = 0.5, 40
"""Side of a cell of meshcat's grid [m], and cells along each side."""
TUBE_SIDES = 6
"""Corners of a prism's section."""


def stage(title: str, caption: str, lines: ArmLines, points: Array, targets: Array) -> Scene:
    """A scene with background, grid and axes around ``points`` (n, 3) [m] of an arm and its data.
    The camera looks past the ``targets`` (k, 3) [m] back to the base, a little from the side.
    """
    scene = Scene(title, caption)
    scene["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    scene["/Background"].set_property("bottom_color", [0.90, 0.92, 0.94])
    cell = 0.1  # [m]; ten times as long where so many cells do not reach all points
    while np.abs(points[:, :2]).max() > CELLS / 2 * cell:
        cell *= 10
    _scale(scene["/Grid"], cell / CELL)
    scene["/Grid"].set_property("color", [1.1, 1.1, 1.1, 0.45])
    _scale(scene["/Axes"], 0.2 * size_of(points))
    scene.explain(AXES_GRADIENT, "axes x, y, z of the base", "line")
    scene.explain("#b4bac2", f"base plane z = 0 (grid of {cell / MM:g} mm)", "line")
    scene.explain(TIP_COLOUR, "tip")
    x, y, _ = targets.mean(axis=0)
    azimuth, level = np.arctan2(y, x) + ANGLED, np.cos(ELEVATION)
    # One direction at a time: the points may be hundreds of thousands.
    outermost = np.unique([(points @ sight).argmax() for sight in SIGHT_DIRECTIONS])
    scene.view = {
        "points": points[outermost],
        "direction": [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(ELEVATION)],
        "room": ROOM_ROUND_ARM * lines.radius,
    }
    return scene


def _scale(node: Any, size: float) -> None:
    node.set_transform(np.diag([size, size, size, 1.0]))


def size_of(points: Array) -> float:
    """The longest side of the box around ``points`` (n, 3) [m]."""
    return float(np.ptp(points, axis=0).max())


def put(node: Any, shape: Any, placement: Array, material: Any) -> None:
    """Draw a shape at a placement (4, 4)."""
    node.set_object(shape, material)
    node.set_transform(placement)


def draw_ball(scene: Scene, path: str, what: str, radius: float, place: Array) -> None:
    """Draw a ball at ``place`` (3,) [m] that nothing hides."""
    put(scene[path], Sphere(radius), placed_at(place), in_front(VERMILLION, 0.85))
    scene.explain(VERMILLION, what)


def place_text(point: Array) -> str:
    """Coordinates as text."""
    x, y, z = point / MM
    return f"{x:.1f}, {y:.1f}, {z:.1f} mm"


def joint_texts(arm: Arm, q: Array) -> dict[str, list[str]]:
    """Values of the joints (n, nq) as text, and which joints are outside their ``limits``."""
    texts = {}
    for joint, (values, slides) in enumerate(zip(q.T, arm.chain.prismatic, strict=True), start=1):
        scale, unit = (MM, " mm") if slides else (DEG, "°")
        texts[f"joint {joint}"] = [f"{value:.2f}{unit}" for value in values / scale]
    joints = [", ".join(map(str, np.flatnonzero(row) + 1)) for row in outside_limits(q, arm.limits)]
    texts["limits"] = [f"outside: joint {numbers}" if numbers else "within" for numbers in joints]
    return texts


# --- shapes and materials


def solid(colour: str, opacity: float = 1.0, **more: Any) -> Any:
    """Material of a body, shaded by the lights of the scene."""
    number, opaque = int(colour[1:], 16), opacity == 1.0
    settings = {"shininess": 40, "depthWrite": opaque} | more
    return MeshPhongMaterial(color=number, opacity=opacity, **settings)


def in_front(colour: str, opacity: float) -> Any:
    """Material that nothing hides, drawn last."""
    return solid(colour, opacity, side=0, depthTest=False)


def by_vertex() -> Any:
    """Material of data: exactly the colours of the legend, without light."""
    return MeshBasicMaterial(vertexColors=True)


def placed_at(points: Array) -> Array:
    """Placements with their origins at ``points`` (…, 3) [m]: (…, 4, 4)."""
    placements = np.tile(np.eye(4), (*points.shape[:-1], 1, 1))
    placements[..., :3, 3] = points
    return placements


def rod(start: Array, end: Array, radius: float) -> tuple[Any, Array]:
    """A cylinder from ``start`` to ``end`` (3,) [m], and its placement (4, 4)."""
    placement = placed_at((start + end) / 2)
    placement[:3, :3] = _toward(end - start)
    return Cylinder(float(np.linalg.norm(end - start)), radius), placement


def prisms(
    start: Array,
    end: Array,
    radius: float | Array,
    *,
    point: bool = False,
    colours: Array | None = None,
) -> Any:
    """Thin prisms from ``start`` to ``end`` (n, 3) [m], or pyramids with their ``point`` there; one
    ``radius`` or (n,) [m], and ``colours`` (n, 2, 3) in [0, 1] of both ends.
    """
    corner = np.arange(TUBE_SIDES)
    angle = corner * (2 * np.pi / TUBE_SIDES)
    section = np.column_stack([np.cos(angle), np.zeros(TUBE_SIDES), np.sin(angle)])
    rings = np.array([section @ _toward(direction).T for direction in end - start])
    rings *= np.reshape(radius, (-1, 1, 1))
    # Six vertices about each start, then six about its end: (n, 2, 6, 3).
    end_rings = np.zeros_like(rings) if point else rings
    vertices = np.stack([start[:, None] + rings, end[:, None] + end_rings], axis=1)
    next_corner = np.roll(corner, -1)
    lower = np.column_stack([corner, next_corner, corner + TUBE_SIDES])
    upper = np.column_stack([next_corner, next_corner + TUBE_SIDES, corner + TUBE_SIDES])
    first_vertex = 2 * TUBE_SIDES * np.arange(len(start))
    faces = np.vstack([lower, upper]) + first_vertex[:, None, None]
    if colours is not None:
        colours = np.repeat(colours.reshape(-1, 3), TUBE_SIDES, axis=0)
    return TriangularMeshGeometry(vertices.reshape(-1, 3), faces.reshape(-1, 3), colours)


def _toward(direction: Array) -> Array:
    """Rotation (3, 3) of y, the axis of cylinders in three.js, to a direction (3,)."""
    if not direction.any():
        return np.eye(3)
    rotation, _ = Rotation.align_vectors(direction[None], np.eye(3)[[1]])
    return np.asarray(rotation.as_matrix())
