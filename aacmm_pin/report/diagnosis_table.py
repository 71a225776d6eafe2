"""The diagnoses of many files as document, CSV and JSON."""

from __future__ import annotations

from typing import Any

import pandas as pd

from aacmm_pin._support.plain_values import plain
from aacmm_pin._support.units import count
from aacmm_pin.effects import listed, probability
from aacmm_pin.report.document import Block, Bullets, Document, Paragraph, Table
from aacmm_pin.report.numbers import percent

DIAGNOSES_SCHEMA = "aacmm-pin/diagnoses/1"
RMS = ("rms_as_stated_mm", "rms_extended_mm")
SHOWN = ("arm", "records", "used", "verdict", "causes", "would_show", *RMS, "gain")
FILE_HEADS = {"records": "file", "used": "records", "would_show": "shown causes"} | {
    name: name.removeprefix("rms_").replace("as_stated", "nominal") for name in RMS
}


def diagnoses_document(table: pd.DataFrame) -> Document:
    """The result of :func:`aacmm_pin.diagnose_files`, one line for each file."""
    failed = table[table["error"] != ""]
    verdicts = table["verdict"].dropna().value_counts()
    parts = [f"{number} {verdict}" for verdict, number in verdicts.items()]
    parts += [count(len(failed), "error")] if len(failed) else []
    shown = with_cause_texts(table).assign(would_show=table["causes_shown"] / table["causes_tried"])
    shown = shown.drop(failed.index).filter([*SHOWN])
    if table["arm"].nunique() == 1:
        shown = shown.drop(columns="arm")
    errors = zip(failed["records"], failed["error"], strict=True)
    problems = [f"{file}: {error.removeprefix(f'{file}: ')}" for file, error in errors]
    blocks: list[Block] = [
        Paragraph(f"Verdicts of {count(len(table), 'file')}: {listed(parts)}.", finding=True),
        Table(
            shown,
            "Share of the causes of typical magnitude that the records would show, RMS residuals, "
            "and gain on held-out records",
            formats={"gain": percent, "would_show": percent},
            heads=FILE_HEADS,
        ),
        Bullets(problems, "Files with an error:"),
    ]
    return Document("Diagnoses", blocks)


def with_cause_texts(table: pd.DataFrame) -> pd.DataFrame:
    """The table with causes as text: ``encoder_eccentricity:3 (0.998), bearing_tilt:2 (0.97)``."""
    texts = []
    for causes in table["causes"]:
        words = [f"{label} ({probability(p)})" for label, p in causes.items()]
        texts.append(", ".join(words))
    return table.assign(causes=texts)


def diagnoses_summary(table: pd.DataFrame) -> dict[str, Any]:
    """Schema ``aacmm-pin/diagnoses/1``."""
    return {"schema": DIAGNOSES_SCHEMA, "files": plain(table)}
