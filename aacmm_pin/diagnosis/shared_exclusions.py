"""What excluded records have in common: gross errors are scattered, and what comes all at once is no gross error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.special import gammaln

from aacmm_pin._support.checks import Array
from aacmm_pin.diagnosis.covariates import Covariate
from aacmm_pin.measurements.records import Measurements

TOGETHER = 1e-3
"""Chance, over all stretches of time, below which excluded records that follow one another are no gross errors."""
FEWEST_TOGETHER = 3
"""Fewer of them than this may be one mishap."""
FEWEST = 5
"""Fewer excluded records than this share many things by chance."""
SURELY = 1e-6
"""Chance, over all that is known of the records, below which what the excluded ones share is no chance."""
PARTS = 20
"""Parts of the range of a number that are looked at."""
WAVES = 20
"""Terms of the series of Kuiper's statistic."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Shared:
    """What excluded records share.

    Attributes:
        name: of the covariate.
        p_value: chance of as much where gross errors are scattered, over all covariates.
        where: its values there, in words.
        excluded, records: how many are excluded there, and how many there are.
        of: how many are excluded in all.
    """

    name: str
    p_value: float
    where: str
    excluded: int
    records: int
    of: int

    def __str__(self) -> str:
        return (
            f"{self.excluded} of the {self.of} excluded records have {self.where}, as {self.records} have in all: gross "
            "errors are scattered, and these are something else, which the model lacks"
        )


def shared_by(excluded: Mask, used: Mask, others: Sequence[Covariate], measurements: Measurements) -> Shared | None:
    """What the ``excluded`` records (n,) share that the ``used`` ones (n,) do not, by the smallest chance; None if nothing.

    The stretch of time first, see :func:`together`. Then numbers by Kuiper's statistic (Kuiper 1960), labels by the binomial
    chance of so many excluded ones with one of them; Bonferroni's bound over all that were looked at.
    """
    stretch, chance = together(excluded, used, measurements)
    if stretch.any():
        time = measurements.conditions.time
        values = (measurements.row if time is None else time)[stretch]
        words = f"{'rows' if time is None else 'time_s from'} {values.min():.6g} to {values.max():.6g}"
        there = int((stretch & excluded).sum()), int((stretch & (excluded | used)).sum())
        return Shared("record" if time is None else "time", chance, words, *there, int(excluded.sum()))
    if excluded.sum() < FEWEST:
        return None
    columns = [*_columns(others, measurements), *_nearness(others, excluded)]
    found = [_of_values(name, values, excluded, used) for name, values in columns]
    each = [shared for shared in found if shared is not None]
    best = min(each, key=lambda shared: shared.p_value, default=None)
    if best is None or best.p_value * len(each) >= SURELY:
        return None
    return replace(best, p_value=best.p_value * len(each))


def together(excluded: Mask, used: Mask, measurements: Measurements) -> tuple[Mask, float]:
    """The stretch of time, else of the file, in which the ``excluded`` records (n,) are, and few of the ``used`` ones: its
    records (n,), and the chance of any such; no records where that is not less than :data:`TOGETHER`.

    Where k of N are drawn at random, m of them are among w that follow one another with a chance of no more than
    ``C(w, m) C(N - m, k - m) / C(N, k)``; Bonferroni's bound over all stretches, half of it for those that begin or end with
    the file.
    """
    time = measurements.conditions.time
    order = np.argsort(np.arange(measurements.n) if time is None else time, kind="stable")
    order = order[(excluded | used)[order]]
    places, count, k = np.flatnonzero(excluded[order]), order.size, int(excluded.sum())
    nothing = np.zeros(excluded.size, dtype=bool)
    if k < FEWEST_TOGETHER:
        return nothing, 1.0
    first, last = np.triu_indices(k, FEWEST_TOGETHER - 1)
    number = np.arange(FEWEST_TOGETHER, k + 1)
    of_file = np.concatenate([0 * number, places[k - number]]), np.concatenate([places[number - 1], 0 * number + count - 1])
    low, high = (np.concatenate(ends) for ends in ((places[first], of_file[0]), (places[last], of_file[1])))
    m, w = np.concatenate([last - first + 1, number, number]), high - low + 1
    tried = np.where(np.arange(m.size) < first.size, count * (count + 1.0), 4.0 * count)
    chances = np.log(tried) + _log_binomial(w, m) + _log_binomial(count - m, k - m) - _log_binomial(count, k)
    best = int(np.argmin(chances))
    if chances[best] >= np.log(TOGETHER):
        return nothing, 1.0
    nothing[order[low[best] : high[best] + 1]] = True
    return nothing, float(np.exp(chances[best]))


def _log_binomial(n: Array | int, k: Array | int) -> Array:
    """``log C(n, k)``."""
    return np.asarray(gammaln(np.add(n, 1)) - gammaln(np.add(k, 1)) - gammaln(np.subtract(n, k) + 1))


def _columns(others: Sequence[Covariate], measurements: Measurements) -> Iterator[tuple[str, pd.Series]]:
    """Every single covariate, by its name, the targets and the seats."""
    for covariate in others:
        if len(covariate.values.columns) == len(covariate.depends_on) and " × " not in covariate.name:
            yield from zip(covariate.depends_on, (covariate.values[column] for column in covariate.values), strict=True)
    for name in ("marker", "seat"):
        if (labels := getattr(measurements.conditions, name)) is not None:
            yield name, pd.Series(labels, name=name)


def _nearness(others: Sequence[Covariate], excluded: Mask) -> Iterator[tuple[str, pd.Series]]:
    """How far each tip is from the middle of those of the excluded records: they may fill a region of the room."""
    for covariate in others:
        if covariate.name == "place":
            off = covariate.values - covariate.values[excluded].median()
            yield "place", np.sqrt(np.square(off).sum(axis=1)).rename("distance_mm from their middle")


def _of_values(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared | None:
    if pd.api.types.is_numeric_dtype(values):
        return _of_numbers(name, values, excluded, used)
    labels, count = values.astype(str).to_numpy(), int(excluded.sum())
    best = None
    for label in np.unique(labels[excluded]):
        mine = labels == label
        there, part = int((mine & excluded).sum()), (mine & (excluded | used)).sum() / (excluded | used).sum()
        chance = float(scipy.special.bdtrc(there - 1, count, part)) if part < 1.0 else 1.0
        if best is None or chance < best.p_value:
            best = Shared(name, chance, f"{values.name} {label}", there, int((mine & (excluded | used)).sum()), count)
    return best


def _of_numbers(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared | None:
    """The range in which most of the excluded ones are, and fewest of the others.

    In parts of the range, and not far beyond that of the used ones: wrong readings, and their tips, are elsewhere anyway.
    """
    numbers = values.to_numpy(dtype=np.float64)
    low, high = numbers[used].min(), numbers[used].max()
    near = numbers[(excluded | used) & (np.abs(numbers - (low + high) / 2) <= high - low)]
    edges = np.linspace(near.min(), near.max(), PARTS + 1)
    like = (numbers >= edges[0]) & (numbers <= edges[-1])
    counts = [np.histogram(numbers[some & like], edges)[0] for some in (excluded, used)]
    if counts[0].sum() < FEWEST or edges[0] == edges[-1]:
        return None
    ahead = np.cumsum([0.0, *(counts[0] / counts[0].sum() - counts[1] / counts[1].sum())])
    first, last = sorted((int(ahead.argmin()), int(ahead.argmax())))
    size = np.sqrt(1.0 / (1.0 / counts[0].sum() + 1.0 / counts[1].sum()))
    chance = _kuiper(float((size + 0.155 + 0.24 / size) * np.ptp(ahead)))
    inside = (numbers >= edges[first]) & (numbers < edges[last])
    outside = bool(ahead.argmin() > ahead.argmax())  # the excluded ones are on both sides of the range
    words = f"{values.name} {'not ' * outside}from {edges[first]:.4g} to {edges[last]:.4g}"
    there = like & (inside != outside)
    mine = int((there & excluded).sum())
    return Shared(name, chance, words, mine, int((there & (excluded | used)).sum()), int(excluded.sum()))


def _kuiper(size: float) -> float:
    """Chance of a larger statistic (Kuiper 1960; Press et al., Numerical Recipes, 14.3)."""
    if size < 0.4:
        return 1.0
    squares: Array = np.square(size * np.arange(1, WAVES))
    return float(min(1.0, 2.0 * ((4.0 * squares - 1.0) * np.exp(-2.0 * squares)).sum()))
