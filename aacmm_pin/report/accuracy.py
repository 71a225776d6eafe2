"""Postures, accuracy, maps and Monte Carlo as documents: what is known before anything is
measured.
"""

from __future__ import annotations

from typing import Any

import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy.length import LengthUncertainty
from aacmm_pin.accuracy.volume import COVERED, AccuracyVolume
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.postures.curve_sampling import Flexibility, sector_centres
from aacmm_pin.postures.postures_at_point import PosturesAtPoint
from aacmm_pin.report.document import Block, Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import in_one_unit, percent, spread

SHOWN_SOURCES = 8
"""So many sources of a budget are shown."""
EXPANDED = "U (k = 2)_mm"
POSTURES = {
    "smallest_u": "smallest U",
    "largest_u": "largest U",
    "best": "smallest volume",
    "worst": "largest volume",
}
"""Postures of an accuracy summary in words."""


@document_of.register
def postures_document(postures: PosturesAtPoint) -> Document:
    """The components of the configurations at a point."""
    table = postures.summary().rename(columns=lambda name: str(name).replace("_", " "))
    return Document("Configurations", [str(postures), Table(table)])


@document_of.register
def flexibility_document(flexibility: Flexibility) -> Document:
    """Which sectors have a configuration."""
    number = len(flexibility.sectors)  # none of an arm without an elbow that goes round
    heads = [f"{centre / DEG:.4g}°" for centre in (sector_centres(number) if number else ())]
    works = {
        head: ["works" if yes else "–"]
        for head, yes in zip(heads, flexibility.sectors, strict=True)
    }
    table = Table(pd.DataFrame(works), "Swivel angle of each sector's centre")
    return Document("Flexibility", [Paragraph(str(flexibility), head="Flexibility ζ:"), table])


@document_of.register
def accuracy_document(accuracy: AccuracyVolume, summary: dict[str, Any] | None = None) -> Document:
    """Volume and uncertainty over the configurations, and their sources.

    Args:
        accuracy: over some configurations.
        summary: of the same at a point, by
            :func:`aacmm_pin.report.json_summaries.accuracy_summary`; adds its best and worst.
    """
    if not len(accuracy.q):
        return Document("Accuracy", [str(accuracy)])
    postures = pd.DataFrame() if summary is None else postures_at_the_ends(summary)
    values = accuracy.to_frame().filter(regex="_mm")
    values.insert(0, EXPANDED, COVERAGE_FACTOR * values["u_mm"])
    budget = accuracy.budget()[["parameter", "u_mm", "share"]]
    postures, over, budget = in_one_unit(
        postures, spread(values, "over the configurations"), budget
    )
    comprehensive = None if summary is None else summary["volume_mm3"]["comprehensive"]
    origin = ", swivel 0 where the elbow is highest" if "swivel [°]" in postures else ""
    blocks: list[Block] = [
        str(accuracy),
        what_k_covers(),
        "" if comprehensive is None else f"comprehensive accuracy {comprehensive:.4g} mm³",
        Table(postures, f"Postures{origin}"),
        Table(over),
        _budget(budget),
        *map(str, accuracy.sources.caveats),
    ]
    return Document("Accuracy", blocks)


def _budget(budget: pd.DataFrame) -> Table:
    return Table(
        budget.head(SHOWN_SOURCES).rename(columns={"share": "share of variance"}),
        f"Uncertainty budget, the first {min(SHOWN_SOURCES, len(budget))} of {len(budget)} sources",
        {"share of variance": lambda share: percent(share, 1)},
    )


@document_of.register
def length_document(length: LengthUncertainty) -> Document:
    """Uncertainty of a length, the best and the worst pair of postures for it, and its sources."""
    rows = []
    for words, number in (("smallest U", length.u.argmin()), ("largest U", length.u.argmax())):
        a, b = length.pair(int(number))
        angles = {"at A": length.q_a[a], "at B": length.q_b[b]}
        degrees = {
            f"theta {end}_deg": " ".join(f"{theta:.0f}" for theta in q / DEG)
            for end, q in angles.items()
        }
        rows.append({"postures": words, EXPANDED: COVERAGE_FACTOR * length.u[a, b] / MM, **degrees})
    ends, budget = in_one_unit(pd.DataFrame(rows), length.budget()[["parameter", "u_mm", "share"]])
    blocks: list[Block] = [
        str(length),
        Table(ends, "Postures for this length"),
        _budget(budget),
        *map(str, length.sources.caveats),
    ]
    return Document("Length", blocks)


def what_k_covers() -> str:
    """The coverage probability of U of a position."""
    along, isotropic = (f"{100 * part:.1f} %" for part in COVERED)
    errors = f"{along} of normal errors along one direction, {isotropic} of isotropic ones"
    return f"U (k = {COVERAGE_FACTOR:g}) of a position covers {errors}."


def postures_at_the_ends(summary: dict[str, Any]) -> pd.DataFrame:
    """The postures of an accuracy summary with the smallest and largest volume and U, one
    row each.
    """
    rows = [{"posture": words} | summary[name] for name, words in POSTURES.items()]
    table = pd.DataFrame(rows).dropna(axis="columns", how="all")
    table["theta_deg"] = [
        " ".join(f"{theta:.0f}" for theta in posture) for posture in table["theta_deg"]
    ]
    table.insert(2, EXPANDED, COVERAGE_FACTOR * table.pop("u_mm"))
    return table


@document_of.register
def map_document(map_: WorkspaceMap) -> Document:
    """Least, median and largest of what a map holds, and its cells by working sectors."""
    names = {
        "comprehensive_mm3": "comprehensive accuracy_mm3",
        "best_mm3": "smallest volume_mm3",
        "worst_mm3": "largest volume_mm3",
        "smallest_u_mm": "smallest u_mm",
        "largest_u_mm": "largest u_mm",
        "flexibility": "flexibility",
    }
    values = pd.DataFrame({words: map_.data[name].values.ravel() for name, words in names.items()})
    cells = pd.DataFrame(
        {str(sectors): [number] for sectors, number in map_.working_sectors().items()}
    )
    table = Table(spread(values, "over the cells"))
    return Document(
        "Map",
        [str(map_), table, Table(cells, "Reachable cells by their number of working sectors")],
    )
