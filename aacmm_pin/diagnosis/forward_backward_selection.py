"""Which set of causes explains the residuals: admit the best, rank all again, look back, try pairs, stop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.evidence import MAGNITUDES, Conditional
from aacmm_pin.diagnosis.gram_matrix import Gram

MOST_CAUSES = 24
"""No more than so many causes are admitted; a set of records that seems to need more is not explained."""
SURE = np.log(0.99 / 0.01)
"""Log odds that something is there at all which every admission needs, and every exchange of one cause for two."""
# 19 blind files of tests/blind: with 0.9 in place of 0.99 one more was explained, with 0.999 all answers were the same.
NEAR = 16
"""So many of the best candidates are tried in pairs …"""
INSTEAD = 8
"""… and so many where a pair may stand in the place of one."""
WEAKEST = 3
"""So many of the weakest admitted causes are tried against pairs."""
GONE = 0.1
"""Probability that a cause which the arm is known to have is gone, where something else has changed."""
EQUAL = 1e-3
"""Sets of causes whose log evidence differs by less are one."""
KEPT = 48
"""Sets of causes that are remembered with what is left beside them."""


@dataclass(frozen=True, eq=False)
class Question:
    """What the search is about.

    Attributes:
        design: the candidates and their blocks of columns.
        log_prior: log probability of each candidate before anything was seen, given that one is there (candidates,).
        stated: True where the noise is known, so that χ² says whether the records scatter more.
        contained: for a candidate that is free enough to be others too, their numbers; they do not stand beside it.
        log_share: log of how probable each block is before anything was seen, beside its candidate's others (blocks,).
    """

    design: Design
    log_prior: Array
    stated: bool
    contained: Mapping[int, frozenset[int]]
    log_share: Array

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks of columns."""
        return self.design.blocks

    def owner(self, block: int) -> int:
        """Candidate of a block."""
        return self.blocks[block].candidate

    @cached_property
    def owners(self) -> Index:
        """Candidate of every block (blocks,); the variants of one follow one another."""
        return np.array([b.candidate for b in self.blocks], dtype=np.intp)

    @cached_property
    def first(self) -> Index:
        """First block of each candidate that has any."""
        return np.unique(self.owners, return_index=True)[1]

    def struck_out(self, blocks: tuple[int, ...]) -> frozenset[int]:
        """Candidates that cannot be admitted beside these blocks: their own, and what these contain."""
        owners = frozenset(map(self.owner, blocks))
        return owners.union(*(self.contained.get(c, frozenset()) for c in owners))

    def joined(self, blocks: tuple[int, ...], more: int) -> tuple[int, ...]:
        """The blocks with one more, without what that contains; in one order, so that equal sets are recognised."""
        contained = self.contained.get(self.owner(more), frozenset())
        return tuple(sorted({more, *(k for k in blocks if self.owner(k) not in contained)}))

    def without(self, struck_out: frozenset[int], evidences: Array) -> Array:
        """Log evidences (blocks,) with minus infinity for the blocks of some candidates."""
        return np.where(np.isin(self.owners, list(struck_out)), -np.inf, evidences)

    def odds(self, evidences: Array) -> Array:
        """Log odds of each candidate (candidates,)."""
        return self.log_prior + self.per_candidate(evidences)

    def per_candidate(self, evidences: Array) -> Array:
        """Log evidence of each candidate, averaged over its variants (candidates,)."""
        found = np.full(self.log_prior.size, -np.inf)
        shares = np.where(np.isfinite(evidences), self.log_share, -np.inf)
        with np.errstate(invalid="ignore"):  # a candidate that is struck out has nothing to add up
            each = (np.logaddexp.reduceat(share, self.first) for share in (evidences + shares, shares))
            found[self.owners[self.first]] = np.nan_to_num(next(each) - next(each), nan=-np.inf)
        return found

    @cached_property
    def doubt(self) -> Array:
        """By how much a variant's log evidence has to be larger than its candidate's others (blocks,).

        One of many other inner values, beside a known cause that changes too, has to be as sure as a cause beside the change
        alone.
        """
        two = np.array([isinstance(b.source, tuple) and len(b.source) > 1 for b in self.blocks])
        return np.where(two, SURE + np.log(np.bincount(self.owners)[self.owners]), 0.0)

    def best_blocks(self, evidences: Array) -> dict[int, int]:
        """The variant with the largest evidence, of each candidate that has any."""
        evidences = evidences + self.log_share - self.doubt
        largest = np.maximum.reduceat(evidences, self.first)
        counts = np.diff([*self.first, len(self.blocks)])
        reached = np.flatnonzero(evidences == np.repeat(largest, counts))
        owners, which = np.unique(self.owners[reached], return_index=True)
        return dict(zip(owners.tolist(), reached[which].tolist(), strict=True))

    def ranked(self, evidences: Array, struck_out: frozenset[int]) -> tuple[Array, dict[int, int]]:
        """Log odds of each candidate (candidates,), minus infinity where struck out; the best variant of each other one."""
        evidences = self.without(struck_out, evidences)
        return self.odds(evidences), self.best_blocks(evidences)


def shares(odds: Array) -> Array:
    """Probability of each candidate (candidates,) by its log odds, where one of them is there or none."""
    return np.asarray(np.exp(odds - logsumexp([*odds, 0.0])))


def search(question: Question, gram: Gram, start: tuple[int, ...] = ()) -> tuple[int, ...]:
    """Blocks of the causes that are there, strongest first."""
    return _Search(question, gram).run(start)


def rival_pairs(question: Question, gram: Gram, admitted: tuple[int, ...]) -> dict[tuple[int, ...], list[Rival]]:
    """Of one or two admitted blocks, the pairs that may be there in their place; only of those that have any."""
    tried = _Search(question, gram)
    weakest = [(k,) for k in tried.by_strength(admitted)[-WEAKEST:]]
    found = {some: tried.rivals(admitted, some) for some in (*weakest, *tried.doubtful(admitted))}
    return {some: rivals for some, rivals in found.items() if rivals}


def one_gone(
    question: Question, gram: Gram, admitted: tuple[int, ...], block: int, change: int, stated: Array
) -> Rival | None:
    """In the place of an admitted block: a known cause is gone, and the best of all others is there.

    The evidence of a ``change`` to a given value is that of any change, times by how much the records have made this value
    more probable than it was (Dickey 1971, Ann. Math. Stat. 42).

    Args:
        question, gram, admitted: of the search.
        block: one of the admitted.
        change: block of the known cause's change.
        stated: its values, in units of the design's scales.
    """
    tried = _Search(question, gram)
    rest = _ordered((*_without(admitted, block), change))
    odds, blocks = tried.odds(rest, frozenset({question.owner(block)}))
    if not np.isfinite(odds).any():
        return None
    other = blocks[int(np.argmax(odds))]
    left = tried.left(_ordered((*rest, other)))
    own = left.projection.places[change]
    covers = [left.covariance[own, own], *(np.eye(stated.size) * tau**2 for tau in MAGNITUDES)]
    after, *before = (
        -0.5 * (off @ np.linalg.solve(cover, off) + np.linalg.slogdet(2.0 * np.pi * cover)[1])
        for cover, off in zip(covers, (stated + left.projection.solution()[own], *[stated] * MAGNITUDES.size), strict=True)
    )
    more = tried.log_evidence(_ordered((*rest, other))) - tried.log_evidence(admitted)
    more += np.log(GONE) - question.log_prior[question.owner(change)]
    return Rival(float(more + after - logsumexp(before) + np.log(MAGNITUDES.size)), (other, change))


class Rival(NamedTuple):
    """Two blocks in the place of others: by how much the log evidence is larger with them."""

    more: float
    blocks: tuple[int, ...]


class _Search:
    """One search; remembers what is left beside the sets of causes that it has tried."""

    def __init__(self, question: Question, gram: Gram) -> None:
        self.question, self.gram = question, gram
        self.left = lru_cache(maxsize=KEPT)(lambda admitted: Conditional.of(gram, admitted, question.stated))

    def run(self, start: tuple[int, ...]) -> tuple[int, ...]:
        """Admit and look back, exchange one for two, until neither changes anything."""
        admitted = self.grown(self.settled(_ordered(start)))
        for _ in range(MOST_CAUSES):
            exchanged = self.exchanged(admitted)
            if exchanged == admitted:
                break
            admitted = self.grown(self.settled(exchanged))
        return self.by_strength(admitted)

    def grown(self, admitted: tuple[int, ...]) -> tuple[int, ...]:
        """One cause after the other, all looked back at each time, until none is sure enough."""
        seen = {admitted}
        pairs_tried = False
        while len(admitted) < MOST_CAUSES:
            odds, blocks = self.odds(admitted)
            if not np.isfinite(odds).any() or logsumexp(odds) < SURE:
                break
            admitted = self.settled(self.question.joined(admitted, blocks[int(np.argmax(odds))]))
            if not pairs_tried:
                pairs_tried = True
                admitted = self.settled(self.better_pair(admitted))
            if admitted in seen:
                return max(sorted(seen), key=self.log_evidence)
            seen.add(admitted)
        return admitted

    def odds(self, admitted: tuple[int, ...], barred: frozenset[int] = frozenset()) -> tuple[Array, dict[int, int]]:
        """Log odds of each candidate beside the admitted, these and the barred struck out, and the best variant of each."""
        return self.question.ranked(self.left(admitted).evidences, self.question.struck_out(admitted) | barred)

    def odds_instead(self, whole: tuple[int, ...], block: int) -> tuple[Array, dict[int, int]]:
        """The same of all in the place of one of the admitted.

        With the variance that is left beside all of them: by what is unexplained without the one that is looked back at all
        others would look alike.
        """
        struck_out = self.question.struck_out(_without(whole, block))
        return self.question.ranked(self.left(whole).evidences_without(block), struck_out)

    def settled(self, admitted: tuple[int, ...]) -> tuple[int, ...]:
        """Each admitted cause against all others in its place, and against nothing, until none changes."""
        seen = {admitted}
        for _ in range(20):
            changed = admitted
            for k in admitted:
                if k not in changed:
                    continue
                rest = _without(changed, k)
                odds, blocks = self.odds_instead(changed, k)
                best = blocks[int(np.argmax(odds))]
                changed = self.question.joined(rest, best) if logsumexp(odds) >= SURE else rest
            if changed == admitted:
                return admitted
            if changed in seen:  # one in the place of the other, and back: the better of them stays
                return max(sorted(seen), key=self.log_evidence)
            admitted = changed
            seen.add(admitted)
        return admitted

    def better_pair(self, admitted: tuple[int, ...]) -> tuple[int, ...]:
        """The best pair among the leading candidates, if two together beat what was admitted: one false can mimic two."""
        if len(admitted) > 2:
            return admitted
        best, value = admitted, self.log_evidence(admitted)
        pairs = self.pairs((), NEAR)
        self.gram.prepare(k for pair in pairs for k in pair)
        for pair in pairs:
            if (found := self.log_evidence(pair)) > value + EQUAL:
                best, value = pair, found
        return best

    def exchanged(self, admitted: tuple[int, ...]) -> tuple[int, ...]:
        """The set with one of its weakest causes replaced by two others, where these are surely better; or two by one that
        contains both, where that is better at all.
        """
        value = self.log_evidence(admitted)
        for candidate, inside in self.question.contained.items():
            rest = tuple(k for k in admitted if self.question.owner(k) not in inside)
            if len(rest) <= len(admitted) - 2 and candidate in self.question.owners:
                whole = self.question.joined(rest, self.odds(rest)[1][candidate])
                if self.log_evidence(whole) > value + EQUAL:
                    return whole
        for k in self.by_strength(admitted)[: -WEAKEST - 1 : -1]:
            rest = _without(admitted, k)
            pairs = [pair for pair in self.pairs(rest, INSTEAD) if k not in pair]
            if pairs and len(rest) + 2 <= MOST_CAUSES:
                self.gram.prepare(k for pair in pairs for k in pair)
                found, best = max((self.log_evidence(_ordered((*rest, *pair))), pair) for pair in pairs)
                if found > value + SURE:
                    return _ordered((*rest, *best))
        for two in self.doubtful(admitted) if len(admitted) <= WEAKEST else ():
            rival = max(self.rivals(admitted, two), default=Rival(-np.inf, two))
            if rival.more > EQUAL:
                return _ordered((*_without(admitted, *two), *rival.blocks))
        return admitted

    def doubtful(self, admitted: tuple[int, ...]) -> list[tuple[int, int]]:
        """The weakest of the admitted, two and two; all would cost more than everything else."""
        return [*combinations(sorted(self.by_strength(admitted)[-WEAKEST:]), 2)]

    def rivals(self, admitted: tuple[int, ...], some: tuple[int, ...]) -> list[Rival]:
        """Pairs of other candidates that may be there in the place of two of the admitted; of one, where they surely are."""
        rest = _without(admitted, *some)
        pairs = self.pairs(rest, WEAKEST, frozenset(map(self.question.owner, some)))
        self.gram.prepare(k for pair in pairs for k in pair)
        value = self.log_evidence(admitted) + SURE * (len(some) == 1)
        return [Rival(self.log_evidence(_ordered((*rest, *pair))) - value, pair) for pair in pairs]

    def pairs(self, rest: tuple[int, ...], count: int, barred: frozenset[int] = frozenset()) -> list[tuple[int, ...]]:
        """Each of the leading candidates, but for the barred, with its best second, beside ``rest``."""
        odds, blocks = self.odds(rest, barred)
        evidences = odds - self.question.log_prior
        leading = [blocks[k] for k in np.argsort(-odds)[:count] if np.isfinite(evidences[k]) and evidences[k] > 0]
        self.gram.prepare(leading)
        found = []
        for first in leading:
            second, others = self.odds(_ordered((*rest, first)), barred)
            if np.isfinite(second).any():
                pair = self.question.joined((first,), others[int(np.argmax(second))])
                found += [pair] if len(pair) == 2 else []
        return list(dict.fromkeys(found))

    def log_evidence(self, admitted: tuple[int, ...]) -> float:
        """Log evidence of a set of causes, prior included, with one variance for all steps: that of the whole set.

        The blocks are added up in one order, whatever their order here, for it depends on that order.
        """
        admitted = _ordered(admitted)
        prior = sum(float(self.question.log_prior[self.question.owner(block)]) for block in admitted)
        return self.left(admitted).of_admitted() + prior

    def by_strength(self, admitted: tuple[int, ...]) -> tuple[int, ...]:
        """The strongest first."""
        strength = {k: self.left(_without(admitted, k)).evidence(k) for k in admitted}
        return tuple(sorted(admitted, key=lambda k: -strength[k]))


def _ordered(admitted: tuple[int, ...]) -> tuple[int, ...]:
    """Without doubles, in one order, so that equal sets are recognised."""
    return tuple(sorted(set(admitted)))


def _without(admitted: tuple[int, ...], *blocks: int) -> tuple[int, ...]:
    """All but these."""
    return tuple(k for k in admitted if k not in blocks)
