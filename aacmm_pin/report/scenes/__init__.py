"""Scenes of the arm in the browser with meshcat, as pages or live."""

from aacmm_pin.report.scenes.arm_scene import arm_scene
from aacmm_pin.report.scenes.circle_scene import circle_scene
from aacmm_pin.report.scenes.residual_scene import residual_scene
from aacmm_pin.report.scenes.scene import Frames, Scene

__all__ = [
    "Frames",
    "Scene",
    "arm_scene",
    "circle_scene",
    "residual_scene",
]
