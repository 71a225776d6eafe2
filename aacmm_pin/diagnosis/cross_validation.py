"""Leave parts of the records out, explore and fit with the rest, predict the part: what the causes are worth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.display import Shown
from aacmm_pin._support.progress import Progress
from aacmm_pin.calibration.cross_validation import FEWEST_GROUPS, Mask, distances, left_out_in_turn, rms
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.exploration import explored_from
from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace

RESAMPLES = 2000
"""Draws of parts with which the 95 % interval of the gain is found."""
LEAST_GAIN = 0.005
"""A gain that is not larger is shown as 0 %, and is none."""


@dataclass(frozen=True, eq=False)
class Gain(Shown):
    """Residuals of records left out in turn, by groups.

    Attributes:
        kind: ``seats`` or ``blocks`` of joint space.
        groups: how many parts were left out in turn.
        simulation, recalibrated, extended: distances of the records by each model (n,) [m]; nan where there is none. A
            rotation from a stated orientation is part of it, by :attr:`Fit.lever`.
        smooth: the same with the discrepancy (n,) [m].
        part: part of each record (n,).
        excluded: how many of the records were excluded from the extended arm, and count here, for the recalibrated arm alone
            does not exclude them.
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
        return 1.0 - rms(self.extended) / rms(self.recalibrated)

    @property
    def beyond_doubt(self) -> bool:
        """Whether the extended arm predicts held-out records better, by the whole interval."""
        return self.interval[0] > LEAST_GAIN

    def of_nothing(self) -> Gain:
        """The same where all records together name nothing, whatever some parts did: both arms are one."""
        return replace(self, extended=self.recalibrated, interval=(0.0, 0.0))

    @property
    def smooth_gain(self) -> float:
        """1 - RMS(smooth)/RMS(extended): what the discrepancy adds to the causes."""
        return 1.0 - rms(self.smooth) / rms(self.extended)


class Training:
    """The posterior of all records but those of one part, and what it predicts of these."""

    def __init__(self, choice: Choice, number: int) -> None:
        self.choice, self.number = choice, number
        amplitude = choice.posterior.left.base.amplitude
        whole = choice.posterior.space
        gram = choice.held.without(number)
        self.space = ModelSpace(whole.candidates, gram, whole.stated, tuple({0.0: None, amplitude: None}))
        self._found: dict[tuple[Blocks, int], Array] = {}

    @cached_property
    def chosen(self) -> Blocks:
        """The median probability model of the other records, explored from nothing and from that of all."""
        return explored_from(self.space, [(), self.choice.posterior.median]).median

    def predicted(self, blocks: Blocks, background: bool = False) -> Array:
        """Distances of the part's records with these blocks, fitted to the others [m].

        What is stated of known causes holds exactly where their change is not among the blocks, or the other records would
        change them all the same.
        """
        amplitude = len(self.space.amplitudes) - 1 if background else 0
        if (blocks, amplitude) not in self._found:
            state = self.space.marginal(blocks).best._replace(amplitude=amplitude)
            rows, records = self.choice.of_part[self.number]
            tips = self.space.conditional(state, as_stated=True).tips(rows)
            self._found[blocks, amplitude] = distances(records, tips, lever=self.choice.fit.lever)
        return self._found[blocks, amplitude]


def gain_of(
    choice: Choice, trained: list[Training], before: Fit, kind: str, rng: np.random.Generator, progress: Progress = None
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
        None where no part that is left out has anything to be compared with, such as one record only of each unknown seat.
    """
    counted, chosen, candidates = choice.counted, [], choice.candidates
    of_part = {each.number: each for each in trained}
    part = np.where(np.isin(choice.parts, [*of_part]), choice.parts, -1)

    def predict(number: int, _: Mask) -> list[Array]:
        training = of_part[number]
        causes = tuple(k for k in training.chosen if candidates.is_cause(k))
        chosen.append(tuple(candidates.design.names[candidates.owner(k)] for k in training.chosen))
        rows, records = choice.of_part[number]
        simulation = distances(records, before.solution.point.prediction.poses[rows], lever=choice.fit.lever)
        fitted = training.predicted(()), training.predicted(causes), training.predicted(training.chosen, background=True)
        return [simulation, *fitted]

    simulation, recalibrated, extended, smooth = left_out_in_turn(part, counted & (part >= 0), predict, kind, progress)
    if not np.isfinite(extended).any():
        return None
    return Gain(
        kind,
        len(trained),
        simulation,
        recalibrated,
        extended,
        smooth,
        choice.parts,
        int((counted & ~choice.fit.used).sum()),
        int((choice.fit.excluded & ~counted).sum()),
        tuple(chosen),
        _interval(recalibrated, extended, choice.parts, rng),
    )


class Brought(NamedTuple):
    """What one cause brings on held-out records: its part of the gain in RMS, and the 95 % interval of that."""

    gain: float
    low: float
    high: float


def brought(choice: Choice, trained: list[Training], block: int) -> Brought | None:
    """By how much one of the causes lowers the RMS of held-out records, each distance over its own noise.

    Every part is predicted by the others with and without the block. The squares that it saves are a ratio of sums over the
    parts, whose interval is Student's t for as few parts as there are (Cochran 1977, 6.4).

    Returns:
        None where fewer than :data:`FEWEST_GROUPS` parts say something of it, such as of a group that is left out whole.
    """
    if choice.in_one_part(block):
        return None
    pairs = np.array([*_squares(choice, trained, block)])
    count = len(pairs)
    if count < FEWEST_GROUPS:
        return None
    left, whole = pairs.T
    share = float(left.sum() / whole.sum())
    error = float(np.sqrt(count / (count - 1) * np.sum((left - share * whole) ** 2)) / whole.sum())
    reach = error * float(scipy.special.stdtrit(count - 1, 0.975))
    gain, low, high = (1.0 - np.sqrt(max(share + off, 0.0)) for off in (0.0, reach, -reach))
    return Brought(float(gain), float(low), float(high))


def _squares(choice: Choice, trained: list[Training], block: int) -> Iterator[tuple[float, float]]:
    """Of each part, the sum of squares of its distances over their noise, with a block and without."""
    whole = choice.posterior.median
    without = tuple(k for k in whole if k != block)
    weight = 1.0 / np.trace(choice.fit.residual_noise[:, :3, :3], axis1=1, axis2=2)
    for training in trained:
        rows, _ = choice.of_part[training.number]
        found = [training.predicted(blocks) for blocks in (whole, without)]
        if np.isfinite(found[0]).any():
            first, second = (float(np.nansum(d**2 * weight[rows])) for d in found)
            yield first, second


def _interval(recalibrated: Array, extended: Array, part: Index, rng: np.random.Generator) -> tuple[float, float]:
    sums = []
    for number in np.unique(part):
        mine = part == number
        if np.isfinite(extended[mine]).any():
            sums.append([np.nansum(recalibrated[mine] ** 2), np.nansum(extended[mine] ** 2)])
    table = np.array(sums)
    drawn = table[rng.integers(0, len(table), (RESAMPLES, len(table)))].sum(axis=1)
    gains = 1.0 - np.sqrt(drawn[:, 1] / drawn[:, 0])
    low, high = np.quantile(gains, [0.025, 0.975])
    return float(low), float(high)
