"""A diagnosis as a dictionary for ``aacmm-pin diagnose --json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from aacmm_pin._support.display import notes_in_json
from aacmm_pin._support.plain_values import of_models, plain
from aacmm_pin._support.units import MM
from aacmm_pin.calibration import rms
from aacmm_pin.diagnosis import Diagnosis, Finding, Unexplained, not_tried
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect, fields_of, strongest_waves
from aacmm_pin.report.calibration_page import bases_in_json
from aacmm_pin.report.check_page import not_tried_in_json
from aacmm_pin.report.verdicts import next_measurements

DIAGNOSIS_SCHEMA = "aacmm-pin/diagnosis/1"
PLACE_FIELDS = {"joint", "bodies"}
"""Fields of a cause that are written elsewhere."""


def diagnosis_to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Schema ``aacmm-pin/diagnosis/1``."""
    extended, posterior = diagnosis.extended, diagnosis.choice.posterior
    records = extended.problem.measurements
    shown, tried = diagnosis.visible
    sets = diagnosis.alternatives
    likely = _likely(sets)
    summary = {
        "schema": DIAGNOSIS_SCHEMA,
        "arm": diagnosis.model.arm.name,
        "verdict": diagnosis.verdict,
        "doubts": diagnosis.doubts,
        "causes_shown": shown,
        "causes_tried": tried,
        "converged": diagnosis.converged,
        "converge_note": diagnosis.converge_note,
        "records": {
            "used": extended.used.sum(),
            "excluded": diagnosis.excluded[["row", "reason", "residual_mm"]],
        },
        "rms_mm": of_models({name: size / MM for name, size in diagnosis.rms.items()}),
        "rms_rad": diagnosis.turns and of_models(diagnosis.turns),
        "budget": [
            {
                "part": part.part,
                "causes": part.causes,
                "rms_mm": part.rms / MM,
                "mean_square_mm2": part.mean_square / MM**2,
                "u_mean_square_mm2": part.u / MM**2,
                "share": part.share,
            }
            for part in diagnosis.budget
        ],
        "findings": [*map(finding_to_dict, diagnosis.findings)],
        "places": [
            {
                "depends_on": place.depends_on,
                **_location(place.effect),
                "probability": place.probability,
                "forms": _likely(place.forms),
            }
            for place in diagnosis.places
        ],
        "held_out": _held_out(diagnosis),
        "alternatives": likely,
        "other_alternatives": {
            "count": len(sets) - len(likely),
            "probability": max(1.0 - sum(listed["probability"] for listed in likely), 0.0),
        },
        "agreement": {"total_variation": posterior.disagreement, "agree": posterior.agree},
        "discrepancy": discrepancy_to_dicts(diagnosis.unexplained),
        "unexplained": _unexplained(diagnosis.unexplained),
        "not_tried": not_tried_in_json(
            not_tried(diagnosis.model.arm, diagnosis.choice.library, records)
        ),
        "cannot_tell_apart": diagnosis.cannot_tell_apart,
        **bases_in_json(diagnosis.of_model),
        "next_measurements": next_measurements(diagnosis),
        **notes_in_json(diagnosis.notes),
    }
    return dict(plain(summary))


def finding_to_dict(finding: Finding) -> dict[str, Any]:
    """A cause with its place, fields, probabilities and values."""
    effect, gain = finding.effect, finding.brought
    names = [name for name in fields_of(type(effect)) if name not in PLACE_FIELDS]
    fields = {name: getattr(effect, name) for name in names}
    waves = strongest_waves(effect)
    if waves is not None:
        spectrum = [{"order": order, "amplitude_rad": size} for order, size in waves]
        fields["spectrum"] = spectrum
    aliases = [
        {
            "cause": alias.label if alias.effect is None else alias.effect.cause,
            **_location(alias.effect),
            "correlation": alias.correlation,
            "probability": alias.probability,
        }
        for alias in finding.aliases
    ]
    return {
        "cause": finding.cause,
        "joint": finding.joint,
        **{name: value for name, value in fields.items() if value not in (None, ())},
        "probability": finding.probability,
        "p_value": finding.p_value,
        "retained_fraction": finding.retained_fraction,
        "held_out": gain and {"gain": gain[0], "gain_ci95": gain[1:]},
        "parameters": _with_u(finding.parameters),
        "below_zero": finding.below_zero,
        "inner": _with_u(finding.inner),
        "aliases": aliases,
    }


def discrepancy_to_dicts(unexplained: Unexplained) -> list[dict[str, Any]]:
    """The parts of the discrepancy at the tip."""
    return [
        {
            "covariate": part.covariate,
            "rms_mm": part.rms / MM,
            "u_mm": part.u / MM,
            "probability": part.probability,
        }
        for part in unexplained.discrepancy
    ]


def _likely(sets: Mapping[tuple[str, ...], float]) -> list[dict[str, Any]]:
    return [
        {"causes": labels, "probability": p}
        for labels, p in sets.items()
        if p >= THRESHOLDS.worth_listing
    ]


def _location(effect: Effect | None) -> dict[str, Any]:
    """The joint, and another place, such as a seat, if the cause acts there; None: a covariate."""
    if effect is None:
        return {"joint": None}
    field = effect.location_field()
    other_place = {} if field in (None, "joint") else {field: effect.place}
    return {"joint": effect.row, **other_place}


def _with_u(values: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    return {name: {"value": value, "u": u} for name, (value, u) in values.items()}


def _held_out(diagnosis: Diagnosis) -> dict[str, Any] | None:
    held_out = diagnosis.held_out
    if held_out is None:
        return None
    return {
        "kind": held_out.kind,
        "groups": held_out.groups,
        "rms_mm": of_models(
            {
                "nominal": rms(held_out.nominal) / MM,
                "recalibrated": rms(held_out.recalibrated) / MM,
                "extended": rms(held_out.extended) / MM,
            }
        ),
        "gain": held_out.gain,
        "gain_ci95": held_out.interval,
        "excluded_counted": held_out.excluded,
        "gross_errors": held_out.gross_errors,
    }


def _unexplained(unexplained: Unexplained) -> dict[str, Any]:
    scattered = []
    for readings in unexplained.readings:
        size = {"scatter_rad": readings.scatter}
        if readings.slides:
            size = {"scatter_mm": readings.scatter / MM}
        test = {"log_likelihood_ratio": readings.log_ratio, "p_value": readings.p_value}
        scattered.append({"joint": readings.joint, **size, "rms_mm": readings.at_tips / MM, **test})
    shared_error = unexplained.shared_by_postures
    return {
        "p_value": unexplained.p_value,
        "threshold": unexplained.threshold,
        "depends_on": unexplained.depends_on,
        "acts_on": unexplained.acts_on,
        "smooth_correction_gain": unexplained.gain,
        "groups": [asdict(group) for group in unexplained.groups],
        "scattered_readings": scattered,
        "shared_by_postures": shared_error
        and {
            "rms_mm": shared_error.rms / MM,
            "times_a_record": shared_error.times,
            "p_value": shared_error.p_value,
        },
        "run_order": unexplained.run_order and asdict(unexplained.run_order),
    }
