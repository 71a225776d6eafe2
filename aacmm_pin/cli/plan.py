"""What to measure next."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin.cli.arm_options import MeasuredHow, UncertainArm, in_metres, restrict_to_known_range
from aacmm_pin.cli.common import (
    CsvOutput,
    Force,
    Json,
    Results,
    Seed,
    command,
    note,
    page_option,
    refuse,
    say,
)
from aacmm_pin.cli.plan_acceptance import Artefacts, note_lowest_tip
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning import (
    POOL_SIZE,
    CalibrationPlan,
    MeasurementPlan,
    Reference,
    plan_calibration,
    plan_measurements,
)
from aacmm_pin.report import Document, calibration_plan_document, plan_document, terminal


@dataclass(frozen=True)
class PlanFiles:
    """Files of every plan."""

    output: CsvOutput = None
    sheet: Annotated[
        Path | None,
        page_option("Page to print, with positions and postures"),
    ] = None
    force: Force = False


@dataclass(frozen=True)
class PlannedRecords:
    """Records of the arm, to distinguish causes or for a calibration."""

    records: Annotated[int, typer.Option(min=1, help="Number of records to plan.")] = 40
    existing: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="File of existing measurements."),
    ] = None
    reference: Annotated[
        str,
        typer.Option(
            help="Reference data: free (each record has its own coordinates) or seats (those of "
            "--existing, or new ones).",
        ),
    ] = "free"
    postures: Annotated[
        int,
        typer.Option(min=1, help="Number of postures to choose from."),
    ] = POOL_SIZE
    json_: Json = None

    def existing_records(self, model: ErrorModel, how: MeasuredHow) -> Measurements | None:
        """The records of ``--existing``."""
        records = None if self.existing is None else Measurements.read(self.existing, model.arm.nq)
        if how.length_noise_mm is not None and (records is None or not records.bars()):
            raise typer.BadParameter(
                "--length-noise-mm requires --existing with bars; a plan has none of its own"
            )
        return records


@dataclass(frozen=True)
class CausesToSplit:
    """Which causes the records distinguish, and what may be changed for it."""

    distinguish: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="CAUSE CAUSE",
            help="Causes to distinguish, such as encoder_eccentricity:3 "
            "joint_compliance:3,compliance_rad_per_nm=2e-5. A cause without values has its typical "
            "magnitude.",
        ),
    ] = None
    keep_set_up: Annotated[
        bool,
        typer.Option("--keep-set-up", help="Propose neither a load nor another mount."),
    ] = False
    arm_out: Annotated[
        Path | None,
        typer.Option(help="Arm file with the set-up that the plan proposes."),
    ] = None


OPTIONS_FOR: dict[str, tuple[type, ...]] = {
    "causes": (PlannedRecords, MeasuredHow, CausesToSplit),
    "calibration": (PlannedRecords, MeasuredHow),
    "acceptance": (Artefacts,),
}
"""Options that each purpose uses besides those of all."""


@command(
    "aacmm-pin plan my_arm.toml --for calibration --records 60 -o plan.csv --sheet plan.html",
    "aacmm-pin plan sino6 --distinguish encoder_gain:3 encoder_eccentricity:3 -o plan.csv",
)
def run(
    context: typer.Context,
    arm: UncertainArm,
    for_: Annotated[
        str,
        typer.Option(
            "--for",
            help="Purpose: causes (distinguish them), calibration (determine the geometry) or "
            "acceptance (probed points by public descriptions of ISO 10360-12:2016 and "
            "ASME B89.4.22-2004).",
        ),
    ] = "causes",
    table_height_mm: Annotated[
        float | None,
        typer.Option(help="Height of a table above the base; the tip stays above it."),
    ] = None,
    seed: Seed = 1,
    *,
    files: PlanFiles,
    planned: PlannedRecords,
    how: MeasuredHow,
    causes: CausesToSplit,
    artefacts: Artefacts,
) -> None:
    """Plan measurements: write postures and set-up as a file to fill in."""
    _refuse_unused(context, for_)
    if for_ == "acceptance":
        artefacts.plan(arm, table_height_mm, seed, files.output, files.sheet, files.force)
        return
    if causes.keep_set_up and causes.distinguish is None:
        raise typer.BadParameter(
            "--keep-set-up requires --distinguish; without it a plan changes neither load nor mount"
        )
    json_ = planned.json_
    outputs = (files.output, causes.arm_out)
    with Results(files.force, *outputs, page=files.sheet, json_=json_) as results:
        model = restrict_to_known_range(arm.model())
        existing = planned.existing_records(model, how)
        options: dict[str, Any] = {
            "records": planned.records,
            "existing": existing,
            "reference": cast(Reference, planned.reference),
            "above": in_metres(table_height_mm),
            "postures": planned.postures,
            "rng": np.random.default_rng(seed),
            **how.keywords(),
        }
        plan, document = _planned(model, for_, causes, options)
        if files.output is not None or (json_ is None and files.sheet is None):
            text = plan.csv() if existing is None else _like(existing, plan.records)
            results.text(text, files.output)
        if files.sheet is not None:
            results.document(document, files.sheet)
        if causes.arm_out is not None and isinstance(plan, MeasurementPlan):
            comment = f"Set up to be measured by a plan: {plan.setup}."
            results.arm(plan.model, causes.arm_out, comment)
        results.json(plan.summary(), json_)
    output = None if json_ == "-" else files.output
    terminal.show(document, output is None)
    tips = plan.model.predict(plan.measurements.q, plan.measurements.conditions)
    note_lowest_tip(tips @ plan.model.arm.up, table_height_mm)
    if isinstance(plan, MeasurementPlan):
        _say_what_to_do(plan, output, causes.arm_out is not None)
        if output is not None:
            note(f"note: chosen from {planned.postures} postures, seed {seed}")


def _planned(
    model: ErrorModel,
    purpose: str,
    causes: CausesToSplit,
    options: dict[str, Any],
) -> tuple[CalibrationPlan | MeasurementPlan, Document]:
    if purpose == "calibration":
        calibration = plan_calibration(model, **options)
        return calibration, calibration_plan_document(calibration)
    plan = plan_measurements(model, causes.distinguish, as_it_stands=causes.keep_set_up, **options)
    return plan, plan_document(plan)


def _refuse_unused(context: typer.Context, purpose: str) -> None:
    """Refuse a purpose that is none, and options that it has no use for."""
    if purpose not in OPTIONS_FOR:
        raise UnknownNameError("purpose", purpose, list(OPTIONS_FOR))
    used = OPTIONS_FOR[purpose]
    for group in (PlannedRecords, MeasuredHow, CausesToSplit, Artefacts):
        if group not in used:
            purposes = [name for name, groups in OPTIONS_FOR.items() if group in groups]
            names = [field.name for field in fields(group)]
            refuse(context, names, f"requires --for {' or '.join(purposes)}")


def _say_what_to_do(plan: MeasurementPlan, file: Path | None, arm_written: bool) -> None:
    """How the file is filled in, and with which arm it is diagnosed."""
    if file is not None:
        only = "" if plan.needed else "for that check, "
        where = "if the arm is only near a posture, enter the angles that the encoders indicate"
        say(f"{file}: {only}fill in x_mm, y_mm, z_mm; {where}")
    if plan.changes_arm and not arm_written:
        note(
            "note: this set-up requires another arm file, which --arm-out FILE writes; diagnose "
            "the new records with it"
        )


def _like(existing: Measurements, records: pd.DataFrame) -> str:
    """The plan with the columns and the unit of angles of the file to which it will be appended."""
    header = pd.Index(existing.header)
    if "theta1_rad" in header:
        angles = [str(name) for name in records.filter(like="theta")]
        radians = {name: np.radians(records[name]) for name in angles}
        names = {name: name.replace("_deg", "_rad") for name in angles}
        records = records.assign(**radians).rename(columns=names)
    known = header.intersection(records.columns, sort=False)
    others = records.columns.difference(header, sort=False)
    return csv_text(records[[*known, *others]])
