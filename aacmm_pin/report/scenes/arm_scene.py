"""The arm in one posture, or moving through many."""

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
from aacmm_pin.report.scenes.frames import Frames
from aacmm_pin.report.scenes.legend import Legend, Swatch
from aacmm_pin.report.scenes.scene import Scene
from aacmm_pin.report.scenes.stage import set_stage
from aacmm_pin.report.scenes.view import View

ARM_SWATCHES = (
    Swatch(TUBE, "tubes", "line"),
    Swatch(JOINT, "joints, drawn along their axes", "area"),
    Swatch(STYLUS, "last body, thinner towards the tip", "line"),
    Swatch(TIP, "tip"),
)
TO_SCALE = "Lengths are true to scale; tubes and joints are not as thick as drawn."
ROOM = 3.4
"""So many radii of a tube are seen beyond the arm's lines: its joints, its foot."""
ANGLED = 35 * DEG
"""How far the camera stands beside the direction in which the arm reaches."""


def arm_scene(model: Arm | ErrorModel, q: ArrayLike) -> Scene:
    """The arm at ``q`` (n, nq) [rad, m]: a picture for one posture, an animation through them for more.

    Raises:
        ShapeError: ``q`` is not a finite (n, nq) array, or has no row.
    """
    arm = ErrorModel.arm_of(model)
    q = batch(q, arm.nq, "q", "rad")
    if not len(q):
        raise ShapeError("q has no row, expected at least one posture")
    bodies, broken = Bodies.of(arm), broken_limits(q, arm.limits)
    points = bodies.corners(q).reshape(-1, 3)
    tips = arm.positions(q)
    scene = Scene(arm.name, _caption(arm, tips))
    bodies.draw(scene)
    swatches = set_stage(scene, points)
    scene.legend = Legend([*ARM_SWATCHES, *swatches], notes=[TO_SCALE])
    scene.frames = Frames(
        moving(bodies, q, scene),
        ["tip x, y, z", *angle_labels(arm), "limits"],
        [[place_text(tip), *angle_texts(arm, row), broken_text(out)] for tip, row, out in zip(tips, q, broken, strict=True)],
        [GREY if out.any() else BLUE for out in broken],
    )
    scene.view = view_of(bodies, points, tips.mean(axis=0))
    return scene


def moving(bodies: Bodies, q: Array, scene: Scene) -> dict[str, Array]:
    """Placements of the bodies that move, by their paths; they are put where the first posture has them."""
    placed = dict(zip((f"arm/{path}" for path in bodies.paths), bodies.placements(q), strict=True))
    for path, placements in placed.items():
        scene[path].set_transform(placements[0])
    placed.pop("arm/body 0")
    return placed


def view_of(bodies: Bodies, points: Array, towards: Array) -> View:
    """Past the place that the arm reaches for, and a little to its side, back to the base."""
    x, y, _ = towards
    return View(np.vstack([points, bodies.foot]), float(np.arctan2(y, x)) + ANGLED, room=ROOM * bodies.radius)


def placed_at(points: Array) -> Array:
    """Placements with their origins at ``points`` (n, 3) [m]: (n, 4, 4)."""
    placements = np.tile(np.eye(4), (len(points), 1, 1))
    placements[:, :3, 3] = points
    return placements


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


def _caption(arm: Arm, tips: Array) -> str:
    if len(tips) == 1:
        return f"The tip is at {place_text(tips[0])} in the base frame."
    return f"{len(tips)} postures."
