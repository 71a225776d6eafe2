"""All solutions of the equations of a pose, by Newton's method from many starts.

With as many equations as angles they are single (:class:`Isolated`). With one more angle they are
up to sixteen closed curves (:class:`~.solution_curves.CurveSearch`): J. W. Burdick, "On the inverse
kinematics of redundant manipulators: characterization of the self-motion manifolds", ICRA 1989.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.angles import spread_angles, wrapped
from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.notes import Note
from aacmm_pin.postures.continuation import CLOSE_ENOUGH, SAME_POINT
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import (
    NEARLY_SINGULAR,
    SINGULAR,
    CurveSearch,
    degenerate,
    flattest,
)

ROUND = 256
ENOUGH = 300
"""Arrivals without a new solution that end a search."""
STARTS_WITHOUT_ARRIVAL = 1024
MOST_STARTS = 16384
STALLED_BELOW = 1e-5
"""Residual of a start that stalled next to a solution [m, rad]."""
MERGE_DISTANCE = 0.02
"""Closer solutions are one if the equations hold half-way too [rad]."""
ASIDE = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""Distances from a solution, in its flattest direction, to look for neighbours [rad]."""
ALONG = np.array([0.02, 0.04, 0.08])
"""Steps along a family, each of which must arrive close to its end [rad]."""
ABOUT_THERE = 0.3
"""Part of such a step by which it may end elsewhere."""
MOST_SINGLE = 16
"""Postures of six revolute joints for a pose (Primrose 1986)."""
MOST_BESIDE = 8
"""Finds beside each other; close to a singular pose there is no end of them."""


@dataclass(frozen=True)
class Search:
    """Data of a search.

    Attributes:
        starts: of Newton's method.
        arrived: starts that ended in a solution.
        stalled: starts that stopped near a nearly singular solution.
        since_new: arrivals in the rounds after the last new solution.
        ended: ended at its limit of work.
        degenerate: nearly singular everywhere.
    """

    starts: int
    arrived: int
    stalled: int
    since_new: int
    ended: bool = False
    degenerate: bool = False

    @property
    def unseen(self) -> float:
        """Upper limit (95 %) of the probability that the next arrival is at a new solution.

        3/``since_new``, at most 1, by the rule of three: n trials without success bound it by
        -ln 0.05/n. The search never finds solutions that no start leads to.
        """
        return min(1.0, 3.0 / self.since_new) if self.since_new else 1.0

    def __str__(self) -> str:
        if not self.arrived:
            return f"none of {self.starts} starts of the search converged"
        counts = {"arrived": self.arrived, "starts": self.starts, "since": self.since_new}
        sentences = [str(Note("search_converged", counts | {"unseen": 100 * self.unseen}))]
        return "; ".join(sentences + [str(Note("search_ended"))] * self.ended)


class Isolated:
    """Single solutions.

    Two that nearly coincide have small basins: the search looks to both sides of each find in its
    flattest direction.

    Attributes:
        q: (m, k) [rad].
        families: singular solutions (f, k) of families with more dimensions, as they came.
    """

    ended = False

    def __init__(self, equations: Equations) -> None:
        self.equations = equations
        self.q = np.empty((0, len(equations.links) - 1))
        self.families = self.q

    def add(self, q: Array) -> None:
        """Add solutions (n, k) [rad]."""
        single = self._single(q)
        for solution in q[single]:
            if self._has(solution):
                continue
            if len(self.q) >= MOST_SINGLE:
                self.families = np.vstack([self.families, solution])
                continue
            self.q = np.vstack([self.q, wrapped(solution)])
            self._look_beside(solution)
        self.families = np.vstack([self.families, q[~single]])

    def __len__(self) -> int:
        return len(self.q)

    def _has(self, q: Array) -> bool:
        """Whether ``q`` (k,) is a find."""
        gap = wrapped(self.q - q)
        distance = np.linalg.norm(gap, axis=1)
        if distance.min(initial=np.inf) < SAME_POINT:
            return True
        # A solution of higher order is known less sharply.
        residuals, _ = self.equations(q + 0.5 * gap[distance < MERGE_DISTANCE])
        return bool((np.abs(residuals).max(axis=1) <= CLOSE_ENOUGH).any())

    def _look_beside(self, q: Array) -> None:
        """Add neighbours of a find (k,) in its flattest direction, and theirs."""
        to_visit = [q]
        for _ in range(MOST_BESIDE):
            if not to_visit:
                return
            find = to_visit.pop(0)
            _, vectors = flattest(self.equations, find[None, :])
            starts = find + np.concatenate([-ASIDE, ASIDE])[:, None] * vectors[0, -1]
            neighbours, arrived = self.equations.polish(starts)
            neighbours = neighbours[arrived]
            for neighbour in neighbours[self._single(neighbours)]:
                if len(self.q) < MOST_SINGLE and not self._has(neighbour):
                    self.q = np.vstack([self.q, wrapped(neighbour)])
                    to_visit.append(neighbour)

    def _single(self, q: Array) -> Mask:
        """Which solutions (n, k) do not continue in one of their two flattest directions: (n,)."""
        ratio, vectors = flattest(self.equations, q)
        singular = np.flatnonzero(ratio < SINGULAR)
        steps = ALONG[:, None] * vectors[singular, -2:, None]  # (m, 2, steps, k)
        guess = (q[singular, None, None] + steps).reshape(-1, q.shape[1])
        solutions, arrived = self.equations.polish(guess)
        miss = np.linalg.norm(solutions - guess, axis=1).reshape(-1, 2, len(ALONG))
        continues = arrived.reshape(miss.shape) & (miss < ABOUT_THERE * ALONG)
        single = np.ones(len(q), dtype=bool)
        single[singular] = ~continues.all(axis=2).any(axis=1)
        return single


def search(finds: Isolated | CurveSearch, joints: int, most_starts: int = MOST_STARTS) -> Search:
    """Fill ``finds`` from at most ``most_starts`` starts in ``joints`` angles."""
    equations = finds.equations
    starts = arrived = stalled = since_new = 0
    spread = spread_angles(most_starts, joints)
    settled = False
    while starts < most_starts and not (settled or finds.ended):
        guesses = spread[starts : starts + ROUND]
        ends, good = equations.polish(guesses)
        failed = ends[~good]
        residuals, _ = equations(failed)
        close = failed[np.abs(residuals).max(axis=1) < STALLED_BELOW]
        # Regular ones of these would have arrived with more steps.
        ratio, _ = flattest(equations, close)
        stalled += int((ratio < NEARLY_SINGULAR).sum())
        before = len(finds), len(finds.families) > 0
        finds.add(ends[good])
        is_new = (len(finds), len(finds.families) > 0) != before
        since_new = 0 if is_new else since_new + int(good.sum())
        starts += len(guesses)
        arrived += int(good.sum())
        settled = since_new >= ENOUGH or (not arrived and starts >= STARTS_WITHOUT_ARRIVAL)
    ended = finds.ended or not settled
    flat = degenerate(equations, spread[:ROUND])
    return Search(starts, arrived, stalled, since_new, ended, flat)
