"""Cross-validation of a diagnosis: leave out one part of the records after the other, choose the
causes and fit them with the other records, and predict the part.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.display import Shown
from aacmm_pin._support.progress import Progress
from aacmm_pin.calibration import Fit, rms
from aacmm_pin.calibration.cross_validation import distances, left_out_in_turn
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.exploration import explore_from
from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

RESAMPLES = 2000
"""Bootstrap resamples of the parts for the 95 % interval of the gain."""


@dataclass(frozen=True, eq=False)
class Gain(Shown):
    """Distances of held-out records by each model.

    Attributes:
        kind: ``seats`` or ``blocks`` of joint space.
        groups: how many parts were left out in turn.
        simulation, recalibrated, extended: distances of the records by each model (n,) [m]; nan
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
    simulation: Array
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


class Fold:
    """The posterior of all records but those of one part, and the distances that it predicts for
    this part.
    """

    def __init__(self, choice: Choice, number: int) -> None:
        self.choice, self.number = choice, number
        self.rows, self.records = choice.of_part[number]
        whole = choice.posterior.space
        gram = choice.by_part.without(number)
        amplitudes = tuple(dict.fromkeys((0.0, choice.posterior.median_model.base.amplitude)))
        self.space = ModelSpace(whole.candidates, gram, whole.stated, amplitudes)
        self._found: dict[tuple[Blocks, int], Array] = {}

    @cached_property
    def chosen(self) -> Blocks:
        """The median probability model of the other records, explored from no cause and from the
        median probability model of all records.
        """
        starts = [(), self.choice.posterior.median]
        return explore_from(self.space, starts).median

    @property
    def causes(self) -> Blocks:
        """The causes among what was chosen."""
        return tuple(filter(self.space.candidates.is_cause, self.chosen))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of what was chosen."""
        candidates = self.space.candidates
        return tuple(candidates.design.names[candidates.owner(k)] for k in self.chosen)

    def predicted(self, blocks: Blocks, background: bool = False) -> Array:
        """Distances of the part's records with these blocks, fitted to the others [m].

        What is stated of known causes holds exactly where their change is not among the blocks, or
        the other records would change them all the same.
        """
        amplitude = len(self.space.amplitudes) - 1 if background else 0
        if (blocks, amplitude) not in self._found:
            state = self.space.marginal(blocks).best._replace(amplitude=amplitude)
            tips = self.space.conditional(state, as_stated=True).tips(self.rows)
            self._found[blocks, amplitude] = self._distances(tips)
        return self._found[blocks, amplitude]

    def by_models(self, before: Fit) -> list[Array]:
        """Distances of the part's records by the arm as it was, recalibrated, extended, with the
        discrepancy too [m].
        """
        poses = before.point.prediction.poses[self.rows]
        recalibrated = self.predicted(())
        extended = self.predicted(self.causes)
        with_discrepancy = self.predicted(self.chosen, background=True)
        return [self._distances(poses), recalibrated, extended, with_discrepancy]

    def _distances(self, poses: Array) -> Array:
        return distances(self.records, poses, lever=self.choice.fit.lever)


def gain_of(
    choice: Choice,
    folds: list[Fold],
    before: Fit,
    kind: str,
    rng: np.random.Generator,
    progress: Progress = None,
) -> Gain | None:
    """Leave out every part in turn; choose and fit with the rest; predict it.

    Records are predicted as in :attr:`Choice.counted`: excluded ones too, but for gross errors.

    Args:
        choice: what was found with all records; only its columns and inner products are used.
        folds: one for each part that can be left out.
        before: the arm as it was, set-up fitted.
        kind: of the parts, for the record.
        rng: for the interval.
        progress: whether to show a bar, or a function that wraps the parts.

    Returns:
        None where no part that is left out has anything to be compared with, such as one record
        only of each unknown seat.
    """
    fold_of_part = {fold.number: fold for fold in folds}
    part = choice.parts
    counted = choice.counted & np.isin(part, [*fold_of_part])

    def predict(number: int, _: Mask) -> list[Array]:
        return fold_of_part[number].by_models(before)

    simulation, recalibrated, extended, with_discrepancy = left_out_in_turn(
        part, counted, predict, kind, progress
    )
    if not np.isfinite(extended).any():
        return None
    excluded = choice.counted & ~choice.fit.used
    gross_errors = choice.fit.excluded & ~choice.counted
    chosen = [fold_of_part[number].labels for number in np.unique(part[counted]).tolist()]
    return Gain(
        kind=kind,
        groups=len(folds),
        simulation=simulation,
        recalibrated=recalibrated,
        extended=extended,
        with_discrepancy=with_discrepancy,
        part=part,
        excluded=int(excluded.sum()),
        gross_errors=int(gross_errors.sum()),
        chosen=tuple(chosen),
        interval=_interval(recalibrated, extended, part, rng),
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
    if choice.in_one_part(block):
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
    blocks = choice.posterior.median
    other_blocks = tuple(k for k in blocks if k != block)
    variance = np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    for fold in folds:
        weight = 1.0 / variance[fold.rows]
        with_block = weight * fold.predicted(blocks) ** 2
        without_block = weight * fold.predicted(other_blocks) ** 2
        if np.isfinite(with_block).any():
            yield float(np.nansum(with_block)), float(np.nansum(without_block))
