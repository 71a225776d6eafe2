"""Parameters of an arm from measurements."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.arm.urdf_writer import urdf_text
from aacmm_pin.calibration import Calibration, calibrate
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
from aacmm_pin.cli.calibration_text import say_calibration
from aacmm_pin.cli.common import EncoderNoise, Force, Json, Plot, Results, Seed, command, note
from aacmm_pin.cli.effect_options import EffectTexts, check_rows, known_effects
from aacmm_pin.effects import StylusOffset
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.report.calibration_findings import calibration_summary, comment, not_in_urdf


@command("calibrate")
def calibrate_(
    arm: MaybeArm = None,
    data: Data = None,
    parameters: Annotated[str, typer.Option(help="One of zero-offsets, geometry.")] = "geometry",
    effect: EffectTexts = None,
    reference_frame: FrameOfReferences = "base",
    target: TargetName = "tip",
    no_prior: NoPrior = False,
    encoder_noise_rad: EncoderNoise = None,
    reference_noise_mm: ReferenceNoise = None,
    probe_noise_mm: ProbeNoise = None,
    length_noise_mm: LengthNoise = None,
    no_held_out: Annotated[bool, typer.Option("--no-held-out", help="Do not predict records left out of the fit.")] = False,
    seed: Seed = 1,
    urdf: Urdf = None,
    frame: FrameName = None,
    translation_half_width_mm: TranslationHalfWidth = None,
    rotation_half_width_rad: RotationHalfWidth = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Arm file for the calibrated arm.")] = None,
    urdf_out: Annotated[Path | None, typer.Option(help="URDF for the calibrated arm.")] = None,
    residuals: Annotated[Path | None, typer.Option(help="CSV file: every record with its residuals.")] = None,
    plot: Plot = None,
    report: Annotated[Path | None, typer.Option(help="HTML page of all that was found.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """Parameters of an arm from measurements, with their uncertainty and what the data cannot tell."""
    with Results(force, output, urdf_out, residuals, report, plot=plot, json_=json_) as results:
        model, path = model_and_data(arm, data, urdf, frame, translation_half_width_mm, rotation_half_width_rad)
        if output is not None and model.arm.dh is None:
            raise UnsupportedArmError(
                f"{output}: an arm file needs a DH table, {model.arm.name} came as URDF; use --urdf-out"
            )
        effects = known_effects(effect, model)
        check_rows(effects, model)
        result = calibrate(
            model,
            Measurements.read(path, model.arm.nq),
            [parameters, *effects],
            reference_frame=cast(ReferenceFrame, reference_frame),
            target=cast(Target, target),
            prior=False if no_prior else None,
            encoder_noise=encoder_noise_rad,
            reference_noise=in_metres(reference_noise_mm),
            probe_noise=in_metres(probe_noise_mm),
            length_noise=in_metres(length_noise_mm),
            hold_out=not no_held_out,
            rng=np.random.default_rng(seed),
        )
        when = f"{datetime.now(UTC):%Y-%m-%d}"
        if output is not None:
            result.model.save(results.file(output), comment=comment(result, path, when))
        if urdf_out is not None:
            results.file(urdf_out).write_bytes(_urdf(model, result))
        if residuals is not None:
            results.text(result.residuals.to_csv(index=False), residuals)
        if plot is not None:
            results.picture(result.plot("all")[0].figure, plot)
        summary = calibration_summary(result, path, seed)
        if report is not None:
            from aacmm_pin.report.calibration_page import calibration_page  # loads what draws

            results.text(calibration_page(result, summary, when), report)
        if json_ is not None:
            results.json(summary, json_)
    if json_ != "-":
        say_calibration(result)


def _urdf(model: ErrorModel, result: Calibration) -> bytes:
    """The calibrated arm as URDF, as far as a URDF can say it."""
    lost = not_in_urdf(result)
    if lost:
        note(f"note: a URDF has no place for {', '.join(lost)}")
    arm = result.model.arm
    if arm.dh is not None:
        return urdf_text(result.model.file(), with_stylus_offset=True).encode()
    offsets = [e.values for e in result.model.effects if isinstance(e, StylusOffset) and e.marker is None]
    return corrected_urdf(model.arm, arm, np.sum(offsets, axis=0) if offsets else None)
