"""What a diagnosis found, in tables for readers and files."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import Effect, JointErrorCurve
from aacmm_pin.report.diagnosis_findings import in_words, label_in_words, p_in_words, parameters_in_words, probability
from aacmm_pin.report.plots.diagnosis import models
from aacmm_pin.report.plots.groups import place_in_words, residuals_by_group
from aacmm_pin.report.plots.partial_residuals import state_of

RANKING_FORMATS = {"at the tip [µm]": ".1f", "retained": ".0%"}
RMS_FORMATS = dict.fromkeys(("simulated [mm]", "recalibrated [mm]", "extended [mm]", "noise alone [mm]"), ".4f")
OFF_FORMATS = dict.fromkeys(("RMS [mm]", "predicted [mm]"), ".4f") | {"times predicted": ".1f"}
"""Formats of the numbers of these tables."""
WAVES = 6
"""So many waves of a free curve are told."""
LOOK_ALIKES = 3
"""So many look-alikes of a cause are listed; the diagnosis has more."""


def motion_of(result: Diagnosis, effect: Effect) -> float:
    """RMS by which a cause moves the tip, or the stated place, over the used records [m]."""
    moved = effect.sensitivity(state_of(result.extended)) @ np.array(effect.values)
    return float(np.sqrt(np.square(moved[result.extended.used]).sum(axis=1).mean()))


def tip_motion(result: Diagnosis, finding: Finding) -> float:
    """The same of a finding [m]."""
    return motion_of(result, finding.effect)


def ranking(result: Diagnosis) -> pd.DataFrame:
    """The causes in the order of the diagnosis: cause, value with U, size at the tip [µm], probability, p, retained."""
    rows = [
        {
            "cause": in_words(f.effect),
            "value ± U (k = 2)": parameters_in_words(f),
            "at the tip [µm]": tip_motion(result, f) / UM,
            "probability": probability(f.probability),
            "p": p_in_words(f.p_value),
            "retained": f.retained_fraction,
        }
        for f in result.findings
    ]
    return pd.DataFrame(rows)


def look_alikes(result: Diagnosis) -> pd.DataFrame:
    """What looks like each cause in these records: cause, looks like, correlation r, probability in its place."""
    rows = [
        {
            "cause": in_words(f.effect),
            "looks like": label_in_words(a.label),
            "r": a.correlation,
            "probability": probability(a.probability),
        }
        for f in result.findings
        for a in f.aliases[:LOOK_ALIKES]
    ]
    return pd.DataFrame(rows)


def rms_table(result: Diagnosis) -> pd.DataFrame:
    """One row: RMS distance of tip and target by the three models, and by the noise alone [mm]."""
    names = {"simulation": "simulated", "noise": "noise alone"}
    return pd.DataFrame({f"{names.get(name, name)} [mm]": [value / MM] for name, value in result.rms.items()})


def most_off(result: Diagnosis, most: int) -> pd.DataFrame:
    """Groups of records where the simulation is off most, in times what its own uncertainties predict there."""
    table = residuals_by_group(result).sort_values("times_predicted", ascending=False).head(most)
    return pd.DataFrame(
        {
            "where": [place_in_words(by, group) for by, group in zip(table["by"], table["group"], strict=True)],
            "records": table["records"],
            "RMS [mm]": table["simulation_mm"],
            "predicted [mm]": table["predicted_mm"],
            "times predicted": table["times_predicted"],
        }
    )


def curves_in_words(result: Diagnosis) -> list[str]:
    """The strongest waves of each free curve that was found."""
    return [
        f"{in_words(f.effect)}, waves per turn: "
        + ", ".join(f"{order:.3g} ({size / UM:.1f} µrad)" for order, size in f.effect.spectrum()[:WAVES])
        for f in result.findings
        if isinstance(f.effect, JointErrorCurve)
    ]


def residuals_table(result: Diagnosis) -> pd.DataFrame:
    """One row a record: line of the file, labels, tip minus target by each model and held out [mm], whether it was used."""
    records = result.extended.problem.measurements
    table: dict[str, Any] = {"row": records.row}
    for holder, names in ((records, ("record", "operator")), (records.conditions, ("seat", "marker", "session"))):
        table |= {name: getattr(holder, name) for name in names if getattr(holder, name) is not None}
    for name, fit in models(result).items():
        deviation = fit.solution.system.deviation / MM
        table |= {f"{axis}_{name}_mm": deviation[:, k] for k, axis in enumerate("xyz")}
        table[f"{name}_mm"] = np.linalg.norm(deviation, axis=1)
    if (held := result.held_out) is not None:
        table |= {"part": held.part} | {f"held_out_{n}_mm": getattr(held, n) / MM for n in ("recalibrated", "extended")}
    return pd.DataFrame(table | {"used": result.extended.used})
