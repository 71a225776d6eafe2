"""Leave parts of the records out, explore and fit with the rest, predict the part: what the causes
are worth.
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
from aacmm_pin.diagnosis.exploration import explored_from
from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

RESAMPLES = 2000
"""Draws of parts with which the 95 % interval of the gain is found."""


@dataclass(frozen=True, eq=False)
class Gain(Shown):
    """Residuals of records left out in turn, by groups.

    Attributes:
        kind: ``seats`` or ``blocks`` of joint space.
        groups: how many parts were left out in turn.
        simulation, recalibrated, extended: distances of the records by each model (n,) [m]; nan
            where there is none. A rotation from a stated orientation is part of it, by
            :attr:`Fit.lever`.
        smooth: the same with the discrepancy (n,) [m].
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
    smooth: Array
    part: Index
    excluded: int
    gross_errors: int
    chosen: tuple[tuple[str, ...], ...]
    interval: tuple[float, float]

    @property
    def gain(self) -> float:
        """1 - RMS(extended)/RMS(recalibrated)."""
        return _less(self.extended, self.recalibrated)

    @property
    def beyond_doubt(self) -> bool:
        """Whether the extended arm predicts held-out records better, by the whole interval."""
        return self.interval[0] > THRESHOLDS.least_gain

    def of_nothing(self) -> Gain:
        """The same where all records together name nothing, whatever some parts did: both arms are
        one.
        """
        return replace(self, extended=self.recalibrated, interval=(0.0, 0.0))

    @property
    def smooth_gain(self) -> float:
        """1 - RMS(smooth)/RMS(extended): what the discrepancy adds to the causes."""
        return _less(self.smooth, self.extended)


def _less(after: Array, before: Array) -> float:
    """By which part the RMS of distances is lower than that of others."""
    return 1.0 - rms(after) / rms(before)


class Training:
    """The posterior of all records but those of one part, and what it predicts of these."""

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
        """The median probability model of the other records, explored from nothing and from that of
        all.
        """
        starts = [(), self.choice.posterior.median]
        return explored_from(self.space, starts).median

    @property
    def causes(self) -> Blocks:
        """The causes among what was chosen."""
        is_cause = self.space.candidates.is_cause
        return tuple(filter(is_cause, self.chosen))

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
        smooth = self.predicted(self.chosen, background=True)
        return [self._distances(poses), recalibrated, extended, smooth]

    def _distances(self, poses: Array) -> Array:
        return distances(self.records, poses, lever=self.choice.fit.lever)


def gain_of(
    choice: Choice,
    trained: list[Training],
    before: Fit,
    kind: str,
    rng: np.random.Generator,
    progress: Progress = None,
) -> Gain | None:
    """Leave out every part in turn; choose and fit with the rest; predict it.

    Records are predicted as in :attr:`Choice.counted`: excluded ones too, but for gross errors.

    Args:
        choice: what was found with all records; only its columns and inner products are used.
        trained: of each part that can be left out.
        before: the arm as it was, set-up fitted.
        kind: of the parts, for the record.
        rng: for the interval.
        progress: whether to show a bar, or a function that wraps the parts.

    Returns:
        None where no part that is left out has anything to be compared with, such as one record
        only of each unknown seat.
    """
    of_part = {training.number: training for training in trained}
    part = choice.parts
    counted = choice.counted & np.isin(part, [*of_part])

    def predict(number: int, _: Mask) -> list[Array]:
        return of_part[number].by_models(before)

    simulation, recalibrated, extended, smooth = left_out_in_turn(
        part, counted, predict, kind, progress
    )
    if not np.isfinite(extended).any():
        return None
    excluded = choice.counted & ~choice.fit.used
    gross_errors = choice.fit.excluded & ~choice.counted
    chosen = [of_part[number].labels for number in np.unique(part[counted]).tolist()]
    return Gain(
        kind=kind,
        groups=len(trained),
        simulation=simulation,
        recalibrated=recalibrated,
        extended=extended,
        smooth=smooth,
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
    before, after = table[draws].sum(axis=1).T
    low, high = np.quantile(1.0 - np.sqrt(after / before), [0.025, 0.975])
    return float(low), float(high)


class Brought(NamedTuple):
    """What one cause brings on held-out records: its part of the gain in RMS, and the 95 % interval
    of that.
    """

    gain: float
    low: float
    high: float


def brought(choice: Choice, trained: list[Training], block: int) -> Brought | None:
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
    squares = np.array([*_squares(choice, trained, block)])
    if len(squares) < THRESHOLDS.fewest_groups:
        return None
    share, u = _ratio(*squares.T)
    reach = u * float(scipy.special.stdtrit(len(squares) - 1, 0.975))
    gain, low, high = (1.0 - float(np.sqrt(max(share + off, 0.0))) for off in (0.0, reach, -reach))
    return Brought(gain, low, high)


def _ratio(upper: Array, lower: Array) -> tuple[float, float]:
    """Ratio of the sums of two quantities of every part (parts,), and its standard uncertainty."""
    count = len(lower)
    total = lower.sum()
    share = float(upper.sum() / total)
    scatter = np.sum((upper - share * lower) ** 2)
    u = np.sqrt(count / (count - 1) * scatter) / total
    return share, float(u)


def _squares(choice: Choice, trained: list[Training], block: int) -> Iterator[tuple[float, float]]:
    """Of each part, the sum of squares of its distances over their noise, with a block and
    without.
    """
    whole = choice.posterior.median
    without = tuple(k for k in whole if k != block)
    variance = np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    for training in trained:
        weight = 1.0 / variance[training.rows]
        left, of_rest = (training.predicted(blocks) for blocks in (whole, without))
        if np.isfinite(left).any():
            yield float(np.nansum(left**2 * weight)), float(np.nansum(of_rest**2 * weight))
