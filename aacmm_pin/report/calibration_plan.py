"""A plan for a calibration as a document: what it is worth, and where to go in which posture."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.planning import CalibrationPlan, MeasurementPlan
from aacmm_pin.postures.articulation import articulations, places
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

TOLD_OTHERWISE = r"^(theta|approach)\d|^u_|_mm$"
"""Columns of a plan that its table has in other words, or that are to be filled in."""


@document_of.register
def calibration_plan_document(plan: CalibrationPlan) -> Document:
    """The plan; its records stand in :attr:`CalibrationPlan.records`."""
    return Document(
        f"Calibration of {plan.model.arm.name}: what to measure",
        [Paragraph(f"{plan}.", finding=True, head="Plan:"), *where_to_go(plan), Notes(plan.notes)],
        "" if plan.seed is None else f"seed {plan.seed}",
    )


def calibration_plan_line(plan: CalibrationPlan) -> str:
    """How many records, and what they are worth beside random ones."""
    beside = f" beside the {plan.existing} existing ones" if plan.existing else ""
    return (
        f"{len(plan.records)} records to calibrate {plan.model.arm.name}{beside}: observability "
        f"O1 is {plan.ratio:.2f} "
        "times that of random records of the same number; u of a point after calibration "
        f"{plan.u / MM:.4f} mm (root "
        f"mean square), {float(np.median(plan.u_random)) / MM:.4f} mm after random ones"
    )


def where_to_go(plan: CalibrationPlan | MeasurementPlan) -> list[Block]:
    """The records of a plan on a page to print, with the CSV to be filled in inside."""
    arm, q = plan.model.arm, plan.measurements.q
    tips = plan.model.predict(q, plan.measurements.conditions)
    return [
        Heading("Where to go"),
        Figure(
            lambda: two_views(arm, q[:1], {"records": (BLUE, [("", tip[None]) for tip in tips])}),
            "Places of the records round the arm, from above and from the side",
            "The arm in the first posture (black), and where the tip will be.",
        ),
        Table(
            _records(plan, places(arm, tips)),
            "Records, in order",
            explained="The file has the joints' angles in full; come within a few degrees of "
            "them, and enter the angles "
            "indicated. Left and right are those of a person behind the stand; bearing counts "
            "counter-clockwise from x. "
            "Last motion, where planned: whether each joint turned to larger (+) or smaller "
            "(-) angles.",
            detail=True,
        ),
        Download("plan.csv", "the file to be filled in", plan.csv().encode()),
    ]


def _records(plan: CalibrationPlan | MeasurementPlan, where: pd.DataFrame) -> pd.DataFrame:
    arm, q, moved = (
        plan.model.arm,
        plan.measurements.q,
        plan.records.filter(regex=r"^approach\d").to_numpy(),
    )
    shown = np.where(arm.chain.prismatic, q, q / DEG)
    whole = where.map(lambda value: f"{value:z.0f}")
    table = plan.records.drop(columns=plan.records.filter(regex=TOLD_OTHERWISE)).astype(str)
    table = table.rename(columns={"temperature_c": "temperature [°C]"}).drop(
        columns="record", errors="ignore"
    )
    label = pd.Series(
        plan.measurements.record, name="record"
    )  # which a file that is appended to may not have
    table = pd.concat(
        [
            label,
            table,
            whole.set_axis(["from the stand [mm]", "bearing [°]", "height [mm]"], axis=1),
        ],
        axis=1,
    )
    table["articulation"] = articulations(arm, q)
    table["joints [°]"] = [" ".join(f"{x:z.0f}" for x in row) for row in shown]
    signs = [" ".join("-0+"[int(sign) + 1] for sign in row) for row in moved]
    return table.assign(**{"last motion": signs} if moved.size else {})
