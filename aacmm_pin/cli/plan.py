"""What to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.cli.arm_options import MeasuredHow, UncertainArm, in_metres
from aacmm_pin.cli.common import Force, Json, Output, Results, Seed, command, note, say
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning import plan_measurements
from aacmm_pin.planning.plan import POSTURES, Reference
from aacmm_pin.report import terminal
from aacmm_pin.report.plan import plan_document


@command
def run(
    arm: UncertainArm,
    how: MeasuredHow,
    split: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="CAUSE CAUSE",
            help="Causes to tell apart, such as encoder_eccentricity:3 joint_compliance:3,compliance_rad_per_nm=2e-5; "
            "one without values has its usual size.",
        ),
    ] = None,
    records: Annotated[int, typer.Option(min=1, help="Number of records to plan.")] = 40,
    data: Annotated[str | None, typer.Option(metavar="FILE", help="Measurement file that is there already.")] = None,
    reference: Annotated[
        str,
        typer.Option(help="free: each record has coordinates of its own; seats: at the seats of --data, or at new ones."),
    ] = "free",
    above_mm: Annotated[float | None, typer.Option(help="Height of a table over the base, under which no tip goes.")] = None,
    as_it_stands: Annotated[bool, typer.Option("--as-it-stands", help="No load and no other mount.")] = False,
    postures: Annotated[int, typer.Option(min=1, help="Number of postures to choose from.")] = POSTURES,
    seed: Seed = 1,
    output: Output = None,
    set_up_arm: Annotated[Path | None, typer.Option(help="File for the arm as the plan wants it set up.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """What to measure next to tell causes apart: postures and set-up, as a measurement file to be filled in."""
    with Results(force, output, set_up_arm, json_=json_, reads=[*arm.files, data]) as results:
        model = arm.model()
        if set_up_arm is not None:
            model.arm.require_dh(f"{set_up_arm}, an arm file,")
        plan = plan_measurements(
            model,
            split,
            records,
            existing=None if data is None else Measurements.read(data, model.arm.nq),
            reference=cast(Reference, reference),
            above=in_metres(above_mm),
            as_it_stands=as_it_stands,
            postures=postures,
            rng=np.random.default_rng(seed),
            **how.keywords(),
        )
        if output is not None or json_ is None:
            results.text(plan.csv() if data is None else _like(data, plan.records), output)
        if set_up_arm is not None:
            plan.model.save(results.file(set_up_arm), comment=f"Set up to be measured by a plan: {plan.setup}.")
        results.json(plan.summary(), json_)
    if output is not None and json_ != "-":
        terminal.show(plan_document(plan))
        say(f"{output}: fill in x_mm, y_mm, z_mm; where the arm only comes near a posture, enter the angles indicated")
    else:
        terminal.show_notes(plan.notes)
    if plan.changes_arm and set_up_arm is None:
        note("note: this set-up is another arm file, which --set-up-arm FILE writes; diagnose the new records with it")
    if output is not None and json_ != "-":
        note(f"note: chosen from {postures} postures, seed {seed}")


def _like(data: str, records: pd.DataFrame) -> str:
    """The plan with its columns in the order, and its angles in the unit, of the file to which it will be appended."""
    header = read_table(data)[0].columns
    if "theta1_rad" in header:
        angles = [str(name) for name in records.filter(like="theta")]
        records = records.assign(**{name: np.radians(records[name]) for name in angles})
        records = records.rename(columns={name: name.replace("_deg", "_rad") for name in angles})
    order = [*header.intersection(records.columns, sort=False), *records.columns.difference(header, sort=False)]
    return csv_text(records[order])
