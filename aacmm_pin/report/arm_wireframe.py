"""The arm as lines, each in the axes of its body.

Body i moves with ``axis i`` of :mod:`aacmm_pin.arm.chain`; body 0 is fixed. With a DH table a line
runs along d and a of the row, as the tubes do; for a URDF, lines join the joints.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm, DHTable, chain


@dataclass(frozen=True, eq=False)
class ArmLines:
    """Lines of the bodies of an arm."""

    arm: Arm

    @cached_property
    def lines(self) -> list[Array]:
        """Corners of the line of each body in its own axes, (k, 3) [m] each."""
        if self.arm.dh is not None:
            return _lines_of_table(self.arm.dh)
        # From each joint to the next, in the zero posture.
        arm_chain = self.arm.chain
        axes = [chain.axis(row) for row in range(1, arm_chain.rows + 1)]
        rotation, origin = arm_chain.at_zero
        lines = []
        for start, end in pairwise([chain.BASE, *axes, arm_chain.tip]):
            step = (origin[end] - origin[start]) @ rotation[start]
            lines.append(np.vstack([np.zeros(3), step]))
        return lines

    @cached_property
    def length(self) -> float:
        """Length of all lines [m]."""
        segments = np.concatenate([np.diff(line, axis=0) for line in self.lines])
        return float(np.linalg.norm(segments, axis=1).sum())

    def placements(self, q: Array) -> Array:
        """Placements of all bodies at ``q`` (n, nq): (bodies, n, 4, 4) [m]."""
        rotation, origin = self.arm.chain.walk(q)
        chain_places = [chain.BASE, *(chain.axis(row) for row in range(1, len(self.lines)))]
        placements = np.zeros((len(chain_places), len(q), 4, 4))
        placements[:, :, :3, :3], placements[:, :, :3, 3] = (
            rotation[chain_places],
            origin[chain_places],
        )
        placements[:, :, 3, 3] = 1.0
        return placements

    def corners(self, q: Array) -> Array:
        """All corners of all lines in the base, from base to tip: (n, corners, 3) [m]."""
        return self.in_base(q, enumerate(self.lines))

    def in_base(self, q: Array, points_of_bodies: Iterable[tuple[int, Array]]) -> Array:
        """Points of bodies, by number and in their axes (k, 3) each, in the base: (n, points, 3)
        [m].
        """
        placements, in_base = self.placements(q), []
        for body, points in points_of_bodies:
            rotation, origin = placements[body, :, :3, :3], placements[body, :, None, :3, 3]
            in_base.append(points @ rotation.transpose(0, 2, 1) + origin)
        return np.concatenate(in_base, axis=1)


def _lines_of_table(dh: DHTable) -> list[Array]:
    """Corners of the line of each body in its own axes (k, 3) [m], along d and a of its DH row."""
    zero, start = np.zeros_like(dh.a), np.zeros((1, 3))
    along_d = np.column_stack([zero, zero, dh.d])
    along_a = np.column_stack([dh.a, zero, zero])
    if dh.standard:
        rows = zip(along_d, along_a, strict=True)
        return [start, *(np.vstack([start, d, d + a]) for d, a in rows)]
    # The modified convention: a of the next row ends the line of a body.
    after_d = [*along_a[1:, None], np.empty((0, 3))]
    rows = zip(along_d, after_d, strict=True)
    return [np.vstack([start, along_a[0]]), *(np.vstack([-d, start, a]) for d, a in rows)]
