"""All curves of solutions that hold some seeds, once; and how nearly singular solutions are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.postures.pose_equations import Curve, Equations

MOST_VERTICES = 2000
"""A curve with more is returned unfinished."""
MOST_STEPS, MOST_ROUNDS = 3000, 50
"""Steps and curves of one problem after which a search ends with what it has. Real arms take fewer
than 800 steps and have up to 16 curves."""
SINGULAR = 1e-6
"""A solution is singular where the smallest singular value of the equations' derivative is this
part of the largest.
"""
CLEARLY = 10.0
"""A bound so many times larger leaves room for the rounding of a determinant, 1e-8 of its root."""
NEARLY_SINGULAR = 1e-4
"""Instead of ``SINGULAR``: a solution next to a singular one, where rounding decides what is found.
"""
PICKS, MAJORITY = 7, 4
"""Vertices of a curve that are looked for on the others, and most of them."""


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of some problems, and what is known besides of their solutions.

    Attributes:
        curves: sorted by the number of their problem.
        families: by problem, a singular solution that is on none of its curves: such go on in
            families of more dimensions.
        unfinished: numbers of the problems of which there may be more curves: the search ended at
            its limit of work.
        degenerate: see :func:`degenerate`.
    """

    curves: list[Curve]
    families: dict[int, Array]
    unfinished: frozenset[int]
    degenerate: bool


def following(curves: list[Curve]) -> Index:
    """Of the vertices of some curves, one curve after the other, the number of each one's next
    round its curve (n,).
    """
    lengths = np.array([len(curve.q) for curve in curves])
    last = np.cumsum(lengths) - 1
    behind = np.arange(1, lengths.sum() + 1)
    behind[last] = last - lengths + 1
    return behind


def all_curves(equations: Equations, seeds: Array, problem: Index, is_degenerate: bool) -> Curves:
    """Every curve that holds one of the ``seeds`` (n, k + 1), which must be solutions, once.

    Args:
        equations: of all problems.
        seeds: solutions [rad].
        problem: number of the problem of each (n,).
        is_degenerate: what :func:`degenerate` says.
    """
    regular = _regular(equations, seeds, problem)
    curves, families, unfinished = list[Curve](), dict[int, Array](), set[int]()
    order = np.argsort(problem, kind="stable")
    numbers, first = np.unique(problem[order], return_index=True)
    for number, mine in zip(numbers.tolist(), np.split(order, first)[1:], strict=True):
        is_regular = regular[mine]
        found, complete = curves_through(equations, seeds[mine[is_regular]], number)
        singular = seeds[mine[~is_regular]]
        for curve in found:  # a crossing is singular, but on a curve
            singular = singular[~equations.on_curve(singular, curve)]
        if len(singular):
            families[number] = singular[0]
        if not complete:
            unfinished.add(number)
        curves += found
    return Curves(curves, families, frozenset(unfinished), is_degenerate)


def curves_through(equations: Equations, seeds: Array, problem: int) -> tuple[list[Curve], bool]:
    """Every curve of one problem that holds one of the regular ``seeds`` (n, k + 1) [rad], once.

    Returns:
        the curves, and False where the search ended at its limit of work.
    """
    curves, steps, rounds = list[Curve](), 0, 0
    while len(seeds) and steps < MOST_STEPS and rounds < MOST_ROUNDS:
        most = min(MOST_VERTICES, MOST_STEPS - steps)
        curve, more = equations.trace(seeds[0], problem, most)
        steps, rounds = steps + more, rounds + 1
        seeds = seeds[1:]
        seeds = seeds[~equations.on_curve(seeds, curve)]
        if not is_known(equations, curve, curves):
            curves.append(curve)
    return curves, not len(seeds)


def is_known(equations: Equations, curve: Curve, curves: list[Curve]) -> bool:
    """Whether a curve is one of ``curves``: from a seed next to a crossing it may not be
    recognised, but most of some vertices all round it are.
    """
    picks = curve.q[np.arange(PICKS) * (len(curve.q) - 1) // (PICKS - 1)]
    for other in curves:
        on = equations.on_curve(picks[:MAJORITY], other).sum()
        if 0 < on < MAJORITY:
            on += equations.on_curve(picks[MAJORITY:], other).sum()
        if on >= MAJORITY:
            return True
    return False


def degenerate(equations: Equations, spread: Array) -> bool:
    """Whether the equations are nearly singular at all of some spread angles (n, k): then solutions
    are easily missed.

    So it is with arms whose axes are parallel, or meet in a point, all of them or nearly.
    """
    ratio, _ = flattest(equations, spread, np.zeros(len(spread), dtype=np.intp))
    return bool(ratio.max(initial=0.0) < NEARLY_SINGULAR)


def flattest(equations: Equations, q: Array, problem: Index) -> tuple[Array, Array]:
    """How far each solution (n, k) is from singular, and in which direction it is most easily left.

    Returns:
        smallest over largest singular value of the derivative (n,), 0 where all are; and the unit
        right singular vectors (n, k, k), the last row of each the one that changes the equations
        least.
    """
    _, sizes, vectors = np.linalg.svd(equations(q, problem)[1])
    return sizes[:, -1] / np.where(sizes[:, 0] > 0, sizes[:, 0], 1.0), vectors


def _regular(equations: Equations, q: Array, problem: Index) -> Mask:
    """Which solutions (n, k + 1) are not singular: (n,).

    ``√det(J Jᵀ) / ‖J‖ᵏ``, a product of ratios of singular values, is no larger than the smallest of
    them. Only where it is small they are worked out.
    """
    jacobian = equations(q, problem)[1]
    gram = jacobian @ jacobian.transpose(0, 2, 1)
    size = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    bound = np.sqrt(np.maximum(np.linalg.det(gram / np.where(size > 0, size, 1.0)), 0.0))
    regular = np.asarray(bound > CLEARLY * SINGULAR)
    doubtful = np.flatnonzero(~regular)
    regular[doubtful] = flattest(equations, q[doubtful], problem[doubtful])[0] > SINGULAR
    return regular
