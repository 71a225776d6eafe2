"""The model space: sets of blocks of causes and covariates, and the one posterior over them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin.diagnosis.candidates import Variants, is_change
from aacmm_pin.diagnosis.design_matrix import Block, Design, Family
from aacmm_pin.diagnosis.gram_matrix import Gram
from aacmm_pin.diagnosis.linear_model import (
    WIDTHS,
    Base,
    Conditional,
    Likelihood,
    keep,
    log_sum,
)
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.effects import Effect
from aacmm_pin.measurements import Measurements

Blocks = tuple[int, ...]
"""A set of blocks, in the order of their numbers."""
FIRST_WIDTH = 2
"""Number of the width with which the search for a block's best width begins."""
COUNTS = 6.0
"""Amplitudes whose log posterior is below the largest by more are not optimised over the widths."""
APART = 1.5
"""The orders of two waves of one joint differ by more; each is refined by up to 0.5."""
LEAST_WEIGHT = 1e-12
"""Least weight of an amplitude when additions are ranked."""
LEAST_GAIN = 1e-9
"""Least gain in log posterior for which a width changes."""
RECENT = 2
"""Sets that are kept as they were worked out: they are needed again with other blocks."""
REMOTE = 16.0
"""A family of blocks that all lower the log posterior of a set by more does not count beside the
set with a block more.
"""
NEGLIGIBLE = 12.0
"""A log posterior that is lower than the largest by more adds nothing to a sum."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The candidates for a set, their places and their prior odds.

    Attributes:
        design: the candidates and their blocks of columns.
        log_odds: log prior odds of inclusion of each block (blocks,).
        places: number of the place of each candidate (candidates,).
        free: whether each candidate can be every function of its place (candidates,).
        follows: the candidate without which each is not in a set, -1 for none (candidates,).
        values: nonlinear parameter of each block, nan for none (blocks,).
        changes: block of the change of each known cause.
    """

    design: Design
    log_odds: Array
    places: Index
    free: Mask
    follows: Index
    values: Array
    changes: Blocks = ()

    @staticmethod
    def of(design: Design, library: Sequence[Variants]) -> Candidates:
        """Prior odds: one cause is expected, shared by the causes' prior weights; one variant of
        each candidate.
        """
        causes = [variants[0] for variants in library]
        covariates = design.names[len(causes) :]
        weights = np.array([cause.prior_weight for cause in causes])
        of_causes = THRESHOLDS.library * weights / weights.sum()
        of_covariate = (1.0 - THRESHOLDS.library) / max(len(covariates), 1)
        of_covariates = np.full(len(covariates), of_covariate)
        log_prior = np.log(np.concatenate([of_causes, of_covariates]))
        records = design.fit.problem.measurements
        log_shares = [np.zeros(0)]
        for variants, log_odds in zip(library, log_prior, strict=False):
            log_shares.append(_shares(variants, log_odds, records))
        for count in np.bincount(design.owners)[len(causes) :]:
            log_shares.append(np.full(count, -np.log(count)))
        places = [*map(place_of, causes), *covariates]
        number_of_place = {place: k for k, place in enumerate(dict.fromkeys(places))}
        number_of_cause = {cause.label: k for k, cause in enumerate(causes)}
        follows = [number_of_cause.get(f"{cause.follows}:{cause.place}", -1) for cause in causes]
        free = [cause.free_form for cause in causes]
        blocks_of_causes = [b for b in design.blocks if b.candidate < len(library)]  # first ones
        effects = [library[b.candidate][b.variant] for b in blocks_of_causes]
        values = np.full(len(design.blocks), np.nan)
        for k, effect in enumerate(effects):
            if effect.nonlinear.field:
                values[k] = effect.nonlinear.value(effect)
        return Candidates(
            design,
            log_prior[design.owners] + np.concatenate(log_shares),
            places=np.array([number_of_place[place] for place in places], dtype=np.intp),
            free=np.array([*free, *len(covariates) * [False]], dtype=bool),
            follows=np.array([*follows, *len(covariates) * [-1]]),
            values=values,
            changes=tuple(k for k, effect in enumerate(effects) if is_change(effect)),
        )

    @property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks of columns."""
        return self.design.blocks

    @property
    def owners(self) -> Index:
        """Candidate of every block (blocks,)."""
        return self.design.owners

    def owner(self, block: int) -> int:
        """Candidate of a block."""
        return self.blocks[block].candidate

    def is_cause(self, block: int) -> bool:
        """Whether a block is of a cause of the library, and not of a covariate."""
        return self.owner(block) < self.design.causes

    @cached_property
    def block_places(self) -> Index:
        """Place of every block (blocks,)."""
        return self.places[self.owners]

    @cached_property
    def families(self) -> dict[int, list[Family]]:
        """The families of the blocks of each place, by its number."""
        of_place = defaultdict[int, list[Family]](list)
        for family in self.design.families:
            places = self.block_places[family.blocks]
            for place in np.unique(places).tolist():
                of_place[place].append(family.some(places == place))
        return of_place

    def barred(self, blocks: Blocks) -> Mask:
        """Which blocks cannot be added to ``blocks`` (blocks,).

        They are blocks of the same candidates; others beside a candidate that can be every function
        of its place, and it beside others; blocks without what they follow, or with an order near
        its.
        """
        owners = np.array([self.owner(k) for k in blocks], dtype=np.intp)
        barred = np.isin(self.owners, owners)
        full_places = self.places[owners[self.free[owners]]]
        barred |= np.isin(self.block_places, full_places)
        barred |= self.free[self.owners] & np.isin(self.block_places, self.places[owners])
        follows = self.follows[self.owners]
        barred |= (follows >= 0) & ~np.isin(follows, owners)
        for k in blocks:
            near = np.abs(self.values - self.values[k]) < APART
            barred |= near & (follows == self.owner(k))
        return barred

    def is_possible(self, blocks: Blocks) -> bool:
        """Whether a set has what each of its blocks follows, with another value."""
        block_of = {self.owner(k): k for k in blocks}
        for owner, k in block_of.items():
            followed = int(self.follows[owner])
            if followed < 0:
                continue
            if followed not in block_of:
                return False
            difference = self.values[k] - self.values[block_of[followed]]
            if abs(difference) < APART:
                return False
        return True


def place_of(effect: Effect) -> tuple[object, ...]:
    """Where a cause acts, and of what it is a function there: causes with the same are forms of one
    place.
    """
    return (effect.function_of or effect.cause, effect.location_field(), effect.place)


def _shares(variants: Variants, log_prior: float, records: Measurements) -> Array:
    """Log of each variant's share of the prior odds of its candidate (variants,).

    Of a known cause, the first variant is a change of its values, with the odds of the candidate.
    Each other variant has another nonlinear parameter: it is such a change and a new cause as well,
    so that its odds are the product of both.
    """
    shares = np.log([effect.nonlinear.prior_probability(effect, records) for effect in variants])
    new_beside_change = len(variants) > 1 and is_change(variants[0]) and variants[0].nonlinear.field
    if not new_beside_change:
        return shares - log_sum(shares)
    new = shares[1:] - log_sum(shares[1:])
    return np.concatenate([[0.0], new + log_prior])


class ModelState(NamedTuple):
    """A set of blocks with the prior width of each, and an amplitude of the background, by their
    numbers.
    """

    blocks: Blocks
    widths: tuple[int, ...]
    amplitude: int

    def of(self, kept: Sequence[int]) -> ModelState:
        """The state with the blocks ``kept`` alone, with their widths; those that this state lacks
        have a usual one.
        """
        width_of = dict(zip(self.blocks, self.widths, strict=True))
        widths = tuple(width_of.get(k, FIRST_WIDTH) for k in kept)
        return ModelState(tuple(kept), widths, self.amplitude)


class Marginal(NamedTuple):
    """Log posterior of a set of blocks, its widths and the background's amplitude summed over; the
    best of these; and the probability of each amplitude (amplitudes,).
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


Weighted = tuple[Conditional, float]
"""What is left beside a state of a set, with the state's log weight."""


class ModelSpace:
    """The posterior over sets of blocks.

    Args:
        candidates: what may be in a set.
        gram: inner products of the records that count.
        stated: whether the noise is stated.
        amplitudes: of the background.

    Attributes:
        ascents: where a search of the most probable set ended, by where it began.
    """

    def __init__(
        self,
        candidates: Candidates,
        gram: Gram,
        stated: bool,
        amplitudes: tuple[float, ...] = THRESHOLDS.amplitudes,
    ) -> None:
        self.candidates, self.gram, self.stated = candidates, gram, stated
        has_covariates = candidates.design.causes < len(candidates.design.names)
        self.amplitudes = amplitudes if has_covariates else (0.0,)
        self.ascents: dict[Blocks, Blocks] = {}
        self._bases: dict[tuple[int, bool], Base] = {}
        self._marginals: dict[Blocks, Marginal] = {}
        self._gains: dict[Blocks, Array] = {}
        self._added_widths: dict[Blocks, Array] = {}  # number of each added block's best width
        self._conditionals: dict[tuple[Blocks, int, bool], Conditional] = {}
        self._beside: dict[Blocks, list[Weighted]] = {}

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
        """The linear model with the set of ``state``, of which the last :data:`RECENT` are kept;
        ``as_stated``: see :class:`Base`.
        """
        key = (state.blocks, state.amplitude, as_stated)
        conditional = self._conditionals.get(key)
        if conditional is None:
            base = self.base(state.amplitude, as_stated)
            conditional = Conditional(base, state.blocks, state.widths, self.likelihood)
        elif conditional.widths != state.widths:
            conditional = conditional.with_widths(state.widths)
        keep(self._conditionals, key, conditional, RECENT)
        return conditional

    def release(self) -> None:
        """Free the memory of what is kept; log posteriors stay."""
        by_set = (self._gains, self._added_widths, self._beside)
        for kept in (self._bases, self._conditionals, *by_set):
            kept.clear()

    def is_evaluated(self, blocks: Blocks) -> bool:
        """Whether the log posterior of a set was worked out, and not approximated."""
        return blocks in self._marginals

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
        """Log prior odds of a set of blocks, with the equal prior of widths and amplitudes."""
        odds = self.candidates.log_odds[list(blocks)] - np.log(WIDTHS.size)
        return float(odds.sum() - np.log(len(self.amplitudes)))

    def marginal(self, blocks: Blocks, near: ModelState | None = None) -> Marginal:
        """The set's log posterior, summed over its widths and the amplitudes; kept.

        At each amplitude, the sum runs over each width alone from the best widths at this
        amplitude, as if the widths were independent. They are looked for from those of ``near``, a
        state of this set or of a larger one.
        """
        if blocks not in self._marginals:
            start = self._near(blocks) if near is None else near.of(blocks)
            self._marginals[blocks] = self._summed(start)
        return self._marginals[blocks]

    def _summed(self, state: ModelState) -> Marginal:
        """See :meth:`marginal`: best amplitude and best widths in turn, until an amplitude is the
        best again. The amplitudes that count are then summed over widths of their own.
        """
        by_amplitude = self._over_amplitudes(state)
        peaks = dict[int, Peak]()
        while (best := int(np.argmax(by_amplitude))) not in peaks:
            peak = self._peak(state._replace(amplitude=best))
            if peak.state.widths != state.widths:
                by_amplitude = self._over_amplitudes(peak.state)
            state = peak.state
            peaks[best] = peak
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
            fewer = (*blocks[:k], *blocks[k + 1 :])
            marginal = self._marginals.get(fewer)
            if marginal is None:
                continue
            added_widths = self._added_widths.get(fewer)
            width = FIRST_WIDTH if added_widths is None else int(added_widths[block])
            widths = list(marginal.best.widths)
            widths.insert(k, width)
            return ModelState(blocks, tuple(widths), marginal.best.amplitude)
        return ModelState(blocks, (FIRST_WIDTH,) * len(blocks), 0)

    def _peak(self, state: ModelState) -> Peak:
        """The peak at the state's amplitude: widths change one by one, the largest gain first."""
        conditional = self.conditional(state)
        log_prior = self._log_prior(state.blocks)
        while True:
            log_evidences = conditional.over_widths[:, :-1]  # (members, widths)
            largest = log_evidences.max(axis=1)
            members = np.arange(len(log_evidences))
            gains = largest - log_evidences[members, list(conditional.widths)]
            if gains.max(initial=0.0) <= LEAST_GAIN:
                break
            member = int(np.argmax(gains))
            widths = list(conditional.widths)
            widths[member] = int(np.argmax(log_evidences[member]))
            changed = conditional.with_widths(tuple(widths))
            # Each gain takes what other positive blocks add as constant: none may remain.
            if changed.log_evidence <= conditional.log_evidence + LEAST_GAIN:
                break
            conditional = changed
        log_posterior = conditional.log_evidence + log_prior
        # The sum over all widths is a product of one sum for each member.
        sums_over_largest = log_sum(log_evidences) - largest
        return Peak(
            log_posterior,
            log_posterior + float(sums_over_largest.sum()),
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

    def gains(self, blocks: Blocks) -> Array:
        """Approximate gain in log posterior of the set by each block more (blocks,); minus infinity
        for barred blocks; kept.

        Widths are the best without the added block; a member of the smallest width is tried with a
        usual width too, for with the block it may act. Amplitudes are the best and the next lower:
        a block may replace a part of the background. Beside a set that has one block more than
        another, they are those of that one.
        """
        if blocks not in self._gains:
            weighted, families = self._with_one_more(blocks)
            if not weighted:
                weighted = self._near_best(self.marginal(blocks))
                keep(self._beside, blocks, weighted, RECENT)
            by_state = [
                beside.additions(families) - beside.log_evidence + log_weight
                for beside, log_weight in weighted
            ]
            by_width = np.logaddexp.reduce(by_state, axis=0)  # (blocks, widths)
            self._added_widths[blocks] = np.argmax(by_width, axis=1)
            gain = log_sum(by_width) - np.log(WIDTHS.size)
            gain[self.candidates.barred(blocks)] = -np.inf
            self._gains[blocks] = gain + self.candidates.log_odds
        return self._gains[blocks]

    def _near_best(self, marginal: Marginal) -> list[Weighted]:
        """What is left beside a set at its best amplitude and at the next lower one; and if a
        member has the smallest width, with a usual one.
        """
        best = marginal.best
        at_best = self.conditional(best)
        lower = max(best.amplitude - 1, 0)
        has_lower = lower < best.amplitude
        shares = np.maximum(marginal.amplitudes[[lower, best.amplitude]], LEAST_WEIGHT)
        # The weights of the two amplitudes add up to one.
        log_weights = np.log(shares) - np.log(shares[1] + has_lower * shares[0])
        weight_of_lower, weight_of_best = log_weights.tolist()
        weighted = [(at_best, weight_of_best)]
        if has_lower:
            at_lower = self.conditional(best._replace(amplitude=lower))
            weighted.append((at_lower, weight_of_lower))
        if 0 in best.widths:
            widths = tuple(width or FIRST_WIDTH for width in best.widths)
            at_usual = self.conditional(best._replace(widths=widths))
            weight = weight_of_best + at_usual.log_evidence - at_best.log_evidence
            weighted.append((at_usual, weight))
        return weighted

    def _with_one_more(self, blocks: Blocks) -> tuple[list[Weighted], list[Family]]:
        """What is left beside a set, from what is left beside one with a block less, or an empty
        list if none of these is kept; and the families of which any block may count.

        A family that is remote beside the smaller set does not count beside the larger.
        """
        families = self._open_families(blocks)
        for k in blocks:
            fewer = tuple(block for block in blocks if block != k)
            if fewer not in self._beside:
                continue
            beside_fewer = self._beside[fewer]
            keep(self._beside, fewer, beside_fewer, RECENT)
            if fewer in self._gains:
                gains = self._gains[fewer]
                families = [one for one in families if gains[one.blocks].max() > -REMOTE]
            width = int(self._added_widths[fewer][k])
            weighted = [(beside.plus(k, width), log_weight) for beside, log_weight in beside_fewer]
            return weighted, families
        return [], families

    def _open_families(self, blocks: Blocks) -> list[Family]:
        """The families of which any block may be added to a set."""
        barred = self.candidates.barred(blocks)
        families = self.candidates.design.families
        return [family for family in families if not barred[family.blocks].all()]

    def exchanges(self, blocks: Blocks, gone: Blocks) -> tuple[float, Array]:
        """Approximate log posterior of the set without some members, and with each block in their
        place (blocks,), all else as it stands; minus infinity for barred blocks.
        """
        marginal = self.marginal(blocks)
        at_best = self.conditional(marginal.best)
        staying = tuple(k for k in blocks if k not in gone)
        beside = self.conditional(marginal.best.of(staying))
        log_odds = self.candidates.log_odds
        prior_of_gone = log_odds[list(gone)].sum() - len(gone) * np.log(WIDTHS.size)
        members = [blocks.index(k) for k in gone]
        over_best_width = log_sum(at_best.over_widths[members, :-1]) - at_best.log_evidence
        # What is to be added to a log evidence beside those that stay, for the log posterior.
        offset = (
            marginal.log_posterior - at_best.log_evidence - over_best_width.sum() - prior_of_gone
        )
        log_evidences = beside.additions(self._open_families(staying))  # (blocks, widths)
        keep(self._beside, staying, [(beside, 0.0)], RECENT)
        self._added_widths[staying] = np.argmax(log_evidences, axis=1)
        log_posterior = offset + log_sum(log_evidences) - np.log(WIDTHS.size) + log_odds
        log_posterior[self.candidates.barred(staying)] = -np.inf
        return float(offset + beside.log_evidence), np.asarray(log_posterior)

    def best_form(self, state: ModelState, place: int) -> ModelState:
        """The state with one block at a place, the most probable with its most probable width, or
        with none there; all else as it stands.

        If several blocks act there and are more probable together, the state stays as it is.
        """
        candidates = self.candidates
        members = [k for k in state.blocks if candidates.block_places[k] == place]
        staying = state.of([k for k in state.blocks if k not in members])
        one_form = self.with_best(staying, place)
        if len(members) > 1 and self.log_posterior(one_form) < self.log_posterior(state):
            return state
        return one_form

    def with_best(self, state: ModelState, place: int | None = None) -> ModelState:
        """The state with the most probable block more, of one place or of any; the state itself if
        none makes it more probable.
        """
        beside = self.conditional(state)
        families = None if place is None else self.candidates.families[place]
        values = beside.additions(families) - np.log(WIDTHS.size)
        values += self.candidates.log_odds[:, None]
        values[self.candidates.barred(state.blocks)] = -np.inf
        if not values.size or values.max() <= beside.log_evidence:
            return state
        block, width = divmod(int(np.argmax(values)), WIDTHS.size)
        width_of = dict(zip(state.blocks, state.widths, strict=True)) | {block: width}
        blocks = tuple(sorted(width_of))
        return ModelState(blocks, tuple(width_of[k] for k in blocks), state.amplitude)

    def best_amplitude(self, state: ModelState) -> ModelState:
        """The state with the most probable amplitude and then the most probable widths."""
        best = int(np.argmax(self._over_amplitudes(state)))
        return self._peak(state._replace(amplitude=best)).state

    def removals(self, blocks: Blocks) -> Array:
        """Approximate log posterior of the set without each of its blocks (members,).

        Widths are the best with the block. Amplitudes are the best and the next higher.
        """
        marginal = self.marginal(blocks)
        best = marginal.best
        higher = min(best.amplitude + 1, len(self.amplitudes) - 1)
        changes = []
        for k in dict.fromkeys([best.amplitude, higher]):
            log_evidences = self.conditional(best._replace(amplitude=k)).over_widths
            with_member = log_sum(log_evidences[:, :-1]) - np.log(WIDTHS.size)
            without_member = log_evidences[:, -1]
            share = max(marginal.amplitudes[k], LEAST_WEIGHT)
            changes.append(np.log(share) + without_member - with_member)
        change = np.logaddexp.reduce(changes, axis=0)
        log_odds = self.candidates.log_odds[list(blocks)]
        return np.asarray(marginal.log_posterior + change - log_odds)
