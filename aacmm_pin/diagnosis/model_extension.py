"""From the posterior to an extended arm: explore, refit at the most probable set, explore there,
until the set stands.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_isf
from aacmm_pin._support.progress import bar
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Fit, Problem, calibrated_model, rms
from aacmm_pin.calibration.estimation import FALSE_EXCLUSION, fit, squared_distances
from aacmm_pin.calibration.shared_exclusions import clusters
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.choice import Choice, noise_is_known
from aacmm_pin.diagnosis.covariates import Covariate
from aacmm_pin.diagnosis.design_matrix import design_of, held_effects
from aacmm_pin.diagnosis.gram_matrix import gram_of
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.nonlinear_parameters import (
    refined_causes,
    with_likeliest,
    with_nonlinear_u,
)
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.reading_scatter import ReadingScatter
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.search import climb, explore
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Carrier, Discrepancy, Effect, ErrorModel

MOST_EXPLORATIONS = 10
"""The scatter that is left shrinks from refit to refit and lets weaker causes be seen; it settles
long before this.
"""
FEWEST_BACK = 3
"""So many records have to make sense at once before they are more than gross errors."""
A_FEW = 0.005
"""A smaller part of the records than this is left out without asking whether they make sense
together.
"""
NOT_FAR = 5.0
"""Excluded records up to so many times the limit away are tried with the others."""
SAME_TIPS = 0.2
"""Tips whose RMS difference is less than this part of the noise are those of one model."""
LETTERS = 40
"""Of the causes found so far, a bar shows this much."""
FREEDOM = 10.0
"""Within so many typical magnitudes a cause is refitted …"""
FREEDOM_OF_MANY = 2.0
"""… and where its parameters are many, within so many: some may be determined by few records."""
MANY_PARAMETERS = 8
"""From so many parameters on."""

ProblemOf = Callable[..., Problem]
"""The calibration problem with some effects estimated too, and with others held."""


def choose(
    problem_of: ProblemOf,
    first: Fit,
    library: Sequence[Variants],
    all_covariates: Sequence[Covariate],
    folds: Index,
    progress: bool = False,
) -> Choice:
    """Explore at the recalibrated arm, refit with the causes, explore again there, until the set
    stays.

    A strong cause in few records (a moved seat, a place in the room) makes these look like gross
    errors, which hides it. So where records were excluded, the search is tried with the nearer of
    them, and those of one time, joint or place, put back too. Its result is taken if it makes sense
    of them; of one or two only where there is nothing else, and then not as found.
    """
    rounds = _Rounds(problem_of, tuple(all_covariates), folds, progress)
    choice = rounds.until_set_stays(tuple(library), first)
    used_or_nearer = _used_or_nearer(first) & _used_or_nearer(choice.fit)
    fewest_put_back = FEWEST_BACK if choice.causes else 1
    count_put_back = int(np.sum(used_or_nearer & ~(first.used & choice.fit.used)))
    if count_put_back >= max(fewest_put_back, A_FEW * len(used_or_nearer)):
        doubtful_before = int(_doubtful(choice, choice.fit).sum())
        fit_with_nearer = fit(problem_of([]), used=used_or_nearer)
        choice_with_nearer = rounds.until_set_stays(tuple(library), fit_with_nearer, used_or_nearer)
        doubtful_after = int(_doubtful(choice_with_nearer, choice.fit).sum())
        doubtful_less = doubtful_before - doubtful_after
        if doubtful_less >= FEWEST_BACK:
            choice = choice_with_nearer
        elif doubtful_less > 0 and not choice.causes:
            choice = replace(choice, otherwise=choice_with_nearer.labels)
    return replace(choice, kept_alone=first.used)


def _doubtful(choice: Choice, judge: Fit) -> Mask:
    """Records that do not fit with all that was found, covariates included, by the scatter of
    ``judge`` (n,).
    """
    return _ratio_to_limit(choice.design.fit, choice.deviations, judge) > 1.0


def _used_or_nearer(refit: Fit) -> Mask:
    """The used records, and excluded ones that are near, or that are neighbours (n,)."""
    times_the_limit = _ratio_to_limit(refit, refit.system.deviations, refit)
    arm = refit.problem.model.arm
    records = refit.problem.measurements
    neighbours = [cluster.records for cluster in clusters(arm, records, refit.excluded, refit.used)]
    nearer = np.any([times_the_limit < NOT_FAR, *neighbours], axis=0)
    return np.asarray(refit.used | (refit.excluded & nearer))


def _ratio_to_limit(refit: Fit, deviations: Array, judge: Fit) -> Array:
    """Residual of each record, over what a good one may have by the scatter of ``judge`` (n,); 0
    without a target.
    """
    has_target = refit.observations.has_target
    ratios = np.zeros(len(deviations))
    coordinates = refit.observations.counts[has_target]
    limit_squared = chi2_isf(FALSE_EXCLUSION / len(deviations), coordinates)
    squares = squared_distances(deviations[has_target], judge.residual_noise[has_target])
    ratios[has_target] = np.sqrt(squares / limit_squared)
    return ratios


@dataclass(frozen=True, eq=False)
class _Rounds:
    """What all rounds of a search have in common; see :func:`choose`."""

    problem_of: ProblemOf
    all_covariates: tuple[Covariate, ...]
    folds: Index
    progress: bool

    def until_set_stays(
        self, library: tuple[Variants, ...], first: Fit, used: Mask | None = None
    ) -> Choice:
        """The choice after rounds of exploration and refit, each refit at the most probable set,
        until that set stays; last, a refit at the median model.

        Each refit looks for gross errors anew, or is of the records ``used``; the last one then of
        those that fit with all that was found, where covariates are a part of it. Else, if some of
        the records ``used`` are gross errors, the search begins again without them.
        """
        refit = first
        refitted_causes = list[Effect]()
        previous = None
        tips_of_rounds, tips_explored = list[Array](), list[Array]()
        # Nobody knows how many rounds it takes.
        with bar(self.progress, "search for causes", "round") as shown_rounds:
            for _ in range(MOST_EXPLORATIONS):
                choice = self.round(library, refit, refitted_causes, previous)
                shown_rounds.update()
                best_causes = refined_causes(choice, choice.top_causes)
                same_causes = _identities(best_causes) == _identities(refitted_causes)
                set_stays = same_causes or _is_near(choice, tips_of_rounds)
                tips_of_rounds.append(choice.posterior.top_model.all_tips)
                if set_stays and _scatter_is_settled(choice):
                    choice = _explored(choice)
                    # Exploration leads nowhere else, or to the same tips again and again.
                    if _is_near(choice, [tips_of_rounds[-1], *tips_explored]):
                        break
                    tips_explored.append(choice.posterior.top_model.all_tips)
                    best_causes = refined_causes(choice, choice.top_causes)
                labels = ", ".join(effect.label for effect in best_causes)
                shown_rounds.set_postfix_str(labels[:LETTERS])
                if best_causes:
                    refit = self.refitted(choice.with_values(best_causes), used=used)
                elif refitted_causes:
                    refit = first
                if not refit.determines_noise:  # more causes than these records can carry
                    nothing = replace(choice.posterior, weights={(): 1.0})
                    return replace(choice, fit=first, posterior=nothing)
                choice.posterior.space.release()
                refitted_causes, previous = best_causes, choice
                library = _with_refined_variants(library, refitted_causes)
            else:
                choice = _explored(choice)
        if used is not None and choice.covariates:
            used = used & ~_doubtful(choice, choice.design.fit)
            return self.extended(choice, fit(self.problem_of([]), used=used), used)
        extended = self.extended(choice, first)
        if used is None or not (used & ~extended.fit.used).any():
            return extended
        used = used & extended.fit.used
        return self.until_set_stays(library, fit(self.problem_of([]), used=used), used)

    def round(
        self,
        library: tuple[Variants, ...],
        refit: Fit,
        effects: Sequence[Effect],
        previous: Choice | None,
    ) -> Choice:
        """The posterior where a fit with some causes ended, with the noise that the round before
        found.

        An error curve, which has many parameters, may follow readings that scatter. So the first
        round takes the more probable: the curves, or the scatter of readings in their place.
        """
        design = design_of(refit, library, self.all_covariates)
        candidates = Candidates.of(design, library)
        identities = [e.identity for e in itertools.chain.from_iterable(library)]  # first blocks
        start = tuple(sorted(identities.index(effect.identity) for effect in effects))
        if previous is None:
            tips, dof, scatter = refit.point.prediction.poses, refit.chi2.dof, None
        else:
            model, scatter = previous.posterior.top_model, previous.scatter_beside_top
            tips, dof = model.all_tips, model.dof
        posterior = _likeliest_climb(candidates, start, scatter, tips, dof)
        choice = Choice(refit, posterior, library, self.all_covariates, self.folds, scatter)
        if previous is not None or noise_is_known(refit):
            return choice
        no_curves = [k for k in posterior.top if not candidates.free[candidates.owner(k)]]
        scatter = choice.scatter_beside(posterior.beside(posterior.top, no_curves))
        if not scatter.readings.any():
            return choice
        posterior_with_scatter = _likeliest_climb(candidates, start, scatter, tips, dof)
        choice_with_scatter = replace(choice, posterior=posterior_with_scatter, scatter=scatter)
        return max(
            choice,
            choice_with_scatter,
            key=lambda one: one.posterior.log_density + one.log_density_of_scatter,
        )

    def refitted(
        self, effects: Sequence[Effect], removed: Sequence[Effect] = (), used: Mask | None = None
    ) -> Fit:
        """All refitted with these causes, within their u, without known ones that are ``removed``;
        without ``used``, gross errors are looked for. Curves stay at their values: so many
        parameters are the posterior's.
        """
        held = [effect for effect in effects if effect.free_form]
        estimated = [effect.at((), effect.u) for effect in effects if not effect.free_form]
        return fit(self.problem_of(estimated, held, removed=removed), used=used)

    def extended(self, choice: Choice, first: Fit, used: Mask | None = None) -> Choice:
        """The refit at the median probability model; its u includes the uncertainty of nonlinear
        parameters, the error that records of one posture share, and held curves.

        A known cause is removed if a cause of its label with another nonlinear parameter is
        estimated, and its own values are zero within their U.
        """
        refit, curves = first, None
        effects = refined_causes(choice, choice.causes)
        if effects:
            with_values = choice.with_values(effects)
            refit = self.refitted(with_values, used=used)
            if removed := _superseded(refit, effects):
                refit = self.refitted(with_values, removed, used)
                # A cause that has replaced a known one has another nonlinear parameter without it.
                labels_removed = {effect.label for effect in removed}
                tried = {
                    k: effect.nonlinear.refine(effect, refit.problem.measurements)
                    for k, effect in enumerate(effects)
                    if effect.label in labels_removed and not effect.nonlinear.is_preferred(effect)
                }
                acting = [(effect,) for effect in effects]
                effects = with_likeliest(refit, choice.noise, acting, tried)
                with_values = choice.with_values(effects)
                refit = self.refitted(with_values, removed, used)
            refit = with_nonlinear_u(refit, choice.noise, effects)
            held_curves = [effect for effect in with_values if effect.free_form]
            curves = choice.held_curves(refit, held_curves) if held_curves else None
        variance = choice.posterior.median_model.variance
        added_covariance = choice.noise.added_covariance(refit, variance)
        if curves is not None:
            added_covariance = added_covariance + curves.added_covariance
        refit = replace(refit, added_covariance=added_covariance)
        return replace(choice, fit=refit, curves=curves)


def _identities(effects: Sequence[Effect]) -> frozenset[Any]:
    return frozenset(effect.identity for effect in effects)


def _is_near(choice: Choice, tips_of_rounds: Sequence[Array]) -> bool:
    """Whether the tips with the most probable set are those of an earlier round (n, 3 or 6), to
    within the noise.
    """
    tips = choice.posterior.top_model.all_tips
    differences = (choice.noise.whitened(tips - earlier) for earlier in tips_of_rounds)
    return any(rms(difference) < SAME_TIPS for difference in differences)


def _scatter_is_settled(choice: Choice) -> bool:
    """Whether the scatter beside the most probable set is about what its noise assumed."""
    scatter = choice.scatter_beside_top
    if scatter is None:
        return True
    if choice.scatter is not None:
        size_assumed = choice.scatter.size
    elif scatter.readings.any():
        return False
    else:
        refit = choice.design.fit
        size_assumed = refit.expected_rms(refit.residual_noise)
    return bool(abs(np.log(scatter.size / size_assumed)) < np.log(THRESHOLDS.rescaled))


def _superseded(refit: Fit, effects: Sequence[Effect]) -> list[Effect]:
    """Known causes, beside new ones of their name, that are zero to within their U (k = 2)."""
    labels_of_new = {
        effect.label for effect in effects if effect.nonlinear.field and not is_change(effect)
    }
    identities = _identities(effects)
    superseded = []
    for effect, entries in zip(refit.effects, refit.problem.vector.slices, strict=True):
        if effect.label in labels_of_new and effect.identity not in identities:
            u = np.sqrt(np.diag(refit.covariance[entries, entries]))
            if np.all(np.abs(effect.values) <= COVERAGE_FACTOR * u):
                superseded.append(effect)
    return superseded


def free(effect: Effect) -> Effect:
    """The effect, free within many typical magnitudes."""
    width = FREEDOM if len(effect.terms) < MANY_PARAMETERS else FREEDOM_OF_MANY
    return effect.at((), tuple(width * t.typical for t in effect.terms))


def _explored(choice: Choice) -> Choice:
    """The posterior from several starts, the most probable set so far among them."""
    posterior = choice.posterior
    return replace(choice, posterior=explore(posterior.space, posterior.top))


def _likeliest_climb(
    candidates: Candidates, start: Blocks, scatter: ReadingScatter | None, tips: Array, dof: float
) -> Posterior:
    """The posterior with the most probable noise, beside the scatter of readings and tips.

    What records of one posture share is either noise or what causes do there. So the search has two
    starts: with the error that the residuals from some tips share, which leave so many degrees of
    freedom, and without any. Each is repeated with the error that the residuals of its own set
    share.
    """
    design = candidates.design
    refit = design.fit
    stated = noise_is_known(refit) if scatter is None else scatter.as_stated
    nothing_shared = RecordNoise.of_postures(refit, (scatter or refit.noise).whitening)

    def posterior_with(noise: RecordNoise) -> Posterior:
        return climb(ModelSpace(candidates, gram_of(design, noise.scaled(stated)), stated), start)

    def with_own_noise(noise: RecordNoise) -> Posterior:
        posterior = posterior_with(noise)
        for _ in range(MOST_EXPLORATIONS):
            model = posterior.top_model
            deviations = design.deviations(model.all_tips)
            noise = nothing_shared.likeliest(deviations, model.dof)
            if noise.is_about(posterior.noise):
                break
            posterior = posterior_with(noise)
        return posterior

    if not nothing_shared.repeat:
        return posterior_with(nothing_shared)
    starts = [nothing_shared.likeliest(design.deviations(tips), dof)]
    if not nothing_shared.is_about(starts[0]):
        starts.append(nothing_shared)
    return max(map(with_own_noise, starts), key=lambda posterior: posterior.log_density)


def _with_refined_variants(
    library: Sequence[Variants], effects: list[Effect]
) -> tuple[Variants, ...]:
    """The library with the refined effects among the variants of their labels.

    Each replaces the nearest variant that was tried: if there were more about the likeliest value
    than elsewhere, their prior would be larger there. Values common in machines (whole orders) and
    changes of known causes stay.
    """
    identities_tried = {variant.identity for variants in library for variant in variants}
    untried_by_label = {
        effect.label: effect.at(()) for effect in effects if effect.identity not in identities_tried
    }
    with_refined = []
    for variants in library:
        # Candidates can have one label, as changes of two known causes: the first has the variants.
        refined = untried_by_label.pop(variants[0].label, None)
        if refined is not None:
            nonlinear = refined.nonlinear
            value = nonlinear.value(refined) if nonlinear.field else math.nan
            distances = {
                k: abs(nonlinear.value(variant) - value)
                for k, variant in enumerate(variants)
                if nonlinear.field
                and type(variant) is type(refined)
                and not (is_change(variant) or nonlinear.is_preferred(variant))
                and nonlinear.at(variant, value).identity == refined.identity
            }
            nearest = min(distances, key=distances.__getitem__, default=len(variants))
            variants = (*variants[:nearest], refined, *variants[nearest + 1 :])
        with_refined.append(variants)
    return tuple(with_refined)


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
    refit = fit(problem_of(estimated, held_effects_of_curves), used=choice.fit.used)
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
