"""Excluded records that are no gross errors: too many, or sharing something."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import betaln

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration.fit import FEWEST_TOGETHER, Fit
from aacmm_pin.measurements import LABELS, UNKNOWN_COLUMN, Measurements

SHARED_CHANCE = 1e-3
"""Chance, over all covariates, below which excluded records that share something are no gross
errors.
"""
MOST_CENTRES = 24
BEYOND_USED = 0.5
"""Excluded records farther beyond the used ones, in parts of their range, do not count."""
MOST_LABELS = 12


@dataclass(frozen=True)
class Shared:
    """What excluded records share.

    Attributes:
        p_value: chance if gross errors are scattered, over all covariates.
        excluded, records: numbers of records there.
        of: number of all excluded records.
    """

    name: str
    p_value: float
    where: str
    excluded: int
    records: int
    of: int

    @property
    def note(self) -> Note:
        """Note that they share it."""
        others = self.records - self.excluded
        data = {"excluded": self.excluded, "of": self.of, "where": self.where, "others": others}
        return Note("excluded_share", data)


@dataclass(frozen=True)
class Exclusions:
    """Whether excluded records are gross errors of single records."""

    excluded: int
    used: int
    too_many: bool
    shared: Shared | None

    @property
    def doubtful(self) -> bool:
        """Whether they are something else than gross errors."""
        return self.too_many or self.shared is not None

    @property
    def notes(self) -> list[Note]:
        """On what they share."""
        return [] if self.shared is None else [self.shared.note]

    def summary(self) -> dict[str, Any]:
        """As plain values, for JSON; SI."""
        shared = None if self.shared is None else asdict(self.shared)
        return {"doubtful": self.doubtful, "too_many": self.too_many, "shared": shared}


def exclusions_of(fit: Fit) -> Exclusions:
    """Whether what a fit excluded are gross errors."""
    excluded, used = int(fit.excluded.sum()), int(fit.used.sum())
    return Exclusions(excluded, used, fit.too_many_excluded, shared_by(fit))


def shared_by(fit: Fit) -> Shared | None:
    """What the excluded records share and the used ones do not: a label first, then time, then the
    smallest chance.
    """
    arm = fit.problem.model.arm
    unlikely = clusters(arm, fit.problem.measurements, fit.excluded, fit.used)

    def rank(shared: Shared) -> tuple[bool, bool, float]:
        return shared.name not in LABELS, shared.name != "time", shared.p_value

    return min((cluster.shared for cluster in unlikely), key=rank, default=None)


class Cluster(NamedTuple):
    """Records (n,) with too many excluded ones for gross errors, and what they share."""

    records: Mask
    shared: Shared


class Scale(NamedTuple):
    """What makes records neighbours.

    Attributes:
        words: in front of its values.
        values: (n, 1 or 3), in the unit of the words; of labels one column for each (n, labels).
        labels: of the columns; None for numbers.
    """

    name: str
    words: str
    values: Array
    labels: pd.Index | None = None

    @property
    def is_order(self) -> bool:
        """Whether it is the order in which the records were taken."""
        return self.name in ("time", "record")

    def near(self, used: Mask) -> Mask:
        """Records not far beyond the used ones (n,), as wrong readings are."""
        if self.is_order or self.labels is not None:
            return np.ones(len(self.values), dtype=bool)
        low = self.values[used].min(axis=0)
        high = self.values[used].max(axis=0)
        most = BEYOND_USED * (high - low)
        return np.asarray(((self.values >= low - most) & (self.values <= high + most)).all(axis=1))

    def extent(self, records: Index) -> str:
        """Where some records are, in words."""
        values = self.values[records]
        if self.labels is not None:
            return f"{self.words} {self.labels[int(values[0].argmax())]}"
        low = values.min(axis=0)
        high = values.max(axis=0)
        if low.size == 1:
            return f"{self.words} from {low[0]:.6g} to {high[0]:.6g}"
        middle = ", ".join(f"{x:.0f}" for x in (low + high) / 2)
        return f"{self.words} within {np.linalg.norm(high - low) / 2:.0f} mm of ({middle}) mm"


def clusters(arm: Arm, records: Measurements, excluded: Mask, used: Mask) -> list[Cluster]:
    """By each scale, neighbours with many ``excluded`` records (n,), whose chance is below
    :data:`SHARED_CHANCE` (Bonferroni). Records of one posture share an error and count once.
    """
    postures = records.postures
    repeated = pd.DataFrame({"posture": postures, "excluded": excluded}).duplicated().to_numpy()
    counted = ~repeated & (excluded | used)
    if np.sum(counted & excluded) < FEWEST_TOGETHER or not used.any():
        return []
    scales = [*_scales(arm, records)]
    unlikely = []
    for scale in scales:
        window, chance = _neighbours(scale, np.flatnonzero(counted & scale.near(used)), excluded)
        chance *= 1 if scale.is_order else len(scales) - 1
        if chance < SHARED_CHANCE:
            inside = np.isin(postures, postures[window])
            excluded_inside = int(excluded[inside].sum())
            total_inside = excluded_inside + int(used[inside].sum())
            shared = Shared(
                scale.name,
                chance,
                scale.extent(window),
                excluded_inside,
                total_inside,
                int(excluded.sum()),
            )
            unlikely.append(Cluster(inside, shared))
    return unlikely


def _scales(arm: Arm, records: Measurements) -> Iterator[Scale]:
    time = records.conditions.time
    if time is None:
        yield Scale("record", "row numbers", records.row[:, None].astype(np.float64))
    else:
        yield Scale("time", "time_s", time[:, None])
    chain = arm.chain
    for j, row in enumerate(chain.moving_rows()):
        unit, factor = ("mm", MM) if chain.prismatic[j] else ("°", DEG)
        yield Scale(f"joint {row}", f"joint {row} [{unit}]", records.q[:, j : j + 1] / factor)
    tips = arm.positions(records.q) / MM
    yield Scale("place", "the tip", tips)
    for axis, values in zip("xyz", tips.T, strict=True):
        yield Scale(axis, f"tip_{axis}_mm", values[:, None])
    yield Scale("scale", "distance_mm", np.linalg.norm(tips, axis=1, keepdims=True))
    for column in records.covariate_columns():
        cells = pd.Series(column.values)
        if column.entry is UNKNOWN_COLUMN:
            numbers = as_numbers(cells)
            cells = cells.astype(str) if numbers is None else numbers
        if not pd.api.types.is_numeric_dtype(cells):
            of_labels = pd.get_dummies(cells.astype(str), dtype=float)
            yield Scale(column.quantity, column.name, of_labels.to_numpy(), of_labels.columns)
        elif column.quantity != "time" and not cells.isna().any():
            yield Scale(column.quantity, column.name, cells.to_numpy(np.float64)[:, None])


def _neighbours(scale: Scale, counted: Index, excluded: Mask) -> tuple[Index, float]:
    """Of the ``counted`` records, those round an excluded one that are the least likely to have so
    many excluded ones; and the chance of any such.

    With k of n drawn at random, one of them as the centre, m are among its w - 1 nearest and itself
    with a chance of at most ``C(w - 1, m - 1) C(n - m, k - m) / C(n - 1, k - 1)``; Bonferroni's
    bound over the centres and over m. Numbers count by their ranks.
    """
    values = scale.values[counted]
    if values.shape[1] == 1:
        ranks = np.unique(values, return_inverse=True)[1]
        values = ranks.reshape(-1, 1).astype(np.float64)
    is_excluded = excluded[counted]
    n = counted.size
    k = int(is_excluded.sum())
    window, least_chance = counted[:0], 1.0
    if k < FEWEST_TOGETHER:
        return window, least_chance
    some = np.linspace(0, k - 1, min(k, MOST_CENTRES)).round().astype(np.intp)
    for centre in values[is_excluded][some]:
        distance = np.linalg.norm(values - centre, axis=1)
        to_excluded = np.sort(distance[is_excluded])
        radii = to_excluded[FEWEST_TOGETHER - 1 :]
        m = np.searchsorted(to_excluded, radii, side="right")
        w = np.searchsorted(np.sort(distance), radii, side="right")
        log_draws = _log_binomial(w - 1, m - 1) + _log_binomial(n - m, k - m)
        log_chances = log_draws - _log_binomial(n - 1, k - 1)
        best = int(np.argmin(log_chances))
        chance = k * radii.size * float(np.exp(min(log_chances[best], 0.0)))
        if chance < least_chance:
            in_ball = distance <= radii[best]
            excluded_values = values[in_ball & is_excluded]
            low, high = excluded_values.min(axis=0), excluded_values.max(axis=0)
            between = ((values >= low) & (values <= high)).all(axis=1)
            window, least_chance = counted[in_ball & between], chance
    return window, least_chance


def _log_binomial(n: Array | Index | int, k: Array | Index | int) -> Array:
    return np.asarray(-np.log1p(n) - betaln(np.add(k, 1), np.subtract(n, k) + 1))


def as_numbers(values: Iterable[object]) -> pd.Series | None:
    """None for labels: text, or at most :data:`MOST_LABELS` different numbers."""
    numbers = pd.to_numeric(pd.Series(values), errors="coerce")
    return numbers if numbers.notna().all() and numbers.nunique() > MOST_LABELS else None
