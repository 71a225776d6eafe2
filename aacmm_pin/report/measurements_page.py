"""Measurements and the conditions of their records as documents."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.units import MM, count
from aacmm_pin.measurements import BAR, Measurements
from aacmm_pin.report.document import Document, Table, document_of

VALUES_LISTED = 8
"""Labels to show."""


@document_of.register
def measurements_document(
    records: Measurements, prismatic: NDArray[np.bool_] | None = None
) -> Document:
    """The content of a measurement file by columns; ``prismatic`` joints (nq,) have readings in
    mm.
    """
    table, other_columns = records.to_frame(), [*records.extra]
    text_of_item = {"with reference": f"{records.known.sum()} of {records.n}"}
    records_at_each: dict[str, list[int]] = {}
    for rows in records.seats().values():
        kind = "planes" if records.on_plane[rows].all() else "seats"
        records_at_each.setdefault(kind, []).append(len(rows))
    for kind, counts in records_at_each.items():
        text_of_item[kind] = f"{len(counts)} with {_range(np.array(counts))} records each"
    lengths = np.array([bar.length for bar in records.bars()]) / MM
    if lengths.size:
        text_of_item["bars"] = f"{lengths.size} with lengths of {_range(lengths)} mm"
    if records.relations:
        distances = sum(bool(np.isfinite(relation.distance)) for relation in records.relations)
        angles = count(len(records.relations), "angle")
        text_of_item["relations"] = f"{count(distances, 'distance')} and {angles} between planes"
    for name in table.columns.drop(["seat", *BAR, *other_columns], errors="ignore"):
        text_of_item[name] = _range(table[name].to_numpy())
    for j in [] if prismatic is None else np.flatnonzero(prismatic):
        del text_of_item[f"theta{j + 1}_deg"]
        text_of_item[f"theta{j + 1} [m]"] = _range(records.readings[:, j])
    if other_columns:
        text_of_item["other columns"] = (
            f"{', '.join(other_columns)} (diagnose compares these with residuals)"
        )
    summary = pd.DataFrame(text_of_item.items(), columns=["item or column", "number or range"])
    return Document("Measurements", [str(records), Table(summary)])


def _range(values: NDArray[Any]) -> str:
    if values.dtype == object:
        labels = [label for label in dict.fromkeys(values) if label]
        more = " …" if len(labels) > VALUES_LISTED else ""
        return f"{count(len(labels), 'label')}: {', '.join(labels[:VALUES_LISTED])}{more}"
    values = values[np.isfinite(values)]
    if not values.size:
        return "none"
    low, high = np.round([values.min(), values.max()], 12)  # zero in mm may be 1e-17
    return f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
