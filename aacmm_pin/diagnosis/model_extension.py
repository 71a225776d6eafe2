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
    given = tuple(library), tuple(all_covariates), folds, progress
    choice = _standing(problem_of, first, *given)
    nearer = _put_back(first) & _put_back(choice.fit)
    least = FEWEST_BACK if choice.causes else 1
    back = int(np.sum(nearer & ~(first.used & choice.fit.used)))
    if back >= max(least, A_FEW * len(nearer)):
        doubtful = _doubtful(choice, choice.fit)
        wider = fit(problem_of([]), used=nearer)
        again = _standing(problem_of, wider, *given, nearer)
        fewer = int(doubtful.sum() - _doubtful(again, choice.fit).sum())
        if fewer >= FEWEST_BACK:
            choice, again = again, choice
        elif fewer > 0 and not choice.causes:
            choice = replace(choice, otherwise=again.labels)
    return replace(choice, kept_alone=first.used)


def _doubtful(choice: Choice, judge: Fit) -> Mask:
    """Records that do not fit with all that was found, covariates included, by the scatter of
    ``judge`` (n,).
    """
    return _times_the_limit(choice.design.fit, choice.deviations, judge) > 1.0


def _put_back(of_fit: Fit) -> Mask:
    """The used records, and excluded ones that are near, or that are neighbours (n,)."""
    far = _times_the_limit(of_fit, of_fit.system.deviations, of_fit)
    arm = of_fit.problem.model.arm
    records = of_fit.problem.measurements
    dense = [cluster.records for cluster in clusters(arm, records, of_fit.excluded, of_fit.used)]
    nearer = np.any([far < NOT_FAR, *dense], axis=0)
    return np.asarray(of_fit.used | (of_fit.excluded & nearer))


def _times_the_limit(at: Fit, deviations: Array, judge: Fit) -> Array:
    """Residual of each record, over what a good one may have by the scatter of ``judge`` (n,)."""
    has_target = at.observations.has_target
    times = np.zeros(len(deviations))
    limit = chi2_isf(FALSE_EXCLUSION / len(deviations), at.observations.counts[has_target])
    times[has_target] = np.sqrt(
        squared_distances(deviations[has_target], judge.residual_noise[has_target]) / limit
    )
    return times


def _standing(
    problem_of: ProblemOf,
    first: Fit,
    library: tuple[Variants, ...],
    all_covariates: tuple[Covariate, ...],
    folds: Index,
    progress: bool,
    used: Mask | None = None,
) -> Choice:
    """Rounds of exploration and refit, each refit at the most probable set; last, a refit at the
    median model.

    Each refit looks for gross errors anew, or is of the records ``used``; the last one then of
    those that fit with all that was found, where covariates are a part of it. Else, if some of the
    records ``used`` are gross errors, the search begins again without them.
    """
    at = first
    effects = list[Effect]()
    before = None
    visited, ends = list[Array](), list[Array]()
    with bar(progress, "search for causes", "round") as rounds:  # nobody knows how many it takes
        for _ in range(MOST_EXPLORATIONS):
            choice = _climbed(at, library, all_covariates, folds, effects, before)
            rounds.update()
            best = refined_causes(choice, choice.top_causes)
            before = _Before.of(choice)
            stays = _identities(best) == _identities(effects) or _is_near(choice, visited)
            visited.append(before.tips)
            if stays and before.settled(choice):
                choice = _explored(choice)
                if _is_near(choice, [visited[-1], *ends]):  # or leads there again and again
                    break
                before = _Before.of(choice)
                ends.append(before.tips)
                best = refined_causes(choice, choice.top_causes)
            rounds.set_postfix_str(", ".join(effect.label for effect in best)[:LETTERS])
            if best:
                at = refitted(problem_of, choice.with_values(best), used=used)
            elif effects:
                at = first
            if not at.determines_noise:  # more causes than these records can carry
                return replace(
                    choice, fit=first, posterior=replace(choice.posterior, weights={(): 1.0})
                )
            choice.posterior.space.release()
            effects = best
            library = _with_variants(library, effects)
        else:
            choice = _explored(choice)
    if used is not None and choice.covariates:
        used = used & ~_doubtful(choice, choice.design.fit)
        first = fit(problem_of([]), used=used)
        return _extended(problem_of, choice, first, used)
    extended = _extended(problem_of, choice, first)
    if used is None or not (used & ~extended.fit.used).any():
        return extended
    good = used & extended.fit.used
    without = fit(problem_of([]), used=good)
    return _standing(problem_of, without, library, all_covariates, folds, progress, good)


def _identities(effects: Sequence[Effect]) -> frozenset[Any]:
    return frozenset(effect.identity for effect in effects)


def _is_near(choice: Choice, visited: Sequence[Array]) -> bool:
    """Whether the tips with the most probable set are those of an earlier round, beside the
    noise.
    """
    tips = choice.posterior.top_model.all_tips
    differences = (choice.noise.whitened(tips - earlier) for earlier in visited)
    return any(rms(difference) < SAME_TIPS for difference in differences)


@dataclass(frozen=True, eq=False)
class _Before:
    """What a round leaves for the next one, beside its most probable set.

    Attributes:
        tips: with all of that set.
        dof: degrees of freedom that it leaves.
        scatter: of readings and tips beside that; None where the stated noise was all there was.
    """

    tips: Array
    dof: float
    scatter: ReadingScatter | None = None

    @staticmethod
    def of(choice: Choice) -> _Before:
        model = choice.posterior.top_model
        scatter = None if noise_is_known(choice.design.fit) else choice.scatter_beside(model)
        return _Before(model.all_tips, model.dof, scatter)

    def settled(self, choice: Choice) -> bool:
        """Whether the scatter is about what a round reckoned with."""
        if self.scatter is None:
            return True
        at = choice.design.fit
        reckoned = (
            at.expected_rms(at.residual_noise) if choice.scatter is None else choice.scatter.size
        )
        same_kind = choice.scatter is not None or not self.scatter.readings.any()
        return same_kind and bool(
            abs(np.log(self.scatter.size / reckoned)) < np.log(THRESHOLDS.rescaled)
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
        return replace(choice, fit=_with_shared_error(first, choice))
    within = choice.with_values(effects)
    at = refitted(problem_of, within, used=used)
    if used is None:
        for moved in steps_past_excluded(choice, at, effects):
            moved_within = choice.with_values(moved)
            refit = refitted(problem_of, moved_within)
            if refit.used.sum() > at.used.sum():
                effects, within, at = moved, moved_within, refit
    if gone := _gone(at, effects):
        at = refitted(problem_of, within, gone, used)
        # A cause that has replaced a known one has another nonlinear parameter without it.
        labels = {effect.label for effect in gone}
        tried = {
            k: effect.nonlinear.refine(effect, at.problem.measurements)
            for k, effect in enumerate(effects)
            if effect.label in labels and not effect.nonlinear.is_preferred(effect)
        }
        acting = [(effect,) for effect in effects]
        effects = with_likeliest(at, choice.noise, acting, tried)
        within = choice.with_values(effects)
        at = refitted(problem_of, within, gone, used)
    at = with_nonlinear_u(at, choice.noise, effects)
    held = [effect for effect in within if effect.free_form]
    curves = choice.held_curves(at, held) if held else None
    return replace(choice, fit=_with_shared_error(at, choice, curves), curves=curves)


def _with_shared_error(at: Fit, choice: Choice, curves: HeldEffects | None = None) -> Fit:
    """The fit, whose covariance includes the error that records of one posture share, and held
    curves.
    """
    variance = choice.posterior.median_model.variance
    added = choice.noise.added_covariance(at, variance)
    if curves is not None:
        added = added + curves.added_covariance
    return replace(at, added_covariance=added)


def _gone(at: Fit, effects: Sequence[Effect]) -> list[Effect]:
    """Known causes, beside new ones of their name, that are zero to within their U (k = 2)."""
    named = {effect.label for effect in effects if effect.nonlinear.field and not is_change(effect)}
    identities = _identities(effects)
    gone = []
    for effect, place in zip(at.effects, at.problem.vector.slices, strict=True):
        if effect.label in named and effect.identity not in identities:
            u = np.sqrt(np.diag(at.covariance[place, place]))
            if np.all(np.abs(effect.values) <= COVERAGE_FACTOR * u):
                gone.append(effect)
    return gone


def refitted(
    problem_of: ProblemOf,
    effects: Sequence[Effect],
    gone: Sequence[Effect] = (),
    used: Mask | None = None,
) -> Fit:
    """All refitted with these causes, within their u, without known ones that are gone; without
    ``used``, gross errors are looked for. Curves stay at their values: so many parameters are the
    posterior's.
    """
    held = [effect for effect in effects if effect.free_form]
    estimated = [effect.at((), effect.u) for effect in effects if not effect.free_form]
    return fit(problem_of(estimated, held, gone=gone), used=used)


def free(effect: Effect) -> Effect:
    """The effect, free within many typical magnitudes."""
    width = FREEDOM if len(effect.terms) < MANY_PARAMETERS else FREEDOM_OF_MANY
    return effect.at((), tuple(width * t.typical for t in effect.terms))


def _explored(choice: Choice) -> Choice:
    """The posterior from several starts, the most probable set so far among them."""
    posterior = choice.posterior
    return replace(choice, posterior=explore(posterior.space, posterior.top))


def _climbed(
    at: Fit,
    library: tuple[Variants, ...],
    all_covariates: tuple[Covariate, ...],
    folds: Index,
    effects: Sequence[Effect],
    before: _Before | None,
) -> Choice:
    """The posterior where a fit with some causes ended, with the noise that the round before found.

    An error curve, which has many parameters, may follow readings that scatter. So the first round
    takes the more probable: the curves, or the scatter of readings in their place.
    """
    design = design_of(at, library, all_covariates)
    candidates = Candidates.of(design, library)
    previous = before or _Before(at.point.prediction.poses, at.chi2.dof)
    blocks_of_causes = [b for b in design.blocks if b.candidate < design.causes]  # the first ones
    identities = [library[b.candidate][b.variant].identity for b in blocks_of_causes]
    start = tuple(sorted(identities.index(effect.identity) for effect in effects))
    climb = _Climb(candidates, start, previous.scatter)
    choice = Choice(at, climb.ended(previous), library, all_covariates, folds, previous.scatter)
    if before is not None or noise_is_known(at):
        return choice
    scatter = choice.scatter_beside(choice.posterior.without_curves)
    if not scatter.readings.any():
        return choice
    posterior = replace(climb, scatter=scatter).ended(previous)
    scattered = replace(choice, posterior=posterior, scatter=scatter)
    return max(
        choice, scattered, key=lambda one: one.posterior.log_density + one.log_density_of_scatter
    )


@dataclass(frozen=True, eq=False)
class _Climb:
    """What a round has in common for every noise that it is tried with."""

    candidates: Candidates
    start: Blocks
    scatter: ReadingScatter | None

    def ended(self, previous: _Before) -> Posterior:
        """The posterior with the most probable noise.

        What records of one posture share is either noise or what causes do there. So two noises are
        tried: shared beside the round before, and nothing shared; each then with what its most
        probable set leaves.
        """
        if not self.noise.repeat:
            return self.with_noise(self.noise)
        starts = [self.shared(previous.tips, previous.dof)]
        if not self.noise.is_about(starts[0]):
            starts.append(self.noise)
        return max(map(self.settled, starts), key=lambda posterior: posterior.log_density)

    @cached_property
    def noise(self) -> RecordNoise:
        """Of records of one posture that share nothing."""
        at = self.candidates.design.fit
        return RecordNoise.of_postures(at, (self.scatter or at.noise).whitening)

    def shared(self, tips: Array, dof: float) -> RecordNoise:
        """With the error that records of one posture share beside some tips."""
        return self.noise.likeliest(self.candidates.design.deviations(tips), dof)

    def with_noise(self, noise: RecordNoise) -> Posterior:
        design = self.candidates.design
        stated = noise_is_known(design.fit) if self.scatter is None else self.scatter.as_stated
        gram = gram_of(design, noise.scaled(stated))
        return climb(ModelSpace(self.candidates, gram, stated), self.start)

    def settled(self, noise: RecordNoise) -> Posterior:
        """The posterior with the error that its most probable set leaves, from a first one."""
        posterior = self.with_noise(noise)
        for _ in range(MOST_EXPLORATIONS):
            model = posterior.top_model
            again = self.shared(model.all_tips, model.dof)
            if again.is_about(posterior.noise):
                break
            posterior = self.with_noise(again)
        return posterior


def _with_variants(library: Sequence[Variants], effects: list[Effect]) -> tuple[Variants, ...]:
    """The library with the refined variants among those that are tried."""
    there = {variant.identity for variants in library for variant in variants}
    refined = {effect.label: effect.at(()) for effect in effects if effect.identity not in there}
    with_refined = []
    for variants in library:
        # Of several candidates of one label, the first has the variants.
        new = refined.pop(variants[0].label, None)
        with_refined.append(variants if new is None else _with_variant(variants, new))
    return tuple(with_refined)


def _with_variant(variants: Variants, refined: Effect) -> Variants:
    """A refined variant replaces the nearest that was tried: if there were more about the likeliest
    value than elsewhere, their prior would be larger there.
    """
    nonlinear = refined.nonlinear
    alike = [
        k
        for k, variant in enumerate(variants)
        if nonlinear.field
        and type(variant) is type(refined)
        and not (is_change(variant) or nonlinear.is_preferred(variant))
        and nonlinear.at(variant, nonlinear.value(refined)).identity == refined.identity
    ]
    nearest = min(
        alike,
        key=lambda k: abs(nonlinear.value(variants[k]) - nonlinear.value(refined)),
        default=len(variants),
    )
    return (*variants[:nearest], refined, *variants[nearest + 1 :])
