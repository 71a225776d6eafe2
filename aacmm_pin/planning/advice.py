"""The one sentence about two look-alike causes that a diagnosis ends with."""

from __future__ import annotations

from typing import Any

import numpy as np

from aacmm_pin.arm.arm import Arm
from aacmm_pin.effects import Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.plan import Reference, plan_measurements

QUICK = 200
"""Postures that are enough to say whether a plan would help; the plan itself then chooses from more."""


def advice(
    model: Arm | ErrorModel,
    split: tuple[Effect | str, Effect | str],
    existing: Measurements,
    records: int = 40,
    *,
    arm: str | None = None,
    options: str = "",
    progress: bool = False,
    **setup: Any,
) -> str:
    """What to measure next to tell two causes apart, in a sentence with the command that plans it.

    New records are taken as the old ones were: at their seats where most of them have one, else each with coordinates of
    its own. Where no plan can be made the sentence says why; nothing is raised for that.

    Args:
        model: the arm.
        split: the two causes, with their values where they are estimated.
        existing: the records that leave the two alike.
        records: how many to plan.
        arm: the arm as a command names it; default its name in small letters.
        options: more options of the command, such as `` --data old.csv``.
        progress: show a bar.
        setup: how records are taken, by keywords of :func:`plan_measurements`: ``reference_frame``, noise, ….
    """
    seat = existing.conditions.seat
    reference: Reference = "seats" if seat is not None and np.mean(seat != "") > 0.5 else "free"
    try:
        plan = plan_measurements(
            model,
            split,
            records,
            existing=existing,
            reference=reference,
            progress=progress,
            postures=max(QUICK, 2 * records),
            **setup,
        )
    except AacmmError as error:
        one, other = (cause if isinstance(cause, str) else cause.key for cause in split)
        return f"no records could be planned that tell {one} from {other}: {error}"
    return plan.sentence(arm, options)
