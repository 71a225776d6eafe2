"""The arm as straight lines from its base over the origins of its axes to the tip.

Body 0 is fixed, and body i moves with ``axis i`` of :mod:`aacmm_pin.arm.chain`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm, chain

THICKNESS = 0.014
"""Radius of a tube over the length of the arm."""


@dataclass(frozen=True, eq=False)
class ArmLines:
    """One line for each body of an arm, from its origin to that of the next body."""

    arm: Arm

    @cached_property
    def bodies(self) -> list[int]:
        """The place of each body in the chain."""
        return [chain.BASE, *(chain.axis(row) for row in range(1, self.arm.chain.rows + 1))]

    @cached_property
    def ends(self) -> Array:
        """End of the line of each body, in the axes of the body (bodies, 3) [m]."""
        rotation, origin = self.arm.chain.at_zero
        steps = np.diff(origin[[*self.bodies, self.arm.chain.tip]], axis=0)
        return np.asarray(np.einsum("nij,ni->nj", rotation[self.bodies], steps))

    @property
    def radius(self) -> float:
        """Radius of the tubes [m]."""
        return THICKNESS * float(np.linalg.norm(self.ends, axis=1).sum())

    def placements(self, q: Array) -> Array:
        """Placements of all bodies at ``q`` (n, nq): (bodies, n, 4, 4) [m]."""
        rotation, origin = self.arm.chain.walk(q)
        placements = np.tile(np.eye(4), (len(self.bodies), len(q), 1, 1))
        placements[..., :3, :3] = rotation[self.bodies]
        placements[..., :3, 3] = origin[self.bodies]
        return placements

    def corners(self, q: Array) -> Array:
        """Ends of all lines in the base, from base to tip: (n, bodies + 1, 3) [m]."""
        _, origin = self.arm.chain.walk(q)
        return origin[[*self.bodies, self.arm.chain.tip]].transpose(1, 0, 2)
