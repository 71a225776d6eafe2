"""Measurements, their noise and the conditions of their records as documents."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM
from aacmm_pin.effects.conditions import COLUMNS, Conditions
from aacmm_pin.measurements.noise import Noise
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.report.document import Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import count

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
        rows.append({"column": COLUMNS[name], "values": text})
    head = f"{'Conditions' if rows else 'Nothing but the angles is known'} of {count(conditions.n, 'record')}"
    return Document("Conditions", [Paragraph("", head=head), Table(pd.DataFrame(rows))])


@document_of.register
def noise_document(noise: Noise) -> Document:
    """Standard uncertainties of readings, references and contacts."""
    row = {f"encoder {j} [µrad]": u / UM for j, u in enumerate(noise.encoder, start=1)}
    row |= {"reference_mm": noise.reference / MM, "contact_mm": noise.probe / MM}
    return Document("Noise", [Table(pd.DataFrame([row]), "Standard uncertainties of random errors of every record")])
