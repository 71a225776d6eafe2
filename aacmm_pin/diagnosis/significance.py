"""Frequentist checks beside the posterior, and how much alike the columns of causes are in these
records.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.diagnosis.candidates import Variants
from aacmm_pin.diagnosis.linear_model import WIDTHS, Conditional, gains
from aacmm_pin.diagnosis.model_space import Candidates, ModelSpace
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect

DRAWS = 400
"""Draws of records with nothing hidden, for the distribution of the largest evidence."""
ALIASES = 5
"""So many aliases are listed at most."""


@dataclass(frozen=True)
class Alias(Shown):
    """A cause with a similar effect as a finding in these records.

    Attributes:
        label: the cause and its place.
        correlation: largest canonical correlation of the two causes' columns, geometry refitted.
        probability: that this cause acts and the finding does not.
        block: number of its columns in the diagnosis's design.
        effect: the cause; None for a covariate.
    """

    label: str
    correlation: float
    probability: float
    block: int = -1
    effect: Effect | None = None


def likelihood_ratio(left: Conditional, block: int) -> tuple[float, int]:
    """Of a block: at most χ² when it is not there, and its degrees of freedom."""
    gradient = left.residual[left.design_blocks[block].columns]
    (ratio,) = _likelihood_ratios(left, left.information(block)[None], gradient[None])
    return float(ratio), gradient.size


def _likelihood_ratios(left: Conditional, informations: Array, gradients: Array) -> Array:
    """Of blocks with informations (b, q, q) and gradients (b, q): (b,).

    Their parameters are known to within the largest width. Else columns of which the records tell
    next to nothing would
    explain everything: an arm that shrinks to a point meets every unknown seat.
    """
    gain, _ = gains(informations, gradients[:, :, None])
    return np.asarray(2.0 * gain[:, np.argmax(WIDTHS), 0] / left.variance)


def chance(left: Conditional, block: int) -> float:
    """That its likelihood ratio is as large when a block is not there."""
    ratio, columns = likelihood_ratio(left, block)
    return float(chi2_sf(ratio, columns))


def family_wise(
    candidates: Candidates, left: Conditional, block: int, rng: np.random.Generator
) -> float:
    """Chance that the best posterior odds of all candidates reach those of a block when nothing is
    there.

    Bonferroni's bound over all that is tried, where that is smaller than any number of draws could
    tell; else by draws of the gradients of residuals that are noise alone.
    """
    bound = len(candidates.blocks) * chance(left, block)
    if bound < 1 / DRAWS:
        return bound
    additions = logsumexp(left.additions[block]) - np.log(WIDTHS.size)
    observed = additions - left.log_evidence + candidates.log_odds[block]
    larger = int(np.sum(_largest_odds(candidates, left, rng) >= observed))
    drawn = (larger + 1) / (DRAWS + 1)
    return min(drawn, max(bound, 1 / (DRAWS + 1)), 1.0)


def _largest_odds(candidates: Candidates, left: Conditional, rng: np.random.Generator) -> Array:
    """Largest log posterior odds of all candidates in draws of records with nothing there
    (draws,).
    """
    products = left.base.gram.products
    gradient = left.of_residuals(products.drawn(DRAWS, rng) * np.sqrt(left.variance))
    best = np.full(DRAWS, -np.inf)
    for size, own in products.of_size.items():
        gain, volume = gains(left.informations(size), gradient[products.columns[size]])
        additions = logsumexp(gain / left.variance - volume[:, :, None], axis=1) - np.log(
            WIDTHS.size
        )
        odds = additions + candidates.log_odds[own][:, None]
        best = np.maximum(best, odds.max(axis=0))
    return best


def any_structure(candidates: Candidates, left: Conditional) -> float:
    """Chance of as much structure over any covariate when there is none: Bonferroni's bound."""
    products, chances = left.base.gram.products, list[float]()
    for size, own in products.of_size.items():
        ratios = _likelihood_ratios(
            left, left.informations(size), left.residual[products.columns[size]]
        )
        covariates = [not candidates.is_cause(k) for k in own.tolist()]
        chances += chi2_sf(ratios[covariates], size).tolist()
    return min(1.0, len(chances) * min(chances, default=1.0))


def retained(left: Conditional, block: int) -> float:
    """``‖M G β‖ / ‖G β‖`` at the block's best β, where M takes out what all else can explain."""
    own = left.design_blocks[block]
    information = left.information(block)
    step = np.linalg.lstsq(information, left.residual[own.columns], rcond=1e-10)[0]
    kept = max(float(step @ information @ step), 0.0)
    size = float(step @ left.base.gram.diagonal_block(own) @ step)
    return math.sqrt(kept / size) if size > 0.0 else 0.0


def aliases_of(posterior: Posterior, library: tuple[Variants, ...], block: int) -> list[Alias]:
    """The candidates that may act in the place of a block of the median probability model, most
    probable first.
    """
    candidates, left = posterior.space.candidates, posterior.without(block)
    own, names = candidates.owner(block), candidates.design.names
    instead, values = (
        posterior.instead(own),
        logsumexp(left.additions, axis=1) + candidates.log_odds,
    )
    acting = {candidates.owner(k) for k in posterior.median}
    found = []
    for other in _rivals(candidates, values, instead, own):
        owner = candidates.owner(other)
        correlation = canonical(left, block, other)
        if owner in acting or correlation < THRESHOLDS.unlike:
            continue
        alike = correlation > THRESHOLDS.same and candidates.is_cause(other)
        if alike or instead[owner] > THRESHOLDS.worth_listing:
            effect = library[owner][0] if owner < len(library) else None
            found.append(Alias(names[owner], correlation, float(instead[owner]), other, effect))
    found.sort(key=lambda alias: (-alias.probability, -alias.correlation))
    return found[:ALIASES]


def _rivals(candidates: Candidates, values: Array, instead: Array, own: int) -> list[int]:
    """The best block of each of the candidates that do best in a block's place."""
    best: dict[int, int] = {}
    for k in np.argsort(-values, kind="stable").tolist():
        owner = candidates.owner(k)
        if owner != own and np.isfinite(values[k]):
            best.setdefault(owner, k)
    leading = list(best)[: 2 * ALIASES]
    return [
        best[owner]
        for owner in dict.fromkeys([*leading, *np.flatnonzero(instead).tolist()])
        if owner in best
    ]


def canonical(left: Conditional, one: int, other: int) -> float:
    """Largest canonical correlation of two blocks' columns, what is refitted taken out."""
    roots = []
    for block in (one, other):
        values, vectors = np.linalg.eigh(left.information(block))
        keep = values > 1e-9 * max(float(values.max(initial=0.0)), 1e-300)
        roots.append(vectors[:, keep] / np.sqrt(values[keep]))
    if not (roots[0].size and roots[1].size):
        return 0.0
    cross = roots[0].T @ left.cross(one, other) @ roots[1]
    return float(min(np.linalg.svd(cross, compute_uv=False)[0], 1.0))


def visible(posterior: Posterior) -> tuple[int, int]:
    """How many causes of the library these records would have shown at their typical magnitude, and
    of how many.

    A cause shows if the noncentrality of its first parameter alone, geometry refitted, is at least
    that of the threshold; more where the noise comes from the same records and few degrees of
    freedom, so that Student's evidence is as large.
    """
    shows, dof = THRESHOLDS.shows, posterior.space.likelihood.dof
    if not posterior.space.stated:
        shows = dof * np.expm1(shows / max(dof, 1.0))
    found = _noncentralities(posterior.space)
    return int(np.sum(found >= shows)), found.size


def _noncentralities(space: ModelSpace) -> Array:
    """Largest of one parameter's, over the variants of each cause at typical magnitude, geometry
    refitted (causes,).
    """
    candidates, base = space.candidates, space.base(0)
    of_blocks = np.empty(len(candidates.blocks))
    for size, own in space.gram.products.of_size.items():
        each = np.diagonal(base.diagonal_blocks(size), axis1=1, axis2=2)
        of_blocks[own] = each.max(axis=1)
    found = np.zeros(candidates.design.causes)
    of_causes = candidates.owners < len(found)
    np.maximum.at(found, candidates.owners[of_causes], of_blocks[of_causes])
    return found
