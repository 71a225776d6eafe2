"""The causes of the median probability model, with their values: new or changed ones, and geometry
beyond what is stated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import geometric_parameters
from aacmm_pin.diagnosis.candidates import is_change
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.cross_validation import Training, brought
from aacmm_pin.diagnosis.inner_values import Step, step_of
from aacmm_pin.diagnosis.result import Finding
from aacmm_pin.diagnosis.significance import aliases_of, family_wise_p_value, retained
from aacmm_pin.effects import Effect, ErrorModel, slides, values_with_u


def findings_of(
    model: ErrorModel, choice: Choice, trained: list[Training], rng: np.random.Generator
) -> list[Finding]:
    """The causes, strongest first, with the values that the last refit gave them; geometric values
    last.
    """

    def is_geometric(finding: Finding) -> bool:
        return bool(geometric_parameters(model.arm, finding.effect))

    found = [_finding(model, choice, trained, block, rng) for block in choice.causes]
    return sorted(found, key=is_geometric)


def _finding(
    model: ErrorModel, choice: Choice, trained: list[Training], block: int, rng: np.random.Generator
) -> Finding:
    every = {each[0].identity: each for each in estimated(choice)}
    # The new one comes last.
    latest = {each[0].label: each for each in every.values()}
    chosen = choice.variant(block)
    effect, covariance = every.get(chosen.identity, latest[chosen.label])
    covariance = covariance + _of_other_sets(choice, block, effect)
    u = np.sqrt(np.diag(covariance))
    effect = effect.at(effect.values, tuple(u))
    field = effect.nonlinear.field
    is_step = field and not effect.nonlinear.prior_sd(effect)
    steps = {field: step_of(choice, block, field)} if is_step else {}
    inner = _inner_values(choice, effect, steps)
    known = [old for old in model.effects if old.label == effect.label]
    replaced = [
        old for old in known if old.identity == effect.identity or old.identity not in every
    ]
    left = choice.posterior.without(block)
    is_geometric = geometric_parameters(model.arm, effect)
    beside = None
    if effect.place is not None and effect.cause in latest:
        beside, _ = latest[effect.cause]
    return Finding(
        effect if is_change(chosen) else _told(choice, effect, inner, steps),
        values_with_u(effect, covariance),
        choice.posterior.probability(block),
        family_wise_p_value(choice.candidates, left, block, rng),
        retained(left, block),
        tuple(aliases_of(choice.posterior, choice.library, block)),
        None if is_geometric else brought(choice, trained, block),
        inner,
        slides(effect, choice.fit.problem.model.arm),
        beside,
        next(iter(replaced), None),
    )


def _of_other_sets(choice: Choice, block: int, effect: Effect) -> Array:
    """What is added to the covariance of a cause's values, for other sets of causes give other
    values.
    """
    design = choice.design
    scales = design.scales[design.blocks[block].columns][: len(effect.terms)]
    more = choice.posterior.uncertainty_of_the_set(block)[: len(effect.terms), : len(effect.terms)]
    return scales[:, None] * more * scales


def _told(
    choice: Choice,
    effect: Effect,
    inner: Mapping[str, tuple[float, float]],
    steps: Mapping[str, Step],
) -> Effect:
    """The effect with what the records tell of where it steps, or of how far off its inner values
    may be.
    """
    intervals = {name: (value - 2.0 * u, value + 2.0 * u) for name, (value, u) in inner.items()}
    for low, high in (
        intervals | {name: (step.low, step.high) for name, step in steps.items()}
    ).values():
        records = choice.fit.problem.measurements
        effect = effect.nonlinear.with_coverage_interval(effect, low, high, records)
    return effect


def _inner_values(
    choice: Choice, effect: Effect, steps: Mapping[str, Step]
) -> dict[str, tuple[float, float]]:
    """What was found of order, time constant or time, with u."""
    every = choice.fit.inner_u.items()
    found = {name: u for (key, name), u in every if key == effect.key}
    found |= {name: step.u for name, step in steps.items()}
    values = {name: float(getattr(effect, name)) for name in found}
    return {name: (values[name], u) for name, u in found.items()}


def estimated(choice: Choice) -> Iterator[tuple[Effect, Array]]:
    """Every effect that the last fit estimated, with u, and the covariance of its values; of what
    no record tells, by the widths within which it was looked for.
    """
    fit = choice.fit
    untold = fit.unknown * fit.problem.scales[:, None]
    for effect, own in zip(fit.effects, fit.problem.vector.slices, strict=True):
        covariance = fit.covariance[own, own] + untold[own] @ untold[own].T
        yield effect.at(effect.values, tuple(np.sqrt(np.diag(covariance)))), covariance
