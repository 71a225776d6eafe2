"""The equations of a point of a DH table that shall be at given places: in NumPy, and with Newton's method in one loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.compiled import Loop
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.postures import newton_loop

MANY_POINTS = 700
"""With so many points at once, a piece of a large map, loading the loop is soon made good. It differs from NumPy in the last
digits, so that the choice must not depend on the time: the same points are always solved the same way."""
NEWTON = Loop(newton_loop.newton, newton_loop.SIGNATURE, newton_loop.HELPERS)


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
        position, jacobian = self.table.position_and_jacobian(q)
        return position - self.points[problem], jacobian

    def newton(
        self, q: Array, problem: Index, tangents: Array, limits: tuple[float, ...], iterations: int
    ) -> tuple[Array, Array, NDArray[np.bool_]] | None:
        """What :func:`newton_loop.newton` makes of ``q``; None where NumPy shall do it."""
        loop = NEWTON.wanted(len(self.points) >= MANY_POINTS) if self.table.nq == 4 else None
        if loop is None:
            return None
        table, angles = self.table, self.table.alpha
        rows = np.column_stack([table.a, table.d, np.cos(angles), np.sin(angles), table.theta_offset, table.moving])
        q, jacobians = q.copy(), np.empty((len(q), 3, 4))
        tangents = np.ascontiguousarray(tangents)
        good = loop(rows, table.standard, self.points[problem], tangents, np.array(limits), iterations, q, jacobians)
        return q, jacobians, good
