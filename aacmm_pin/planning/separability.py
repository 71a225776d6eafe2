"""A plan for all causes at once: which pairs records distinguish, and which no posture
distinguishes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, permutations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.candidate_design import Situation
from aacmm_pin.planning.detection_power import SAME_FRACTION, UNDETECTABLE, Size, alone, distance
from aacmm_pin.planning.measurement_conditions import possible_conditions
from aacmm_pin.planning.measurement_sheet import plan_of
from aacmm_pin.planning.result import MeasurementPlan, Tried
from aacmm_pin.planning.search import SequentialDesign, d_optimality, t_optimality
from aacmm_pin.planning.task import Task

HOPELESS = 1.0
"""A pair whose T would be smaller than this with random records gets no record of its own."""
LEAST_T = 10.8
"""T from which two causes of known values are distinguished with probability 0.95: ``Φ(√T/2)``."""

Pair = tuple[int, int]


def for_all(
    task: Task, postures: Measurements, records: int, rng: np.random.Generator, steps: Iterable[int]
) -> MeasurementPlan:
    """The plan for every pair of causes, each of typical magnitude: half of the records for all,
    the others for the worst pairs.

    Its ``pairs`` are all that would be detected, worst first; ``told`` where T suffices.
    ``why_not``: the two have ``the same`` effect in every posture, or it is ``too small`` for so
    many records; else "". See :func:`pairwise_discrimination.for_two`.

    Raises:
        AacmmError: fewer than two causes would be detected.
    """
    options = [*possible_conditions(task.model, task.causes, task.temperature)]
    set_up = [option for option in options if not option.changes_arm][-1]  # every condition varied
    situation = Situation.of(task, set_up, postures, rng)
    others = {
        option.words[-1]: Situation.of(task, option, postures, rng).triangle(None)
        for option in options
        if option.changes_arm
    }
    blocks = situation.layout.blocks
    whole = situation.triangle(None)
    undetectable = {k for k, block in enumerate(blocks) if _is_undetectable(whole, block)}
    all_pairs = distances(whole, blocks)
    every = {pair: both for pair, both in all_pairs.items() if not undetectable & set(pair)}
    if not every:
        raise AacmmError(
            "a diagnosis of this plan would detect fewer than two causes; expected two or more; "
            "plan more records, or add columns"
        )
    same = {pair for pair, (_, part) in every.items() if part <= SAME_FRACTION}
    needed = HOPELESS * situation.pool.n / records
    open_ = {pair for pair, (t, _) in every.items() if pair not in same and t >= needed}
    chosen = _chosen(situation, records, open_, steps)
    planned = distances(situation.triangle(chosen), blocks)
    after = {pair: planned[pair][0] for pair in every}
    why_not = dict.fromkeys(every, "too small")
    why_not |= dict.fromkeys(open_, "") | dict.fromkeys(same, "the same")
    labels = [cause.label for cause in task.causes]
    pairs = _table(after, why_not, labels)
    worst = min(open_ or set(every) - same or set(every), key=lambda pair: after[pair])
    one, other = (task.causes[k] for k in worst)
    draws = int(rng.integers(2**32))
    sizes = (Size.of(one), Size.of(other))
    power = situation.power(chosen, worst, sizes, draws)
    before = situation.power([], worst, sizes, draws) if situation.before else None
    told = Note("pairs_told_apart", {"told": int(pairs["told"].sum()), "pairs": len(pairs)})
    notes = (told, *_notes(undetectable, same, labels, others, blocks))
    found = {"split": (one, other), "before": before, "after": power, "pairs": pairs}
    tried = (Tried(str(set_up), power),)
    return plan_of(task, situation, chosen, notes, tried=tried, **found)


def _table(
    distance_of: Mapping[Pair, float], why_not: Mapping[Pair, str], labels: Sequence[str]
) -> pd.DataFrame:
    """One row a pair, the worst first."""
    rows = []
    for pair, t in distance_of.items():
        one, other = (labels[k] for k in pair)
        rows.append((one, other, t, t >= LEAST_T, why_not[pair]))
    table = pd.DataFrame(rows, columns=["cause", "other", "T", "told", "why_not"])
    return table.sort_values("T", ignore_index=True)


def _chosen(
    situation: Situation, records: int, open_: set[Pair], steps: Iterable[int]
) -> list[int]:
    """Numbers of records of the pool: those that determine everything best, then each for the
    ``open_`` pair that is distinguished worst.
    """
    layout = situation.layout
    typical = np.zeros(layout.width)
    typical[layout.nuisances :] = 1.0
    choice = SequentialDesign(
        situation.rows, situation.known.T @ situation.known + np.diag(typical)
    )
    for step in steps:
        if step < (records + 1) // 2 or not open_:
            choice.run(1, d_optimality)
            continue
        now = distances(situation.triangle(choice.taken), layout.blocks)
        choice.take(_best_for(min(open_, key=lambda pair: now[pair][0]), situation, choice))
    return choice.taken


def distances(r: Array, blocks: tuple[slice, ...]) -> dict[Pair, tuple[float, float]]:
    """Of every pair of blocks, each of typical magnitude: the smaller T, and the part of an effect
    that the other cause cannot have.
    """
    found = {}
    for pair in combinations(range(len(blocks)), 2):
        both = []
        for one, other in permutations(pair):
            mine = blocks[one]
            its = blocks[other]
            size = np.eye(mine.stop - mine.start)
            t = distance(r, mine, its, size)
            whole = alone(r, mine, size)
            both.append((t, t / whole if whole > 0 else 0.0))
        found[pair] = (min(t for t, _ in both), min(part for _, part in both))
    return found


def _best_for(pair: Pair, situation: Situation, choice: SequentialDesign) -> int:
    """The record that distinguishes one pair best, if only these two causes act."""
    layout = situation.layout
    pool = situation.rows
    first = layout.nuisances
    blocks = [layout.columns(cause) for cause in pair]
    columns = np.concatenate([np.arange(first), *blocks])
    taken = pool[choice.taken].reshape(-1, layout.width)
    information = situation.start + taken.T @ taken
    alone = SequentialDesign(pool[:, :, columns], information[np.ix_(columns, columns)])
    one, other = (len(block) for block in blocks)
    sizes = (Size(np.eye(one)), Size(np.eye(other)))
    worth = t_optimality(first + np.arange(one), first + one + np.arange(other), sizes)(alone)
    return int(np.argmax(np.where(choice.free, worth, -np.inf)))


def _notes(
    undetectable: set[int],
    same: set[Pair],
    labels: list[str],
    others: dict[str, Array],
    blocks: tuple[slice, ...],
) -> Iterator[Note]:
    """Causes that no posture detects or distinguishes, and which of the ``others``, set-ups with
    their triangles, would.
    """
    for k in sorted(undetectable):
        helps = next(
            (words for words, r in others.items() if not _is_undetectable(r, blocks[k])), None
        )
        data = {"cause": labels[k], "set_up": helps}
        yield Note("cause_never_shows" if helps is None else "cause_shows_otherwise", data)
    for one, other in sorted(same):
        both = blocks[one], blocks[other]
        separating = (
            words
            for words, r in others.items()
            if distances(r, both)[0, 1][1] > SAME_FRACTION and not _is_undetectable(r, *both)
        )
        helps = next(separating, None)
        data = {"one": labels[one], "other": labels[other], "set_up": helps}
        yield Note("pair_never_told" if helps is None else "pair_told_otherwise", data)


def _is_undetectable(r: Array, *blocks: slice) -> bool:
    """Whether one of the blocks has no detectable effect."""
    for block in blocks:
        typical = np.eye(block.stop - block.start)
        if alone(r, block, typical) <= UNDETECTABLE:
            return True
    return False
