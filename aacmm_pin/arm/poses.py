"""Poses of an arm, computed by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown


@dataclass(frozen=True, eq=False)
class Poses(Shown):
    """An arm at many configurations, computed by Pinocchio on first use; the arrays are copies, not
    views of its memory.

    Attributes:
        model: the Pinocchio model.
        q: configurations (n, nq) [rad; m where a joint slides]; of joints that follow others too.
        frame_id: Pinocchio's number of the frame looked at.
    """

    model: Any
    q: Array
    frame_id: int

    @cached_property
    def placement(self) -> Array:
        """Placement of the frame in the base, (n, 4, 4) [m]."""
        model = self.model
        data = self.model.createData()
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
        """Twist of the frame per joint speed, linear first, ``LOCAL_WORLD_ALIGNED``: (n, 6, nq)
        [m/rad, rad/rad].
        """
        model = self.model
        data = self.model.createData()
        jacobians = np.empty((len(self.q), 6, self.q.shape[1]))
        for k, q in enumerate(self.q):
            jacobians[k] = pin.computeFrameJacobian(
                model, data, q, self.frame_id, pin.LOCAL_WORLD_ALIGNED
            ).reshape(6, -1)
        return jacobians

    @cached_property
    def placement_sensitivity(self) -> Array:
        """∂position/∂(shift, turn of every joint placement in its own axes): (n, 3, 6 nq) [m/m,
        m/rad].
        """
        model = self.model
        data = self.model.createData()
        columns = np.empty((len(self.q), 3, 6 * (model.njoints - 1)))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            pin.updateFramePlacement(model, data, self.frame_id)
            columns[k] = pin.computeFrameKinematicRegressor(
                model, data, self.frame_id, pin.LOCAL_WORLD_ALIGNED
            )[:3]
        return columns
