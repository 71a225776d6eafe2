"""All closed curves of solutions of equations in one angle more: the self-motion of an arm whose pose is held.

The notion: J. W. Burdick, "On the inverse kinematics of redundant manipulators: characterization of the self-motion
manifolds", ICRA 1989; for one joint more than conditions they are closed curves, at most sixteen of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin.postures.arc_length_sampling import evenly
from aacmm_pin.postures.continuation import Curve, System, on_curves, trace, without_known
from aacmm_pin.postures.newton_search import SINGULAR, flattest

TOGETHER = 24
"""Curves that are traced side by side, the same one several times: a batch costs little more than one alone."""


@dataclass(eq=False)
class SelfMotion:
    """Gathers closed curves; see :class:`aacmm_pin.postures.newton_search.Finds`.

    Attributes:
        system: the equations.
        curves: those found so far.
        hits: arrivals at each.
        family: a singular solution that is on no curve found (k,); None where there is none.
        families: arrivals at such.
    """

    system: System
    curves: list[Curve] = field(default_factory=list)
    hits: list[int] = field(default_factory=list)
    family: Array | None = None
    families: int = 0

    def absorb(self, q: Array) -> int:
        """Take in solutions (n, k + 1) [rad]; return the place in ``q`` behind the last that brought something new, or 0."""
        regular = flattest(self.system, q)[0] > SINGULAR
        newest = 0
        if self.family is None and not regular.all():
            newest = int(np.flatnonzero(~regular)[0]) + 1
            self.family = q[newest - 1]
        self.families += int((~regular).sum())
        left = np.flatnonzero(regular)
        for number, curve in enumerate(self.curves):
            left = left[~self._count(number, curve, q[left])]
        while left.size:
            some, left = left[:TOGETHER], left[TOGETHER:]
            for start, curve in zip(some, trace(self.system, q[some], np.zeros(len(some), dtype=np.intp)), strict=True):
                if start not in some or not without_known(self.system, [curve], [[known] for known in self.curves]):
                    continue
                newest = max(newest, int(start) + 1)
                self.curves.append(curve)
                self.hits.append(0)
                some, left = (part[~self._count(-1, curve, q[part])] for part in (some, left))
        return newest

    def _count(self, number: int, curve: Curve, q: Array) -> NDArray[np.bool_]:
        on = on_curves(self.system, q, np.full(len(q), curve.problem), [curve])
        self.hits[number] += int(on.sum())
        return on

    def spaced(self, count: int) -> tuple[Array, NDArray[np.intp]]:
        """``count`` solutions on each curve, evenly spaced by the way that the angles go, and the number of its curve."""
        return evenly(self.system, self.curves, count, lambda q: q)
