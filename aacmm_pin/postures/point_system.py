"""The equations of a point of a DH table that shall be at given places: in NumPy, and with Newton's method in one loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.compiled import Loop
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.postures import curve_loop

MANY_POINTS = 250
"""With so many points at once, a piece of a large map, loading the loop is soon made good. It differs from NumPy in the last
digits, so that the choice must not depend on the time: the same points are always solved the same way."""
NEWTON = Loop(curve_loop.newton, curve_loop.NEWTON, curve_loop.HELPERS)
CURVES = Loop(curve_loop.curves, curve_loop.CURVES, curve_loop.HELPERS)
ROOM, MOST_CURVES = 100_000, 4096
"""Vertices and curves of some problems that the loop returns at once."""


@dataclass(frozen=True, eq=False)
class PointSystem:
    """Distance (n, 3) [m] of the origin of a table's last frame from its goal, as a function of the joints (n, nq) [rad].

    Attributes:
        table: rows up to the point.
        points: the goals of all problems (m, 3) [m].
    """

    table: DHTable
    points: Array

    def __call__(self, q: Array, problem: Index) -> tuple[Array, Array]:
        """The distances, and their derivatives (n, 3, nq) [m/rad]."""
        position, jacobian = self.table.chain.position_and_jacobian(q)
        return position - self.points[problem], jacobian

    def newton(
        self, q: Array, problem: Index, tangents: Array, iterations: int
    ) -> tuple[Array, Array, NDArray[np.bool_]] | None:
        """What :func:`curve_loop.newton` makes of ``q``; None where NumPy shall do it."""
        loop = self._wanted(NEWTON)
        if loop is None:
            return None
        q, jacobians, tangents = q.copy(), np.empty((len(q), 3, 4)), np.ascontiguousarray(tangents)
        good = loop(self.table.links(), self.points[problem], tangents, iterations, q, jacobians)
        return q, jacobians, good

    def curves(self, seeds: Array, problem: Index) -> tuple[list[tuple[int, Array]], NDArray[np.bool_]]:
        """What :func:`curve_loop.curves` finds: problem and vertices of closed curves, and which seeds are left to NumPy."""
        left, found = np.ones(len(self.points), dtype=bool), list[tuple[int, Array]]()
        loop = self._wanted(CURVES)
        if loop is not None:
            order, done, goals = np.argsort(problem, kind="stable"), 0, np.ascontiguousarray(self.points)
            ends = np.cumsum(np.bincount(problem, minlength=len(self.points)))
            vertices, pieces = np.empty((ROOM, 4)), np.zeros((MOST_CURVES, 3), dtype=np.int64)
            while done < len(self.points):
                done = loop(self.table.links(), goals, seeds[order], ends, done, vertices, pieces, left)
                count = int(np.argmin(pieces[:, 0]))
                found += [(int(n), vertices[first : first + many].copy()) for n, first, many in pieces[:count]]
            left = ~left
        return found, left[problem]

    def _wanted(self, loop: Loop) -> Callable[..., Any] | None:
        return loop.wanted(len(self.points) >= MANY_POINTS) if self.table.nq == 4 else None
