"""Excluded records that are no gross errors: too many, sharing something, or all that moved some joint."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.special import gammaln

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.fit import FEWEST_TOGETHER, Fit
from aacmm_pin.effects.encoder import LEAST_SPREAD
from aacmm_pin.measurements.records import Measurements

TOGETHER = 1e-3
"""Chance, over all stretches of time, below which excluded records that follow one another are no gross errors."""
FEWEST = 5
"""Fewer excluded records than this share many things by chance."""
SURELY = 1e-6
"""Chance, over all that is known of the records, below which what the excluded ones share is no chance."""
PARTS = 20
"""Parts of the range of a number that are looked at."""
WAVES = 20
"""Terms of the series of Kuiper's statistic."""
MOST_LABELS = 12
"""Numbers with more different values than this are a scale, others are labels."""
NARROW = 0.5
"""Used records that move a joint over less than this part of its range in all records are about another part of the arm."""

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
        others = self.records - self.excluded
        return (
            f"{self.excluded} of the {self.of} excluded records have {self.where}, and {others} of those used: gross "
            "errors are scattered, and these have a common cause, which the model lacks"
        )


@dataclass(frozen=True)
class Narrowed:
    """A joint that the excluded records alone moved over most of its range.

    Attributes:
        joint: its row, from 1.
        used, seen: range over which the used records move it, and all of them [rad; m where it slides].
        slides: whether it is prismatic.
    """

    joint: int
    used: float
    seen: float
    slides: bool

    def __str__(self) -> str:
        size, unit = (MM, " mm") if self.slides else (DEG, "°")
        return (
            f"the used records move joint {self.joint} over {self.used / size:.3g}{unit}, and all over "
            f"{self.seen / size:.3g}{unit}: nothing is known of the rest"
        )


@dataclass(frozen=True)
class Exclusions:
    """What makes excluded records no gross errors of single records.

    Attributes:
        excluded, used: how many were excluded, and how many count.
        too_many: whether that is more than gross errors are, see :attr:`aacmm_pin.calibration.fit.Fit.thinned`.
        shared: what they share, or None.
        narrowed: joints that they alone moved over most of the range.
    """

    excluded: int
    used: int
    too_many: bool
    shared: Shared | None
    narrowed: tuple[Narrowed, ...]

    @property
    def doubtful(self) -> bool:
        """Whether they are something else than gross errors."""
        return self.too_many or self.shared is not None or bool(self.narrowed)

    @property
    def notes(self) -> list[str]:
        """What they share and which joints they narrowed, in sentences."""
        return [str(each) for each in (self.shared, *self.narrowed) if each is not None]

    def summary(self) -> dict[str, Any]:
        """As plain values, for JSON; SI."""
        return {
            "doubtful": self.doubtful,
            "too_many": self.too_many,
            "shared": None if self.shared is None else asdict(self.shared),
            "narrowed": [asdict(joint) for joint in self.narrowed],
        }


def exclusions_of(found: Fit) -> Exclusions:
    """Whether what a fit excluded are gross errors."""
    counts = int(found.excluded.sum()), int(found.used.sum())
    return Exclusions(*counts, found.thinned, shared_by(found), tuple(_narrowed(found)))


def _narrowed(found: Fit) -> Iterator[Narrowed]:
    """Joints that the used records move over a part below :data:`NARROW` of the range which all records give them.

    Three excluded records at least reach beyond the used range, for one or two may be wrong readings.
    """
    if not (found.excluded.any() and found.used.any()):
        return
    chain, q = found.problem.model.arm.chain, found.problem.measurements.q
    for j, row in enumerate(chain.moving_rows()):
        low, high = q[found.used, j].min(), q[found.used, j].max()
        values = q[found.excluded, j]
        beyond = np.maximum(low - values, values - high)
        if (beyond > 0.0).sum() < FEWEST_TOGETHER:
            continue
        values = values[beyond <= np.sort(beyond)[-FEWEST_TOGETHER]]  # a reading or two may be wrong by any angle
        seen = max(high, values.max()) - min(low, values.min())
        if high - low < NARROW * seen:
            yield Narrowed(row, float(high - low), float(seen), bool(chain.prismatic[j]))


def shared_by(found: Fit) -> Shared | None:
    """What the excluded records of a fit share that the used ones do not, by the smallest chance; None if nothing.

    The stretch of time first, see :func:`together`. Then numbers by Kuiper's statistic (Kuiper 1960), labels by the binomial
    chance of so many excluded ones with one of them; Bonferroni's bound over all that were looked at.
    """
    excluded, used, measurements = found.excluded, found.used, found.problem.measurements
    stretch, chance = together(excluded, used, measurements)
    if stretch.any():
        time = measurements.conditions.time
        values = (measurements.row if time is None else time)[stretch]
        words = f"{'rows' if time is None else 'time_s from'} {values.min():.6g} to {values.max():.6g}"
        there = int((stretch & excluded).sum()), int((stretch & (excluded | used)).sum())
        return Shared("record" if time is None else "time", chance, words, *there, int(excluded.sum()))
    if excluded.sum() < FEWEST:
        return None
    columns = _columns(found.problem.model.arm, measurements, excluded)
    each = [shared for name, values in columns if (shared := _of_values(name, values, excluded, used)) is not None]
    best = min(each, key=lambda shared: shared.p_value, default=None)
    if best is None or best.p_value * len(each) >= SURELY:
        return None
    return replace(best, p_value=best.p_value * len(each))


def together(excluded: Mask, used: Mask, measurements: Measurements) -> tuple[Mask, float]:
    """The stretch of time, else of the file, in which the ``excluded`` records (n,) are, and few of the ``used`` ones: its
    records (n,), and the chance of any such; no records where that is not less than :data:`TOGETHER`.

    Where k of N are drawn at random, m of them are among w that follow one another with a chance of no more than
    ``C(w, m) C(N - m, k - m) / C(N, k)``; Bonferroni's bound over all stretches, half of it for those that begin or end with
    the file. Of the stretches with m, the shortest is the least likely.
    """
    time = measurements.conditions.time
    order = np.argsort(np.arange(measurements.n) if time is None else time, kind="stable")
    order = order[(excluded | used)[order]]
    places, count, k = np.flatnonzero(excluded[order]), order.size, int(excluded.sum())
    nothing = np.zeros(excluded.size, dtype=bool)
    if k < FEWEST_TOGETHER:
        return nothing, 1.0
    number: Index = np.arange(FEWEST_TOGETHER, k + 1)
    first = np.array([np.argmin(places[m - 1 :] - places[: k - m + 1]) for m in number])
    low = np.concatenate([places[first], places[k - number], 0 * number])
    high = np.concatenate([places[first + number - 1], 0 * number + count - 1, places[number - 1]])
    m: Index = np.tile(number, 3)
    w = high - low + 1
    tried = np.where(np.arange(m.size) < number.size, count * (count + 1.0), 4.0 * count)
    chances = np.log(tried) + _log_binomial(w, m) + _log_binomial(count - m, k - m) - _log_binomial(count, k)
    best = int(np.argmin(chances))
    if chances[best] >= np.log(TOGETHER):
        return nothing, 1.0
    nothing[order[low[best] : high[best] + 1]] = True
    return nothing, float(np.exp(chances[best]))


def _log_binomial(n: Array | Index | int, k: Array | Index | int) -> Array:
    """``log C(n, k)``."""
    return np.asarray(gammaln(np.add(n, 1)) - gammaln(np.add(k, 1)) - gammaln(np.subtract(n, k) + 1))


def as_numbers(values: Iterable[object]) -> pd.Series | None:
    """A column as numbers, or None where it holds labels: text, or no more than :data:`MOST_LABELS` different numbers."""
    numbers = pd.to_numeric(pd.Series(values), errors="coerce")
    return numbers if numbers.notna().all() and numbers.nunique() > MOST_LABELS else None


def _columns(arm: Arm, measurements: Measurements, excluded: Mask) -> Iterator[tuple[str, pd.Series]]:
    """All that is known of single records, by the name of what it is; a name says the unit."""
    q, conditions = measurements.q, measurements.conditions
    for j, row in enumerate(arm.chain.moving_rows()):
        slides = arm.chain.prismatic[j]
        if np.ptp(q[:, j]) > LEAST_SPREAD:
            column = f"joint{row}_mm" if slides else f"theta{row}_deg"
            yield f"joint {row}", pd.Series(q[:, j] / (MM if slides else DEG), name=column)
        if conditions.torque is not None:
            yield f"torque {row}", pd.Series(conditions.torque[:, j], name=f"torque{row}_nm")
    known = {"time_s": conditions.time, "temperature_c": conditions.temperature}
    yield from ((name.partition("_")[0], pd.Series(v, name=name)) for name, v in known.items() if v is not None)
    labels = {name: getattr(conditions, name) for name in ("session", "marker", "seat")}
    labels |= {"operator": measurements.operator, "bar": measurements.bar}
    yield from ((name, pd.Series(values, name=name)) for name, values in labels.items() if values is not None)
    for name in measurements.extra:
        numbers = as_numbers(measurements.extra[name])
        values = measurements.extra[name].astype(str) if numbers is None else numbers
        yield str(name), values.reset_index(drop=True).rename(str(name))
    tip = arm.positions(q) / MM
    yield from ((axis, pd.Series(tip[:, k], name=f"tip_{axis}_mm")) for k, axis in enumerate("xyz"))
    yield "scale", pd.Series(np.linalg.norm(tip, axis=1), name="distance_mm")
    apart = np.linalg.norm(tip - np.median(tip[excluded], axis=0), axis=1)
    yield "place", pd.Series(apart, name="distance_mm from their middle")  # they may fill a region of the room


def _of_values(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared | None:
    if pd.api.types.is_numeric_dtype(values):
        return _of_numbers(name, values, excluded, used) if values.notna().all() else None
    codes, labels = pd.factorize(values.astype(str))
    there, mine = (np.bincount(codes[some], minlength=len(labels)) for some in (excluded, excluded | used))
    count = int(excluded.sum())
    # Bonferroni's bound over the labels; one that all records have says nothing.
    chances = np.minimum(1.0, len(labels) * scipy.special.bdtrc(there - 1.0, count, mine / mine.sum()))
    chances[(there == 0) | (mine == mine.sum())] = 1.0
    best = int(np.argmin(chances))
    return Shared(name, float(chances[best]), f"{values.name} {labels[best]}", int(there[best]), int(mine[best]), count)


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
