"""Measurements, their noise and the conditions of their records as documents."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import UM
from aacmm_pin.accuracy.single_point import SinglePoint
from aacmm_pin.effects.conditions import COLUMNS, Conditions
from aacmm_pin.measurements.noise import Noise
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.report.document import Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import count, in_one_unit, lengths

FEW = 8
"""So many labels are shown."""


@document_of.register
def measurements_document(records: Measurements) -> Document:
    """What a measurement file holds, column by column."""
    return Document("Measurements", [str(records), Table(records.summary())])


@document_of.register
def conditions_document(conditions: Conditions) -> Document:
    """What is known of records besides the angles."""
    rows = []
    for name in conditions.present:
        values = conditions.require(name, "its document")
        if values.dtype == object:
            labels = [label for label in dict.fromkeys(values) if label]
            text = f"{len(labels)}: {', '.join(labels[:FEW])}{' …' if len(labels) > FEW else ''}"
        else:
            text = f"{np.nanmin(values):.6g} to {np.nanmax(values):.6g}"
        rows.append({"condition": name.replace("_", " "), "column": COLUMNS[name], "values": text})
    none = "" if rows else "Only the angles are known."
    words = Paragraph(f"of {count(conditions.n, 'record')}", head="Conditions")
    return Document("Conditions", [words, Table(pd.DataFrame(rows)), none])


@document_of.register
def noise_document(noise: Noise) -> Document:
    """Standard uncertainties of readings, references and contacts."""
    rows = [{"noise": f"encoder {j}", "u": f"{u / UM:.4g} µrad"} for j, u in enumerate(noise.encoder, start=1)]
    reference, probe = lengths([noise.reference, noise.probe])
    rows += [{"noise": "coordinate of a reference", "u": reference}, {"noise": "coordinate of a contact", "u": probe}]
    words = Paragraph("standard uncertainties of random errors of every record", head="Noise:")
    return Document("Noise", [words, Table(pd.DataFrame(rows))])


@document_of.register
def single_point_document(point: SinglePoint) -> Document:
    """Spread of the records of one point, of all and of the high-accuracy part."""
    rows = [{"records": "all", "number": point.n, "spread": point.sigma}]
    if point.part_n:
        rows.append({"records": "high-accuracy part", "number": point.part_n, "spread": point.part})
        rows.append({"records": "the rest", "number": point.n - point.part_n, "spread": point.rest})
    table, formats = in_one_unit(pd.DataFrame(rows), ["spread"])
    return Document("Single point", [Paragraph(str(point), head="Single point:"), Table(table, "", formats)])
