"""Equations of a pose (place of the tip, direction, orientation), and their solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.postures import continuation
from aacmm_pin.postures.continuation import MOST_POLISHES, POINT_AND_AXIS

POSE = 6
Z_AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of problems that differ in the place of the tip alone.

    Attributes:
        links: of ``L_0 Rz(q_1) L_1 … Rz(q_n) L_n``, (n + 1, 4, 4) [m], from the wanted orientation
            to the tip, whose frame must become that of the base.
        goals: places of the tip in the axes of the wanted orientation (m, 3) [m].
        count: number of equations k: 3, 5 with the z axis, 6 of a pose.
    """

    links: Array
    goals: Array
    count: int

    @staticmethod
    def of_axis(links: Array, points: Array, tool: Array, axis: Array) -> Equations:
        """The tip at ``points`` (m, 3) [m], its unit vector ``tool`` (3,) along ``axis`` (3,).

        ``links`` (n + 1, 4, 4) and all vectors but ``tool`` are in the base.
        """
        upright = rotation_between(axis, Z_AXIS)
        rotated = _in_axes(links, upright)
        rotated[-1, :3, :3] = rotated[-1, :3, :3] @ rotation_between(Z_AXIS, tool)
        return Equations(rotated, points @ upright.T, POINT_AND_AXIS)

    @staticmethod
    def of_pose(links: Array, points: Array, rotation: Array) -> Equations:
        """The tip's frame at ``points`` (m, 3) [m] with the axes ``rotation`` (3, 3)."""
        return Equations(_in_axes(links, rotation.T), points @ rotation, POSE)

    def __call__(self, q: Array, problem: Index | int = 0) -> tuple[Array, Array]:
        """Values (n, k) [m, rad] and derivatives (n, k, joints) at ``q`` (n, joints) [rad];
        ``problem`` numbers (n,), or one.
        """
        _, equations, _ = self._newton(q, problem, 0)
        return equations[:, :, -1], equations[:, :, :-1]

    def polish(self, q: Array, problem: Index | int = 0) -> tuple[Array, Mask]:
        """Move each row to the nearest solution by damped Newton steps.

        Returns:
            q (n, joints) [rad], and whether each arrived (n,).
        """
        moved, _, arrived = self._newton(q, problem, MOST_POLISHES)
        return moved, arrived

    def _newton(self, q: Array, problem: Index | int, most: int) -> tuple[Array, Array, Mask]:
        """Angles after at most ``most`` steps, equations at the last ones, and which arrived."""
        joints = q.shape[1]
        angles = np.array(q, order="C")
        arrived = np.empty(len(q), dtype=np.bool_)
        equations = np.empty((len(q), self.count, joints + 1))
        goals = np.empty((len(q), 3))
        goals[:] = self.goals[problem]
        move_to_solutions = continuation.NEWTON.compiled
        space = continuation.working_space(joints)
        move_to_solutions(self.links, goals, most, angles, equations, arrived, space)
        return angles, equations, arrived


def rotation_between(u: Array, v: Array) -> Array:
    """Takes the unit vector u to the unit vector v."""
    from scipy.spatial.transform import Rotation

    rotation, _ = Rotation.align_vectors(v, u)
    return np.asarray(rotation.as_matrix())


def _in_axes(links: Array, rotation: Array) -> Array:
    """The links in axes rotated by ``rotation`` (3, 3)."""
    rotated = links.copy()
    rotated[0, :3] = rotation @ rotated[0, :3]
    return rotated
