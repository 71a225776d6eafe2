"""The model space: sets of blocks of causes and covariates, and the one posterior over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.diagnosis.candidates import Variants
from aacmm_pin.diagnosis.design_matrix import Block, Design
from aacmm_pin.diagnosis.gram_matrix import Gram
from aacmm_pin.diagnosis.linear_model import WIDTHS, Base, Conditional, Likelihood
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

Blocks = tuple[int, ...]
"""A set of blocks, in the order of their numbers."""
FIRST_WIDTH = 2
"""Number of the width with which the search for a block's best width begins."""
SWEEPS = 8
"""The best widths of a set are found in fewer rounds over its members than this."""


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
        each = [np.log([effect.share(records) for effect in variants]) for variants in library]
        each += [np.zeros(count) for count in np.bincount([b.candidate for b in design.blocks])[len(library) :]]
        within = np.concatenate([shares - logsumexp(shares) for shares in each])
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


class Marginal(NamedTuple):
    """Log posterior of a set of blocks, its widths and the background's amplitude summed over; and the best of these."""

    log_posterior: float
    best: State
    amplitudes: Array


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
        self._expansions: dict[Blocks, Array] = {}

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
        widths = tuple(WIDTHS[list(state.widths)].tolist())
        return Conditional(self.base(state.amplitude, as_stated), state.blocks, widths, self.likelihood)

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

        The sum is taken along each width alone from the best widths, as if they were independent.
        """
        if blocks not in self._marginals:
            self._marginals[blocks] = self._summed(blocks)
        return self._marginals[blocks]

    def _summed(self, blocks: Blocks) -> Marginal:
        best = self._near(blocks)
        for _ in range(SWEEPS):
            before, along = best, []
            best, amplitudes = self._over_amplitudes(best)
            products = self._products(blocks, best.amplitude)
            for member in range(len(blocks)):
                values = self._over_widths(products, best, member)
                along.append(values)
                widths = (*best.widths[:member], int(np.argmax(values)), *best.widths[member + 1 :])
                best = best._replace(widths=widths)
            if best == before:
                break
        top = max([amplitudes.max(), *(values.max() for values in along)])
        excess = sum(logsumexp(values) - values.max() for values in (*along, amplitudes))
        return Marginal(float(top + excess), best, np.exp(amplitudes - logsumexp(amplitudes)))

    def _near(self, blocks: Blocks) -> State:
        """A state of the set near the best: widths and amplitude of a set with one block less, if one is known."""
        for k, block in enumerate(blocks):
            if (known := self._marginals.get((*blocks[:k], *blocks[k + 1 :]))) is not None:
                widths = known.best.widths
                return State(blocks, (*widths[:k], self._first_width(known.best, block), *widths[k:]), known.best.amplitude)
        return State(blocks, (FIRST_WIDTH,) * len(blocks), 0)

    def _first_width(self, beside: State, block: int) -> int:
        expansion = self._expansions.get(beside.blocks)
        return FIRST_WIDTH if expansion is None else int(np.argmax(expansion[block]))

    def _products(self, blocks: Blocks, amplitude: int) -> Array:
        """Products of the set's columns with one another and with the residual, which is last (m + 1, m + 1)."""
        base, design = self.base(amplitude), self.candidates.design
        columns = [np.arange(design.blocks[k].columns.start, design.blocks[k].columns.stop) for k in blocks]
        own = np.concatenate([*columns, [design.width]]).astype(np.intp)
        rows = [base.strip(k)[:, own] for k in blocks]
        return np.concatenate([*rows, base.residual[None, own]])

    def _over_widths(self, products: Array, state: State, member: int) -> Array:
        """Log posterior of a state with each width of one of its blocks (widths,)."""
        trials = np.tile(state.widths, (WIDTHS.size, 1))
        trials[:, member] = np.arange(WIDTHS.size)
        return self._log_posteriors(products, state, trials)

    def _log_posteriors(self, products: Array, state: State, widths: Index) -> Array:
        """Log posterior of a state with several choices of widths (choices, blocks): (choices,)."""
        sizes = [self.candidates.blocks[k].size for k in state.blocks]
        scale = np.repeat(WIDTHS[widths], sizes, axis=1)
        scale = np.concatenate([scale, np.ones((len(widths), 1))], axis=1)
        whole = scale[:, :, None] * products * scale[:, None, :]
        whole[:, range(scale.shape[1] - 1), range(scale.shape[1] - 1)] += 1.0
        whole[:, -1, -1] = np.finfo(np.float64).max
        factor = np.linalg.cholesky(whole)
        chi2 = products[-1, -1] - np.square(factor[:, -1, :-1]).sum(axis=1)
        volume = np.log(np.diagonal(factor, axis1=1, axis2=2)[:, :-1]).sum(axis=1) + self.base(state.amplitude).log_volume
        return np.asarray(self.likelihood.log(chi2) - volume + self._log_prior(state.blocks))

    def _over_amplitudes(self, state: State) -> tuple[State, Array]:
        """The state with the best amplitude, and the log posterior with each (amplitudes,)."""
        widths = np.array([state.widths], dtype=np.intp)
        each = [state._replace(amplitude=k) for k in range(len(self.amplitudes))]
        found = [self._log_posteriors(self._products(s.blocks, s.amplitude), s, widths)[0] for s in each]
        return each[int(np.argmax(found))], np.array(found)

    def additions(self, blocks: Blocks) -> Array:
        """Log posterior of the set with each block more, about (blocks,); minus infinity for those that are barred.

        Widths and amplitude are the best without it, and summed over as there.
        """
        marginal = self.marginal(blocks)
        if blocks not in self._expansions:
            found = self.conditional(marginal.best).additions - np.log(WIDTHS.size)
            found[self.candidates.barred(blocks)] = -np.inf
            self._expansions[blocks] = found
        gain = logsumexp(self._expansions[blocks], axis=1) - self.conditional(marginal.best).log_evidence
        return np.asarray(marginal.log_posterior + gain + self.candidates.log_odds)
