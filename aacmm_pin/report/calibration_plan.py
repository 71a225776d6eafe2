"""A plan for a calibration as a document: what it is worth, and where to go in which posture."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.planning import CalibrationPlan, MeasurementPlan
from aacmm_pin.postures import articulations, places
from aacmm_pin.report.document import (
    Block,
    Document,
    Download,
    Figure,
    Heading,
    Notes,
    Paragraph,
    Table,
    document_of,
)
from aacmm_pin.report.plots.style import BLUE
from aacmm_pin.report.plots.two_views import two_views

COLUMNS_NOT_LISTED = r"^(theta|approach)\d|^u_|_mm$"
"""Columns of a plan that its table has in other words, or that are to be filled in."""
HOW_TO_GO = (
    "The file plan.csv states the joint angles with all decimals. Move the arm to within a few "
    "degrees of these angles, and enter the readings. Left and right are those of a person behind "
    "the stand who looks from the shoulder to the tip. Bearings count counter-clockwise from the x "
    "axis. In the column last motion, + means that you move the joint to the posture towards "
    "larger angles, and - towards smaller angles. The probe direction points from the probe to the "
    "surface, in the axes of the base."
)


@document_of.register
def calibration_plan_document(plan: CalibrationPlan) -> Document:
    """The plan; its records stand in :attr:`CalibrationPlan.records`."""
    finding = Paragraph(f"{plan}.", finding=True, head="Plan:")
    title = f"Plan for the calibration of {plan.model.arm.name}"
    seed = "" if plan.seed is None else f"seed {plan.seed}"
    return Document(title, [finding, *where_to_go(plan), Notes(plan.notes)], seed)


def calibration_plan_line(plan: CalibrationPlan) -> str:
    """How many records, and their observability and u compared with those of random ones."""
    beside = f" in addition to the {plan.existing} existing ones" if plan.existing else ""
    return (
        f"Take {len(plan.records)} records to calibrate {plan.model.arm.name}{beside}. After "
        f"calibration, the standard uncertainty u of the tip is {plan.u / MM:.4f} mm (RMS over the "
        f"postures). Random records would give {float(np.median(plan.u_random)) / MM:.4f} mm. The "
        f"observability index O1 is {plan.ratio:.2f} times as large as with random records"
    )


def where_to_go(plan: CalibrationPlan | MeasurementPlan) -> list[Block]:
    """The records of a plan on a page to print, with the CSV to be filled in inside."""
    arm, measurements = plan.model.arm, plan.measurements
    q, readings = measurements.q, measurements.readings
    tips = plan.model.predict(q, measurements.conditions)
    marks = [("", tip[None]) for tip in tips]
    figure = Figure(
        lambda: two_views(arm, q[:1], {"records": (BLUE, marks)}),
        "Places of the records round the arm, from above and from the side",
        "The figure shows the arm in the first posture (black), and the planned positions of the "
        "tip.",
    )
    planned = plan.records.filter(regex=COLUMNS_NOT_LISTED)
    others = plan.records.drop(columns=[*planned, "record"], errors="ignore").astype(str)
    others = others.rename(columns={"temperature_c": "temperature [°C]"})
    # a file that is appended to may have no column record
    label = pd.Series(measurements.record, name="record")
    place = places(arm, tips).map(lambda value: f"{value:z.0f}")
    place = place.set_axis(["from the stand [mm]", "bearing [°]", "height [mm]"], axis=1)
    table = pd.concat([label, others, place], axis=1)
    table["posture"] = articulations(arm, q)
    shown = np.where(arm.chain.prismatic, readings, readings / DEG)
    table["joints [°]"] = [" ".join(f"{x:z.0f}" for x in row) for row in shown]
    moved = plan.records.filter(regex=r"^approach\d").to_numpy()
    if moved.size:
        table["last motion"] = [" ".join("-0+"[int(sign) + 1] for sign in row) for row in moved]
    return [
        Heading("Where to go"),
        figure,
        Table(table, "Records, in order", explained=HOW_TO_GO, detail=True),
        Download("plan.csv", "the file to fill in", plan.csv().encode()),
    ]
