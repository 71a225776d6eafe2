"""The causes of the median probability model, with their values."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import geometric_parameters
from aacmm_pin.diagnosis.candidates import is_change
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.design_matrix import typical_of
from aacmm_pin.diagnosis.held_out_gain import HeldOut, cause_gain
from aacmm_pin.diagnosis.nonlinear_parameters import NonlinearInterval, interval_of_step
from aacmm_pin.diagnosis.result import Finding
from aacmm_pin.diagnosis.significance import aliases_of, family_wise_p_value, retained
from aacmm_pin.effects import Effect, ErrorModel, slides, values_with_u


def findings_of(model: ErrorModel, choice: Choice, held_out: HeldOut) -> list[Finding]:
    """The causes, strongest first, with the values of the last refit; geometric values last."""

    def is_geometric(finding: Finding) -> bool:
        return bool(geometric_parameters(model.arm, finding.effect))

    findings = [_finding(model, choice, held_out, block) for block in choice.causes]
    return sorted(findings, key=is_geometric)


def _finding(model: ErrorModel, choice: Choice, held_out: HeldOut, block: int) -> Finding:
    """The cause of a block, with its values, probability, aliases and gain."""
    by_identity = {estimate[0].identity: estimate for estimate in estimated(choice)}
    # Of several effects with one label the new one comes last.
    by_label = {estimate[0].label: estimate for estimate in by_identity.values()}
    variant = choice.variant(block)
    effect, covariance = by_identity.get(variant.identity, by_label[variant.label])
    # Other sets of causes give other values (law of total variance).
    term_count = len(effect.terms)
    typical = typical_of(effect)
    between_sets = choice.posterior.uncertainty_of_the_set(block)[:term_count, :term_count]
    covariance = covariance + np.outer(typical, typical) * between_sets
    u = np.sqrt(np.diag(covariance))
    effect = effect.at(effect.values, tuple(u))
    reported, nonlinear_values = effect, {}
    interval = _nonlinear_interval(choice, block, effect)
    if interval is not None:
        name = effect.nonlinear.field
        nonlinear_values = {name: (float(getattr(effect, name)), interval.u)}
        if not is_change(variant):
            reported = effect.nonlinear.with_coverage_interval(
                effect, interval.low, interval.high, choice.fit.problem.measurements
            )
    known_before = (
        old
        for old in model.effects
        if old.label == effect.label
        and (old.identity == effect.identity or old.identity not in by_identity)
    )
    without_block = choice.posterior.without(block)
    is_geometric = bool(geometric_parameters(model.arm, effect))
    whole_arm = None
    if effect.place is not None and effect.cause in by_label:
        whole_arm, _ = by_label[effect.cause]
    return Finding(
        effect=reported,
        parameters=values_with_u(effect, covariance),
        probability=choice.posterior.probability(block),
        p_value=family_wise_p_value(choice.candidates, without_block, block),
        retained_fraction=retained(without_block, block),
        aliases=tuple(aliases_of(choice.posterior, choice.library, block)),
        brought=None if is_geometric else cause_gain(choice, held_out, block),
        inner=nonlinear_values,
        slides=slides(effect, choice.fit.problem.model.arm),
        beside=whole_arm,
        was=next(known_before, None),
    )


def _nonlinear_interval(choice: Choice, block: int, effect: Effect) -> NonlinearInterval | None:
    """Of the nonlinear parameter of a cause; None if the records do not determine it."""
    name = effect.nonlinear.field
    if name and not effect.nonlinear.prior_sd(effect):
        return interval_of_step(choice, block, name)
    u = choice.fit.nonlinear_u.get((effect.key, name))
    if u is None:
        return None
    value = float(getattr(effect, name))
    return NonlinearInterval(u, value - 2.0 * u, value + 2.0 * u)


def estimated(choice: Choice) -> Iterator[tuple[Effect, Array]]:
    """Every effect of the last fit with u and covariance; undetermined ones with the prior
    widths.
    """
    fit = choice.fit
    undetermined_directions = fit.unknown * fit.problem.scales[:, None]
    for effect, entries in zip(fit.effects, fit.problem.vector.slices, strict=True):
        from_prior = undetermined_directions[entries] @ undetermined_directions[entries].T
        covariance = fit.covariance[entries, entries] + from_prior
        u = np.sqrt(np.diag(covariance))
        yield effect.at(effect.values, tuple(u)), covariance
    if choice.curves is not None:
        for effect in choice.curves.effects:
            yield effect, choice.curves.of_effect(effect)
