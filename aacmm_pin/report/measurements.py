"""Measurements and the conditions of their records as documents."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.units import MM
from aacmm_pin.effects import CONDITION_COLUMNS, Conditions
from aacmm_pin.measurements.csv_columns import BAR
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.report.document import Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import count

FEW = 8
"""So many labels are shown."""


@document_of.register
def measurements_document(records: Measurements) -> Document:
    """What a measurement file holds, column by column."""
    table, seats, bars = records.to_frame(), records.seats(), records.bars()
    each, mm = (
        np.array([len(rows) for rows in seats.values()]),
        np.array([bar.length for bar in bars]) / MM,
    )
    shown = {
        "records": str(records.n),
        "joints": str(records.nq),
        "with reference": str(records.known.sum()),
        "seats": f"{len(seats)}, records of each: {_range(each)}" if seats else "none",
        "bars": f"{len(bars)}, mm: {_range(mm)}" if bars else "none",
    }
    for name in table.columns.drop(["seat", *BAR, *records.extra.columns], errors="ignore"):
        shown[name] = _range(table[name].to_numpy())
    if len(records.extra.columns):
        shown["other columns"] = (
            f"{', '.join(records.extra.columns)} (kept; candidates for 'depends on')"
        )
    summary = pd.DataFrame({"what": list(shown), "value": list(shown.values())})
    return Document("Measurements", [str(records), Table(summary)])


@document_of.register
def conditions_document(conditions: Conditions) -> Document:
    """What is known of records besides the angles."""
    rows = []
    for name in conditions.present:
        rows.append(
            {
                "column": CONDITION_COLUMNS[name],
                "values": _range(conditions.require(name, "its document")),
            }
        )
    head = (
        f"{'Conditions' if rows else 'Nothing but the angles is known'} of "
        f"{count(conditions.n, 'record')}"
    )
    return Document("Conditions", [Paragraph("", head=head), Table(pd.DataFrame(rows))])


def _range(values: NDArray[Any]) -> str:
    """Smallest and largest of numbers; number and names of labels."""
    if values.dtype == object:
        labels = [label for label in dict.fromkeys(values) if label]
        return f"{len(labels)}: {', '.join(labels[:FEW])}{' …' if len(labels) > FEW else ''}"
    values = values[np.isfinite(values)]
    if not values.size:
        return "none"
    low, high = values.min(), values.max()
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
