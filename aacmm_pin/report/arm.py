"""Arms as documents: geometry, limits, noise, causes of error, and what is known of records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import KINDS, DHTable
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.arm.poses import Poses
from aacmm_pin.diagnosis.result import described
from aacmm_pin.effects import Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.labels import in_words, values_in_words
from aacmm_pin.report.document import Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import count, quantity, small, vector

HEADS = dict(zip(KINDS, ("a [mm]", "d [mm]", "α [°]", "θ offset [°]"), strict=True))
"""Heads of the columns of a DH table."""
FEW = 8
"""So many postures, or names, are shown."""
MOST_SOURCES = 40


@document_of.register
def arm_document(arm: Arm) -> Document:
    """Geometry with its uncertainty, limits and noise."""
    joints = count(arm.nq, "joint")
    what = f"{joints}, {arm.dh.rows} rows of {arm.dh.convention}" if arm.dh else f"{joints}, from a URDF"
    gravity = f"gravity {vector(arm.gravity)} m/s²" if arm.gravity.any() else "no gravity"
    stylus = "" if arm.stylus_axis is None else f"; stylus along {vector(arm.stylus_axis)} of the tip's frame"
    return Document(
        arm.name,
        [
            Paragraph(f"{what}; tip at frame {arm.tip}{stylus}; {gravity}; {arm.reference_temperature:g} °C", head=arm.name),
            f"Source: {arm.source}" if arm.source else "",
            Table(_rows(arm, arm.dh) if arm.dh is not None else _joints(arm)),
            _uncertainty_in_words(arm),
        ],
    )


def _uncertainty_in_words(arm: Arm) -> str:
    exact = arm.without_uncertainty
    if len(exact) == len(arm.parameters):
        return "No uncertainty is stated, so no accuracy can be computed."
    text = "±: half-widths as stated; without ±: exact"
    if arm.covariance is not None:
        text += f"; U (k = 2) of the {len(arm.covariance.parameters)} parameters of a calibration with its covariance"
    names = f" Not stated: {', '.join(exact[:FEW])}{' …' if len(exact) > FEW else ''}." if exact else ""
    return f"{text}.{names}"


def _rows(arm: Arm, dh: DHTable) -> pd.DataFrame:
    """One row a DH row: its values ± half-widths, limits, noise, mass."""
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
        halves = [half_widths.get(f"{kind}{i + 1}") for i in range(dh.rows)]
        found[HEADS[kind]] = [
            f"{value / scale:z.5f}" + (f" ± {half / scale:.5f}" if half else "")
            for value, half in zip(values, halves, strict=True)
        ]
    return pd.DataFrame(found)


def _joints(arm: Arm) -> pd.DataFrame:
    """One row a joint of an arm that came as URDF."""
    half = [[(p.half_width or 0.0) for p in arm.parameters if p.joint == j + 1] for j in range(arm.nq)]
    table = pd.DataFrame(
        {
            "joint": range(1, arm.nq + 1),
            "name": arm.joint_names,
            "moves": ["along" if sliding else "about" for sliding in arm.chain.prismatic],
            "axis": [vector(axis) for axis in arm.joint_axes],
            f"limits [{'°, or mm' if arm.chain.prismatic.any() else '°'}]": [_limits(arm, j) for j in range(arm.nq)],
            "placement ± [mm]": [", ".join(f"{h / MM:g}" for h in own[:3]) for own in half],
            "placement ± [µrad]": [", ".join(f"{h / UM:g}" for h in own[3:]) for own in half],
        }
    )
    return table if arm.encoder_noise is None else table.assign(**{"encoder u [µrad]": arm.encoder_noise / UM})


def _limits(arm: Arm, joint: int) -> str:
    low, high = arm.limits[joint] / (MM if arm.chain.prismatic[joint] else DEG)
    return f"{low:z.5g} to {high:z.5g}"


@document_of.register
def dh_document(dh: DHTable) -> Document:
    """The rows of a DH table."""
    words = f"{dh.rows} rows, {count(dh.nq, 'joint')}, {dh.convention}"
    rows = _dh_cells(dh, {}).assign(joint=["yes" if moves else "fixed" for moves in dh.moving])
    return Document("DH table", [Paragraph(words, head="DH table"), Table(rows)])


@document_of.register
def parameter_document(parameter: Parameter) -> Document:
    """A parameter with its uncertainty."""
    return Document(parameter.name, [Table(_parameters([parameter]), parameter.name)])


def _parameters(parameters: Sequence[Parameter]) -> pd.DataFrame:
    """One row a parameter: kind, joint, value, U, half-width, each with its unit, and to what it belongs."""
    return pd.DataFrame(
        [
            {
                "parameter": p.name,
                "kind": p.kind,
                "joint": None if p.joint is None else str(p.joint),
                "value": quantity(p.value, p.unit),
                "U (k = 2)": small(COVERAGE_FACTOR * p.u, p.unit),
                "half-width": None if p.half_width is None else small(p.half_width, p.unit),
                "scope": p.scope,
            }
            for p in parameters
        ]
    )


@document_of.register
def effect_document(effect: Effect) -> Document:
    """A cause of error with its parameters."""
    rows = _parameters(effect.parameters()).drop(columns=["kind", "half-width"])
    needs = f"; depends on {', '.join(effect.needs)}" if effect.needs else ""
    u = ", ± U (k = 2)" if any(effect.u) else ""
    typical = [small(term.typical, term.unit) for term in effect.terms]
    words = Paragraph(f"{_values(effect)}{u}{needs}", head=f"{in_words(effect)}:")
    return Document(in_words(effect), [words, Table(rows.assign(typical=typical))])


def _values(effect: Effect) -> str:
    """Described values of a cause ± U; its parameters count as independent."""
    return values_in_words(effect, described(effect, np.diag(np.square(effect.u))))


@document_of.register
def error_model_document(model: ErrorModel) -> Document:
    """An arm and its causes of error."""
    rows = [{"cause": in_words(e), "label": e.label, "value ± U (k = 2)": _values(e)} for e in model.effects]
    none = "" if rows else "No causes of error other than geometry."
    blocks = [*document_of(model.arm).blocks, Table(pd.DataFrame(rows), f"Causes of error: {len(rows)}"), none]
    return Document(model.arm.name, blocks)


@document_of.register
def poses_document(poses: Poses) -> Document:
    """Angles and tip positions of the first configurations; of all there may be a million."""
    some = replace(poses, q=poses.q[:FEW])
    found = {}
    for j, values in enumerate(some.q.T):
        slides = poses.model.joints[j + 1].shortname().startswith("JointModelP")  # prismatic; planar ones are refused
        found[f"joint {j + 1} [mm]" if slides else f"θ{j + 1} [°]"] = values / (MM if slides else DEG)
    found |= {f"{axis} [mm]": some.position[:, k] / MM for k, axis in enumerate("xyz")}
    formats = {name: "z.3f" if "°" in name else "z.4f" for name in found}
    words = f"{count(len(poses.q), 'configuration')}, frame {poses.model.frames[poses.frame_id].name}, by Pinocchio"
    more = f"… and {len(poses.q) - FEW} more" if len(poses.q) > FEW else ""
    return Document(
        poses.model.name, [Paragraph(words, head=poses.model.name), Table(pd.DataFrame(found), "", formats), more]
    )


@document_of.register
def sources_document(sources: ErrorSources) -> Document:
    """What errors an accuracy is computed from."""
    left_out = f"; not included: {', '.join(sources.not_included)}" if sources.not_included else ""
    words = f"{count(len(sources.parameters), 'source')} of error at {sources.at}{left_out}"
    table = Table(_parameters(sources.parameters), most=MOST_SOURCES)
    return Document(sources.arm.name, [Paragraph(words, head=sources.arm.name), table])
