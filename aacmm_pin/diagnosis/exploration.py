"""Search for the sets of causes that hold the posterior's mass: best first from several starts,
with exchanges.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from aacmm_pin.diagnosis.model_space import Blocks, ModelSpace
from aacmm_pin.diagnosis.posterior import Posterior, inclusion, weights_of
from aacmm_pin.diagnosis.thresholds import THRESHOLDS


def explore(space: ModelSpace, starts: Iterable[Blocks] = ()) -> Posterior:
    """The sets that hold the posterior's mass.

    A first walk starts from the empty set; a second from ``starts``, each of the leading causes,
    and what could replace each member of the most probable set. If they disagree, the search goes
    on from all sets that either found.
    """
    walk = Walk(space, [()])
    walk.run()
    top = max(walk.values, key=lambda s: (walk.values[s], s))
    other = Walk(space, [*starts, *_leading(space), *(_climb_without(space, top, k) for k in top)])
    other.run()
    disagreement = _disagreement(space, walk.values, other.values)
    walk.values.update(other.values)
    walk.best = max(walk.best, other.best)
    if disagreement > THRESHOLDS.agreement:
        before = dict(walk.values)
        walk.exchanged.clear()
        walk.expansions += THRESHOLDS.expansions
        walk.run()
        disagreement = _disagreement(space, before, walk.values)
    return walk.posterior(disagreement)


def climb(space: ModelSpace, start: Blocks) -> Posterior:
    """The most probable set that steps and exchanges from ``start`` or the empty set lead to, and
    the sets visited on the way.
    """
    walk = Walk(space, [(), start])
    walk.run(least=1.0)
    return walk.posterior()


def explore_from(space: ModelSpace, starts: Iterable[Blocks]) -> Posterior:
    """The sets that hold the mass near ``starts``, for a part of the records: without exchanges."""
    walk = Walk(space, starts)
    walk.expansions = THRESHOLDS.expansions_of_part
    walk.run(exchanges=False)
    return walk.posterior()


def _leading(space: ModelSpace) -> list[Blocks]:
    """Each of the leading candidates alone."""
    odds = space.additions(())
    order = np.argsort(-odds, kind="stable")
    _, first = np.unique(space.candidates.owners[order], return_index=True)
    leading = order[np.sort(first)[: THRESHOLDS.leading]]
    return [(int(k),) for k in leading if np.isfinite(odds[k])]


def _climb_without(space: ModelSpace, blocks: Blocks, block: int) -> Blocks:
    """The set that ``blocks`` without ``block`` lead to, step by step uphill, if no block of this
    candidate is allowed.
    """
    barred = space.candidates.owners == space.candidates.owner(block)
    current = without_block(blocks, block)
    while True:
        log_posterior = space.marginal(current).log_posterior
        additions = np.where(barred, -np.inf, space.additions(current))
        steps = [(float(additions.max()), with_block(current, int(np.argmax(additions))))]
        steps += [
            (value, without_block(current, k))
            for k, value in zip(current, space.removals(current).tolist(), strict=True)
        ]
        best, next_set = max(steps, key=lambda step: step[0])
        if (
            best <= log_posterior - THRESHOLDS.close
            or space.marginal(next_set).log_posterior <= log_posterior
        ):
            return current
        current = next_set


def _disagreement(
    space: ModelSpace, one: Mapping[Blocks, float], other: Mapping[Blocks, float]
) -> float:
    first, second = (inclusion(space, weights_of(values)) for values in (one, other))
    difference = np.abs(first - second)
    return float(difference.max(initial=0.0))


class Walk:
    """Sets visited from some starts.

    Attributes:
        values: log posterior of each set visited; approximate where it is far below the best.
        best: largest log posterior.
        expansions: number of sets whose additions may still be ranked.
    """

    def __init__(self, space: ModelSpace, starts: Iterable[Blocks]) -> None:
        self.space, self.values, self.best = space, dict[Blocks, float](), -np.inf
        self.expanded, self.exchanged = set[Blocks](), set[Blocks]()
        self.expansions = THRESHOLDS.expansions
        for start in starts:
            self._look_at(start)

    def posterior(self, disagreement: float = 0.0) -> Posterior:
        """The posterior over the sets visited and all additions to expanded sets: each addition has
        little mass, but all together may have some per cent.
        """
        weights = weights_of(self._additions | self.values, THRESHOLDS.negligible_set)
        return Posterior(self.space, weights, disagreement)

    @property
    def _additions(self) -> dict[Blocks, float]:
        """Approximate log posterior of each expanded set with one block more."""
        found: dict[Blocks, float] = {}
        for blocks in self.expanded:
            about = self.space.additions(blocks)
            for k in np.flatnonzero(about > self.best - THRESHOLDS.negligible_set).tolist():
                larger = with_block(blocks, k)
                found[larger] = max(found.get(larger, -np.inf), float(about[k]))
        return found

    def run(self, least: float = THRESHOLDS.expanded, exchanges: bool = True) -> None:
        """Expand the best sets, and exchange members of those that hold the mass before weaker ones
        are expanded.

        Args:
            least: sets that are less probable than this part of the most probable are not expanded.
            exchanges: whether members are exchanged.
        """
        while self.expansions > 0:
            weights = weights_of(self.values)
            top = weights[next(iter(weights))]
            holds = max(min(THRESHOLDS.holds, top), least * top)
            open_ = [s for s, w in weights.items() if s not in self.expanded and w >= least * top]
            held = [
                s
                for s, w in weights.items()
                if exchanges and w >= holds and s not in self.exchanged
            ]
            if open_ and (not held or weights[open_[0]] >= holds):
                self._expand(open_[0])
            elif held:
                self._exchange(held[0])
            else:
                break

    def _look_at(self, blocks: Blocks) -> None:
        value = self.space.marginal(blocks).log_posterior
        self.values[blocks], self.best = value, max(self.best, value)

    def _visit(self, blocks: Blocks, about: float) -> None:
        """Evaluate a set if ``about``, its approximate log posterior, is near the best; keep the
        approximation if it is farther below.
        """
        if about > self.best - THRESHOLDS.close:
            self._look_at(blocks)
        elif about > self.best - THRESHOLDS.reach:
            self.values.setdefault(blocks, about)

    def _expand(self, blocks: Blocks) -> None:
        """Visit the set with each block more that is within reach, and without each member."""
        self._visit_additions(blocks)
        for k, value in zip(blocks, self.space.removals(blocks).tolist(), strict=True):
            self._visit(without_block(blocks, k), value)

    def _visit_additions(self, blocks: Blocks) -> list[int]:
        """Visit the additions to a set that are within reach; the most probable additions."""
        self.expansions -= blocks not in self.expanded
        self.expanded.add(blocks)
        self._look_at(blocks)
        values = self.space.additions(blocks)
        possible = np.flatnonzero(np.isfinite(values))
        order = possible[np.argsort(-values[possible], kind="stable")]
        best = self.best
        self.space.gram.prepare(order[values[order] > best - THRESHOLDS.close].tolist())
        for k in order[values[order] > best - THRESHOLDS.reach].tolist():
            self._visit(with_block(blocks, k), float(values[k]))
        leading: list[int] = order[: THRESHOLDS.instead].tolist()
        return leading

    def _exchange(self, blocks: Blocks) -> None:
        """Visit the set with one or two blocks in place of a member, or one block in place of
        several; until a better set is found.
        """
        self.exchanged.add(blocks)
        candidates = self.space.candidates
        before = self.best
        for rest in self._without_contained(blocks):
            self._visit_additions(rest)
        for k in blocks:
            rest = without_block(blocks, k)
            leading = self._visit_additions(rest)
            values = self.space.additions(rest)
            least = self.values[rest]
            least += THRESHOLDS.imitated * (self.best - least)
            for first in dict.fromkeys([*leading, *self._contained_in(rest, k)]):
                if candidates.owner(first) != candidates.owner(k) and values[first] > least:
                    self._visit_additions(with_block(rest, first))
            if self.best > before:
                return

    def _without_contained(self, blocks: Blocks) -> list[Blocks]:
        """The set without the members that one candidate contains, for each that contains
        several.
        """
        candidates = self.space.candidates
        found = list[Blocks]()
        for inside in candidates.contained.values():
            rest = tuple(k for k in blocks if candidates.owner(k) not in inside)
            if len(rest) < len(blocks) - 1 and rest not in found:
                found.append(rest)
        return found

    def _contained_in(self, rest: Blocks, block: int) -> list[int]:
        """The best block, beside ``rest``, of each candidate that a block's candidate contains."""
        candidates = self.space.candidates
        values = self.space.additions(rest)
        inside = candidates.contained.get(candidates.owner(block), frozenset())
        blocks_of = [np.flatnonzero(candidates.owners == owner) for owner in sorted(inside)]
        best = [int(blocks[np.argmax(values[blocks])]) for blocks in blocks_of if blocks.size]
        return [k for k in best if np.isfinite(values[k])]


def with_block(blocks: Blocks, more: int) -> Blocks:
    """The set with one block more."""
    return tuple(sorted((*blocks, more)))


def without_block(blocks: Blocks, less: int) -> Blocks:
    """The set without one of its blocks."""
    return tuple(k for k in blocks if k != less)
