"""Solutions of the equations of a pose by Newton's method from many starts, in rounds, until rounds bring nothing new."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.postures.continuation import System, polish
from aacmm_pin.postures.wrist_ik import spread_angles

ROUND = 256
"""Starts of one round."""
ENOUGH = 300
"""Arrivals in a row that bring nothing new end a search."""
NOTHING = 1024
"""Starts of which none arrives end it too."""
MOST_STARTS = 16384
BESIDE = 1e-5
"""A start that did not arrive but whose equations are off by less than this stalled next to a solution [m, rad]."""
SINGULAR = 1e-6
"""A solution is singular where the smallest singular value of the equations' derivative is this part of the largest."""
FLAT = 1e-4
"""With this part of it, it is next to a singular one: rounding decides what is found there."""


@dataclass(frozen=True)
class Search:
    """What a search did, from which follows how sure it is.

    Attributes:
        starts: evenly spread starts of Newton's method.
        arrived: how many of them ended in a solution.
        stalled: how many came to a stand beside a solution next to a singular one.
        hits: how many arrived at each find, in the order of the components.
        since_new: arrivals after the last one that brought something new.
    """

    starts: int
    arrived: int
    stalled: int
    hits: tuple[int, ...]
    since_new: int

    @property
    def unseen(self) -> float:
        """Upper limit, 95 %, of the share of arrivals that would go to finds not yet seen: 3/``since_new``, at most 1.

        The rule of three: n trials without a success bound its probability by -ln 0.05/n. It speaks of basins of Newton's
        method, not of the arm: what no start leads to stays unseen.
        """
        return min(1.0, 3.0 / self.since_new) if self.since_new else 1.0

    def __str__(self) -> str:
        if not self.arrived:
            return f"none of {self.starts} spread starts arrived"
        return (
            f"{self.arrived} of {self.starts} spread starts arrived, the last {self.since_new} at nothing new "
            f"(95 %: fewer than {self.unseen:.1%} of arrivals would find more)"
        )


class Finds(Protocol):
    """What gathers solutions."""

    @property
    def hits(self) -> list[int]:
        """Arrivals at each find so far."""

    def absorb(self, q: Array) -> int:
        """Take in solutions (n, k) [rad]; return the place in ``q`` behind the last that brought something new, or 0."""


def search(system: System, joints: int, finds: Finds, most_starts: int = MOST_STARTS) -> Search:
    """Fill ``finds`` with the solutions of ``system`` in ``joints`` angles.

    Args:
        system: the equations; see :mod:`aacmm_pin.postures.continuation`.
        joints: number of angles.
        finds: gathers them.
        most_starts: the search ends there in any case.
    """
    starts = arrived = stalled = since_new = 0
    spread = spread_angles(most_starts, joints)
    while starts < most_starts and since_new < ENOUGH and (arrived or starts < NOTHING):
        some = spread[starts : starts + ROUND]
        q, good = polish(system, some, np.zeros(len(some), dtype=np.intp))
        stalled += _stalled(system, q[~good])
        q = q[good]
        newest = finds.absorb(q) if len(q) else 0
        since_new = len(q) - newest + (0 if newest else since_new)
        starts, arrived = starts + len(some), arrived + len(q)
    return Search(starts, arrived, stalled, tuple(finds.hits), since_new)


def _stalled(system: System, q: Array) -> int:
    """How many of some that did not arrive (n, k) stand beside a solution that is nearly singular."""
    off = np.abs(system(q, np.zeros(len(q), dtype=np.intp))[0]).max(axis=1, initial=0.0)
    beside = q[off < BESIDE]  # others of these would have arrived with more steps
    return int((flattest(system, beside)[0] < FLAT).sum()) if len(beside) else 0


def flattest(system: System, q: Array) -> tuple[Array, Array]:
    """How far each solution (n, k) is from singular, and in which direction it is most easily left.

    Returns:
        smallest over largest singular value of the derivative (n,), and the unit right singular vectors (n, k, k), the last
        row of each the one that changes the equations least.
    """
    jacobian = system(q, np.zeros(len(q), dtype=np.intp))[1]
    _, sizes, vectors = np.linalg.svd(jacobian)
    return sizes[:, -1] / sizes[:, 0], vectors
