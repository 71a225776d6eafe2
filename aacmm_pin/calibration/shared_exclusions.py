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
from aacmm_pin.effects import LEAST_SPREAD
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
PARTS = 20
"""Parts of the range of a number that are looked at."""
KUIPER_TERMS = 20
"""Terms of the series of Kuiper's statistic."""
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
        found: dict[str, Any] = {"doubtful": self.doubtful, "too_many": self.too_many}
        found["shared"] = None if self.shared is None else asdict(self.shared)
        found["narrowed"] = [asdict(joint) for joint in self.narrowed]
        return found


def exclusions_of(found: Fit) -> Exclusions:
    """Whether what a fit excluded are gross errors."""
    excluded = int(found.excluded.sum())
    used = int(found.used.sum())
    shared = shared_by(found)
    narrowed = tuple(_narrowed(found))
    return Exclusions(excluded, used, found.too_many_excluded, shared, narrowed)


def _narrowed(found: Fit) -> Iterator[Narrowed]:
    """Joints that the used records move over a part below :data:`NARROW` of the range which all
    records give them.

    Three excluded records at least reach beyond the used range, for one or two may be wrong
    readings.
    """
    if not (found.excluded.any() and found.used.any()):
        return
    chain = found.problem.model.arm.chain
    q = found.problem.measurements.q
    for j, row in enumerate(chain.moving_rows()):
        low = q[found.used, j].min()
        high = q[found.used, j].max()
        values = q[found.excluded, j]
        beyond = np.maximum(low - values, values - high)
        if (beyond > 0.0).sum() < FEWEST_TOGETHER:
            continue
        # A reading or two may be wrong by any angle.
        values = values[beyond <= np.sort(beyond)[-FEWEST_TOGETHER]]
        seen = max(high, values.max()) - min(low, values.min())
        if high - low < NARROW * seen:
            yield Narrowed(row, float(high - low), float(seen), bool(chain.prismatic[j]))


def shared_by(found: Fit) -> Shared | None:
    """What the excluded records of a fit share that the used ones do not, by the smallest chance;
    None if nothing.

    The stretch of time first, see :func:`clusters`. Then the other clusters; numbers by Kuiper's
    statistic (Kuiper 1960), labels by the binomial chance of so many excluded ones with one of
    them; Bonferroni's bound over all that were looked at.
    """
    arm = found.problem.model.arm
    records = found.problem.measurements
    excluded = found.excluded
    used = found.used
    dense = [cluster.shared for cluster in clusters(arm, records, excluded, used)]
    if dense and dense[0].name == "time":
        return dense[0]
    columns = _columns(arm, records) if excluded.sum() >= FEWEST_EXCLUDED else ()
    found_by = (_of_values(name, values, excluded, used) for name, values in columns)
    each = [shared for shared in found_by if shared is not None]
    bounds = [replace(shared, p_value=shared.p_value * len(each)) for shared in each]
    sure = [*dense, *(shared for shared in bounds if shared.p_value < SURELY)]
    # These say more than the rows of a file that have one.
    labels = [shared for shared in sure if shared.name in LABELS]
    return min(labels or sure, key=lambda shared: shared.p_value, default=None)


class Cluster(NamedTuple):
    """Records (n,) of which so many are excluded that these are no gross errors, and what they
    share.
    """

    records: Mask
    shared: Shared


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
    postures = records.postures
    single = np.zeros(records.n, dtype=bool)
    single[np.unique(np.stack([postures, excluded], axis=1), axis=0, return_index=True)[1]] = True
    counted = single & (excluded | used)
    if np.sum(counted & excluded) < FEWEST_TOGETHER or not used.any():
        return []
    found = []
    for name, values, kinds in _scales(arm, records):
        like = counted & np.all(
            (values >= values[used].min(axis=0)) & (values <= values[used].max(axis=0)), axis=1
        )
        if name in ("time", "record"):
            like = counted
        window, chance = (_ball if values.shape[1] > 1 else _stretch)(
            values, np.flatnonzero(like), excluded
        )
        if (chance := chance * kinds) < TOGETHER:
            inside = np.isin(postures, postures[window])
            mine, every = (int((inside & some).sum()) for some in (excluded, excluded | used))
            shared = Shared(
                name, chance, _extent(name, values[window]), mine, every, int(excluded.sum())
            )
            found.append(Cluster(inside, shared))
    return found


def _scales(arm: Arm, records: Measurements) -> Iterator[tuple[str, Array, int]]:
    """Where neighbours are looked for: name, values (n, 1 or 3) in the unit of words, and of how
    many kinds it is one.
    """
    time = records.conditions.time
    chain = arm.chain
    order = records.row if time is None else time
    yield "record" if time is None else "time", np.asarray(order, dtype=np.float64)[:, None], 1
    kinds = records.q.shape[1] + 1
    for j, row in enumerate(chain.moving_rows()):
        yield f"joint {row}", records.q[:, j : j + 1] / (MM if chain.prismatic[j] else DEG), kinds
    yield "place", arm.positions(records.q) / MM, kinds


def _extent(name: str, values: Array) -> str:
    """Where values (m, 1 or 3) are, in words."""
    low = values.min(axis=0)
    high = values.max(axis=0)
    if name == "place":
        middle = ", ".join(f"{each:.0f}" for each in (low + high) / 2)
        return f"the tip within {np.linalg.norm(high - low) / 2:.0f} mm of ({middle}) mm"
    words = {"record": "row numbers from", "time": "time_s from"}.get(name, f"{name} from")
    return f"{words} {low[0]:.6g} to {high[0]:.6g}"


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
    found: tuple[Index, float] = like[:0], 1.0
    for centre in like[excluded[like]] if number.size else ():
        order = like[
            np.argsort(np.linalg.norm(places[like] - places[centre], axis=1), kind="stable")
        ]
        among = np.flatnonzero(excluded[order])[number - 1] + 1
        best, chance = _least_likely(
            among, number, np.full(number.size, float(count) ** 2), count, k
        )
        if chance < found[1]:
            found = order[: among[best]], chance
    return found


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
            where = f"{_extent('place', tips[inside])}, where used records deviate similarly"
            best = Shared(
                "place",
                float(chances[k]),
                where,
                int(out[inside].sum()),
                inside.size,
                int(out.sum()),
            )
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
    whole, chosen, left = (gammaln(np.add(count, 1)) for count in (n, k, others))
    return np.asarray(whole - chosen - left)


def as_numbers(values: Iterable[object]) -> pd.Series | None:
    """A column as numbers, or None where it holds labels: text, or no more than :data:`MOST_LABELS`
    different numbers.
    """
    numbers = pd.to_numeric(pd.Series(values), errors="coerce")
    return numbers if numbers.notna().all() and numbers.nunique() > MOST_LABELS else None


def _columns(arm: Arm, measurements: Measurements) -> Iterator[tuple[str, pd.Series]]:
    """All that is known of single records, by the name of what it is; a name says the unit."""
    q = measurements.q
    for j, row in enumerate(arm.chain.moving_rows()):
        if np.ptp(q[:, j]) > LEAST_SPREAD:
            slides = arm.chain.prismatic[j]
            name, unit = (f"joint{row}_mm", MM) if slides else (f"theta{row}_deg", DEG)
            yield f"joint {row}", pd.Series(q[:, j] / unit, name=name)
    for column in measurements.covariate_columns():
        values = pd.Series(column.values, name=column.name)
        if column.entry is UNKNOWN_COLUMN:
            numbers = as_numbers(values)
            values = values.astype(str) if numbers is None else numbers
        yield column.quantity, values
    tip = arm.positions(q) / MM
    yield from ((axis, pd.Series(tip[:, k], name=f"tip_{axis}_mm")) for k, axis in enumerate("xyz"))
    yield "scale", pd.Series(np.linalg.norm(tip, axis=1), name="distance_mm")


def _of_values(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared | None:
    """The range or the label that excluded records share; None of numbers with gaps."""
    if pd.api.types.is_numeric_dtype(values):
        if values.isna().any():
            return None
        return _of_numbers(name, values, excluded, used)
    codes, labels = pd.factorize(values.astype(str))
    there = np.bincount(codes[excluded], minlength=len(labels))
    mine = np.bincount(codes[excluded | used], minlength=len(labels))
    count = int(excluded.sum())
    every = mine.sum()
    # Bonferroni's bound over the labels; one that all records have says nothing.
    chances = len(labels) * scipy.special.bdtrc(there - 1.0, count, mine / every)
    chances[(there == 0) | (mine == every) | (chances > 1.0)] = 1.0
    best = int(np.argmin(chances))
    chance = float(chances[best])
    where = f"{values.name} {labels[best]}"
    return Shared(name, chance, where, int(there[best]), int(mine[best]), count)


def _of_numbers(name: str, values: pd.Series, excluded: Mask, used: Mask) -> Shared | None:
    """The range in which most of the excluded ones are, and fewest of the others.

    In parts of the range, and not far beyond that of the used ones: wrong readings, and their tips,
    are elsewhere anyway.
    """
    numbers = values.to_numpy(dtype=np.float64)
    counted = excluded | used
    low = numbers[used].min()
    high = numbers[used].max()
    from_middle = np.abs(numbers - (low + high) / 2)
    near = numbers[counted & (from_middle <= high - low)]
    edges = np.linspace(near.min(), near.max(), PARTS + 1)
    like = (numbers >= edges[0]) & (numbers <= edges[-1])
    of_excluded, _ = np.histogram(numbers[excluded & like], edges)
    of_used, _ = np.histogram(numbers[used & like], edges)
    n_excluded = of_excluded.sum()
    n_used = of_used.sum()
    if n_excluded < FEWEST_EXCLUDED or edges[0] == edges[-1]:
        return None
    part = of_excluded / n_excluded - of_used / n_used
    ahead = np.cumsum(np.concatenate([[0.0], part]))
    least = int(ahead.argmin())
    most = int(ahead.argmax())
    size = np.sqrt(1.0 / (1.0 / n_excluded + 1.0 / n_used))
    chance = _kuiper(float((size + 0.155 + 0.24 / size) * np.ptp(ahead)))
    first = edges[min(least, most)]
    last = edges[max(least, most)]
    outside = least > most  # the excluded ones are on both sides of the range
    inside = (numbers >= first) & (numbers < last)
    where = f"{values.name} from {first:.4g} to {last:.4g}"
    if outside:
        where = f"{values.name} below {first:.4g} or above {last:.4g}"
    there = like & (inside != outside)
    mine = int((there & excluded).sum())
    every = int((there & counted).sum())
    return Shared(name, chance, where, mine, every, int(excluded.sum()))


def _kuiper(size: float) -> float:
    """Chance of a larger statistic (Kuiper 1960; Press et al., Numerical Recipes, 14.3)."""
    if size < 0.4:
        return 1.0
    squares: Array = np.square(size * np.arange(1, KUIPER_TERMS))
    return float(min(1.0, 2.0 * ((4.0 * squares - 1.0) * np.exp(-2.0 * squares)).sum()))
