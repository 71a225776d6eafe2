"""All solutions of the equations of a pose, by Newton's method from many starts.

With as many equations as angles they are single (:class:`Isolated`). With one more angle they are
up to sixteen closed curves (:class:`SelfMotion`): J. W. Burdick, "On the inverse kinematics of
redundant manipulators: characterization of the self-motion manifolds", ICRA 1989.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aacmm_pin._support.angles import spread_angles, wrapped
from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.notes import Note
from aacmm_pin.postures.continuation import CLOSE_ENOUGH, NO_CURVE, SAME_POINT
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import (
    NEARLY_SINGULAR,
    SINGULAR,
    Curve,
    CurveSearch,
    degenerate,
    flattest,
)

ROUND = 256
ENOUGH = 300
"""Arrivals in a row without a new solution that end a search."""
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
        hits: arrivals at each solution found, in the order of the components.
        since_new: arrivals after the last new solution.
        ended: ended at its limit of work.
        degenerate: nearly singular everywhere.
    """

    starts: int
    arrived: int
    stalled: int
    hits: tuple[int, ...]
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


@dataclass(eq=False)
class SolutionSet:
    """A collection of solutions.

    Attributes:
        hits: arrivals at each find.
        family: a singular solution of no find (k,), or None.
        families: number of arrivals at such solutions.
        ended: the limit of work is reached.
    """

    equations: Equations
    hits: list[int] = field(default_factory=list)
    family: Array | None = None
    families: int = 0
    ended: bool = False

    def add(self, q: Array) -> int:
        """Add solutions (n, k) [rad]; return the number after the last new one, or 0."""
        raise NotImplementedError

    def _count_families(self, q: Array, regular: Mask) -> int:
        """Return the number after the first singular solution of a new family, or 0."""
        self.families += int((~regular).sum())
        if self.family is not None or regular.all():
            return 0
        first = int(np.flatnonzero(~regular)[0])
        self.family = q[first]
        return first + 1


@dataclass(eq=False)
class Isolated(SolutionSet):
    """Single solutions.

    Two that nearly coincide have small basins: the search looks to both sides of each find in its
    flattest direction.

    Attributes:
        q: (m, k) [rad].
    """

    def __post_init__(self) -> None:
        self.q = np.empty((0, len(self.equations.links) - 1))

    def add(self, q: Array) -> int:
        """See :meth:`SolutionSet.add`."""
        single = self._single(q)
        newest = self._count_families(q, single)
        for row in np.flatnonzero(single):
            number = self._number_of_same(q[row])
            if number is not None:
                self.hits[number] += 1
            elif len(self.q) >= MOST_SINGLE:
                self.families += 1
                self.family = q[row] if self.family is None else self.family
            else:
                self._add(q[row])
                self.hits[-1] += 1
                newest = max(newest, int(row) + 1)
                self._look_beside(q[row])
        return newest

    def _add(self, q: Array) -> None:
        self.q = np.vstack([self.q, wrapped(q)])
        self.hits.append(0)

    def _number_of_same(self, q: Array) -> int | None:
        """Number of the find that is the same solution as ``q`` (k,)."""
        gap = wrapped(self.q - q)
        distance = np.linalg.norm(gap, axis=1)
        for number in np.argsort(distance):
            if distance[number] < SAME_POINT:
                return int(number)
            if distance[number] > MERGE_DISTANCE:
                return None
            halfway = (q + 0.5 * gap[number])[None, :]
            residuals, _ = self.equations(halfway)
            if np.abs(residuals).max() <= CLOSE_ENOUGH:
                return int(number)  # a solution of higher order is known less sharply
        return None

    def _look_beside(self, q: Array) -> None:
        """Add neighbours of a find (k,) in its flattest direction, and theirs."""
        to_visit = [q]
        for _ in range(MOST_BESIDE):
            if not to_visit:
                return
            find = to_visit.pop(0)
            _, vectors = flattest(self.equations, find[None, :])
            direction = vectors[0, -1]
            starts = find + np.concatenate([-ASIDE, ASIDE])[:, None] * direction
            neighbours, arrived = self.equations.polish(starts)
            neighbours = neighbours[arrived]
            for neighbour in neighbours[self._single(neighbours)]:
                if len(self.q) < MOST_SINGLE and self._number_of_same(neighbour) is None:
                    self._add(neighbour)
                    to_visit.append(neighbour)

    def _single(self, q: Array) -> Mask:
        """Which solutions (n, k) do not continue in one of their two flattest directions: (n,)."""
        single = np.ones(len(q), dtype=bool)
        if not len(q):
            return single
        ratio, vectors = flattest(self.equations, q)
        singular = np.flatnonzero(ratio < SINGULAR)
        steps = ALONG[:, None] * vectors[singular, -2:, None]  # (m, 2, steps, k)
        guess = (q[singular, None, None] + steps).reshape(-1, q.shape[1])
        solutions, arrived = self.equations.polish(guess)
        miss = np.linalg.norm(solutions - guess, axis=1).reshape(-1, 2, len(ALONG))
        continues = arrived.reshape(miss.shape) & (miss < ABOUT_THERE * ALONG)
        single[singular] = ~continues.all(axis=2).any(axis=1)
        return single


@dataclass(eq=False)
class SelfMotion(SolutionSet):
    """Closed curves of solutions."""

    def __post_init__(self) -> None:
        self._search = CurveSearch(self.equations, 0)

    @property
    def curves(self) -> list[Curve]:
        """The curves so far."""
        return self._search.curves

    def add(self, q: Array) -> int:
        """See :meth:`SolutionSet.add`."""
        ratio, _ = flattest(self.equations, q)
        regular = ratio > SINGULAR
        newest = self._count_families(q, regular)
        curves_before = len(self.hits)
        curve = np.where(regular, self._search.add(q, regular), NO_CURVE)
        self.ended = self._search.steps <= 0
        latest_curve = int(curve.max(initial=NO_CURVE))
        if latest_curve >= curves_before:
            first_on_it = int(np.argmax(curve))
            newest = max(newest, first_on_it + 1)
        hits = np.bincount(curve[curve >= 0], minlength=curves_before)
        hits[:curves_before] += np.array(self.hits, dtype=np.intp)
        self.hits = hits.tolist()
        return newest


def search(finds: SolutionSet, joints: int, most_starts: int = MOST_STARTS) -> Search:
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
        close = failed[np.abs(residuals).max(axis=1, initial=0.0) < STALLED_BELOW]
        # Regular ones of these would have arrived with more steps.
        ratio, _ = flattest(equations, close)
        stalled += int((ratio < NEARLY_SINGULAR).sum())
        solutions = ends[good]
        newest = finds.add(solutions) if len(solutions) else 0
        since_new = len(solutions) - newest + (0 if newest else since_new)
        starts = starts + len(guesses)
        arrived = arrived + len(solutions)
        settled = since_new >= ENOUGH or (not arrived and starts >= STARTS_WITHOUT_ARRIVAL)
    ended = finds.ended or not settled
    flat = degenerate(equations, spread[:ROUND])
    return Search(starts, arrived, stalled, tuple(finds.hits), since_new, ended, flat)
