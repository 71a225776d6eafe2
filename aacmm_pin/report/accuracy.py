"""Postures, accuracy, maps and Monte Carlo as documents: what is known before anything is measured."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy.volume import AccuracyVolume, paired
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.postures.curve_sampling import Flexibility, sector_centres
from aacmm_pin.postures.solution_set import PosturesAtPoint
from aacmm_pin.report.document import Block, Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import in_one_unit, percent, spread

SHOWN_SOURCES = 8
"""So many sources of a budget are shown."""


@document_of.register
def postures_document(postures: PosturesAtPoint) -> Document:
    """The components of the configurations at a point."""
    table = postures.summary().rename(columns=lambda name: str(name).replace("_", " "))
    return Document("Configurations", [str(postures), Table(table)])


@document_of.register
def flexibility_document(flexibility: Flexibility) -> Document:
    """Which sectors have a configuration."""
    number = len(flexibility.sectors)
    if not number:  # an arm without an elbow that goes round
        return Document("Flexibility", [Paragraph(f"{flexibility.arc_fraction:.3f} of arc", head="Flexibility:")])
    centres = sector_centres(number) / DEG
    works = {f"{centre:.4g}°": ["works" if yes else "–"] for centre, yes in zip(centres, flexibility.sectors, strict=True)}
    words = f"{flexibility.zeta:.3f} by {number} sectors, {flexibility.arc_fraction:.3f} of arc"
    table = Table(pd.DataFrame(works), "Swivel angle of each sector's centre")
    return Document("Flexibility", [Paragraph(words, head="Flexibility ζ:"), table])


@document_of.register
def accuracy_document(accuracy: AccuracyVolume) -> Document:
    """Volume and uncertainty over the configurations, and their sources."""
    if not len(accuracy.q):
        return Document("Accuracy", [str(accuracy)])
    rows: dict[str, tuple[Array, str]] = {
        "accuracy volume [mm³]": (accuracy.volume / MM3, ".4g"),
        "expanded uncertainty U (k = 2) [µm]": (COVERAGE_FACTOR * accuracy.u / UM, ".1f"),
        "standard uncertainty u [µm]": (accuracy.u / UM, ".1f"),
    }
    if accuracy.sources.bounded:
        rows["largest deviation [µm]"] = (accuracy.largest_deviation / UM, ".1f")
    values = [{"over the configurations": name} | spread(found, form) for name, (found, form) in rows.items()]
    return Document("Accuracy", [str(accuracy), Table(pd.DataFrame(values)), *_sources(accuracy)])


def accuracy_at_point(postures: PosturesAtPoint, accuracy: AccuracyVolume, comprehensive: float | None) -> Document:
    """The same of every configuration at a point, with the best and the worst of them.

    Args:
        postures: every configuration at the point.
        accuracy: of those within the limits.
        comprehensive: comprehensive accuracy [mm³], or None.

    Raises:
        ShapeError: ``accuracy`` was computed for other configurations.
    """
    inside = paired(postures, accuracy)
    chosen = {
        "smallest volume": np.argmin(accuracy.volume),
        "largest volume": np.argmax(accuracy.volume),
        "smallest u": np.argmin(accuracy.u),
        "largest u": np.argmax(accuracy.u),
    }
    rows = [
        {
            "posture": words,
            "swivel [°]": postures.swivel[inside][k] / DEG,
            "θ1 … θn [°]": " ".join(f"{theta / DEG:.0f}" for theta in accuracy.q[k]),
            "volume [mm³]": accuracy.volume[k] / MM3,
            "U (k = 2)": COVERAGE_FACTOR * accuracy.u[k],
        }
        for words, k in chosen.items()
    ]
    table, formats = in_one_unit(pd.DataFrame(rows), ["U (k = 2)"])
    elbow = bool(np.isfinite(table["swivel [°]"]).all())
    head = "Postures, swivel 0 where the elbow is highest" if elbow else "Postures"
    shown = table if elbow else table.drop(columns="swivel [°]")
    whole = document_of(accuracy)
    return Document(
        "Accuracy",
        [
            str(postures),
            whole.blocks[0],
            "" if comprehensive is None else f"comprehensive accuracy {comprehensive:.4g} mm³",
            Table(shown, head, formats | {"swivel [°]": ".1f", "volume [mm³]": ".4g"}),
            *whole.blocks[1:],
        ],
    )


def _sources(accuracy: AccuracyVolume) -> list[Block]:
    """The largest parts of the uncertainty budget, and what is not in it."""
    budget = accuracy.budget()
    joint = [None if pd.isna(number) else str(number) for number in budget["joint"]]
    table = pd.DataFrame({"parameter": budget["parameter"], "joint": joint, "u [µm]": budget["u_mm"] * MM / UM})
    table = table.assign(**{"share of variance": budget["share"]}).head(SHOWN_SOURCES)
    exact = accuracy.sources.taken_as_exact
    return [
        Table(
            table,
            f"Uncertainty budget, the first {len(table)} of {len(budget)} sources",
            {"u [µm]": ".2f", "share of variance": lambda share: percent(share, 1)},
        ),
        f"no uncertainty is stated for, and so taken as exact: {', '.join(exact)}" if exact else "",
    ]


@document_of.register
def map_document(map_: WorkspaceMap) -> Document:
    """Least, median and largest of what a map holds, and its cells by working sectors."""
    rows: dict[str, Any] = {
        "comprehensive accuracy [mm³]": map_.data["comprehensive_mm3"],
        "smallest accuracy volume [mm³]": map_.data["best_mm3"],
        "largest accuracy volume [mm³]": map_.data["worst_mm3"],
        "smallest standard uncertainty [µm]": MM / UM * map_.data["smallest_u_mm"],
        "largest standard uncertainty [µm]": MM / UM * map_.data["largest_u_mm"],
        "flexibility [1]": map_.data["flexibility"],
    }
    values = pd.DataFrame([{"over the cells": name} | spread(data.values, ".4g") for name, data in rows.items()])
    cells = pd.DataFrame({str(sectors): [number] for sectors, number in map_.working_sectors().items()})
    return Document("Map", [str(map_), Table(values), Table(cells, "Reachable cells by their number of working sectors")])
