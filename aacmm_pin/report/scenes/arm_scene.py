"""The arm in one posture, or moving through many, and what every scene has around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array, batch
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.limits import broken_limits
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import ShapeError
from aacmm_pin.report.plots.style import BLUE, GREY
from aacmm_pin.report.scenes.arm_parts import JOINT, STYLUS, TIP, TUBE, Bodies
from aacmm_pin.report.scenes.legend import Legend, Swatch
from aacmm_pin.report.scenes.scene import Frames, Scene, View

TO_SCALE = "Lengths are true to scale; tubes and joints are not as thick as drawn."
ROOM = 3.4
"""So many radii of a tube are seen beyond the arm's lines: its joints, its foot."""
ANGLED = 35 * DEG
"""How far the camera stands beside the direction in which the arm reaches."""
CELL, CELLS = 0.5, 40
"""Side of a cell of meshcat's grid [m], and how many of them lie along each side of it."""


def arm_scene(model: Arm | ErrorModel, q: ArrayLike) -> Scene:
    """The arm at ``q`` (n, nq) [rad, m]: a picture for one posture, an animation through them for more.

    Raises:
        ShapeError: ``q`` is not a finite (n, nq) array, or has no row.
    """
    arm = ErrorModel.arm_of(model)
    q = batch(q, arm.nq, "q", "rad")
    if not len(q):
        raise ShapeError("q has no row, expected at least one posture")
    bodies, broken, tips = Bodies.of(arm), broken_limits(q, arm.limits), arm.positions(q)
    points = bodies.corners(q).reshape(-1, 3)
    one = f"The tip is at {place_text(tips[0])} in the base frame."
    scene = Scene(arm.name, one if len(q) == 1 else f"{len(q)} postures.")
    scene.legend = Legend(surroundings(scene, bodies, points), notes=[TO_SCALE])
    scene.frames = Frames(
        moving(bodies, q, scene),
        ["tip x, y, z", *angle_labels(arm), "limits"],
        [[place_text(tip), *angle_texts(arm, row), broken_text(out)] for tip, row, out in zip(tips, q, broken, strict=True)],
        [GREY if out.any() else BLUE for out in broken],
    )
    scene.view = view_of(bodies, points, tips.mean(axis=0))
    return scene


def surroundings(scene: Scene, bodies: Bodies, points: Array) -> list[Swatch]:
    """Draw the arm's bodies, and around ``points`` (n, 3) [m] background, grid and axes; what they are, for the legend."""
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
    return [
        Swatch(TUBE, "tubes", "line"),
        Swatch(JOINT, "joints, drawn along their axes", "area"),
        Swatch(STYLUS, "last body, thinner towards the tip", "line"),
        Swatch(TIP, "tip"),
        Swatch("#b4bac2", f"base plane z = 0, one cell {cell / MM:g} mm", "line"),
        Swatch(f"linear-gradient(to right, {thirds})", "axes x, y, z of the base", "line"),
    ]


def moving(bodies: Bodies, q: Array, scene: Scene) -> dict[str, Array]:
    """Placements of the bodies that move, by their paths; they are put where the first posture has them."""
    placed = {f"arm/body {k}": placements for k, placements in enumerate(bodies.placements(q))}
    for path, placements in placed.items():
        scene[path].set_transform(placements[0])
    placed.pop("arm/body 0")
    return placed


def view_of(bodies: Bodies, points: Array, towards: Array) -> View:
    """Past the place that the arm reaches for, and a little to its side, back to the base."""
    x, y, _ = towards
    return View(np.vstack([points, bodies.foot]), float(np.arctan2(y, x)) + ANGLED, room=ROOM * bodies.radius)


def place_text(point: Array) -> str:
    """Coordinates for the reader."""
    return ", ".join(f"{c / MM:.1f}" for c in point) + " mm"


def angle_labels(arm: Arm) -> list[str]:
    """Names of the joints' values."""
    return [f"joint {j}" for j in range(1, arm.nq + 1)]


def angle_texts(arm: Arm, q: Array) -> list[str]:
    """Values of the joints, degrees or millimetres."""
    return [f"{v / MM:.2f} mm" if slides else f"{v / DEG:.2f}°" for v, slides in zip(q, arm.chain.prismatic, strict=True)]


def broken_text(broken: Array) -> str:
    """Whether a posture is within limits, or which joints are not, from their flags (nq,)."""
    joints = [str(j + 1) for j in np.flatnonzero(broken)]
    return f"outside: joint {', '.join(joints)}" if joints else "within"
