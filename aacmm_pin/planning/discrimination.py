"""A plan that distinguishes causes: set-up of least effort, and its records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import compress

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin.effects import Effect, typical_magnitude_in_words
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning.candidate_design import Situation
from aacmm_pin.planning.measurement_conditions import possible_conditions
from aacmm_pin.planning.measurement_plan import DECIDED, MeasurementPlan, Tried
from aacmm_pin.planning.measurement_sheet import planned_records
from aacmm_pin.planning.optimal_design import chosen_records, t_optimality
from aacmm_pin.planning.separability import UNDETECTABLE, Pair, Power, Separation, size_of
from aacmm_pin.planning.task import Task

LOOSE = 1e-6
"""Prior information of an unknown cause: a thousand typical magnitudes wide."""
THOROUGH = 1000
"""From this size of the pool, every chosen record is exchanged once."""
MORE = (1.5, 2.0, 2.5, 3.0)
"""If so many times the records suffice, load and mount stay."""
PAIR = (0, 1)
BETTER = 0.1
"""Probability that a set-up of more effort that does not suffice must gain."""
HOPELESS = 1.0
"""A pair with a smaller T of random records gets none of its own."""
LEAST_T = 10.8
"""T from which causes of known values are distinguished with probability 0.95: ``Φ(√T/2)``."""


def for_two(
    task: Task,
    split: tuple[Effect, Effect],
    postures: Measurements,
    records: int,
    as_it_stands: bool,
    rng: np.random.Generator,
    steps: Iterable[int],
) -> MeasurementPlan:
    """The plan of least effort that distinguishes two causes, else the best.

    Args:
        split: two causes; zero values stand for the typical magnitude.
        postures: to choose from.
        as_it_stands: exclude a load and another mount.
        rng: for conditions.
        steps: counts records, perhaps wrapped to show progress.
    """
    tried: list[Tried] = []
    best: tuple[Situation, list[int], Power] | None = None
    enough_records: int | None = None
    power_before: Power | None = None
    sizes = [size_of(effect) for effect in split]
    for set_up in possible_conditions(task.model, task.causes, task.temperature):
        if set_up.changes_arm and (as_it_stands or enough_records is not None):
            break
        situation = Situation.of(task, set_up, postures, rng)
        if power_before is None and situation.before:
            sizes = _sizes_alike(situation, split, sizes)
            power_before = situation.power([], PAIR, sizes)
        of_pool = situation.power(None, PAIR, sizes)
        why_not = _why_not(split, of_pool)
        if why_not and best is not None:
            tried.append(Tried(str(set_up), of_pool, why_not))
            continue
        chosen = _chosen(situation, sizes, [PAIR], steps)
        steps = range(records)  # progress is shown for the first choice only
        after = situation.power(chosen, PAIR, sizes)
        tried.append(Tried(str(set_up), of_pool if why_not else after, why_not))
        decides = after.probability >= DECIDED and not after.inseparable
        better = best is not None and after.probability > best[2].probability + BETTER
        if best is None or decides or better or (best[2].inseparable and not after.inseparable):
            best = (situation, chosen, after)
            enough_records = None
            for times in () if decides or why_not else MORE:
                if situation.power(chosen, PAIR, sizes, times).probability >= DECIDED:
                    enough_records = int(np.ceil(times * len(chosen)))
                    break
        if decides:
            break
    assert best is not None
    situation, chosen, after = best
    notes = [*_sizes_in_words(split, power_before)]
    if situation.set_up.changes_arm and task.existing is not None:
        notes.append(Note("old_records_excluded"))
    return MeasurementPlan(
        **planned_records(task, situation, chosen),
        notes=tuple(notes),
        set_up=situation.set_up.words,
        changes_arm=situation.set_up.changes_arm,
        split=split,
        before=power_before,
        after=after,
        tried=tuple(tried),
        enough=enough_records,
    )


def for_all(
    task: Task, postures: Measurements, records: int, rng: np.random.Generator, steps: Iterable[int]
) -> MeasurementPlan:
    """The plan for every pair of causes of typical magnitude; load and mount stay.

    Arguments as of :func:`for_two`. ``pairs`` lists all detectable pairs, worst first: ``told`` if
    T suffices; ``why_not``: ``the same`` effect in every posture, ``too small``, or "".
    """
    options = [*possible_conditions(task.model, task.causes, task.temperature)]
    set_up = [option for option in options if not option.changes_arm][-1]
    situation = Situation.of(task, set_up, postures, rng)
    sizes = [size_of(effect) for effect in task.causes]
    of_pool = situation.separation(None, sizes)
    pairs = of_pool.detectable_pairs
    if not pairs:
        raise AacmmError(
            "a diagnosis of this plan would detect fewer than two causes; expected two or more; "
            "plan more records, or add columns"
        )
    different = [pair for pair in pairs if not of_pool.same(pair)]
    needed = HOPELESS * situation.pool.n / records
    distinguishable = [pair for pair in different if of_pool.least(pair) >= needed]
    wanted = distinguishable or different or pairs
    chosen = _chosen(situation, sizes, wanted, steps)
    separation = situation.separation(chosen, sizes)
    labels = [cause.label for cause in task.causes]
    why_not = dict.fromkeys(pairs, "the same")
    why_not |= dict.fromkeys(different, "too small")
    why_not |= dict.fromkeys(distinguishable, "")
    rows = []
    for pair, why in why_not.items():
        t = separation.least(pair)
        rows.append((*(labels[cause] for cause in pair), t, t >= LEAST_T, why))
    table = pd.DataFrame(rows, columns=["cause", "other", "T", "told", "why_not"])
    table = table.sort_values("T", ignore_index=True)
    worst = separation.worst(wanted)
    after = situation.power(chosen, worst, sizes)
    distinguished = int(table["told"].sum())
    summary = Note("pairs_told_apart", {"told": distinguished, "pairs": len(table)})
    by_other_set_ups = {
        option.words[-1]: Situation.of(task, option, postures, rng).separation(None, sizes)
        for option in options
        if option.changes_arm
    }
    one, other = worst
    return MeasurementPlan(
        **planned_records(task, situation, chosen),
        notes=(summary, *_never_distinguished(labels, of_pool, by_other_set_ups)),
        set_up=set_up.words,
        changes_arm=False,
        split=(task.causes[one], task.causes[other]),
        before=situation.power([], worst, sizes) if situation.before else None,
        after=after,
        tried=(Tried(str(set_up), after),),
        pairs=table,
    )


def _chosen(
    situation: Situation, sizes: Sequence[Array], pairs: Sequence[Pair], steps: Iterable[int]
) -> list[int]:
    """Records of the pool that separate the worst of ``pairs`` best."""
    rows = situation.rows
    width = rows.shape[2]
    loose_prior = np.where(np.arange(width) < situation.nuisances, 0.0, LOOSE)
    all_rows = rows.reshape(-1, width)
    # An average record keeps the first steps from being blind; it counts in no power.
    average_record = all_rows.T @ all_rows / len(rows)
    information = situation.information + np.diag(loose_prior) + average_record
    score = t_optimality(rows, situation.blocks, sizes, pairs)
    exchanges = int(len(pairs) == 1 and len(rows) >= THOROUGH)
    return chosen_records(rows, information, steps, score, exchanges)


def _sizes_alike(
    situation: Situation, split: tuple[Effect, Effect], sizes: list[Array]
) -> list[Array]:
    """Sizes; if only one cause has values, the other takes the size whose effect in the existing
    records is most similar.
    """
    stated = [any(effect.values) for effect in split]
    if stated[0] == stated[1]:
        return sizes
    unsized, sized = stated.index(False), stated.index(True)
    triangle = situation.triangle([])
    by_unsized, by_sized = (triangle[:, situation.blocks[cause]] for cause in (unsized, sized))
    alike, *_ = np.linalg.lstsq(by_unsized, by_sized @ sizes[sized], rcond=1e-12)
    if alike.any():
        sizes[unsized] = np.asarray(alike, dtype=np.float64)
    return sizes


def _sizes_in_words(split: tuple[Effect, Effect], before: Power | None) -> Iterator[Note]:
    for effect, other in (split, split[::-1]):
        if any(effect.values):
            continue
        option = f"{effect.key},{next(iter(effect.file_values()))}=…"
        data = {"cause": effect.label, "option": option}
        if before is not None and any(other.values):
            yield Note("planned_as_large_as", {**data, "other": other.label})
        else:
            size = typical_magnitude_in_words(effect)
            yield Note("planned_at_typical_magnitude", {**data, "size": size})


def _why_not(split: tuple[Effect, Effect], power: Power) -> str:
    """Why no posture distinguishes two causes, or ""."""
    undetectable = power.separation.alone <= UNDETECTABLE
    if undetectable.any():
        labels = compress((effect.label for effect in split), undetectable)
        return f"no posture shows {' or '.join(labels)}"
    own_effects = power.separation.own_effects
    first_has, second_has = own_effects[0, 1], own_effects[1, 0]
    if first_has and second_has:
        return ""
    if not first_has and not second_has:
        return str(Note("causes_inseparable"))
    inner, outer = split[::-1] if first_has else split
    return f"{outer.label} can have every effect of {inner.label}"


def _never_distinguished(
    labels: list[str], of_pool: Separation, by_other_set_ups: dict[str, Separation]
) -> Iterator[Note]:
    """Notes on causes that no posture of the pool detects or distinguishes, each with the first of
    the other set-ups (by their words) that would.
    """
    set_ups = by_other_set_ups.items()
    for k in np.flatnonzero(of_pool.alone <= UNDETECTABLE):
        helping = [words for words, separation in set_ups if separation.alone[k] > UNDETECTABLE]
        data = {"cause": labels[k], "set_up": next(iter(helping), None)}
        yield Note("cause_shows_otherwise" if helping else "cause_never_shows", data)
    for pair in of_pool.detectable_pairs:
        if of_pool.same(pair):
            one, other = (labels[k] for k in pair)
            helping = [words for words, separation in set_ups if not separation.same(pair)]
            data = {"one": one, "other": other, "set_up": next(iter(helping), None)}
            yield Note("pair_told_otherwise" if helping else "pair_never_told", data)
