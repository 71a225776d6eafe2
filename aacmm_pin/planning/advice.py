"""The one sentence about two look-alike causes that a diagnosis ends with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.calibrate import ReferenceFrame
from aacmm_pin.calibration.parameters import Target
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
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
    progress: bool = False,
    rng: np.random.Generator | None = None,
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
        reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise, progress, rng: see
            :func:`plan_measurements`.
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
            reference_frame=reference_frame,
            target=target,
            prior=prior,
            encoder_noise=encoder_noise,
            reference_noise=reference_noise,
            probe_noise=probe_noise,
            length_noise=length_noise,
            progress=progress,
            postures=max(QUICK, 2 * records),
            rng=rng,
        )
    except AacmmError as error:
        one, other = (cause if isinstance(cause, str) else cause.key for cause in split)
        return f"no records could be planned that tell {one} from {other}: {error}"
    return plan.sentence(arm, options)
