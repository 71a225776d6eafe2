"""What depends on when, and on how the joint came: warm-up and hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError


@dataclass(frozen=True)
class ZeroDrift(Effect):
    """The zero of one encoder wanders while it warms up: ``δ = A (1 - exp(-t/τ))``, t from switching on.

    Unit rad; typical 5e-5 to 3e-4, τ a quarter to two hours. Source: first-order heating. Needs ``time_s``. Confused with:
    ``encoder_slip`` where τ is short, ``thermal_expansion`` where the room warms up alike.
    """

    joint: int
    time_constant_s: float
    cause: ClassVar[str] = "zero_drift"
    needs: ClassVar[tuple[str, ...]] = ("time",)

    def __post_init__(self) -> None:
        """Check the time constant."""
        super().__post_init__()
        if not (np.isfinite(self.time_constant_s) and self.time_constant_s > 0):
            raise AacmmError(f"{self.label}: time_constant_s is {self.time_constant_s}, expected seconds above zero")

    def inner_widths(self) -> dict[str, float]:
        """The time constant, known to a factor of three or so."""
        return {"time_constant_s": 2.0 * self.time_constant_s}

    @property
    def terms(self) -> tuple[Term, ...]:
        """The drift in the end."""
        return (Term("", "rad", 2e-4, "drift_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """How far the warm-up has come."""
        time = state.conditions.require("time", self.label)
        return [about_axis(state, self.joint, -np.expm1(-time / self.time_constant_s)[:, None])]


@dataclass(frozen=True)
class JointHysteresis(Effect):
    """Friction, a cable or a coupling holds the joint back on the side that it came from: ``δ = h s``, s = -1, 0, 1.

    Unit rad, half of the reversal error; typical 2e-5 to 2e-4. Source: ISO 230-2 reversal value. Needs ``approachN``.
    Confused with: hysteresis of neighbours that always move together.
    """

    joint: int
    cause: ClassVar[str] = "joint_hysteresis"
    needs: ClassVar[tuple[str, ...]] = ("approach",)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Half of the reversal error."""
        return (Term("", "rad", 1e-4, "half_width_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """The sign of the last motion."""
        approach = state.conditions.require("approach", self.label)
        return [about_axis(state, self.joint, approach[:, state.joint(self.joint), None])]
