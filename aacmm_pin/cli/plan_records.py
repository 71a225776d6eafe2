"""What plans of records share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.cli.arm_options import UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    CsvOutput,
    Force,
    Json,
    Results,
    Seed,
    length_option,
    note,
    page_option,
)
from aacmm_pin.cli.measuring_options import MeasuredHow
from aacmm_pin.measurements import Measurements, as_measurements
from aacmm_pin.planning import POOL_SIZE, CalibrationPlan, MeasurementPlan, PlannedScheme
from aacmm_pin.report import Document, terminal

Plan = TypeVar("Plan", CalibrationPlan, MeasurementPlan)
TableHeight = Annotated[
    float | None,
    length_option(
        "--table-height-mm",
        "Height of a table above the base. The plan keeps the tip above the table.",
        COORDINATE,
    ),
]


Sheet = Annotated[Path | None, page_option("a page to print, with positions and postures")]


@dataclass(frozen=True)
class PlannedRecords:
    """Planned records, and their files."""

    records: Annotated[int, typer.Option(metavar="N", min=1, help="Number of records to plan.")] = (
        40
    )
    existing: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.csv", help="Existing records, to which the plan adds new records."
        ),
    ] = None
    scheme: Annotated[
        PlannedScheme,
        typer.Option(
            help="Kind of reference data. free: coordinates of each record. seats: seats of "
            "--existing. If --existing has no seats, the plan proposes new seats.",
        ),
    ] = "free"
    postures: Annotated[
        int,
        typer.Option(metavar="N", min=1, help="Number of postures from which the plan chooses."),
    ] = POOL_SIZE
    above: TableHeight = None
    seed: Seed = 1
    output: CsvOutput = None
    sheet: Sheet = None
    json_: Json = None
    force: Force = False

    @property
    def csv_on_stdout(self) -> bool:
        """Whether other results than the plan's page take stdout."""
        return self.output is None or self.json_ == "-"


def plan_records(
    arm: UncertainArm,
    planned: PlannedRecords,
    how: MeasuredHow,
    choose: Callable[..., Plan],
    document_of: Callable[[Plan], Document],
    arm_out: Path | None = None,
) -> Plan:
    with Results(planned, planned.output, arm_out, page=planned.sheet) as results:
        model, existing = restrict_to_known_range(arm.model()), None
        if planned.existing is not None:
            existing = as_measurements(planned.existing, model.arm)
        if how.length_noise is not None and (existing is None or not existing.bars()):
            raise typer.BadParameter(
                "--u-bar-mm requires --existing with bars; planned records have no bars"
            )
        plan = choose(
            model,
            existing=existing,
            records=planned.records,
            scheme=planned.scheme,
            postures=planned.postures,
            above=planned.above,
            rng=np.random.default_rng(planned.seed),
            **how.keywords(),
        )
        document = document_of(plan)
        if planned.output is not None or (planned.json_ is None and planned.sheet is None):
            text = plan.csv() if existing is None else _csv_like(existing, plan.records)
            results.text(text, planned.output)
        results.document(document, planned.sheet)
        results.json(plan.summary())
        if isinstance(plan, MeasurementPlan) and arm_out is not None:
            results.arm(plan.model, arm_out, f"Set-up of a plan: {plan.setup}.")
    terminal.show(document, planned.csv_on_stdout)
    tips = plan.model.predict(plan.measurements.q, plan.measurements.conditions)
    note_lowest_tip(tips @ plan.model.arm.up, planned.above)
    return plan


def note_lowest_tip(heights: Array, above: float | None) -> None:
    if above is None and heights.min() < 0:
        note(
            f"the lowest planned position of the tip is {-heights.min() / MM:.0f} mm below the "
            "base; if the arm stands on a table, use --table-height-mm"
        )


def _csv_like(existing: Measurements, records: pd.DataFrame) -> str:
    """The plan with columns and angle unit of the file that it extends."""
    header = pd.Index(existing.header)
    if "theta1_rad" in header:
        angles = [str(name) for name in records.filter(like="theta")]
        radians = {name: np.radians(records[name]) for name in angles}
        names = {name: name.replace("_deg", "_rad") for name in angles}
        records = records.assign(**radians).rename(columns=names)
    columns = header.intersection(records.columns, sort=False)
    others = records.columns.difference(header, sort=False)
    return csv_text(records[[*columns, *others]])
