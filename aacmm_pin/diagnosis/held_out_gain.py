"""Cross-validation of a diagnosis: choose and fit causes without one fold of the records after the
other, and predict the fold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin.calibration import Fit, rms
from aacmm_pin.calibration.cross_validation import distances
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.gram_matrix import Gram, gram_of
from aacmm_pin.diagnosis.model_space import ModelSpace, ModelState
from aacmm_pin.diagnosis.search import explore_from, without_block
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

RESAMPLES = 2000
"""Bootstrap resamples of the folds for the 95 % interval of the gain."""
PREDICTED_BY = ("nominal", "recalibrated", "extended", "with_discrepancy")


@dataclass(frozen=True, eq=False)
class Gain(Shown):
    """Distances of held-out records by each model.

    Attributes:
        kind: ``seats`` or ``blocks`` of joint space, of which the folds consist.
        groups: how many folds were left out in turn.
        nominal, recalibrated, extended, with_discrepancy: distances of the records by each model,
            the last the extended arm with the discrepancy (n,) [m]; nan for none. A rotation from a
            stated orientation is part of it, by :attr:`Fit.lever`.
        folds: fold of each record (n,).
        excluded: how many records count here that only the extended arm excludes.
        gross_errors: how many do not count, for both arms exclude them.
        interval: 95 % interval of the gain, by resampling the folds.
    """

    kind: str
    groups: int
    nominal: Array
    recalibrated: Array
    extended: Array
    with_discrepancy: Array
    folds: Index
    excluded: int
    gross_errors: int
    interval: tuple[float, float]

    @property
    def gain(self) -> float:
        """1 - RMS(extended)/RMS(recalibrated)."""
        return 1.0 - rms(self.extended) / rms(self.recalibrated)

    @property
    def beyond_doubt(self) -> bool:
        """Whether the whole interval is a gain."""
        return self.interval[0] > THRESHOLDS.least_gain

    def without_causes(self) -> Gain:
        """The gain if all records together name no cause: the extended arm is then the
        recalibrated.
        """
        return replace(self, extended=self.recalibrated, interval=(0.0, 0.0))

    @property
    def discrepancy_gain(self) -> float:
        """1 - RMS(with discrepancy)/RMS(extended)."""
        return 1.0 - rms(self.with_discrepancy) / rms(self.extended)


@dataclass(frozen=True, eq=False)
class Fold:
    """Distances of the records of one fold, as all other records predict them.

    Attributes:
        by_model: distances by each of the models (m,) [m].
        by_median: by the median probability model of all records, fitted to the others (m,) [m].
        without: the same without one of its causes, by the number of its block.
    """

    rows: Index
    by_model: Mapping[str, Array]
    by_median: Array
    without: Mapping[int, Array]


def predicted_folds(choice: Choice, nominal: Fit, kind: str, progress: Progress) -> list[Fold]:
    """Leave out every fold in turn; choose and fit with the others; predict it. ``nominal``: the
    arm as stated, set-up fitted.
    """
    gram_of_all = choice.gram_of_folds
    numbers = np.unique(choice.folds[choice.counted]).tolist()
    with watched(numbers, progress, f"held-out {kind}", "part") as watched_numbers:
        folds = [_fold(choice, nominal, gram_of_all, number) for number in watched_numbers]
    return [fold for fold in folds if fold is not None]


def _fold(choice: Choice, nominal: Fit, gram_of_all: Gram, fold_number: int) -> Fold | None:
    """Choose and fit without the records of a fold, and predict them; None if these have
    no more rows than unknown coordinates of seats.
    """
    in_fold = choice.folds == fold_number
    gram_of_fold = gram_of(choice.design, choice.noise, [in_fold])
    if not gram_of_fold.free:
        return None
    space = choice.posterior.space
    amplitudes = tuple(dict.fromkeys((0.0, choice.posterior.median_model.base.amplitude)))
    gram_of_others = gram_of_all.without(gram_of_fold)
    space_of_others = ModelSpace(space.candidates, gram_of_others, space.stated, amplitudes)
    rows = np.flatnonzero(choice.counted & in_fold)
    records = choice.fit.problem.measurements.take(rows)
    median_of_all = choice.posterior.median

    def distances_of(poses: Array) -> Array:
        return distances(records, poses, lever=choice.fit.lever)

    def predicted(state: ModelState, with_discrepancy: bool = False) -> Array:
        """Distances of the fold's records by a state, fitted to the others. Known causes keep their
        stated values unless their change is among its blocks. With the discrepancy, it has the
        amplitude that all records give it; else none.
        """
        amplitude = len(space_of_others.amplitudes) - 1 if with_discrepancy else 0
        state_of_others = state._replace(amplitude=amplitude)
        fitted = space_of_others.conditional(state_of_others, as_stated=True)
        return distances_of(fitted.tips(rows))

    median_of_others = explore_from(space_of_others, median_of_all).median
    state_chosen_by_others = space_of_others.marginal(median_of_others).best
    state_of_median = space_of_others.marginal(median_of_all).best
    candidates = space_of_others.candidates
    by_model = (
        distances_of(nominal.point.prediction.poses[rows]),
        predicted(state_chosen_by_others.of(())),
        predicted(state_chosen_by_others.of([*filter(candidates.is_cause, median_of_others)])),
        predicted(state_chosen_by_others, with_discrepancy=True),
    )
    return Fold(
        rows=rows,
        by_model=dict(zip(PREDICTED_BY, by_model, strict=True)),
        by_median=predicted(state_of_median),
        without={
            k: predicted(state_of_median.of(without_block(median_of_all, k))) for k in choice.causes
        },
    )


def gain_of(
    choice: Choice, folds: Sequence[Fold], kind: str, rng: np.random.Generator
) -> Gain | None:
    """The distances of all folds together, as in :attr:`Choice.counted`. None if no fold can be
    compared, as with one record of each unknown seat.
    """
    distances_by = {model: np.full(choice.folds.size, np.nan) for model in PREDICTED_BY}
    for fold in folds:
        for model, distances_of_fold in fold.by_model.items():
            distances_by[model][fold.rows] = distances_of_fold
    if not np.isfinite(distances_by["extended"]).any():
        return None
    recalibrated, extended = distances_by["recalibrated"], distances_by["extended"]
    return Gain(
        kind=kind,
        groups=len(folds),
        **distances_by,
        folds=choice.folds,
        excluded=int((choice.counted & ~choice.fit.used).sum()),
        gross_errors=int((choice.fit.excluded & ~choice.counted).sum()),
        interval=_interval(recalibrated, extended, choice.folds, rng),
    )


def _interval(
    recalibrated: Array, extended: Array, folds: Index, rng: np.random.Generator
) -> tuple[float, float]:
    """The 95 % interval of the gain, by distances (n,) [m] of resampled folds."""
    squares = np.square(np.stack([recalibrated, extended]))
    fold_numbers = np.unique(folds[np.isfinite(extended)])
    sums_of_folds = np.array(
        [np.nansum(squares[:, folds == number], axis=1) for number in fold_numbers]
    )
    resampled_folds = rng.integers(0, len(sums_of_folds), (RESAMPLES, len(sums_of_folds)))
    recalibrated_sum, extended_sum = sums_of_folds[resampled_folds].sum(axis=1).T
    gains = 1.0 - np.sqrt(extended_sum / recalibrated_sum)
    low, high = np.quantile(gains, [0.025, 0.975]).tolist()
    return low, high


class Brought(NamedTuple):
    """Gain in RMS on held-out records by one cause, and its 95 % interval."""

    gain: float
    low: float
    high: float


def cause_gain(choice: Choice, folds: list[Fold], block: int) -> Brought | None:
    """By how much a cause lowers the RMS of held-out records, each distance over its own noise.

    Every fold is predicted by the others with and without the block. The squares that it saves are
    a ratio of sums over the folds, with an interval by Student's t (Cochran 1977, 6.4). None if too
    few folds say something of it, as of a group that is left out whole.
    """
    if not folds or choice.in_one_fold(block):
        return None
    variance = np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    sums_of_folds = []
    for fold in folds:
        if np.isfinite(fold.by_median).any():
            distances_of_both = np.stack([fold.by_median, fold.without[block]])
            relative_squares = np.square(distances_of_both) / variance[fold.rows]
            sums_of_folds.append(np.nansum(relative_squares, axis=1))
    count = len(sums_of_folds)
    if count < THRESHOLDS.fewest_groups:
        return None
    sums_with, sums_without = np.array(sums_of_folds).T
    sum_without = sums_without.sum()
    ratio = float(sums_with.sum() / sum_without)
    squared_scatter = np.sum((sums_with - ratio * sums_without) ** 2)
    u = np.sqrt(count / (count - 1) * squared_scatter) / sum_without
    half_width = u * float(scipy.special.stdtrit(count - 1, 0.975))
    ratios = np.array([ratio, ratio + half_width, ratio - half_width])
    gains = 1.0 - np.sqrt(np.maximum(ratios, 0.0))
    return Brought(*gains.tolist())
