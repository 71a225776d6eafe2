"""Arms as documents: geometry, limits, noise, causes of error."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.units import DEG, MM, UM, count
from aacmm_pin.arm import KINDS, Arm
from aacmm_pin.effects import (
    Effect,
    ErrorModel,
    in_words,
    listed,
    values_in_words,
    values_with_u,
)
from aacmm_pin.report.document import NO_NUMBER, Bullets, Document, Paragraph, Table, document_of
from aacmm_pin.report.numbers import vector

DH_HEADS = dict(zip(KINDS, ("a [mm]", "d [mm]", "α [°]", "θ offset [°]"), strict=True))
"""Heads of the columns of a DH table."""


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
    uncertainty = (
        "± precedes half-widths, or U (k = 2) of calibrated parameters; values without ± are "
        "exact. arm.parameters states the uncertainties of all parameters."
    )
    if len(arm.without_uncertainty) == len(arm.parameters):
        uncertainty = "The arm file states no uncertainty, so that the accuracy is unknown."
    unexplained = f"The last calibration left an error unexplained ({arm.unexplained})."
    return Document(
        arm.name,
        [
            Paragraph(f"has {listed(words)}.", head=arm.name),
            Paragraph(arm.source, head="Source:" if arm.source else ""),
            Table(_joints_table(arm)),
            uncertainty,
            unexplained if arm.unexplained else "",
        ],
    )


def _joints_table(arm: Arm) -> pd.DataFrame:
    """DH rows, or joints of a URDF, with the limits and noise of those that have a reading."""
    if arm.dh is None:
        table = pd.DataFrame({"joint": arm.joint_names, "axis": [*map(vector, arm.joint_axes)]})
        rows = arm.chain.drive.independent
    else:
        table = pd.DataFrame({"row": range(1, arm.dh.rows + 1)})
        half_widths = {p.name: p.half_width for p in arm.parameters}
        for kind, values in zip(KINDS, arm.dh.values().T, strict=True):
            scale = MM if kind in ("a", "d") else DEG
            cells = []
            for row, value in enumerate(values / scale, 1):
                half_width = half_widths.get(f"{kind}{row}")
                plus_minus = f" ± {half_width / scale:.5f}" if half_width else ""
                cells.append(f"{value:z.5f}{plus_minus}")
            table[DH_HEADS[kind]] = cells
        rows = np.flatnonzero(arm.dh.moving)
    table["limits"] = NO_NUMBER
    table.loc[rows, "limits"] = [
        f"{low / MM:z.5g} to {high / MM:z.5g} mm"
        if slides
        else f"{low / DEG:z.5g} to {high / DEG:z.5g}°"
        for (low, high), slides in zip(arm.limits, arm.chain.prismatic, strict=True)
    ]
    if arm.encoder_noise is not None:
        table.loc[rows, "encoder u"] = [
            f"{u / UM:.4g} {'µm' if slides else 'µrad'}"
            for u, slides in zip(arm.encoder_noise, arm.chain.prismatic, strict=True)
        ]
    return table


@document_of.register
def effect_document(effect: Effect) -> Document:
    """A cause of error with its values."""
    name = in_words(effect)
    return Document(name, [Paragraph(_values(effect), head=f"{name}:")])


def _values(effect: Effect) -> str:
    """Values of a cause ± U; its parameters count as independent."""
    covariance = np.diag(np.square(effect.u))
    values = values_in_words(effect, values_with_u(effect, covariance))
    return f"{values} (U, k = 2)" if any(effect.u) else values


@document_of.register
def error_model_document(model: ErrorModel) -> Document:
    """An arm and its causes of error."""
    causes = [f"{in_words(effect, model.arm)}: {_values(effect)}" for effect in model.effects]
    none = "" if causes else "The model has no causes of error other than geometry."
    return Document(
        model.arm.name,
        [*arm_document(model.arm).blocks, Bullets(causes, "Causes of error:"), none],
    )
