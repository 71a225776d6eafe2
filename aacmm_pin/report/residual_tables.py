"""Residuals by model, and of groups of records; shapes of unexplained structure."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration import Calibration, Fit
from aacmm_pin.diagnosis import Choice, Diagnosis
from aacmm_pin.errors import UnknownNameError

OF_RECORD = "_of_record"
"""End of the columns of a shape with the values by each record."""
RANGES_OF_A_NUMBER = 4
"""Ranges of joints, time and temperature, with equal numbers of records."""


def models(result: Calibration | Diagnosis) -> dict[str, Fit]:
    """The fits by the names of their models; the last determines the used records."""
    if isinstance(result, Calibration):
        return {"before": result.before, "after": result.fit}
    return {
        "nominal": result.before,
        "recalibrated": result.recalibrated,
        "extended": result.extended,
    }


def model_named(result: Calibration | Diagnosis, name: str) -> Fit:
    """One of :func:`models`.

    Raises:
        UnknownNameError: no such model.
    """
    if name not in models(result):
        raise UnknownNameError("model", name, list(models(result)))
    return models(result)[name]


def residuals_by_group(before: Fit, recalibrated: Fit, extended: Fit) -> pd.DataFrame:
    """RMS of groups of records (seat, joint range, time, temperature, …) by the three models,
    predicted too.

    The prediction for the nominal arm is ``S Σ Sᵀ + N + u²``, with stated uncertainties, noise, and
    u of the stated targets that a seat shares (JCGM 100:2008, eq. 13); for the other models, whose
    targets are fitted, the noise ``N``, without scatter beyond stated noise.

    Args:
        before: the nominal arm with fitted set-up.
        recalibrated, extended: with fitted geometry; with the causes.

    Returns:
        by, group, records, nominal_mm, predicted_mm, times_predicted, recalibrated_mm, extended_mm,
        noise_mm, times_noise (extended), the largest times_predicted first, but with the joints
        first in the index; groups of at least two records.
    """
    noise = np.trace(extended.stated_noise[:, :3, :3], axis1=1, axis2=2)
    squares = {
        "nominal_mm": np.square(before.system.deviation).sum(axis=1),
        "predicted_mm": noise + before.stated_variance,
        "recalibrated_mm": np.square(recalibrated.system.deviation).sum(axis=1),
        "extended_mm": np.square(extended.system.deviation).sum(axis=1),
        "noise_mm": noise,
    }
    rows = []
    for by, group, members in _groups(before):
        used_members = members & before.used
        if used_members.sum() > 1:
            sizes = [np.sqrt(square[used_members].mean()) / MM for square in squares.values()]
            rows.append([by, group, int(used_members.sum()), *sizes])
    table = pd.DataFrame(rows, columns=["by", "group", "records", *squares])
    table.insert(5, "times_predicted", table["nominal_mm"] / table["predicted_mm"])
    table["times_noise"] = table["extended_mm"] / table["noise_mm"]
    return table.sort_values("times_predicted", ascending=False)


def _groups(fit: Fit) -> Iterator[tuple[str, str, Mask]]:
    """Kind of group (``joint 3``), name of the group, and its records (n,)."""
    records = fit.problem.measurements
    conditions = records.conditions
    for j, slides in enumerate(fit.problem.model.arm.chain.prismatic):
        unit, scale = (" mm", MM) if slides else ("°", DEG)
        yield from _ranges(f"joint {j + 1}", records.q[:, j] / scale, unit)
    for name, unit in (("time", " s"), ("temperature", " °C")):
        values = getattr(conditions, name)
        if values is not None:
            yield from _ranges(name, values, unit)
    for name in ("seat", "marker", "session"):
        labels = conditions.labels(name)
        for label in dict.fromkeys(labels):
            if label:
                yield name, str(label), labels == label


def _ranges(name: str, values: Array, unit: str) -> Iterator[tuple[str, str, Mask]]:
    """Ranges with equal numbers of records; their ends have two digits of the width."""
    quantiles = np.linspace(0, 1, RANGES_OF_A_NUMBER + 1)
    edges = np.unique(np.quantile(values, quantiles))
    for low, high in itertools.pairwise(edges):
        before_end = values <= high if high == edges[-1] else values < high
        decimals = max(0, 1 - int(np.floor(np.log10(high - low))))
        group = f"{low:z.{decimals}f} to {high:z.{decimals}f}{unit}"
        yield name, group, (values >= low) & before_end


def shapes_of(choice: Choice) -> dict[str, pd.DataFrame]:
    """See :attr:`aacmm_pin.diagnosis.unexplained.Unexplained.shapes`."""
    return {choice.covariate(k).name: _shape(choice, k) for k in choice.covariates}


def _shape(choice: Choice, block: int) -> pd.DataFrame:
    """Smooth correction over the covariate of a block, and that by each record."""
    design, covariate = choice.design, choice.covariate(block)
    model = choice.posterior.median_model
    functions, quantities = choice.way(block).functions, choice.way(block).quantities
    records = np.arange(len(functions))
    scales = design.scales[design.blocks[block].columns]
    # Each function has one coefficient for each quantity.
    coefficients = (model.estimate[model.entries[block]] * scales).reshape(-1, len(quantities))
    correction = functions @ coefficients
    # Displacement of the tip by one unit of each quantity (n, 3, quantities): a column is a
    # function times this displacement, so divide by the strongest function.
    strongest = np.argmax(np.abs(functions), axis=1)
    columns = (design.columns(block)[:, :3] / scales).reshape(
        len(functions), 3, -1, len(quantities)
    )
    displacement = columns[records, :, strongest] / functions[records, strongest][:, None, None]
    deviation = choice.deviations[:, :3]
    # Amount of each quantity that the deviation of a record contains (n, quantities).
    contained = np.einsum("nij,ni->nj", displacement, deviation) / np.square(displacement).sum(
        axis=1
    )
    table = covariate.values.copy()
    for k, (name, unit) in enumerate(quantities.items()):
        table[name] = correction[:, k] / unit
        table[name + OF_RECORD] = (correction - contained)[:, k] / unit
    return table[choice.fit.used].sort_values(list(covariate.values.columns), ignore_index=True)
