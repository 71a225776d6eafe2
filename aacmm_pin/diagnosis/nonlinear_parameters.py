"""Nonlinear parameters of causes, such as orders and times, by the evidence of values nearby."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import logsumexp

from aacmm_pin._support.arrays import Array
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.choice import Choice, noise_is_known
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


def refined_causes(choice: Choice, causes: Blocks) -> list[Effect]:
    """Some causes, together, with their likeliest nonlinear parameters."""
    records = choice.fit.problem.measurements
    acting = _acting(choice, causes)
    tried_by_number = {}
    for number, (*_, effect) in enumerate(acting):
        if is_change(choice.variant(causes[number])):
            continue
        refined = effect.nonlinear.refine(effect, records)
        if len(refined) > 1:
            tried_by_number[number] = refined
    return with_likeliest(choice.fit, choice.noise, acting, tried_by_number)


def with_likeliest(
    fit: Fit, noise: RecordNoise, acting: Sequence[Variants], tried: Mapping[int, Sequence[Effect]]
) -> list[Effect]:
    """Each cause as it acts, last of its variants, or in its place the likeliest effect of those
    tried for it, see :func:`likeliest`; arguments as in :func:`evidences`.
    """
    effects = [variants[-1] for variants in acting]
    for k, log_odds in evidences(fit, noise, acting, tried).items():
        effects[k] = likeliest(tried[k], log_odds)
    return effects


def _acting(choice: Choice, blocks: Sequence[int]) -> list[Variants]:
    """The effect of each block, as :func:`evidences` takes them."""
    acting: list[Variants] = []
    for block in blocks:
        effect = choice.variant(block)
        first_variant = choice.library[choice.candidates.owner(block)][0]
        replaces_known = is_change(first_variant) and effect is not first_variant
        known_cause = (first_variant,) if replaces_known else ()
        acting.append((*known_cause, effect.at(())))
    return acting


def evidences(
    fit: Fit, noise: RecordNoise, acting: Sequence[Variants], tried: Mapping[int, Sequence[Effect]]
) -> dict[int, Array]:
    """Log of evidence times prior of effects in the place of one cause, the other causes held,
    where a fit with one of each ended: (effects,) by the number of the cause.

    Args:
        acting: each cause as it acts; before it the known cause, if its nonlinear parameter
            differs.
        tried: effects to try, by the number of the cause whose place they take.
    """
    if not any(tried.values()):
        return {}
    library = [(*variants, *tried.get(number, ())) for number, variants in enumerate(acting)]
    design = design_of(fit, library, [])
    candidates = Candidates.of(design, library)
    space = ModelSpace(candidates, gram_of(design, noise), noise_is_known(fit))
    blocks_of_causes = [
        np.flatnonzero(candidates.owners == number) for number in range(len(acting))
    ]
    acting_blocks = [
        int(blocks[len(variants) - 1])
        for blocks, variants in zip(blocks_of_causes, acting, strict=True)
    ]
    records = fit.problem.measurements
    evidence_of = {}
    for number, effects in tried.items():
        if not effects:
            continue
        state = space.marginal(without_block(tuple(acting_blocks), acting_blocks[number])).best
        additions = space.conditional(state).additions()
        log_evidence = additions[blocks_of_causes[number][-len(effects) :]]
        priors = [effect.nonlinear.prior_probability(effect, records) for effect in effects]
        evidence_of[number] = logsumexp(log_evidence, axis=1) + np.log(priors)
    return evidence_of


def likeliest(tried: Sequence[Effect], log_odds: Array) -> Effect:
    """The effect with the largest evidence, between the values that were tried, or one with nearly
    this evidence and a value that machines are made with.
    """
    best = int(np.argmax(log_odds))
    preferred = [k for k, effect in enumerate(tried) if effect.nonlinear.is_preferred(effect)]
    likeliest_preferred = max(preferred, key=lambda k: log_odds[k], default=best)
    if preferred and log_odds[likeliest_preferred] > log_odds[best] - EXCEPTIONAL:
        return tried[likeliest_preferred]
    effect = tried[best]
    nonlinear = effect.nonlinear
    if not nonlinear.prior_sd(effect) or not 0 < best < len(tried) - 1:
        return effect
    # The top of the parabola through the best and its neighbours.
    near = slice(best - 1, best + 2)
    values = np.array([nonlinear.value(neighbour) for neighbour in tried[near]])
    bend, slope, _ = np.polyfit(values - values[1], log_odds[near], 2)
    top = -slope / (2.0 * bend) if bend < 0.0 else 0.0
    refined: Effect = nonlinear.at(effect, float(np.clip(values[1] + top, values[0], values[2])))
    return refined


def with_nonlinear_u(fit: Fit, noise: RecordNoise, effects: Sequence[Effect]) -> Fit:
    """A fit in which the nonlinear parameters of new causes are uncertain too; a known cause keeps
    its own.
    """
    records = fit.problem.measurements
    # The effect is smooth in their nonlinear parameter, which may have any value.
    new_causes = [
        k
        for k, effect in enumerate(effects)
        if not is_change(effect)
        and effect.nonlinear.prior_sd(effect)
        and not effect.nonlinear.is_preferred(effect)
    ]
    tried_by_number = {
        k: effects[k].nonlinear.refine(effects[k].at(()), records) for k in new_causes
    }
    log_odds = evidences(fit, noise, [(effect,) for effect in effects], tried_by_number)
    u_by_key = {}
    number_by_label = {effects[k].label: k for k in new_causes}
    for effect, entries in zip(fit.effects, fit.problem.vector.slices, strict=True):
        k = number_by_label.get(effect.label, -1)
        if k in log_odds and not fit.problem.start[entries].any():
            u_by_key[effect.key] = _least_u(effect, tried_by_number[k], log_odds[k])
    return replace(fit, estimated_nonlinear=u_by_key)


def _least_u(effect: Effect, tried: Sequence[Effect], log_odds: Array) -> float:
    """Half of the distance from a nonlinear parameter to the farther end of its 95 % interval: a
    time constant beyond the records has more room upwards than its derivative says.
    """
    if len(tried) < 2:
        return 0.0
    grid = np.arange(len(tried))
    fine_grid = np.linspace(0.0, grid[-1], PARTS_OF_STEP * int(grid[-1]) + 1)
    tried_values = [variant.nonlinear.value(variant) for variant in tried]
    fine_values = scipy.interpolate.CubicSpline(grid, tried_values)(fine_grid)
    fine_odds = scipy.interpolate.CubicSpline(grid, log_odds)(fine_grid)
    low, high = _interval(fine_values, fine_odds)
    value = effect.nonlinear.value(effect)
    return float(max(high - value, value - low) / 2.0)


def _interval(values: Array, log_odds: Array) -> tuple[float, float]:
    """The ends of 95 % of the probability of values (k,), by their log odds."""
    cumulated = np.cumsum(np.exp(log_odds - logsumexp(log_odds)))
    ends = np.searchsorted(cumulated, (0.025, 0.975)).clip(max=values.size - 1)
    low, high = values[ends].tolist()
    return low, high


class NonlinearInterval(NamedTuple):
    """Of a nonlinear parameter [its unit].

    Attributes:
        low, high: ends of 95 % of the probability.
    """

    u: float
    low: float
    high: float


def nonlinear_interval(choice: Choice, block: int, effect: Effect) -> NonlinearInterval | None:
    """Of the nonlinear parameter of a block's estimated effect; None if the records do not
    determine it. That of a step, such as the time of a slip, is by the evidence of values nearby,
    each for the gap around it.
    """
    name = effect.nonlinear.field
    if not name or effect.nonlinear.prior_sd(effect):
        u = choice.fit.nonlinear_u.get(effect.key)
        if u is None:
            return None
        value = float(getattr(effect, name))
        return NonlinearInterval(u, value - 2.0 * u, value + 2.0 * u)
    candidates = choice.candidates
    records = choice.fit.problem.measurements
    effect_of_block = choice.variant(block).at(())
    tried = effect_of_block.nonlinear.refine(effect_of_block, records)
    other_causes = [k for k in choice.top_causes if candidates.owner(k) != candidates.owner(block)]
    acting = _acting(choice, [block, *other_causes])
    log_odds = evidences(choice.fit, choice.noise, acting, {0: tried})[0]
    values = np.array([getattr(effect, name) for effect in tried])
    probabilities = np.exp(log_odds - logsumexp(log_odds))
    gaps = np.array([effect.nonlinear.gap(effect, records) for effect in tried])
    variances = np.square(values - getattr(effect_of_block, name)) + np.square(gaps) / 12.0
    u = float(np.sqrt(probabilities @ variances))
    return NonlinearInterval(u, *_interval(values, log_odds))
