"""Cards of what is known before anything is measured: postures, accuracy, maps, and points by Monte Carlo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.table_cells import spread
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy.monte_carlo import LengthUncertainty, PointUncertainty
from aacmm_pin.accuracy.single_point import SinglePoint
from aacmm_pin.accuracy.volume import AccuracyVolume
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.postures.curve_sampling import Flexibility, sector_centres
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.cards.card import details, html_of, paragraph, table
from aacmm_pin.report.summaries import map_table

SHOWN_SOURCES = 8
"""So many sources of a budget are shown."""


@html_of.register
def _circle(circle: PosturesAtPoint) -> str:
    return paragraph(str(circle)) + table(circle.summary().rename(columns=lambda name: str(name).replace("_", " ")))


@html_of.register
def _flexibility(flexibility: Flexibility) -> str:
    count = len(flexibility.sectors)
    if not count:  # an arm without an elbow that goes round
        return paragraph(f"{flexibility.arc_fraction:.3f} of arc", "Flexibility:")
    centres = sector_centres(count) / DEG
    works = {f"{centre:.4g}°": ["works" if yes else "–"] for centre, yes in zip(centres, flexibility.sectors, strict=True)}
    words = f"{flexibility.zeta:.3f} by {count} sectors, {flexibility.arc_fraction:.3f} of arc"
    return paragraph(words, "Flexibility ζ:") + table(pd.DataFrame(works), head="Swivel angle of each sector's centre:")


@html_of.register
def _accuracy(accuracy: AccuracyVolume) -> str:
    if not len(accuracy.q):
        return paragraph(str(accuracy))
    values: dict[str, tuple[Any, str]] = {
        "accuracy volume [mm³]": (accuracy.volume / MM3, ".4g"),
        "standard uncertainty u [µm]": (accuracy.u / UM, ".2f"),
    }
    if accuracy.sources.bounded:
        values["largest deviation [µm]"] = (accuracy.largest_deviation / UM, ".1f")
    rows = [{"over the configurations": name} | spread(found, form) for name, (found, form) in values.items()]
    budget = accuracy.budget()
    shown = pd.DataFrame(
        {
            "parameter": budget["parameter"],
            "joint": [None if pd.isna(j) else str(j) for j in budget["joint"]],
            "u [µm]": budget["u_mm"] * MM / UM,
            "share": budget["share"],
        }
    ).head(SHOWN_SOURCES)
    head = f"Where it comes from, the first {len(shown)} of {len(budget)} sources:"
    return paragraph(str(accuracy)) + table(pd.DataFrame(rows)) + table(shown, {"u [µm]": ".2f", "share": ".1%"}, head)


@html_of.register
def _map(map_: WorkspaceMap) -> str:
    cells_ = {str(count): [cells] for count, cells in map_.working_sectors().items()}
    return (
        paragraph(str(map_))
        + table(map_table(map_))
        + table(pd.DataFrame(cells_), head="Reachable cells by their number of working sectors:")
        + details("all data", map_.data._repr_html_())
    )


@html_of.register
def _single_point(point: SinglePoint) -> str:
    rows = [{"records": "all", "number": point.n, "spread [µm]": point.sigma / UM}]
    if point.part_n:
        rows.append({"records": "high-accuracy part", "number": point.part_n, "spread [µm]": point.part / UM})
        rows.append({"records": "the rest", "number": point.n - point.part_n, "spread [µm]": point.rest / UM})
    return paragraph(str(point), "Single point:") + table(pd.DataFrame(rows), {"spread [µm]": ".2f"})


@html_of.register
def _point(point: PointUncertainty) -> str:
    frame = point.to_frame()
    frame.columns = [_with_unit(str(name)) for name in frame.columns]
    head = "95 % coverage intervals, shortest and probabilistically symmetric:"
    return paragraph(str(point), "Point by Monte Carlo:") + table(frame, dict.fromkeys(frame.columns, ".5f"), head)


@html_of.register
def _length(length: LengthUncertainty) -> str:
    rows = {"estimate [mm]": length.estimate, "mean [mm]": length.mean, "u [mm]": length.u}
    for name, (low, high) in (("shortest", length.shortest), ("symmetric", length.symmetric)):
        rows |= {f"{name} from [mm]": low, f"{name} to [mm]": high}
    shown = pd.DataFrame({name: np.array([value]) / MM for name, value in rows.items()})
    return paragraph(str(length), "Length by Monte Carlo:") + table(shown, dict.fromkeys(shown.columns, ".5f"))


def _with_unit(column: str) -> str:
    """``shortest_low_mm`` as ``shortest low [mm]``."""
    return f"{column.removesuffix('_mm').replace('_', ' ')} [mm]" if column.endswith("_mm") else column.replace("_", " ")
