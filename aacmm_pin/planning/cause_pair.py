"""A plan for two causes: the set-up with the least effort that tells them apart, and the records in it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from aacmm_pin.effects import Effect
from aacmm_pin.planning.candidate_records import Postures, base_temperature
from aacmm_pin.planning.detection_power import Power, Size, mimicking, power_of
from aacmm_pin.planning.measurement_sheet import sheet
from aacmm_pin.planning.result import DECIDED, MeasurementPlan, Tried
from aacmm_pin.planning.search import Choosing, telling
from aacmm_pin.planning.setups import set_ups
from aacmm_pin.planning.situation import Asked, Situation

THOROUGH = 1000
"""From so many postures on, every record of a plan is looked at once more when all are chosen."""
MORE = (1.5, 2.0, 2.5, 3.0)
"""Where so many times the records would decide, nobody need hang a load on the arm or turn its mount."""
BETTER = 0.1
"""More effort that does not decide must at least raise the odds by this much to be worth it."""


def for_two(
    asked: Asked,
    split: tuple[Effect, Effect],
    where: Postures,
    records: int,
    as_it_stands: bool,
    rng: np.random.Generator,
    steps: Iterable[int],
) -> MeasurementPlan:
    """The plan with the least effort that decides, or else the best.

    Args:
        asked: what the plan is for.
        split: the two causes with their values; all zero stand for a typical size.
        where: postures to choose from.
        records: how many.
        as_it_stands: no load and no other mount.
        rng: for the conditions of the records.
        steps: the records, perhaps wrapped to show progress.
    """
    tried: list[Tried] = []
    best: tuple[Situation, list[int], Power] | None = None
    enough: int | None = None
    before: Power | None = None
    sizes = (Size.of(split[0]), Size.of(split[1]))
    draws = int(rng.integers(2**32))
    for set_up in set_ups(asked.model, asked.causes, base_temperature(asked.model.arm, asked.existing)):
        if set_up.changes_arm and (as_it_stands or enough is not None):
            break
        situation = Situation.of(asked, set_up, where, rng)
        if before is None and situation.before:
            sizes = _matched(situation, sizes)
            before = _power(situation, [], sizes, draws)
        whole = _power(situation, None, sizes, draws)
        why_not = _why_not(split, whole)
        if why_not and best is not None:
            tried.append(Tried(str(set_up), whole, why_not))
            continue
        chosen = chosen_for(situation, sizes, records, len(where.q) >= THOROUGH, steps)
        steps = range(records)
        after = _power(situation, chosen, sizes, draws)
        tried.append(Tried(str(set_up), whole if why_not else after, why_not))
        decides = after.probability >= DECIDED and not after.same
        better = best is not None and after.probability > best[2].probability + BETTER
        if best is None or decides or better or (best[2].same and not after.same):
            best = (situation, chosen, after)
            enough = None if decides or why_not else _enough(situation, chosen, sizes, draws)
        if decides:
            break
    assert best is not None
    return sheet(asked, split, best[0], best[1], before, best[2], tuple(tried), enough)


def chosen_for(
    situation: Situation, sizes: tuple[Size, Size], records: int, thorough: bool, steps: Iterable[int]
) -> list[int]:
    """Numbers of the records of the pool that tell the two causes apart best."""
    flat = situation.rows.records.reshape(-1, situation.layout.width)
    # One record's worth of the average keeps the first steps from being blind; it counts in no power.
    choice = Choosing(situation.rows.records, situation.start + flat.T @ flat / len(situation.rows.records))
    columns = [situation.layout.nuisances + np.arange(b.start, b.stop) for b in situation.layout.blocks]
    score = telling(columns[0], columns[1], sizes)
    choice.run(records, score, steps)
    if thorough:
        choice.exchange(score)
    return choice.taken


def _power(
    situation: Situation, chosen: list[int] | None, sizes: tuple[Size, Size], draws: int, times: float = 1.0
) -> Power:
    """Of a choice; with the same draws each time, so that odds differ by what is measured and not by luck."""
    one, other = situation.layout.blocks
    return power_of(situation.triangle(chosen, times), one, other, sizes, np.random.default_rng(draws))


def _enough(situation: Situation, chosen: list[int], sizes: tuple[Size, Size], draws: int) -> int | None:
    """About how many records like the chosen ones would decide; None if not even a few times as many."""
    for times in MORE:
        if _power(situation, chosen, sizes, draws, times).probability >= DECIDED:
            return int(np.ceil(times * len(chosen)))
    return None


def _matched(situation: Situation, sizes: tuple[Size, Size]) -> tuple[Size, Size]:
    """A cause without values is as large as it must be to look like the other one, if that has some, in existing records."""
    if sizes[0].stated == sizes[1].stated:
        return sizes
    known, r = int(sizes[1].stated), situation.triangle([])
    mine, its = situation.layout.blocks[known], situation.layout.blocks[1 - known]
    alike = mimicking(r, mine, its, sizes[known].factor)
    if not alike.any():
        return sizes
    return (sizes[0], Size(alike)) if known == 0 else (Size(alike), sizes[1])


def _why_not(split: tuple[Effect, Effect], power: Power) -> str:
    """Why no posture tells two causes apart, in words; "" where some do."""
    silent = [effect.label for effect, nothing in zip(split, power.silent, strict=True) if nothing]
    if silent:
        return f"{' and '.join(silent)} would not show"
    if not power.same:
        return ""
    if power.open == (False, False):
        return "the two do the same in every posture"
    inner, outer = split[::-1] if power.open[0] else split
    return f"whatever {inner.label} does, {outer.label} can do too"
