"""Cards of arms: geometry, limits, noise, causes of error, and what is known of records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from aacmm_pin._support.table_cells import spread
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.accuracy.error_sources import ErrorSources
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import KINDS, DHTable
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.arm.poses import Poses
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import COLUMNS, Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.labels import in_words, values_in_words
from aacmm_pin.measurements.noise import Noise
from aacmm_pin.report.calibration_findings import small_unit
from aacmm_pin.report.cards.card import html_of, paragraph, table
from aacmm_pin.report.diagnosis_findings import effect_values

HEADS = dict(zip(KINDS, ("a [mm]", "d [mm]", "α [°]", "θ offset [°]"), strict=True))
"""Heads of the columns of a DH table."""
FEW = 8
"""So many postures are shown."""


@html_of.register
def _arm(arm: Arm) -> str:
    joints = f"{arm.nq} joints"
    what = f"{joints}, {arm.dh.rows} rows of {arm.dh.convention}" if arm.dh else f"{joints}, from a URDF"
    gravity = "no gravity" if not arm.gravity.any() else f"gravity {_vector(arm.gravity)} m/s²"
    stylus = "" if arm.stylus_axis is None else f"; stylus along {_vector(arm.stylus_axis)} of the tip's frame"
    exact = arm.without_uncertainty
    return (
        paragraph(f"{what}; tip at frame {arm.tip}{stylus}; {gravity}; {arm.reference_temperature:g} °C", arm.name)
        + paragraph(f"Source: {arm.source}" if arm.source else "")
        + table(_rows(arm) if arm.dh is not None else _joints(arm))
        + paragraph(_of_uncertainty(arm, exact))
    )


def _of_uncertainty(arm: Arm, exact: tuple[str, ...]) -> str:
    if len(exact) == len(arm.parameters):
        return "No uncertainty is stated: it has postures, but no accuracy."
    said = "±: half-widths as stated; without ±: exact"
    if arm.covariance is not None:
        said += f"; U (k = 2) of the {len(arm.covariance.parameters)} parameters that a calibration knows together"
    if not exact:
        return f"{said}."
    return f"{said}. Nothing is stated of {', '.join(exact[:FEW])}{' …' if len(exact) > FEW else ''}."


def _rows(arm: Arm) -> pd.DataFrame:
    """One row a DH row: its values ± half-widths, limits, noise, mass."""
    dh = arm.require_dh("its table")
    found = _dh_cells(dh, {p.name: p.half_width for p in arm.parameters})
    joint = np.cumsum(dh.moving) - 1
    found["limits [°]"] = [_limits(arm, joint[i]) if dh.moving[i] else "fixed" for i in range(dh.rows)]
    if arm.encoder_noise is not None:
        u = arm.encoder_noise / UM
        found["encoder u [µrad]"] = [f"{u[joint[i]]:.4g}" if dh.moving[i] else "" for i in range(dh.rows)]
    if arm.file is not None and any(row.mass_kg for row in arm.file.joints):
        found["mass [kg]"] = ["" if row.mass_kg is None else f"{row.mass_kg:g}" for row in arm.file.joints]
    return found


def _dh_cells(dh: DHTable, half_widths: dict[str, float | None]) -> pd.DataFrame:
    found: dict[str, list[str]] = {"row": [str(i + 1) for i in range(dh.rows)]}
    for kind, values in zip(KINDS, dh.values().T, strict=True):
        scale = MM if kind in ("a", "d") else DEG
        of_rows = [half_widths.get(f"{kind}{i + 1}") or 0.0 for i in range(dh.rows)]
        found[HEADS[kind]] = [
            f"{v / scale:z.5f}" + (f" ± {half / scale:.5f}" if half else "") for v, half in zip(values, of_rows, strict=True)
        ]
    return pd.DataFrame(found)


def _joints(arm: Arm) -> pd.DataFrame:
    """One row a joint of an arm that came as URDF."""
    half = [[p.half_width for p in arm.parameters if p.joint == j + 1] for j in range(arm.nq)]
    rows = []
    for j, name in enumerate(arm.joint_names):
        sliding = arm.chain.prismatic[j]
        rows.append(
            {
                "joint": str(j + 1),
                "name": name,
                "moves": "along" if sliding else "about",
                "axis": _vector(arm.joint_axes[j]),
                f"limits [{'°, or mm' if arm.chain.prismatic.any() else '°'}]": _limits(arm, j),
                "placement ± [mm]": ", ".join(f"{(h or 0.0) / MM:g}" for h in half[j][:3]),
                "placement ± [µrad]": ", ".join(f"{(h or 0.0) / UM:g}" for h in half[j][3:]),
            }
        )
    table_ = pd.DataFrame(rows)
    if arm.encoder_noise is not None:
        table_["encoder u [µrad]"] = [f"{u:.4g}" for u in arm.encoder_noise / UM]
    return table_


def _limits(arm: Arm, joint: int) -> str:
    unit = MM if arm.chain.prismatic[joint] else DEG
    low, high = arm.limits[joint] / unit
    return f"{low:z.5g} to {high:z.5g}"


def _vector(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return "(" + ", ".join(f"{value:z.4g}" for value in np.round(values, 12)) + ")"


@html_of.register
def _dh(dh: DHTable) -> str:
    found = _dh_cells(dh, {}).assign(joint=["yes" if m else "fixed" for m in dh.moving])
    return paragraph(f"{dh.rows} rows, {dh.nq} joints, {dh.convention}", "DH table") + table(found)


@html_of.register
def _parameter(parameter: Parameter) -> str:
    return paragraph("", parameter.name) + table(parameter_rows([parameter]))


def parameter_rows(parameters: list[Parameter]) -> pd.DataFrame:
    """One row a parameter: kind, joint, value, half-width and u, each with its unit."""
    return pd.DataFrame(
        [
            {
                "parameter": p.name,
                "kind": p.kind,
                "joint": None if p.joint is None else str(p.joint),
                "value": _quantity(p.value, p.unit),
                "±": None if p.half_width is None else _small(p.half_width, p.unit),
                "u": _small(p.u, p.unit),
                "scope": p.scope,
            }
            for p in parameters
        ]
    )


def _quantity(value: float, unit: str) -> str:
    if unit == "m":
        return f"{value / MM:z.5f} mm"
    return f"{value:z.7f} rad" if unit == "rad" else f"{value:.6g} {unit}".removesuffix(" 1")


def _small(value: float, unit: str) -> str:
    """An uncertainty in the unit in which it is a number of a few digits."""
    small, factor = small_unit("mm" if unit == "m" else unit)
    return f"{value / MM * factor if unit == 'm' else value * factor:.4g} {small}"


@html_of.register
def _effect(effect: Effect) -> str:
    typical = [_small(term.typical, term.unit) for term in effect.terms]
    rows = parameter_rows(list(effect.parameters())).drop(columns=["kind", "±"]).assign(typical=typical)
    needs = f"; depends on {', '.join(effect.needs)}" if effect.needs else ""
    u = ", ± U (k = 2)" if any(effect.u) else ""
    return paragraph(f"{values_in_words(effect_values(effect))}{u}{needs}", f"{in_words(effect)}:") + table(rows)


@html_of.register
def _error_model(model: ErrorModel) -> str:
    words = {e.label: values_in_words(effect_values(e)) for e in model.effects}
    rows = [{"cause": in_words(e), "label": e.label, "value ± U (k = 2)": words[e.label]} for e in model.effects]
    causes = table(pd.DataFrame(rows), head=f"Causes of error: {len(rows)}")
    return html_of(model.arm) + (causes or paragraph("No causes of error beside geometry."))


@html_of.register
def _poses(poses: Poses) -> str:
    some = replace(poses, q=poses.q[:FEW])  # all of them may be a million
    frame = poses.model.frames[poses.frame_id].name
    found = {}
    for j, values in enumerate(some.q.T):
        slides = poses.model.joints[j + 1].shortname().startswith("JointModelP")  # prismatic; planar ones are refused
        found[f"joint {j + 1} [mm]" if slides else f"θ{j + 1} [°]"] = values / (MM if slides else DEG)
    found |= {f"{axis} [mm]": some.position[:, k] / MM for k, axis in enumerate("xyz")}
    formats = {name: "z.3f" if "°" in name else "z.4f" for name in found}
    more = paragraph(f"… and {len(poses.q) - FEW} more") if len(poses.q) > FEW else ""
    words = f"{len(poses.q)} configurations, frame {frame}, by Pinocchio"
    return paragraph(words, poses.model.name) + table(pd.DataFrame(found), formats) + more


@html_of.register
def _conditions(conditions: Conditions) -> str:
    rows = []
    for name in conditions.present:
        values = conditions.require(name, "its card")
        if values.dtype == object:
            labels = [label for label in dict.fromkeys(values) if label]
            text = f"{len(labels)}: {', '.join(labels[:FEW])}{' …' if len(labels) > FEW else ''}"
        else:
            found = spread(values, ".6g")
            text = f"{found['least']} to {found['largest']}"
        rows.append({"condition": name.replace("_", " "), "column": COLUMNS[name], "values": text})
    known = table(pd.DataFrame(rows)) or paragraph("Nothing is known beside the angles.")
    return paragraph(f"of {conditions.n} records", "Conditions") + known


@html_of.register
def _noise(noise: Noise) -> str:
    rows = [{"noise": f"encoder {j}", "u": f"{u / UM:.4g} µrad"} for j, u in enumerate(noise.encoder, start=1)]
    rows += [{"noise": name, "u": f"{u / UM:.4g} µm"} for name, u in _contacts(noise).items()]
    return paragraph("standard uncertainties of what is new in every record", "Noise:") + table(pd.DataFrame(rows))


def _contacts(noise: Noise) -> dict[str, float]:
    return {"coordinate of a reference": noise.reference, "coordinate of a contact": noise.probe}


@html_of.register
def _sources(sources: ErrorSources) -> str:
    left_out = f"; not included: {', '.join(sources.not_included)}" if sources.not_included else ""
    words = f"{len(sources.parameters)} sources of error at {sources.at}{left_out}"
    return paragraph(words, sources.arm.name) + table(parameter_rows(list(sources.parameters)), most=40)
