"""Which sets of causes hold the posterior's mass: best first from several starts, with exchanges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from aacmm_pin._support.checks import Array
from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace
from aacmm_pin.diagnosis.thresholds import EXPLORATION


@dataclass(frozen=True, eq=False)
class Explored:
    """Sets that were visited, with their weights.

    Attributes:
        weights: of each set of blocks, the largest first; they add up to one.
        log_posterior: of the most probable.
        total_variation: between what the two halves of the starts found.
    """

    weights: Mapping[Blocks, float]
    log_posterior: float
    total_variation: float

    @property
    def top(self) -> Blocks:
        """The most probable set."""
        return next(iter(self.weights))

    @property
    def agree(self) -> bool:
        """Whether the two halves of the starts found the same."""
        return self.total_variation <= EXPLORATION.agreement


def explore(space: ModelSpace, starts: Iterable[Blocks] = (), rng: np.random.Generator | None = None) -> Explored:
    """The sets that hold the posterior's mass.

    One half of the starts is nothing; the other half is what is given and each of the leading causes. With ``rng``, the
    second half has random sets of these too.
    """
    walk = Walk(space, [()])
    walk.run()
    first = walk.weights()
    other = Walk(space, [*starts, *_leading(space, rng)])
    other.run()
    apart = total_variation(space, first, other.weights())
    walk.values.update(other.values)
    if apart > EXPLORATION.agreement:
        walk.exchanged.clear()
        walk.expansions += EXPLORATION.expansions
        walk.run()
    weights = walk.weights()
    return Explored(weights, walk.best, apart)


def _leading(space: ModelSpace, rng: np.random.Generator | None) -> list[Blocks]:
    """Each of the leading candidates alone, and random sets of them."""
    odds = space.additions(())
    order = np.argsort(-odds)
    _, first = np.unique(space.candidates.owners[order], return_index=True)
    leading = order[np.sort(first)[: EXPLORATION.leading]]
    found: list[Blocks] = [(int(k),) for k in leading if np.isfinite(odds[k])]
    return found


def total_variation(space: ModelSpace, one: Mapping[Blocks, float], other: Mapping[Blocks, float]) -> float:
    """Largest difference of the probability of any candidate's inclusion."""
    first, second = (inclusion(space, weights) for weights in (one, other))
    return float(np.abs(first - second).max(initial=0.0))


def inclusion(space: ModelSpace, weights: Mapping[Blocks, float]) -> Array:
    """Inclusion probability of each candidate (candidates,)."""
    found = np.zeros(len(space.candidates.design.names))
    for blocks, weight in weights.items():
        found[[space.candidates.owner(k) for k in blocks]] += weight
    return found


class Walk:
    """Sets visited from some starts."""

    def __init__(self, space: ModelSpace, starts: Iterable[Blocks]) -> None:
        self.space, self.values = space, dict[Blocks, float]()
        self.expanded, self.exchanged = set[Blocks](), set[Blocks]()
        self.expansions = EXPLORATION.expansions
        for start in dict.fromkeys(starts):
            self.visit(start)

    @property
    def best(self) -> float:
        """Largest log posterior."""
        return max(self.values.values())

    def weights(self) -> dict[Blocks, float]:
        """Weight of each visited set, the largest first; sets out of reach are not among them."""
        near = {blocks: value for blocks, value in self.values.items() if value > self.best - EXPLORATION.reach}
        total = logsumexp(list(near.values()))
        return {blocks: float(np.exp(near[blocks] - total)) for blocks in sorted(near, key=lambda s: (-near[s], s))}

    def visit(self, blocks: Blocks) -> float:
        """Log posterior of a set."""
        if blocks not in self.values:
            self.values[blocks] = self.space.marginal(blocks).log_posterior
        return self.values[blocks]

    def run(self) -> None:
        """Expand the best sets; when they are, exchange members of those that hold the mass; until nothing is new."""
        while self.expansions > 0:
            open_ = [s for s, v in self.values.items() if s not in self.expanded and v > self.best - EXPLORATION.reach]
            if open_:
                self.expand(max(open_, key=lambda s: self.values[s]))
                continue
            held = [s for s, w in self.weights().items() if w >= EXPLORATION.holds and s not in self.exchanged]
            if not held:
                break
            self.exchange(held[0])

    def expand(self, blocks: Blocks, instead: bool = False) -> list[int]:
        """Visit the set with each of the most probable additions, and without each member; the additions."""
        if blocks in self.expanded and not instead:
            return []
        self.expansions -= blocks not in self.expanded
        self.expanded.add(blocks)
        values = self.space.additions(blocks)
        order = [int(k) for k in np.argsort(-values)[: EXPLORATION.beside]]
        for k in order:
            if values[k] > self.best - EXPLORATION.reach:
                self.visit(with_block(blocks, k))
        if not instead:
            for k in blocks:
                self.visit(without_block(blocks, k))
        return order

    def exchange(self, blocks: Blocks) -> None:
        """Visit the set with others in the place of each member: one, or two."""
        self.exchanged.add(blocks)
        before = self.best
        for k in blocks:
            rest = without_block(blocks, k)
            self.visit(rest)
            order = self.expand(rest, instead=True)
            for first in dict.fromkeys([*order[: EXPLORATION.instead], *self.contained_in(rest, k)]):
                if first != k and self.space.candidates.owner(first) != self.space.candidates.owner(k):
                    self.space.marginal(with_block(rest, first))
                    self.expand(with_block(rest, first), instead=True)
            if self.best > before:
                return

    def contained_in(self, rest: Blocks, block: int) -> list[int]:
        """The best block, beside ``rest``, of each candidate that a block's candidate contains."""
        candidates, values = self.space.candidates, self.space.additions(rest)
        found = []
        for owner in candidates.contained.get(candidates.owner(block), ()):
            own = np.flatnonzero(candidates.owners == owner)
            if own.size:
                found.append(int(own[np.argmax(values[own])]))
        return found


def with_block(blocks: Blocks, more: int) -> Blocks:
    """The set with one block more."""
    return tuple(sorted((*blocks, more)))


def without_block(blocks: Blocks, less: int) -> Blocks:
    """The set without one of its blocks."""
    return tuple(k for k in blocks if k != less)
