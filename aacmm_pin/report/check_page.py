"""What was read of an arm and its measurements, and what they lack: document and JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.display import notes_in_json
from aacmm_pin._support.file_problems import rows_in_words
from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.units import MM, count
from aacmm_pin.diagnosis import Check
from aacmm_pin.effects import CONDITION_COLUMNS, Effect, cause_in_words, listed
from aacmm_pin.report.document import Document, Notes, Paragraph, Table, document_of
from aacmm_pin.report.measurements_page import measurements_document
from aacmm_pin.report.numbers import lengths, mistakes_in_words, other_notes
from aacmm_pin.report.repeated_postures import repeatability_in_json, repeatability_in_words

CHECK_SCHEMA = "aacmm-pin/check/1"
MISSING = "Causes of error that diagnose cannot try, because the file lacks a column"


@document_of.register
def check_document(check: Check) -> Document:
    """The check as a document."""
    name, records = check.model.arm.name, check.measurements
    sizes = [check.rms, check.calibrated_rms]
    predicted = "The arm file states no uncertainties, which would predict this distance"
    if not np.isnan(check.predicted_rms):
        sizes.append(check.predicted_rms)
        predicted = f"The stated uncertainties predict a distance of {lengths(sizes)[-1]}"
    distance, calibrated = lengths(sizes)[:2]
    fits = f"{int(check.used.sum())} of {count(records.n, 'record')} fit {name}"
    finding = (
        f"{mistakes_in_words(check.notes)}{fits}. With the stated geometry, the RMS distance "
        f"between tip and target is {distance}. {predicted}. With calibrated geometry, this "
        f"distance is {calibrated}."
    )
    left_out = records.row[check.excluded]
    rows = f"{name} does not fit the records in {rows_in_words(left_out)}." if left_out.size else ""
    missing = [
        {
            "column": CONDITION_COLUMNS[need],
            "causes": listed([cause_in_words(cause) for cause in causes]),
        }
        for need, causes in check.missing.items()
    ]
    columns = measurements_document(records, check.model.arm.chain.prismatic).blocks[1:]
    blocks = [
        Paragraph(finding, finding=True),
        Paragraph(rows, finding=True),
        repeatability_in_words(check.repeatability),
        *columns,
        Table(pd.DataFrame(missing), MISSING),
        Notes(other_notes(check.notes)),
    ]
    return Document(f"{name} and {records.source}", blocks)


def check_summary(check: Check) -> dict[str, Any]:
    """Schema ``aacmm-pin/check/1``."""
    records = check.measurements
    summary = {
        "schema": CHECK_SCHEMA,
        "arm": check.model.arm.name,
        "source": records.source,
        "records": records.n,
        "used": check.used.sum(),
        "with_reference": records.known.sum(),
        "seats": len(records.seats()),
        "bars": len(records.bars()),
        "rms_mm": check.rms / MM,
        "other_rows": records.row[check.excluded],
        "calibrated_rms_mm": check.calibrated_rms / MM,
        "predicted_rms_mm": check.predicted_rms / MM,
        "repeatability": repeatability_in_json(check.repeatability),
        "columns": [*records.to_frame()],
        "not_tried": not_tried_in_json(check.missing),
        **notes_in_json(check.notes),
    }
    return dict(plain(summary))


def not_tried_in_json(missing: Mapping[str, tuple[type[Effect], ...]]) -> list[dict[str, Any]]:
    """Missing columns, and the causes that need them."""
    return [
        {"column": CONDITION_COLUMNS[need], "causes": [cause.cause for cause in causes]}
        for need, causes in missing.items()
    ]
