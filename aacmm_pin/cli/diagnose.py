"""What the simulation gets wrong, and why."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin.calibration.calibrate import ReferenceFrame
from aacmm_pin.calibration.parameters import Target
from aacmm_pin.cli.arm_options import (
    Data,
    FrameName,
    FrameOfReferences,
    LengthNoise,
    MaybeArm,
    NoPrior,
    ProbeNoise,
    ReferenceNoise,
    RotationHalfWidth,
    TargetName,
    TranslationHalfWidth,
    Urdf,
    in_metres,
    model_and_data,
)
from aacmm_pin.cli.common import EncoderNoise, Force, Json, Results, Seed, command, note
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.measurements.records import Measurements


@command("diagnose")
def diagnose_(
    arm: MaybeArm = None,
    data: Data = None,
    reference_frame: FrameOfReferences = "base",
    target: TargetName = "tip",
    no_prior: NoPrior = False,
    encoder_noise_rad: EncoderNoise = None,
    reference_noise_mm: ReferenceNoise = None,
    probe_noise_mm: ProbeNoise = None,
    length_noise_mm: LengthNoise = None,
    no_held_out: Annotated[bool, typer.Option("--no-held-out", help="Do not measure the gain.")] = False,
    seed: Seed = 1,
    urdf: Urdf = None,
    frame: FrameName = None,
    translation_half_width_mm: TranslationHalfWidth = None,
    rotation_half_width_rad: RotationHalfWidth = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="HTML page of all that was found.")] = None,
    extended_arm: Annotated[Path | None, typer.Option(help="Arm file for the extended model.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """What the simulation gets wrong, which cause it has, and how much better the arm is once the model knows."""
    with Results(force, output, extended_arm, json_=json_) as results:
        model, path = model_and_data(arm, data, urdf, frame, translation_half_width_mm, rotation_half_width_rad)
        if extended_arm is not None and model.arm.dh is None:
            raise UnsupportedArmError(f"{extended_arm}: an arm file needs a DH table, {model.arm.name} came as URDF")
        result = diagnose(
            model,
            Measurements.read(path, model.arm.nq),
            reference_frame=cast(ReferenceFrame, reference_frame),
            target=cast(Target, target),
            prior=not no_prior,
            encoder_noise=encoder_noise_rad,
            reference_noise=in_metres(reference_noise_mm),
            probe_noise=in_metres(probe_noise_mm),
            length_noise=in_metres(length_noise_mm),
            hold_out=not no_held_out,
            rng=np.random.default_rng(seed),
        )
        if extended_arm is not None:
            result.model.save(results.file(extended_arm), comment=f"Extended by aacmm-pin diagnose from {path}: {result}")
        summary = result.summary() | {"source": path, "seed": seed}
        if output is not None:
            from aacmm_pin.report.diagnosis_page import diagnosis_page  # here and below: loads what draws

            results.text(diagnosis_page(result, summary, f"{datetime.now(UTC):%Y-%m-%d}"), output)
        if json_ is not None:
            results.json(summary, json_)
    for text in result.notes:
        note(f"note: {text}")
    if json_ != "-":
        from aacmm_pin.cli.diagnosis_text import say_diagnosis

        say_diagnosis(result)
