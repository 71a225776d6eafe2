"""The arm as bodies to be drawn: what lies between one joint axis and the next, in the axes of the joint before it.

Body i moves with ``axis i`` of the chain (:mod:`aacmm_pin.arm.chain`), body 0 stands still. With a DH table its line runs
along d and a of the row, so that tubes are where the arm has them; an arm that came as URDF has straight lines between
its joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from meshcat.geometry import Sphere

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import chain
from aacmm_pin.arm.arm import Arm
from aacmm_pin.report.scenes.scene import Scene
from aacmm_pin.report.scenes.shapes import placed_at, rod, solid

TUBE, JOINT, STYLUS, TIP, BASE = "#8d99a6", "#22395c", "#b8bec6", "#a3123a", "#4a4a4f"
GHOST = "#7f9cc0"
"""The arm in postures other than the one that is shown."""
THICKNESS = 0.014
"""Radius of a tube, in lengths of the arm."""
DRAWN = 0.3
"""Pieces shorter than this many radii are hidden in a joint and not drawn."""


@dataclass(frozen=True, eq=False)
class Bodies:
    """Lines of the bodies of an arm.

    Attributes:
        arm: the arm.
        lines: corners of the line of body 0, 1, … in its own axes, (k, 3) [m] each.
        radius: of the tubes [m].
    """

    arm: Arm
    lines: tuple[Array, ...]
    radius: float

    @staticmethod
    def of(arm: Arm) -> Bodies:
        """The bodies of ``arm``."""
        lines = tuple(_dh_lines(arm) if arm.dh is not None else _straight_lines(arm))
        length = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
        return Bodies(arm, lines, THICKNESS * length)

    def placements(self, q: Array) -> Array:
        """Placements of all bodies for checked ``q`` (n, nq): (bodies, n, 4, 4) [m]."""
        rotation, origin = self.arm.chain.walk(q)
        places = [chain.BASE, *(chain.axis(row) for row in range(1, len(self.lines)))]
        placements = np.zeros((len(places), len(q), 4, 4))
        placements[:, :, :3, :3], placements[:, :, :3, 3] = rotation[places], origin[places]
        placements[:, :, 3, 3] = 1.0
        return placements

    def corners(self, q: Array) -> Array:
        """All corners of all lines in the base, from the base to the tip: (n, corners, 3) [m]."""
        placed = zip(self.placements(q), self.lines, strict=True)
        return np.concatenate([line @ at[:, :3, :3].transpose(0, 2, 1) + at[:, None, :3, 3] for at, line in placed], axis=1)

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


def _dh_lines(arm: Arm) -> list[Array]:
    """Along d and a of every row, in the axes of the joint."""
    dh = arm.require_dh("its lines")
    zero = np.zeros_like(dh.a)
    along_d, along_a = np.column_stack([zero, zero, dh.d]), np.column_stack([dh.a, zero, zero])
    start = np.zeros((1, 3))
    if dh.standard:
        return [start, *(np.vstack([start, d, d + a]) for d, a in zip(along_d, along_a, strict=True))]
    behind = [*along_a[1:], None]
    bodies = [np.vstack([-d, start, *([] if a is None else [a])]) for d, a in zip(along_d, behind, strict=True)]
    return [np.vstack([start, along_a[0]]), *bodies]


def _straight_lines(arm: Arm) -> list[Array]:
    """From each joint's origin to the next, at rest."""
    places = [chain.BASE, *(chain.axis(row) for row in range(1, arm.chain.rows + 1)), arm.chain.tip]
    rotation, origin = (part[:, 0] for part in arm.chain.walk(np.zeros((1, arm.nq))))
    return [np.vstack([np.zeros(3), (origin[after] - origin[place]) @ rotation[place]]) for place, after in pairwise(places)]


def _put(scene: Scene, path: str, shape: Any, where: Array, colour: str) -> None:
    """An object at a point (3,) [m], or with a placement (4, 4)."""
    scene[path].set_object(shape, solid(colour))
    scene[path].set_transform(where if where.ndim == 2 else placed_at(where[None])[0])
