"""Covariates that structure depends on, as effects that an arm file can have."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration import Fit, calibrated_model
from aacmm_pin.calibration.estimation import fit as fit_of
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.covariates import Carried
from aacmm_pin.diagnosis.design_matrix import held_effects
from aacmm_pin.diagnosis.model_extension import ProblemOf
from aacmm_pin.effects import Carrier, Discrepancy, ErrorModel, Part

Described = tuple[str, Carried]
"""Name of a covariate, and the way in which it acts."""


def described_by(choice: Choice, blocks: Iterable[int]) -> list[Described]:
    """Names and ways of some blocks."""
    return [(choice.covariate(block).name, choice.way(block)) for block in blocks]


def lost(described: Sequence[Described]) -> list[str]:
    """Covariates that new records, and so arm files, cannot have: labels, torques, unknown
    columns.
    """
    names = [name for name, way in described if way.smooth is None]
    return list(dict.fromkeys(names))


def described_model(
    nominal: ErrorModel, choice: Choice, problem_of: ProblemOf
) -> tuple[ErrorModel, Fit]:
    """The extended arm, and its refit with the covariates of the discrepancy as effects. Their
    labels are none of the nominal arm.
    """
    model, design = choice.posterior.median_model, choice.design
    prior_u = []
    for k in choice.covariates:
        scales = design.scales[design.blocks[k].columns]
        prior_u.append(model.scale[model.entries[k]] * scales)
    taken = {effect.label for effect in nominal.effects}
    named = covariate_effects(described_by(choice, choice.covariates), prior_u, taken)
    causes = choice.with_values(choice.effects)
    estimated = [effect for effect in causes if not effect.free_form]
    curves = choice.curves
    held = () if curves is None else curves.effects
    refit = fit_of(problem_of([*estimated, *named], held), used=choice.fit.used)
    if curves is None:
        return calibrated_model(refit), refit
    beside = held_effects(refit, curves.effects, curves.covariance)
    refit = replace(refit, added_covariance=beside.added_covariance)
    return calibrated_model(refit, beside), refit


def covariate_effects(
    described: Sequence[Described],
    prior_u: Sequence[Array | float],
    taken: Collection[str] = (),
) -> list[Discrepancy]:
    """Effects to be estimated, one for each covariate that new records have too, see :func:`lost`.

    Args:
        described: covariates, each with its variant.
        prior_u: for each, prior standard deviations of its functions' coefficients, on all axes
            together (q,) [m, rad, m/m].
        taken: labels that others have: a number is added to the name.
    """
    effects = list[Discrepancy]()
    labels = set(taken)
    for (name, way), of_covariate in zip(described, prior_u, strict=True):
        if way.smooth is None:
            continue
        u = coefficients_of_effect(way) * of_covariate
        part = Part(Carrier(way.carrier), way.smooth)
        effect = _new(name, part, len(u), labels)
        effects.append(effect.at(effect.values, u))
        labels.add(effect.label)
    return effects


def coefficients_of_effect(way: Carried) -> Array:
    """Factors from coefficients of a covariate, for functions of root mean square one, to an
    effect's (q,).
    """
    return np.repeat(1.0 / way.size, Carrier(way.carrier).axes)


def _new(name: str, part: Part, size: int, taken: Collection[str]) -> Discrepancy:
    effect = Discrepancy(name, (part,), size)
    number = 1
    while effect.label in taken:
        number += 1
        effect = replace(effect, covariate=f"{name} ({number})")
    return effect
