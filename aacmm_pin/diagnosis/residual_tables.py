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


def residuals_by_group(before: Fit, recalibrated: Fit, extended: Fit) -> pd.DataFrame:
    """RMS of the records by seat, joint range, time, temperature, …, by the three models, beside what is predicted.

    Predicted for the arm as it was: by its stated uncertainties, the noise and, where its targets are as stated, what the
    records of a seat share, ``S Σ Sᵀ + N + u²`` (JCGM 100:2008, eq. 13); for the others, whose targets are fitted, the
    noise ``N`` alone. Scatter that was found beside a stated noise is what this asks about, and is not predicted.

    Args:
        before: the arm as it was, set-up fitted.
        recalibrated, extended: its geometry fitted too; with the causes found.

    Returns:
        by, group, records, simulation_mm, predicted_mm, times_predicted, recalibrated_mm, extended_mm, noise_mm,
        times_noise (extended), the largest times_predicted first; groups of fewer than two records are left out.
    """
    model, records, point = before.problem.model, before.problem.measurements, before.solution.point
    turned = point.frame.rotation @ model.sensitivity(records.q, records.conditions)
    noise = np.trace(extended.stated_noise[:, :3, :3], axis1=1, axis2=2)
    predicted = noise + np.sum(turned @ model.covariance() * turned, axis=(1, 2))
    if not before.problem.scales.size:  # nothing is fitted, not even targets
        touched = before.observations.seat >= 0
        shared = before.observations.stated_u[before.observations.seat[touched]]
        predicted[touched] += np.square(np.nan_to_num(shared)).sum(axis=1)
    simulated, *fitted = (np.square(fit.solution.system.deviation).sum(axis=1) for fit in (before, recalibrated, extended))
    names = ["simulation_mm", "predicted_mm", "recalibrated_mm", "extended_mm", "noise_mm"]
    rows = []
    for what, label, members in _groups(before):
        mine = members & before.used
        if mine.sum() > 1:
            means = [np.sqrt(each[mine].mean()) / MM for each in (simulated, predicted, *fitted, noise)]
            rows.append([what, label, int(mine.sum()), *means])
    table = pd.DataFrame(rows, columns=["by", "group", "records", *names])
    table.insert(5, "times_predicted", table["simulation_mm"] / table["predicted_mm"])
    table["times_noise"] = table["extended_mm"] / table["noise_mm"]
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
