"""A diagnosis as a plain dictionary for JSON: what ``aacmm-pin diagnose --json`` writes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from aacmm_pin._support.notes import notes_in_json
from aacmm_pin._support.units import MM
from aacmm_pin.calibration import rms
from aacmm_pin.diagnosis import (
    Alias,
    BudgetPart,
    Diagnosis,
    Finding,
    Gain,
    ScatteredReadings,
    SharedError,
    Unexplained,
    not_tried,
)
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import DiscrepancySize
from aacmm_pin.effects import Effect, fields_of, strongest_waves
from aacmm_pin.report.calibration import bases_in_json
from aacmm_pin.report.check import not_tried_in_json
from aacmm_pin.report.next_measurements import next_measurements

DIAGNOSIS_SCHEMA = "aacmm-pin/diagnosis/1"
PLACE_FIELDS = {"joint", "bodies"}
"""Fields of a cause that are no inner fields."""


def diagnosis_to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Schema ``aacmm-pin/diagnosis/1``."""
    parts = diagnosis.unexplained.discrepancy
    summary: dict[str, Any] = {"schema": DIAGNOSIS_SCHEMA, "arm": diagnosis.model.arm.name}
    summary |= {"verdict": diagnosis.verdict, "doubts": list(diagnosis.doubts)}
    shown, tried = diagnosis.visible
    summary |= {"causes_shown": shown, "causes_tried": tried}
    summary |= {"converged": diagnosis.converged, "converge_note": diagnosis.converge_note}
    summary["records"] = _records(diagnosis)
    summary["rms_mm"] = {name: size / MM for name, size in diagnosis.rms.items()}
    summary["rms_rad"] = diagnosis.turns
    summary["budget"] = [_part_of_budget(part) for part in diagnosis.budget]
    summary["findings"] = [finding_to_dict(finding) for finding in diagnosis.findings]
    summary["held_out"] = _held_out(diagnosis.held_out)
    summary |= _alternatives(diagnosis)
    summary["agreement"] = _agreement(diagnosis.choice.posterior)
    summary["discrepancy"] = [_discrepancy(part) for part in parts]
    summary["unexplained"] = _unexplained(diagnosis.unexplained)
    records = diagnosis.extended.problem.measurements
    missing = not_tried(diagnosis.model.arm, diagnosis.choice.library, records)
    summary["not_tried"] = not_tried_in_json(missing)
    summary["cannot_tell_apart"] = [list(labels) for labels in diagnosis.cannot_tell_apart]
    summary |= bases_in_json(diagnosis.extended)
    summary["next_measurements"] = next_measurements(diagnosis)
    return summary | notes_in_json(diagnosis.notes)


def _alternatives(diagnosis: Diagnosis) -> dict[str, Any]:
    """Sets that are worth listing, and all others together."""
    every = diagnosis.alternatives.items()
    listed = [(labels, p) for labels, p in every if p >= THRESHOLDS.worth_listing]
    alternatives = [{"causes": list(labels), "probability": p} for labels, p in listed]
    rest = max(1.0 - sum(p for _, p in listed), 0.0)
    others = {"count": len(every) - len(listed), "probability": rest}
    return {"alternatives": alternatives, "other_alternatives": others}


def finding_to_dict(finding: Finding) -> dict[str, Any]:
    """A cause with its place, inner fields, probabilities and values."""
    summary: dict[str, Any] = {"cause": finding.cause, "joint": finding.joint}
    summary |= _inner_fields(finding.effect)
    summary |= _spectrum(finding.effect)
    summary |= {"probability": finding.probability, "p_value": finding.p_value}
    summary["retained_fraction"] = finding.retained_fraction
    summary["held_out"] = _brought(finding)
    summary["parameters"] = _with_u(finding.parameters)
    summary["below_zero"] = list(finding.below_zero)
    summary["inner"] = _with_u(finding.inner)
    summary["aliases"] = [_alias(alias) for alias in finding.aliases]
    return summary


def _records(diagnosis: Diagnosis) -> dict[str, Any]:
    used = int(diagnosis.extended.used.sum())
    excluded = diagnosis.excluded[["row", "reason", "residual_mm"]]
    return {"used": used, "excluded": excluded.to_dict("records")}


def _agreement(posterior: Posterior) -> dict[str, Any]:
    return {"total_variation": posterior.disagreement, "agree": posterior.agree}


def _part_of_budget(part: BudgetPart) -> dict[str, Any]:
    sizes = {"rms_mm": part.rms / MM, "mean_square_mm2": part.mean_square / MM**2}
    return {"part": part.part, "causes": list(part.causes), **sizes} | {
        "u_mean_square_mm2": part.u / MM**2,
        "share": part.share,
    }


def _held_out(gain: Gain | None) -> dict[str, Any] | None:
    if gain is None:
        return None
    summary: dict[str, Any] = {"kind": gain.kind, "groups": gain.groups}
    models = ("simulation", "recalibrated", "extended")
    summary["rms_mm"] = {name: rms(getattr(gain, name)) / MM for name in models}
    summary |= {"gain": gain.gain, "gain_ci95": list(gain.interval)}
    summary |= {"excluded_counted": gain.excluded, "gross_errors": gain.gross_errors}
    return summary


def _brought(finding: Finding) -> dict[str, Any] | None:
    if finding.brought is None:
        return None
    gain, *interval = finding.brought
    return {"gain": gain, "gain_ci95": interval}


def _inner_fields(effect: Effect) -> dict[str, Any]:
    """Orders, times and other fields that are set, but for the place."""
    names = [name for name in fields_of(type(effect)) if name not in PLACE_FIELDS]
    fields = {name: getattr(effect, name) for name in names}
    unset = (None, ())
    return {name: value for name, value in fields.items() if value not in unset}


def _spectrum(effect: Effect) -> dict[str, Any]:
    """Waves per turn of a free curve."""
    waves = strongest_waves(effect)
    if waves is None:
        return {}
    return {"spectrum": [{"order": order, "amplitude_rad": size} for order, size in waves]}


def _with_u(values: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float | None]]:
    pairs = map(_value, values.values())
    return dict(zip(values, pairs, strict=True))


def _value(known: tuple[float, float]) -> dict[str, float | None]:
    """A value with u; None where nothing determines it."""
    value, u = known
    return {"value": value, "u": u if math.isfinite(u) else None}


def _alias(alias: Alias) -> dict[str, Any]:
    place = _covariate(alias.label) if alias.effect is None else _place(alias.effect)
    return {**place, "correlation": alias.correlation, "probability": alias.probability}


def _covariate(label: str) -> dict[str, Any]:
    return {"cause": label, "joint": None}


def _place(effect: Effect) -> dict[str, Any]:
    """A cause, its joint, and the seat or body where it sits on one."""
    summary: dict[str, Any] = {"cause": effect.cause, "joint": effect.row}
    site = effect.location_field()
    if site not in (None, "joint"):
        summary[site] = effect.place
    return summary


def _discrepancy(part: DiscrepancySize) -> dict[str, Any]:
    summary: dict[str, Any] = {"covariate": part.covariate}
    summary |= {"rms_mm": part.rms / MM, "u_mm": part.u / MM}
    return summary | {"probability": part.probability}


def _unexplained(left: Unexplained) -> dict[str, Any]:
    summary: dict[str, Any] = {"p_value": left.p_value, "threshold": left.threshold}
    summary |= {"depends_on": list(left.depends_on), "acts_on": left.acts_on}
    summary["smooth_correction_gain"] = left.gain
    summary["groups"] = [asdict(group) for group in left.groups]
    summary["scattered_readings"] = [_scatter(readings) for readings in left.readings]
    summary["shared_by_postures"] = _shared(left.shared_by_postures)
    summary["run_order"] = None if left.run_order is None else asdict(left.run_order)
    return summary


def _scatter(readings: ScatteredReadings) -> dict[str, Any]:
    scatter = _amount("scatter", readings.scatter, readings.slides)
    chance = {"log_likelihood_ratio": readings.log_ratio, "p_value": readings.p_value}
    return {"joint": readings.joint, **scatter, "rms_mm": readings.at_tips / MM, **chance}


def _shared(error: SharedError | None) -> dict[str, float] | None:
    if error is None:
        return None
    return {"rms_mm": error.rms / MM, "times_a_record": error.times, "p_value": error.p_value}


def _amount(name: str, value: float, slides: bool) -> dict[str, float]:
    """An amount of a joint, its unit in the name; ``value`` in m where the joint slides, else in
    rad.
    """
    if slides:
        return {f"{name}_mm": value / MM}
    return {f"{name}_rad": value}
