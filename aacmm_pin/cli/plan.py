"""What to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import numpy as np
import typer

from aacmm_pin.calibration.calibrate import ReferenceFrame
from aacmm_pin.calibration.parameters import Target
from aacmm_pin.cli.arm_options import (
    FrameName,
    FrameOfReferences,
    LengthNoise,
    MaybeArm,
    NoPrior,
    ProbeNoise,
    ReferenceNoise,
    TargetName,
    Urdf,
    in_metres,
    model_of,
)
from aacmm_pin.cli.common import EncoderNoise, Force, Json, Output, Results, Seed, command, note, say
from aacmm_pin.cli.tables import show
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning import MeasurementPlan, plan_measurements
from aacmm_pin.planning.plan import POSTURES, Reference
from aacmm_pin.report.plan_tables import pairs_table, tried_table

MOST_PAIRS = 8
"""Pairs that are told worst are listed up to this number; the JSON has all that are not told."""


@command("plan")
def plan_(
    arm: MaybeArm = None,
    split: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="CAUSE CAUSE", help="Causes to tell apart, such as encoder_eccentricity:3 joint_compliance:3."),
    ] = None,
    records: Annotated[int, typer.Option(min=1, help="Number of records to plan.")] = 40,
    data: Annotated[str | None, typer.Option(metavar="FILE", help="Measurement file that is there already.")] = None,
    reference: Annotated[
        str,
        typer.Option(help="free: each record has coordinates of its own; seats: at the seats of --data, or at new ones."),
    ] = "free",
    reference_frame: FrameOfReferences = "base",
    target: TargetName = "tip",
    no_prior: NoPrior = False,
    encoder_noise_rad: EncoderNoise = None,
    reference_noise_mm: ReferenceNoise = None,
    probe_noise_mm: ProbeNoise = None,
    length_noise_mm: LengthNoise = None,
    above_mm: Annotated[float | None, typer.Option(help="Height of a table over the base, under which no tip goes.")] = None,
    as_it_stands: Annotated[bool, typer.Option("--as-it-stands", help="No load and no other mount.")] = False,
    postures: Annotated[int, typer.Option(min=1, help="Number of postures to choose from.")] = POSTURES,
    seed: Seed = 1,
    urdf: Urdf = None,
    frame: FrameName = None,
    output: Output = None,
    set_up_arm: Annotated[Path | None, typer.Option(help="File for the arm as the plan wants it set up.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """What to measure next to tell causes apart: postures and set-up, as a measurement file to be filled in."""
    with Results(force, output, set_up_arm, json_=json_) as results:
        model = model_of(arm, urdf, frame)
        if set_up_arm is not None and model.arm.dh is None:
            raise AacmmError(f"{set_up_arm}: an arm file needs a DH table, {model.arm.name} came as URDF")
        plan = plan_measurements(
            model,
            split,
            records,
            existing=None if data is None else Measurements.read(data, model.arm.nq),
            reference=cast(Reference, reference),
            reference_frame=cast(ReferenceFrame, reference_frame),
            target=cast(Target, target),
            prior=not no_prior,
            encoder_noise=encoder_noise_rad,
            reference_noise=in_metres(reference_noise_mm),
            probe_noise=in_metres(probe_noise_mm),
            length_noise=in_metres(length_noise_mm),
            above=in_metres(above_mm),
            as_it_stands=as_it_stands,
            postures=postures,
            rng=np.random.default_rng(seed),
        )
        if output is not None:
            results.text(plan.csv(), output)
        if set_up_arm is not None:
            plan.model.save(results.file(set_up_arm), comment=f"Set up to be measured by a plan: {plan.setup}.")
        if json_ is not None:
            results.json(plan.summary(), json_)
        elif output is None:
            results.text(plan.csv(), None)
    for text in plan.notes:
        note(f"note: {text}")
    if plan.changes_arm and set_up_arm is None:
        note("note: this set-up is another arm file, which --set-up-arm FILE writes; diagnose the new records with it")
    if output is not None and json_ != "-":
        _say(plan, output)
        note(f"note: chosen from {postures} postures, seed {seed}")


def _say(plan: MeasurementPlan, output: Path) -> None:
    say(str(plan))
    for words in plan.set_up:
        say(f"set-up: {words}")
    if len(plan.tried) > 1:
        show(tried_table(plan), {"T": ".3g"}, "set-ups that were considered:")
    show(pairs_table(plan).head(MOST_PAIRS), {"T": ".3g"}, "told worst, of what these postures can tell:")
    say(f"{output}: fill in x_mm, y_mm, z_mm; where the hand ends up near a posture, put what the encoders indicate there")
