"""All single solutions of as many equations as angles, and whether some of the solutions are not single."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array
from aacmm_pin.postures.continuation import CLOSE_ENOUGH, SAME_POINT, System, polish
from aacmm_pin.postures.newton_search import SINGULAR, flattest

NEAR = 0.02
"""Solutions nearer than this are one if the equations hold half-way between them as well [rad]."""
ASIDE = np.array([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
"""How far beside a solution its neighbour is looked for, in the direction in which it is most easily left [rad]."""
ALONG = np.array([0.02, 0.04, 0.08])
"""Steps along a family, each of which has to arrive about there [rad]."""
MOST_SINGLE = 16
"""Six turning joints have at most so many single postures for a pose (Primrose 1986); more are a family in disguise."""
MOST_BESIDE = 8
"""So many finds are looked for beside one another; next to a singular pose an almost-family of them has no end."""


@dataclass(eq=False)
class Isolated:
    """Gathers single solutions; see :class:`aacmm_pin.postures.newton_search.Finds`.

    Two solutions that nearly coincide, as next to a singularity, have small basins between them: each find is left in its
    flattest direction, to both sides, to look for the other.

    Attributes:
        system: the equations.
        q: the solutions so far (m, k) [rad].
        hits: arrivals at each.
        family: a solution that is not single, because singular ones go on beside it (k,); None where none was met.
        families: arrivals at such.
    """

    system: System
    q: Array
    hits: list[int] = field(default_factory=list)
    family: Array | None = None
    families: int = 0

    def absorb(self, q: Array) -> int:
        """Take in solutions (n, k) [rad]; return the place in ``q`` behind the last that brought something new, or 0."""
        newest, first = 0, self.family is None
        single = self._single(q)
        self.families += int((~single).sum())
        if first and not single.all():
            newest = int(np.flatnonzero(~single)[0]) + 1
            self.family = q[newest - 1]
        for place in np.flatnonzero(single):
            number = self._number(q[place])
            if number is not None:
                self.hits[number] += 1
            elif len(self.q) >= MOST_SINGLE:
                self.families += 1
                self.family = q[place] if self.family is None else self.family
            else:
                self._add(q[place])
                self.hits[-1] += 1
                newest = max(newest, int(place) + 1)
                self._look_beside(q[place])
        return newest

    def _add(self, q: Array) -> None:
        self.q = np.vstack([self.q, wrapped(q)])
        self.hits.append(0)

    def _number(self, q: Array) -> int | None:
        """Which find ``q`` (k,) is; None where it is none of them."""
        gap = wrapped(self.q - q)
        distance = np.linalg.norm(gap, axis=1)
        for number in np.argsort(distance):
            if distance[number] < SAME_POINT:
                return int(number)
            if distance[number] > NEAR:
                return None
            between, _ = self.system((q + 0.5 * gap[number])[None, :], np.zeros(1, dtype=np.intp))
            if np.abs(between).max() <= CLOSE_ENOUGH:  # a solution of higher order is known less sharply
                return int(number)
        return None

    def _look_beside(self, q: Array) -> None:
        """Look for neighbours of a find (k,), for neighbours of these, and so on."""
        left = [q]
        for _ in range(MOST_BESIDE):
            if not left:
                return
            left += self._neighbours(left.pop(0))

    def _neighbours(self, q: Array) -> list[Array]:
        """Finds not known before, in the flattest direction from one (k,); they are known then."""
        direction = flattest(self.system, q[None, :])[1][0, -1]
        starts = q + np.concatenate([-ASIDE, ASIDE])[:, None] * direction
        found, good = polish(self.system, starts, np.zeros(len(starts), dtype=np.intp))
        found = found[good]
        new = []
        for other in found[self._single(found)]:
            if len(self.q) < MOST_SINGLE and self._number(other) is None:
                self._add(other)
                new.append(other)
        return new

    def _single(self, q: Array) -> NDArray[np.bool_]:
        """Which solutions (n, k) do not go on beside themselves, in one of their two flattest directions: (n,)."""
        single = np.ones(len(q), dtype=bool)
        if not len(q):
            return single
        size, vectors = flattest(self.system, q)
        flat = np.flatnonzero(size < SINGULAR)
        start, step = np.broadcast_arrays(q[flat, None, None], ALONG[:, None] * vectors[flat, -2:, None])
        guess = (start + step).reshape(-1, q.shape[1])
        found, good = polish(self.system, guess, np.zeros(len(guess), dtype=np.intp))
        there = (good & (np.linalg.norm(found - guess, axis=1) < 0.3 * np.tile(ALONG, 2 * len(flat)))).reshape(
            -1, 2, len(ALONG)
        )
        single[flat] = ~there.all(axis=2).any(axis=1)
        return single
