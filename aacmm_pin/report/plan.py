"""A plan of measurements as a document: set-up, what was considered, which causes are told apart, the records."""

from __future__ import annotations

import pandas as pd

from aacmm_pin.planning import MeasurementPlan
from aacmm_pin.report.calibration_plan import where_to_go
from aacmm_pin.report.document import Bullets, Document, Notes, Paragraph, Table, document_of

MOST_PAIRS = 8
"""Pairs of causes that are listed; the JSON has all."""


@document_of.register
def plan_document(plan: MeasurementPlan) -> Document:
    """The plan; its records stand in :attr:`MeasurementPlan.records`."""
    tried = [
        {
            "set-up": one.words,
            "T": one.power.least,
            "probability of the right decision": None if one.why_not else one.power.probability,
            "why not": one.why_not,
        }
        for one in plan.tried
    ]
    considered = pd.DataFrame(tried if len(tried) > 1 else [])
    forms = {"T": ".3g", "probability of the right decision": ".2f"}
    return Document(
        "Plan",
        [
            Paragraph(str(plan), head="Plan:"),
            Bullets(plan.set_up, "Set-up, besides postures:"),
            Table(considered, "Set-ups that were considered", forms),
            Table(_pairs(plan), "Told apart worst, of what these postures can tell apart", forms, most=MOST_PAIRS),
            *where_to_go(plan),
            Notes(plan.notes),
        ],
    )


def _pairs(plan: MeasurementPlan) -> pd.DataFrame:
    """Pairs of causes that postures can tell apart, worst first; empty where the plan is for one pair."""
    if plan.pairs is None:
        return pd.DataFrame()
    heads = {"cause": "cause", "other": "from", "T": "T", "told": "told apart"}
    return plan.pairs.loc[plan.pairs["why_not"] == "", [*heads]].rename(columns=heads)
