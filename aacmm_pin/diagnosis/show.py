"""What the simulation gets wrong, before any cause is thought of: residuals against what their own uncertainty predicts."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import chi2

from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.fold import origins
from aacmm_pin.calibration.problem import geometric_parameters
from aacmm_pin.checks import Array
from aacmm_pin.units import DEG, MM

BINS = 4
MOVED = 0.01
"""Family-wise level at which a geometric value counts as beyond its stated uncertainty."""


def predicted_covariance(before: Fit, sensitivity: Array, covariance: Array) -> Array:
    """What the stated uncertainties say of each residual: ``S U Sᵀ`` plus noise, (n, 3, 3) [m²]."""
    total = before.noise + sensitivity @ covariance @ sensitivity.transpose(0, 2, 1)
    for observation in before.observations:
        total[observation.records] += observation.covariance()
    return np.asarray(total)


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
    numbers: list[tuple[str, Array, float, str]] = [(f"joint {j + 1}", records.q[:, j], DEG, "°") for j in range(records.nq)]
    if records.conditions.time is not None:
        numbers.append(("time", records.conditions.time, 1.0, " s"))
    if records.conditions.temperature is not None:
        numbers.append(("temperature", records.conditions.temperature, 1.0, " °C"))
    for name, values, unit, text in numbers:
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
        for low, high in itertools.pairwise(edges):
            inside = (values >= low) & ((values <= high) if high == edges[-1] else (values < high))
            found.append((name, f"{low / unit:.4g} to {high / unit:.4g}{text}", inside))
    return found


def moved_geometry(fit: Fit) -> pd.DataFrame:
    """Geometric values that the data move farther than their stated uncertainty allows.

    If the stated values are right to within their u₀, the change to an estimate with u has variance u₀² - u².

    Returns:
        parameter, cause, joint, before, change, u, stated_u [SI], times (change over its standard deviation), p_value
        (two-sided, times the number of values that are judged); those that count, strongest first.
    """
    problem, x = fit.problem, fit.solution.point.x
    u = np.sqrt(np.diag(fit.covariance))
    before = origins(problem)
    rows, first, judged = [], 0, 0
    for effect in problem.estimated:
        geometric = geometric_parameters(problem.model.arm, effect)
        for k in range(len(effect.terms)):
            i = first + k
            variance = problem.widths[i] ** 2 - u[i] ** 2
            if geometric and problem.stated[i] and variance > (0.1 * problem.widths[i]) ** 2:
                judged += 1
                change = float(x[i] - problem.start[i])
                times = change / np.sqrt(variance)
                rows.append(
                    {
                        "parameter": problem.parameters[i].name,
                        "cause": effect.cause,
                        "joint": effect.row,
                        "before": float(before[i]),
                        "change": change,
                        "u": float(u[i]),
                        "stated_u": float(problem.widths[i]),
                        "times": float(times),
                        "p_value": float(chi2.sf(times**2, 1)),
                    }
                )
        first += len(effect.terms)
    table = pd.DataFrame(
        rows, columns=["parameter", "cause", "joint", "before", "change", "u", "stated_u", "times", "p_value"]
    )
    table["p_value"] = np.minimum(table["p_value"] * max(judged, 1), 1.0)
    table = table[table["p_value"] < MOVED]
    return table.sort_values("p_value", ignore_index=True)
