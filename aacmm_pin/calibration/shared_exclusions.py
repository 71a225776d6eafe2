"""Excluded records that are no gross errors: too many, sharing something, or all that moved some
joint.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
from scipy.special import gammaln

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.calibration.fit import FEWEST_TOGETHER, Fit
from aacmm_pin.measurements import LABELS, UNKNOWN_COLUMN, Measurements

TOGETHER = 1e-3
"""Chance, over all neighbours of their kind, below which excluded records that are neighbours are
no gross errors.
"""
NEIGHBOURS = (4, 8, 16, 32)
"""So many records round an excluded one are looked at together."""
FEWEST_EXCLUDED = 5
"""Fewer excluded records than this share many things by chance."""
SURELY = 1e-6
"""Chance, over all that is known of the records, below which what the excluded ones share is no
chance.
"""
BEYOND_USED = 0.5
"""Part of the range of the used records by which many excluded ones may be beyond it, and share
that.
"""
MOST_LABELS = 12
"""Numbers with more different values than this are a scale, others are labels."""
NARROW = 0.5
"""Used records that move a joint over less than this part of its range in all records are about
another part of the arm.
"""


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

    @property
    def note(self) -> Note:
        """That they share it."""
        others = self.records - self.excluded
        data = {"excluded": self.excluded, "of": self.of, "where": self.where, "others": others}
        return Note("excluded_share", data)


@dataclass(frozen=True)
class Narrowed:
    """A joint that the excluded records alone moved over most of its range.

    Attributes:
        joint: its row, from 1.
        used, seen: range over which the used records move it, and all of them [rad; m where it
            slides].
        slides: whether it is prismatic.
    """

    joint: int
    used: float
    seen: float
    slides: bool

    @property
    def note(self) -> Note:
        """That it does."""
        code = "slide_narrowed" if self.slides else "joint_narrowed"
        return Note(code, {"joint": self.joint, "used": self.used, "seen": self.seen})


@dataclass(frozen=True)
class Exclusions:
    """What makes excluded records no gross errors of single records.

    Attributes:
        excluded, used: how many were excluded, and how many count.
        too_many: whether that is more than gross errors are, see
            :attr:`aacmm_pin.calibration.fit.Fit.too_many_excluded`.
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
    def notes(self) -> list[Note]:
        """What they share and which joints they narrowed."""
        shared = [] if self.shared is None else [self.shared.note]
        return shared + [joint.note for joint in self.narrowed]

    def summary(self) -> dict[str, Any]:
        """As plain values, for JSON; SI."""
        return {
            "doubtful": self.doubtful,
            "too_many": self.too_many,
            "shared": None if self.shared is None else asdict(self.shared),
            "narrowed": [asdict(joint) for joint in self.narrowed],
        }


def exclusions_of(fit: Fit) -> Exclusions:
    """Whether what a fit excluded are gross errors."""
    return Exclusions(
        int(fit.excluded.sum()),
        int(fit.used.sum()),
        fit.too_many_excluded,
        shared_by(fit),
        tuple(_narrowed(fit)),
    )


def _narrowed(fit: Fit) -> Iterator[Narrowed]:
    """Joints that the used records move over a part below :data:`NARROW` of the range which all
    records give them.

    Three excluded records at least reach beyond the used range, for one or two may be wrong
    readings.
    """
    if not (fit.excluded.any() and fit.used.any()):
        return
    chain = fit.problem.model.arm.chain
    q = fit.problem.measurements.q
    for j, row in enumerate(chain.moving_rows()):
        low = q[fit.used, j].min()
        high = q[fit.used, j].max()
        values = q[fit.excluded, j]
        beyond = np.maximum(low - values, values - high)
        if (beyond > 0.0).sum() < FEWEST_TOGETHER:
            continue
        # A reading or two may be wrong by any angle.
        values = values[beyond <= np.sort(beyond)[-FEWEST_TOGETHER]]
        seen = max(high, values.max()) - min(low, values.min())
        if high - low < NARROW * seen:
            yield Narrowed(row, float(high - low), float(seen), bool(chain.prismatic[j]))


def shared_by(fit: Fit) -> Shared | None:
    """What the excluded records of a fit share that the used ones do not, by the smallest chance;
    None if nothing.

    The stretch of time first, see :func:`clusters`. Then the other clusters, those of numbers known
    of single records among them, and labels by the binomial chance of so many excluded ones with
    one of them; Bonferroni's bound over all that were looked at.
    """
    arm = fit.problem.model.arm
    records = fit.problem.measurements
    excluded = fit.excluded
    scales = [*_scales(arm, records)]
    shared = [found.shared for found in _clusters(scales, records, excluded, fit.used)]
    if shared and shared[0].name == "time":
        return shared[0]
    if excluded.sum() >= FEWEST_EXCLUDED:
        tips = scales[-1].values
        numbers, labels = _columns(records, tips)
        beyond = _clusters([*scales, *numbers], records, excluded, fit.used, BEYOND_USED)
        shared += [found.shared for found in beyond if found.shared.p_value < SURELY]
        by_label = [_of_labels(name, labels[name], excluded, fit.used) for name in labels]
        chances = [len(by_label) * found.p_value for found in by_label]
        shared += [
            replace(found, p_value=chance)
            for found, chance in zip(by_label, chances, strict=True)
            if chance < SURELY
        ]
    # These say more than the rows of a file that have one.
    named = [found for found in shared if found.name in LABELS]
    return min(named or shared, key=lambda found: found.p_value, default=None)


class Cluster(NamedTuple):
    """Records (n,) of which so many are excluded that these are no gross errors, and what they
    share.
    """

    records: Mask
    shared: Shared


class Scale(NamedTuple):
    """Numbers of records by which neighbours are looked for.

    Attributes:
        name: of what they are.
        words: what stands in front of a range of them.
        values: (n, 1 or 3), in the unit of the words.
        kinds: of how many like scales it is one.
    """

    name: str
    words: str
    values: Array
    kinds: int


def clusters(arm: Arm, records: Measurements, excluded: Mask, used: Mask) -> list[Cluster]:
    """The stretch of time, else of the file, that of each joint, and the ball in space in which the
    ``excluded`` records (n,) are, and few of the ``used`` ones; those of which the chance of any
    such is less than :data:`TOGETHER`.

    Where k of N are drawn at random, m of them are among w neighbours with a chance of no more than
    ``C(w, m) C(N - m, k - m) / C(N, k)``; Bonferroni's bound over all stretches of time, half of it
    for those that begin or end with the file, and over all stretches of joints and all balls. Of
    the neighbours with m, the fewest are the least likely. Records of one posture share an error
    and count once. Wrong readings, and their tips, are beyond the range of the used records.
    """
    return _clusters(_scales(arm, records), records, excluded, used)


def _clusters(
    scales: Iterable[Scale], records: Measurements, excluded: Mask, used: Mask, margin: float = 0.0
) -> list[Cluster]:
    """Those of some scales; records may be beyond the used ones by a part of their range."""
    postures = records.postures
    single = np.zeros(records.n, dtype=bool)
    single[np.unique(np.stack([postures, excluded], axis=1), axis=0, return_index=True)[1]] = True
    counted = single & (excluded | used)
    if np.sum(counted & excluded) < FEWEST_TOGETHER or not used.any():
        return []
    dense = []
    for name, words, values, kinds in scales:
        like = counted
        if name not in ("time", "record"):
            low = values[used].min(axis=0)
            high = values[used].max(axis=0)
            most = margin * (high - low)
            like = counted & ((values >= low - most) & (values <= high + most)).all(axis=1)
        neighbours = _ball if values.shape[1] > 1 else _stretch
        window, chance = neighbours(values, np.flatnonzero(like), excluded)
        if chance * kinds < TOGETHER:
            inside = np.isin(postures, postures[window])
            mine, counting = (int((inside & some).sum()) for some in (excluded, excluded | used))
            where = _extent(words, values[window])
            count = int(excluded.sum())
            dense.append(
                Cluster(inside, Shared(name, chance * kinds, where, mine, counting, count))
            )
    return dense


def _scales(arm: Arm, records: Measurements) -> Iterator[Scale]:
    time = records.conditions.time
    chain = arm.chain
    if time is None:
        yield Scale("record", "row numbers", records.row[:, None].astype(np.float64), 1)
    else:
        yield Scale("time", "time_s", time[:, None], 1)
    kinds = records.q.shape[1] + 1
    for j, row in enumerate(chain.moving_rows()):
        values = records.q[:, j : j + 1] / (MM if chain.prismatic[j] else DEG)
        yield Scale(f"joint {row}", f"joint {row}", values, kinds)
    yield Scale("place", "the tip", arm.positions(records.q) / MM, kinds)


def _extent(words: str, values: Array) -> str:
    """Where values (m, 1 or 3) are, in words."""
    low = values.min(axis=0)
    high = values.max(axis=0)
    if low.size == 1:
        return f"{words} from {low[0]:.6g} to {high[0]:.6g}"
    middle = ", ".join(f"{x:.0f}" for x in (low + high) / 2)
    return f"{words} within {np.linalg.norm(high - low) / 2:.0f} mm of ({middle}) mm"


def _stretch(values: Array, like: Index, excluded: Mask) -> tuple[Index, float]:
    """Of the records ``like``, the least likely ones that follow one another by ``values`` (n, 1);
    and their chance.
    """
    order = like[np.argsort(values[like, 0], kind="stable")]
    places = np.flatnonzero(excluded[order])
    count = order.size
    k = places.size
    number: Index = np.arange(FEWEST_TOGETHER, k + 1)
    if not number.size:
        return like[:0], 1.0
    lengths = [places[m - 1 :] - places[: k - m + 1] for m in number]
    shortest = np.array([np.argmin(length) for length in lengths])
    start = np.zeros_like(number)
    end = np.full_like(number, count - 1)
    low = np.concatenate([places[shortest], places[k - number], start])
    high = np.concatenate([places[shortest + number - 1], end, places[number - 1]])
    inner = np.arange(low.size) < number.size
    tried = np.where(inner, count * (count + 1.0), 4.0 * count)
    best, chance = _least_likely(high - low + 1, np.tile(number, 3), tried, count, k)
    return order[low[best] : high[best] + 1], chance


def _ball(places: Array, like: Index, excluded: Mask) -> tuple[Index, float]:
    """The same of those round an excluded one, by ``places`` (n, 3)."""
    k = int(excluded[like].sum())
    count = like.size
    number: Index = np.arange(FEWEST_TOGETHER, k + 1)
    least: tuple[Index, float] = like[:0], 1.0
    for centre in like[excluded[like]] if number.size else ():
        order = like[
            np.argsort(np.linalg.norm(places[like] - places[centre], axis=1), kind="stable")
        ]
        among = np.flatnonzero(excluded[order])[number - 1] + 1
        best, chance = _least_likely(
            among, number, np.full(number.size, float(count) ** 2), count, k
        )
        if chance < least[1]:
            least = order[: among[best]], chance
    return least


def round_excluded(found: Fit, off: Array) -> Shared | None:
    """The ball round an excluded record in which records are off in one direction; None if that is
    chance.

    Args:
        found: the fit.
        off: residuals beside all that was found, of variance one (n, 3). Of an excluded record the
            direction counts alone.
    """
    out = found.excluded
    has_target = found.observations.has_target
    size = np.where(out, np.sqrt(np.square(off).sum(axis=1) / 3.0), 1.0)
    off = off / size[:, None]
    tips = found.problem.model.arm.positions(found.problem.measurements.q) / MM
    sizes: Index = np.array(
        [size for size in NEIGHBOURS if 2 * size <= has_target.sum()], dtype=np.intp
    )
    best: Shared | None = None
    for centre in np.flatnonzero(out) if sizes.size else ():
        distance = np.where(has_target, np.linalg.norm(tips - tips[centre], axis=1), np.inf)
        order = np.argsort(distance, kind="stable")
        squares = np.square(np.cumsum(off[order[: sizes[-1]]], axis=0)[sizes - 1]).sum(axis=1)
        chances = chi2_sf(squares / sizes, 3) * sizes.size * int(out.sum())
        k = int(np.argmin(chances))
        if chances[k] < (TOGETHER if best is None else best.p_value):
            inside = order[: sizes[k]]
            where = f"{_extent('the tip', tips[inside])}, where used records deviate similarly"
            mine = int(out[inside].sum())
            best = Shared("place", float(chances[k]), where, mine, inside.size, int(out.sum()))
    return best


def _least_likely(w: Index, m: Index, tried: Array, count: int, k: int) -> tuple[int, float]:
    """Which m of k excluded ones of ``count`` are least likely among w neighbours, and the chance
    of any of ``tried``.
    """
    ways = _log_binomial(w, m) + _log_binomial(count - m, k - m)
    chances = np.log(tried) + ways - _log_binomial(count, k)
    best = int(np.argmin(chances))
    return best, float(np.exp(min(chances[best], 0.0)))


def _log_binomial(n: Array | Index | int, k: Array | Index | int) -> Array:
    """``log C(n, k)``."""
    others = np.subtract(n, k)
    of_all, of_chosen, of_others = (gammaln(np.add(count, 1)) for count in (n, k, others))
    return np.asarray(of_all - of_chosen - of_others)


def as_numbers(values: Iterable[object]) -> pd.Series | None:
    """A column as numbers, or None where it holds labels: text, or no more than :data:`MOST_LABELS`
    different numbers.
    """
    numbers = pd.to_numeric(pd.Series(values), errors="coerce")
    return numbers if numbers.notna().all() and numbers.nunique() > MOST_LABELS else None


def _columns(records: Measurements, tips: Array) -> tuple[list[Scale], dict[str, pd.Series]]:
    """What else is known of single records, with ``tips`` (n, 3) [mm]: numbers, and labels by the
    name of what they are.
    """
    numbers = {axis: (f"tip_{axis}_mm", tips[:, k]) for k, axis in enumerate("xyz")}
    numbers["scale"] = "distance_mm", np.linalg.norm(tips, axis=1)
    labels = {}
    for column in records.covariate_columns():
        values = pd.Series(column.values, name=column.name)
        if column.entry is UNKNOWN_COLUMN:
            of_numbers = as_numbers(values)
            values = values.astype(str) if of_numbers is None else of_numbers
        if not pd.api.types.is_numeric_dtype(values):
            labels[column.quantity] = values.astype(str)
        elif not values.isna().any():
            numbers[column.quantity] = column.name, values.to_numpy(dtype=np.float64)
    kinds = len(numbers)
    scales = [
        Scale(name, words, values[:, None], kinds) for name, (words, values) in numbers.items()
    ]
    return scales, labels


def _of_labels(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared:
    """The label that excluded records share, by Bonferroni's bound over the labels; one that all
    records have says nothing.
    """
    codes, labels = pd.factorize(values)
    there = np.bincount(codes[excluded], minlength=len(labels))
    mine = np.bincount(codes[excluded | used], minlength=len(labels))
    count = int(excluded.sum())
    total = mine.sum()
    chances = len(labels) * scipy.special.bdtrc(there - 1.0, count, mine / total)
    chances[(there == 0) | (mine == total) | (chances > 1.0)] = 1.0
    best = int(np.argmin(chances))
    where = f"{values.name} {labels[best]}"
    return Shared(name, float(chances[best]), where, int(there[best]), int(mine[best]), count)
