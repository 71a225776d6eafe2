"""The model space: sets of blocks of causes and covariates, and the one posterior over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.gram_matrix import Gram
from aacmm_pin.diagnosis.linear_model import WIDTHS, Base, Conditional, Likelihood, log_sum
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements.records import Measurements

Blocks = tuple[int, ...]
"""A set of blocks, in the order of their numbers."""
FIRST_WIDTH = 2
"""Number of the width with which the search for a block's best width begins."""
COUNTS = 6.0
"""At an amplitude whose log posterior is lower than the largest by more, the widths need not be the best."""
LEAST_WEIGHT = 1e-12
"""An amplitude has at least this weight where additions are ranked."""
LEAST_GAIN = 1e-9
"""A width is better if the log posterior is larger by more."""
RECENT = 10
"""So many sets' own products are kept, for they are asked for again at once: at each amplitude, and beside other blocks."""
NEGLIGIBLE = 12.0
"""A log posterior that is lower than the largest by more adds nothing to a sum."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """What may be in a set, and how probable it is before anything was seen.

    Attributes:
        design: the candidates and their blocks of columns.
        log_odds: log prior odds of inclusion of each block (blocks,).
        contained: for a candidate that is free enough to be others too, their numbers; they do not stand beside it.
    """

    design: Design
    log_odds: Array
    contained: Mapping[int, frozenset[int]]

    @staticmethod
    def of(design: Design, library: Sequence[Variants]) -> Candidates:
        """One cause is expected, shared by the causes' prior weights; of each, one variant is."""
        weights = np.array([candidate[0].usual for candidate in library])
        rest = len(design.names) - len(library)
        share = [THRESHOLDS.library * weights / weights.sum(), np.full(rest, (1.0 - THRESHOLDS.library) / max(rest, 1))]
        log_prior = np.log(np.concatenate(share))
        records = design.fit.problem.measurements
        each = [_shares(variants, prior, records) for variants, prior in zip(library, log_prior, strict=False)]
        each += [np.full(k, -np.log(k)) for k in np.bincount([b.candidate for b in design.blocks])[len(library) :]]
        within = np.concatenate(each)
        owners = np.array([b.candidate for b in design.blocks], dtype=np.intp)
        return Candidates(design, log_prior[owners] + within, _contained(library))

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks of columns."""
        return self.design.blocks

    @cached_property
    def owners(self) -> Index:
        """Candidate of every block (blocks,)."""
        return np.array([b.candidate for b in self.blocks], dtype=np.intp)

    def owner(self, block: int) -> int:
        """Candidate of a block."""
        return self.blocks[block].candidate

    def is_cause(self, block: int) -> bool:
        """Whether a block is of a cause of the library, and not of a covariate."""
        return self.owner(block) < self.design.causes

    @cached_property
    def containers(self) -> dict[int, frozenset[int]]:
        """For each candidate that others contain, their numbers."""
        inside = {c for members in self.contained.values() for c in members}
        return {c: frozenset(k for k, members in self.contained.items() if c in members) for c in inside}

    def barred(self, blocks: Blocks) -> NDArray[np.bool_]:
        """Which blocks cannot stand beside these: of the same candidates, what these contain, and what contains these."""
        owners = {self.owner(k) for k in blocks}
        struck = owners.union(*(self.contained.get(c, ()) for c in owners), *(self.containers.get(c, ()) for c in owners))
        return np.isin(self.owners, list(struck))


def _shares(variants: Variants, log_prior: float, records: Measurements) -> Array:
    """Log share of each variant in the prior odds of its candidate (variants,).

    Another inner value than that of a known cause is a change of this one and a new cause, each with these odds.
    """
    shares = np.log([effect.share(records) for effect in variants])
    if len(variants) > 1 and is_change(variants[0]) and variants[0].inner:
        return np.concatenate([[0.0], shares[1:] - log_sum(shares[1:]) + log_prior])
    return np.asarray(shares - log_sum(shares))


def _contained(library: Sequence[Variants]) -> dict[int, frozenset[int]]:
    number = {(effect.cause, effect.place): k for k, (effect, *_) in enumerate(library)}
    found: dict[int, set[int]] = {}
    for k, (effect, *_) in enumerate(library):
        for freer in effect.contained_in:
            if (owner := number.get((freer, effect.place))) is not None:
                found.setdefault(owner, set()).add(k)
    return {owner: frozenset(causes) for owner, causes in found.items()}


class State(NamedTuple):
    """A set of blocks with the prior width of each, and an amplitude of the background, by their numbers."""

    blocks: Blocks
    widths: tuple[int, ...]
    amplitude: int

    def of(self, kept: Sequence[int]) -> State:
        """Some of the blocks, with their widths; all else is as in it."""
        width = dict(zip(self.blocks, self.widths, strict=True))
        return State(tuple(kept), tuple(width[k] for k in kept), self.amplitude)


class Marginal(NamedTuple):
    """Log posterior of a set of blocks, its widths and the background's amplitude summed over; and the best of these."""

    log_posterior: float
    best: State
    amplitudes: Array


class Peak(NamedTuple):
    """At one amplitude: the largest log posterior over the widths of a set, the sum over the widths, the best state."""

    largest: float
    total: float
    state: State


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
        return Likelihood(self.gram.free - self.base(0).determined, self.stated)

    def conditional(self, state: State, as_stated: bool = False) -> Conditional:
        """What is left of every block beside a set."""
        base, key = self.base(state.amplitude, as_stated), (state.blocks, state.amplitude, as_stated)
        if key not in self._among:
            if len(self._among) == RECENT:
                del self._among[next(iter(self._among))]
            self._among[key] = base.among(state.blocks)
        return Conditional(base, state.blocks, state.widths, self.likelihood, self._among[key])

    def log_prior(self, blocks: Blocks) -> float:
        """Log prior odds of a set of blocks against none, without its widths."""
        return float(self.candidates.log_odds[list(blocks)].sum())

    def log_posterior(self, state: State) -> float:
        """Log posterior of a set with its widths and an amplitude, up to a constant of these records.

        Log marginal likelihood, plus the log prior odds of inclusion, plus the equal prior of widths and amplitudes. It does
        not depend on the order of the blocks.
        """
        order = sorted(range(len(state.blocks)), key=lambda k: state.blocks[k])
        blocks, widths = (tuple(each[k] for k in order) for each in (state.blocks, state.widths))
        return self.conditional(State(blocks, widths, state.amplitude)).log_evidence + self._log_prior(blocks)

    def _log_prior(self, blocks: Blocks) -> float:
        return self.log_prior(blocks) - float(len(blocks) * np.log(WIDTHS.size) + np.log(len(self.amplitudes)))

    def marginal(self, blocks: Blocks) -> Marginal:
        """The set's log posterior, summed over its widths and the amplitudes; kept.

        At each amplitude, the sum is taken along each width alone from the best widths there, as if they were independent.
        """
        if blocks not in self._marginals:
            self._marginals[blocks] = self._summed(blocks)
        return self._marginals[blocks]

    def _summed(self, blocks: Blocks) -> Marginal:
        state = self._near(blocks)
        found, peaks = self._over_amplitudes(state), dict[int, Peak]()
        while (best := int(np.argmax(found))) not in peaks:
            peaks[best] = self._peak(state._replace(amplitude=best))
            state = peaks[best].state
            found = self._over_amplitudes(state)
        for k in np.flatnonzero(found > found.max() - COUNTS).tolist():
            if k not in peaks:
                peaks[k] = self._peak(state._replace(amplitude=k))
        for k, peak in peaks.items():
            found[k] = peak.total
        top = max(peaks.values(), key=lambda peak: peak.largest)
        return Marginal(float(log_sum(found)), top.state, np.exp(found - log_sum(found)))

    def _near(self, blocks: Blocks) -> State:
        """A state of the set near the best: widths and amplitude of a set with one block less, if one is known."""
        for k, block in enumerate(blocks):
            if (known := self._marginals.get((*blocks[:k], *blocks[k + 1 :]))) is not None:
                widths, first = known.best.widths, self._first_width(known.best.blocks, block)
                return State(blocks, (*widths[:k], first, *widths[k:]), known.best.amplitude)
        return State(blocks, (FIRST_WIDTH,) * len(blocks), 0)

    def _first_width(self, beside: Blocks, block: int) -> int:
        return int(self._widths[beside][block]) if beside in self._widths else FIRST_WIDTH

    def _peak(self, state: State) -> Peak:
        """The best widths at the state's amplitude, changed one at a time."""
        at, log_prior = self.conditional(state), self._log_prior(state.blocks)
        while True:
            values = at.over_widths[:, :-1]
            largest = values.max(axis=1)
            more = largest - values[np.arange(len(values)), list(at.widths)]
            if more.max(initial=0.0) <= LEAST_GAIN:
                break
            member = int(np.argmax(more))
            widths = list(at.widths)
            widths[member] = int(np.argmax(values[member]))
            at = replace(at, widths=tuple(widths))
        own = at.log_evidence + log_prior
        total = own + float((log_sum(values) - largest).sum())
        return Peak(own, total, state._replace(widths=at.widths))

    def _over_amplitudes(self, state: State) -> Array:
        """Log posterior of the state with each amplitude (amplitudes,).

        It has one top: upwards and downwards from the state's amplitude, those beyond a negligible one are not asked.
        """
        found = np.full(len(self.amplitudes), -np.inf)
        for way in (range(state.amplitude, found.size), range(state.amplitude - 1, -1, -1)):
            for k in way:
                found[k] = self.log_posterior(state._replace(amplitude=k))
                if found[k] < found.max() - NEGLIGIBLE:
                    break
        return found

    def additions(self, blocks: Blocks) -> Array:
        """Log posterior of the set with each block more, about (blocks,); minus infinity for those that are barred; kept.

        Widths are the best without it. Amplitudes are the best and the next lower: a block takes over what the background
        did without it.
        """
        if blocks not in self._additions:
            marginal = self.marginal(blocks)
            there = [one.additions - one.log_evidence + weight for one, weight in self._near_best(marginal, lower=True)]
            factors = np.logaddexp.reduce(there, axis=0)
            self._widths[blocks] = np.argmax(factors, axis=1)
            gain = log_sum(factors) - np.log(WIDTHS.size)
            gain[self.candidates.barred(blocks)] = -np.inf
            self._additions[blocks] = marginal.log_posterior + gain + self.candidates.log_odds
        return self._additions[blocks]

    def removals(self, blocks: Blocks) -> Array:
        """Log posterior of the set without each of its blocks, about (members,).

        Widths are the best with it. Amplitudes are the best and the next higher.
        """
        marginal, found = self.marginal(blocks), []
        for one, weight in self._near_best(marginal, lower=False):
            each = one.over_widths
            found.append(weight + each[:, -1] - log_sum(each[:, :-1]) + np.log(WIDTHS.size))
        odds = self.candidates.log_odds[list(blocks)]
        return np.asarray(marginal.log_posterior + np.logaddexp.reduce(found, axis=0) - odds)

    def _near_best(self, marginal: Marginal, lower: bool) -> list[tuple[Conditional, float]]:
        """A set at its best amplitude and at the next one, each with its log weight."""
        best = marginal.best.amplitude
        following = best - 1 if lower else best + 1
        amplitudes = sorted({best, int(np.clip(following, 0, len(self.amplitudes) - 1))})
        weights = np.log(np.maximum(marginal.amplitudes[amplitudes], LEAST_WEIGHT))
        there = [self.conditional(marginal.best._replace(amplitude=k)) for k in amplitudes]
        return list(zip(there, weights - log_sum(weights), strict=True))
