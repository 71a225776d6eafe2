"""The arm in one or many postures."""

from __future__ import annotations

from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import batch
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import ShapeError
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.plots.style import BLUE, GREY
from aacmm_pin.report.scenes.bodies import OPAQUE, BodyStyle, draw_bodies, moves_of
from aacmm_pin.report.scenes.scene import Frames, Scene
from aacmm_pin.report.scenes.stage import joint_texts, place_text, stage


def arm_scene(model: GivenModel, q: ArrayLike, *, body_style: BodyStyle = "meshes") -> Scene:
    """Make a scene of the arm at ``q`` ``(n, nq)`` [rad, m]: a picture of one posture, an animation
    of more.

    Args:
        body_style: ``meshes`` draws the meshes of the arm's URDF, in their colours; ``sticks``,
            also for an arm without meshes, tubes and joints.

    Raises:
        ShapeError: ``q`` is not a finite ``(n, nq)`` array, or has no row.
    """
    arm = ErrorModel.arm_of(model)
    q = batch(q, arm.nq, "q", "rad")
    if not len(q):
        raise ShapeError("q has no row; expected at least one posture")
    lines, tips = ArmLines(arm), arm.positions(q)
    caption = f"The tip is at {place_text(tips[0])} in the base frame."
    if len(q) > 1:
        caption = f"The scene shows {len(q)} postures."
    scene = stage(arm.name, caption, lines, lines.corners(q).reshape(-1, 3), tips)
    draw_bodies(scene, lines, body_style, OPAQUE)
    texts = {"tip x, y, z": [place_text(tip) for tip in tips], **joint_texts(arm, q)}
    colours = [BLUE if text == "within" else GREY for text in texts["limits"]]
    scene.frames = Frames(moves_of(lines, q), texts, colours)
    return scene
