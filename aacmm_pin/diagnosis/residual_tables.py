"""What the simulation gets wrong, before any cause is thought of: residuals against what their own uncertainty predicts."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.fit import Fit

BINS = 4
"""Ranges into which joints, time and temperature are divided, with as many records in each."""


def residuals_by_group(before: Fit) -> pd.DataFrame:
    """:func:`groups_table` of the arm as it was, against what the stated uncertainties predict: ``S U Sᵀ`` plus noise.

    Scatter that was found beside a stated noise is what the simulation gets wrong, and is not predicted.

    Args:
        before: the arm as it was, set-up fitted.
    """
    model = before.problem.model
    sensitivity = model.arm.sensitivity(before.problem.measurements.q)
    sensitivity = before.solution.point.frame.rotation @ sensitivity
    own = model.covariance()[: sensitivity.shape[2], : sensitivity.shape[2]]
    return groups_table(before, before.stated_noise[:, :3, :3] + sensitivity @ own @ sensitivity.transpose(0, 2, 1))


def groups_table(fit: Fit, covariance: Array) -> pd.DataFrame:
    """Residuals by seat, joint range, time, temperature, session: RMS, and how many times what is predicted.

    Args:
        fit: whose residuals are looked at.
        covariance: predicted for each residual (n, 3, 3) [m²].
    """
    deviation = fit.solution.system.deviation
    squared, expected = np.square(deviation).sum(axis=1), np.trace(covariance, axis1=1, axis2=2)
    rows = []
    for what, label, members in _groups(fit):
        mine = members & fit.used
        if mine.sum() < 2:
            continue
        rows.append(
            {
                "by": what,
                "group": label,
                "records": int(mine.sum()),
                "rms_mm": float(np.sqrt(squared[mine].mean()) / MM),
                "predicted_mm": float(np.sqrt(expected[mine].mean()) / MM),
                "times_predicted": float(np.sqrt(squared[mine].mean() / expected[mine].mean())),
            }
        )
    table = pd.DataFrame(rows, columns=["by", "group", "records", "rms_mm", "predicted_mm", "times_predicted"])
    return table.sort_values("times_predicted", ascending=False, ignore_index=True)


def _groups(fit: Fit) -> list[tuple[str, str, NDArray[np.bool_]]]:
    records = fit.problem.measurements
    found: list[tuple[str, str, NDArray[np.bool_]]] = []
    for name in ("seat", "marker", "session"):
        labels = getattr(records.conditions, name)
        if labels is not None:
            found += [(name, str(label), labels == label) for label in dict.fromkeys(labels) if label]
    numbers: list[tuple[str, Array, float, str]] = [
        (f"joint {j + 1}", records.q[:, j], *((MM, " mm") if slides else (DEG, "°")))
        for j, slides in enumerate(fit.problem.model.arm.chain.prismatic)
    ]
    if records.conditions.time is not None:
        numbers.append(("time", records.conditions.time, 1.0, " s"))
    if records.conditions.temperature is not None:
        numbers.append(("temperature", records.conditions.temperature, 1.0, " °C"))
    for name, values, unit, text in numbers:
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
        for low, high in itertools.pairwise(edges):
            inside = (values >= low) & ((values <= high) if high == edges[-1] else (values < high))
            found.append((name, f"{_range(low / unit, high / unit)}{text}", inside))
    return found


def _range(low: float, high: float) -> str:
    """Ends of a range with the same number of decimals: two digits of its width."""
    decimals = max(0, 1 - int(np.floor(np.log10(high - low))))
    return f"{low:z.{decimals}f} to {high:z.{decimals}f}"
