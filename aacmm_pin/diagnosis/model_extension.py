"""From chosen blocks to an extended arm: refine what was tried in steps, refit everything, choose again until it stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.distributions import chi2_isf
from aacmm_pin._support.progress import bar
from aacmm_pin.calibration.fit import Fit, fit
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.shared_exclusions import together
from aacmm_pin.calibration.variance_components import FALSE_EXCLUSION, squared_distances
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.covariates import Covariate
from aacmm_pin.diagnosis.design_matrix import Design, design_of
from aacmm_pin.diagnosis.evidence import Conditional, evidence_of
from aacmm_pin.diagnosis.forward_backward_selection import SURE, Question, search
from aacmm_pin.diagnosis.gram_matrix import Gram, products_of
from aacmm_pin.diagnosis.nuisance_projection import Projection, freedom
from aacmm_pin.effects import Effect
from aacmm_pin.measurements.records import Measurements

MOST_ROUNDS = 10
"""The scatter that is left shrinks from refit to refit and lets weaker causes be seen; it settles long before this."""
LIBRARY = 0.9
"""Probability, if anything is there, that it is a cause of the library."""
FEWEST_BACK = 3
"""So many records have to make sense at once before they are more than gross errors."""
A_FEW = 0.005
"""A smaller part of the records than this is left out without asking whether they make sense together."""
NOT_FAR = 5.0
"""Excluded records up to so many times the limit away are tried with the others."""
EXCEPTIONAL = 2.0
"""An inner value that machines are made with is taken unless the log evidence falls by this."""
REPLACED = 2
"""So many times the inner value of a cause in the place of a known one is looked for, and all refitted."""
RIVALS = 2
"""So many others in the place of a cause are refined too."""
FINER = 200
"""Parts of a step between inner values that were tried in which their evidence is summed."""
LETTERS = 40
"""Of the causes found so far, a bar shows this much."""

ProblemOf = Callable[..., Problem]
"""The calibration problem with these effects estimated too, and without those, where any are named that are gone."""


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen, at the point where the refit with it ended.

    Attributes:
        fit: refit of geometry and causes.
        design: columns there; the chosen causes are candidates.
        question, gram: what the search was asked, and the inner products it used.
        admitted: blocks, strongest first.
        library, others: the candidates.
        parts: part of each record for leaving out (n,).
        held: inner products from which parts can be left out.
        otherwise: labels of causes that would be found if excluded records counted, where without these there is none.
        kept_alone: records that the arm recalibrated alone, by its own scatter, does not exclude (n,); None: the used ones.
    """

    fit: Fit
    design: Design
    question: Question
    gram: Gram
    admitted: tuple[int, ...]
    library: tuple[Variants, ...]
    others: tuple[Covariate, ...]
    parts: Index
    held: Gram
    otherwise: tuple[str, ...] = ()
    kept_alone: NDArray[np.bool_] | None = None

    @cached_property
    def left(self) -> Conditional:
        """What is left beside all that was admitted."""
        return Conditional.of(self.gram, self.admitted, self.question.stated)

    @cached_property
    def bare(self) -> Conditional:
        """What is left beside the nuisances alone."""
        return Conditional(Projection(self.gram, ()))

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

    @property
    def tips(self) -> Array:
        """Tips (n, 3), turns behind them (n, 6), with all that was admitted, covariates included, refitted [m, rad]."""
        return self.design.moved(self.admitted, self.left.projection.solution())

    @property
    def effects(self) -> list[Effect]:
        """The admitted causes of the library, with the values that the refit gave them."""
        return [self.variant(k) for k in self.causes]

    @property
    def causes(self) -> tuple[int, ...]:
        """Admitted blocks that are causes of the library."""
        return tuple(k for k in self.admitted if self.question.owner(k) < self.design.causes)

    def in_one_part(self, block: int) -> bool:
        """Whether a block moves only records that are left out together, so that the others say nothing of it."""
        moved = self.design.columns(block).any(axis=(1, 2))
        inside, every = (np.unique(self.parts[records]).size for records in (moved & self.fit.used, self.fit.used))
        return bool(inside == 1 < every)

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
    """Search at the recalibrated arm, refit with what was found, search again there, until the choice stays.

    A strong cause in few records (a moved seat, a place in the room) makes these look like gross errors, which hides it.
    So where records were excluded, the search is tried with the nearer of them, and those of one time, put back too; what it
    finds is taken if it makes sense of them, of one or two only where there is nothing else, and then not as found.
    """
    nearer = _put_back(first)
    found = _standing(problem_of, first, tuple(library), tuple(others), parts, progress)
    back = int(nearer.sum() - first.used.sum())
    if back >= max(1 if not found.causes else FEWEST_BACK, A_FEW * len(nearer)):
        found.gram.products.release()  # there is room for one of them
        wider = fit(problem_of([]), used=nearer)
        again = _standing(problem_of, wider, tuple(library), tuple(others), parts, progress)
        fewer = _doubtful(found, first) - _doubtful(again, first)
        if fewer >= FEWEST_BACK:
            found, again = again, found
        elif fewer > 0 and not found.causes:
            found = replace(found, otherwise=tuple(effect.label for effect in again.effects))
        again.gram.products.release()
    found = replace(found, kept_alone=first.used)
    if not _torn(found.design.fit, parts):
        return found
    found.gram.products.release()
    return replace(found, held=Gram(products_of(found.design, parts)))


def _doubtful(choice: Choice, first: Fit) -> int:
    """How many records do not fit with all that was admitted, covariates included, by the scatter of the first fit."""
    return int(np.sum(_times_the_limit(choice.fit, choice.tips, first) > 1.0))


def _put_back(first: Fit) -> NDArray[np.bool_]:
    """The records that count, and those that were excluded but not by far, or all at one time (n,)."""
    far = _times_the_limit(first, first.solution.point.prediction.poses, first)
    stretch, _ = together(first.excluded, first.used, first.problem.measurements)
    return np.asarray(first.used | (first.excluded & ((far < NOT_FAR) | stretch)))


def _times_the_limit(at: Fit, tips: Array, judge: Fit) -> Array:
    """Distance of each record's tip from its target, over what a good one may have by the scatter of ``judge`` (n,)."""
    says = at.observations.says
    off = at.observations.deviations(tips, at.solution.point.seats)
    found, limit = np.zeros(len(tips)), chi2_isf(FALSE_EXCLUSION / len(tips), at.observations.counts[says])
    found[says] = np.sqrt(squared_distances(off[says], judge.residual_noise[says]) / limit)
    return found


def _standing(
    problem_of: ProblemOf,
    first: Fit,
    library: tuple[Variants, ...],
    others: tuple[Covariate, ...],
    parts: Index,
    progress: bool,
) -> Choice:
    """Rounds of search and refit from one start."""
    with bar(progress, "search for causes", "round") as rounds:  # nobody knows how many it takes
        found = _chosen(first, library, others, parts, [])
        rounds.update()
        for _ in range(MOST_ROUNDS):
            if not found.causes:
                return replace(found, fit=first)
            effects = [_refined(found, k) for k in found.causes]
            rivals = [rival for k in found.causes for rival in _rivals(found, k)]
            rounds.set_postfix_str(", ".join(effect.label for effect in effects)[:LETTERS])
            del found  # its columns are as large as those that come
            refit = refitted(problem_of, effects)
            if not refit.tells_noise:  # more causes than these records can carry
                return replace(_chosen(first, library, others, parts, []), admitted=())
            found = _chosen(refit, _with_variants(library, [*rivals, *effects]), others, parts, effects)
            rounds.update()
            if {e.identity for e in found.effects} == {e.identity for e in effects}:
                return found
        # Two sets take turns, each the better one beside the other's values: what was admitted last is what is refitted.
        return replace(found, fit=refitted(problem_of, found.effects)) if found.causes else replace(found, fit=first)


def refitted(problem_of: ProblemOf, effects: Sequence[Effect]) -> Fit:
    """All refitted with these causes."""
    return fit(problem_of([free(effect) for effect in effects]))


def in_its_place(problem_of: ProblemOf, choice: Choice) -> Fit:
    """The refit of a choice in which a new cause stands in the place of the known one with another inner value.

    The known one stays beside it where that is as sure as any cause has to be. The new one's inner value is looked for anew
    where it does not. What is uncertain of inner values is in the u of the result.
    """
    effects, at = choice.effects, _told_inner(choice.fit, choice.effects)
    places = {effect.label for effect in effects if effect.inner and not is_change(effect)}
    gone = []
    for effect, own in zip(at.solution.effects, at.problem.vector.slices, strict=True):
        if effect.label in places and effect.identity not in {cause.identity for cause in effects}:
            typical = np.array([term.typical for term in effect.terms])
            information = typical[:, None] * np.linalg.inv(at.covariance[own, own]) * typical
            if evidence_of(information[None], (information @ (effect.values / typical))[None])[0] < SURE:
                gone.append(effect)
    without = partial(problem_of, gone=gone)
    for _ in range(REPLACED if gone else 0):
        at = refitted(without, effects)
        for k, effect in enumerate(effects):
            if effect.label in {old.label for old in gone} and not (is_change(effect) or effect.exceptional):
                tried = effect.at(()).refined(at.problem.measurements)
                rest = [other.at(()) for other in effects if other is not effect]
                effects[k] = _likeliest(tried, _beside(at, tuple(tried), rest))
    return _told_inner(refitted(without, effects), effects) if gone else at


def _told_inner(at: Fit, effects: Sequence[Effect]) -> Fit:
    """A refit that counts the inner values of new causes as uncertain; a known one changes its values alone."""
    new, found = {effect.label for effect in effects if not is_change(effect)}, {}
    for effect, own in zip(at.solution.effects, at.problem.vector.slices, strict=True):
        if effect.label in new and not at.problem.start[own].any():
            rest = [other.at(()) for other in effects if other.label != effect.label]
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


def free(effect: Effect) -> Effect:
    """The effect as the search took it: anywhere within a few typical magnitudes."""
    return effect.at((), tuple(freedom(len(effect.terms)) * t.typical for t in effect.terms))


def _chosen(
    at: Fit,
    library: tuple[Variants, ...],
    others: tuple[Covariate, ...],
    parts: Index,
    effects: list[Effect],
) -> Choice:
    design = design_of(at, library, others, at.problem.candidates)
    # With all records there is no need to take an observation's unknown points apart.
    gram = Gram(products_of(design, np.zeros_like(parts) if _torn(at, parts) else parts))
    question = question_of(design, library, at.stated)
    start = tuple(_block_of(design, library, effect) for effect in effects)
    admitted = search(question, gram, start)
    return Choice(at, design, question, gram, admitted, library, others, parts, held=gram)


def _torn(at: Fit, parts: Index) -> bool:
    """Whether the records of a seat, or of seats that a bar connects, are in several parts."""
    touched = at.observations.seat >= 0
    pairs = np.stack([at.observations.clusters[at.observations.seat[touched]], parts[touched]], axis=1)
    return len(np.unique(pairs, axis=0)) > len(np.unique(pairs[:, 0]))


def question_of(design: Design, library: Sequence[Variants], stated: bool) -> Question:
    """The search's question with the prior probabilities of the candidates."""
    usual = np.array([candidate[0].usual for candidate in library])
    rest = len(design.names) - len(library)
    prior = np.concatenate([LIBRARY * usual / usual.sum(), np.full(rest, (1 - LIBRARY) / max(rest, 1))])
    contained: dict[int, set[int]] = {}
    number = {(effect.cause, effect.place): k for k, (effect, *_) in enumerate(library)}
    for k, (effect, *_) in enumerate(library):
        for freer in effect.contained_in:
            if (owner := number.get((freer, effect.place))) is not None:
                contained.setdefault(owner, set()).add(k)
    inside = {owner: frozenset(causes) for owner, causes in contained.items()}
    shares = _log_shares([*(effect for variants in library for effect in variants)], design.fit)
    log_share = np.concatenate([shares, np.zeros(len(design.blocks) - shares.size)])
    return Question(design, np.log(prior), stated, inside, log_share)


def _log_shares(effects: Sequence[Effect], at: Fit) -> Array:
    """Log of how probable each inner value is before anything was seen (effects,)."""
    return np.log([effect.share(at.problem.measurements) for effect in effects])


def _block_of(design: Design, library: tuple[Variants, ...], effect: Effect) -> int:
    for number, block in enumerate(design.blocks):
        if block.candidate < len(library) and library[block.candidate][block.variant].identity == effect.identity:
            return number
    raise LookupError(effect.label)


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
    evidences = [_evidences(choice, block, tried) for tried in series]
    best = int(np.argmax([each.max() for each in evidences]))
    return _likeliest(series[best], evidences[best])


def _rivals(choice: Choice, block: int) -> list[Effect]:
    """The likeliest others in the place of a block, refined as it is: where they were tried they are worse than need be.

    But for those with inner values that machines are made with, such as orders: these are the values that are tried.
    """
    question, records = choice.question, choice.fit.problem.measurements
    rest = [choice.variant(k).at(()) for k in choice.causes if k != block]
    odds, best = question.ranked(choice.left.evidences_without(block), question.struck_out(choice.admitted))
    found: list[Effect] = []
    for candidate in np.argsort(-odds[: choice.design.causes]):
        if candidate not in best or not np.isfinite(odds[candidate]) or len(found) == RIVALS:
            break
        effect = choice.variant(best[int(candidate)])
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
    places, heights = (
        np.array(each)
        for each in zip(*((getattr(tried[k], name), evidences[k]) for k in (best - 1, best, best + 1)), strict=True)
    )
    bend, slope, _ = np.polyfit(places - places[1], heights, 2)
    top = -slope / (2.0 * bend) if bend < 0.0 else 0.0
    inner: dict[str, Any] = {name: float(places[1] + np.clip(top, places[0] - places[1], places[2] - places[1]))}
    return replace(effect, **inner)


def _evidences(choice: Choice, block: int, tried: Sequence[Effect]) -> Array:
    """Log evidence of each effect in the place of a block, the others held."""
    rest = [choice.variant(k).at(()) for k in choice.causes if k != block]
    variants = choice.library[choice.question.owner(block)]
    first = variants[:1] if is_change(variants[0]) else ()  # in the place of a cause that is known
    return _beside(choice.fit, (*first, *tried), rest)[len(first) :] + _log_shares(tried, choice.fit)


def _beside(at: Fit, variants: Variants, rest: Sequence[Effect]) -> Array:
    """Log evidence of each variant beside the rest, where a refit with one of them and the rest ended."""
    design = design_of(at, [variants, *((e,) for e in rest)], [], at.problem.candidates)
    gram = Gram(products_of(design, np.zeros(len(at.used), dtype=np.intp)))
    others = tuple(range(len(variants), len(variants) + len(rest)))
    return Conditional.of(gram, others, at.stated).evidences[: len(variants)]


@dataclass(frozen=True)
class Step:
    """What the records tell of an inner value in which a cause steps, such as the time of a slip [its unit].

    Of its posterior over the values near it, each of which stands for the gap around it.

    Attributes:
        u: standard uncertainty.
        low, high: the first and the last of the values that together have 95 % of the probability.
    """

    u: float
    low: float
    high: float


def step_of(choice: Choice, block: int, name: str) -> Step:
    """What the records tell of the inner value ``name`` of a block."""
    chosen, records = choice.variant(block).at(()), choice.fit.problem.measurements
    tried = chosen.refined(records)
    values = np.array([getattr(effect, name) for effect in tried])
    odds = _evidences(choice, block, tried)
    share = np.exp(odds - logsumexp(odds))
    gaps = np.array([effect.step_width(records) for effect in tried])
    u = float(np.sqrt(share @ (np.square(values - getattr(chosen, name)) + np.square(gaps) / 12.0)))
    low, high = values[np.searchsorted(np.cumsum(share), (0.025, 0.975)).clip(max=len(values) - 1)]
    return Step(u, float(low), float(high))
