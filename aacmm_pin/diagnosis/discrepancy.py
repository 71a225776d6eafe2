"""Covariates that structure depends on, as effects that an arm file can have."""

from __future__ import annotations

import itertools
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from aacmm_pin.calibration import Fit, calibrated_model
from aacmm_pin.calibration.estimation import fit as fit_of
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.design_matrix import held_effects
from aacmm_pin.diagnosis.model_extension import ProblemOf
from aacmm_pin.effects import Carrier, Discrepancy, ErrorModel


def not_saved(choice: Choice) -> list[str]:
    """Covariates of the discrepancy that new records, and so arm files, cannot have: labels,
    torques, unknown columns.
    """
    blocks = [k for k in choice.covariates if choice.way(k).smooth is None]
    return list(dict.fromkeys(choice.covariate(k).name for k in blocks))


def described_model(
    nominal: ErrorModel, choice: Choice, problem_of: ProblemOf
) -> tuple[ErrorModel, Fit]:
    """The extended arm, and its refit with the covariates of the discrepancy as effects. Their
    labels are none of the nominal arm.
    """
    causes = choice.with_values(choice.effects)
    estimated = [effect for effect in causes if not effect.free_form]
    labels_taken = {effect.label for effect in nominal.effects}
    for block in choice.covariates:
        if choice.way(block).smooth is not None:
            effect = _effect_of(choice, block, labels_taken)
            labels_taken.add(effect.label)
            estimated.append(effect)
    curves = choice.curves
    held_effects_of_curves = () if curves is None else curves.effects
    refit = fit_of(problem_of(estimated, held_effects_of_curves), used=choice.fit.used)
    if curves is None:
        return calibrated_model(refit), refit
    held_curves = held_effects(refit, curves.effects, curves.covariance)
    refit = replace(refit, added_covariance=held_curves.added_covariance)
    return calibrated_model(refit, held_curves), refit


def _effect_of(choice: Choice, block: int, labels_taken: Collection[str]) -> Discrepancy:
    """The effect of a covariate with its prior widths as u; a number is added to its name if the
    label is taken.
    """
    model, design, way = choice.posterior.median_model, choice.design, choice.way(block)
    name, carrier = choice.covariate(block).name, Carrier(way.carrier)
    # The columns are of functions with root mean square one.
    prior_widths = model.scale[model.entries[block]] * design.scales[design.blocks[block].columns]
    u = prior_widths / np.repeat(way.size, len(carrier.quantities))
    effect = Discrepancy(name, carrier, way.smooth or (), u.size)
    next_numbers = itertools.count(2)
    while effect.label in labels_taken:
        effect = replace(effect, covariate=f"{name} ({next(next_numbers)})")
    return effect.at(effect.values, u)
