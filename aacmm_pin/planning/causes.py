"""The causes that a plan is to tell apart: by their names, or all that an arm can have."""

from __future__ import annotations

from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects import Effect, all_candidates
from aacmm_pin.effects.error_model import require_row
from aacmm_pin.errors import AacmmError


def checked(effects: tuple[Effect, ...], arm: Arm) -> None:
    """Refuse causes that no plan can be about.

    Raises:
        AacmmError: one that is refitted anyway, one on a row that the arm does not have, or the same twice.
    """
    for effect in effects:
        if effect.refitted and effect.site() != "marker":  # the tip is refitted only where the target is unknown
            raise AacmmError(f"{effect.label} is refitted in every diagnosis, expected a cause that stands beside geometry")
        require_row(effect, arm)
        if effect.site() == "joint" and effect.row not in arm.chain.moving_rows():
            raise AacmmError(f"{effect.label}: row {effect.row} of {arm.name} is rigid, expected one with a joint")
    if len(effects) != len({e.identity for e in effects}):
        raise AacmmError(f"{effects[0].key} is there twice, expected two different causes")


def usual_causes(arm: Arm) -> tuple[Effect, ...]:
    """Every cause that the arm can have, typical in size; but for those with an order or time of their own."""
    return tuple(effect for effect, *others in all_candidates(arm) if not (others or effect.inner))
