"""Cross-validation of a diagnosis: leave out one part of the records after the other, choose the
causes and fit them with the other records, and predict the part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
"""Bootstrap resamples of the parts for the 95 % interval of the gain."""


@dataclass(frozen=True, eq=False)
class Gain(Shown):
    """Distances of held-out records by each model.

    Attributes:
        kind: ``seats`` or ``blocks`` of joint space.
        groups: how many parts were left out in turn.
        nominal, recalibrated, extended: distances of the records by each model (n,) [m]; nan
            where there is none. A rotation from a stated orientation is part of it, by
            :attr:`Fit.lever`.
        with_discrepancy: distances by the extended arm with the discrepancy (n,) [m].
        part: part of each record (n,).
        excluded: how many of the records were excluded from the extended arm, and count here, for
            the recalibrated arm alone does not exclude them.
        gross_errors: how many do not count, for both arms exclude them.
        chosen: labels that were chosen without each part.
        interval: 95 % interval of the gain, by resampling the parts.
    """

    kind: str
    groups: int
    nominal: Array
    recalibrated: Array
    extended: Array
    with_discrepancy: Array
    part: Index
    excluded: int
    gross_errors: int
    chosen: tuple[tuple[str, ...], ...]
    interval: tuple[float, float]

    @property
    def gain(self) -> float:
        """1 - RMS(extended)/RMS(recalibrated)."""
        return _relative_reduction(self.extended, self.recalibrated)

    @property
    def beyond_doubt(self) -> bool:
        """Whether the extended arm predicts held-out records better, by the whole interval."""
        return self.interval[0] > THRESHOLDS.least_gain

    def without_causes(self) -> Gain:
        """The gain if all records together name no cause, whatever single parts name: the extended
        arm is then the recalibrated arm.
        """
        return replace(self, extended=self.recalibrated, interval=(0.0, 0.0))

    @property
    def discrepancy_gain(self) -> float:
        """1 - RMS(with discrepancy)/RMS(extended): what the discrepancy adds to the causes."""
        return _relative_reduction(self.with_discrepancy, self.extended)


def _relative_reduction(after: Array, before: Array) -> float:
    """1 - RMS(after)/RMS(before) of distances [m]."""
    return 1.0 - rms(after) / rms(before)


@dataclass(frozen=True, eq=False)
class Fold:
    """Distances of the records of one part, as all other records predict them.

    Attributes:
        rows: numbers of the records.
        chosen: labels of the causes and covariates of the median probability model of the others.
        nominal, recalibrated, extended, with_discrepancy: distances by each model (m,) [m].
        whole: by the median probability model of all records, fitted to the others (m,) [m].
        without: the same without one of its causes, by the number of its block.
    """

    rows: Index
    chosen: tuple[str, ...]
    nominal: Array
    recalibrated: Array
    extended: Array
    with_discrepancy: Array
    whole: Array
    without: Mapping[int, Array]


def folds_of(choice: Choice, before: Fit, kind: str, progress: Progress) -> list[Fold]:
    """Leave out every part in turn; choose and fit with the rest; predict it.

    Args:
        choice: what was found with all records.
        before: the arm as it was, set-up fitted.
        kind: of the parts, for the progress bar.
        progress: whether to show a bar, or a function that wraps the parts.
    """
    of_all = choice.products_of_parts
    numbers = np.unique(choice.parts[choice.counted]).tolist()
    with watched(numbers, progress, f"held-out {kind}", "part") as parts:
        folds = [_fold(choice, before, of_all, number) for number in parts]
    return [fold for fold in folds if fold is not None]


def _fold(choice: Choice, before: Fit, whole: Gram, number: int) -> Fold | None:
    """One of them; None where the part has nothing to be compared with."""
    inside = choice.parts == number
    part = gram_of(choice.design, choice.noise, [inside])
    if not part.free:
        return None
    space = choice.posterior.space
    amplitudes = tuple(dict.fromkeys((0.0, choice.posterior.median_model.base.amplitude)))
    others = ModelSpace(space.candidates, whole.without(part), space.stated, amplitudes)
    rows = np.flatnonzero(choice.counted & inside)
    records = choice.fit.problem.measurements.take(rows)
    median = choice.posterior.median

    def distances_of(poses: Array) -> Array:
        return distances(records, poses, lever=choice.fit.lever)

    def predicted(state: ModelState, background: bool = False) -> Array:
        """What is stated of known causes holds exactly where their change is not among the blocks,
        or the other records would change them all the same.
        """
        amplitude = len(others.amplitudes) - 1 if background else 0
        alike = state._replace(amplitude=amplitude)
        return distances_of(others.conditional(alike, as_stated=True).tips(rows))

    chosen = explore_from(others, median).median
    of_chosen, of_median = (others.marginal(blocks).best for blocks in (chosen, median))
    candidates = others.candidates
    names = tuple(candidates.design.names[candidates.owner(k)] for k in chosen)
    return Fold(
        rows=rows,
        chosen=names,
        nominal=distances_of(before.point.prediction.poses[rows]),
        recalibrated=predicted(of_chosen.of(())),
        extended=predicted(of_chosen.of([*filter(candidates.is_cause, chosen)])),
        with_discrepancy=predicted(of_chosen, background=True),
        whole=predicted(of_median),
        without={k: predicted(of_median.of(without_block(median, k))) for k in choice.causes},
    )


def gain_of(
    choice: Choice, folds: Sequence[Fold], kind: str, rng: np.random.Generator
) -> Gain | None:
    """The distances of all parts together.

    Records are predicted as in :attr:`Choice.counted`: excluded ones too, but for gross errors.

    Args:
        choice: what was found with all records.
        folds: one for each part that can be left out.
        kind: of the parts, for the record.
        rng: for the interval.

    Returns:
        None where no part that is left out has anything to be compared with, such as one record
        only of each unknown seat.
    """
    models = ("nominal", "recalibrated", "extended", "with_discrepancy")
    by_model = {model: np.full(choice.parts.size, np.nan) for model in models}
    for fold in folds:
        for model, distances_of_model in by_model.items():
            distances_of_model[fold.rows] = getattr(fold, model)
    if not np.isfinite(by_model["extended"]).any():
        return None
    excluded = choice.counted & ~choice.fit.used
    gross_errors = choice.fit.excluded & ~choice.counted
    return Gain(
        kind=kind,
        groups=len(folds),
        **by_model,
        part=choice.parts,
        excluded=int(excluded.sum()),
        gross_errors=int(gross_errors.sum()),
        chosen=tuple(fold.chosen for fold in folds),
        interval=_interval(by_model["recalibrated"], by_model["extended"], choice.parts, rng),
    )


def _interval(
    recalibrated: Array, extended: Array, part: Index, rng: np.random.Generator
) -> tuple[float, float]:
    """95 % interval of the gain by resampling the parts, of distances (n,) [m]."""
    squares = []
    for number in np.unique(part):
        of_both = np.stack([recalibrated, extended])[:, part == number]
        if np.isfinite(of_both[1]).any():
            squares.append(np.nansum(np.square(of_both), axis=1))
    table = np.array(squares)
    draws = rng.integers(0, len(table), (RESAMPLES, len(table)))
    recalibrated_sum, extended_sum = table[draws].sum(axis=1).T
    gains = 1.0 - np.sqrt(extended_sum / recalibrated_sum)
    low, high = np.quantile(gains, [0.025, 0.975]).tolist()
    return low, high


class Brought(NamedTuple):
    """What one cause brings on held-out records: its part of the gain in RMS, and the 95 % interval
    of that.
    """

    gain: float
    low: float
    high: float


def cause_gain(choice: Choice, folds: list[Fold], block: int) -> Brought | None:
    """By how much one of the causes lowers the RMS of held-out records, each distance over its own
    noise.

    Every part is predicted by the others with and without the block. The squares that it saves are
    a ratio of sums over the parts, whose interval is Student's t for as few parts as there are
    (Cochran 1977, 6.4).

    Returns:
        None where too few parts say something of it, such as of a group that is left out whole.
    """
    if not folds or choice.in_one_part(block):
        return None
    squares = np.array([*_squares(choice, folds, block)])
    if len(squares) < THRESHOLDS.fewest_groups:
        return None
    share, u = _ratio(*squares.T)
    half_width = u * float(scipy.special.stdtrit(len(squares) - 1, 0.975))
    shares = np.array([share, share + half_width, share - half_width])
    gains = 1.0 - np.sqrt(np.maximum(shares, 0.0))
    return Brought(*gains.tolist())


def _ratio(numerator: Array, denominator: Array) -> tuple[float, float]:
    """Ratio of the sums of two quantities of every part (parts,), and its standard uncertainty."""
    count = len(denominator)
    total = denominator.sum()
    share = float(numerator.sum() / total)
    scatter = np.sum((numerator - share * denominator) ** 2)
    u = np.sqrt(count / (count - 1) * scatter) / total
    return share, float(u)


def _squares(choice: Choice, folds: list[Fold], block: int) -> Iterator[tuple[float, float]]:
    """For each part the sum of squares of its distances over their noise, with ``block`` and
    without.
    """
    variance = np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    for fold in folds:
        weight = 1.0 / variance[fold.rows]
        with_block = weight * fold.whole**2
        without_block = weight * fold.without[block] ** 2
        if np.isfinite(with_block).any():
            yield float(np.nansum(with_block)), float(np.nansum(without_block))
