"""All curves through seeds, and how nearly singular solutions are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask, spread_angles
from aacmm_pin.postures import continuation
from aacmm_pin.postures.continuation import NO_CURVE
from aacmm_pin.postures.pose_equations import Equations

MOST_STEPS, MOST_CURVES = 3000, 50
"""Of one problem, after which a search ends with what it has. Real arms take fewer than 800 steps
and have up to 16 curves.
"""
SINGULAR = 1e-6
"""Ratio of smallest to largest singular value of a singular solution."""
CLEARLY = 10.0
"""Margin for the rounding of a determinant, 1e-8 of its root."""
NEARLY_SINGULAR = 1e-4
"""Ratio next to a singular solution, where rounding decides what is found."""


@dataclass(frozen=True)
class Curve:
    """A curve: its vertices in order, the first not repeated.

    Attributes:
        q: (m, k + 1) [rad], unwrapped, so that it may leave [-π, π].
        closed: True if the last vertex is followed by the first.
        problem: number of its problem.
    """

    q: Array
    closed: bool
    problem: int


class CurveSearch:
    """The curves of one problem so far.

    Attributes:
        equations: of all problems.
        problem: number of this problem.
        families: singular solutions (f, k + 1) on no curve, of families with more dimensions.
        ended: the limit of work is reached.
    """

    def __init__(self, equations: Equations, problem: int = 0) -> None:
        self.equations = equations
        self.problem = problem
        joints = len(equations.links) - 1
        self.families = np.empty((0, joints))
        self.ended = False
        self._steps = MOST_STEPS
        self._count = 0
        self._vertices = np.empty((MOST_STEPS + MOST_CURVES + 1, joints))
        self._ends = np.zeros(MOST_CURVES, dtype=np.intp)
        self._closed = np.zeros(MOST_CURVES, dtype=np.bool_)

    def add(self, seeds: Array, regular: Mask | None = None) -> None:
        """Follow every curve through solutions ``seeds`` (n, k + 1) [rad] once; those that are
        ``regular`` (n,) may begin one. None: the search finds them.
        """
        equations = self.equations
        if regular is None:
            regular = _regular(equations, seeds, self.problem)
        number = np.empty(len(seeds), dtype=np.intp)
        goal = np.ascontiguousarray(equations.goals[self.problem])
        follow_curves = continuation.CURVES.compiled
        self._count, self._steps = follow_curves(
            equations.links,
            goal,
            np.ascontiguousarray(seeds),
            regular,
            self._steps,
            self._count,
            self._vertices,
            self._ends,
            self._closed,
            number,
            continuation.working_space(seeds.shape[1]),
        )
        on_no_curve = number == NO_CURVE  # a crossing is singular, but on a curve
        self.families = np.vstack([self.families, seeds[on_no_curve & ~regular]])
        self.ended |= bool((on_no_curve & regular).any())

    def __len__(self) -> int:
        return self._count

    @property
    def complete(self) -> bool:
        """Whether the curves are closed, and are all solutions that were found."""
        return bool(self._closed[: self._count].all()) and not (self.ended or len(self.families))

    @property
    def curves(self) -> list[Curve]:
        """The curves so far."""
        ends = self._ends[: self._count].tolist()
        begins = [0, *ends][: self._count]
        curves = []
        for begin, end, closed in zip(begins, ends, self._closed, strict=False):
            vertices = self._vertices[begin:end].copy()
            curves.append(Curve(vertices, bool(closed), self.problem))
        return curves


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of some problems.

    Attributes:
        equations: of all problems.
        searches: of each problem with solutions, in order.
        degenerate: see :func:`degenerate`.
    """

    equations: Equations
    searches: list[CurveSearch]
    degenerate: bool

    @cached_property
    def curves(self) -> list[Curve]:
        """All curves, sorted by the number of their problem."""
        return [curve for search in self.searches for curve in search.curves]


Guesses = Callable[[Array], tuple[Array, Index]]
"""Angles (n, k) [rad] close to solutions for goals (m, …), and the goal of each (n,)."""


def all_curves(equations: Equations, starts: int, guesses: Guesses | None = None) -> Curves:
    """Every curve, once, to which Newton's method leads from ``guesses`` for the goals in reach and
    from so many evenly spread ``starts`` for each.
    """
    base, *links = equations.links[:, :3, 3]
    distance = np.linalg.norm(equations.goals - base, axis=1)
    in_reach = np.flatnonzero(distance <= np.linalg.norm(links, axis=1).sum())
    spread = spread_angles(starts, len(links))
    q = np.tile(spread, (len(in_reach), 1))
    problem = np.repeat(in_reach, starts)
    if guesses is not None:
        guessed, goal = guesses(equations.goals[in_reach])
        q = np.concatenate([guessed, q])
        problem = np.concatenate([in_reach[goal], problem])
    q, arrived = equations.polish(q, problem)
    order = np.flatnonzero(arrived)[np.argsort(problem[arrived], kind="stable")]
    regular = _regular(equations, q[order], problem[order])
    numbers, first = np.unique(problem[order], return_index=True)
    searches = [CurveSearch(equations, number) for number in numbers.tolist()]
    for search, rows in zip(searches, np.split(np.arange(len(order)), first)[1:], strict=True):
        search.add(q[order[rows]], regular[rows])
    return Curves(equations, searches, degenerate(equations, spread))


def degenerate(equations: Equations, spread: Array) -> bool:
    """Whether the equations are nearly singular at all ``spread`` angles (n, k), as with parallel
    axes: solutions are then easily missed.
    """
    ratio, _ = flattest(equations, spread)
    return bool(ratio.max() < NEARLY_SINGULAR)


def flattest(equations: Equations, q: Array, problem: Index | int = 0) -> tuple[Array, Array]:
    """Distance of solutions (n, k) from singular, and directions that change the equations least.

    Returns:
        smallest over largest singular value (n,), 0 if all are 0; and right
        singular vectors (n, k, k), the flattest last.
    """
    _, jacobian = equations(q, problem)
    _, singular_values, vectors = np.linalg.svd(jacobian)
    largest = singular_values[:, 0]
    ratio = singular_values[:, -1] / np.where(largest > 0, largest, 1.0)
    return ratio, vectors


def _regular(equations: Equations, q: Array, problem: Index | int) -> Mask:
    """Solutions (n, k + 1) that are not singular: (n,).

    ``√det(J Jᵀ) / ‖J‖ᵏ``, a product of ratios of singular values, bounds the smallest; only if it
    is small, they are computed.
    """
    _, jacobian = equations(q, problem)
    gram = jacobian @ jacobian.transpose(0, 2, 1)
    square = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    determinant = np.linalg.det(gram / np.where(square > 0, square, 1.0))
    bound = np.sqrt(np.maximum(determinant, 0.0))
    regular = np.asarray(bound > CLEARLY * SINGULAR)
    doubtful = np.flatnonzero(~regular)
    ratio, _ = flattest(equations, q[doubtful], np.broadcast_to(problem, len(q))[doubtful])
    regular[doubtful] = ratio > SINGULAR
    return regular
