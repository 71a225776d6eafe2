"""What was read of an arm and its measurements, and what they lack, as a document and for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.file_problems import rows_in_words
from aacmm_pin._support.notes import notes_in_json
from aacmm_pin._support.units import MM, count
from aacmm_pin.diagnosis import Check
from aacmm_pin.effects import CONDITION_COLUMNS, Effect, cause_in_words, listed
from aacmm_pin.report.document import Document, Notes, Paragraph, Table, document_of
from aacmm_pin.report.measurements import measurements_document
from aacmm_pin.report.numbers import lengths, mistakes_in_words, other_notes

CHECK_SCHEMA = "aacmm-pin/check/1"
MISSING = "Causes of error that diagnose cannot try, because the file lacks a column"


@document_of.register
def check_document(check: Check) -> Document:
    """The check as a document."""
    name, used = check.model.arm.name, int(check.used.sum())
    fits = f"{used} of {count(check.measurements.n, 'record')} fit {name}"
    known = not np.isnan(check.predicted_rms)
    sizes = [check.rms, check.calibrated_rms, *([check.predicted_rms] if known else [])]
    found, calibrated, *expected = lengths(sizes)
    distance = f"With the stated geometry, the RMS distance between tip and target is {found}"
    predicted = "The arm file states no uncertainties, which would predict this distance"
    if known:
        predicted = f"The stated uncertainties predict a distance of {expected[0]}"
    wrong = mistakes_in_words(check.notes)
    after = f"With calibrated geometry, this distance is {calibrated}"
    finding = Paragraph(f"{wrong}{fits}. {distance}. {predicted}. {after}.", finding=True)
    prismatic = check.model.arm.chain.prismatic
    columns = measurements_document(check.measurements, prismatic).blocks[1:]
    left_out = check.measurements.row[check.excluded]
    rows = f"{name} does not fit the records in {rows_in_words(left_out)}." if left_out.size else ""
    blocks = [
        finding,
        Paragraph(rows, finding=True),
        *columns,
        Table(_missing(check), MISSING),
        Notes(other_notes(check.notes)),
    ]
    return Document(f"{name} and {check.measurements.source}", blocks)


def _missing(check: Check) -> pd.DataFrame:
    rows = []
    for need, causes in check.missing.items():
        names = listed([cause_in_words(cause) for cause in causes])
        rows.append({"column": CONDITION_COLUMNS[need], "causes": names})
    return pd.DataFrame(rows)


def check_summary(check: Check) -> dict[str, Any]:
    """Schema ``aacmm-pin/check/1``."""
    records = check.measurements
    summary: dict[str, Any] = {"schema": CHECK_SCHEMA, "arm": check.model.arm.name}
    summary |= {"source": records.source, "records": records.n, "used": int(check.used.sum())}
    summary |= {"with_reference": int(records.known.sum()), "seats": len(records.seats())}
    summary |= {"bars": len(records.bars()), "rms_mm": check.rms / MM}
    summary["other_rows"] = check.measurements.row[check.excluded].tolist()
    summary["calibrated_rms_mm"] = check.calibrated_rms / MM
    summary["predicted_rms_mm"] = check.predicted_rms / MM
    summary["columns"] = [str(name) for name in records.to_frame().columns]
    summary["not_tried"] = not_tried_in_json(check.missing)
    return summary | notes_in_json(check.notes)


def not_tried_in_json(missing: Mapping[str, tuple[type[Effect], ...]]) -> list[dict[str, Any]]:
    """Columns that a file lacks, and the causes that were no candidates without them."""
    lacking = []
    for need, causes in missing.items():
        names = [cause.cause for cause in causes]
        lacking.append({"column": CONDITION_COLUMNS[need], "causes": names})
    return lacking
