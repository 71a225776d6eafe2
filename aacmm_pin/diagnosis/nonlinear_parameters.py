"""Nonlinear parameters of causes, such as orders and times, by the evidence of values nearby."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.design_matrix import design_of
from aacmm_pin.diagnosis.gram_matrix import gram_of
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.search import without_block
from aacmm_pin.effects import Effect

EXCEPTIONAL = 2.0
"""A value common in machines is taken unless the log evidence falls by this."""
PARTS_OF_STEP = 200
"""Parts of the distance of two tried values, over which their evidence is summed."""
UNREFUSED = 3.0
"""The used records refuse a time of a step if its log evidence is so far below the largest."""


def noise_is_known(at: Fit) -> bool:
    """Whether the stated noise is all that the fit found."""
    return at.noise_is_stated and at.noise.scatters.of_targets == 0.0


def refined_causes(choice: Choice, causes: Blocks) -> list[Effect]:
    """Some causes, together, with their likeliest nonlinear parameters."""
    records = choice.fit.problem.measurements
    acting = _acting(choice, causes)
    tried = {}
    for k, (*_, effect) in enumerate(acting):
        if is_change(choice.variant(causes[k])):
            continue
        refined = effect.nonlinear.refine(effect, records)
        if len(refined) > 1:
            tried[k] = refined
    return with_likeliest(choice.fit, choice.noise, acting, tried)


def with_likeliest(
    at: Fit, noise: RecordNoise, acting: Sequence[Variants], tried: Mapping[int, Sequence[Effect]]
) -> list[Effect]:
    """Each cause as it acts, or in its place the likeliest effect of those tried for it, see
    :func:`likeliest`; arguments as in :func:`evidences`.
    """
    best = [variants[-1] for variants in acting]
    for k, log_odds in evidences(at, noise, acting, tried).items():
        best[k] = likeliest(tried[k], log_odds)
    return best


def steps_past_excluded(choice: Choice, at: Fit, causes: Sequence[Effect]) -> list[list[Effect]]:
    """The causes, each time with one step moved so that other excluded records come before it: to
    the likeliest of these times, unless the used records refuse it.
    """
    records = at.problem.measurements
    excluded = records.take(np.flatnonzero(at.excluded))
    steps = [k for k, effect in enumerate(causes) if effect.nonlinear.gap(effect, records)]
    if not excluded.n or not steps:
        return []
    times_excluded = excluded.conditions.times
    tried = {k: causes[k].nonlinear.refine(causes[k].at(()), records) for k in steps}
    acting = [(effect.at(()),) for effect in causes]
    moved = []
    for k, log_odds in evidences(at, choice.noise, acting, tried).items():
        nonlinear = causes[k].nonlinear
        times = [nonlinear.value(effect) for effect in tried[k]]
        excluded_before = np.searchsorted(times_excluded, times)
        as_now = np.searchsorted(times_excluded, nonlinear.value(causes[k]))
        for count in np.setdiff1d(excluded_before, as_now):
            log_odds_there = np.where(excluded_before == count, log_odds, -np.inf)
            best = int(np.argmax(log_odds_there))
            if log_odds_there[best] > log_odds.max() - UNREFUSED:
                moved.append([*causes[:k], tried[k][best], *causes[k + 1 :]])
    return moved


def _acting(choice: Choice, blocks: Sequence[int]) -> list[Variants]:
    acting: list[Variants] = []
    for block in blocks:
        effect = choice.variant(block)
        first = choice.library[choice.candidates.owner(block)][0]
        changed = (first,) if is_change(first) and effect is not first else ()
        acting.append((*changed, effect.at(())))
    return acting


def evidences(
    at: Fit, noise: RecordNoise, acting: Sequence[Variants], tried: Mapping[int, Sequence[Effect]]
) -> dict[int, Array]:
    """Log of evidence times prior of effects in the place of one cause, the other causes held,
    where a fit with one of each ended.

    Args:
        acting: each cause as it acts; before it the known cause, if its nonlinear parameter
            differs.
        tried: effects to try, by the number of the cause whose place they take.
    """
    if not any(tried.values()):
        return {}
    library = [(*variants, *tried.get(number, ())) for number, variants in enumerate(acting)]
    design = design_of(at, library, [])
    candidates = Candidates.of(design, library)
    space = ModelSpace(candidates, gram_of(design, noise), noise_is_known(at))
    places = [np.flatnonzero(candidates.owners == number) for number in range(len(acting))]
    held = [int(rows[len(variants) - 1]) for rows, variants in zip(places, acting, strict=True)]
    records = at.problem.measurements
    evidence_of = {}
    for number, effects in tried.items():
        if not effects:
            continue
        state = space.marginal(without_block(tuple(held), held[number])).best
        additions = space.conditional(state).without().additions()
        log_evidence = additions[places[number][-len(effects) :]]
        priors = [effect.nonlinear.prior_probability(effect, records) for effect in effects]
        evidence_of[number] = logsumexp(log_evidence, axis=1) + np.log(priors)
    return evidence_of


def likeliest(tried: Sequence[Effect], log_odds: Array) -> Effect:
    """The effect with the largest evidence, or one with nearly this evidence and a value that
    machines are made with.
    """
    best = int(np.argmax(log_odds))
    exceptional = [k for k, effect in enumerate(tried) if effect.nonlinear.is_preferred(effect)]
    usual = max(exceptional, key=lambda k: log_odds[k], default=best)
    if exceptional and log_odds[usual] > log_odds[best] - EXCEPTIONAL:
        return tried[usual]
    return _at_the_top(tried, log_odds, best)


def _at_the_top(tried: Sequence[Effect], log_odds: Array, best: int) -> Effect:
    """The effect at the top of the parabola through the best of those tried and its neighbours."""
    effect = tried[best]
    nonlinear = effect.nonlinear
    if not nonlinear.prior_sd(effect) or not 0 < best < len(tried) - 1:
        return effect
    near = slice(best - 1, best + 2)
    values = np.array([nonlinear.value(neighbour) for neighbour in tried[near]])
    bend, slope, _ = np.polyfit(values - values[1], log_odds[near], 2)
    top = -slope / (2.0 * bend) if bend < 0.0 else 0.0
    refined: Effect = nonlinear.at(effect, float(np.clip(values[1] + top, values[0], values[2])))
    return refined


def with_nonlinear_u(at: Fit, noise: RecordNoise, effects: Sequence[Effect]) -> Fit:
    """A fit in which the nonlinear parameters of new causes are uncertain too; a known cause keeps
    its own.
    """
    records = at.problem.measurements
    new = [k for k, effect in enumerate(effects) if not is_change(effect) and _is_smooth(effect)]
    tried = {k: effects[k].nonlinear.refine(effects[k].at(()), records) for k in new}
    log_odds = evidences(at, noise, [(effect,) for effect in effects], tried)
    u_of = {}
    number = {effects[k].label: k for k in new}
    for effect, entries in zip(at.effects, at.problem.vector.slices, strict=True):
        k = number.get(effect.label, -1)
        if k in log_odds and not at.problem.start[entries].any():
            u_of[effect.key] = {effect.nonlinear.field: _least_u(effect, tried[k], log_odds[k])}
    return replace(at, estimated_nonlinear=u_of)


def _is_smooth(effect: Effect) -> bool:
    """Whether it is smooth in its nonlinear parameter, which may have any value."""
    nonlinear = effect.nonlinear
    return bool(nonlinear.prior_sd(effect)) and not nonlinear.is_preferred(effect)


def _least_u(effect: Effect, tried: Sequence[Effect], log_odds: Array) -> float:
    """Half of the distance from a nonlinear parameter to the farther end of its 95 % interval: a
    time constant beyond the records has more room upwards than its derivative says.
    """
    if len(tried) < 2:
        return 0.0
    grid = np.arange(len(tried))
    fine = np.linspace(0.0, grid[-1], PARTS_OF_STEP * int(grid[-1]) + 1)
    tried_values = [variant.nonlinear.value(variant) for variant in tried]
    values = scipy.interpolate.CubicSpline(grid, tried_values)(fine)
    fine_odds = scipy.interpolate.CubicSpline(grid, log_odds)(fine)
    low, high = _interval(values, fine_odds)
    value = effect.nonlinear.value(effect)
    return float(max(high - value, value - low) / 2.0)


def _interval(values: Array, log_odds: Array) -> tuple[float, float]:
    """The ends of 95 % of the probability, by log log_odds of the values."""
    share = np.cumsum(np.exp(log_odds - logsumexp(log_odds)))
    places = np.searchsorted(share, (0.025, 0.975)).clip(max=values.size - 1)
    low, high = values[places].tolist()
    return low, high


class NonlinearInterval(NamedTuple):
    """Of a nonlinear parameter [its unit].

    Attributes:
        low, high: ends of 95 % of the probability.
    """

    u: float
    low: float
    high: float


def interval_of_step(choice: Choice, block: int, name: str) -> NonlinearInterval:
    """Of the nonlinear parameter ``name`` at which a block steps, such as the time of a slip, by
    the evidence of values nearby, each for the gap around it.
    """
    candidates = choice.candidates
    records = choice.fit.problem.measurements
    chosen = choice.variant(block).at(())
    tried = chosen.nonlinear.refine(chosen, records)
    others = [k for k in choice.top_causes if candidates.owner(k) != candidates.owner(block)]
    acting = _acting(choice, [block, *others])
    log_odds = evidences(choice.fit, choice.noise, acting, {0: tried})[0]
    values = np.array([getattr(effect, name) for effect in tried])
    share = np.exp(log_odds - logsumexp(log_odds))
    gaps = np.array([effect.nonlinear.gap(effect, records) for effect in tried])
    variances = np.square(values - getattr(chosen, name)) + np.square(gaps) / 12.0
    u = float(np.sqrt(share @ variances))
    return NonlinearInterval(u, *_interval(values, log_odds))
