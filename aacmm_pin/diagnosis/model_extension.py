"""From the posterior to an extended arm: explore, refit at the most probable set, explore there,
until the set stands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_isf
from aacmm_pin._support.progress import bar
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Fit, HeldEffects, Problem, rms
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.shared_exclusions import clusters
from aacmm_pin.calibration.variance_components import FALSE_EXCLUSION, squared_distances
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.covariates import Covariate
from aacmm_pin.diagnosis.design_matrix import design_of
from aacmm_pin.diagnosis.gram_matrix import gram_of
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.nonlinear_parameters import (
    noise_is_known,
    refined_causes,
    steps_past_excluded,
    with_likeliest,
    with_nonlinear_u,
)
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.reading_scatter import ReadingScatter
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.diagnosis.search import climb, explore
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect

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
    search_arguments = tuple(library), tuple(all_covariates), folds, progress
    choice = _search_until_set_stays(problem_of, first, *search_arguments)
    used_or_nearer = _used_or_nearer(first) & _used_or_nearer(choice.fit)
    fewest_put_back = FEWEST_BACK if choice.causes else 1
    count_put_back = int(np.sum(used_or_nearer & ~(first.used & choice.fit.used)))
    if count_put_back >= max(fewest_put_back, A_FEW * len(used_or_nearer)):
        doubtful_before = int(_doubtful(choice, choice.fit).sum())
        fit_with_nearer = fit(problem_of([]), used=used_or_nearer)
        choice_with_nearer = _search_until_set_stays(
            problem_of, fit_with_nearer, *search_arguments, used_or_nearer
        )
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


def _search_until_set_stays(
    problem_of: ProblemOf,
    first: Fit,
    library: tuple[Variants, ...],
    all_covariates: tuple[Covariate, ...],
    folds: Index,
    progress: bool,
    used: Mask | None = None,
) -> Choice:
    """The choice after rounds of exploration and refit, each refit at the most probable set, until
    that set stays; last, a refit at the median model.

    Each refit looks for gross errors anew, or is of the records ``used``; the last one then of
    those that fit with all that was found, where covariates are a part of it. Else, if some of the
    records ``used`` are gross errors, the search begins again without them.
    """
    refit = first
    refitted_causes = list[Effect]()
    previous = None
    tips_of_rounds, tips_explored = list[Array](), list[Array]()
    rounds_bar = bar(progress, "search for causes", "round")  # nobody knows how many it takes
    with rounds_bar as shown_rounds:
        for _ in range(MOST_EXPLORATIONS):
            choice = _round_of_search(
                refit, library, all_covariates, folds, refitted_causes, previous
            )
            shown_rounds.update()
            best_causes = refined_causes(choice, choice.top_causes)
            previous = _PreviousRound.of(choice)
            same_causes = _identities(best_causes) == _identities(refitted_causes)
            set_stays = same_causes or _is_near(choice, tips_of_rounds)
            tips_of_rounds.append(previous.tips)
            if set_stays and previous.scatter_settled(choice):
                choice = _explored(choice)
                # Exploration leads nowhere else, or to the same tips again and again.
                if _is_near(choice, [tips_of_rounds[-1], *tips_explored]):
                    break
                previous = _PreviousRound.of(choice)
                tips_explored.append(previous.tips)
                best_causes = refined_causes(choice, choice.top_causes)
            shown_rounds.set_postfix_str(
                ", ".join(effect.label for effect in best_causes)[:LETTERS]
            )
            if best_causes:
                refit = refitted(problem_of, choice.with_values(best_causes), used=used)
            elif refitted_causes:
                refit = first
            if not refit.determines_noise:  # more causes than these records can carry
                return replace(
                    choice, fit=first, posterior=replace(choice.posterior, weights={(): 1.0})
                )
            choice.posterior.space.release()
            refitted_causes = best_causes
            library = _with_variants(library, refitted_causes)
        else:
            choice = _explored(choice)
    if used is not None and choice.covariates:
        used = used & ~_doubtful(choice, choice.design.fit)
        first = fit(problem_of([]), used=used)
        return _extended(problem_of, choice, first, used)
    extended = _extended(problem_of, choice, first)
    if used is None or not (used & ~extended.fit.used).any():
        return extended
    still_used = used & extended.fit.used
    fit_without = fit(problem_of([]), used=still_used)
    return _search_until_set_stays(
        problem_of, fit_without, library, all_covariates, folds, progress, still_used
    )


def _identities(effects: Sequence[Effect]) -> frozenset[Any]:
    return frozenset(effect.identity for effect in effects)


def _is_near(choice: Choice, tips_of_rounds: Sequence[Array]) -> bool:
    """Whether the tips with the most probable set are those of an earlier round (n, 3 or 6), to
    within the noise.
    """
    tips = choice.posterior.top_model.all_tips
    differences = (choice.noise.whitened(tips - earlier) for earlier in tips_of_rounds)
    return any(rms(difference) < SAME_TIPS for difference in differences)


@dataclass(frozen=True, eq=False)
class _PreviousRound:
    """What a round leaves for the next one, beside its most probable set.

    Attributes:
        tips: poses of the records with all of that set (n, 3 or 6) [m, rad].
        dof: degrees of freedom that it leaves.
        scatter: of readings and tips beside that; None where the stated noise was all there was.
    """

    tips: Array
    dof: float
    scatter: ReadingScatter | None = None

    @staticmethod
    def of(choice: Choice) -> _PreviousRound:
        model = choice.posterior.top_model
        scatter = None if noise_is_known(choice.design.fit) else choice.scatter_beside(model)
        return _PreviousRound(model.all_tips, model.dof, scatter)

    def scatter_settled(self, choice: Choice) -> bool:
        """Whether the scatter left by this round is about what its noise assumed, in ``choice``."""
        if self.scatter is None:
            return True
        refit = choice.design.fit
        size_assumed = (
            refit.expected_rms(refit.residual_noise)
            if choice.scatter is None
            else choice.scatter.size
        )
        same_kind = choice.scatter is not None or not self.scatter.readings.any()
        return same_kind and bool(
            abs(np.log(self.scatter.size / size_assumed)) < np.log(THRESHOLDS.rescaled)
        )


def _extended(
    problem_of: ProblemOf, choice: Choice, first: Fit, used: Mask | None = None
) -> Choice:
    """The refit at the median probability model; its u includes the uncertainty of nonlinear
    parameters.

    A known cause is removed if a cause of its name with another nonlinear parameter is estimated,
    and its own values are zero within their U.
    """
    effects = refined_causes(choice, choice.causes)
    if not effects:
        return replace(choice, fit=_with_shared_and_held_errors(first, choice))
    with_widths = choice.with_values(effects)
    refit = refitted(problem_of, with_widths, used=used)
    if used is None:
        for moved in steps_past_excluded(choice, refit, effects):
            moved_with_widths = choice.with_values(moved)
            other_refit = refitted(problem_of, moved_with_widths)
            if other_refit.used.sum() > refit.used.sum():
                effects, with_widths, refit = moved, moved_with_widths, other_refit
    if removed := _superseded(refit, effects):
        refit = refitted(problem_of, with_widths, removed, used)
        # A cause that has replaced a known one has another nonlinear parameter without it.
        labels_removed = {effect.label for effect in removed}
        tried = {
            k: effect.nonlinear.refine(effect, refit.problem.measurements)
            for k, effect in enumerate(effects)
            if effect.label in labels_removed and not effect.nonlinear.is_preferred(effect)
        }
        acting = [(effect,) for effect in effects]
        effects = with_likeliest(refit, choice.noise, acting, tried)
        with_widths = choice.with_values(effects)
        refit = refitted(problem_of, with_widths, removed, used)
    refit = with_nonlinear_u(refit, choice.noise, effects)
    held_curves = [effect for effect in with_widths if effect.free_form]
    curves = choice.held_curves(refit, held_curves) if held_curves else None
    return replace(choice, fit=_with_shared_and_held_errors(refit, choice, curves), curves=curves)


def _with_shared_and_held_errors(
    refit: Fit, choice: Choice, curves: HeldEffects | None = None
) -> Fit:
    """The fit, whose covariance includes the error that records of one posture share, and held
    curves.
    """
    variance = choice.posterior.median_model.variance
    added_covariance = choice.noise.added_covariance(refit, variance)
    if curves is not None:
        added_covariance = added_covariance + curves.added_covariance
    return replace(refit, added_covariance=added_covariance)


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


def refitted(
    problem_of: ProblemOf,
    effects: Sequence[Effect],
    removed: Sequence[Effect] = (),
    used: Mask | None = None,
) -> Fit:
    """All refitted with these causes, within their u, without known ones that are ``removed``;
    without ``used``, gross errors are looked for. Curves stay at their values: so many parameters
    are the posterior's.
    """
    held = [effect for effect in effects if effect.free_form]
    estimated = [effect.at((), effect.u) for effect in effects if not effect.free_form]
    return fit(problem_of(estimated, held, removed=removed), used=used)


def free(effect: Effect) -> Effect:
    """The effect, free within many typical magnitudes."""
    width = FREEDOM if len(effect.terms) < MANY_PARAMETERS else FREEDOM_OF_MANY
    return effect.at((), tuple(width * t.typical for t in effect.terms))


def _explored(choice: Choice) -> Choice:
    """The posterior from several starts, the most probable set so far among them."""
    posterior = choice.posterior
    return replace(choice, posterior=explore(posterior.space, posterior.top))


def _round_of_search(
    refit: Fit,
    library: tuple[Variants, ...],
    all_covariates: tuple[Covariate, ...],
    folds: Index,
    effects: Sequence[Effect],
    previous_round: _PreviousRound | None,
) -> Choice:
    """The posterior where a fit with some causes ended, with the noise that the round before found.

    An error curve, which has many parameters, may follow readings that scatter. So the first round
    takes the more probable: the curves, or the scatter of readings in their place.
    """
    design = design_of(refit, library, all_covariates)
    candidates = Candidates.of(design, library)
    previous = previous_round or _PreviousRound(refit.point.prediction.poses, refit.chi2.dof)
    blocks_of_causes = [b for b in design.blocks if b.candidate < design.causes]  # the first ones
    identities = [library[b.candidate][b.variant].identity for b in blocks_of_causes]
    start = tuple(sorted(identities.index(effect.identity) for effect in effects))
    climb = _Climb(candidates, start, previous.scatter)
    posterior = climb.best_posterior(previous)
    choice = Choice(refit, posterior, library, all_covariates, folds, previous.scatter)
    if previous_round is not None or noise_is_known(refit):
        return choice
    scatter = choice.scatter_beside(choice.posterior.without_curves)
    if not scatter.readings.any():
        return choice
    posterior_with_scatter = replace(climb, scatter=scatter).best_posterior(previous)
    choice_with_scatter = replace(choice, posterior=posterior_with_scatter, scatter=scatter)
    return max(
        choice,
        choice_with_scatter,
        key=lambda one: one.posterior.log_density + one.log_density_of_scatter,
    )


@dataclass(frozen=True, eq=False)
class _Climb:
    """What a round has in common for every noise that it is tried with."""

    candidates: Candidates
    start: Blocks
    scatter: ReadingScatter | None

    def best_posterior(self, previous: _PreviousRound) -> Posterior:
        """The posterior with the most probable noise.

        What records of one posture share is either noise or what causes do there. So the search
        has two starts: with the error that the residuals of the round before share, and without
        any. Each is repeated with the error that the residuals of its own set share.
        """
        if not self.noise.repeat:
            return self.posterior_with(self.noise)
        starts = [self.noise_shared_beside(previous.tips, previous.dof)]
        if not self.noise.is_about(starts[0]):
            starts.append(self.noise)
        return max(map(self.with_own_noise, starts), key=lambda posterior: posterior.log_density)

    @cached_property
    def noise(self) -> RecordNoise:
        """The noise if records of one posture share nothing."""
        refit = self.candidates.design.fit
        return RecordNoise.of_postures(refit, (self.scatter or refit.noise).whitening)

    def noise_shared_beside(self, tips: Array, dof: float) -> RecordNoise:
        """The noise with the error that records of one posture share beside some tips."""
        return self.noise.likeliest(self.candidates.design.deviations(tips), dof)

    def posterior_with(self, noise: RecordNoise) -> Posterior:
        """The posterior of a search with this noise."""
        design = self.candidates.design
        stated = noise_is_known(design.fit) if self.scatter is None else self.scatter.as_stated
        gram = gram_of(design, noise.scaled(stated))
        return climb(ModelSpace(self.candidates, gram, stated), self.start)

    def with_own_noise(self, noise: RecordNoise) -> Posterior:
        """The posterior, from a first ``noise`` on, with the shared error that its own most
        probable set leaves.
        """
        posterior = self.posterior_with(noise)
        for _ in range(MOST_EXPLORATIONS):
            model = posterior.top_model
            shared_beside_set = self.noise_shared_beside(model.all_tips, model.dof)
            if shared_beside_set.is_about(posterior.noise):
                break
            posterior = self.posterior_with(shared_beside_set)
        return posterior


def _with_variants(library: Sequence[Variants], effects: list[Effect]) -> tuple[Variants, ...]:
    """The library with the refined effects among the variants of their labels."""
    identities_tried = {variant.identity for variants in library for variant in variants}
    untried_by_label = {
        effect.label: effect.at(()) for effect in effects if effect.identity not in identities_tried
    }
    with_refined = []
    for variants in library:
        # Of several candidates of one label, the first has the variants.
        refined = untried_by_label.pop(variants[0].label, None)
        with_refined.append(variants if refined is None else _with_variant(variants, refined))
    return tuple(with_refined)


def _with_variant(variants: Variants, refined: Effect) -> Variants:
    """A refined variant replaces the nearest that was tried: if there were more about the likeliest
    value than elsewhere, their prior would be larger there.
    """
    nonlinear = refined.nonlinear
    numbers_alike = [
        k
        for k, variant in enumerate(variants)
        if nonlinear.field
        and type(variant) is type(refined)
        and not (is_change(variant) or nonlinear.is_preferred(variant))
        and nonlinear.at(variant, nonlinear.value(refined)).identity == refined.identity
    ]
    nearest = min(
        numbers_alike,
        key=lambda k: abs(nonlinear.value(variants[k]) - nonlinear.value(refined)),
        default=len(variants),
    )
    return (*variants[:nearest], refined, *variants[nearest + 1 :])
