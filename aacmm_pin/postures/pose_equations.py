"""Equations of a pose (place of the tip, direction, orientation), and their solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.arm import Chain
from aacmm_pin.postures import continuation
from aacmm_pin.postures.continuation import MOST_POLISHES, POINT, POINT_AND_AXIS

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


@dataclass(frozen=True, eq=False)
class PoseConditions:
    """Conditions on the tip of a chain of revolute joints.

    Attributes:
        point: of the tip (3,) [m].
        tool: unit direction in the tip's frame along ``axis`` (3,), or None.
        axis: unit direction in the base (3,), or None.
        rotation: orientation of the tip's frame in the base (3, 3), or None.
    """

    chain: Chain
    point: Array
    tool: Array | None = None
    axis: Array | None = None
    rotation: Array | None = None

    @property
    def count(self) -> int:
        """3, 5 with an axis, 6 with a rotation."""
        if self.rotation is not None:
            return POSE
        return POINT if self.axis is None else POINT_AND_AXIS

    @property
    def free(self) -> int:
        """Joints beyond the conditions: dimension of the regular postures."""
        return self.chain.nq - self.count

    def equations(self) -> Equations:
        """The equations of one problem."""
        links = self.chain.links()
        points = self.point[None]
        if self.rotation is not None:
            return Equations(_in_axes(links, self.rotation.T), points @ self.rotation, POSE)
        if self.axis is not None and self.tool is not None:
            return Equations.of_axis(links, points, self.tool, self.axis)
        return Equations(links, points, POINT)


def rotation_between(u: Array, v: Array) -> Array:
    """Takes the unit vector u to the unit vector v."""
    frames = []
    for direction in (u, v):
        other = np.eye(3)[np.argmin(np.abs(direction))]
        second = np.cross(direction, other)
        second /= np.linalg.norm(second)
        frames.append(np.column_stack([direction, second, np.cross(direction, second)]))
    return np.asarray(frames[1] @ frames[0].T)


def _in_axes(links: Array, rotation: Array) -> Array:
    """The links in axes rotated by ``rotation`` (3, 3)."""
    rotated = links.copy()
    rotated[0, :3] = rotation @ rotated[0, :3]
    return rotated
