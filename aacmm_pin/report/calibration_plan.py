"""A plan for a calibration as a document: what it is worth, and where to go in which posture."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG
from aacmm_pin.planning import CalibrationPlan
from aacmm_pin.postures.articulation import articulations, places
from aacmm_pin.report.document import Document, Download, Figure, Heading, Notes, Paragraph, Table, document_of
from aacmm_pin.report.plots.style import BLUE
from aacmm_pin.report.plots.two_views import two_views


@document_of.register
def calibration_plan_document(plan: CalibrationPlan) -> Document:
    """The plan; its records stand in :attr:`CalibrationPlan.records`."""
    arm, q = plan.model.arm, plan.measurements.q
    tips = plan.model.predict(q, plan.measurements.conditions)
    seed = "" if plan.seed is None else f"seed {plan.seed}"
    return Document(
        f"Calibration of {arm.name}: what to measure",
        [
            Paragraph(f"{plan}.", finding=True, head="Plan:"),
            Heading("Where to go"),
            Figure(
                lambda: two_views(arm, q[:1], {"records": (BLUE, [("", tip[None]) for tip in tips])}),
                "Places of the records round the arm, from above and from the side",
                "The arm in the first posture (black), and where the tip will be.",
            ),
            Table(
                _records(plan, places(arm, tips)),
                "Records, in order",
                explained="The joints' angles lie in the file; come within a few degrees, and enter the angles indicated. "
                "Left and right are those of a person behind the stand; bearing counts counter-clockwise from x.",
                detail=True,
            ),
            Notes(plan.notes),
            Download("plan.csv", "the file to be filled in", plan.csv().encode()),
        ],
        seed,
    )


def _records(plan: CalibrationPlan, where: pd.DataFrame) -> pd.DataFrame:
    arm, q, seat = plan.model.arm, plan.measurements.q, plan.measurements.conditions.seat
    table = pd.DataFrame({"record": plan.records["record"]} | ({} if seat is None else {"seat": seat}))
    whole = where.map(lambda value: f"{value:z.0f}")
    table = pd.concat([table, whole.set_axis(["from the stand [mm]", "bearing [°]", "height [mm]"], axis=1)], axis=1)
    shown = np.where(arm.chain.prismatic, q, q / DEG)
    angles = [" ".join(f"{x:.0f}" for x in row) for row in shown]
    return table.assign(articulation=articulations(arm, q), **{"joints [°]": angles})
