"""Poses of an arm, computed by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import count


@dataclass(frozen=True, eq=False)
class Poses(Shown):
    """Placements of one frame, computed by Pinocchio at the first use.

    Attributes:
        q: ``(n, nq)`` [rad; m for prismatic joints], with joints that follow others.
        frame_id: in Pinocchio.
    """

    model: Any
    q: Array
    frame_id: int

    def __str__(self) -> str:
        return f"{count(len(self.q), 'posture')} of frame {self.model.frames[self.frame_id].name}"

    @cached_property
    def placement(self) -> Array:
        """The placement of the frame in the base, ``(n, 4, 4)`` [m]."""
        model = self.model
        data = self.model.createData()
        placements = np.empty((len(self.q), 4, 4))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            placements[k] = pin.updateFramePlacement(model, data, self.frame_id).homogeneous
        return placements

    @property
    def position(self) -> Array:
        """The origin of the frame in the base, ``(n, 3)`` [m]."""
        return self.placement[:, :3, 3]
