"""Cards of measurements, calibrations and plans."""

from __future__ import annotations

import pandas as pd

from aacmm_pin._support.units import MM
from aacmm_pin.calibration import Calibration, HeldOut
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning import MeasurementPlan
from aacmm_pin.planning.detection_power import Power
from aacmm_pin.planning.result import Tried
from aacmm_pin.report.calibration_findings import (
    causes_in_words,
    decimals,
    fit_in_words,
    frame_in_words,
    readable_parameters,
    sizes_table,
    verdict,
)
from aacmm_pin.report.cards.card import bullets, html_of, paragraph, table
from aacmm_pin.report.plan_tables import pairs_table, tried_table

MOST = 12
"""So many rows of what may be long."""


@html_of.register
def _measurements(records: Measurements) -> str:
    return paragraph(str(records)) + table(records.summary())


@html_of.register
def _calibration(result: Calibration) -> str:
    parameters, excluded = readable_parameters(result), result.excluded
    beyond = parameters.pop("beyond")
    parameters["parameter"] = parameters["parameter"].where(~beyond, "* " + parameters["parameter"])
    head = "Parameters; changes and uncertainties in the small unit of the column in, U with k = 2:"
    return (
        paragraph(verdict(result))
        + paragraph(fit_in_words(result))
        + paragraph(frame_in_words(result))
        + bullets(causes_in_words(result), "Causes of error, ± U (k = 2):")
        + table(sizes_table(result), dict.fromkeys(("before [mm]", "after [mm]"), ".4f"), "RMS distance of tip and target:")
        + table(excluded, {"residual_mm": ".3f"}, f"excluded records ({len(excluded)}):", MOST)
        + table(parameters, dict.fromkeys(("change", "stated", "u", "U"), decimals(parameters)), head)
        + paragraph("* moved farther than its stated and its new uncertainty together allow" if beyond.any() else "")
        + bullets(result.undetermined, "Not told by these data, and left as it was:")
        + bullets(result.notes, "Notes:")
    )


@html_of.register
def _held_out(held: HeldOut) -> str:
    shown = pd.DataFrame({"before [mm]": [held.rms_before / MM], "after [mm]": [held.rms_after / MM]})
    words = f"{held.kind}, left out in {held.groups} parts; RMS distance of tip and target"
    return paragraph(words, "Held out:") + table(shown, dict.fromkeys(shown.columns, ".4f"))


@html_of.register
def _observability(indices: Observability) -> str:
    words = {
        "O1": ("(Πσ)^(1/m)/√n [m]", indices.o1),
        "O2": ("σ_min/σ_max [1]", indices.o2),
        "O3": ("σ_min [m]", indices.o3),
        "O4": ("σ_min²/σ_max [m]", indices.o4),
        "O5": ("1/Σ(1/σ) [m]", indices.o5),
    }
    rows = [{"index": name, "of the singular values σ": what, "value": value} for name, (what, value) in words.items()]
    head = f"of {indices.directions} directions that the data determine; larger is better"
    return paragraph(head, "Observability") + table(pd.DataFrame(rows), {"value": ".4g"})


@html_of.register
def _plan(plan: MeasurementPlan) -> str:
    tried = table(tried_table(plan), {"T": ".3g"}, "Set-ups that were considered:") if len(plan.tried) > 1 else ""
    return (
        paragraph(str(plan), "Plan:")
        + bullets(plan.set_up, "Set-up, beside postures:")
        + tried
        + table(pairs_table(plan), {"T": ".3g"}, "Told worst, of what these postures can tell:", MOST)
        + table(plan.records, dict.fromkeys(plan.records.columns, ".6g"), f"{len(plan.records)} records to measure:", MOST)
        + bullets(plan.notes, "Notes:")
    )


@html_of.register
def _tried(tried: Tried) -> str:
    return paragraph(tried.why_not, f"{tried.words}:") + html_of(tried.power)


@html_of.register
def _power(power: Power) -> str:
    rows = [
        {"if it is": "the first cause", "T": power.one, "T without the other": power.alone[0]},
        {"if it is": "the second cause", "T": power.other, "T without the other": power.alone[1]},
    ]
    words = f"{power.probability:.2f}"
    formats = dict.fromkeys(("T", "T without the other"), ".3g")
    return paragraph(words, "Probability of the right decision:") + table(pd.DataFrame(rows), formats)
