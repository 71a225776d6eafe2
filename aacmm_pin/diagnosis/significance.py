"""What an admitted cause is worth: probability beside its look-alikes, family-wise p-value, retained fraction, aliases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.distributions import chi2_sf, f_sf
from aacmm_pin.diagnosis.candidates import is_change
from aacmm_pin.diagnosis.design_matrix import Block
from aacmm_pin.diagnosis.evidence import MAGNITUDES, Conditional, evidence_of
from aacmm_pin.diagnosis.forward_backward_selection import Question, one_gone, rival_pairs, shares
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.diagnosis.nuisance_projection import Projection
from aacmm_pin.effects import Effect

DRAWS = 400
"""Draws of records with nothing hidden, for the distribution of the largest evidence."""
ALIASES = 5
"""So many look-alikes are listed at most."""
WORTH_LISTING = 1e-3
"""A look-alike less probable than this is listed only if its columns are nearly the same."""
SHOWS = 15.0
"""Noncentrality at which a cause is found more often than not among all others."""
SAME = 0.95
"""Causes whose columns have a larger canonical correlation are listed as look-alikes whatever their probability."""
WHOLLY = 0.9999
"""Structure with a larger one contains the cause, and is no other: it is listed only where it is likely."""
UNSEEN = 10.0
"""Structure of which only the scatter is seen counts as spread over so many directions, as many as a smooth function has."""
TOLD = 0.95
"""Causes of usual size are told apart where the true one is expected to be at least this probable beside the other."""


@dataclass(frozen=True)
class Alias(Shown):
    """A cause that looks like a finding in these records.

    Attributes:
        label: the cause and its place.
        correlation: largest canonical correlation of the two causes' columns, geometry refitted.
        probability: of this cause in the finding's place.
        block: number of its columns in the diagnosis's design.
        effect: the cause; None for a covariate.
    """

    label: str
    correlation: float
    probability: float
    block: int = -1
    effect: Effect | None = None


@dataclass(frozen=True, eq=False)
class Strength:
    """How sure an admitted block is.

    Attributes:
        block: its number.
        probability: of this candidate, among all in its place and none.
        p_value: chance that the best of all candidates is as good when nothing is there.
        retained: part of its columns' effect that refitting the rest leaves.
        aliases: look-alikes, most probable first.
    """

    block: int
    probability: float
    p_value: float
    retained: float
    aliases: tuple[Alias, ...]


@dataclass(frozen=True, eq=False)
class Place:
    """The place of an admitted block, the others held: all candidates compete for it.

    Attributes:
        left: what is left without the block.
        odds: log odds of each candidate (candidates,).
        shares: their probabilities (candidates,).
        own: number of the block's candidate.
    """

    left: Conditional
    odds: Array
    shares: Array
    own: int

    @staticmethod
    def of(choice: Choice, whole: Conditional, block: int) -> Place:
        """The place of one of the blocks that were admitted in ``whole``, by the scatter that is left beside all of them.

        More of an admitted cause competes too, under another load or by another measure of it: noise of a measured torque
        leaves a part of what it does, in proportion to the weights.
        """
        question, rest = choice.question, tuple(other for other in whole.projection.admitted if other != block)
        left = Conditional(Projection(choice.gram, rest), whole.variance, whole.dof)
        more = {question.owner(k) for k in rest if question.owner(k) < choice.design.causes and not choice.variant(k).inner}
        return Place._of(question, left, question.owner(block), question.struck_out(rest) - more)

    @staticmethod
    def beside(choice: Choice, own: int) -> Place:
        """A place beside all that were admitted, for which the candidate ``own`` competes with all others."""
        left = choice.left
        return Place._of(choice.question, left, own, choice.question.struck_out(choice.admitted) - {own})

    @staticmethod
    def _of(question: Question, left: Conditional, own: int, struck_out: frozenset[int]) -> Place:
        odds = question.odds(question.without(struck_out, left.evidences))
        return Place(left, odds, shares(odds), own)

    @property
    def probability(self) -> float:
        """Of the block's own candidate."""
        return float(self.shares[self.own])


class InPairs(NamedTuple):
    """One or two admitted causes that two others together may look like, though none of these alone looks like one of them;
    or one that another looks like where a known cause is gone.

    Attributes:
        blocks: numbers of the two, or of the one.
        probability: that they are there rather than such others.
        rivals: names of two others, and their probability; the most probable first.
    """

    blocks: tuple[int, ...]
    probability: float
    rivals: list[tuple[str, str, float]]


def in_pairs(choice: Choice) -> list[InPairs]:
    """All of the admitted that have such rivals."""
    question, names, found = choice.question, choice.design.names, []
    for some, rivals in rival_pairs(question, choice.gram, choice.admitted).items():
        log_odds = np.array([0.0, *(rival.more for rival in rivals)])
        own, *others = np.exp(log_odds - logsumexp(log_odds)).tolist()
        labels = [tuple(names[question.owner(k)] for k in rival.blocks) for rival in rivals]
        told = [(one, other, share) for (one, other), share in zip(labels, others, strict=True) if share > WORTH_LISTING]
        found.append(InPairs(some, own, sorted(told, key=lambda rival: -rival[2])))
    return [*found, *_where_one_is_gone(choice)]


def _where_one_is_gone(choice: Choice) -> Iterator[InPairs]:
    """The admitted causes that may be others, where a known cause is gone."""
    question, design = choice.question, choice.design
    problem, admitted = design.fit.problem, {question.owner(k) for k in choice.admitted}
    stated = {effect.identity: problem.start[own] for effect, own in problem.vector}
    for owner, (first, *_) in enumerate(choice.library):
        if not is_change(first) or owner in admitted or first.identity not in stated:
            continue
        change = int(np.argmax(question.owners == owner))
        values = stated[first.identity] / design.scales[question.blocks[change].columns]
        for k in choice.causes:
            rival = one_gone(question, choice.gram, choice.admitted, k, change, values)
            share = 0.0 if rival is None else float(expit(rival.more))
            if rival is not None and share > WORTH_LISTING:
                other = design.names[question.owner(rival.blocks[0])]
                yield InPairs((k,), 1.0 - share, [(other, f"{first.label} gone", share)])


def strengths(choice: Choice, excess: float, pairs: Sequence[InPairs], rng: np.random.Generator) -> list[Strength]:
    """Of each admitted block, the others held in place.

    ``excess`` is by how much χ² is larger than the stated noise explains, where structure is left that nothing has.

    Beside structure that no cause explains a cause may be no more than a part of that structure: its probability is lowered
    by the chance that as many directions of the structure look as strong (F test of the two mean squares, times the
    number of candidates that have as many). None is more probable than the ``pairs`` of which it is one.
    """
    question, causes = choice.question, choice.design.causes
    places = {k: Place.of(choice, choice.left, k) for k in choice.admitted}
    ratios = {k: Ratio.of(place.left, question.blocks[k]) for k, place in places.items()}
    structure = [ratio for k, ratio in ratios.items() if question.owner(k) >= causes]
    structure += [Ratio(excess, UNSEEN)] if excess > 0.0 else []
    found = []
    for k, place in places.items():
        among = min((pair.probability for pair in pairs if k in pair.blocks), default=1.0)
        chance, block = 0.0, question.blocks[k]
        if structure and question.owner(k) < causes:
            alike = len({b.candidate for b in question.blocks if b.size >= block.size})
            chance = min(1.0, alike * max(_as_strong(ratios[k].value, block.size, *one) for one in structure))
        found.append(
            Strength(
                k,
                place.probability * (1.0 - chance) * among,
                family_wise(question, place.left, float(place.odds[place.own]), k, rng),
                retained(place.left, block),
                tuple(aliases_of(choice, place, k)),
            )
        )
    return found


def family_wise(question: Question, left: Conditional, observed: float, block: int, rng: np.random.Generator) -> float:
    """Chance that the best odds of all candidates reach ``observed`` when nothing is there.

    Bonferroni's bound over all that is tried, where that is smaller than any number of draws could tell; else by draws of
    the gradients of residuals that are noise alone.
    """
    b = question.blocks[block]
    bound = len(question.blocks) * float(chi2_sf(Ratio.of(left, b).value, b.size))
    if bound < 1 / DRAWS:
        return bound
    drawn = left.gradients(left.projection.gram.products.drawn(DRAWS, rng)) * np.sqrt(left.variance)
    per_block = np.stack([evidence_of(left.information(b)[None], drawn[b.columns][None])[0] for b in question.blocks])
    reached = sum(bool(question.odds(evidences).max() >= observed) for evidences in per_block.T)
    return min((reached + 1) / (DRAWS + 1), max(bound, 1 / (DRAWS + 1)), 1.0)


class Ratio(NamedTuple):
    """Likelihood ratio of a block, and over how many directions it is spread: ``(Σ e)² / Σ e²``."""

    value: float
    directions: float

    @staticmethod
    def of(left: Conditional, block: Block) -> Ratio:
        """At most χ² with as many degrees as the block has columns when it is not there.

        Its parameters are known to within the largest magnitudes that its evidence averages over. Else columns of which the
        records tell next to nothing would explain everything: an arm that shrinks to a point meets every unknown seat.
        """
        values, vectors = np.linalg.eigh(left.information(block))
        each = np.square(vectors.T @ left.gradient[block.columns])
        each /= np.maximum(values, 0.0) + 1.0 / MAGNITUDES.max() ** 2
        return Ratio(float(each.sum()), float(each.sum() ** 2 / max(np.square(each).sum(), 1e-300)))


def _as_strong(own: float, q: int, energy: float, size: float) -> float:
    """Chance that q directions of a structure with so much energy over ``size`` directions have as much as a cause."""
    taken = min(float(q), size)
    return float(f_sf((own / taken) / (energy / size), taken, size))


def retained(left: Conditional, block: Block) -> float:
    """``‖M G β‖ / ‖G β‖`` at the block's best β."""
    information = left.information(block)
    whole = left.projection.gram.inside(block) / left.variance
    step = np.asarray(np.linalg.lstsq(information, left.gradient[block.columns], rcond=1e-10)[0])
    kept, size = (float(step @ matrix @ step) for matrix in (information, whole))
    return float(np.sqrt(max(kept, 0.0) / size)) if size > 0 else 0.0


def aliases_of(choice: Choice, place: Place, k: int) -> list[Alias]:
    """The candidates that compete with block ``k`` for its place, most probable first."""
    question, names, library = choice.question, choice.design.names, choice.library
    own, left, shares = place.own, place.left, place.shares
    found = []
    for candidate, block in question.best_blocks(left.evidences).items():
        if candidate == own or not np.isfinite(shares[candidate]):
            continue
        correlation = canonical(left, question.blocks[k], question.blocks[block])
        alike = correlation > SAME and (candidate < len(library) or correlation < WHOLLY)
        if alike or shares[candidate] > WORTH_LISTING:
            effect = library[candidate][0] if candidate < len(library) else None
            found.append(Alias(names[candidate], correlation, float(shares[candidate]), block, effect))
    found.sort(key=lambda alias: (-alias.probability, -alias.correlation))
    return found[:ALIASES]


def canonical(left: Conditional, one: Block, other: Block) -> float:
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


def look_alikes(choice: Choice) -> list[tuple[str, str]]:
    """Pairs of causes of usual size that these records would not tell apart, though they would show each of them.

    With one of them true at its typical size β, the other can take up all but ``T = min ‖G_k β - G_l β_l‖²`` of what it
    does; the expected difference of their log evidences is about T/2, which is to be the log odds of :data:`TOLD`.
    """
    question, names, left = choice.question, choice.design.names, choice.bare
    alone = np.bincount(question.owners, minlength=len(names)) == 1
    single = [k for k, owner in enumerate(question.owners) if owner < choice.design.causes and alone[owner]]
    sizes = {k: np.trace(left.information(question.blocks[k])) / question.blocks[k].size for k in single}
    shown = [k for k in single if sizes[k] >= SHOWS]
    if not shown:
        return []
    choice.gram.prepare(shown)
    slices = [question.blocks[k].columns for k in shown]
    columns = np.concatenate([np.arange(s.start, s.stop) for s in slices])
    white = left.projection.whitened(columns)
    products = np.concatenate([choice.gram.strip(s, columns) for s in slices]) - white.T @ white
    ends = np.cumsum([0, *(s.stop - s.start for s in slices)])
    taken = np.empty((len(shown), len(shown)))  # of each cause by each other, the sum over its directions
    for k, (first, last) in enumerate(pairwise(ends)):
        its = products[first:last]
        best = np.linalg.solve(its[:, first:last] + np.eye(last - first) / MAGNITUDES.max() ** 2, its)
        taken[:, k] = np.add.reduceat(np.sum(its * best, axis=0), ends[:-1])
    apart = np.array([sizes[k] for k in shown])[:, None] - taken / np.diff(ends)[:, None]
    alike = np.triu(0.5 * np.minimum(apart, apart.T) < np.log(TOLD / (1.0 - TOLD)), 1)
    owners = [names[question.owner(k)] for k in shown]
    return [(owners[i], owners[j]) for i, j in np.argwhere(alike)]


def visible(choice: Choice) -> tuple[int, int]:
    """How many causes of the library these records would have shown at their usual size, and of how many.

    A cause shows if the noncentrality of its first parameter alone, geometry refitted, is at least :data:`SHOWS`; more where
    the noise comes from the same records and few degrees of freedom, so that Student's evidence is as large.
    """
    question, left, dof = choice.question, choice.bare.projection, choice.left.dof
    least = dof * np.expm1(SHOWS / max(dof, 1.0)) if np.isfinite(dof) else SHOWS
    sizes = np.empty(len(question.blocks))
    for size, own in choice.gram.products.of_size.items():
        sizes[own] = np.diagonal(left.informations(size), axis1=1, axis2=2).max(axis=1)
    best = np.maximum.reduceat(sizes, question.first)[question.owners[question.first] < choice.design.causes]
    return int(np.sum(best >= least)), best.size
