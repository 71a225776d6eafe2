"""Arms as documents: geometry, limits, noise, causes of error, conditions of records."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Index
from aacmm_pin._support.units import DEG, MM, UM, count
from aacmm_pin.arm import COVERAGE_FACTOR, KINDS, Arm, ArmFile, DHTable, Poses
from aacmm_pin.effects import (
    Effect,
    ErrorModel,
    in_words,
    listed,
    values_in_words,
    values_with_u,
)
from aacmm_pin.report.document import Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import quantity, small, vector

DH_HEADS = dict(zip(KINDS, ("a [mm]", "d [mm]", "α [°]", "θ offset [°]"), strict=True))
"""Heads of the columns of a DH table."""
POSTURES_LISTED = 8
"""Postures, or names, to show."""


@document_of.register
def arm_document(arm: Arm) -> Document:
    """Geometry with its uncertainty, limits and noise."""
    origin = f"{arm.dh.rows} rows of {arm.dh.convention}" if arm.dh else "from a URDF"
    words = [
        f"{count(arm.nq, 'joint')} ({origin})",
        f"the tip at frame {arm.tip}",
        f"gravity {vector(arm.gravity)} m/s²",
    ]
    if arm.stylus_axis is not None:
        words.append(f"the stylus along {vector(arm.stylus_axis)} of the tip's frame")
    words.append(f"lengths that hold at {arm.reference_temperature:g} °C")
    uncertainty = "± precedes half-widths; values without ± are exact."
    if len(arm.without_uncertainty) == len(arm.parameters):
        uncertainty = "The arm file states no uncertainty, so that the accuracy is unknown."
    elif arm.covariance is not None:
        number = len(arm.covariance.parameters)
        uncertainty = (
            f"± precedes half-widths, or U (k = 2) for the {number} parameters of a calibration; "
            "values without ± are exact."
        )
    unexplained = f"The last calibration left an error unexplained ({arm.unexplained})."
    return Document(
        arm.name,
        [
            Paragraph(f"has {listed(words)}.", head=arm.name),
            Paragraph(arm.source, head="Source:" if arm.source else ""),
            Table(_joints_table(arm) if arm.dh is None else _dh_rows(arm, arm.dh)),
            uncertainty,
            unexplained if arm.unexplained else "",
        ],
    )


def _dh_rows(arm: Arm, dh: DHTable) -> pd.DataFrame:
    table = _dh_cells(dh, {p.name: p.half_width for p in arm.parameters})
    _add_limits_and_noise(table, arm, np.flatnonzero(dh.moving), "fixed")
    if isinstance(arm.file, ArmFile) and any(row.mass_kg for row in arm.file.joints):
        table["mass [kg]"] = [row.mass_kg for row in arm.file.joints]
    return table


def _dh_cells(dh: DHTable, half_widths: Mapping[str, float | None]) -> pd.DataFrame:
    """DH rows as text, with half-widths [m, rad] by name, such as ``a2``."""
    table = pd.DataFrame({"row": range(1, dh.rows + 1)})
    for kind, values in zip(KINDS, dh.values().T, strict=True):
        scale = MM if kind in ("a", "d") else DEG
        cells = []
        for row, value in enumerate(values / scale, 1):
            half_width = half_widths.get(f"{kind}{row}")
            plus_minus = f" ± {half_width / scale:.5f}" if half_width else ""
            cells.append(f"{value:z.5f}{plus_minus}")
        table[DH_HEADS[kind]] = cells
    return table


def _joints_table(arm: Arm) -> pd.DataFrame:
    """Joints of an arm without a DH table."""
    # Six for each joint: x, y, z, then rotations.
    half_widths = np.array([p.half_width or 0.0 for p in arm.parameters]).reshape(-1, 6)
    table = pd.DataFrame(
        {
            "joint": range(1, len(arm.joint_names) + 1),
            "name": arm.joint_names,
            "moves": np.where(arm.chain.slides, "along", "about"),
            "axis": [*map(vector, arm.joint_axes)],
        }
    )
    head = _add_limits_and_noise(table, arm, arm.chain.drive.independent, "")
    for mimic in arm.mimics:
        leader = "reading" if mimic.of == mimic.joint else f"joint {mimic.of}"
        table.loc[mimic.joint - 1, head] = f"{mimic.ratio:.5g} × {leader}"
    table.insert(5, "placement ± [mm]", [*map(tuple, half_widths[:, :3] / MM)])
    table.insert(6, "placement ± [µrad]", [*map(tuple, half_widths[:, 3:] / UM)])
    return table


def _add_limits_and_noise(table: pd.DataFrame, arm: Arm, rows: Index, fixed: str) -> str:
    """Add columns for the joints with a reading; return the head of the limits."""
    lengths = ", or mm" if arm.chain.slides.any() else ""
    head = f"limits [°{lengths}]"
    table[head] = fixed
    limits = arm.limits / np.where(arm.chain.prismatic, MM, DEG)[:, None]
    table.loc[rows, head] = [f"{low:z.5g} to {high:z.5g}" for low, high in limits]
    if arm.encoder_noise is not None:
        noise = "encoder u [µrad, or µm]" if lengths else "encoder u [µrad]"
        table.loc[rows, noise] = arm.encoder_noise / UM
    return head


@document_of.register
def dh_document(dh: DHTable) -> Document:
    """The rows of a DH table."""
    table = _dh_cells(dh, {}).assign(joint=dh.moving)
    return Document("DH table", [Table(table, f"DH table, {dh.convention}")])


@document_of.register
def effect_document(effect: Effect) -> Document:
    """A cause of error with its parameters."""
    name, words = in_words(effect), _values(effect)
    if any(effect.u):
        words += ", ± U (k = 2)"
    if effect.needs:
        words += f"; the cause depends on {', '.join(effect.needs)}"
    terms = zip(effect.parameters(), effect.terms, strict=True)
    rows = [
        {
            "parameter": p.name,
            "value": quantity(p.value, p.unit),
            "U (k = 2)": small(COVERAGE_FACTOR * p.u, p.unit),
            "typical": small(term.typical, term.unit),
        }
        for p, term in terms
    ]
    return Document(name, [Paragraph(words, head=f"{name}:"), Table(pd.DataFrame(rows))])


def _values(effect: Effect) -> str:
    """Values of a cause ± U; its parameters count as independent."""
    covariance = np.diag(np.square(effect.u))
    return values_in_words(effect, values_with_u(effect, covariance))


@document_of.register
def error_model_document(model: ErrorModel) -> Document:
    """An arm and its causes of error."""
    rows = [
        {
            "cause": in_words(effect, model.arm),
            "label": effect.label,
            "value ± U (k = 2)": _values(effect),
        }
        for effect in model.effects
    ]
    none = "" if rows else "The model has no causes of error other than geometry."
    causes = Table(pd.DataFrame(rows), f"Causes of error ({len(rows)})")
    return Document(model.arm.name, [*arm_document(model.arm).blocks, causes, none])


@document_of.register
def poses_document(poses: Poses) -> Document:
    """Angles and tip positions of the first postures."""
    model, number = poses.model, len(poses.q)
    first_poses = Poses(model, poses.q[:POSTURES_LISTED], poses.frame_id)
    table = {}
    for j, values in enumerate(first_poses.q.T, 1):
        if model.joints[j].shortname().startswith("JointModelP"):  # prismatic; planar are refused
            table[f"joint {j} [mm]"] = values / MM
        else:
            table[f"θ{j} [°]"] = values / DEG
    table |= {f"{axis} [mm]": first_poses.position[:, k] / MM for k, axis in enumerate("xyz")}
    frame = model.frames[poses.frame_id].name
    words = f"has {count(number, 'posture')} of frame {frame}, computed by Pinocchio."
    not_listed = f"… and {number - POSTURES_LISTED} more" if number > POSTURES_LISTED else ""
    return Document(
        model.name, [Paragraph(words, head=model.name), Table(pd.DataFrame(table)), not_listed]
    )
