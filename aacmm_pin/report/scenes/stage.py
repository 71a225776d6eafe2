"""What scenes share: bodies of the arm, shapes and materials, ground, grid and axes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from meshcat.geometry import (
    Cylinder,
    MeshBasicMaterial,
    MeshPhongMaterial,
    Sphere,
    TriangularMeshGeometry,
)
from scipy.spatial.transform import Rotation

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm, chain, outside_limits
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import VERMILLION
from aacmm_pin.report.scenes.scene import Scene, Swatch, View

TUBE, JOINT, STYLUS, TIP, BASE = "#8d99a6", "#22395c", "#b8bec6", "#a3123a", "#4a4a4f"
GHOST = "#7f9cc0"
"""Other postures than the shown one."""
THICKNESS = 0.014
"""Radius of a tube over the length of the arm."""
DRAWN = 0.3
"""Shorter pieces, in radii, are hidden in a joint."""
STYLUS_WIDTH, HALF_JOINT = 0.4, 1.9
"""Radius of the last body, and half length of a joint, in radii of the tubes."""
AXES_GRADIENT = "linear-gradient(to right, red 33%, lime 33% 66%, blue 66%)"
TO_SCALE = "Lengths of the arm are to scale, but thicknesses of tubes and joints are not."
ROOM_ROUND_ARM = 3.4
"""Margin in radii of a tube around the arm's lines, for joints and flange."""
ANGLED = 35 * DEG
"""Angle of the camera beside the direction in which the arm reaches."""
CELL, CELLS = 0.5, 40
"""Side of a cell of meshcat's grid [m], and cells along each side."""
TUBE_SIDES = 6
"""Corners of a prism's section."""


@dataclass(frozen=True, eq=False)
class Bodies(ArmLines):
    """The bodies of an arm along its lines, with ``remarks`` on omitted parts."""

    remarks: tuple[str, ...] = ()

    @property
    def radius(self) -> float:
        """Radius of the tubes [m]."""
        return THICKNESS * self.length

    @property
    def swatches(self) -> list[Swatch]:
        """The legend of the bodies."""
        return [
            Swatch(TUBE, "tubes", "line"),
            Swatch(JOINT, "joints (cylinders along their axes)", "area"),
            Swatch(STYLUS, "last body", "line"),
        ]

    @property
    def notes(self) -> list[str]:
        """Sentences on the bodies."""
        return [TO_SCALE, *self.remarks]

    def outline(self, q: Array) -> Array:
        """Points (k, 3) [m] around the bodies at checked ``q`` (n, nq)."""
        return self.corners(q).reshape(-1, 3)

    def draw(self, scene: Scene) -> None:
        """Put the bodies into a scene, each to be moved by the transform of ``arm/body i``."""
        moving_axes = set(self.arm.chain.moving_axes())
        last = len(self.lines) - 1
        for number, line in enumerate(self.lines):
            body, radius, material = scene[f"arm/body {number}"], self.radius, solid(TUBE)
            if number == last:
                radius, material = STYLUS_WIDTH * self.radius, solid(STYLUS)
            pieces = [pair for pair in pairwise(line) if self._shows(*pair)]
            for count, (start, end) in enumerate(pieces, start=1):
                _put(body[f"tube {count}"], *rod(start, end, radius), material)
                _put(body[f"corner {count}"], Sphere(radius), placed_at(end), material)
            if number == 0:
                self._draw_foot(body["foot"])
            elif chain.axis(number) in moving_axes:
                self._draw_joint(body["joint"], number)
        draw_tip(scene, self)

    def _draw_joint(self, node: Any, number: int) -> None:
        """A cylinder along the axis, or a square bar for a prismatic joint."""
        end = HALF_JOINT * self.radius * np.array([0.0, 0.0, 1.0])
        shape, placement = rod(-end, end, 1.45 * self.radius)
        if self.arm.chain.slides[self.arm.chain.moved[chain.axis(number)]]:
            shape.radialSegments = 4
        _put(node, shape, placement, solid(JOINT))

    def _draw_foot(self, node: Any) -> None:
        """A flange at the origin of the base if a line leads from there to joint 1, else below
        joint 1.
        """
        base, joint = self.lines[0][[0, -1]]
        direction, top = joint - base, base
        if not self._shows(base, joint):
            rotations, origins = self.arm.chain.at_zero
            axis = rotations[chain.axis(1), :, 2]
            direction = -axis if axis @ self.arm.up < 0 else axis
            top = origins[chain.axis(1)] - HALF_JOINT * self.radius * direction
        height = 0.8 * self.radius * direction / np.linalg.norm(direction)
        _put(node, *rod(top - height, top, 3.4 * self.radius), solid(BASE))

    def _shows(self, start: Array, end: Array) -> bool:
        """Whether a tube is longer than the joint that hides it."""
        return float(np.linalg.norm(end - start)) > DRAWN * self.radius


def draw_tip(scene: Scene, bodies: Bodies) -> None:
    """Put a ball at the tip of the last body."""
    path = f"arm/body {len(bodies.lines) - 1}/tip"
    _put(scene[path], Sphere(0.55 * bodies.radius), placed_at(bodies.lines[-1][-1]), solid(TIP))


def _put(node: Any, shape: Any, placement: Array, material: Any) -> None:
    node.set_object(shape, material)
    node.set_transform(placement)


# --- the stage


def stage(title: str, caption: str, bodies: Bodies, points: Array, targets: Array) -> Scene:
    """A scene with the arm's bodies, and with background, grid and axes around ``points`` (n, 3)
    [m]. The camera looks past the ``targets`` (k, 3) [m] back to the base, a little from the side.
    """
    scene = Scene(title, caption)
    bodies.draw(scene)
    scene["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    scene["/Background"].set_property("bottom_color", [0.90, 0.92, 0.94])
    cell = 0.1  # [m]; ten times as long where so many cells do not reach all points
    while np.abs(points[:, :2]).max() > CELLS / 2 * cell:
        cell *= 10
    _scale(scene["/Grid"], cell / CELL)
    scene["/Grid"].set_property("color", [1.1, 1.1, 1.1, 0.45])
    _scale(scene["/Axes"], 0.2 * float(np.ptp(points, axis=0).max()))
    scene.swatches = [
        *bodies.swatches,
        Swatch(TIP, "tip"),
        Swatch("#b4bac2", f"base plane z = 0 (grid of {cell / MM:g} mm)", "line"),
        Swatch(AXES_GRADIENT, "axes x, y, z of the base", "line"),
    ]
    scene.notes = bodies.notes
    x, y, _ = targets.mean(axis=0)
    scene.view = View(points, float(np.arctan2(y, x)) + ANGLED, room=ROOM_ROUND_ARM * bodies.radius)
    return scene


def _scale(node: Any, size: float) -> None:
    node.set_transform(np.diag([size, size, size, 1.0]))


def place_in_first_posture(bodies: Bodies, q: Array, scene: Scene) -> dict[str, Array]:
    """Place the bodies; return the placements in all postures of the moving bodies, by path."""
    placements_of_path = {
        f"arm/body {k}": placements for k, placements in enumerate(bodies.placements(q))
    }
    for path, placements in placements_of_path.items():
        scene[path].set_transform(placements[0])
    placements_of_path.pop("arm/body 0")
    return placements_of_path


def draw_ghosts(scene: Scene, radius: float, postures: Iterable[Array]) -> None:
    """Draw postures as thin lines through their corners (corners, 3) [m]."""
    for number, corners in enumerate(postures, start=1):
        lines = prisms(corners[:-1], corners[1:], 0.3 * radius)
        scene[f"ghosts/{number}"].set_object(lines, solid(GHOST, 0.45))
    scene.explain(GHOST, "other postures", "line")


def draw_ball(scene: Scene, path: str, what: str, radius: float, place: Array) -> None:
    """Draw a ball at ``place`` (3,) [m] that nothing hides."""
    _put(scene[path], Sphere(radius), placed_at(place), in_front(VERMILLION, 0.85))
    scene.explain(VERMILLION, what)


def place_text(point: Array) -> str:
    """Coordinates as text."""
    x, y, z = point / MM
    return f"{x:.1f}, {y:.1f}, {z:.1f} mm"


def joint_texts(arm: Arm, q: Array) -> dict[str, list[str]]:
    """Values of the joints (n, nq) as text, and which joints are outside their ``limits``."""
    texts, limits = {}, []
    for joint, (values, slides) in enumerate(zip(q.T, arm.chain.prismatic, strict=True), start=1):
        scale, unit = (MM, " mm") if slides else (DEG, "°")
        texts[f"joint {joint}"] = [f"{value:.2f}{unit}" for value in values / scale]
    for outside in outside_limits(q, arm.limits):
        joints = ", ".join(str(joint + 1) for joint in np.flatnonzero(outside))
        limits.append(f"outside: joint {joints}" if joints else "within")
    return texts | {"limits": limits}


def slider_in_words(frames: int, number: int, things: str) -> str:
    """How many of ``number`` things are on the slider."""
    part = "" if frames == number else f"{frames} of "
    return f"The slider shows {part}the {number} {things}."


# --- shapes and materials


def colour_number(colour: str) -> int:
    """The colour for three.js."""
    return int(to_hex(colour)[1:], 16)


def solid(colour: str, opacity: float = 1.0, *, flat: bool = False) -> Any:
    """Material of a body: shaded by the lights of the scene, face by face if ``flat``."""
    opaque = opacity == 1.0
    return MeshPhongMaterial(
        color=colour_number(colour),
        opacity=opacity,
        shininess=40,
        depthWrite=opaque,
        flatShading=flat or not opaque,
    )


def flat(colour: str = "white", *, by_vertex: bool = False) -> Any:
    """Material of data: exactly the colour of the legend, without light."""
    return MeshBasicMaterial(color=colour_number(colour), vertexColors=by_vertex)


def in_front(colour: str, opacity: float) -> Any:
    """Material that nothing hides, drawn last."""
    return MeshPhongMaterial(
        color=colour_number(colour),
        opacity=opacity,
        transparent=True,
        side=0,
        shininess=40,
        depthTest=False,
        depthWrite=False,
    )


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
    start: Array, end: Array, radius: float, *, point: bool = False, colours: Array | None = None
) -> Any:
    """Thin prisms from ``start`` to ``end`` (n, 3) [m], or pyramids with their ``point`` there;
    ``colours`` (n, 2, 3) in [0, 1] of both ends.
    """
    corner = np.arange(TUBE_SIDES)
    angle = corner * (2 * np.pi / TUBE_SIDES)
    section = radius * np.column_stack([np.cos(angle), np.zeros(TUBE_SIDES), np.sin(angle)])
    rings = np.array([section @ _toward(direction).T for direction in end - start])
    end_rings = 0.0 * rings if point else rings
    # Six vertices about each start, then six about its end: (n, 2, 6, 3).
    vertices = np.stack([start[:, None] + rings, end[:, None] + end_rings], axis=1)
    next_corner = (corner + 1) % TUBE_SIDES
    lower = np.column_stack([corner, next_corner, corner + TUBE_SIDES])
    upper = np.column_stack([next_corner, next_corner + TUBE_SIDES, corner + TUBE_SIDES])
    first_vertex = 2 * TUBE_SIDES * np.arange(len(start))
    faces = np.vstack([lower, upper]) + first_vertex[:, None, None]
    vertex_colours = (
        None if colours is None else np.repeat(colours.reshape(-1, 3), TUBE_SIDES, axis=0)
    )
    return TriangularMeshGeometry(vertices.reshape(-1, 3), faces.reshape(-1, 3), vertex_colours)


def _toward(direction: Array) -> Array:
    """Rotation (3, 3) of y, the axis of cylinders in three.js, to a direction (3,)."""
    if not direction.any():
        return np.eye(3)
    rotation, _ = Rotation.align_vectors(direction[None], np.eye(3)[[1]])
    return np.asarray(rotation.as_matrix())
