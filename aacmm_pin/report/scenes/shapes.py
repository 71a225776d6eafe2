"""Materials and shapes that meshcat draws: cylinders between points, thin prisms along lines."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from meshcat.geometry import Cylinder, MeshBasicMaterial, MeshPhongMaterial, TriangularMeshGeometry

from aacmm_pin._support.checks import Array

SIDES = 6
"""Corners of the section of a prism."""


def colour_number(colour: str) -> int:
    """A colour as three.js wants it."""
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return (red << 16) + (green << 8) + blue


def solid(colour: str, opacity: float = 1.0) -> Any:
    """Material of a body: shaded by the lights of the scene."""
    return MeshPhongMaterial(
        color=colour_number(colour), opacity=opacity, shininess=40, depthWrite=opacity == 1.0, flatShading=opacity != 1.0
    )


def flat(colour: str = "white", opacity: float = 1.0, *, by_vertex: bool = False) -> Any:
    """Material of data: exactly the colour that the legend shows, whatever the light."""
    return MeshBasicMaterial(color=colour_number(colour), opacity=opacity, vertexColors=by_vertex)


def ahead(colour: str, opacity: float = 0.999) -> Any:
    """Material of what has to be seen even where it is inside the arm: drawn last, whatever stands before it."""
    options = {"transparent": True, "side": 0, "shininess": 40, "depthTest": False, "depthWrite": False}
    return MeshPhongMaterial(color=colour_number(colour), opacity=opacity, **options)


def placed_at(points: Array) -> Array:
    """Placements with their origins at ``points`` (n, 3) [m]: (n, 4, 4)."""
    placements = np.tile(np.eye(4), (len(points), 1, 1))
    placements[:, :3, 3] = points
    return placements


def rod(start: Array, end: Array, radius: float, end_radius: float | None = None) -> tuple[Any, Array]:
    """A cylinder from ``start`` to ``end`` (3,) [m], or a cone with another radius there, and its placement (4, 4)."""
    along = end - start
    length = float(np.linalg.norm(along))
    shape = Cylinder(length, radiusBottom=radius, radiusTop=radius if end_radius is None else end_radius)
    across, beside = _sections(along[None])
    placement = placed_at((start + end)[None] / 2)[0]
    placement[:3, :3] = np.column_stack([across[0], along / length, -beside[0]])  # three.js draws cylinders along y
    return shape, placement


def prisms(start: Array, end: Array, radius: float, end_radius: float | None = None, colours: Array | None = None) -> Any:
    """Thin prisms from ``start`` to ``end`` (n, 3) [m], pyramids where ``end_radius`` is zero.

    Six vertices about each start are followed by six about its end; ``colours`` (n, 2, 3) in [0, 1] are those of both.
    """
    across, beside = _sections(end - start)
    turn = np.arange(SIDES)[:, None] * (2 * np.pi / SIDES)
    ring = across[:, None] * np.cos(turn) + beside[:, None] * np.sin(turn)
    far = radius if end_radius is None else end_radius
    vertices = np.stack([start[:, None] + radius * ring, end[:, None] + far * ring], axis=1)  # (n, 2, 6, 3)
    corner = np.arange(SIDES)
    after = (corner + 1) % SIDES
    one = np.vstack(
        [np.column_stack([corner, after, corner + SIDES]), np.column_stack([after, after + SIDES, corner + SIDES])]
    )
    faces = one + 2 * SIDES * np.arange(len(start))[:, None, None]
    painted = None if colours is None else np.repeat(colours.reshape(-1, 3), SIDES, axis=0)
    return TriangularMeshGeometry(vertices.reshape(-1, 3), faces.reshape(-1, 3), painted)


def _sections(along: Array) -> tuple[Array, Array]:
    """Two unit vectors across each direction (n, 3), which with it are right-handed."""
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
    return across, np.cross(along, across)
