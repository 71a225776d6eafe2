"""Arms as documents: geometry, limits, noise, causes of error, and conditions of records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM, UM, count
from aacmm_pin.accuracy import ErrorSources
from aacmm_pin.arm import COVERAGE_FACTOR, KINDS, Arm, ArmFile, DHTable, Parameter, Poses
from aacmm_pin.effects import (
    Effect,
    ErrorModel,
    in_words,
    listed,
    values_in_words,
    values_with_u,
)
from aacmm_pin.report.document import Block, Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import quantity, small, vector

DH_HEADS = dict(zip(KINDS, ("a [mm]", "d [mm]", "α [°]", "θ offset [°]"), strict=True))
"""Heads of the columns of a DH table."""
POSTURES_LISTED = 8
"""So many postures, or names, are shown."""
MOST_SOURCES = 40


@document_of.register
def arm_document(arm: Arm) -> Document:
    """Geometry with its uncertainty, limits and noise."""
    origin = f"{arm.dh.rows} rows of {arm.dh.convention}" if arm.dh else "from a URDF"
    words = [f"{count(arm.nq, 'joint')} ({origin})", f"the tip at frame {arm.tip}"]
    words.append(f"gravity {vector(arm.gravity)} m/s²")
    if arm.stylus_axis is not None:
        words.append(f"the stylus along {vector(arm.stylus_axis)} of the tip's frame")
    words.append(f"lengths that hold at {arm.reference_temperature:g} °C")
    table = _joints(arm) if arm.dh is None else _rows(arm, arm.dh)
    blocks: list[Block] = [
        Paragraph(f"has {listed(words)}.", head=arm.name),
        Paragraph(arm.source, head="Source:" if arm.source else ""),
        Table(table),
        Paragraph(_uncertainty_in_words(arm)),
    ]
    if arm.unexplained:
        blocks.append(
            Paragraph(f"The last calibration left an error unexplained ({arm.unexplained}).")
        )
    return Document(arm.name, blocks)


def _uncertainty_in_words(arm: Arm) -> str:
    exact = arm.without_uncertainty
    if len(exact) == len(arm.parameters):
        return "The arm file states no uncertainty, so that the accuracy is unknown."
    calibrated = ""
    if arm.covariance is not None:
        number = len(arm.covariance.parameters)
        calibrated = f", or U (k = 2) for the {number} parameters of a calibration"
    return f"± precedes half-widths{calibrated}; values without ± are exact."


def _rows(arm: Arm, dh: DHTable) -> pd.DataFrame:
    """One row a DH row: its values ± half-widths, limits, noise, mass."""
    table = _dh_cells(dh, {p.name: p.half_width for p in arm.parameters})
    moving = np.flatnonzero(dh.moving)
    table[_limits_head(arm)] = "fixed"
    table.loc[moving, _limits_head(arm)] = [_limits(arm, j) for j in range(arm.nq)]
    if arm.encoder_noise is not None:
        table.loc[moving, _noise_head(arm)] = arm.encoder_noise / UM
    if isinstance(arm.file, ArmFile) and any(row.mass_kg for row in arm.file.joints):
        table["mass [kg]"] = [row.mass_kg for row in arm.file.joints]
    return table


def _dh_cells(dh: DHTable, half_widths: Mapping[str, float | None]) -> pd.DataFrame:
    table = pd.DataFrame({"row": range(1, dh.rows + 1)})
    for kind, values in zip(KINDS, dh.values().T, strict=True):
        scale = MM if kind in ("a", "d") else DEG
        halves = [half_widths.get(f"{kind}{row}") for row in table["row"]]
        cells = zip(values / scale, halves, strict=True)
        table[DH_HEADS[kind]] = [_dh_cell(value, half, scale) for value, half in cells]
    return table


def _dh_cell(value: float, half_width: float | None, scale: float) -> str:
    known = f" ± {half_width / scale:.5f}" if half_width else ""
    return f"{value:z.5f}{known}"


def _joints(arm: Arm) -> pd.DataFrame:
    """One row a joint of an arm that came as URDF."""
    half = np.array([p.half_width or 0.0 for p in arm.parameters]).reshape(-1, 6)
    table = pd.DataFrame({"name": arm.joint_names})
    table.insert(0, "joint", table.index + 1)
    table["moves"] = np.where(arm.chain.slides, "along", "about")
    table["axis"] = [vector(axis) for axis in arm.joint_axes]
    table[_limits_head(arm)] = ""
    own = arm.chain.drive.own
    table.loc[own, _limits_head(arm)] = [_limits(arm, j) for j in range(arm.nq)]
    for mimic in arm.mimics:
        of = "reading" if mimic.of == mimic.joint else f"joint {mimic.of}"
        follows = f"{mimic.ratio:.5g} × {of}"
        table.loc[mimic.joint - 1, _limits_head(arm)] = follows
    table["placement ± [mm]"] = [*map(tuple, half[:, :3] / MM)]
    table["placement ± [µrad]"] = [*map(tuple, half[:, 3:] / UM)]
    if arm.encoder_noise is not None:
        table.loc[own, _noise_head(arm)] = arm.encoder_noise / UM
    return table


def _limits_head(arm: Arm) -> str:
    return "limits [°, or mm]" if arm.chain.slides.any() else "limits [°]"


def _noise_head(arm: Arm) -> str:
    return "encoder u [µrad, or µm]" if arm.chain.slides.any() else "encoder u [µrad]"


def _limits(arm: Arm, joint: int) -> str:
    unit = MM if arm.chain.prismatic[joint] else DEG
    low, high = arm.limits[joint] / unit
    return f"{low:z.5g} to {high:z.5g}"


@document_of.register
def dh_document(dh: DHTable) -> Document:
    """The rows of a DH table."""
    table = _dh_cells(dh, {}).assign(joint=dh.moving)
    return Document("DH table", [Table(table, f"DH table, {dh.convention}")])


def _parameters(parameters: Sequence[Parameter]) -> pd.DataFrame:
    """One row a parameter: value, U, half-width, each with its unit, and to what it belongs."""
    return pd.DataFrame([_parameter(parameter) for parameter in parameters])


def _parameter(p: Parameter) -> dict[str, str | None]:
    row: dict[str, str | None] = {"parameter": p.name, "value": quantity(p.value, p.unit)}
    row["U (k = 2)"] = small(COVERAGE_FACTOR * p.u, p.unit)
    row["half-width"] = None if p.half_width is None else small(p.half_width, p.unit)
    row["scope"] = p.scope
    return row


@document_of.register
def parameter_document(parameter: Parameter) -> Document:
    """A parameter with its uncertainty."""
    return Document(parameter.name, [Table(_parameters([parameter]))])


@document_of.register
def effect_document(effect: Effect) -> Document:
    """A cause of error with its parameters."""
    words = _values(effect)
    if any(effect.u):
        words += ", ± U (k = 2)"
    if effect.needs:
        words += f"; the cause depends on {', '.join(effect.needs)}"
    rows = _parameters(effect.parameters()).drop(columns="half-width")
    rows["typical"] = [small(term.typical, term.unit) for term in effect.terms]
    name = in_words(effect)
    return Document(name, [Paragraph(words, head=f"{name}:"), Table(rows)])


def _values(effect: Effect) -> str:
    """Described values of a cause ± U; its parameters count as independent."""
    covariance = np.diag(np.square(effect.u))
    return values_in_words(effect, values_with_u(effect, covariance))


@document_of.register
def error_model_document(model: ErrorModel) -> Document:
    """An arm and its causes of error."""
    rows = []
    for effect in model.effects:
        cause = {"cause": in_words(effect, model.arm), "label": effect.label}
        rows.append({**cause, "value ± U (k = 2)": _values(effect)})
    none = "" if rows else "The model has no causes of error other than geometry."
    causes = Table(pd.DataFrame(rows), f"Causes of error ({len(rows)})")
    return Document(model.arm.name, [*arm_document(model.arm).blocks, causes, none])


@document_of.register
def poses_document(poses: Poses) -> Document:
    """Angles and tip positions of the first configurations; of all there may be a million."""
    name, table = poses.model.name, {}
    for j, values in enumerate(poses.q.T):
        kind = poses.model.joints[j + 1].shortname()
        slides = kind.startswith("JointModelP")  # prismatic; planar ones are refused
        head = f"joint {j + 1} [mm]" if slides else f"θ{j + 1} [°]"
        table[head] = values[:POSTURES_LISTED] / (MM if slides else DEG)
    some = Poses(poses.model, poses.q[:POSTURES_LISTED], poses.frame_id)
    table |= {f"{axis} [mm]": some.position[:, k] / MM for k, axis in enumerate("xyz")}
    frame = poses.model.frames[poses.frame_id].name
    words = f"has {count(len(poses.q), 'posture')} of frame {frame}, computed by Pinocchio."
    more = f"… and {len(poses.q) - POSTURES_LISTED} more" if len(poses.q) > POSTURES_LISTED else ""
    return Document(name, [Paragraph(words, head=name), Table(pd.DataFrame(table)), more])


@document_of.register
def sources_document(sources: ErrorSources) -> Document:
    """What errors an accuracy is computed from."""
    words = f"has {count(len(sources.parameters), 'source')} of error at {sources.at}"
    if sources.not_included:
        words += f", without {', '.join(sources.not_included)}"
    name = sources.arm.name
    table = Table(_parameters(sources.parameters), most=MOST_SOURCES)
    return Document(name, [Paragraph(words, head=name), table])
