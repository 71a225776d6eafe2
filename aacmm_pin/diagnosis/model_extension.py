"""From the posterior to an extended arm: explore, refit at the most probable set, explore there, until the set stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.distributions import chi2_isf
from aacmm_pin._support.progress import bar
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.calibration.fit import Fit, fit
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.shared_exclusions import clusters
from aacmm_pin.calibration.variance_components import FALSE_EXCLUSION, squared_distances
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.covariates import Carried, Covariate
from aacmm_pin.diagnosis.design_matrix import Design, design_of
from aacmm_pin.diagnosis.exploration import explore, without_block
from aacmm_pin.diagnosis.gram_matrix import Gram, products_of
from aacmm_pin.diagnosis.held_postures import HeldPostures, RecordNoise
from aacmm_pin.diagnosis.model_space import Blocks, Candidates, ModelSpace
from aacmm_pin.diagnosis.posterior import Posterior
from aacmm_pin.diagnosis.reading_scatter import ReadingScatter
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect
from aacmm_pin.measurements.records import Measurements

MOST_ROUNDS = 6
"""The scatter that is left shrinks from refit to refit and lets weaker causes be seen; it settles long before this."""
FEWEST_BACK = 3
"""So many records have to make sense at once before they are more than gross errors."""
A_FEW = 0.005
"""A smaller part of the records than this is left out without asking whether they make sense together."""
NOT_FAR = 5.0
"""Excluded records up to so many times the limit away are tried with the others."""
EXCEPTIONAL = 2.0
"""An inner value that machines are made with is taken unless the log evidence falls by this."""
RIVALS = 2
"""So many others in the place of a cause are refined too."""
FINER = 200
"""Parts of a step between inner values that were tried in which their evidence is summed."""
LETTERS = 40
"""Of the causes found so far, a bar shows this much."""
FREEDOM = 10.0
"""Within so many typical magnitudes a cause is refitted …"""
FREEDOM_OF_MANY = 2.0
"""… and where its parameters are many, within so many: some may be determined by few records."""
MANY = 8
"""From so many parameters on."""

ProblemOf = Callable[..., Problem]
"""The calibration problem with some effects estimated too, and with others held."""


@dataclass(frozen=True, eq=False)
class Choice:
    """What was found, at the point where the last refit ended.

    Attributes:
        fit: refit of geometry and of the causes of the median probability model.
        posterior: over sets of blocks, linear at the most probable set.
        library, others: the candidates.
        parts: part of each record for leaving out (n,).
        held: inner products from which parts can be left out.
        scatter: of readings beyond the stated noise; None where the records show none.
        otherwise: labels of causes and covariates that would be found if excluded records counted, where without these no
            cause is.
        kept_alone: records that the arm recalibrated alone, by its own scatter, does not exclude (n,); None: the used ones.
    """

    fit: Fit
    posterior: Posterior
    library: tuple[Variants, ...]
    others: tuple[Covariate, ...]
    parts: Index
    held: Gram
    scatter: ReadingScatter | None = None
    otherwise: tuple[str, ...] = ()
    kept_alone: NDArray[np.bool_] | None = None

    @property
    def candidates(self) -> Candidates:
        """What may be in a set."""
        return self.posterior.space.candidates

    @property
    def design(self) -> Design:
        """Columns of all candidates."""
        return self.candidates.design

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Records that count when they are left out and predicted (n,): all but those that both arms exclude.

        A record that only the extended arm excludes may be one that its causes are wrong for. One that the recalibrated
        arm excludes too is a gross error: either arm is equally far off there, and a few such records would be all that
        a gain in RMS shows.
        """
        used = self.fit.used
        return np.asarray(used if self.kept_alone is None else used | self.kept_alone)

    @cached_property
    def of_part(self) -> dict[int, tuple[Index, Measurements]]:
        """The counted records of each part that can be left out, their numbers first."""
        rows = {number: np.flatnonzero(self.counted & (self.parts == number)) for number in self.held.parts}
        return {number: (own, self.fit.problem.measurements.take(own)) for number, own in rows.items()}

    @cached_property
    def tips(self) -> Array:
        """Tips (n, 3), turns behind them (n, 6), with the median probability model and the background [m, rad]."""
        return self.posterior.left.tips()

    @cached_property
    def scatter_left(self) -> ReadingScatter:
        """Scatter of readings and tips beside all that was found."""
        left, postures = self.posterior.left, self.posterior.space.gram.products.noise.postures
        share = min(max(left.dof, 1.0) / max(left.base.gram.free, 1), 1.0)
        return ReadingScatter.of(self.design.fit, self.design.deviations(self.tips), share, postures)

    @property
    def causes(self) -> Blocks:
        """Blocks of the median probability model that are causes of the library, the strongest first."""
        own = [k for k in self.posterior.median if self.candidates.is_cause(k)]
        return tuple(sorted(own, key=lambda k: -self.posterior.strength(k)))

    @property
    def covariates(self) -> Blocks:
        """Its blocks that are covariates, the strongest first."""
        own = [k for k in self.posterior.median if not self.candidates.is_cause(k)]
        return tuple(sorted(own, key=lambda k: -self.posterior.strength(k)))

    @property
    def effects(self) -> list[Effect]:
        """Its causes."""
        return [self.variant(k) for k in self.causes]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of its causes and its covariates."""
        names = self.design.names
        return tuple(names[self.candidates.owner(k)] for k in (*self.causes, *self.covariates))

    def in_one_part(self, block: int) -> bool:
        """Whether a block moves only records that are left out together, so that the others say nothing of it."""
        moved = self.design.columns(block).any(axis=(1, 2))
        inside, every = (np.unique(self.parts[records]).size for records in (moved & self.fit.used, self.fit.used))
        return bool(inside == 1 < every)

    def covariate(self, block: int) -> Covariate:
        """The covariate of a block."""
        return self.others[self.candidates.owner(block) - self.design.causes]

    def way(self, block: int) -> Carried:
        """How it acts."""
        return self.covariate(block).variants[self.design.blocks[block].variant]

    def variant(self, block: int) -> Effect:
        """The effect of a block."""
        b = self.design.blocks[block]
        return self.library[b.candidate][b.variant]


def choose(
    problem_of: ProblemOf,
    first: Fit,
    library: Sequence[Variants],
    others: Sequence[Covariate],
    parts: Index,
    progress: bool = False,
) -> Choice:
    """Explore at the recalibrated arm, refit with what was found, explore again there, until the set stays.

    A strong cause in few records (a moved seat, a place in the room) makes these look like gross errors, which hides it.
    So where records were excluded, the search is tried with the nearer of them, and those of one time, joint or place, put
    back too; what it finds is taken if it makes sense of them, of one or two only where there is nothing else, and then not
    as found.
    """
    found = _standing(problem_of, first, tuple(library), tuple(others), parts, progress)
    nearer, least = _put_back(first) & _put_back(found.fit), FEWEST_BACK if found.causes else 1
    back = int(np.sum(nearer & ~(first.used & found.fit.used)))
    if back >= max(least, A_FEW * len(nearer)):
        judge, doubtful = found.fit, _doubtful(found, found.fit)
        _release(found)  # there is room for one of them
        wider = fit(problem_of([]), used=nearer)
        again = _standing(problem_of, wider, tuple(library), tuple(others), parts, progress, nearer)
        fewer = int(doubtful.sum() - _doubtful(again, judge).sum())
        if fewer >= FEWEST_BACK:
            found, again = again, found
        elif fewer > 0 and not found.causes:
            found = replace(found, otherwise=again.labels)
        _release(again)
    found = replace(found, kept_alone=first.used)
    if not _torn(found.design.fit, parts):
        return found
    _release(found)
    return replace(found, held=Gram(products_of(found.design, parts, found.held.products.noise)))


def _release(choice: Choice) -> None:
    choice.posterior.space.gram.products.release()


def _doubtful(choice: Choice, judge: Fit) -> NDArray[np.bool_]:
    """Records that do not fit with all that was found, covariates included, by the scatter of ``judge`` (n,)."""
    return np.asarray(_times_the_limit(choice.design.fit, choice.design.deviations(choice.tips), judge) > 1.0)


def _put_back(of: Fit) -> NDArray[np.bool_]:
    """The records that count, and those that were excluded but not by far, or that are neighbours (n,)."""
    far = _times_the_limit(of, of.solution.system.off, of)
    dense = [cluster.records for cluster in clusters(of.problem.model.arm, of.problem.measurements, of.excluded, of.used)]
    return np.asarray(of.used | (of.excluded & np.any([far < NOT_FAR, *dense], axis=0)))


def _times_the_limit(at: Fit, off: Array, judge: Fit) -> Array:
    """Residual of each record (n, 3 or 6), over what a good one may have by the scatter of ``judge`` (n,)."""
    says = at.observations.says
    found, limit = np.zeros(len(off)), chi2_isf(FALSE_EXCLUSION / len(off), at.observations.counts[says])
    found[says] = np.sqrt(squared_distances(off[says], judge.residual_noise[says]) / limit)
    return found


def _standing(
    problem_of: ProblemOf,
    first: Fit,
    library: tuple[Variants, ...],
    others: tuple[Covariate, ...],
    parts: Index,
    progress: bool,
    used: NDArray[np.bool_] | None = None,
) -> Choice:
    """Rounds of exploration and refit, each refit at the most probable set; last, a refit at the median model.

    Each refit looks for gross errors anew, or is of the records ``used``; the last one then of those that fit with all that
    was found, where covariates are a part of it.
    """
    at, effects, before, seen = first, list[Effect](), None, {frozenset[Any]()}
    with bar(progress, "search for causes", "round") as rounds:  # nobody knows how many it takes
        for _ in range(MOST_ROUNDS):
            found = _explored(at, library, others, parts, effects, before)
            rounds.update()
            best = [_refined(found, k) for k in _top_causes(found)]
            identities, before = frozenset(e.identity for e in best), _Before.of(found)
            if identities in seen and before.settled(found):
                break
            rivals = [rival for k in _top_causes(found) for rival in _rivals(found, k)]
            rounds.set_postfix_str(", ".join(effect.label for effect in best)[:LETTERS])
            _release(found)  # there is room for its rows or for those of the refit
            if identities != frozenset(e.identity for e in effects):
                at = refitted(problem_of, best, used=used) if best else first
            if not at.tells_noise:  # more causes than these records can carry
                return replace(found, fit=first, posterior=replace(found.posterior, weights={(): 1.0}))
            effects = best
            seen.add(identities)
            library = _with_variants(library, [*rivals, *effects])
        if used is not None and found.covariates:
            used = used & ~_doubtful(found, found.design.fit)
            first = fit(problem_of([]), used=used)
        elif used is not None:  # gross errors are looked for with all causes
            used, found = None, replace(found, fit=first)
        return replace(found, fit=_extended(problem_of, found, first, used))


@dataclass(frozen=True, eq=False)
class _Before:
    """What a round leaves for the next one.

    Attributes:
        tips: with all that was found.
        scatter: of readings and tips beside that; None where the stated noise was all there was to begin with.
    """

    tips: Array
    scatter: ReadingScatter | None

    @staticmethod
    def of(found: Choice) -> _Before:
        return _Before(found.tips, None if noise_is_known(found.design.fit) else found.scatter_left)

    def settled(self, found: Choice) -> bool:
        """Whether the scatter is about what a round reckoned with."""
        if self.scatter is None:
            return True
        at = found.design.fit
        reckoned = at.distance_of(at.residual_noise) if found.scatter is None else found.scatter.size
        same_kind = found.scatter is not None or not self.scatter.readings.any()
        return same_kind and bool(abs(np.log(self.scatter.size / reckoned)) < np.log(THRESHOLDS.rescaled))


def _extended(problem_of: ProblemOf, found: Choice, first: Fit, used: NDArray[np.bool_] | None) -> Fit:
    """The refit at the median probability model; what is uncertain of inner values is in its u.

    A known cause beside one of its name with another inner value, and of which nothing is left, is gone.
    """
    effects = [effect.at(()) for effect in found.effects]
    if not effects:
        return first
    fitted = {e.identity for e in found.fit.solution.effects[-found.fit.problem.candidates :]}
    same = found.fit.problem.candidates == len(effects) and fitted == {e.identity for e in effects}
    same = same and (used is None or np.array_equal(used, found.fit.used))
    at = found.fit if same else refitted(problem_of, effects, used=used)
    if gone := _gone(at, effects):
        at = refitted(problem_of, effects, gone, used)
        effects = [_without(at, effects, k, gone) for k in range(len(effects))]
        at = refitted(problem_of, effects, gone, used)
    return _told_inner(at, effects)


def _gone(at: Fit, effects: Sequence[Effect]) -> list[Effect]:
    """Known causes, beside new ones of their name, whose values are zero to within their U (k = 2)."""
    named = {effect.label for effect in effects if effect.inner and not is_change(effect)}
    own = {effect.identity for effect in effects}
    found = []
    for effect, place in zip(at.solution.effects, at.problem.vector.slices, strict=True):
        if effect.label in named and effect.identity not in own:
            u = np.sqrt(np.diag(at.covariance[place, place]))
            if np.all(np.abs(effect.values) <= COVERAGE_FACTOR * u):
                found.append(effect)
    return found


def _without(at: Fit, effects: Sequence[Effect], number: int, gone: Sequence[Effect]) -> Effect:
    """One of the effects, with the likeliest inner value where it has taken the place of a known one."""
    effect = effects[number]
    if effect.label not in {old.label for old in gone} or effect.exceptional:
        return effect
    rest = [other for k, other in enumerate(effects) if k != number]
    tried = effect.refined(at.problem.measurements)
    return _likeliest(tried, _beside(at, tuple(tried), rest))


def refitted(
    problem_of: ProblemOf,
    effects: Sequence[Effect],
    gone: Sequence[Effect] = (),
    used: NDArray[np.bool_] | None = None,
) -> Fit:
    """All refitted with these causes, without known ones that are gone; without ``used``, gross errors are looked for."""
    return fit(problem_of([free(effect) for effect in effects], gone=gone), used=used)


def free(effect: Effect) -> Effect:
    """The effect, free within many typical magnitudes."""
    width = FREEDOM if len(effect.terms) < MANY else FREEDOM_OF_MANY
    return effect.at((), tuple(width * t.typical for t in effect.terms))


def noise_is_known(at: Fit) -> bool:
    """Whether the stated noise is all that the fit found."""
    return at.stated and max(at.noise.scatters.tip, at.noise.scatters.turn) == 0.0


def _explored(
    at: Fit,
    library: tuple[Variants, ...],
    others: tuple[Covariate, ...],
    parts: Index,
    effects: Sequence[Effect],
    before: _Before | None,
) -> Choice:
    """The posterior where a fit with some causes ended, with the noise that the round before found."""
    design = design_of(at, library, others, at.problem.candidates)
    tips = at.solution.point.prediction.poses if before is None else before.tips
    scatter = None if before is None else before.scatter
    whitening = at.noise.whitening if scatter is None else scatter.whitening
    noise = RecordNoise(whitening, HeldPostures.of(at, design.deviations(tips), whitening))
    # With all records there is no need to take an observation's unknown points apart.
    gram = Gram(products_of(design, np.zeros_like(parts) if _torn(at, parts) else parts, noise))
    candidates = Candidates.of(design, library)
    space = ModelSpace(candidates, gram, noise_is_known(at) if scatter is None else scatter.as_stated)
    start = tuple(sorted(_block_of(candidates, library, effect) for effect in effects))
    return Choice(at, explore(space, [start]), library, others, parts, gram, scatter)


def _torn(at: Fit, parts: Index) -> bool:
    """Whether the records of a seat, or of seats that a bar connects, are in several parts."""
    touched = at.observations.seat >= 0
    pairs = np.stack([at.observations.clusters[at.observations.seat[touched]], parts[touched]], axis=1)
    return len(np.unique(pairs, axis=0)) > len(np.unique(pairs[:, 0]))


def _top_causes(choice: Choice) -> list[int]:
    """Blocks of the most probable set that are causes of the library."""
    return [k for k in choice.posterior.top if choice.candidates.is_cause(k)]


def _block_of(candidates: Candidates, library: tuple[Variants, ...], effect: Effect) -> int:
    for number, block in enumerate(candidates.blocks):
        if block.candidate < len(library) and library[block.candidate][block.variant].identity == effect.identity:
            return number
    raise LookupError(effect.label)


# --- inner values: orders, times, time constants


def _told_inner(at: Fit, effects: Sequence[Effect]) -> Fit:
    """A refit that counts the inner values of new causes as uncertain; a known one changes its values alone."""
    new, found = {effect.label for effect in effects if not is_change(effect)}, {}
    for effect, own in zip(at.solution.effects, at.problem.vector.slices, strict=True):
        if effect.label in new and not at.problem.start[own].any():
            rest = [other for other in effects if other.label != effect.label]
            found[effect.key] = {name: _least_u(at, effect, name, rest) for name in effect.inner_widths()}
    return replace(at, found=found)


def _least_u(at: Fit, effect: Effect, name: str, rest: Sequence[Effect]) -> float:
    """Half of the way from an inner value to the farther end of its 95 % interval, by the evidence of others near it.

    A time constant that is longer than the records last has far more room upwards than its derivative says.
    """
    tried = effect.at(()).refined(at.problem.measurements)
    if len(tried) < 2 or effect.exceptional:
        return 0.0
    values, odds = np.array([getattr(each, name) for each in tried]), _beside(at, tuple(tried), rest)
    fine = np.linspace(0.0, len(tried) - 1.0, FINER * (len(tried) - 1) + 1)
    dense, odds = (scipy.interpolate.CubicSpline(np.arange(len(tried)), each)(fine) for each in (values, odds))
    share = np.cumsum(np.exp(odds - logsumexp(odds)))
    low, high = dense[np.searchsorted(share, (0.025, 0.975)).clip(max=len(fine) - 1)]
    value = getattr(effect, name)
    return float(max(high - value, value - low) / 2.0)


def _with_variants(library: Sequence[Variants], effects: list[Effect]) -> tuple[Variants, ...]:
    """The library with the refined variants among those that are tried."""
    there = {variant.identity for variants in library for variant in variants}
    refined = {effect.label: effect.at(()) for effect in effects if effect.identity not in there}
    # Of several candidates of one label, the first has the variants.
    return tuple((*v, refined.pop(v[0].label)) if v[0].label in refined else v for v in library)


def _refined(choice: Choice, block: int) -> Effect:
    """The effect with its inner parameter, or the special case of it, where the evidence is largest, the others held."""
    effect, records = choice.variant(block).at(()), choice.fit.problem.measurements
    if is_change(choice.variant(block)):  # a cause that is known changes its values alone
        return effect
    there = {variants[0].label for variants in choice.library}
    series = [effect.refined(records)]
    if special := [case for case in effect.special_cases() if case.label in there]:
        series.append(special[int(np.argmax(_evidences(choice, block, special)))].refined(records))
    if len(series[0]) < 2 and len(series) < 2:
        return effect
    every = _evidences(choice, block, [tried for several in series for tried in several])
    evidences = np.split(every, np.cumsum([len(several) for several in series])[:-1])
    best = int(np.argmax([each.max() for each in evidences]))
    return _likeliest(series[best], evidences[best])


def _rivals(choice: Choice, block: int) -> list[Effect]:
    """The likeliest others in the place of a block, refined as it is: where they were tried they are worse than need be.

    But for those with inner values that machines are made with, such as orders: these are the values that are tried.
    """
    records, candidates = choice.fit.problem.measurements, choice.candidates
    values = choice.posterior.space.additions(without_block(choice.posterior.top, block))
    rest = [choice.variant(k).at(()) for k in _top_causes(choice) if k != block]
    best = {candidates.owner(block): block}
    for k in np.argsort(-values, kind="stable").tolist():
        if candidates.is_cause(k) and np.isfinite(values[k]):
            best.setdefault(candidates.owner(k), k)
    others = [*best.values()][1 : RIVALS + 1]
    found = []
    for effect in map(choice.variant, others):
        tried = effect.at(()).refined(records) if effect.inner and not is_change(effect) else []
        if tried and not any(each.exceptional for each in tried):
            found.append(_likeliest(tried, _beside(choice.fit, tuple(tried), rest)))
    return found


def _likeliest(tried: list[Effect], evidences: Array) -> Effect:
    """The effect with the largest evidence, or one with an exceptional inner value that has nearly as much."""
    best = int(np.argmax(evidences))
    exceptional = [k for k, e in enumerate(tried) if e.exceptional]
    likeliest = max(exceptional, key=lambda k: evidences[k], default=best)
    if exceptional and evidences[likeliest] > evidences[best] - EXCEPTIONAL:
        return tried[likeliest]
    return _between(tried, evidences, best)


def _between(tried: list[Effect], evidences: Array, best: int) -> Effect:
    """The effect at the top of the parabola through the best of those tried and its neighbours."""
    effect = tried[best]
    if not effect.inner_widths() or not 0 < best < len(tried) - 1:
        return effect
    name = next(iter(effect.inner_widths()))
    near = (best - 1, best, best + 1)
    places, heights = np.array([getattr(tried[k], name) for k in near]), evidences[list(near)]
    bend, slope, _ = np.polyfit(places - places[1], heights, 2)
    top = -slope / (2.0 * bend) if bend < 0.0 else 0.0
    inner: dict[str, Any] = {name: float(places[1] + np.clip(top, places[0] - places[1], places[2] - places[1]))}
    return replace(effect, **inner)


def _evidences(choice: Choice, block: int, tried: Sequence[Effect]) -> Array:
    """Log evidence of each effect in the place of a block, the other causes of the most probable set held."""
    rest = [choice.variant(k).at(()) for k in _top_causes(choice) if k != block]
    variants = choice.library[choice.candidates.owner(block)]
    first = variants[:1] if is_change(variants[0]) else ()  # in the place of a cause that is known
    shares = np.log([effect.share(choice.fit.problem.measurements) for effect in tried])
    return _beside(choice.fit, (*first, *tried), rest)[len(first) :] + shares


def _beside(at: Fit, variants: Variants, rest: Sequence[Effect]) -> Array:
    """Log evidence of each variant beside the rest, where a refit with one of them and the rest ended."""
    library = (variants, *((effect,) for effect in rest))
    design = design_of(at, library, [], at.problem.candidates)
    gram = Gram(products_of(design, np.zeros(len(at.used), dtype=np.intp)))
    space = ModelSpace(Candidates.of(design, library), gram, noise_is_known(at))
    others = tuple(range(len(variants), len(variants) + len(rest)))
    return np.asarray(logsumexp(space.conditional(space.marginal(others).best).additions[: len(variants)], axis=1))


@dataclass(frozen=True)
class Step:
    """What the records determine of an inner value in which a cause steps, such as the time of a slip [its unit].

    Of its posterior over the values near it, each of which stands for the gap around it.

    Attributes:
        u: standard uncertainty.
        low, high: the first and the last of the values that together have 95 % of the probability.
    """

    u: float
    low: float
    high: float


def step_of(choice: Choice, block: int, name: str) -> Step:
    """What the records determine of the inner value ``name`` of a block."""
    chosen, records = choice.variant(block).at(()), choice.fit.problem.measurements
    tried = chosen.refined(records)
    values = np.array([getattr(effect, name) for effect in tried])
    odds = _evidences(choice, block, tried)
    share = np.exp(odds - logsumexp(odds))
    gaps = np.array([effect.step_width(records) for effect in tried])
    u = float(np.sqrt(share @ (np.square(values - getattr(chosen, name)) + np.square(gaps) / 12.0)))
    low, high = values[np.searchsorted(np.cumsum(share), (0.025, 0.975)).clip(max=len(values) - 1)]
    return Step(u, float(low), float(high))
