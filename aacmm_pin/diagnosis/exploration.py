"""Which sets of causes hold the posterior's mass: best first from several starts, with exchanges."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace
from aacmm_pin.diagnosis.posterior import Posterior, inclusion, weights_of
from aacmm_pin.diagnosis.thresholds import THRESHOLDS


def explore(space: ModelSpace, starts: Iterable[Blocks] = ()) -> Posterior:
    """The sets that hold the posterior's mass.

    One half of the starts is nothing; the other half is what is given and each of the leading causes. Where they do not find
    the same, all sets that either found are explored on.
    """
    walk, other = Walk(space, [()]), Walk(space, [*starts, *_leading(space)])
    walk.run()
    other.run()
    apart = _total_variation(walk, other)
    walk.values.update(other.values)
    if apart > THRESHOLDS.agreement:
        walk.exchanged.clear()
        walk.expansions += THRESHOLDS.expansions
        walk.run()
    return Posterior(space, weights_of(walk.values), walk.best - space.marginal(()).log_posterior, apart)


def explored_from(space: ModelSpace, starts: Iterable[Blocks]) -> Posterior:
    """The sets that hold the mass near some starts, for a part of the records: nothing is exchanged."""
    walk = Walk(space, starts)
    walk.expansions = THRESHOLDS.expansions_of_part
    walk.run(exchanges=False)
    return Posterior(space, weights_of(walk.values), walk.best - space.marginal(()).log_posterior, 0.0)


def _leading(space: ModelSpace) -> list[Blocks]:
    """Each of the leading candidates alone."""
    odds = space.additions(())
    order = np.argsort(-odds, kind="stable")
    _, first = np.unique(space.candidates.owners[order], return_index=True)
    leading = order[np.sort(first)[: THRESHOLDS.leading]]
    return [(int(k),) for k in leading if np.isfinite(odds[k])]


def _total_variation(one: Walk, other: Walk) -> float:
    first, second = (inclusion(walk.space, weights_of(walk.values)) for walk in (one, other))
    return float(np.abs(first - second).max(initial=0.0))


class Walk:
    """Sets visited from some starts.

    Attributes:
        values: log posterior of each set visited.
        expansions: of how many sets all additions may still be ranked.
    """

    def __init__(self, space: ModelSpace, starts: Iterable[Blocks]) -> None:
        self.space, self.values = space, dict[Blocks, float]()
        self.expanded, self.exchanged = set[Blocks](), set[Blocks]()
        self.expansions = THRESHOLDS.expansions
        for start in dict.fromkeys(starts):
            self._visit(start)

    @property
    def best(self) -> float:
        """Largest log posterior."""
        return max(self.values.values())

    def run(self, exchanges: bool = True) -> None:
        """Expand the best sets; when they are, exchange members of those that hold the mass; until nothing is new."""
        while self.expansions > 0:
            near = self.best - THRESHOLDS.expanded
            open_ = [s for s, v in self.values.items() if s not in self.expanded and v > near]
            if open_:
                self._expand(max(open_, key=lambda s: (self.values[s], s)))
                continue
            weights = weights_of(self.values).items()
            held = [s for s, w in weights if w >= THRESHOLDS.holds and s not in self.exchanged]
            if not (held and exchanges):
                break
            self._exchange(held[0])

    def _visit(self, blocks: Blocks) -> None:
        if blocks not in self.values:
            self.values[blocks] = self.space.marginal(blocks).log_posterior

    def _expand(self, blocks: Blocks) -> None:
        """Visit the set with each of the most probable additions, and without each member."""
        self._visit_additions(blocks)
        for k in blocks:
            self._visit(without_block(blocks, k))

    def _visit_additions(self, blocks: Blocks) -> list[int]:
        """The most probable additions to a set; those within reach are visited."""
        self.expansions -= blocks not in self.expanded
        self.expanded.add(blocks)
        values = self.space.additions(blocks)
        order = [int(k) for k in np.argsort(-values, kind="stable")[: THRESHOLDS.beside]]
        for k in order:
            if values[k] > self.best - THRESHOLDS.reach:
                self._visit(with_block(blocks, k))
        return order

    def _exchange(self, blocks: Blocks) -> None:
        """Visit the set with others in the place of each member: one, or two; until a better set is found."""
        self.exchanged.add(blocks)
        candidates, before = self.space.candidates, self.best
        for k in blocks:
            rest = without_block(blocks, k)
            order = self._visit_additions(rest)
            for first in order:
                self._visit(with_block(rest, first))
            for first in dict.fromkeys([*order[: THRESHOLDS.instead], *self._contained_in(rest, k)]):
                if candidates.owner(first) != candidates.owner(k):
                    self._visit_additions(with_block(rest, first))
            if self.best > before:
                return

    def _contained_in(self, rest: Blocks, block: int) -> list[int]:
        """The best block, beside ``rest``, of each candidate that a block's candidate contains."""
        candidates, values = self.space.candidates, self.space.additions(rest)
        inside = candidates.contained.get(candidates.owner(block), frozenset())
        own = [np.flatnonzero(candidates.owners == owner) for owner in sorted(inside)]
        return [int(some[np.argmax(values[some])]) for some in own if some.size]


def with_block(blocks: Blocks, more: int) -> Blocks:
    """The set with one block more."""
    return tuple(sorted((*blocks, more)))


def without_block(blocks: Blocks, less: int) -> Blocks:
    """The set without one of its blocks."""
    return tuple(k for k in blocks if k != less)
