"""Arms as documents: geometry, limits, noise, causes of error, and what is known of records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import KINDS, DHTable
from aacmm_pin.arm.file import COVERAGE_FACTOR, ArmFile
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.arm.poses import Poses
from aacmm_pin.effects import Effect, ErrorModel, in_words, values_in_words, values_with_u
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
    origin = f"{arm.dh.rows} rows of {arm.dh.convention}" if arm.dh else "from a URDF"
    words = [
        f"{count(arm.nq, 'joint')}, {origin}",
        f"tip at frame {arm.tip}",
        f"gravity {vector(arm.gravity)} m/s²",
    ]
    words += (
        []
        if arm.stylus_axis is None
        else [f"stylus along {vector(arm.stylus_axis)} of the tip's frame"]
    )
    return Document(
        arm.name,
        [
            Paragraph(f"{'; '.join(words)}; {arm.reference_temperature:g} °C", head=arm.name),
            f"Source: {arm.source}" if arm.source else "",
            Table(_rows(arm, arm.dh) if arm.dh is not None else _joints(arm)),
            _uncertainty_in_words(arm),
            f"Its calibration left unexplained: {arm.unexplained}." if arm.unexplained else "",
        ],
    )


def _uncertainty_in_words(arm: Arm) -> str:
    exact = arm.without_uncertainty
    if len(exact) == len(arm.parameters):
        return "No uncertainty is stated, so no accuracy can be computed."
    text = "±: half-widths as stated; without ±: exact"
    if arm.covariance is not None:
        text += (
            f"; U (k = 2) of the {len(arm.covariance.parameters)} parameters of a calibration "
            "with its covariance"
        )
    return f"{text}."


def _rows(arm: Arm, dh: DHTable) -> pd.DataFrame:
    """One row a DH row: its values ± half-widths, limits, noise, mass."""
    table = _dh_cells(dh, {p.name: p.half_width for p in arm.parameters})
    moving = np.flatnonzero(dh.moving)
    table["limits [°]"] = "fixed"
    table.loc[moving, "limits [°]"] = [_limits(arm, j) for j in range(arm.nq)]
    if arm.encoder_noise is not None:
        table.loc[moving, "encoder u [µrad]"] = arm.encoder_noise / UM
    if isinstance(arm.file, ArmFile) and any(row.mass_kg for row in arm.file.joints):
        table["mass [kg]"] = [row.mass_kg for row in arm.file.joints]
    return table


def _dh_cells(dh: DHTable, half_widths: Mapping[str, float | None]) -> pd.DataFrame:
    table = pd.DataFrame({"row": range(1, dh.rows + 1)})
    for kind, values in zip(KINDS, dh.values().T, strict=True):
        scale = MM if kind in ("a", "d") else DEG
        halves = [half_widths.get(f"{kind}{i + 1}") for i in range(dh.rows)]
        cells = zip(values / scale, halves, strict=True)
        table[HEADS[kind]] = [
            f"{value:z.5f}" + (f" ± {half / scale:.5f}" if half else "") for value, half in cells
        ]
    return table


def _joints(arm: Arm) -> pd.DataFrame:
    """One row a joint of an arm that came as URDF."""
    half = np.array([p.half_width or 0.0 for p in arm.parameters]).reshape(arm.nq, 6)
    table = pd.DataFrame(
        {
            "joint": range(1, arm.nq + 1),
            "name": arm.joint_names,
            "moves": ["along" if sliding else "about" for sliding in arm.chain.prismatic],
            "axis": [vector(axis) for axis in arm.joint_axes],
            "limits [°, or mm]": [_limits(arm, j) for j in range(arm.nq)],
            "placement ± [mm]": [tuple(own) for own in half[:, :3] / MM],
            "placement ± [µrad]": [tuple(own) for own in half[:, 3:] / UM],
        }
    )
    return (
        table
        if arm.encoder_noise is None
        else table.assign(**{"encoder u [µrad]": arm.encoder_noise / UM})
    )


def _limits(arm: Arm, joint: int) -> str:
    low, high = arm.limits[joint] / (MM if arm.chain.prismatic[joint] else DEG)
    return f"{low:z.5g} to {high:z.5g}"


@document_of.register
def dh_document(dh: DHTable) -> Document:
    """The rows of a DH table."""
    return Document(
        "DH table", [Table(_dh_cells(dh, {}).assign(joint=dh.moving), f"DH table, {dh.convention}")]
    )


def _parameters(parameters: Sequence[Parameter]) -> pd.DataFrame:
    """One row a parameter: value, U, half-width, each with its unit, and to what it belongs."""
    rows = [
        {
            "parameter": p.name,
            "value": quantity(p.value, p.unit),
            "U (k = 2)": small(COVERAGE_FACTOR * p.u, p.unit),
            "half-width": None if p.half_width is None else small(p.half_width, p.unit),
            "scope": p.scope,
        }
        for p in parameters
    ]
    return pd.DataFrame(rows)


@document_of.register
def parameter_document(parameter: Parameter) -> Document:
    """A parameter with its uncertainty."""
    return Document(parameter.name, [Table(_parameters([parameter]))])


@document_of.register
def effect_document(effect: Effect) -> Document:
    """A cause of error with its parameters."""
    needs = f"; depends on {', '.join(effect.needs)}" if effect.needs else ""
    rows = _parameters(effect.parameters()).drop(columns="half-width")
    rows["typical"] = [small(term.typical, term.unit) for term in effect.terms]
    words = Paragraph(
        f"{_values(effect)}{', ± U (k = 2)' if any(effect.u) else ''}{needs}",
        head=f"{in_words(effect)}:",
    )
    return Document(in_words(effect), [words, Table(rows)])


def _values(effect: Effect) -> str:
    """Described values of a cause ± U; its parameters count as independent."""
    return values_in_words(effect, values_with_u(effect, np.diag(np.square(effect.u))))


@document_of.register
def error_model_document(model: ErrorModel) -> Document:
    """An arm and its causes of error."""
    rows = [
        {"cause": in_words(e, model.arm), "label": e.label, "value ± U (k = 2)": _values(e)}
        for e in model.effects
    ]
    none = "" if rows else "No causes of error other than geometry."
    causes = Table(pd.DataFrame(rows), f"Causes of error: {len(rows)}")
    return Document(model.arm.name, [*arm_document(model.arm).blocks, causes, none])


@document_of.register
def poses_document(poses: Poses) -> Document:
    """Angles and tip positions of the first configurations; of all there may be a million."""
    table = {}
    for j, values in enumerate(poses.q.T):
        slides = (
            poses.model.joints[j + 1].shortname().startswith("JointModelP")
        )  # prismatic; planar ones are refused
        table[f"joint {j + 1} [mm]" if slides else f"θ{j + 1} [°]"] = values[:FEW] / (
            MM if slides else DEG
        )
    some = Poses(poses.model, poses.q[:FEW], poses.frame_id)
    table |= {f"{axis} [mm]": some.position[:, k] / MM for k, axis in enumerate("xyz")}
    words = (
        f"{count(len(poses.q), 'configuration')}, frame "
        f"{poses.model.frames[poses.frame_id].name}, by Pinocchio"
    )
    more = f"… and {len(poses.q) - FEW} more" if len(poses.q) > FEW else ""
    return Document(
        poses.model.name,
        [Paragraph(words, head=poses.model.name), Table(pd.DataFrame(table)), more],
    )


@document_of.register
def sources_document(sources: ErrorSources) -> Document:
    """What errors an accuracy is computed from."""
    left_out = f"; not included: {', '.join(sources.not_included)}" if sources.not_included else ""
    words = f"{count(len(sources.parameters), 'source')} of error at {sources.at}{left_out}"
    return Document(
        sources.arm.name,
        [
            Paragraph(words, head=sources.arm.name),
            Table(_parameters(sources.parameters), most=MOST_SOURCES),
        ],
    )
