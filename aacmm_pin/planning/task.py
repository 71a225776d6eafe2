"""The task of a plan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Frame, Problem, Setup, problem_of, registered
from aacmm_pin.effects import Conditions, Effect, ErrorModel, all_candidates, require_row
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements


@dataclass(frozen=True, eq=False)
class Task:
    """The task of a plan.

    Attributes:
        causes: to distinguish, values zero.
        existing: evaluated with the new records.
        setup: how records are taken, with all noise.
    """

    model: ErrorModel
    causes: tuple[Effect, ...]
    existing: Measurements | None
    setup: Setup

    @property
    def conditions(self) -> Conditions:
        """Of the existing records."""
        return Conditions(0) if self.existing is None else self.existing.conditions

    @property
    def temperature(self) -> float:
        """Mean so far, else the reference temperature of the arm [°C]."""
        for values in (self.conditions.temperature, self.conditions.link_temperature):
            if values is not None:
                return float(np.round(values.mean(), 1))
        return self.model.arm.reference_temperature

    def problem(self, model: ErrorModel, records: Measurements) -> Problem:
        """Geometry and causes unknown; other effects of the model stay."""
        return problem_of(model, records, ["geometry", *self.causes], self.setup)

    @cached_property
    def frame(self) -> Frame:
        """The base in the frame of the references, by existing records."""
        if not self.setup.external or self.existing is None or self.existing.known.sum() < 3:
            return Frame.identity()
        placed = self.existing.take(self.existing.known)
        return registered(self.model.predict(placed.q, placed.conditions), placed.reference)


def require_separable(effects: tuple[Effect, ...], arm: Arm) -> None:
    """Refuse causes that no plan can distinguish."""
    for effect in effects:
        # The tip is refitted only where the target is unknown.
        if effect.refitted and effect.location_field() != "marker":
            raise AacmmError(
                f"{effect.label}: every diagnosis estimates this parameter; expected a cause that "
                "diagnose can name"
            )
        require_row(effect, arm)
        if effect.location_field() == "joint" and effect.row not in arm.chain.moving_rows():
            raise AacmmError(
                f"{effect.label}: row {effect.row} of {arm.name} is rigid; expected a row with a "
                "joint"
            )
    if len(effects) != len({e.identity for e in effects}):
        raise AacmmError(f"{effects[0].key} occurs twice; expected two different causes")


def usual_causes(model: ErrorModel) -> tuple[Effect, ...]:
    """Every further possible cause of typical magnitude, but for those with an order or time of
    their own.
    """
    present = {effect.identity for effect in model.effects}
    usual = (
        effect
        for effect, *others in all_candidates(model.arm)
        if not (others or effect.nonlinear.field)
    )
    return tuple(effect for effect in usual if effect.identity not in present)
