"""Meshes and placements that meshcat draws: tubes along a line, cylinders between points, hulls."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from meshcat.geometry import (
    Cylinder,
    LineBasicMaterial,
    LineSegments,
    MeshBasicMaterial,
    MeshPhongMaterial,
    PointsGeometry,
    TriangularMeshGeometry,
)
from scipy.spatial import ConvexHull

from aacmm_pin._support.checks import Array, Index

SIDES = 6
"""Corners of the section of a thin tube."""


def colour_number(colour: str) -> int:
    """A colour as three.js wants it."""
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return (red << 16) + (green << 8) + blue


def solid(colour: str, opacity: float = 1.0) -> Any:
    """Material of a body: shaded by the lights of the scene."""
    return MeshPhongMaterial(color=colour_number(colour), opacity=opacity, shininess=40, depthWrite=opacity == 1.0)


def flat(colour: str = "white", opacity: float = 1.0, *, by_vertex: bool = False) -> Any:
    """Material of data: exactly the colour that the legend shows, whatever the light."""
    return MeshBasicMaterial(color=colour_number(colour), opacity=opacity, vertexColors=by_vertex)


def ahead(colour: str, opacity: float = 0.999) -> Any:
    """Material of what has to be seen even where it is inside the arm: drawn last, whatever stands before it."""
    return MeshPhongMaterial(
        color=colour_number(colour),
        opacity=opacity,
        transparent=True,
        side=0,
        shininess=40,
        depthTest=False,
        depthWrite=False,
    )


def lines(pairs: Array, colour: str, opacity: float = 1.0) -> Any:
    """Hair lines between pairs of points (n, 2, 3) [m]."""
    points = np.asarray(pairs.reshape(-1, 3).T, dtype=np.float32)
    return LineSegments(PointsGeometry(points), LineBasicMaterial(color=colour_number(colour), opacity=opacity))


def rod(start: Array, end: Array, radius: float, end_radius: float | None = None) -> tuple[Any, Array]:
    """A cylinder from ``start`` to ``end`` (3,) [m], or a cone with another radius there, and its placement (4, 4)."""
    along = end - start
    length = float(np.linalg.norm(along))
    shape = Cylinder(length, radiusBottom=radius, radiusTop=radius if end_radius is None else end_radius)
    placement = np.eye(4)
    placement[:3, :3] = _with_y(along / length)
    placement[:3, 3] = (start + end) / 2
    return shape, placement


def _with_y(direction: Array) -> Array:
    """A rotation with the unit vector ``direction`` as its second column: three.js draws cylinders along y."""
    x = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, direction, np.cross(x, direction)])


def tube(points: Array, radius: float, colours: Array | None = None) -> Any:
    """A thin tube along the line through ``points`` (n, 3) [m], n at least 2, coloured by ``colours`` (n, 3) in [0, 1]."""
    moves = np.insert(np.linalg.norm(np.diff(points, axis=0), axis=1) > 0, 0, True)
    moves[-1] |= not moves[1:].any()  # a line of length zero keeps two points
    centre = points[moves]
    across, beside = _sections(centre)
    turn = np.arange(SIDES) * (2 * np.pi / SIDES)
    ring = across[:, None] * np.cos(turn)[:, None] + beside[:, None] * np.sin(turn)[:, None]
    vertices = (centre[:, None] + radius * ring).reshape(-1, 3)
    painted = None if colours is None else np.repeat(colours[moves], SIDES, axis=0)
    return TriangularMeshGeometry(vertices, _tube_faces(len(centre)), painted)


def _sections(centre: Array) -> tuple[Array, Array]:
    """Two directions across a line at each of its points, turned along it as little as possible."""
    pieces = np.diff(centre, axis=0)
    pieces /= np.maximum(np.linalg.norm(pieces, axis=1), 1e-300)[:, None]
    tangent = np.vstack([pieces[:1], pieces[1:] + pieces[:-1], pieces[-1:]])
    back = np.linalg.norm(tangent, axis=1) < 1e-9
    tangent[back] = np.vstack([pieces, pieces[-1:]])[back]
    tangent[~tangent.any(axis=1)] = [0.0, 0.0, 1.0]
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    across = np.empty_like(tangent)
    last = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    for i, t in enumerate(tangent):
        last = last - t * (t @ last)
        length = np.linalg.norm(last)
        last = last / length if length > 1e-9 else _with_y(t)[:, 0]
        across[i] = last
    return across, np.cross(tangent, across)


def _tube_faces(rings: int) -> Index:
    corner = np.arange(SIDES)
    beside = (corner + 1) % SIDES
    first = np.concatenate(
        [
            np.column_stack([corner, beside, corner + SIDES]),
            np.column_stack([beside, beside + SIDES, corner + SIDES]),
        ]
    )
    return (first[None] + SIDES * np.arange(rings - 1)[:, None, None]).reshape(-1, 3)


def hull(points: Array) -> tuple[Array, Index]:
    """Vertices (v, 3) and outward triangles (f, 3) of the convex hull of ``points`` (n, 3), by Qhull."""
    found = ConvexHull(points)
    faces = found.simplices.copy()
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    kept, renumbered = np.unique(faces, return_inverse=True)
    return points[kept], renumbered.reshape(faces.shape)
