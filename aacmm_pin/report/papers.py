"""Results of the source papers as documents: their tables made again, and their measurements diagnosed."""

from __future__ import annotations

from aacmm_pin.papers.sino6 import Table2
from aacmm_pin.papers.sino6_table3 import Table3Diagnosis
from aacmm_pin.report.document import Bullets, Document, Paragraph, Table, document_of
from aacmm_pin.report.papers_page import in_words


@document_of.register
def table2_document(result: Table2) -> Document:
    """Table 2 made again."""
    flexibility = ", ".join(f"{name} {value:.3f}" for name, value in result.mean_flexibility.items())
    distance = ", ".join(f"{value:.4f} {name}" for name, value in result.total_variation.items())
    words = f"mean flexibility {flexibility}; total variation from the print {distance}"
    return Document("Table 2", [Paragraph(words, head="Table 2:"), Table(result.counts)])


@document_of.register
def table3_diagnosis_document(found: Table3Diagnosis) -> Document:
    """The diagnosis of Table 3."""
    weighed = found.evidences.filter(regex="cause|probability").sort_values("five_probability", ascending=False)
    return Document(
        "Table 3",
        [
            Paragraph(f"printed coordinates read as {found.reading}", head=f"Table 3, {found.verdict}:"),
            Bullets(list(in_words(found).values())),
            Table(found.shown, "Measured spreads, beside those of DH errors and of encoder noise"),
            Table(weighed, "Probability of each cause by five seats, and six"),
            Table(found.held_out_five.seats, "Each of seats 1 to 5 predicted by the others"),
        ],
    )
