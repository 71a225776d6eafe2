"""Which set of causes explains the residuals: admit the best, rank all again, look back, try pairs, stop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp
from scipy.stats import chi2

from aacmm_pin.checks import Array
from aacmm_pin.diagnosis.design import Block
from aacmm_pin.diagnosis.evidence import Conditional
from aacmm_pin.diagnosis.products import Gram

MOST = 24
"""No more than so many causes are admitted; a set of records that seems to need more is not explained."""
SURE = 0.99
"""Probability that something is there at all which a first admission needs."""
SCATTER = 1e-3
"""χ² less likely than this means that the records scatter more than their noise; their variance is then taken from them."""
NEAR = 12
"""So many of the best candidates are tried in pairs."""
EQUAL = 1e-3
"""Sets of causes whose log evidence differs by less are one."""


@dataclass(frozen=True, eq=False)
class Question:
    """What the search is about.

    Attributes:
        blocks: all blocks of columns.
        candidates: number of candidates.
        nuisances: number of nuisance columns.
        log_prior: log probability of each candidate before anything was seen, given that one is there (candidates,).
        stated: True where the noise is known, so that χ² says whether the records scatter more.
    """

    blocks: tuple[Block, ...]
    candidates: int
    nuisances: int
    log_prior: Array
    stated: bool

    def owner(self, block: int) -> int:
        """Candidate of a block."""
        return self.blocks[block].candidate

    def per_candidate(self, evidences: Array) -> Array:
        """Log evidence of each candidate, averaged over its variants (candidates,)."""
        owners, first = np.unique([b.candidate for b in self.blocks], return_index=True)
        found = np.full(self.candidates, -np.inf)
        variants = np.add.reduceat(np.isfinite(evidences).astype(np.float64), first)
        with np.errstate(invalid="ignore"):  # a candidate that is struck out has nothing to add up
            found[owners] = np.logaddexp.reduceat(evidences, first) - np.log(np.maximum(variants, 1.0))
        return found

    def best_block(self, evidences: Array, candidate: int) -> int:
        """The variant of a candidate with the largest evidence."""
        mine = [k for k, b in enumerate(self.blocks) if b.candidate == candidate]
        return max(mine, key=lambda k: evidences[k])


def conditional(question: Question, gram: Gram, admitted: tuple[int, ...]) -> Conditional:
    """What is left with these blocks admitted, the variance factor included."""
    bare = Conditional(gram, question.blocks, question.nuisances, admitted)
    dof = gram.free - bare.determined
    if dof <= 0:
        return bare
    ratio = bare.chi2 / dof
    scatters = ratio > 1.0 and chi2.sf(bare.chi2, dof) < SCATTER
    if question.stated and not scatters:
        return bare
    return replace(bare, variance=max(ratio, 1.0) if question.stated else ratio)


def search(question: Question, gram: Gram, start: tuple[int, ...] = ()) -> tuple[int, ...]:
    """Blocks of the causes that are there, strongest first."""
    admitted = _settled(question, gram, start)
    pairs_tried = False
    while len(admitted) < MOST:
        left = conditional(question, gram, admitted)
        evidences = left.evidences
        each = question.per_candidate(_without(question, evidences, admitted))
        odds = question.log_prior + each
        if not np.isfinite(odds).any() or logsumexp(odds) < np.log(SURE / (1 - SURE)):
            break
        best = int(np.argmax(odds))
        admitted = _settled(question, gram, (*admitted, question.best_block(evidences, best)))
        if not pairs_tried:
            pairs_tried = True
            admitted = _settled(question, gram, _better_pair(question, gram, admitted))
        if admitted and len(set(admitted)) != len(admitted):
            break
    return _by_strength(question, gram, admitted)


def _without(question: Question, evidences: Array, admitted: tuple[int, ...]) -> Array:
    """Evidences with those of candidates that are in already struck out; a curve may follow an order at the same joint."""
    owners = {question.owner(k) for k in admitted}
    return np.array([-np.inf if question.owner(k) in owners else e for k, e in enumerate(evidences)])


def _settled(question: Question, gram: Gram, admitted: tuple[int, ...]) -> tuple[int, ...]:
    """Each admitted cause against all others in its place, and against nothing, until none changes."""
    seen = {admitted}
    for _ in range(20):
        changed = admitted
        for k in admitted:
            rest = tuple(other for other in changed if other != k)
            if len(rest) == len(changed):
                continue
            left = conditional(question, gram, rest)
            evidences = _without(question, left.evidences, rest)
            odds = question.log_prior + question.per_candidate(evidences)
            best = int(np.argmax(odds))
            something = logsumexp(odds) >= np.log(SURE / (1 - SURE))
            changed = (*rest, question.best_block(evidences, best)) if something else rest
        if changed == admitted or set(changed) == set(admitted):
            return admitted
        admitted = changed
        if admitted in seen:
            return admitted
        seen.add(admitted)
    return admitted


def _better_pair(question: Question, gram: Gram, admitted: tuple[int, ...]) -> tuple[int, ...]:
    """The best pair among the leading candidates, if two together beat what was admitted: one false can mimic two true."""
    nothing = conditional(question, gram, ())
    each = question.per_candidate(nothing.evidences)
    leaders = [int(c) for c in np.argsort(-each)[:NEAR] if np.isfinite(each[c]) and each[c] > 0]
    best, value = admitted, log_evidence(question, gram, admitted)
    for first in leaders:
        one = question.best_block(nothing.evidences, first)
        left = conditional(question, gram, (one,))
        evidences = _without(question, left.evidences, (one,))
        second = int(np.argmax(question.per_candidate(evidences)))
        pair = (one, question.best_block(evidences, second))
        if len(admitted) <= 2 and (found := log_evidence(question, gram, pair)) > value + EQUAL:
            best, value = pair, found
    return best


def log_evidence(question: Question, gram: Gram, admitted: tuple[int, ...]) -> float:
    """Log evidence of a set of causes, prior included, with one variance for all steps: that of the whole set."""
    variance = conditional(question, gram, admitted).variance
    total = 0.0
    for count, block in enumerate(admitted):
        left = replace(Conditional(gram, question.blocks, question.nuisances, admitted[:count]), variance=variance)
        total += left.evidence(block) + float(question.log_prior[question.owner(block)])
    return total


def _by_strength(question: Question, gram: Gram, admitted: tuple[int, ...]) -> tuple[int, ...]:
    strength = {}
    for k in admitted:
        rest = tuple(other for other in admitted if other != k)
        strength[k] = conditional(question, gram, rest).evidence(k)
    return tuple(sorted(admitted, key=lambda k: -strength[k]))
