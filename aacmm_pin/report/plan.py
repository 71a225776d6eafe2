"""A plan of measurements as a document: set-up, what was considered, which causes are told apart, the records."""

from __future__ import annotations

import pandas as pd

from aacmm_pin.planning import MeasurementPlan
from aacmm_pin.planning.detection_power import Power
from aacmm_pin.planning.result import Tried
from aacmm_pin.report.document import Bullets, Details, Document, Notes, Paragraph, Table, document_of
from aacmm_pin.report.numbers import count

MOST_PAIRS, MOST_RECORDS = 8, 12
"""Pairs of causes and records that are listed; the JSON and the measurement file have all."""


@document_of.register
def plan_document(plan: MeasurementPlan) -> Document:
    """The plan; its records stand in :attr:`MeasurementPlan.records`."""
    tried = pd.DataFrame(
        [
            {
                "set-up": one.words,
                "T": one.power.least,
                "told apart with probability": "" if one.why_not else f"{one.power.probability:.2f}",
                "why not": one.why_not,
            }
            for one in plan.tried
        ]
    )
    return Document(
        "Plan",
        [
            Paragraph(str(plan), head="Plan:"),
            Bullets(plan.set_up, "Set-up, besides postures:"),
            Table(tried if len(tried) > 1 else tried.head(0), "Set-ups that were considered", {"T": ".3g"}),
            Table(_pairs(plan), "Told apart worst, of what these postures can tell apart", {"T": ".3g"}, most=MOST_PAIRS),
            Details(f"{count(len(plan.records), 'record')} to measure", [Table(plan.records, most=MOST_RECORDS)]),
            Notes(plan.notes),
        ],
    )


def _pairs(plan: MeasurementPlan) -> pd.DataFrame:
    """Pairs of causes that postures can tell apart, worst first; empty where the plan is for one pair."""
    if plan.pairs is None:
        return pd.DataFrame()
    heads = {"cause": "cause", "other": "from", "T": "T", "told": "told apart"}
    return plan.pairs.loc[plan.pairs["why_not"] == "", [*heads]].rename(columns=heads)


@document_of.register
def tried_document(tried: Tried) -> Document:
    """A set-up that was considered."""
    return Document(tried.words, [Paragraph(tried.why_not, head=f"{tried.words}:"), *document_of(tried.power).blocks])


@document_of.register
def power_document(power: Power) -> Document:
    """How well two causes are told apart."""
    rows = pd.DataFrame(
        {
            "if it is": ["the first cause", "the second cause"],
            "T": [power.one, power.other],
            "T without the other": power.alone[:2],
        }
    )
    words = Paragraph(f"{power.probability:.2f}", head="Probability of the right decision:")
    return Document("Power", [words, Table(rows, "", dict.fromkeys(("T", "T without the other"), ".3g"))])
