"""Closed curves of solutions of k equations in k + 1 angles, many at once, by predictor and corrector.

Source of the method: E. Allgower, K. Georg, "Introduction to Numerical Continuation Methods", SIAM 2003.
Each curve keeps its own step length. The sign of ``det [J; tᵀ]`` is constant along a smooth curve and changes where a step
jumps across a narrow gap to another branch; such a step is taken back and shortened. Where no step is short enough, curves
cross (as they do for an arm with parallel axes in an upright pose), and the trace leaps over to go straight on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, product

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.batches import chunks
from aacmm_pin._support.checks import Array, Index
from aacmm_pin.postures.curve_loop import (
    ASIDE_START,
    BULGE,
    CLEARLY,
    CLOSE_ENOUGH,
    CORRECTED,
    DAMPING,
    FIRST_STEP,
    LARGEST_TURN,
    LEAST_TURN,
    LONGEST_POLISH,
    LONGEST_STEP,
    MOST_CORRECTIONS,
    MOST_MEETINGS,
    MOST_POLISHES,
    MOST_ROUNDS,
    MOST_STEPS,
    MOST_VERTICES,
    NEAREST,
    OFF_GUESS,
    PAST_START,
    PICKS,
    POLISHED,
    SAME_POINT,
    SHORTENED,
    SHORTEST_STEP,
    SINGULAR,
    STEP_CHANGE,
    SURE_STEP,
    WANTED_TURN,
)
from aacmm_pin.postures.point_system import PointSystem

System = Callable[[Array, Index], tuple[Array, Array]]
"""``system(q, problem) -> F (n, k), J (n, k, k + 1)`` for angles q (n, k + 1) and the number of each row's problem (n,)."""

FLAT = 1e-4
"""Instead of ``SINGULAR``: a solution next to a singular one, where rounding decides what is found."""
STEADY = 0.01
"""A vertex reached by a step this long knows its tangent and curvature, however near a crossing is [rad]."""
LEAPS = (0.03, 0.1, 0.01)
"""How far beyond a crossing, where no step succeeds, the curve is looked for again [rad]."""
COMPARED = 200_000
"""Distances of solutions from vertices that are worked out at once, for the processor's cache."""
MOST_LEAPS = 100


@dataclass(frozen=True)
class Curve:
    """One curve: its vertices in order (the first is not repeated at the end) and whether it returned to its start.

    Attributes:
        q: (m, k + 1) [rad], unwrapped: it follows the curve and may leave [-π, π].
        closed: True where the last vertex is followed by the first.
        problem: number of the problem that it belongs to.
    """

    q: Array
    closed: bool
    problem: int


def following(curves: list[Curve]) -> Index:
    """Of the vertices of some curves, one curve after the other, the number of each one's next round its curve (n,)."""
    lengths = np.array([len(curve.q) for curve in curves])
    last = np.cumsum(lengths) - 1
    behind = np.arange(1, lengths.sum() + 1)
    behind[last] = last - lengths + 1
    return behind


@dataclass(frozen=True, eq=False)
class Curves:
    """The curves of some problems, and what is known besides of their solutions.

    Attributes:
        curves: sorted by the number of their problem.
        families: by problem, a singular solution that is on none of its curves: such go on in families of more dimensions.
        unfinished: numbers of the problems of which there may be more curves: the search ended at its limit of work.
        degenerate: see :func:`degenerate`.
    """

    curves: list[Curve]
    families: dict[int, Array]
    unfinished: frozenset[int]
    degenerate: bool


def polish(system: System, q: Array, problem: Index) -> tuple[Array, NDArray[np.bool_]]:
    """Move each row to the nearest solution by damped least-norm Newton steps.

    Returns:
        q (n, k + 1) [rad] and the flags (n,) of those that reached a residual of ``CLOSE_ENOUGH``.
    """
    if isinstance(system, PointSystem):
        arrived = system.newton(q, problem, np.empty((0, q.shape[1])), MOST_POLISHES - 1)
        if arrived is not None:
            return arrived[0], arrived[2]
    q, best = q.copy(), np.full(len(q), np.inf)
    result = q.copy()
    active = np.arange(len(q))
    for _ in range(MOST_POLISHES):
        f, jacobian = system(q[active], problem[active])
        size = np.abs(f).max(axis=1, initial=0.0)
        better = size < best[active]
        result[active[better]], best[active[better]] = q[active[better]], size[better]
        going = size > POLISHED
        active, f, jacobian = active[going], f[going], jacobian[going]
        if not active.size:
            break
        step = -_least_norm(jacobian, f)
        length = np.linalg.norm(step, axis=1)
        q[active] += step * np.minimum(1.0, LONGEST_POLISH / np.maximum(length, 1e-300))[:, None]
        sure = _sure(jacobian, f, step)
        result[active[sure]], best[active[sure]] = q[active[sure]], 0.0
        active = active[~sure]
    return result, best <= CLOSE_ENOUGH


def trace(system: System, start: Array, problem: Index, most: int = MOST_VERTICES) -> tuple[list[Curve], int]:
    """Follow the curve through each of ``start`` (n, k + 1), which must be regular solutions, once round.

    Two starts on one curve give it twice: see :func:`on_curves`.

    Returns:
        one curve for each start, and the number of steps, at most ``most``, that the longest of them took.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # what comes of it is judged, and refused
        state = _State(system, start, problem)
        steps = next((step for step in range(most) if not state.step()), most)
    return state.curves(), steps


class _State:
    """All curves that are still under way."""

    def __init__(self, system: System, start: Array, problem: Index) -> None:
        self.system, self.start, self.problem = system, start, problem
        n = len(start)
        self.q = start.copy()
        jacobian = system(start, problem)[1]
        self.tangent = _null_vectors(jacobian)
        self.start_tangent = self.tangent.copy()
        self.sign = np.sign(np.linalg.det(_bordered(jacobian, self.tangent)))
        self.curvature = np.zeros_like(start)
        self.length = np.full(n, FIRST_STEP)
        self.steady = (self.q.copy(), self.tangent.copy(), self.curvature.copy())
        self.leaps = np.zeros(n, dtype=np.intp)
        self.travelled = np.zeros(n)
        self.closed = np.zeros(n, dtype=bool)
        self.active = np.arange(n)
        self.history: list[tuple[Index, Array]] = [(self.active, start.copy())]

    def step(self) -> bool:
        """One step of every active curve; False when none is left."""
        who = self.active
        if not who.size:
            return False
        h, t = self.length[who, None], self.tangent[who]
        guess = self.q[who] + h * t + 0.5 * h**2 * self.curvature[who]
        q, jacobian, good = _correct(self.system, guess, t, self.problem[who])
        tangent, sign = _next_tangent(jacobian, t)
        cosine = np.einsum("ni,ni->n", tangent, t)
        good &= (cosine > np.cos(LARGEST_TURN)) & (np.linalg.norm(q - guess, axis=1) < OFF_GUESS * h[:, 0])
        good &= sign == self.sign[who]
        self.length[who[~good]] *= SHORTENED
        stuck = self.length[who] < SHORTEST_STEP
        self._accept(who[good], q[good], tangent[good], sign[good], np.sqrt(np.maximum(0.0, 1 - cosine[good] ** 2)))
        stuck[stuck] = ~self._leap(who[stuck])
        self.active = who[~(self.closed[who] | stuck)]
        return True

    def _leap(self, who: Index) -> NDArray[np.bool_]:
        """Go on beyond the crossing that stops each of ``who``; which of them got there.

        Where curves cross, J loses rank. From the last vertex that knew its tangent well, the curve is foretold beyond the
        crossing and corrected there.
        """
        over = np.zeros(len(who), dtype=bool)
        for leap in LEAPS:
            left = np.flatnonzero(~over & (self.leaps[who] < MOST_LEAPS))
            some = who[left]
            if not some.size:
                break
            base, t, curvature = (part[some] for part in self.steady)
            h = 2 * np.linalg.norm(self.q[some] - base, axis=1)[:, None] + leap
            guess = base + h * t + 0.5 * h**2 * curvature
            q, jacobian, good = _correct(self.system, guess, t, self.problem[some])
            tangent, sign = _next_tangent(jacobian, t)
            good &= np.einsum("ni,ni->n", tangent, t) > np.cos(LARGEST_TURN)
            good &= np.linalg.norm(q - guess, axis=1) < BULGE * h[:, 0]
            there = some[good]
            self._accept(there, q[good], tangent[good], sign[good], np.full(len(there), LARGEST_TURN))
            self.length[there], self.curvature[there] = STEADY, curvature[good]
            self.leaps[there] += 1
            over[left[good]] = True
        return over

    def _accept(self, who: Index, q: Array, tangent: Array, sign: Array, turn: Array) -> None:
        moved = q - self.q[who]
        distance = np.linalg.norm(moved, axis=1)
        closed = self._returned(who, moved, distance)
        keep = ~closed
        self.closed[who[closed]] = True
        self.history.append((who[keep], q[keep]))
        self.curvature[who] = (tangent - self.tangent[who]) / distance[:, None]
        self.q[who], self.tangent[who], self.sign[who] = q, tangent, sign
        steady = who[distance >= STEADY]
        for kept, now in zip(self.steady, (self.q, self.tangent, self.curvature), strict=True):
            kept[steady] = now[steady]
        self.travelled[who] += distance
        wanted = np.clip(WANTED_TURN / np.maximum(turn, LEAST_TURN), *STEP_CHANGE)
        self.length[who] = np.clip(self.length[who] * wanted, SHORTEST_STEP, LONGEST_STEP)

    def _returned(self, who: Index, moved: Array, distance: Array) -> NDArray[np.bool_]:
        """Did this step pass the start (modulo full turns)? Near it, the start is solved for and compared."""
        to_start = wrapped(self.start[who] - self.q[who])
        along = np.einsum("ni,ni->n", to_start, moved) / distance
        aside = np.linalg.norm(to_start - (along / distance)[:, None] * moved, axis=1)
        near = (along > 0) & (along <= PAST_START * distance) & (aside < ASIDE_START * distance) & (self.travelled[who] > 0)
        returned = np.zeros(len(who), dtype=bool)
        if near.any():
            some = np.flatnonzero(near)
            guess = self.q[who[some]] + (along[some] / distance[some])[:, None] * moved[some]
            goal = guess + wrapped(self.start[who[some]] - guess)
            returned[some] = _meets(self.system, guess, goal, self.start_tangent[who[some]], self.problem[who[some]])
        return returned

    def curves(self) -> list[Curve]:
        """The vertices gathered by curve."""
        who = np.concatenate([w for w, _ in self.history])
        q = np.concatenate([v for _, v in self.history])
        order = np.argsort(who, kind="stable")
        parts = np.split(q[order], np.searchsorted(who[order], np.arange(1, len(self.start))))
        return [Curve(part, bool(c), int(p)) for part, c, p in zip(parts, self.closed, self.problem, strict=True)]


def all_curves(system: System, seeds: Array, problem: Index, is_degenerate: bool) -> Curves:
    """Every curve that holds one of the ``seeds`` (n, k + 1), which must be solutions, once."""
    followed, left = system.curves(seeds, problem) if isinstance(system, PointSystem) else ([], slice(None))
    seeds, problem = seeds[left], problem[left]
    rounds: list[list[Curve]] = []
    regular = _regular(system, seeds, problem)
    singular, of_singular = seeds[~regular], problem[~regular]
    seeds, problem, steps = seeds[regular], problem[regular], 0
    while len(seeds) and steps < MOST_STEPS and len(rounds) < MOST_ROUNDS:
        _, first = np.unique(problem, return_index=True)
        new, more = trace(system, seeds[first], problem[first], min(MOST_VERTICES, MOST_STEPS - steps))
        steps += more
        left = np.ones(len(seeds), dtype=bool)
        left[first] = False
        left[left] = ~on_curves(system, seeds[left], problem[left], new)
        seeds, problem = seeds[left], problem[left]
        rounds.append(without_known(system, new, rounds))
    for known in rounds:  # a crossing is singular, but on a curve
        off = ~on_curves(system, singular, of_singular, known)
        singular, of_singular = singular[off], of_singular[off]
    return Curves(
        sorted(chain((Curve(q, True, number) for number, q in followed), *rounds), key=lambda curve: curve.problem),
        {int(number): q for number, q in zip(of_singular[::-1], singular[::-1], strict=True)},
        frozenset(int(number) for number in problem),
        is_degenerate,
    )


def degenerate(system: System, spread: Array) -> bool:
    """Whether the equations are nearly singular at all of some spread angles (n, k): then solutions are easily missed.

    So it is with arms whose axes are parallel, or meet in a point, all of them or nearly.
    """
    return bool(flattest(system, spread, np.zeros(len(spread), dtype=np.intp))[0].max(initial=0.0) < FLAT)


def _regular(system: System, q: Array, problem: Index) -> NDArray[np.bool_]:
    """Which solutions (n, k + 1) are not singular: (n,).

    ``√det(J Jᵀ) / ‖J‖ᵏ``, a product of ratios of singular values, is no larger than the smallest of them. Only where it is
    small they are worked out.
    """
    jacobian = system(q, problem)[1]
    gram = jacobian @ jacobian.transpose(0, 2, 1)
    size = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    bound = np.sqrt(np.maximum(np.linalg.det(gram / np.where(size > 0, size, 1.0)), 0.0))
    regular = np.asarray(bound > CLEARLY * SINGULAR)
    doubtful = np.flatnonzero(~regular)
    regular[doubtful] = flattest(system, q[doubtful], problem[doubtful])[0] > SINGULAR
    return regular


def flattest(system: System, q: Array, problem: Index) -> tuple[Array, Array]:
    """How far each solution (n, k) is from singular, and in which direction it is most easily left.

    Returns:
        smallest over largest singular value of the derivative (n,), 0 where all are; and the unit right singular vectors
        (n, k, k), the last row of each the one that changes the equations least.
    """
    _, sizes, vectors = np.linalg.svd(system(q, problem)[1])
    return sizes[:, -1] / np.where(sizes[:, 0] > 0, sizes[:, 0], 1.0), vectors


def without_known(system: System, new: list[Curve], rounds: list[list[Curve]]) -> list[Curve]:
    """The ``new`` curves without those found before: from a seed next to a crossing a known curve may not be recognised,
    but most of some vertices all round it are.
    """
    for known in rounds:
        if not new:
            break
        picks = [curve.q[np.linspace(0, len(curve.q) - 1, PICKS).astype(np.intp)] for curve in new]
        problem = np.repeat([curve.problem for curve in new], PICKS)
        on = on_curves(system, np.concatenate(picks), problem, known).reshape(-1, PICKS).sum(axis=1)
        new = [curve for curve, count in zip(new, on, strict=True) if 2 * count < PICKS]
    return new


def on_curves(system: System, q: Array, problem: Index, curves: list[Curve]) -> NDArray[np.bool_]:
    """Which of the solutions ``q`` (n, k + 1) lie on one of the ``curves`` (at most one for each problem): (n,).

    From the pieces at the vertices nearest to a solution, the curve's point in the plane through the solution and across its
    tangent is solved for; the solution is on the curve where that point is the solution itself. It must be as near to the
    piece as the curve is: from farther away Newton's method finds the solution from a neighbouring curve as well.
    """
    found = np.zeros(len(q), dtype=bool)
    row_of = np.full(max(problem.max(initial=-1), *[curve.problem for curve in curves], -1) + 1, -1)
    row_of[[curve.problem for curve in curves]] = np.arange(len(curves))
    open_ = np.flatnonzero(row_of[problem] >= 0)
    if not open_.size:
        return found
    longest = max(len(curve.q) for curve in curves)
    vertices = np.empty((len(curves), longest, q.shape[1]))
    for row, curve in enumerate(curves):
        vertices[row, : len(curve.q)] = curve.q
        vertices[row, len(curve.q) :] = curve.q[0]
    lengths = np.array([len(curve.q) for curve in curves])
    rows = row_of[problem[open_]]
    tangents = _null_vectors(system(q[open_], problem[open_])[1])
    nearest = _nearest(q[open_], vertices, lengths, rows)
    for k, side in product(range(nearest.shape[1]), (1, -1)):  # then the next nearest: the first may be on another strand
        left = np.flatnonzero(~found[open_])
        mine, vertex = rows[left], nearest[left, k]
        start, piece = vertices[mine, vertex], vertices[mine, (vertex + side) % lengths[mine]]
        piece = wrapped(piece - start)
        goal = start + wrapped(q[open_[left]] - start)
        size = np.maximum(np.linalg.norm(piece, axis=1), 1e-100)
        part = np.clip(np.einsum("ni,ni->n", goal - start, piece) / size**2, 0.0, 1.0)
        guess = start + part[:, None] * piece
        close = np.linalg.norm(goal - guess, axis=1) < BULGE * size + SAME_POINT  # else Newton might come from another curve
        left, who = left[close], open_[left[close]]
        found[who] = _meets(system, guess[close], goal[close], tangents[left], problem[who])
    return found


def _nearest(q: Array, vertices: Array, lengths: Index, rows: Index) -> Index:
    """Numbers of the vertices of row ``rows[i]`` that are nearest to ``q[i]``: (n, at most ``NEAREST``).

    Beyond its ``lengths`` a row is padded; copies of one vertex would crowd out the second and third nearest.
    """
    longest = vertices.shape[1]
    nearest = np.empty((len(q), min(NEAREST, longest)), dtype=np.intp)
    real = np.arange(longest) < lengths[:, None]
    there, here = (_on_circles(vertices) * real[:, :, None]).transpose(0, 2, 1), _on_circles(q)
    order = np.argsort(rows, kind="stable")
    ends = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(vertices)))])
    most = max(1, int(np.diff(ends).max()))  # of one row: the others are filled up to as many
    for part in chunks(len(vertices), max(1, COMPARED // (most * longest))):
        mine = order[ends[part.start] : ends[part.stop]]
        row, place = rows[mine] - part.start, np.arange(ends[part.start], ends[part.stop]) - ends[rows[mine]]
        filled = np.zeros((part.stop - part.start, most, here.shape[1]))
        filled[row, place] = here[mine]
        closeness = filled @ there[part]  # Σ cos(difference): largest where nearest
        for k in range(nearest.shape[1]):
            pick = closeness.argmax(axis=2)
            nearest[mine, k] = pick[row, place]
            np.put_along_axis(closeness, pick[:, :, None], -np.inf, axis=2)
    return nearest


def _on_circles(angles: Array) -> Array:
    """Each angle as a point of the unit circle, (..., 2 k)."""
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=-1)


def _meets(system: System, guess: Array, goal: Array, tangent: Array, problem: Index) -> NDArray[np.bool_]:
    """Does the curve near ``guess`` cut the plane through ``goal`` across ``tangent`` in ``goal`` itself?"""
    if not len(guess):
        return np.zeros(0, dtype=bool)
    shifted = guess - np.einsum("ni,ni->n", guess - goal, tangent)[:, None] * tangent
    near = np.linalg.norm(shifted - goal, axis=1) < 2 * LONGEST_STEP
    met = np.zeros(len(guess), dtype=bool)
    if near.any():
        q, _, good = _correct(system, shifted[near], tangent[near], problem[near], MOST_MEETINGS)
        met[near] = good & (np.linalg.norm(q - goal[near], axis=1) < SAME_POINT)
    return met


def _correct(
    system: System, guess: Array, tangent: Array, problem: Index, iterations: int = MOST_CORRECTIONS
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Newton across the tangent: solutions, their Jacobians, and which of them converged."""
    if isinstance(system, PointSystem):
        arrived = system.newton(guess, problem, tangent, iterations)
        if arrived is not None:
            return arrived
    q = guess.copy()
    f, jacobian = system(q, problem)
    good = np.abs(f).max(axis=1) <= CORRECTED
    open_ = np.flatnonzero(~good)
    for _ in range(iterations):
        right = np.zeros((len(open_), q.shape[1], 1))
        right[:, :-1, 0] = -f[open_]
        step = _solve(_bordered(jacobian[open_], tangent[open_]), right)[:, :, 0]
        q[open_] += step
        sure = _sure(jacobian[open_], f[open_], step)
        good[open_[sure]] = True
        open_ = open_[~sure]
        if not open_.size:
            break
        f[open_], jacobian[open_] = system(q[open_], problem[open_])
        there = np.abs(f[open_]).max(axis=1) <= CORRECTED
        good[open_[there]] = True
        open_ = open_[~there]
    return q, jacobian, good


def _sure(jacobian: Array, f: Array, step: Array) -> NDArray[np.bool_]:
    """Which Newton steps (n, k + 1) are so short that the next residual need not be worked out: (n,).

    A step is short, too, where no step helps: an arm whose axes are all parallel cannot leave its plane.
    """
    sure = np.asarray(np.linalg.norm(step, axis=1) < SURE_STEP)
    left = (jacobian[sure] @ step[sure][:, :, None])[:, :, 0] + f[sure]
    sure[sure] = np.abs(left).max(axis=1, initial=0.0) <= CLOSE_ENOUGH
    return sure


def _next_tangent(jacobian: Array, tangent: Array) -> tuple[Array, Array]:
    """Unit null vectors that go on in the sense of ``tangent``, and the sign of the bordered determinant."""
    matrix = _bordered(jacobian, tangent)
    right = np.zeros((len(matrix), matrix.shape[1], 1))
    right[:, -1] = 1.0
    new = _solve(matrix, right)[:, :, 0]
    new /= np.linalg.norm(new, axis=1)[:, None]
    return new, np.sign(np.linalg.det(matrix))


def _solve(matrix: Array, right: Array) -> Array:
    """Batched solve; a singular matrix gives a step that the caller refuses, not an exception for the whole batch."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix) @ right)


def _bordered(jacobian: Array, tangent: Array) -> Array:
    return np.concatenate([jacobian, tangent[:, None, :]], axis=1)


def _null_vectors(jacobian: Array) -> Array:
    """Unit null vectors of J (n, k, k + 1), from one solve each: any border that is not orthogonal to them will do."""
    n, k, _ = jacobian.shape
    border = np.broadcast_to(np.sqrt(np.arange(2.0, k + 3.0)), (n, k + 1))
    right = np.zeros((n, k + 1, 1))
    right[:, -1] = 1.0
    vectors = _solve(_bordered(jacobian, border), right)[:, :, 0]
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _least_norm(jacobian: Array, f: Array) -> Array:
    """Least-norm solution of J x = f, damped only where J is nearly singular."""
    gram = jacobian @ jacobian.transpose(0, 2, 1)
    trace_ = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    damping = np.where(trace_ > 0, DAMPING * trace_, 1.0) * np.eye(gram.shape[1])
    return np.asarray((jacobian.transpose(0, 2, 1) @ np.linalg.solve(gram + damping, f[:, :, None]))[:, :, 0])
