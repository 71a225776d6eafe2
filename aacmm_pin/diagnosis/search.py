"""Search for the sets of causes that hold the posterior's mass: place by place from two starts,
then best first.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin.diagnosis.model_space import FIRST_WIDTH, Blocks, ModelSpace, ModelState
from aacmm_pin.diagnosis.posterior import Posterior, inclusion, weights_of
from aacmm_pin.diagnosis.thresholds import THRESHOLDS

Candidacy = frozenset[tuple[int, int]]
"""The candidates of a set, and the variants of its covariates."""
FREE_PARAMETERS = (3, 110)
"""Parameters of a form that could be nearly anything at its place: at least, and at most where the
search begins.
"""
LEAST_ASCENT = 1e-6
"""An ascent ends if a round gains less log posterior."""


def explore(space: ModelSpace, start: Blocks = ()) -> Posterior:
    """The sets that hold the posterior's mass.

    One walk begins where ascents from the empty set, from ``start``, and from a change of every
    known cause end; the other where that from every place at its freest form ends, until it meets
    the best set of the first. The search goes on from all sets that either visited; it has settled
    if that changes no probability.
    """
    starts = ((), start, space.candidates.changes)
    walk = Walk(space, [(), *(ascended(space, blocks) for blocks in starts)])
    walk.run()
    freest = ascended(space, every_place(space))
    if freest in walk.expanded:
        return walk.posterior()
    other = Walk(space, [freest])
    other.run(until=walk.best)
    met = other.best == walk.best
    walk.take_up(other)
    if not met:
        walk.exchanged.clear()
    values_before = dict(walk.values)
    walk.run()
    before = inclusion(space, weights_of(values_before))
    after = inclusion(space, weights_of(walk.values))
    disagreement = float(np.abs(before - after).max(initial=0.0))
    return walk.posterior(disagreement)


def climb(space: ModelSpace, start: Blocks) -> Posterior:
    """The most probable set that an ascent from ``start`` leads to, or the empty set."""
    return Walk(space, [(), ascended(space, start)]).posterior()


def explore_from(space: ModelSpace, start: Blocks) -> Posterior:
    """The sets that hold the mass near ``start``, for a part of the records: without exchanges."""
    walk = Walk(space, [(), ascended(space, start)])
    walk.expansions = THRESHOLDS.expansions_of_part
    walk.run(exchanges=False)
    return walk.posterior()


def every_place(space: ModelSpace) -> Blocks:
    """Every place at its freest form: the one with the most parameters."""
    candidates = space.candidates
    freest: dict[int, int] = {}
    for number, block in enumerate(candidates.blocks):
        place = int(candidates.places[block.candidate])
        least, most = FREE_PARAMETERS
        if candidates.is_cause(number) and least <= block.size <= most:
            freest_yet = freest.setdefault(place, number)
            if block.size > candidates.blocks[freest_yet].size:
                freest[place] = number
    return tuple(sorted(freest.values()))


def ascended(space: ModelSpace, start: Blocks) -> Blocks:
    """The set that changes of one place at a time lead to, each of which makes it more probable.

    First each place of the set takes its most probable form, or none; then the most probable block
    is added anywhere; until neither is a gain.
    """
    if start in space.ascents:
        return space.ascents[start]
    state = space.best_amplitude(ModelState(start, (FIRST_WIDTH,) * len(start), 0))
    value = space.log_posterior(state)
    while True:
        places = {int(space.candidates.block_places[k]) for k in state.blocks}
        for place in sorted(places):
            state = space.best_form(state, place)
        state = space.best_amplitude(space.with_best(state))
        value_before = value
        value = space.log_posterior(state)
        if value <= value_before + LEAST_ASCENT:
            break
    space.marginal(state.blocks, near=state)
    space.ascents |= {start: state.blocks, state.blocks: state.blocks}
    return state.blocks


class Walk:
    """Sets visited from some starts.

    Attributes:
        values: log posterior of each set visited; approximate where it is far below the best.
        expanded: sets, with the log posterior of each with one block more.
        exchanged: sets whose members were exchanged, whatever the variants of their causes.
        gains: gain in log posterior by each block more of sets whose causes differ in their
            variants alone, such as in the order of a wave: as of the last that was expanded. Where
            one is a gain, each of these sets is expanded: with the wrong order, others explain what
            the wave leaves.
        best: largest log posterior.
        expansions: number of sets whose additions may still be ranked.
    """

    def __init__(self, space: ModelSpace, starts: Iterable[Blocks]) -> None:
        self.space = space
        self.values = dict[Blocks, float]()
        self.best = -np.inf
        self.expanded = dict[Blocks, Array]()
        self.exchanged = set[Candidacy]()
        self.gains = dict[Candidacy, Array]()
        self.expansions = THRESHOLDS.expansions
        for start in starts:
            self._look_at(start)

    def take_up(self, other: Walk) -> None:
        """Add what another walk has visited; as many sets as at first may be expanded."""
        self.values |= other.values
        self.expanded |= other.expanded
        self.exchanged |= other.exchanged
        self.gains |= other.gains
        self.expansions = THRESHOLDS.expansions
        self.best = max(self.best, other.best)

    def posterior(self, disagreement: float = 0.0) -> Posterior:
        """The posterior over the sets visited and all additions to expanded sets: each addition has
        little mass, but all together may have some per cent.
        """
        additions: dict[Blocks, float] = {}
        least = self.best - THRESHOLDS.negligible_set
        for blocks, approximate in self.expanded.items():
            for k in np.flatnonzero(approximate > least).tolist():
                larger = with_block(blocks, k)
                additions[larger] = max(additions.get(larger, -np.inf), float(approximate[k]))
        weights = weights_of(additions | self.values, THRESHOLDS.negligible_set)
        return Posterior(self.space, weights, disagreement)

    def run(self, exchanges: bool = True, until: float = np.inf) -> None:
        """Expand the best sets, and exchange members of those that hold the mass before weaker ones
        are expanded; until the best set has the log posterior ``until``.
        """
        while self.expansions > 0 and self.best != until:
            weights = weights_of(self.values)
            top = weights[next(iter(weights))]
            least = THRESHOLDS.expanded * top
            holds = max(min(THRESHOLDS.holds, top), least)
            to_expand = [
                blocks
                for blocks, weight in weights.items()
                if blocks not in self.expanded and weight >= least
            ]
            to_exchange = [
                blocks
                for blocks, weight in weights.items()
                if exchanges
                and weight >= holds
                and self._regardless_of_variants(blocks) not in self.exchanged
            ]
            if to_expand and (not to_exchange or weights[to_expand[0]] >= holds):
                blocks = to_expand[0]
                gains = self.gains.get(self._regardless_of_variants(blocks))
                if gains is not None and gains.max() <= 0.0:
                    self.expanded[blocks] = self.values[blocks] + gains
                    continue
                # Two blocks that act only together are far more probable than the approximation
                # with the widths of one of them.
                if not self.space.is_evaluated(blocks):
                    self._look_at(blocks)
                self._visit_additions(blocks)
                removals = self.space.removals(blocks).tolist()
                for k, value in zip(blocks, removals, strict=True):
                    self._visit(without_block(blocks, k), value, blocks)
            elif to_exchange:
                self._exchange(to_exchange[0])
            else:
                break

    def _look_at(self, blocks: Blocks, near: ModelState | None = None) -> float:
        """Evaluate a set, and return its log posterior; see :meth:`ModelSpace.marginal`."""
        value = self.space.marginal(blocks, near).log_posterior
        self.values[blocks] = value
        self.best = max(self.best, value)
        return value

    def _visit(self, blocks: Blocks, approximate: float, beside: Blocks) -> float:
        """Evaluate a set if its approximate log posterior is near the best; keep the approximation
        if it is farther below. Its widths are looked for from those of ``beside``.

        Returns:
            By how much the approximation was too low.
        """
        if not self.space.candidates.is_possible(blocks):
            return 0.0
        if approximate > self.best - THRESHOLDS.close:
            near = self.space.marginal(beside).best if self.space.is_evaluated(beside) else None
            return self._look_at(blocks, near) - approximate
        if approximate > self.best - THRESHOLDS.reach:
            self.values.setdefault(blocks, approximate)
        return 0.0

    def _visit_each(self, staying: Blocks, values: Array, beside: Blocks) -> list[int]:
        """Visit a set with each block more that is within reach, by their approximate values; of
        the variants of one candidate, the approximation of the best is corrected for all.

        Returns:
            The best blocks of the most probable candidates.
        """
        possible = np.flatnonzero(np.isfinite(values))
        order = possible[np.argsort(-values[possible], kind="stable")]
        within_reach = order[values[order] > self.best - THRESHOLDS.reach]
        correction: dict[int, float] = {}
        for k in within_reach.tolist():
            owner = self.space.candidates.owner(k)
            larger = with_block(staying, k)
            if not self.space.candidates.is_possible(larger):
                continue
            if owner in correction:
                self.values.setdefault(larger, float(values[k]) + correction[owner])
            else:
                correction[owner] = self._visit(larger, float(values[k]), beside)
        _, first_of_owner = np.unique(self.space.candidates.owners[order], return_index=True)
        leading: list[int] = order[np.sort(first_of_owner)[: THRESHOLDS.instead]].tolist()
        return leading

    def _visit_additions(self, blocks: Blocks) -> None:
        """Visit a set with each block more; this uses up one expansion, the first time."""
        if blocks not in self.expanded:
            self.expansions -= 1
        gains = self.space.gains(blocks)
        self.gains[self._regardless_of_variants(blocks)] = gains
        self.expanded[blocks] = self.values[blocks] + gains
        self._visit_each(blocks, self.expanded[blocks], blocks)

    def _regardless_of_variants(self, blocks: Blocks) -> Candidacy:
        """The candidates of a set, and the variants of its covariates."""
        candidates = self.space.candidates
        return frozenset((candidates.owner(k), 0 if candidates.is_cause(k) else k) for k in blocks)

    def _exchange(self, blocks: Blocks) -> None:
        """Visit the set with one or two blocks, of whatever place, in place of each member, and of
        two members that imitate one another; until a better set is found.
        """
        self.exchanged.add(self._regardless_of_variants(blocks))
        owner = self.space.candidates.owner
        best_before = self.best
        for gone in self._exchanged_together(blocks):
            staying = tuple(k for k in blocks if k not in gone)
            without, values = self.space.exchanges(blocks, gone)
            self._visit(staying, without, blocks)
            leading = self._visit_each(staying, values, blocks)
            gone_owners = {owner(k) for k in gone}
            least = without + THRESHOLDS.imitated * (self.best - without)
            for first in leading:
                larger = with_block(staying, first)
                possible = self.space.candidates.is_possible(larger)
                is_other = owner(first) not in gone_owners
                if possible and is_other and values[first] > least:
                    self.values.setdefault(larger, float(values[first]))
                    self._visit_additions(larger)
            if self.best > best_before:
                return

    def _exchanged_together(self, blocks: Blocks) -> Iterator[Blocks]:
        """Each member alone, and each two members of one place or that imitate one another."""
        for k in blocks:
            yield (k,)
        places = self.space.candidates.block_places
        model = self.space.conditional(self.space.marginal(blocks).best)
        for pair in itertools.combinations(blocks, 2):
            one_place = places[pair[0]] == places[pair[1]]
            if one_place or model.canonical(*pair) > THRESHOLDS.imitates:
                yield pair


def with_block(blocks: Blocks, more: int) -> Blocks:
    """The set with one block more."""
    return tuple(sorted((*blocks, more)))


def without_block(blocks: Blocks, less: int) -> Blocks:
    """The set without one of its blocks."""
    return tuple(k for k in blocks if k != less)
