"""A plan for two causes: the set-up with the least effort that distinguishes them, and its
records.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from aacmm_pin._support.notes import Note
from aacmm_pin.effects import Effect, typical_magnitude_in_words
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.candidate_design import Situation
from aacmm_pin.planning.detection_power import Power, Size, mimicking
from aacmm_pin.planning.measurement_conditions import possible_conditions
from aacmm_pin.planning.measurement_sheet import plan_of
from aacmm_pin.planning.result import DECIDED, MeasurementPlan, Tried
from aacmm_pin.planning.search import SequentialDesign, t_optimality
from aacmm_pin.planning.task import Task

THOROUGH = 1000
"""From so many postures on, every record of a plan is looked at once more when all are chosen."""
MORE = (1.5, 2.0, 2.5, 3.0)
"""If so many times the records would decide, no load and no other mount is planned."""
PAIR = (0, 1)
BETTER = 0.1
"""A set-up of more effort that does not decide must raise the probability by this much."""


def for_two(
    task: Task,
    split: tuple[Effect, Effect],
    postures: Measurements,
    records: int,
    as_it_stands: bool,
    rng: np.random.Generator,
    steps: Iterable[int],
) -> MeasurementPlan:
    """The plan with the least effort that decides, or else the best, of so many ``records`` at some
    of the ``postures``.

    Values of the ``split`` that are all zero stand for the typical magnitude. The generator is
    for the conditions of the records; ``steps`` count these, perhaps wrapped to show progress.
    """
    tried: list[Tried] = []
    best: tuple[Situation, list[int], Power] | None = None
    enough: int | None = None
    before: Power | None = None
    sizes = (Size.of(split[0]), Size.of(split[1]))
    draws = int(rng.integers(2**32))
    for set_up in possible_conditions(task.model, task.causes, task.temperature):
        if set_up.changes_arm and (as_it_stands or enough is not None):
            break
        situation = Situation.of(task, set_up, postures, rng)
        if before is None and situation.before:
            sizes = _matched(situation, sizes)
            before = situation.power([], PAIR, sizes, draws)
        whole = situation.power(None, PAIR, sizes, draws)
        why_not = _why_not(split, whole)
        if why_not and best is not None:
            tried.append(Tried(str(set_up), whole, why_not))
            continue
        chosen = _chosen(situation, sizes, records, steps)
        steps = range(records)
        after = situation.power(chosen, PAIR, sizes, draws)
        tried.append(Tried(str(set_up), whole if why_not else after, why_not))
        decides = after.probability >= DECIDED and not after.same
        better = best is not None and after.probability > best[2].probability + BETTER
        if best is None or decides or better or (best[2].same and not after.same):
            best = (situation, chosen, after)
            enough = None if decides or why_not else _enough(situation, chosen, sizes, draws)
        if decides:
            break
    assert best is not None
    situation, chosen, after = best
    found = {
        "split": split,
        "before": before,
        "after": after,
        "tried": tuple(tried),
        "enough": enough,
    }
    return plan_of(task, situation, chosen, tuple(_notes(split, before)), **found)


def _chosen(
    situation: Situation, sizes: tuple[Size, Size], records: int, steps: Iterable[int]
) -> list[int]:
    """Numbers of the records of the pool that distinguish the two causes best."""
    flat = situation.rows.reshape(-1, situation.layout.width)
    # One record's worth of the average keeps the first steps from being blind; it counts in no
    # power.
    choice = SequentialDesign(situation.rows, situation.start + flat.T @ flat / len(situation.rows))
    score = t_optimality(situation.layout.columns(0), situation.layout.columns(1), sizes)
    choice.run(records, score, steps)
    if situation.pool.n >= THOROUGH:
        choice.exchange(score)
    return choice.taken


def _enough(
    situation: Situation, chosen: list[int], sizes: tuple[Size, Size], draws: int
) -> int | None:
    """About how many records like the chosen ones would decide; None if not even a few times as
    many.
    """
    for times in MORE:
        if situation.power(chosen, PAIR, sizes, draws, times).probability >= DECIDED:
            return int(np.ceil(times * len(chosen)))
    return None


def _matched(situation: Situation, sizes: tuple[Size, Size]) -> tuple[Size, Size]:
    """A cause without values has those that make its effect most similar to that of the other, if
    that has some, in existing records.
    """
    if sizes[0].stated == sizes[1].stated:
        return sizes
    known = int(sizes[1].stated)
    r = situation.triangle([])
    mine = situation.layout.blocks[known]
    its = situation.layout.blocks[1 - known]
    alike = mimicking(r, mine, its, sizes[known].factor)
    if not alike.any():
        return sizes
    return (sizes[0], Size(alike)) if known == 0 else (Size(alike), sizes[1])


def _notes(split: tuple[Effect, Effect], before: Power | None) -> Iterator[Note]:
    """How large causes without values are taken to be, see :func:`_matched`."""
    for effect, other in (split, split[::-1]):
        if any(effect.values):
            continue
        option = f"{effect.key},{next(iter(effect.notation.parameters(effect)))}=…"
        data = {"cause": effect.label, "option": option}
        if before is not None and any(other.values):
            yield Note("planned_as_large_as", {**data, "other": other.label})
        else:
            yield Note(
                "planned_at_typical_magnitude", {**data, "size": typical_magnitude_in_words(effect)}
            )


def _why_not(split: tuple[Effect, Effect], power: Power) -> str:
    """Why no posture distinguishes two causes, in words; "" where some do."""
    undetectable = [
        effect.label for effect, nothing in zip(split, power.undetectable, strict=True) if nothing
    ]
    if undetectable:
        return f"no posture shows {' or '.join(undetectable)}"
    if not power.same:
        return ""
    if power.open == (False, False):
        return str(Note("causes_inseparable"))
    inner, outer = split[::-1] if power.open[0] else split
    return f"{outer.label} can have every effect of {inner.label}"
