"""Prediction of an acceptance test: median and interval of each test value, probability of
conformity, and the cause with the largest effect.
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

ARM_COLOURS = (BLUE, GREEN, GREY)
PREDICTION_HEADS = {
    "figure": "characteristic",
    "median_mm": "median [mm]",
    "low_mm": "2.5 % quantile [mm]",
    "high_mm": "97.5 % quantile [mm]",
    "mpe_mm": "MPE [mm]",
    "probability_to_pass": "conforming share",
    "dominant": "largest cause",
    "dominant_alone_mm": "median of this cause alone [mm]",
}
"""Columns of the table, and their heads."""
STATED_ONLY = (
    "The prediction is a first-order approximation, and contains only the uncertainties that the "
    "arm states. Causes that the model of the arm lacks increase the errors further. The "
    "conforming share is the share of the runs with the verdict conformity."
)
INTERVALS_CAPTION = (
    "The dots show the medians of the test values, the bars show the 95 % intervals, and the "
    "vertical marks show the MPEs."
)
ALONE_CAPTION = "Median of each test value if one cause acts alone"
ALONE_EXPLAINED = (
    "Correlated parameters of a calibration may have larger effects alone than together."
)


@document_of.register
def prediction_document(result: PredictedAcceptance) -> Document:
    """The predicted test values of a procedure."""
    table = result.to_frame()
    several = table["arm"].nunique() > 1
    shown = [*PREDICTION_HEADS]
    if several:
        shown.insert(0, "arm")
    if (table["missing"] != "").any():
        shown.append("missing")
    forms = {"probability_to_pass": ".2f"}
    alone = result.causes().rename(columns=lambda name: UNIT.sub(" [mm]", name))
    if not several:
        alone = alone.drop(columns="arm")
    seed = "" if result.seed is None else f", seed {result.seed}"
    summary = json_text(result.summary()).encode()
    return Document(
        "Predicted acceptance test",
        [
            ORIGIN,
            Paragraph(f"{result}.", finding=True, head="Predicted:"),
            Table(table[shown], "Predicted magnitude of each test value", forms, PREDICTION_HEADS),
            Paragraph(STATED_ONLY, detail=True),
            Figure(
                lambda: _intervals(result),
                "95 % intervals of the test values",
                INTERVALS_CAPTION,
            ),
            Table(
                alone, ALONE_CAPTION, heads=PREDICTION_HEADS, explained=ALONE_EXPLAINED, detail=True
            ),
            Notes(result.notes),
            Download("prediction.json", "all numbers of this page", summary),
        ],
        f"{result.path}; {result.count} runs{seed}",
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
        colour, label = ARM_COLOURS[number % 3], f.source if f.definition.name == names[0] else None
        axes.plot([low, high], [y, y], color=colour, lw=2.5, solid_capstyle="butt", label=label)
        axes.plot(median, y, "o", color=colour, mec="white")
        axes.plot(f.runs[0].mpe / MM, y, "|", color=VERMILLION, ms=16, mew=2.5)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="magnitude [mm]", xlim=(0, None))
    axes.invert_yaxis()
    axes.grid(axis="x", color="#eeeeee")
    if len(arms) > 1:
        axes.legend(frameon=False, fontsize=8)
    return axes.figure  # type: ignore[return-value]
