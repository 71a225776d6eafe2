"""Figures of an acceptance test before it is made: median, interval, chance to conform, and what
each comes from.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure as Drawing

from aacmm_pin._support.output_files import json_text
from aacmm_pin._support.units import MM
from aacmm_pin.report.document import (
    Document,
    Download,
    Figure,
    Notes,
    Paragraph,
    Table,
    document_of,
)
from aacmm_pin.report.numbers import UNIT
from aacmm_pin.report.plots.style import BLUE, GREEN, GREY, VERMILLION, plain
from aacmm_pin.report.procedure import ORIGIN
from aacmm_pin.verification import PredictedAcceptance

COLOURS = (BLUE, GREEN, GREY)


@document_of.register
def prediction_document(result: PredictedAcceptance) -> Document:
    """The figures that a procedure will show."""
    table = result.to_frame()
    heads = {
        "median_mm": "median [mm]",
        "low_mm": "95 % from [mm]",
        "high_mm": "95 % to [mm]",
        "mpe_mm": "MPE [mm]",
    }
    heads |= {
        "probability_to_pass": "conforms",
        "dominant": "largest cause",
        "dominant_alone_mm": "this cause alone [mm]",
    }
    several = table["arm"].nunique() > 1
    shown = ["arm"] * several + ["figure", *heads]
    shown += ["missing"] * bool((table["missing"] != "").any())
    return Document(
        "Acceptance test, before it is made",
        [
            ORIGIN,
            Paragraph(f"{result}.", finding=True, head="Predicted:"),
            Table(table[shown], "Magnitude of each figure", {"probability_to_pass": ".2f"}, heads),
            Paragraph(
                "Predicted is what the arm states as uncertain, first order; what its model gets "
                "wrong unknown to it is "
                "not in these figures. Conforms: share of the runs in which the figure and U are "
                "within the MPE.",
                detail=True,
            ),
            Figure(
                lambda: _intervals(result),
                "Intervals of the figures, with their limits",
                "Median and 95 % interval of every figure; a mark stands at the MPE.",
            ),
            Table(
                result.causes()
                .drop(columns=[] if several else "arm")
                .rename(columns=lambda name: UNIT.sub(" [mm]", name)),
                "Median of the figure by each cause alone",
                explained="Parameters that a calibration knows together may do more alone than "
                "together.",
                detail=True,
            ),
            Notes(result.notes),
            Download(
                "prediction.json", "the figures as JSON", json_text(result.summary()).encode()
            ),
        ],
        f"{result.path}; {result.count} runs"
        + ("" if result.seed is None else f", seed {result.seed}"),
    )


@plain
def _intervals(result: PredictedAcceptance) -> Drawing:
    names = [*dict.fromkeys(f.definition.name for f in result.figures)]
    arms = [*dict.fromkeys(f.source for f in result.figures)]
    axes = Drawing(figsize=(8.0, 1.2 + 0.45 * len(names)), layout="constrained").add_subplot()
    for f in result.figures:
        number = arms.index(f.source)
        y = names.index(f.definition.name) + 0.22 * (number - (len(arms) - 1) / 2)
        low, median, high = np.quantile(f.magnitudes, (0.025, 0.5, 0.975)) / MM
        label = f.source if f.definition.name == names[0] else None
        axes.plot(
            [low, high],
            [y, y],
            color=COLOURS[number % 3],
            lw=2.5,
            solid_capstyle="butt",
            label=label,
        )
        axes.plot(median, y, "o", color=COLOURS[number % 3], mec="white")
        axes.plot(f.runs[0].mpe / MM, y, "|", color=VERMILLION, ms=16, mew=2.5)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="magnitude [mm]", xlim=(0, None))
    axes.invert_yaxis()
    axes.grid(axis="x", color="#eeeeee")
    if len(arms) > 1:
        axes.legend(frameon=False, fontsize=8)
    return axes.figure  # type: ignore[return-value]
