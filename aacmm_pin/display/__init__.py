"""The arm in three dimensions, in the browser, by meshcat: pages that need no server, and scenes shown live."""

from aacmm_pin.display.arm_scene import arm_scene
from aacmm_pin.display.circle_scene import circle_scene
from aacmm_pin.display.page import shared_script
from aacmm_pin.display.scene import Scene
from aacmm_pin.display.server import Server

__all__ = ["Scene", "Server", "arm_scene", "circle_scene", "shared_script"]
