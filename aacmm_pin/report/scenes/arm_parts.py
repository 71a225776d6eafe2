"""The arm as bodies to be drawn: tubes along its lines, joints along their axes, a foot, a tip."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from meshcat.geometry import Sphere

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import chain
from aacmm_pin.report.arm_wireframe import ArmLines
from aacmm_pin.report.scenes.scene import Scene
from aacmm_pin.report.scenes.shapes import placed_at, rod, solid

TUBE, JOINT, STYLUS, TIP, BASE = "#8d99a6", "#22395c", "#b8bec6", "#a3123a", "#4a4a4f"
GHOST = "#7f9cc0"
"""The arm in postures other than the one that is shown."""
THICKNESS = 0.014
"""Radius of a tube, in lengths of the arm."""
DRAWN = 0.3
"""Pieces shorter than this many radii are hidden in a joint and not drawn."""


class Bodies(ArmLines):
    """The bodies of an arm along its lines."""

    @property
    def radius(self) -> float:
        """Of the tubes [m]."""
        return THICKNESS * self.length

    def draw(self, scene: Scene, root: str = "arm") -> None:
        """Put the bodies into a scene below ``root``; they are moved by a transform of ``root/body i`` each."""
        moves, last = set(self.arm.chain.moving_axes()), len(self.lines) - 1
        for number, line in enumerate(self.lines):
            path = f"{root}/body {number}"
            self._draw_line(scene, path, line, thin=number == last)
            if number == 0:
                self._draw_foot(scene, path)
            elif chain.axis(number) in moves:
                self._draw_joint(scene, path, number)
        _put(scene, f"{root}/body {last}/tip", Sphere(0.55 * self.radius), self.lines[-1][-1], TIP)

    def _draw_line(self, scene: Scene, path: str, line: Array, thin: bool) -> None:
        """Tubes along the line and round corners; the last body gets thinner towards the tip."""
        pieces = [pair for pair in pairwise(line) if self._shows(*pair)]
        for count, (start, end) in enumerate(pieces, start=1):
            stylus = thin and count == len(pieces)
            radius = (0.35 if stylus else 0.7 if thin else 1.0) * self.radius
            shape, placement = rod(start, end, radius, 0.3 * self.radius if stylus else None)
            _put(scene, f"{path}/tube {count}", shape, placement, STYLUS if stylus else TUBE)
            if not stylus:
                _put(scene, f"{path}/corner {count}", Sphere(radius), end, TUBE)

    def _draw_joint(self, scene: Scene, path: str, number: int) -> None:
        """A short thick cylinder along the joint's axis; a square one for a joint that slides."""
        half, radius = np.array([0.0, 0.0, 1.9]), 1.45
        if number == len(self.lines) - 1:  # near the tip
            half, radius = np.array([0.0, 0.0, 1.4]), 1.1
        shape, placement = rod(-self.radius * half, self.radius * half, radius * self.radius)
        if self.arm.chain.prismatic[self.arm.chain.joint[chain.axis(number)]]:
            shape.radialSegments = 4
        _put(scene, f"{path}/joint", shape, placement, JOINT)

    @property
    def foot(self) -> Array:
        """Two points: where the foot ends and the arm begins, and the middle of the flange below (2, 3) [m].

        The arm stands on the origin of the base where something leads from there to joint 1, else on a short post.
        """
        if self._shows(*self.lines[0][[0, -1]]):
            return np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        rotation, origin = (part[chain.axis(1), 0] for part in self.arm.chain.walk(np.zeros((1, self.arm.nq))))
        down = -rotation[:, 2] * (np.sign(rotation[:, 2] @ self.arm.up) or 1.0)
        return np.array([origin, origin + 4.2 * self.radius * down])

    def _draw_foot(self, scene: Scene, path: str) -> None:
        top, bottom = self.foot
        way = bottom - top if (bottom != top).any() else self.lines[0][0] - self.lines[0][-1]
        if (bottom != top).any():
            _put(scene, f"{path}/post", *rod(top, bottom, 1.5 * self.radius), BASE)
        thick = 0.8 * self.radius * way / np.linalg.norm(way)
        _put(scene, f"{path}/flange", *rod(bottom, bottom + thick, 3.4 * self.radius), BASE)

    def _shows(self, start: Array, end: Array) -> bool:
        return float(np.linalg.norm(end - start)) > DRAWN * self.radius


def _put(scene: Scene, path: str, shape: Any, where: Array, colour: str) -> None:
    """An object at a point (3,) [m], or with a placement (4, 4)."""
    scene[path].set_object(shape, solid(colour))
    scene[path].set_transform(where if where.ndim == 2 else placed_at(where[None])[0])
