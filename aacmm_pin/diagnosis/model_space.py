"""The model space: sets of blocks of causes and covariates, and the one posterior over them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.gram_matrix import Gram
from aacmm_pin.diagnosis.linear_model import WIDTHS, Base, Conditional, Likelihood, log_sum
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import Measurements

Blocks = tuple[int, ...]
"""A set of blocks, in the order of their numbers."""
FIRST_WIDTH = 2
"""Number of the width with which the search for a block's best width begins."""
COUNTS = 6.0
"""Amplitudes whose log posterior is below the largest by more are not optimised over the widths."""
LEAST_WEIGHT = 1e-12
"""Least weight of an amplitude when additions are ranked."""
LEAST_GAIN = 1e-9
"""Least gain in log posterior for which a width changes."""
RECENT = 10
"""Sets whose own products are cached: they are needed again at each amplitude, and with other
blocks.
"""
NEGLIGIBLE = 12.0
"""A log posterior that is lower than the largest by more adds nothing to a sum."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The candidates for a set, and their prior odds.

    Attributes:
        design: the candidates and their blocks of columns.
        log_odds: log prior odds of inclusion of each block (blocks,).
        contained: for a candidate of which others are special cases, their numbers; these are in no
            set with it.
    """

    design: Design
    log_odds: Array
    contained: Mapping[int, frozenset[int]]

    @staticmethod
    def of(design: Design, library: Sequence[Variants]) -> Candidates:
        """Prior odds: one cause is expected, shared by the causes' prior weights; one variant of
        each candidate.
        """
        log_prior = _log_prior_of_candidates(library, len(design.names))
        records = design.fit.problem.measurements
        of_causes = zip(library, log_prior, strict=False)
        within = [_shares(variants, prior, records) for variants, prior in of_causes]
        owners = _owners(design)
        variants_of = np.bincount(owners)
        for count in variants_of[len(library) :]:
            within.append(np.full(count, -np.log(count)))
        log_odds = log_prior[owners] + np.concatenate(within)
        return Candidates(design, log_odds, _contained(library))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks of columns."""
        return self.design.blocks

    @cached_property
    def owners(self) -> Index:
        """Candidate of every block (blocks,)."""
        return _owners(self.design)

    def owner(self, block: int) -> int:
        """Candidate of a block."""
        return self.blocks[block].candidate

    def is_cause(self, block: int) -> bool:
        """Whether a block is of a cause of the library, and not of a covariate."""
        return self.owner(block) < self.design.causes

    @cached_property
    def containers(self) -> dict[int, frozenset[int]]:
        """For each candidate that others contain, their numbers."""
        found = defaultdict[int, set[int]](set)
        for container, members in self.contained.items():
            for member in members:
                found[member].add(container)
        return {member: frozenset(containers) for member, containers in found.items()}

    def barred(self, blocks: Blocks) -> Mask:
        """Which blocks cannot be added to ``blocks``: blocks of their candidates, of special cases
        of these, and of candidates of which these are special cases.
        """
        struck = set[int]()
        for owner in {self.owner(k) for k in blocks}:
            struck.add(owner)
            struck |= self.contained.get(owner, frozenset())
            struck |= self.containers.get(owner, frozenset())
        return np.isin(self.owners, list(struck))


def _owners(design: Design) -> Index:
    """Candidate of every block (blocks,)."""
    return np.array([block.candidate for block in design.blocks], dtype=np.intp)


def _log_prior_of_candidates(library: Sequence[Variants], count: int) -> Array:
    """Log prior odds of each candidate, causes before covariates (count,)."""
    weights = np.array([variants[0].prior_weight for variants in library])
    covariates = count - len(library)
    of_causes = THRESHOLDS.library * weights / weights.sum()
    of_covariates = np.full(covariates, (1.0 - THRESHOLDS.library) / max(covariates, 1))
    return np.asarray(np.log(np.concatenate([of_causes, of_covariates])))


def _shares(variants: Variants, log_prior: float, records: Measurements) -> Array:
    """Log share of each variant in the prior odds of its candidate (variants,).

    A variant with another nonlinear parameter than the known cause is a change of this cause and a
    new cause, each with these odds.
    """
    shares = np.log([effect.nonlinear.prior_probability(effect, records) for effect in variants])
    new_beside_change = len(variants) > 1 and is_change(variants[0]) and variants[0].nonlinear.field
    if not new_beside_change:
        return shares - log_sum(shares)
    new = shares[1:] - log_sum(shares[1:])
    return np.concatenate([[0.0], new + log_prior])


def _contained(library: Sequence[Variants]) -> dict[int, frozenset[int]]:
    number = {(effect.cause, effect.place): k for k, (effect, *_) in enumerate(library)}
    found = defaultdict[int, set[int]](set)
    for k, (effect, *_) in enumerate(library):
        for freer in effect.special_case_of:
            owner = number.get((freer, effect.place))
            if owner is not None:
                found[owner].add(k)
    return {owner: frozenset(causes) for owner, causes in found.items()}


class ModelState(NamedTuple):
    """A set of blocks with the prior width of each, and an amplitude of the background, by their
    numbers.
    """

    blocks: Blocks
    widths: tuple[int, ...]
    amplitude: int

    def of(self, kept: Sequence[int]) -> ModelState:
        """The state with the blocks ``kept`` alone, with their widths."""
        width = dict(zip(self.blocks, self.widths, strict=True))
        widths = tuple(width[k] for k in kept)
        return ModelState(tuple(kept), widths, self.amplitude)


class Marginal(NamedTuple):
    """Log posterior of a set of blocks, its widths and the background's amplitude summed over; and
    the best of these.
    """

    log_posterior: float
    best: ModelState
    amplitudes: Array


class Peak(NamedTuple):
    """At one amplitude: the largest log posterior over the widths of a set, the sum over the
    widths, the best state.
    """

    largest: float
    total: float
    state: ModelState


class ModelSpace:
    """The posterior over sets of blocks.

    Args:
        candidates: what may be in a set.
        gram: inner products of the records that count.
        stated: whether the noise is stated.
        amplitudes: of the background.
    """

    def __init__(
        self,
        candidates: Candidates,
        gram: Gram,
        stated: bool,
        amplitudes: tuple[float, ...] = THRESHOLDS.amplitudes,
    ) -> None:
        self.candidates, self.gram, self.stated = candidates, gram, stated
        covariates = candidates.design.causes < len(candidates.design.names)
        self.amplitudes = amplitudes if covariates else (0.0,)
        self._bases: dict[tuple[int, bool], Base] = {}
        self._marginals: dict[Blocks, Marginal] = {}
        self._additions: dict[Blocks, Array] = {}
        self._widths: dict[Blocks, Array] = {}
        self._among: dict[tuple[Blocks, int, bool], Array] = {}

    def base(self, amplitude: int, as_stated: bool = False) -> Base:
        """Nuisances and the background of an amplitude integrated over."""
        key = (amplitude, as_stated)
        if key not in self._bases:
            self._bases[key] = Base(self.gram, self.amplitudes[amplitude], as_stated)
        return self._bases[key]

    @cached_property
    def likelihood(self) -> Likelihood:
        """Marginal likelihood by χ²."""
        dof = self.gram.free - self.base(0).determined
        return Likelihood(dof, self.stated)

    def conditional(self, state: ModelState, as_stated: bool = False) -> Conditional:
        """Every block, conditional on the set of ``state``."""
        base = self.base(state.amplitude, as_stated)
        key = (state.blocks, state.amplitude, as_stated)
        if key not in self._among:
            if len(self._among) == RECENT:
                del self._among[next(iter(self._among))]
            self._among[key] = base.among(state.blocks)
        return Conditional(base, state.blocks, state.widths, self.likelihood, self._among[key])

    def log_prior(self, blocks: Blocks) -> float:
        """Log prior odds of a set of blocks against none, without its widths."""
        return float(self.candidates.log_odds[list(blocks)].sum())

    def log_posterior(self, state: ModelState) -> float:
        """Log posterior of a set with its widths and an amplitude, up to a constant of these
        records.

        Log marginal likelihood, plus the log prior odds of inclusion, plus the equal prior of
        widths and amplitudes. It does not depend on the order of the blocks.
        """
        ordered = state.of(sorted(state.blocks))
        log_evidence = self.conditional(ordered).log_evidence
        return log_evidence + self._log_prior(ordered.blocks)

    def _log_prior(self, blocks: Blocks) -> float:
        """Log prior odds with the equal prior of widths and amplitudes."""
        of_widths = len(blocks) * np.log(WIDTHS.size)
        of_amplitude = np.log(len(self.amplitudes))
        return self.log_prior(blocks) - float(of_widths + of_amplitude)

    def marginal(self, blocks: Blocks) -> Marginal:
        """The set's log posterior, summed over its widths and the amplitudes; kept.

        At each amplitude, the sum runs over each width alone from the best widths at this
        amplitude, as if the widths were independent.
        """
        if blocks not in self._marginals:
            self._marginals[blocks] = self._summed(blocks)
        return self._marginals[blocks]

    def _summed(self, blocks: Blocks) -> Marginal:
        state = self._near(blocks)
        by_amplitude = self._over_amplitudes(state)
        peaks = dict[int, Peak]()
        while (best := int(np.argmax(by_amplitude))) not in peaks:
            peaks[best] = self._peak(state._replace(amplitude=best))
            state = peaks[best].state
            by_amplitude = self._over_amplitudes(state)
        counting = np.flatnonzero(by_amplitude > by_amplitude.max() - COUNTS)
        for k in counting.tolist():
            if k not in peaks:
                peaks[k] = self._peak(state._replace(amplitude=k))
        for k, peak in peaks.items():
            by_amplitude[k] = peak.total
        top = max(peaks.values(), key=lambda peak: peak.largest)
        total = float(log_sum(by_amplitude))
        return Marginal(total, top.state, np.exp(by_amplitude - total))

    def _near(self, blocks: Blocks) -> ModelState:
        """A state of the set near the best: widths and amplitude of a set with one block less, if
        one is known.
        """
        for k, block in enumerate(blocks):
            rest = (*blocks[:k], *blocks[k + 1 :])
            known = self._marginals.get(rest)
            if known is None:
                continue
            widths = list(known.best.widths)
            widths.insert(k, self._first_width(rest, block))
            return ModelState(blocks, tuple(widths), known.best.amplitude)
        return ModelState(blocks, (FIRST_WIDTH,) * len(blocks), 0)

    def _first_width(self, beside: Blocks, block: int) -> int:
        known = self._widths.get(beside)
        return FIRST_WIDTH if known is None else int(known[block])

    def _peak(self, state: ModelState) -> Peak:
        """The best widths at the state's amplitude, changed one at a time."""
        conditional = self.conditional(state)
        log_prior = self._log_prior(state.blocks)
        while True:
            values = conditional.over_widths[:, :-1]
            largest = values.max(axis=1)
            members = np.arange(len(values))
            gains = largest - values[members, list(conditional.widths)]
            if gains.max(initial=0.0) <= LEAST_GAIN:
                break
            member = int(np.argmax(gains))
            widths = list(conditional.widths)
            widths[member] = int(np.argmax(values[member]))
            conditional = replace(conditional, widths=tuple(widths))
        log_posterior = conditional.log_evidence + log_prior
        along_widths = log_sum(values) - largest
        return Peak(
            log_posterior,
            log_posterior + float(along_widths.sum()),
            state._replace(widths=conditional.widths),
        )

    def _over_amplitudes(self, state: ModelState) -> Array:
        """Log posterior of the state with each amplitude (amplitudes,).

        It has one maximum: upwards and downwards from the state's amplitude, amplitudes beyond a
        negligible one are not evaluated.
        """
        log_posteriors = np.full(len(self.amplitudes), -np.inf)
        upwards = range(state.amplitude, log_posteriors.size)
        downwards = range(state.amplitude - 1, -1, -1)
        for direction in (upwards, downwards):
            for k in direction:
                log_posteriors[k] = self.log_posterior(state._replace(amplitude=k))
                if log_posteriors[k] < log_posteriors.max() - NEGLIGIBLE:
                    break
        return log_posteriors

    def additions(self, blocks: Blocks) -> Array:
        """Approximate log posterior of the set with each block added (blocks,); minus infinity for
        barred blocks; cached.

        Widths are the best without the added block; a member of the smallest width is tried with a
        usual width too, for with the block it may act. Amplitudes are the best and the next lower:
        a block may replace a part of the background.
        """
        if blocks not in self._additions:
            marginal = self.marginal(blocks)
            near_best = self._near_best(marginal, lower=True)
            factors_at = [at.additions - at.log_evidence + weight for at, weight in near_best]
            factors = np.logaddexp.reduce(factors_at, axis=0)
            if 0 in marginal.best.widths:
                factors = np.maximum(factors, self._with_usual_widths(marginal, near_best))
            self._widths[blocks] = np.argmax(factors, axis=1)
            gain = log_sum(factors) - np.log(WIDTHS.size)
            gain[self.candidates.barred(blocks)] = -np.inf
            self._additions[blocks] = marginal.log_posterior + gain + self.candidates.log_odds
        return self._additions[blocks]

    def _with_usual_widths(
        self, marginal: Marginal, near: list[tuple[Conditional, float]]
    ) -> Array:
        """Factors of the additions if no member has the smallest width (blocks, widths)."""
        best = marginal.best
        usual = tuple(width or FIRST_WIDTH for width in best.widths)
        at = self.conditional(best._replace(widths=usual))
        same, weight = near[-1]  # the best amplitude: the other one is lower
        return at.additions - same.log_evidence + weight

    def removals(self, blocks: Blocks) -> Array:
        """Approximate log posterior of the set without each of its blocks (members,).

        Widths are the best with the block. Amplitudes are the best and the next higher.
        """
        marginal = self.marginal(blocks)
        losses = []
        for at, weight in self._near_best(marginal, lower=False):
            values = at.over_widths
            with_it = log_sum(values[:, :-1]) - np.log(WIDTHS.size)
            losses.append(weight + values[:, -1] - with_it)
        loss = np.logaddexp.reduce(losses, axis=0)
        odds = self.candidates.log_odds[list(blocks)]
        return np.asarray(marginal.log_posterior + loss - odds)

    def _near_best(self, marginal: Marginal, lower: bool) -> list[tuple[Conditional, float]]:
        """A set at its best amplitude and at the next one, each with its log weight."""
        best = marginal.best.amplitude
        following = best - 1 if lower else best + 1
        last = len(self.amplitudes) - 1
        amplitudes = sorted({best, min(max(following, 0), last)})
        at_least = np.maximum(marginal.amplitudes[amplitudes], LEAST_WEIGHT)
        weights = np.log(at_least)
        conditionals = [self.conditional(marginal.best._replace(amplitude=k)) for k in amplitudes]
        return list(zip(conditionals, weights - log_sum(weights), strict=True))
