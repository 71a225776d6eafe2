"""The certificate of an acceptance test: figures, limits and verdicts."""

from __future__ import annotations

from aacmm_pin._support.output_files import json_text
from aacmm_pin.report.document import Document, Download, Notes, Paragraph, Table, document_of
from aacmm_pin.verification import AcceptanceResult

RULE = (
    "Conformity: |value| + U is at most the MPE; non-conformity: |value| - U is above it; neither in between "
    "(ISO 14253-1, U = 2u of the calibrated length or diameter)."
)


@document_of.register
def acceptance_document(result: AcceptanceResult, date: str = "", data: bytes | None = None) -> Document:
    """The result as one page; with ``data``, the file of touches, that stands in the page too.

    Args:
        result: what was found.
        date: of the test, for the line below the title.
        data: content of the file of touches.
    """
    table = result.to_frame()
    several = len({f.source for f in result.figures}) > 1
    shown = ["coordinates"] * several + ["figure", "value_mm", "U_mm", "mpe_mm", "verdict", "had", "missing"]
    downloads = [Download("acceptance.json", "the figures as JSON", json_text(result.summary()).encode())]
    if data is not None:
        downloads.append(Download("touches.csv", "the touches", data))
    if not result.figures:
        return Document("Acceptance test", ["No touches of a test of this standard."], f"{result.path} {date}".strip())
    named = table[["figure", "standard", "clause", "definition"]].drop_duplicates()
    return Document(
        "Acceptance test",
        [
            Paragraph(f"{result}.", finding=True, head="Acceptance:"),
            Table(table[shown], "Figures and their limits", heads={"mpe_mm": "MPE_mm", "had": "touches or lengths"}),
            Paragraph(RULE),
            Table(named, "What the figures are", detail=True),
            Notes(result.notes),
            *downloads,
        ],
        f"{result.path}{', ' * bool(date)}{date}",
    )
