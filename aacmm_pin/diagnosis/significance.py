"""Frequentist checks beside the posterior, and how much alike the columns of causes are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import beta_sf, chi2_sf
from aacmm_pin.diagnosis.candidates import Variants
from aacmm_pin.diagnosis.linear_model import WIDTHS, Conditional, gains
from aacmm_pin.diagnosis.model_space import Candidates, ModelState
from aacmm_pin.diagnosis.posterior import Posterior, best_of_candidates
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect

MOST_EXPLAINED = 1.0 - 1e-12
"""Part of χ² that a block explains at most, by rounding."""
ALIASES = 5
"""So many aliases are listed at most."""


@dataclass(frozen=True)
class Alias(Shown):
    """A cause with a similar effect as a finding in these records.

    Attributes:
        correlation: largest canonical correlation of the columns of both, geometry refitted.
        probability: that this cause acts and the finding does not.
        effect: the cause; None for a covariate.
    """

    label: str
    correlation: float
    probability: float
    effect: Effect | None


def family_wise_p_value(candidates: Candidates, conditional: Conditional, block: int) -> float:
    """Bound of the chance that the posterior odds of any candidate reach those of a block when
    nothing is there.

    The mean of the odds is then the prior odds: Markov's inequality for all together.
    """
    information, gradient = conditional.left.of_block(block)
    gain, volume = gains(information[None], gradient[None])
    if not _knows_noise(conditional):
        # Student's evidence, by the share of χ² that the block explains.
        share = np.minimum(2.0 * gain / conditional.left.chi2, MOST_EXPLAINED)
        gain = -0.5 * conditional.likelihood.dof * np.log1p(-share)
    log_bayes_factor = float(logsumexp(gain - volume) - np.log(WIDTHS.size))
    log_bound = logsumexp(candidates.log_odds) - candidates.log_odds[block] - log_bayes_factor
    return float(np.exp(min(log_bound, 0.0)))


def _knows_noise(conditional: Conditional) -> bool:
    """Whether the noise is stated, and the records scatter as stated."""
    return conditional.likelihood.stated and conditional.variance == 1.0


def p_value_of_structure(candidates: Candidates, conditional: Conditional) -> float:
    """Chance of as much structure over any covariate when there is none: Bonferroni's bound.

    Columns that do nothing explain a χ² of their own or, if the noise is not known, a share of χ²
    that is beta distributed. Parameters are known to within the largest width, or hardly determined
    columns would explain everything.
    """
    chances = list[float]()
    for family in conditional.design.families:
        of_covariates = candidates.owners[family.blocks] >= candidates.design.causes
        if not of_covariates.any():
            continue
        information, gradient = conditional.left.of_family(family)
        gain, _ = gains(information[of_covariates], gradient[of_covariates])
        squares = 2.0 * gain[:, np.argmax(WIDTHS)]
        columns = information.shape[1]
        if _knows_noise(conditional):
            chances_of_family = chi2_sf(np.maximum(squares, 0.0), columns)
        else:
            other_dof = max(conditional.likelihood.dof - columns, 1.0)
            shares = np.clip(squares / conditional.left.chi2, 0.0, 1.0)
            chances_of_family = beta_sf(shares, 0.5 * columns, 0.5 * other_dof)
        chances += chances_of_family.tolist()
    return min(1.0, len(chances) * min(chances, default=1.0))


def retained(conditional: Conditional, block: int) -> float:
    """``‖M G β‖ / ‖G β‖`` of a block's columns G at its best β; M takes out what others explain."""
    parameters = conditional.design.blocks[block]
    information, gradient = conditional.left.of_block(block)
    step = np.linalg.lstsq(information, gradient, rcond=1e-10)[0]
    square_left = max(float(step @ information @ step), 0.0)
    coefficients = parameters.in_columns(np.asarray(step, np.float64))
    products = conditional.base.gram.matrix[parameters.columns, parameters.columns]
    square = float(coefficients @ products @ coefficients)
    return math.sqrt(square_left / square) if square > 0.0 else 0.0


def aliases_of(posterior: Posterior, library: tuple[Variants, ...], block: int) -> list[Alias]:
    """The candidates that may act in the place of a block of the median set, likeliest first.

    They best replace the block beside the other members, or act in a visited set without it.
    """
    candidates = posterior.space.candidates
    conditional = posterior.without(block)
    finding = candidates.owner(block)
    names = candidates.design.names
    instead = posterior.instead(finding)
    log_posteriors = logsumexp(conditional.additions(), axis=1) + candidates.log_odds
    log_posteriors[candidates.barred(conditional.blocks)] = -np.inf
    acting = {candidates.owner(k) for k in posterior.median}
    best_block = best_of_candidates(candidates, log_posteriors)
    best_block.pop(finding, None)
    leading = [*best_block][: 2 * ALIASES]
    aliases = []
    for owner in dict.fromkeys([*leading, *np.flatnonzero(instead).tolist()]):
        if owner in acting or owner not in best_block:
            continue
        other = best_block[owner]
        correlation = conditional.left.canonical(block, other)
        if correlation < THRESHOLDS.unlike:
            continue
        is_same_cause = correlation > THRESHOLDS.same and candidates.is_cause(other)
        if is_same_cause or instead[owner] > THRESHOLDS.worth_listing:
            effect = library[owner][0] if owner < len(library) else None
            aliases.append(Alias(names[owner], correlation, float(instead[owner]), effect))
    aliases.sort(key=lambda alias: (-alias.probability, -alias.correlation))
    return aliases[:ALIASES]


def visible(posterior: Posterior) -> tuple[int, int]:
    """How many causes these records would have shown at their typical magnitude, and how many were
    asked.

    A cause shows if the noncentrality of one parameter, over all variants, geometry refitted, is at
    least the threshold; more if the noise comes from the same records and few degrees of freedom,
    so that Student's evidence is as large.
    """
    space = posterior.space
    candidates = space.candidates
    dof = space.likelihood.dof
    least = THRESHOLDS.shows
    if not space.stated:
        least = dof * np.expm1(THRESHOLDS.shows / max(dof, 1.0))
    alone = space.conditional(ModelState((), (), 0))
    noncentralities = np.zeros(len(candidates.places))
    for family in candidates.design.families:
        information, _ = alone.left.of_family(family)
        by_parameter = np.diagonal(information, axis1=1, axis2=2)
        owners = candidates.owners[family.blocks]
        np.maximum.at(noncentralities, owners, by_parameter.max(axis=1))
    asked = candidates.follows < 0
    asked[candidates.design.causes :] = False
    return int(np.sum(noncentralities[asked] >= least)), int(asked.sum())
