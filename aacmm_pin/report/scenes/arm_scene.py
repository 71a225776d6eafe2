"""The arm in one posture, or moving through many, and what every scene has around it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from meshcat.geometry import Sphere
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array, batch
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.limits import broken_limits
from aacmm_pin.effects.error_model import ErrorModel, GivenModel
from aacmm_pin.errors import ShapeError
from aacmm_pin.report.plots.style import BLUE, GREY, VERMILLION
from aacmm_pin.report.scenes.arm_parts import GHOST, JOINT, STYLUS, TIP, TUBE, Bodies
from aacmm_pin.report.scenes.legend import Swatch
from aacmm_pin.report.scenes.scene import Frames, Scene, View
from aacmm_pin.report.scenes.shapes import ahead, placed_at, prisms, solid

TO_SCALE = "Lengths are true to scale; tubes and joints are not as thick as drawn."
ROOM = 3.4
"""So many radii of a tube are seen beyond the arm's lines: its joints, its foot."""
ANGLED = 35 * DEG
"""How far the camera stands beside the direction in which the arm reaches."""
CELL, CELLS = 0.5, 40
"""Side of a cell of meshcat's grid [m], and how many of them lie along each side of it."""


def arm_scene(model: GivenModel, q: ArrayLike) -> Scene:
    """The arm at ``q`` (n, nq) [rad, m]: a picture for one posture, an animation through them for more.

    Raises:
        ShapeError: ``q`` is not a finite (n, nq) array, or has no row.
    """
    arm = ErrorModel.arm_of(model)
    q = batch(q, arm.nq, "q", "rad")
    if not len(q):
        raise ShapeError("q has no row, expected at least one posture")
    bodies, tips = Bodies(arm), arm.positions(q)
    one = f"The tip is at {place_text(tips[0])} in the base frame."
    scene = stage(arm.name, one if len(q) == 1 else f"{len(q)} postures.", bodies, bodies.corners(q).reshape(-1, 3), tips)
    texts = {"tip x, y, z": [place_text(tip) for tip in tips], **joint_texts(arm, q)}
    colours = [BLUE if text == "within" else GREY for text in texts["limits"]]
    scene.frames = Frames(moving(bodies, q, scene), texts, colours)
    return scene


def stage(title: str, caption: str, bodies: Bodies, points: Array, targets: Array) -> Scene:
    """A scene with the arm's bodies, and around ``points`` (n, 3) [m] background, grid and axes.

    It is looked at past the ``targets`` (k, 3) [m] that the arm reaches for, a little from the side, back to the base.
    """
    scene = Scene(title, caption)
    bodies.draw(scene)
    scene["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    scene["/Background"].set_property("bottom_color", [0.90, 0.92, 0.94])
    cell = 0.1  # [m]; ten times as long where so many cells do not reach all points
    while np.abs(points[:, :2]).max() > CELLS / 2 * cell:
        cell *= 10
    scene["/Grid"].set_transform(np.diag([*[cell / CELL] * 3, 1.0]))
    scene["/Grid"].set_property("color", [1.1, 1.1, 1.1, 0.45])
    axes = 0.2 * float(np.ptp(points, axis=0).max())
    scene["/Axes"].set_transform(np.diag([*[axes] * 3, 1.0]))
    thirds = ", ".join(f"{colour} {33 * i}% {33 * (i + 1)}%" for i, colour in enumerate(("red", "lime", "blue")))
    scene.swatches = [
        Swatch(TUBE, "tubes", "line"),
        Swatch(JOINT, "joints, drawn along their axes", "area"),
        Swatch(STYLUS, "last body, thinner towards the tip", "line"),
        Swatch(TIP, "tip"),
        Swatch("#b4bac2", f"base plane z = 0, one cell {cell / MM:g} mm", "line"),
        Swatch(f"linear-gradient(to right, {thirds})", "axes x, y, z of the base", "line"),
    ]
    scene.notes = [TO_SCALE]
    x, y, _ = targets.mean(axis=0)
    seen = np.vstack([points, bodies.foot])
    scene.view = View(seen, float(np.arctan2(y, x)) + ANGLED, room=ROOM * bodies.radius)
    return scene


def moving(bodies: Bodies, q: Array, scene: Scene) -> dict[str, Array]:
    """Placements of the bodies that move, by their paths; they are put where the first posture has them."""
    placed = {f"arm/body {k}": placements for k, placements in enumerate(bodies.placements(q))}
    for path, placements in placed.items():
        scene[path].set_transform(placements[0])
    placed.pop("arm/body 0")
    return placed


def draw_ghosts(scene: Scene, radius: float, postures: Iterable[Array]) -> None:
    """The arm in other postures, as thin lines through their corners (corners, 3) [m] each."""
    for number, corners in enumerate(postures, start=1):
        scene[f"ghosts/{number}"].set_object(prisms(corners[:-1], corners[1:], 0.3 * radius), solid(GHOST, 0.45))
    scene.swatches.insert(0, Swatch(GHOST, "other postures", "line"))


def draw_ball(scene: Scene, path: str, what: str, radius: float, place: Array) -> None:
    """A ball at ``place`` (3,) [m] that is seen whatever stands before it."""
    scene[path].set_object(Sphere(radius), ahead(VERMILLION, 0.85))
    scene[path].set_transform(placed_at(place[None])[0])
    scene.swatches.insert(0, Swatch(VERMILLION, what))


def place_text(point: Array) -> str:
    """Coordinates for the reader."""
    return ", ".join(f"{c / MM:.1f}" for c in point) + " mm"


def joint_texts(arm: Arm, q: Array) -> dict[str, list[str]]:
    """Values of the joints (n, nq), degrees or millimetres, and whether they are within limits, or which are not."""
    texts = {}
    for joint, (values, slides) in enumerate(zip(q.T, arm.chain.prismatic, strict=True), start=1):
        texts[f"joint {joint}"] = [f"{v / MM:.2f} mm" if slides else f"{v / DEG:.2f}°" for v in values]
    outside = [", ".join(str(joint + 1) for joint in np.flatnonzero(row)) for row in broken_limits(q, arm.limits)]
    return texts | {"limits": [f"outside: joint {joints}" if joints else "within" for joints in outside]}
