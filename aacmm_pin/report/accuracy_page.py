"""Predictions as documents: postures, accuracy, lengths, maps."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pandas as pd

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy import (
    COVERED,
    QUANTITIES,
    AccuracyVolume,
    LengthUncertainty,
    WorkspaceMap,
)
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.report.document import Document, Table, document_of
from aacmm_pin.report.numbers import in_one_unit, percent, spread

SHOWN_SOURCES = 8
"""Sources of a budget to show."""
EXTREMES = "Postures with the smallest and the largest U and accuracy volume"
HIGHEST = "At a swivel angle of 0°, the elbow is highest."
EXPANDED, SHARE = "U (k = 2)_mm", "share of variance"
END_POSTURES = {
    "smallest_u": "smallest U",
    "largest_u": "largest U",
    "best": "smallest volume",
    "worst": "largest volume",
}
"""Postures of an accuracy summary in words."""
COVERS = (
    f"U (k = {COVERAGE_FACTOR:g}) of a position covers {100 * COVERED[0]:.1f} to "
    f"{100 * COVERED[1]:.1f} % of normally distributed errors, depending on the directions of the "
    "errors."
)
CELLS = "Number of reachable cells, by the number of sectors with a posture within the joint limits"


@document_of.register
def accuracy_document(accuracy: AccuracyVolume, summary: dict[str, Any] | None = None) -> Document:
    """Volume, uncertainty and its sources over postures; with the content of ``accuracy --json``,
    also the best and worst posture.
    """
    if not len(accuracy.q):
        return Document("Accuracy", [str(accuracy)])
    postures, comprehensive = pd.DataFrame(), ""
    if summary is not None:
        postures = postures_at_the_ends(summary)
        volume = summary["volume_mm3"]["comprehensive"]
        if volume is not None:
            comprehensive = (
                "The comprehensive accuracy volume (weighted mean over the postures) is "
                f"{volume:.4g} mm³."
            )
    values = accuracy.to_frame().filter(regex="_mm")
    values = values.rename(columns={"largest_deviation_mm": "worst-case deviation_mm"})
    values.insert(0, EXPANDED, COVERAGE_FACTOR * values["u_mm"])
    over = spread(values, "all postures")
    postures, over, budget = in_one_unit(postures, over, _budget(accuracy))
    return Document(
        "Accuracy",
        [
            f"{accuracy}.",
            COVERS,
            comprehensive,
            Table(postures, EXTREMES),
            HIGHEST if "swivel [°]" in postures else "",
            Table(over),
            _budget_table(budget),
            *map(str, accuracy.sources.caveats),
        ],
    )


def _budget(result: AccuracyVolume | LengthUncertainty) -> pd.DataFrame:
    return result.budget()[["parameter", "u_mm", "share"]].rename(columns={"share": SHARE})


def _budget_table(budget: pd.DataFrame) -> Table:
    number = min(SHOWN_SOURCES, len(budget))
    return Table(
        budget.head(number),
        f"Uncertainty budget with the {number} largest of {len(budget)} sources",
        {SHARE: lambda share: percent(share, 1)},
    )


@document_of.register
def length_document(length: LengthUncertainty) -> Document:
    """Uncertainty of a length, best and worst pair of postures, and sources."""
    rows = []
    for words, number in (("smallest U", length.u.argmin()), ("largest U", length.u.argmax())):
        a, b = length.pair(int(number))
        rows.append(
            {
                "postures": words,
                EXPANDED: COVERAGE_FACTOR * length.u[a, b] / MM,
                "theta at A_deg": _degrees(length.q_a[a] / DEG),
                "theta at B_deg": _degrees(length.q_b[b] / DEG),
            }
        )
    ends, budget = in_one_unit(pd.DataFrame(rows), _budget(length))
    caption = "Pairs of postures at the points A and B with the smallest and the largest U"
    tables = [Table(ends, caption), _budget_table(budget)]
    return Document("Length", [f"{length}.", *tables, *map(str, length.sources.caveats)])


def _degrees(angles: Iterable[float]) -> str:
    return " ".join(f"{angle:.0f}" for angle in angles)


def postures_at_the_ends(summary: dict[str, Any]) -> pd.DataFrame:
    """The postures of an accuracy summary with the smallest and largest volume and U."""
    rows = [{"posture": words} | summary[name] for name, words in END_POSTURES.items()]
    table = pd.DataFrame(rows).dropna(axis="columns", how="all")
    table["theta_deg"] = table["theta_deg"].map(_degrees)
    table.insert(2, EXPANDED, COVERAGE_FACTOR * table.pop("u_mm"))
    return table


@document_of.register
def map_document(map_: WorkspaceMap) -> Document:
    """Smallest, median and largest quantities of a map, and its cells by working sectors."""
    data = {}
    for name, variable in QUANTITIES.items():
        if variable.kind is float:  # the others are numbers of sectors
            unit = "" if variable.unit == "1" else f"_{variable.unit}"
            data[f"{variable.text}{unit}"] = map_.data[name].values.ravel()
    (in_units,) = in_one_unit(pd.DataFrame(data))
    quantities = spread(in_units, "quantity").set_index("quantity").T
    table = Table(quantities.rename_axis("over all cells").reset_index())
    cells = {str(sectors): [number] for sectors, number in map_.working_sectors().items()}
    by_sectors = Table(pd.DataFrame(cells), CELLS)
    return Document("Map", [f"{map_}.", table, by_sectors])
