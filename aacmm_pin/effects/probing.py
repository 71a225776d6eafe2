"""What happens between the last joint and the part: where the ball really is, and how the stylus gives way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin._support.units import MM
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Term, shifts, twist
from aacmm_pin.effects.state import State
from aacmm_pin.errors import UnsupportedArmError

FARTHEST = 10.0
"""A target on the last body is within so much of the tip [m]."""
ANOTHER_POINT = 5e-4
"""No ball is so far from where its qualification has it: it is another point [m]."""


@dataclass(frozen=True)
class StylusOffset(Effect):
    """The ball or target is not at the tip: a constant shift in the axes of the last frame; with ``marker``, of that target.

    Unit m; typical 2e-5 of a qualified stylus, 0.1 of a target screwed on. Source: probe qualification, ISO 10360-12:2016.
    Needs ``marker`` where one is named. Confused with: a, d and θ of the last row, which move the same point.
    """

    marker: str | None = None
    cause: ClassVar[str] = "stylus_offset"
    refitted: ClassVar[bool] = True
    prior_weight: ClassVar[float] = 0.2
    terms: ClassVar[tuple[Term, ...]] = shifts(5e-5, FARTHEST)

    @property
    def needs(self) -> tuple[str, ...]:
        """The marker, where one is named."""
        return () if self.marker is None else ("marker",)

    def validity_notes(self, conditions: Conditions) -> list[str]:
        """That coordinates are of another point than the tip of the arm's geometry."""
        far = float(np.linalg.norm(self.values))
        if self.marker is not None or far < ANOTHER_POINT:
            return []
        return [f"{self.label}: coordinates are of the target, {far / MM:.4g} mm from the tip of the arm's geometry"]

    def displacements(self, state: State) -> list[Displacement]:
        """Unit shifts at the tip."""
        columns = twist(np.eye(3)[None])
        if self.marker is not None:
            columns = columns * (state.conditions.require("marker", self.label) == self.marker)[:, None, None]
        return [Displacement(state.arm.chain.tip, columns)]


@dataclass(frozen=True)
class StylusBending(Effect):
    """The stylus sags under gravity: ``δp = s (I - e eᵀ) down``, e its axis; s is the sag when it is level.

    Unit m; typical 1e-6 to 2e-5. Source: beam theory; probing force adds to it where the hand always pushes alike. Needs
    no column, but the stylus axis of the arm file. Confused with: ``bearing_tilt``, ``joint_compliance`` of the last joint.
    """

    cause: ClassVar[str] = "stylus_bending"
    prior_weight: ClassVar[float] = 0.2
    elastic: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = (Term("", "m", 1e-5, "level_sag_mm", MM, positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """Gravity across the stylus."""
        stylus = state.arm.stylus_axis
        if stylus is None:
            raise UnsupportedArmError(f"{self.label} needs the axis of the stylus ([stylus] in the arm file)")
        down = state.in_axes_of(state.arm.chain.tip, np.broadcast_to(state.down, (state.n, 3)))
        across = down - (down @ stylus)[:, None] * stylus
        return [Displacement(state.arm.chain.tip, twist(across[:, :, None]))]
