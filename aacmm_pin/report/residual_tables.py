"""What the simulation gets wrong, before any cause is thought of: residuals against what their own
uncertainty predicts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration import Fit
from aacmm_pin.effects import Labels

RANGES_OF_A_NUMBER = 4
"""Ranges into which joints, time and temperature are divided, with as many records in each."""


class Unit(NamedTuple):
    """A unit as it stands behind a number, and how many SI units one of it is."""

    text: str
    si: float


def residuals_by_group(before: Fit, recalibrated: Fit, extended: Fit) -> pd.DataFrame:
    """RMS of the records by seat, joint range, time, temperature, …, by the three models, beside
    what is predicted.

    Predicted for the arm as it was: by its stated uncertainties, the noise and, where its targets
    are as stated, what the records of a seat share, ``S Σ Sᵀ + N + u²`` (JCGM 100:2008, eq. 13);
    for the others, whose targets are fitted, the noise ``N`` alone. Scatter that was found beside a
    stated noise is what this asks about, and is not predicted.

    Args:
        before: the arm as it was, set-up fitted.
        recalibrated, extended: its geometry fitted too; with the causes found.

    Returns:
        by, group, records, simulation_mm, predicted_mm, times_predicted, recalibrated_mm,
        extended_mm, noise_mm, times_noise (extended), the largest times_predicted first; groups of
        fewer than two records are left out.
    """
    noise = np.trace(extended.stated_noise[:, :3, :3], axis1=1, axis2=2)
    squares = {
        "simulation": _square_distances(before),
        "predicted": noise + before.stated_variance,
        "recalibrated": _square_distances(recalibrated),
        "extended": _square_distances(extended),
        "noise": noise,
    }
    rows = []
    for by, group, members in _groups(before):
        mine = members & before.used
        if mine.sum() > 1:
            sizes = [np.sqrt(each[mine].mean()) / MM for each in squares.values()]
            rows.append([by, group, int(mine.sum()), *sizes])
    names = [f"{name}_mm" for name in squares]
    table = pd.DataFrame(rows, columns=["by", "group", "records", *names])
    table.insert(5, "times_predicted", table["simulation_mm"] / table["predicted_mm"])
    table["times_noise"] = table["extended_mm"] / table["noise_mm"]
    return table.sort_values("times_predicted", ascending=False, ignore_index=True)


def _square_distances(fit: Fit) -> Array:
    """Squared distance of tip and target of each record (n,) [m²]."""
    squares = np.square(fit.system.deviation)
    return np.asarray(squares.sum(axis=1))


def _groups(fit: Fit) -> Iterator[tuple[str, str, Mask]]:
    """By what the records are grouped, the group, and its members (n,)."""
    conditions = fit.problem.measurements.conditions
    for name in ("seat", "marker", "session"):
        labels = getattr(conditions, name)
        yield from [] if labels is None else _groups_of_labels(name, labels)
    for name, values, unit in _numbers(fit):
        yield from _ranges(name, values, unit)


def _groups_of_labels(name: str, labels: Labels) -> Iterator[tuple[str, str, Mask]]:
    """One group for each label."""
    for label in filter(None, dict.fromkeys(labels)):
        yield name, str(label), labels == label


def _numbers(fit: Fit) -> Iterator[tuple[str, Array, Unit]]:
    """Joints, time and temperature: name, values (n,), unit."""
    records = fit.problem.measurements
    for j, slides in enumerate(fit.problem.model.arm.chain.prismatic):
        yield f"joint {j + 1}", records.q[:, j], Unit(" mm", MM) if slides else Unit("°", DEG)
    for name, unit in (("time", Unit(" s", 1.0)), ("temperature", Unit(" °C", 1.0))):
        values = getattr(records.conditions, name)
        if values is not None:
            yield name, values, unit


def _ranges(name: str, values: Array, unit: Unit) -> Iterator[tuple[str, str, Mask]]:
    """Ranges of a number with as many records in each."""
    quantiles = np.linspace(0, 1, RANGES_OF_A_NUMBER + 1)
    edges = np.unique(np.quantile(values, quantiles))
    for low, high in itertools.pairwise(edges):
        below = values <= high if high == edges[-1] else values < high
        group = _range(low / unit.si, high / unit.si)
        yield name, f"{group}{unit.text}", (values >= low) & below


def _range(low: float, high: float) -> str:
    """Ends of a range with the same number of decimals: two digits of its width."""
    digits = int(np.floor(np.log10(high - low)))
    decimals = max(0, 1 - digits)
    return f"{low:z.{decimals}f} to {high:z.{decimals}f}"
