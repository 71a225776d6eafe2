"""What the simulation gets wrong, before any cause is thought of: residuals against what their own uncertainty predicts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.effects import Effect

BINS = 4
MOVED = 0.01
"""Family-wise level at which a geometric value counts as beyond its stated uncertainty."""
LEAST_SHARE = 0.5
"""A value is judged only if the data could move it by this part of its stated uncertainty."""


def predicted_covariance(before: Fit, sensitivity: Array, covariance: Array) -> Array:
    """What the stated uncertainties say of each residual: ``S U Sᵀ`` plus noise, (n, 3, 3) [m²].

    Scatter that was found beside a stated noise is what the simulation gets wrong, and is not in it.
    """
    return np.asarray(before.stated_noise + sensitivity @ covariance @ sensitivity.transpose(0, 2, 1))


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


def moved_geometry(choice: Choice) -> pd.DataFrame:
    """Geometric values that the data move farther than their stated uncertainty allows.

    If the stated values are right to within their u₀, the change to an estimate with u has variance u₀² - u². The estimate
    is the one with everything in it that was admitted, covariates included: what they do is not geometry's.

    Returns:
        parameter, cause, joint, unit (SI), before, change, u, stated_u [unit], times (change over its standard deviation),
        p_value (two-sided, times the number of values that are judged); those that count, strongest first.
    """
    problem = choice.fit.problem
    left = choice.left
    own = choice.design.nuisances
    taken_out = choice.design.taken_out
    stays = problem.vector.slices[-taken_out].start if taken_out else problem.vector.size
    scales = choice.design.scales[:own]
    x = dict(zip(choice.design.kept.tolist(), scales * left.projection.solution()[:own], strict=True))
    u = dict(zip(choice.design.kept.tolist(), scales * np.sqrt(np.diag(left.covariance)[:own]), strict=True))
    rows = [
        {
            "parameter": name,
            "cause": effect.cause,
            "joint": effect.row,
            "unit": effect.terms[0].unit,
            "before": before,
            "change": float(choice.fit.solution.point.x[i] + x[i] - problem.start[i]),
            "u": float(u[i]),
            "stated_u": float(problem.widths[i]),
        }
        for i, effect, name, before in _judged(problem)
        if i < stays and i in u and u[i] < np.sqrt(1.0 - LEAST_SHARE**2) * problem.widths[i]
    ]
    table = pd.DataFrame(rows, columns=["parameter", "cause", "joint", "unit", "before", "change", "u", "stated_u"])
    change, u_, stated = (table[name].to_numpy(dtype=np.float64) for name in ("change", "u", "stated_u"))
    table["times"] = change / np.sqrt(stated**2 - u_**2)
    table["p_value"] = np.minimum(chi2_sf(np.square(change) / (stated**2 - u_**2), 1) * max(len(table), 1), 1.0)
    table = table[table["p_value"] < MOVED]
    return table.sort_values("p_value", ignore_index=True)


def _judged(problem: Problem) -> Iterator[tuple[int, Effect, str, float]]:
    """Number, cause, name and value before of each geometric value whose uncertainty is stated."""
    vector = problem.vector
    for effect, own in vector:
        for i in range(own.start, own.stop):
            if problem.stated[i] and vector.of_arm[i] is not None:
                yield i, effect, vector.names[i], float(vector.origins[i])
