"""What to measure next."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.cli.arm_options import MeasuredHow, UncertainArm, in_metres, where_known
from aacmm_pin.cli.common import Force, Json, Output, Results, Seed, command, note, refuse, say
from aacmm_pin.cli.plan_acceptance import Artefacts, tell_lowest
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning import CalibrationPlan, MeasurementPlan, plan_calibration, plan_measurements
from aacmm_pin.planning.plan import POSTURES, Reference
from aacmm_pin.report import html, terminal
from aacmm_pin.report.calibration_plan import calibration_plan_document
from aacmm_pin.report.plan import plan_document

PURPOSES = ("causes", "calibration", "acceptance")
OPTIONS_FOR = {
    ("split", "set_up_arm", "as_it_stands"): ("causes",),
    tuple(f.name for f in fields(MeasuredHow)): ("causes", "calibration"),
    ("data", "json_", "records", "reference", "postures"): ("causes", "calibration"),
    tuple(f.name for f in fields(Artefacts)): ("acceptance",),
}
"""Options, by the names of their arguments, that some purposes have no use for."""


@command
def run(
    context: typer.Context,
    arm: UncertainArm,
    how: MeasuredHow,
    for_: Annotated[
        str,
        typer.Option(
            "--for",
            help="causes: tell them apart; calibration: most of the geometry; acceptance: touches of "
            "ISO 10360-12:2016 and ASME B89.4.22-2004, for accept.",
        ),
    ] = "causes",
    split: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="CAUSE CAUSE",
            help="Causes to tell apart, such as encoder_eccentricity:3 joint_compliance:3,compliance_rad_per_nm=2e-5; "
            "one without values has its typical magnitude.",
        ),
    ] = None,
    records: Annotated[int, typer.Option(min=1, help="Number of records to plan.")] = 40,
    *,
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
    sheet: Annotated[Path | None, typer.Option(help="HTML page to print, with positions and articulations.")] = None,
    artefacts: Artefacts,
    set_up_arm: Annotated[Path | None, typer.Option(help="File for the arm as the plan wants it set up.")] = None,
    json_: Json = None,
    force: Force = False,
) -> None:
    """What to measure next: postures and set-up, as a file to be filled in."""
    _refuse_others(context, for_)
    if for_ == "acceptance":
        artefacts.plan(arm, above_mm, seed, output, sheet, force)
        return
    if as_it_stands and split is None:
        raise typer.BadParameter("--as-it-stands goes with --split; without it a plan changes neither load nor mount")
    with Results(force, output, set_up_arm, sheet, json_=json_) as results:
        model = where_known(arm.model())
        existing = None if data is None else Measurements.read(data, model.arm.nq)
        if how.length_noise_mm is not None and (existing is None or not existing.bars()):
            raise typer.BadParameter("--length-noise-mm goes with --data that has bars; a plan has none of its own")
        options: dict[str, Any] = {
            "existing": existing,
            "reference": cast(Reference, reference),
            "above": in_metres(above_mm),
            "postures": postures,
            "rng": np.random.default_rng(seed),
            **how.keywords(),
        }
        plan: CalibrationPlan | MeasurementPlan
        if for_ == "calibration":
            plan = plan_calibration(model, records, **options)
            document = calibration_plan_document(plan)
        else:
            plan = plan_measurements(model, split, records, as_it_stands=as_it_stands, **options)
            document = plan_document(plan)
        if output is not None or (json_ is None and sheet is None):
            results.text(plan.csv() if existing is None else _like(existing, plan.records), output)
        if sheet is not None:
            results.text(html.page(document), sheet)
        if set_up_arm is not None and isinstance(plan, MeasurementPlan):
            results.arm(plan.model, set_up_arm, f"Set up to be measured by a plan: {plan.setup}.")
        results.json(plan.summary(), json_)
    told_of = None if json_ == "-" else output
    terminal.show(document, told_of is None)
    tell_lowest(plan.model.predict(plan.measurements.q, plan.measurements.conditions) @ plan.model.arm.up, above_mm)
    if isinstance(plan, MeasurementPlan):
        _tell_what_to_do(plan, told_of, set_up_arm is not None)
        if told_of is not None:
            note(f"note: chosen from {postures} postures, seed {seed}")


def _refuse_others(context: typer.Context, purpose: str) -> None:
    """Refuse a purpose that is none, and options that it has no use for."""
    if purpose not in PURPOSES:
        raise UnknownNameError("purpose", purpose, [*PURPOSES])
    for names, purposes in OPTIONS_FOR.items():
        if purpose not in purposes:
            refuse(context, names, f"goes with --for {' or '.join(purposes)}")


def _tell_what_to_do(plan: MeasurementPlan, file: Path | None, arm_written: bool) -> None:
    """How the file is filled in, where it was told of, and with which arm it is diagnosed."""
    if file is not None:
        only = "" if plan.needed else "for that check, "
        where = "where the arm only comes near a posture, enter the angles indicated"
        say(f"{file}: {only}fill in x_mm, y_mm, z_mm; {where}")
    if plan.changes_arm and not arm_written:
        note("note: this set-up is another arm file, which --set-up-arm FILE writes; diagnose the new records with it")


def _like(existing: Measurements, records: pd.DataFrame) -> str:
    """The plan with its columns in the order, and its angles in the unit, of the file to which it will be appended."""
    header = pd.Index(existing.header)
    if "theta1_rad" in header:
        angles = [str(name) for name in records.filter(like="theta")]
        records = records.assign(**{name: np.radians(records[name]) for name in angles})
        records = records.rename(columns={name: name.replace("_deg", "_rad") for name in angles})
    order = [*header.intersection(records.columns, sort=False), *records.columns.difference(header, sort=False)]
    return csv_text(records[order])
