"""A plan for all causes at once: which pairs of them records tell apart, and which no posture will."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, pairwise, permutations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin.effects import Effect
from aacmm_pin.errors import AacmmError
from aacmm_pin.planning.detection_power import SAME, SILENT, Size, distance
from aacmm_pin.planning.search import Choosing, informing, telling
from aacmm_pin.planning.situation import Situation

HOPELESS = 1.0
"""A pair whose T would be smaller than this with random records gets no record of its own."""
TOLD = 10.8
"""T from which two causes of known size are told apart with odds of 0.95: ``Φ(√T/2)``."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What was chosen for all pairs.

    Attributes:
        chosen: numbers of records of the pool.
        worst: numbers of the causes that are told worst of those that can be told.
        pairs: every pair that shows, with its T, worst first; ``told`` where that suffices. ``why_not``: the two do
            ``the same`` in every posture, or what they do is ``too small`` for so many records; else "".
        notes: pairs that no posture tells apart, and what does.
    """

    chosen: list[int]
    worst: tuple[int, int]
    pairs: pd.DataFrame
    notes: tuple[str, ...]


def surveyed(
    situation: Situation,
    causes: tuple[Effect, ...],
    records: int,
    others: list[tuple[str, Array]],
    steps: Iterable[int],
) -> Survey:
    """Choose records for all pairs.

    Args:
        situation: the set-up and its pool.
        causes: of typical size.
        records: how many.
        others: other set-ups in words, with the triangle of their whole pool.
        steps: the records, perhaps wrapped to show progress.
    """
    layout, pool = situation.layout, situation.rows.records
    whole = situation.triangle(None)
    share = records / len(pool)
    silent = {k for k, block in enumerate(layout.blocks) if _silent(whole, block)}
    every = {pair: both for pair, both in distances(whole, layout.blocks).items() if not silent & set(pair)}
    same = {pair for pair, (_, part) in every.items() if part <= SAME}
    open_ = {pair for pair, (t, _) in every.items() if pair not in same and t * share >= HOPELESS}
    information = situation.known.T @ situation.known
    typical = np.zeros(layout.width)
    typical[layout.nuisances :] = 1.0
    choice = Choosing(pool, information + np.diag(typical))
    for step in steps:
        if step < (records + 1) // 2 or not open_:
            choice.run(1, informing)
            continue
        now = distances(situation.triangle(choice.taken), layout.blocks)
        choice.take(_best_for(min(open_, key=lambda pair: now[pair][0]), situation, choice))
    after = distances(situation.triangle(choice.taken), layout.blocks)
    if not every:
        raise AacmmError("fewer than two causes would show at all, so that there is nothing to tell apart")
    worst = min(open_ or set(every) - same or set(every), key=lambda pair: after[pair][0])
    rows = [
        {
            "cause": causes[pair[0]].label,
            "other": causes[pair[1]].label,
            "T": t,
            "told": t >= TOLD,
            "why_not": "the same" if pair in same else "" if pair in open_ else "too small",
        }
        for pair, (t, _) in after.items()
        if pair in every
    ]
    pairs = pd.DataFrame(rows).sort_values("T", ignore_index=True)
    return Survey(choice.taken, worst, pairs, tuple(_notes(silent, same, causes, others, layout.blocks, pairs)))


def distances(r: Array, blocks: tuple[slice, ...]) -> dict[tuple[int, int], tuple[float, float]]:
    """Of every pair of blocks, each of typical size: the smaller T, and the part of a cause that the other does not do."""
    found = {}
    for pair in combinations(range(len(blocks)), 2):
        both = []
        for mine, its in permutations(blocks[k] for k in pair):
            t = distance(r, mine, its, np.eye(mine.stop - mine.start))
            alone = float(np.square(r[:, mine]).sum())
            both.append((t, t / alone if alone > 0 else 0.0))
        found[pair] = (min(t for t, _ in both), min(part for _, part in both))
    return found


def _best_for(pair: tuple[int, int], situation: Situation, choice: Choosing) -> int:
    """The record that tells one pair best, only these two causes being there."""
    layout, pool = situation.layout, situation.rows.records
    blocks = [layout.nuisances + np.arange(b.start, b.stop) for b in (layout.blocks[i] for i in pair)]
    columns = np.concatenate([np.arange(layout.nuisances), *blocks])
    taken = pool[choice.taken].reshape(-1, layout.width)
    information = situation.start + taken.T @ taken
    alone = Choosing(pool[:, :, columns], information[np.ix_(columns, columns)])
    first = layout.nuisances
    ends = np.cumsum([first, *(len(b) for b in blocks)])
    own = [np.arange(a, b) for a, b in pairwise(ends)]
    size = tuple(Size(np.eye(len(b))) for b in own)
    worth = telling(own[0], own[1], (size[0], size[1]))(alone)
    return int(np.argmax(np.where(choice.free, worth, -np.inf)))


def _notes(
    silent: set[int],
    same: set[tuple[int, int]],
    causes: tuple[Effect, ...],
    others: list[tuple[str, Array]],
    blocks: tuple[slice, ...],
    pairs: pd.DataFrame,
) -> Iterable[str]:
    told, count = int(pairs["told"].sum()), len(pairs)
    yield f"{told} of {count} pairs of causes of typical size are told apart with odds of 0.95 or more"
    for k in sorted(silent):
        yield f"{causes[k].label} would not show{_how([words for words, r in others if not _silent(r, blocks[k])])}"
    for one, other in sorted(same):
        helps = [words for words, r in others if _apart(r, blocks[one], blocks[other])]
        yield f"no posture tells {causes[one].label} from {causes[other].label}{_how(helps)}"


def _how(helps: list[str]) -> str:
    return f"; it takes another set-up: {helps[0]}" if helps else ", nor would it with a load or on another mount"


def _silent(r: Array, block: slice) -> bool:
    return float(np.square(r[:, block]).sum()) <= SILENT


def _apart(r: Array, one: slice, other: slice) -> bool:
    for mine, its in ((one, other), (other, one)):
        alone = float(np.square(r[:, mine]).sum())
        if alone <= SILENT or distance(r, mine, its, np.eye(mine.stop - mine.start)) <= SAME * alone:
            return False
    return True
