"""What the plans of records share: their options, their files, and what is said of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import MM
from aacmm_pin.cli.arm_options import in_metres
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
from aacmm_pin.effects import ErrorModel
from aacmm_pin.measurements import Measurements, as_measurements
from aacmm_pin.planning import POOL_SIZE, CalibrationPlan, MeasurementPlan, PlannedScheme
from aacmm_pin.report import Document, terminal

TableHeight = Annotated[
    float | None,
    length_option(
        "Height of a table above the base. The plan keeps the tip above the table.", COORDINATE
    ),
]


@dataclass(frozen=True)
class PlanFiles:
    """Files of every plan."""

    output: CsvOutput = None
    sheet: Annotated[
        Path | None,
        page_option("a page to print, with positions and postures"),
    ] = None
    force: Force = False


@dataclass(frozen=True)
class PlannedRecords(PlanFiles):
    """Records of the arm, to distinguish causes or for a calibration."""

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
    table_height_mm: TableHeight = None
    seed: Seed = 1
    json_: Json = None

    def results(self, arm_out: Path | None = None) -> Results:
        """The files of the command."""
        outputs = (self.output, arm_out)
        return Results(self.force, *outputs, page=self.sheet, json_=self.json_)

    def existing_records(self, model: ErrorModel, how: MeasuredHow) -> Measurements | None:
        """The records of ``--existing``."""
        records = None if self.existing is None else as_measurements(self.existing, model.arm)
        if how.u_bar_mm is not None and (records is None or not records.bars()):
            raise typer.BadParameter(
                "--u-bar-mm requires --existing with bars; planned records have no bars"
            )
        return records

    def keywords(self, how: MeasuredHow) -> dict[str, Any]:
        """As ``plan_calibration`` and ``plan_measurements`` take them."""
        keywords = how.keywords()
        keywords |= {"records": self.records, "scheme": self.scheme, "postures": self.postures}
        keywords["above"] = in_metres(self.table_height_mm)
        keywords["rng"] = np.random.default_rng(self.seed)
        return keywords

    def write(
        self,
        results: Results,
        plan: CalibrationPlan | MeasurementPlan,
        existing: Measurements | None,
        document: Document,
    ) -> None:
        """Write the file of the records, the sheet and the JSON, as asked for."""
        if self.output is not None or (self.json_ is None and self.sheet is None):
            text = plan.csv() if existing is None else _like(existing, plan.records)
            results.text(text, self.output)
        if self.sheet is not None:
            results.document(document, self.sheet)
        results.json(plan.summary(), self.json_)

    @property
    def csv_on_stdout(self) -> bool:
        """Whether results other than the page of the plan take stdout."""
        return self.output is None or self.json_ == "-"

    def show(self, plan: CalibrationPlan | MeasurementPlan, document: Document) -> None:
        """Show the plan at the terminal, and how low the tip goes."""
        terminal.show(document, self.csv_on_stdout)
        tips = plan.model.predict(plan.measurements.q, plan.measurements.conditions)
        note_lowest_tip(tips @ plan.model.arm.up, self.table_height_mm)


def note_lowest_tip(heights: Array, table_height_mm: float | None) -> None:
    """How far below the base the lowest tip is [m], where no table was stated."""
    if table_height_mm is None and heights.min() < 0:
        note(
            f"the lowest planned position of the tip is {-heights.min() / MM:.0f} mm below the "
            "base; if the arm stands on a table, use --table-height-mm"
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
