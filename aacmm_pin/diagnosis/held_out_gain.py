"""Cross-validation of a diagnosis: choose and fit causes without one fold of the records after the
other, and predict the fold.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array, Index
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


HeldOut = Mapping[str | int, Array]
"""Distances of held-out records by each model, see :func:`held_out_distances`."""


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


def held_out_distances(choice: Choice, nominal: Fit, kind: str, progress: Progress) -> HeldOut:
    """Leave out every fold in turn; choose and fit with the others; predict it.

    Args:
        nominal: the arm as stated, set-up fitted.

    Returns:
        Distances of the records (n,) [m], nan for none, by each of :data:`PREDICTED_BY`; by
        ``"median"``, the median probability model of all records, fitted to the others; and by this
        without one of its causes, by the number of its block.
    """
    gram_of_all = choice.gram_of_folds
    numbers = np.unique(choice.folds[choice.counted]).tolist()
    held_out = defaultdict[str | int, Array](lambda: np.full(choice.folds.size, np.nan))
    with watched(numbers, progress, f"held-out {kind}", "part") as watched_numbers:
        for number in watched_numbers:
            rows = np.flatnonzero(choice.counted & (choice.folds == number))
            poses_by_model = _fold(choice, gram_of_all, number, rows)
            if poses_by_model:
                poses_by_model["nominal"] = nominal.point.prediction.poses[rows]
            records = choice.fit.problem.measurements.take(rows)
            for model, poses in poses_by_model.items():
                held_out[model][rows] = distances(records, poses, lever=choice.fit.lever)
    return held_out


def _fold(choice: Choice, gram_of_all: Gram, fold: int, rows: Index) -> dict[str | int, Array]:
    """Choose and fit without the records of a fold, and predict the poses of some of these; empty
    if they have no more coordinates than unknown coordinates of seats.
    """
    gram_of_fold = gram_of(choice.design, choice.noise, [choice.folds == fold])
    if not gram_of_fold.free:
        return {}
    space, median_of_all = choice.posterior.space, choice.posterior.median
    amplitudes = tuple(dict.fromkeys((0.0, choice.posterior.median_model.base.amplitude)))
    gram_of_others = gram_of_all.without(gram_of_fold)
    space_of_others = ModelSpace(space.candidates, gram_of_others, space.stated, amplitudes)

    def predicted(state: ModelState, with_discrepancy: bool = False) -> Array:
        """Poses of the records by a state, fitted to the others. Known causes keep their stated
        values unless their change is among its blocks. With the discrepancy, it has the amplitude
        that all records give it; else none.
        """
        amplitude = len(space_of_others.amplitudes) - 1 if with_discrepancy else 0
        state_of_others = state._replace(amplitude=amplitude)
        return space_of_others.conditional(state_of_others, as_stated=True).tips(rows)

    chosen = space_of_others.marginal(explore_from(space_of_others, median_of_all).median).best
    median = space_of_others.marginal(median_of_all).best
    causes_chosen = [*filter(space.candidates.is_cause, chosen.blocks)]
    return {
        "recalibrated": predicted(chosen.of(())),
        "extended": predicted(chosen.of(causes_chosen)),
        "with_discrepancy": predicted(chosen, with_discrepancy=True),
        "median": predicted(median),
        **{k: predicted(median.of(without_block(median_of_all, k))) for k in choice.causes},
    }


def gain_of(choice: Choice, held_out: HeldOut, kind: str, rng: np.random.Generator) -> Gain | None:
    """The gain by :func:`held_out_distances`, of the records as in :attr:`Choice.counted`. None if
    no fold can be compared, as with one record of each unknown seat.
    """
    by_model = {model: held_out[model] for model in PREDICTED_BY if model in held_out}
    if not by_model or not np.isfinite(by_model["extended"]).any():
        return None
    sums_of_folds = _sums_of_folds(by_model["recalibrated"], by_model["extended"], choice.folds)
    return Gain(
        kind=kind,
        groups=len(sums_of_folds),
        **by_model,
        folds=choice.folds,
        excluded=int((choice.counted & ~choice.fit.used).sum()),
        gross_errors=int((choice.fit.excluded & ~choice.counted).sum()),
        interval=_interval(sums_of_folds, rng),
    )


def _sums_of_folds(before: Array, after: Array, folds: Index) -> Array:
    """Sums of the squares of distances (n,) before and after in each fold with any (folds, 2)."""
    squares = np.square(np.stack([before, after]))
    numbers = np.unique(folds[np.isfinite(after)])
    return np.array([np.nansum(squares[:, folds == number], axis=1) for number in numbers])


def _interval(sums_of_folds: Array, rng: np.random.Generator) -> tuple[float, float]:
    """The 95 % interval of the gain, by resampled folds; see :func:`_sums_of_folds`."""
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


def cause_gain(choice: Choice, held_out: HeldOut, block: int) -> Brought | None:
    """By how much a cause lowers the RMS of held-out records, each distance over its own noise.

    Every fold is predicted by the others with and without the block. The squares that it saves are
    a ratio of sums over the folds, with an interval by Student's t (Cochran 1977, 6.4). None if too
    few folds say something of it, as of a group that is left out whole.
    """
    if not held_out or choice.in_one_fold(block):
        return None
    noise = np.sqrt(np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2))
    without, median = held_out[block] / noise, held_out["median"] / noise
    sums_of_folds = _sums_of_folds(without, median, choice.folds)
    count = len(sums_of_folds)
    if count < THRESHOLDS.fewest_groups:
        return None
    sums_without, sums_with = sums_of_folds.T
    sum_without = sums_without.sum()
    ratio = float(sums_with.sum() / sum_without)
    squared_scatter = np.sum((sums_with - ratio * sums_without) ** 2)
    u = np.sqrt(count / (count - 1) * squared_scatter) / sum_without
    half_width = u * float(scipy.special.stdtrit(count - 1, 0.975))
    ratios = np.array([ratio, ratio + half_width, ratio - half_width])
    gains = 1.0 - np.sqrt(np.maximum(ratios, 0.0))
    return Brought(*gains.tolist())
