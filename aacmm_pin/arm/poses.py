"""Poses of an arm, computed by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown
from aacmm_pin.arm.dh import KINDS, DHTable
from aacmm_pin.errors import UnsupportedArmError


@dataclass(frozen=True, eq=False)
class Poses(Shown):
    """An arm at many configurations, computed by Pinocchio on first use; the arrays are copies, not views of its memory.

    Attributes:
        model: the Pinocchio model.
        q: configurations (n, nq) [rad; m where a joint slides].
        frame_id: Pinocchio's number of the frame looked at.
        dh: the arm's DH table, or None.
        row: the DH row whose frame is looked at, or None where the table does not know the frame.
    """

    model: Any
    q: Array
    frame_id: int
    dh: DHTable | None = None
    row: int | None = None

    @cached_property
    def placement(self) -> Array:
        """Placement of the frame in the base, (n, 4, 4) [m]."""
        model, data = self.model, self.model.createData()
        placements = np.empty((len(self.q), 4, 4))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            placements[k] = pin.updateFramePlacement(model, data, self.frame_id).homogeneous
        return placements

    @property
    def position(self) -> Array:
        """Origin of the frame in the base, (n, 3) [m]."""
        return self.placement[:, :3, 3]

    @cached_property
    def jacobian(self) -> Array:
        """Twist of the frame per joint speed, linear first, ``LOCAL_WORLD_ALIGNED``: (n, 6, nq) [m/rad, rad/rad]."""
        model, data = self.model, self.model.createData()
        jacobians = np.empty((len(self.q), 6, self.q.shape[1]))
        for k, q in enumerate(self.q):
            jacobians[k] = pin.computeFrameJacobian(model, data, q, self.frame_id, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)
        return jacobians

    @cached_property
    def placement_sensitivity(self) -> Array:
        """∂position/∂(shift, turn of every joint placement in its own axes): (n, 3, 6 nq) [m/m, m/rad]."""
        model, data = self.model, self.model.createData()
        columns = np.empty((len(self.q), 3, 6 * (model.njoints - 1)))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            pin.updateFramePlacement(model, data, self.frame_id)
            columns[k] = pin.computeFrameKinematicRegressor(model, data, self.frame_id, pin.LOCAL_WORLD_ALIGNED)[:3]
        return columns

    def dh_sensitivity(self) -> Array:
        """∂position/∂(a, d, alpha, theta of each row) by the chain rule through the placements: (n, 3, 4 rows).

        The constant part of row i lies in the placement of the next joint, or behind the last joint in the frame itself;
        its derivative is a twist there, carried to the regressor's axes by an adjoint. Independent of the closed form
        of :meth:`DHTable.sensitivity`.

        Raises:
            UnsupportedArmError: the arm has no DH table, or the table does not know the frame.
        """
        if self.dh is None or self.row is None:
            frame = self.model.frames[self.frame_id].name
            raise UnsupportedArmError(f"{self.model.name}: frame {frame!r} is not one of the DH table")
        through_placements, behind_last_joint = _dh_columns(self.dh, self.row, self.q.shape[1])
        return self.placement_sensitivity @ through_placements + self.placement[:, :3, :3] @ behind_last_joint

    @cached_property
    def gravity_moments(self) -> Array:
        """Moment of the weight of all that hangs beyond each joint, about the joint's origin, base axes: (n, nq, 3) [N·m].

        Raises:
            UnsupportedArmError: no body of the arm has a mass.
        """
        if sum(inertia.mass for inertia in self.model.inertias) == 0.0:
            raise UnsupportedArmError(f"{self.model.name}: gravity moments need masses; the arm states none")
        model, data = self.model, self.model.createData()
        moments = np.empty((len(self.q), self.q.shape[1], 3))
        for k, q in enumerate(self.q):
            pin.centerOfMass(model, data, q, True)
            for joint in range(1, model.njoints):
                if data.mass[joint] == 0.0:  # Pinocchio's centre of nothing is 0/0
                    moments[k, joint - 1] = 0.0
                    continue
                lever = data.oMi[joint].rotation @ data.com[joint]
                moments[k, joint - 1] = np.cross(lever, data.mass[joint] * self.model.gravity.linear)
        return moments


def _dh_columns(dh: DHTable, row: int, nq: int) -> tuple[Array, Array]:
    """How the DH values up to ``row`` act: on the joint placements, and on the frame behind the last joint.

    Going backwards along the chain, ``to_target`` is the constant transform from the piece at hand to the next joint's
    axes (or to the frame itself); the unit twist of the piece, seen from there, is the column.

    Returns:
        (6 nq, 4 rows) and (3, 4 rows), the latter in the axes of the frame.
    """
    through, behind = np.zeros((6 * nq, 4 * dh.rows)), np.zeros((3, 4 * dh.rows))
    to_target, target = pin.SE3.Identity(), None
    joint = int(dh.moving[:row].sum())
    for i in reversed(range(row)):
        for kind, piece in reversed(_row_pieces(dh, i)):
            if kind is None:  # the joint itself
                target, to_target = joint, pin.SE3.Identity()
                joint -= 1
                continue
            to_target = piece * to_target
            motion = to_target.actInv(_unit_twist(kind))
            if target is None:
                behind[:, 4 * i + KINDS.index(kind)] = motion.linear
            else:
                through[6 * (target - 1) : 6 * target, 4 * i + KINDS.index(kind)] = motion.vector
    return through, behind


def _row_pieces(dh: DHTable, i: int) -> list[tuple[str | None, Any]]:
    """The constant transforms of row i in their order, with the joint, if any, as (None, None)."""
    zero = np.zeros(3)
    theta = ("theta_offset", pin.SE3(pin.utils.rotate("z", dh.theta_offset[i]), zero))
    d = ("d", pin.SE3(np.eye(3), np.array([0.0, 0.0, dh.d[i]])))
    a = ("a", pin.SE3(np.eye(3), np.array([dh.a[i], 0.0, 0.0])))
    alpha = ("alpha", pin.SE3(pin.utils.rotate("x", dh.alpha[i]), zero))
    joint: list[tuple[str | None, Any]] = [(None, None)] if dh.moving[i] else []
    if dh.standard:
        return [theta, *joint, d, a, alpha]
    return [alpha, a, theta, *joint, d]


def _unit_twist(kind: str) -> Any:
    """Motion that a unit of this value makes, in the axes where the value stands."""
    vector = np.zeros(6)
    vector[{"a": 0, "d": 2, "alpha": 3, "theta_offset": 5}[kind]] = 1.0
    return pin.Motion(vector)
