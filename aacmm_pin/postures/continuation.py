"""Closed curves of solutions of k equations in k + 1 angles, by predictor and corrector, in loops
that numba compiles.

Source of the method: E. Allgower, K. Georg, "Introduction to Numerical Continuation Methods", SIAM
2003. The sign of ``det [J; tᵀ]`` is constant along a smooth curve and changes where a step jumps
across a narrow gap to another branch; such a step is taken back and shortened. Where no step is
short enough, curves cross (as they do for an arm with parallel axes in an upright pose), and the
trace leaps over the crossing to go straight on.

The equations say that the tip's frame is that of the base: its origin, its z axis too, or all its
axes. What the wanted pose is, is part of the first link: see :class:`~.pose_equations.Equations`.
Every function and constant that is compiled is here, for numba keeps the result until this file
changes; there are no slices, for these take numba seconds to compile.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.compiled import Loop

Space = tuple[Array, Array, Array, Array]
"""Working space: equations (k, n + 1), joint axes (n, 6), frame of the tip (3, 4), matrix (n, n +
2).

The equations are their derivatives by the n angles, and in the last column their values."""

POINT, POINT_AND_AXIS = 3, 5
"""Numbers of equations; a whole pose has 6."""
STRAIGHT = 1e-12
"""Sine of an angle below which a direction has arrived, or points right away from its goal."""
SERIES = 1e-3
"""Angle below which a series loses fewer digits than the closed form [rad]."""
CLOSE_ENOUGH = 1e-12
"""Largest residual of a solution [m, rad]."""
POLISHED, CORRECTED = 0.02 * CLOSE_ENOUGH, 0.2 * CLOSE_ENOUGH
"""Residuals at which polishing a seed, and correcting a step, end: what is left is rounding."""
MOST_POLISHES, MOST_CORRECTIONS, MOST_MEETINGS = 40, 5, 8
"""Newton steps after which polishing a seed, correcting a step, and meeting a plane give up."""
LONGEST_POLISH = 0.5
"""Of one Newton step from a seed [rad]; longer ones would leave the neighbourhood."""
DAMPING = 1e-14
"""Part of the trace of ``J Jᵀ`` added to its diagonal: felt only where J is nearly singular."""
SURE_STEP = 5e-7
"""After a shorter Newton step the residual is about the arm's length times step²/2, < 2e-13 m."""
LONGEST_CURVE_STEP = 0.40
FIRST_STEP = 0.125 * LONGEST_CURVE_STEP
"""Of a predictor along the curve [rad]."""
SHORTENED = 0.4
"""A step that failed is tried again at this part of its length."""
LEAST_CHANGE, MOST_CHANGE = 0.5, 1.8
"""Of a step's length, over that of the one before, which succeeded."""
SHORTEST_STEP = 1e-5
"""Nearer than this to a crossing the residual's rounding, over the distance, hides the direction
of the curve; a gap that narrow is a crossing [rad]."""
LARGEST_TURN = 0.30
"""Largest angle between the tangents at the two ends of a step [rad]."""
WANTED_TURN, LEAST_TURN = 0.6 * LARGEST_TURN, 1e-3
"""Angle that the length of the next step aims at, and one below which a piece counts as straight
[rad]."""
OFF_GUESS = 0.4
"""Part of a step by which its correction may move it; farther away it may be another curve."""
PAST_START, ASIDE_START = 1.0001, 0.3
"""Parts of a step: so far along it, and so far aside of it, the start is taken for passed."""
BULGE = 0.1
"""A curve that turns by less than ``LARGEST_TURN`` between vertices leaves the chord by less than
this part of it."""
STEADY = 0.01
"""A vertex reached by a step this long knows its tangent and curvature, however near a crossing is
[rad]."""
LEAPS = (0.03, 0.1, 0.01)
"""How far beyond a crossing, where no step succeeds, the curve is looked for again [rad]."""
MOST_LEAPS = 100
NEAREST = 3
"""Vertices of a curve from which a solution is looked for on it: the nearest may be on another
strand."""
SAME_POINT = 1e-6
"""Two solutions nearer to each other than this are one [rad]."""


# --- what is called from Python


def evaluate(links: Array, goals: Array, sine: bool, q: Array, equations: Array) -> None:
    """Values and derivatives of the equations.

    Args:
        links: see :meth:`DHTable.links`, (n + 1, 4, 4); the wanted pose is in the first.
        goals: places of the tip, one for each row of ``q``, (m, 3) [m].
        sine: whether the stylus is off by the sine of its angle, not by the angle.
        q: angles (m, n) [rad].
        equations: filled (m, k, n + 1), see :data:`Space`.
    """
    count, here, angles = equations.shape[1], links.copy(), np.empty(q.shape[1])
    space = working_space(count, q.shape[1])
    for row in range(len(q)):
        place(links, goals, row, here)
        copy(q, row, angles)
        linearise(here, sine, angles, space)
        for i in range(count):
            for j in range(q.shape[1] + 1):
                equations[row, i, j] = space[0][i, j]


def polish(links: Array, goals: Array, sine: bool, count: int, q: Array) -> Mask:
    """Move each row of ``q`` (m, n) to the nearest solution by damped least-norm Newton steps.

    Returns:
        which rows arrived (m,), at a residual of at most ``CLOSE_ENOUGH``.
    """
    arrived, here = np.empty(len(q), dtype=np.bool_), links.copy()
    angles, best = np.empty(q.shape[1]), np.empty(q.shape[1])
    space = working_space(count, q.shape[1])
    for row in range(len(q)):
        place(links, goals, row, here)
        copy(q, row, angles)
        arrived[row] = descend(here, sine, angles, best, space)
        for j in range(q.shape[1]):
            q[row, j] = best[j]
    return arrived


def trace(
    links: Array, goal: Array, sine: bool, start: Array, most: int, vertices: Array
) -> tuple[int, int, bool]:
    """Follow the curve through ``start`` (n,), a regular solution, once round.

    Args:
        links, sine: see :func:`evaluate`.
        goal: place of the tip (1, 3) [m].
        start: angles (n,) [rad].
        most: steps after which it ends in any case.
        vertices: filled (at least most + 1, n) [rad].

    Returns:
        how many vertices there are, how many steps it took, and whether the curve came back to its
        start.
    """
    n, here = len(start), links.copy()
    space = working_space(n - 1, n)
    place(links, goal, 0, here)
    q, tangent, curvature, first_tangent = start.copy(), np.empty(n), np.zeros(n), np.empty(n)
    steady_q, steady_tangent, steady_curvature = start.copy(), np.empty(n), np.zeros(n)
    trial, ahead = np.empty(n), np.empty(n)
    sign = tangent_at(here, sine, q, tangent, space)
    for j in range(n):
        vertices[0, j] = q[j]
        first_tangent[j] = steady_tangent[j] = tangent[j]
    length, travelled, count, leaps = FIRST_STEP, 0.0, 1, 0
    for step in range(most):
        on_side = follow(
            here, sine, q, tangent, curvature, length, OFF_GUESS * length, trial, ahead, space
        )
        leapt = False
        if on_side != sign:
            length *= SHORTENED
            if length >= SHORTEST_STEP:
                continue
            far = 2.0 * distance(q, steady_q)
            for leap in LEAPS:
                h = far + leap
                if not leapt and leaps < MOST_LEAPS:
                    on_side = follow(
                        here,
                        sine,
                        steady_q,
                        steady_tangent,
                        steady_curvature,
                        h,
                        BULGE * h,
                        trial,
                        ahead,
                        space,
                    )
                    leapt = on_side != 0.0
            if not leapt:
                return count, step + 1, False
            leaps, sign = leaps + 1, on_side
        moved = distance(trial, q)
        if travelled > 0.0 and passes(here, sine, q, trial, moved, start, first_tangent, space):
            return count, step + 1, True
        turn = LARGEST_TURN
        if not leapt:
            turn = math.sqrt(max(0.0, 1.0 - dot(ahead, tangent) ** 2))
        for j in range(n):
            vertices[count, j] = trial[j]
            change = (ahead[j] - tangent[j]) / moved
            curvature[j] = steady_curvature[j] if leapt else change
            q[j], tangent[j] = trial[j], ahead[j]
            if moved >= STEADY:
                steady_q[j], steady_tangent[j], steady_curvature[j] = q[j], tangent[j], change
        travelled, count = travelled + moved, count + 1
        length *= min(max(WANTED_TURN / max(turn, LEAST_TURN), LEAST_CHANGE), MOST_CHANGE)
        length = min(max(length, SHORTEST_STEP), LONGEST_CURVE_STEP)
        if leapt:
            length = STEADY
    return count, most, False


def on_curve(links: Array, goal: Array, sine: bool, q: Array, vertices: Array) -> Mask:
    """Which of the solutions ``q`` (m, n) are on the curve with these ``vertices`` (any, n): (m,).

    From the pieces at the vertices nearest to a solution, the curve's point in the plane through
    the solution and across its tangent is solved for; the solution is on the curve where that point
    is the solution itself.
    """
    n, here, found = q.shape[1], links.copy(), np.empty(len(q), dtype=np.bool_)
    space = working_space(n - 1, n)
    place(links, goal, 0, here)
    angles, tangent, guess, seen = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    nearest = np.empty(NEAREST, dtype=np.int64)
    for row in range(len(q)):
        copy(q, row, angles)
        nearest_vertices(angles, vertices, nearest)
        found[row], has_tangent = False, False
        for k in range(min(NEAREST, len(vertices))):
            for side in (1, -1):
                other = (nearest[k] + side) % len(vertices)
                if found[row] or not touches(angles, vertices, nearest[k], other, guess, seen):
                    continue
                if not has_tangent:
                    tangent_at(here, sine, angles, tangent, space)
                    has_tangent = True
                found[row] = meets(here, sine, guess, seen, tangent, space)
    return found


# --- along a curve


def follow(
    links: Array,
    sine: bool,
    q: Array,
    tangent: Array,
    curvature: Array,
    length: float,
    widest: float,
    trial: Array,
    ahead: Array,
    space: Space,
) -> float:
    """Predict a step of this ``length`` and correct it, into ``trial``, by less than ``widest``.

    Returns:
        the sign of the determinant there, with the tangent in ``ahead``; 0 where the step fails.
    """
    guess = np.empty(len(q))
    for j in range(len(q)):
        guess[j] = q[j] + length * tangent[j] + 0.5 * length**2 * curvature[j]
        trial[j] = guess[j]
        ahead[j] = tangent[j]
    if not correct(links, sine, tangent, MOST_CORRECTIONS, trial, space):
        return 0.0
    sign = null_vector(space, ahead)
    near = distance(trial, guess) < widest
    if near and dot(ahead, tangent) > math.cos(LARGEST_TURN):
        return sign
    return 0.0


def passes(
    links: Array,
    sine: bool,
    q: Array,
    trial: Array,
    moved: float,
    start: Array,
    tangent: Array,
    space: Space,
) -> bool:
    """Does the step from ``q`` to ``trial`` pass ``start``, where the curve has this
    ``tangent``?
    """
    n, along, aside = len(q), 0.0, 0.0
    guess, goal = np.empty(n), np.empty(n)
    for j in range(n):
        along += wrap(start[j] - q[j]) * (trial[j] - q[j]) / moved
    for j in range(n):
        aside += (wrap(start[j] - q[j]) - along / moved * (trial[j] - q[j])) ** 2
    if not 0.0 < along <= PAST_START * moved or math.sqrt(aside) >= ASIDE_START * moved:
        return False
    for j in range(n):
        guess[j] = q[j] + along / moved * (trial[j] - q[j])
        goal[j] = guess[j] + wrap(start[j] - guess[j])
    return meets(links, sine, guess, goal, tangent, space)


def nearest_vertices(q: Array, vertices: Array, nearest: NDArray[np.int64]) -> None:
    """Numbers of the vertices nearest to ``q``, in order; 0 where there are fewer."""
    least = np.full(NEAREST, np.inf)
    for place_ in range(NEAREST):
        nearest[place_] = 0
    for vertex in range(len(vertices)):
        far = 0.0
        for j in range(len(q)):
            far += wrap(q[j] - vertices[vertex, j]) ** 2
        rank = NEAREST
        while rank > 0 and far < least[rank - 1]:
            rank -= 1
        for later in range(NEAREST - 1, rank, -1):
            least[later], nearest[later] = least[later - 1], nearest[later - 1]
        if rank < NEAREST:
            least[rank], nearest[rank] = far, vertex


def touches(q: Array, vertices: Array, begin: int, end: int, guess: Array, seen: Array) -> bool:
    """Whether ``q`` is as near to the chord between two vertices as their curve is: from farther
    away Newton's method finds it from a neighbouring curve as well.

    The nearest place on the chord goes into ``guess``, and ``q`` in the same turns into ``seen``.
    """
    square, part = 1e-200, 0.0
    for j in range(len(q)):
        chord = wrap(vertices[end, j] - vertices[begin, j])
        seen[j] = vertices[begin, j] + wrap(q[j] - vertices[begin, j])
        square += chord**2
        part += chord * (seen[j] - vertices[begin, j])
    part = min(max(part / square, 0.0), 1.0)
    for j in range(len(q)):
        chord = wrap(vertices[end, j] - vertices[begin, j])
        guess[j] = vertices[begin, j] + part * chord
    return distance(seen, guess) < BULGE * math.sqrt(square) + SAME_POINT


def meets(
    links: Array, sine: bool, guess: Array, goal: Array, tangent: Array, space: Space
) -> bool:
    """Does the curve near ``guess``, which moves, cut the plane through ``goal`` and across
    ``tangent`` in ``goal`` itself?
    """
    off = 0.0
    for j in range(len(goal)):
        off += (guess[j] - goal[j]) * tangent[j]
    for j in range(len(goal)):
        guess[j] -= off * tangent[j]
    if not distance(guess, goal) < 2 * LONGEST_CURVE_STEP:
        return False
    solved = correct(links, sine, tangent, MOST_MEETINGS, guess, space)
    return solved and distance(guess, goal) < SAME_POINT


# --- Newton's method


def correct(
    links: Array, sine: bool, tangent: Array, iterations: int, q: Array, space: Space
) -> bool:
    """Move ``q`` across ``tangent`` to a solution; whether it arrived."""
    equations, _, _, matrix = space
    n = len(q)
    size = linearise(links, sine, q, space)
    for _ in range(iterations):
        if size <= CORRECTED:
            return True
        border(equations, tangent, -1.0, matrix)
        solve(matrix, n)
        length = step_length(matrix, n)
        if not length < np.inf:  # the derivative is singular
            return False
        for j in range(n):
            q[j] += matrix[j, n]
        if length < SURE_STEP and residual_after(equations, matrix) <= CLOSE_ENOUGH:
            return True
        size = linearise(links, sine, q, space)
    return size <= CORRECTED


def descend(links: Array, sine: bool, q: Array, best: Array, space: Space) -> bool:
    """Move ``q`` to the nearest solution by damped least-norm steps; the best place into ``best``.

    Returns:
        whether that is a solution.
    """
    equations, _, _, matrix = space
    n, least = len(q), np.inf
    for _ in range(MOST_POLISHES):
        size = linearise(links, sine, q, space)
        if size < least:
            least = size
            for j in range(n):
                best[j] = q[j]
        if size <= POLISHED:
            break
        least_norm_step(equations, matrix)
        length = step_length(matrix, n)
        if not length < np.inf:
            break
        part = min(1.0, LONGEST_POLISH / max(length, 1e-300))
        for j in range(n):
            q[j] += part * matrix[j, n]
        if length < SURE_STEP and residual_after(equations, matrix) <= CLOSE_ENOUGH:
            for j in range(n):
                best[j] = q[j]
            return True
    return least <= CLOSE_ENOUGH


def least_norm_step(equations: Array, matrix: Array) -> None:
    """The shortest step to where the linear equations hold, damped where J is nearly singular, into
    column n of ``matrix``.
    """
    count, n, size = len(equations), len(matrix), 0.0
    for i in range(count):
        for k in range(i + 1):
            product = 0.0
            for j in range(n):
                product += equations[i, j] * equations[k, j]
            matrix[i, k] = matrix[k, i] = product
        size += matrix[i, i]
    for i in range(count):
        matrix[i, i] += DAMPING * size if size > 0.0 else 1.0
        matrix[i, count] = -equations[i, n]
    solve(matrix, count)
    for i in range(count):
        matrix[i, n + 1] = matrix[i, count]
    for j in range(n):
        step = 0.0
        for i in range(count):
            step += equations[i, j] * matrix[i, n + 1]
        matrix[j, n] = step


def residual_after(equations: Array, matrix: Array) -> float:
    """Largest residual that the step in ``matrix`` leaves, to first order."""
    n, largest = len(matrix), 0.0
    for i in range(len(equations)):
        rest = equations[i, n]
        for j in range(n):
            rest += equations[i, j] * matrix[j, n]
        largest = max(largest, abs(rest))
    return largest


def step_length(matrix: Array, n: int) -> float:
    """Length of the step in column ``n`` of ``matrix`` [rad]."""
    square = 0.0
    for j in range(n):
        square += matrix[j, n] ** 2
    return math.sqrt(square)


def tangent_at(links: Array, sine: bool, q: Array, tangent: Array, space: Space) -> float:
    """The curve's ``tangent`` at the solution ``q``, in one of its senses; the sign of the
    determinant. Any border that is not orthogonal to the tangent would do.
    """
    linearise(links, sine, q, space)
    for j in range(len(q)):
        tangent[j] = math.sqrt(2.0 + j)
    return null_vector(space, tangent)


def null_vector(space: Space, along: Array) -> float:
    """The unit null vector of J in the sense of ``along``, in its place; the sign of the
    determinant of J with ``along`` below.
    """
    equations, _, _, matrix = space
    n = len(along)
    border(equations, along, 0.0, matrix)
    matrix[n - 1, n] = 1.0
    sign = solve(matrix, n)
    length = step_length(matrix, n)
    for j in range(n):
        along[j] = matrix[j, n] / length
    return sign


def border(equations: Array, along: Array, sense: float, matrix: Array) -> None:
    """``[J; alongᵀ]`` and behind it the values of the equations times ``sense``, into
    ``matrix``.
    """
    n = len(along)
    for j in range(n):
        for i in range(n - 1):
            matrix[i, j] = equations[i, j]
        matrix[n - 1, j] = along[j]
    for i in range(n - 1):
        matrix[i, n] = sense * equations[i, n]
    matrix[n - 1, n] = 0.0


def solve(matrix: Array, size: int) -> float:
    """Gauss's elimination: the solution of ``size`` equations takes the place of their right side,
    which is the column behind them.

    Returns:
        the sign of the determinant. Of a singular matrix the solution is not finite.
    """
    sign = 1.0
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if pivot != k:
            sign = -sign
            for j in range(k, size + 1):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        sign = math.copysign(sign, sign * matrix[k, k])
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, size + 1):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            matrix[k, size] -= matrix[k, j] * matrix[j, size]
        matrix[k, size] /= matrix[k, k]
    return sign


# --- the equations


def linearise(links: Array, sine: bool, q: Array, space: Space) -> float:
    """The equations at ``q``, into ``space``; the largest of their values."""
    equations, axes, tip, _ = space
    n, count, largest = len(q), len(equations), 0.0
    walk(links, q, axes, tip)
    for j in range(n):
        z0, z1, z2 = axes[j, 0], axes[j, 1], axes[j, 2]
        l0, l1, l2 = tip[0, 3] - axes[j, 3], tip[1, 3] - axes[j, 4], tip[2, 3] - axes[j, 5]
        equations[0, j] = z1 * l2 - z2 * l1
        equations[1, j] = z2 * l0 - z0 * l2
        equations[2, j] = z0 * l1 - z1 * l0
    for i in range(POINT):
        equations[i, n] = tip[i, 3]
    if count == POINT_AND_AXIS:
        point_along_z(equations, axes, tip, sine)
    elif count > POINT_AND_AXIS:
        turn_back(equations, axes, tip)
    for i in range(count):
        largest = max(largest, abs(equations[i, n]))
    return largest


def walk(links: Array, q: Array, axes: Array, tip: Array) -> None:
    """Direction and origin of each joint axis, and the frame of the tip."""
    for i in range(3):
        for k in range(4):
            tip[i, k] = links[0, i, k]
    for j in range(len(q)):
        cosine, sine, link = math.cos(q[j]), math.sin(q[j]), links[j + 1]
        for i in range(3):
            z, o = tip[i, 2], tip[i, 3]
            x = cosine * tip[i, 0] + sine * tip[i, 1]
            y = cosine * tip[i, 1] - sine * tip[i, 0]
            axes[j, i], axes[j, 3 + i] = z, o
            for k in range(4):
                tip[i, k] = x * link[0, k] + y * link[1, k] + z * link[2, k]
            tip[i, 3] += o


def point_along_z(equations: Array, axes: Array, tip: Array, sine: bool) -> None:
    """How far the tip's z axis d points off the base's: its part across, stretched from the sine of
    the angle θ to the angle, ``f = (d_x, d_y) θ/sin θ``; or its part across alone.

    Unlike the sine, the angle has no zero half a turn away: Newton's method from spread starts then
    arrives four times as often. Half a turn away it jumps, which costs a detour.
    """
    n = len(axes)
    d0, d1, d2 = tip[0, 2], tip[1, 2], tip[2, 2]
    across = math.sqrt(d0**2 + d1**2)
    stretch, slope, fixed = 1.0, 0.0, 0.0
    if not sine and across >= STRAIGHT:
        stretch = math.atan2(across, d2) / across
        slope, fixed = (d2 - stretch) / across**2, 1.0
    for j in range(n):
        z0, z1, z2 = axes[j, 0], axes[j, 1], axes[j, 2]
        u, v, w = z1 * d2 - z2 * d1, z2 * d0 - z0 * d2, z0 * d1 - z1 * d0
        longer = slope * (d0 * u + d1 * v) - fixed * w  # how the stretch changes
        equations[3, j] = stretch * u + d0 * longer
        equations[4, j] = stretch * v + d1 * longer
    equations[3, n], equations[4, n] = stretch * d0, stretch * d1
    if not sine and across < STRAIGHT and d2 < 0.0:
        equations[3, n] = math.pi


def turn_back(equations: Array, axes: Array, tip: Array) -> None:
    """The turn of the tip's frame as axis times angle φ, and its derivative by the joints.

    ``φ = log R``, and by a turn ω before R ``∂φ/∂ω = 1 - ½ [φ] + c [φ]²`` with c = 1/φ² -
    (1 + cos φ)/(2 φ sin φ) (Murray, Li, Sastry 1994, 2.3; the inverse of the left Jacobian).
    """
    n = len(axes)
    s0, s1, s2 = tip[2, 1] - tip[1, 2], tip[0, 2] - tip[2, 0], tip[1, 0] - tip[0, 1]
    sine = 0.5 * math.sqrt(s0**2 + s1**2 + s2**2)
    cosine = 0.5 * (tip[0, 0] + tip[1, 1] + tip[2, 2] - 1.0)
    angle, stretch = math.atan2(sine, cosine), 0.5
    if sine >= STRAIGHT:
        stretch = 0.5 * angle / sine
    p0, p1, p2 = stretch * s0, stretch * s1, stretch * s2
    if sine < STRAIGHT and cosine < 0.0:
        p0 = math.pi  # any axis is as wrong as another
    c = 1.0 / 12.0 + angle**2 / 720.0
    if angle >= SERIES:
        c = 1.0 / angle**2 - (1.0 + cosine) / (2.0 * angle * max(sine, STRAIGHT))
    for j in range(n):
        z0, z1, z2 = axes[j, 0], axes[j, 1], axes[j, 2]
        u, v, w = p1 * z2 - p2 * z1, p2 * z0 - p0 * z2, p0 * z1 - p1 * z0
        equations[3, j] = z0 - 0.5 * u + c * (p1 * w - p2 * v)
        equations[4, j] = z1 - 0.5 * v + c * (p2 * u - p0 * w)
        equations[5, j] = z2 - 0.5 * w + c * (p0 * v - p1 * u)
    equations[3, n], equations[4, n], equations[5, n] = p0, p1, p2


# --- small things


def working_space(count: int, n: int) -> Space:
    """Room for ``count`` equations in ``n`` angles."""
    return np.empty((count, n + 1)), np.empty((n, 6)), np.empty((3, 4)), np.empty((n, n + 2))


def place(links: Array, goals: Array, row: int, here: Array) -> None:
    """Move the base of ``here`` so that the goal is at the origin."""
    for i in range(3):
        here[0, i, 3] = links[0, i, 3] - goals[row, i]


def distance(a: Array, b: Array) -> float:
    """Of two configurations [rad]."""
    square = 0.0
    for j in range(len(a)):
        square += (a[j] - b[j]) ** 2
    return math.sqrt(square)


def dot(a: Array, b: Array) -> float:
    """Scalar product."""
    total = 0.0
    for j in range(len(a)):
        total += a[j] * b[j]
    return total


def wrap(angle: float) -> float:
    """The same direction between -π and π."""
    return angle - 2 * math.pi * math.floor(angle * (0.5 / math.pi) + 0.5)


def copy(rows: Array, number: int, row: Array) -> None:
    """One of the rows."""
    for j in range(len(row)):
        row[j] = rows[number, j]


HELPERS = (
    copy,
    wrap,
    dot,
    distance,
    place,
    working_space,
    turn_back,
    point_along_z,
    walk,
    linearise,
    solve,
    border,
    step_length,
    null_vector,
    tangent_at,
    residual_after,
    least_norm_step,
    descend,
    correct,
    meets,
    touches,
    nearest_vertices,
    passes,
    follow,
)
"""What the loops call, in an order in which each knows those that it calls itself."""
ARM = "f8[:, :, ::1], f8[:, ::1], b1"
EVALUATE = Loop(evaluate, f"({ARM}, f8[:, ::1], f8[:, :, ::1])", HELPERS)
POLISH = Loop(polish, f"({ARM}, i8, f8[:, ::1])", HELPERS)
TRACE = Loop(trace, f"({ARM}, f8[::1], i8, f8[:, ::1])", HELPERS)
ON_CURVE = Loop(on_curve, f"({ARM}, f8[:, ::1], f8[:, ::1])", HELPERS)
