"""Closed curves of solutions of k equations in k + 1 angles, by predictor and corrector, in numba.

Source: E. Allgower, K. Georg, "Introduction to Numerical Continuation Methods", SIAM 2003. The sign
of ``det [J; tᵀ]`` is constant along a smooth curve. A step that changes it has jumped to another
branch, and is repeated shorter. Where no step is short enough, curves cross, and the trace leaps
straight over.

The equations make the frame of the tip that of the base: origin, z axis, or all axes. The first
link contains the wanted pose; see :class:`~.pose_equations.Equations`.

All compiled functions are here: numba caches them until this file changes. They work on rows of one
array, :func:`working_space`: further arrays, slices and levels of calls compile slower.
"""

from __future__ import annotations

import math

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.compiled import INLINED, Loop

POINT, POINT_AND_AXIS = 3, 5
"""Numbers of equations; a whole pose has 6."""
TIP = 0
AXES = 3
EQUATIONS = 9
GOAL = 15
"""First rows of the working space for the tip's frame (3 rows), directions and origins of the joint
axes (6, a column each), the equations (up to 6; values in the last column but one), and the wanted
place of the tip.
"""
HERE = 16
STEADY = 19
AHEAD = 22
START = 24
SOUGHT = 26
IMAGE = 28
GUESS = 29
BEST = 30
"""Rows for angles, each before the row of the tangent there; ``HERE`` and ``STEADY`` also have the
curvature behind it. ``IMAGE``, ``GUESS`` and ``BEST`` use neither.
"""
COSINES, MATRIX = 31, 33
"""Rows for cosines and sines, and the first one for linear equations: n columns and two right
sides.
"""
STRAIGHT = 1e-12
"""Sine below which a direction has arrived, or points right away from its goal."""
SERIES = 1e-3
"""Angle below which a series loses fewer digits than the closed form [rad]."""
CLOSE_ENOUGH = 1e-12
"""Largest residual of a solution [m, rad]."""
POLISHED = 0.02 * CLOSE_ENOUGH
CORRECTED_RESIDUAL = 0.2 * CLOSE_ENOUGH
"""Residual at which polishing and correcting end: the rest is rounding."""
MOST_POLISHES = 39
MOST_CORRECTIONS = 5
MOST_MEETINGS = 8
"""Newton steps after which polishing, correcting, and meeting a plane give up."""
LONGEST_POLISH = 0.5
"""Newton step from a seed [rad]; longer ones would leave the neighbourhood."""
DAMPING = 1e-14
"""Part of the trace of ``J Jᵀ`` added to its diagonal: felt only where J is nearly singular."""
SURE_STEP = 5e-7
"""After a shorter Newton step the residual is about arm length times step²/2, < 2e-13 m."""
LONGEST_CURVE_STEP = 0.40
FIRST_STEP = 0.125 * LONGEST_CURVE_STEP
"""Of a predictor along the curve [rad]."""
SHORTENED = 0.4
"""Part of a failed step that is tried next."""
LEAST_CHANGE, MOST_CHANGE = 0.5, 1.8
"""Of a step over the one before, which succeeded."""
SHORTEST_STEP = 1e-5
"""Closer to a crossing, rounding hides the direction of the curve; a narrower gap is a crossing
[rad].
"""
LARGEST_TURN = 0.30
"""Between the tangents at the ends of a step [rad]."""
WANTED_TURN = 0.6 * LARGEST_TURN
LEAST_TURN = 1e-3
"""The next step aims at this angle; a piece with less is straight [rad]."""
OFF_GUESS = 0.4
"""Part of a step by which its correction may move it; farther solutions may be on another curve."""
PAST_START, ASIDE_START = 1.0001, 0.3
"""Parts of a step along and aside of it within which the start is passed."""
BULGE = 0.1
"""Part of the chord by which a curve that turns by less than ``LARGEST_TURN`` leaves it."""
STEADY_STEP = 0.01
"""A vertex after such a step has a sure tangent and curvature, even near a crossing [rad]."""
LEAPS = (0.03, 0.1, 0.01)
"""Distances beyond a crossing to look for the curve again [rad]."""
MOST_LEAPS = 100
MOST_VERTICES = 2000
"""A curve with more is unfinished."""
PICKS, MAJORITY = 7, 4
"""Vertices of a curve that are looked for on others, and most of them."""
SAME_POINT = 1e-6
"""Nearer solutions are one [rad]."""

NO_CURVE = -1
KNOWN_CURVE = -2
"""In place of the number of a curve: on none, or on a known one that does not show it next to a
crossing.
"""


# --- what is called from Python


def newton(
    links: Array,
    goals: Array,
    most: int,
    q: Array,
    equations: Array,
    arrived: Mask,
    space: Array,
) -> None:
    """Move each row of ``q`` to the nearest solution by damped Newton steps.

    Args:
        links: see :meth:`DHTable.links`, (n + 1, 4, 4); the first contains the wanted pose.
        goals: of the tip for each row of ``q``, (m, 3) [m].
        most: steps; 0 only evaluates the equations.
        q: angles (m, n) [rad].
        equations: output (m, k, n + 1): derivatives by the angles, then values, at the last angles
            tried.
        arrived: output (m,): residual is at most ``CLOSE_ENOUGH``.
        space: see :func:`working_space`.
    """
    count = equations.shape[1]
    n = q.shape[1]
    for row in range(len(q)):
        for i in range(3):
            space[GOAL, i] = goals[row, i]
        for j in range(n):
            space[HERE, j] = q[row, j]
        arrived[row] = polish(links, count, most, space) <= CLOSE_ENOUGH
        for j in range(n):
            q[row, j] = space[BEST, j]
        for i in range(count):
            for j in range(n + 1):
                equations[row, i, j] = space[EQUATIONS + i, j]


def curves(
    links: Array,
    goal: Array,
    seeds: Array,
    is_regular: Mask,
    steps: int,
    count: int,
    vertices: Array,
    ends: Index,
    closed: Mask,
    number: Index,
    space: Array,
) -> tuple[int, int]:
    """Follow every curve through the ``seeds``, which are solutions, once.

    Args:
        links, space: see :func:`newton`.
        goal: place of the tip (3,) [m].
        seeds: angles (m, n) [rad].
        is_regular: seeds that may begin a curve (m,); others are only looked up.
        steps: after which the search ends.
        count: of known curves.
        vertices: of all curves in order (any, n) [rad]; extended.
        ends: number after the last vertex of each curve (most curves,); extended.
        closed: whether each returned to its start (most curves,); extended.
        number: output (m,): the curve of each seed, ``NO_CURVE`` or ``KNOWN_CURVE``.

    Returns:
        number of curves, and remaining steps.
    """
    n = seeds.shape[1]
    traces = 0
    for i in range(3):
        space[GOAL, i] = goal[i]
    for seed in range(len(seeds)):
        number[seed] = NO_CURVE
    for curve in range(count):
        number_seeds_on(links, seeds, 0, curve, curve, vertices, ends, number, space)
    for seed in range(len(seeds)):
        if number[seed] != NO_CURVE or not is_regular[seed]:
            continue
        if steps <= 0 or traces == len(ends) or count == len(ends):
            break
        for j in range(n):
            space[START, j] = seeds[seed, j]
        begin = ends[count - 1] if count > 0 else 0
        most = min(steps, MOST_VERTICES)
        ends[count], taken, closed[count] = trace(links, begin, most, vertices, space)
        steps -= taken
        traces += 1
        number[seed] = count
        if repeats_earlier_curve(links, count, vertices, ends, space):
            number[seed] = KNOWN_CURVE
        number_seeds_on(links, seeds, seed + 1, count, number[seed], vertices, ends, number, space)
        if number[seed] != KNOWN_CURVE:
            count += 1
    return count, steps


# --- which curve a solution is on


def number_seeds_on(
    links: Array,
    seeds: Array,
    first: int,
    curve: int,
    label: int,
    vertices: Array,
    ends: Index,
    number: Index,
    space: Array,
) -> None:
    """Give seeds on a curve, from ``first`` on, the number ``label`` if they have none."""
    for seed in range(first, len(seeds)):
        if number[seed] == NO_CURVE and on_curve(links, seeds, seed, curve, vertices, ends, space):
            number[seed] = label


def repeats_earlier_curve(
    links: Array, curve: int, vertices: Array, ends: Index, space: Array
) -> bool:
    """Whether most of some vertices of a curve are on an earlier one; its seed, close to a
    crossing, may not show it.
    """
    begin = ends[curve - 1] if curve > 0 else 0
    last = ends[curve] - 1
    for other in range(curve):
        on, off = 0, 0
        for pick in range(PICKS):
            if on < MAJORITY and off <= PICKS - MAJORITY:
                vertex = begin + pick * (last - begin) // (PICKS - 1)
                if on_curve(links, vertices, vertex, other, vertices, ends, space):
                    on += 1
                else:
                    off += 1
        if on == MAJORITY:
            return True
    return False


def on_curve(
    links: Array,
    solutions: Array,
    row: int,
    curve: int,
    vertices: Array,
    ends: Index,
    space: Array,
) -> bool:
    """Whether a solution, one ``row`` of several, is on a curve.

    The curve from the nearest vertices (the nearest may be on another strand) must meet the plane
    through the solution across its tangent there.
    """
    for j in range(solutions.shape[1]):
        space[SOUGHT, j] = solutions[row, j]
    has_tangent = False
    begin = ends[curve - 1] if curve > 0 else 0
    end = ends[curve]
    for vertex in nearest_vertices(begin, end, vertices, space):
        for side in (1, -1):
            neighbour = begin + (vertex - begin + side) % (end - begin)
            if is_at_chord(vertex, neighbour, vertices, space):
                if not has_tangent:
                    tangent_at(links, SOUGHT, space)
                    has_tangent = True
                if curve_meets_plane(links, SOUGHT + 1, space):
                    return True
    return False


def nearest_vertices(begin: int, end: int, vertices: Array, space: Array) -> tuple[int, int, int]:
    """The three vertices nearest to ``SOUGHT``, in order."""
    first = begin
    second = begin
    third = begin
    near = np.inf
    far = np.inf
    farther = np.inf
    for vertex in range(begin, end):
        square = 0.0
        for j in range(vertices.shape[1]):
            square += wrap(space[SOUGHT, j] - vertices[vertex, j]) ** 2
        if square < near:
            first, second, third = vertex, first, second
            near, far, farther = square, near, far
        elif square < far:
            second, third = vertex, second
            far, farther = square, far
        elif square < farther:
            third = vertex
            farther = square
    return first, second, third


def is_at_chord(begin: int, end: int, vertices: Array, space: Array) -> bool:
    """Whether ``SOUGHT`` is as close to the chord between two vertices as their curve is.

    Puts the nearest point of the chord into ``GUESS``, and ``SOUGHT``, in the revolutions of the
    chord, into ``IMAGE``.
    """
    squared_chord = 1e-200
    product = 0.0
    n = vertices.shape[1]
    for j in range(n):
        chord = wrap(vertices[end, j] - vertices[begin, j])
        offset = wrap(space[SOUGHT, j] - vertices[begin, j])
        space[IMAGE, j], space[GUESS, j] = vertices[begin, j] + offset, chord
        squared_chord += chord**2
        product += chord * offset
    fraction = min(max(product / squared_chord, 0.0), 1.0)
    for j in range(n):
        space[GUESS, j] = vertices[begin, j] + fraction * space[GUESS, j]
    return distance(IMAGE, GUESS, space) < BULGE * math.sqrt(squared_chord) + SAME_POINT


def curve_meets_plane(links: Array, tangent: int, space: Array) -> bool:
    """Whether the curve near ``GUESS`` passes ``IMAGE``. Moves ``GUESS`` to where the curve cuts
    the plane through ``IMAGE`` across the ``tangent`` (a row).
    """
    n = space.shape[1] - 2
    beyond = 0.0
    for j in range(n):
        beyond += (space[GUESS, j] - space[IMAGE, j]) * space[tangent, j]
    for j in range(n):
        space[GUESS, j] -= beyond * space[tangent, j]
    if not distance(GUESS, IMAGE, space) < 2 * LONGEST_CURVE_STEP:
        return False
    arrived, _ = correct(links, GUESS, tangent, MOST_MEETINGS, space)
    return arrived and distance(GUESS, IMAGE, space) < SAME_POINT


# --- along a curve


def trace(
    links: Array, begin: int, most: int, vertices: Array, space: Array
) -> tuple[int, int, bool]:
    """Follow the curve through ``START``, a regular solution, once around.

    Args:
        links, space: see :func:`newton`.
        begin: number of its first vertex.
        most: steps.
        vertices: output, up to ``most + 1`` rows of n angles [rad].

    Returns:
        number after its last vertex, steps, and whether it returned to its start.
    """
    n = vertices.shape[1]
    sign = tangent_at(links, START, space)
    for j in range(n):
        vertices[begin, j] = space[HERE, j] = space[STEADY, j] = space[START, j]
        space[HERE + 1, j] = space[STEADY + 1, j] = space[START + 1, j]
        space[HERE + 2, j] = space[STEADY + 2, j] = 0.0
    length = FIRST_STEP
    end = begin + 1
    crossings = 0
    leap = 0  # number of the leap over a crossing that is tried; 0 for a step along the curve
    for step in range(most):
        vertex = HERE
        predicted = length
        most_correction = OFF_GUESS * length
        if leap > 0:
            vertex = STEADY
            predicted = 2.0 * distance(HERE, STEADY, space) + LEAPS[leap - 1]
            most_correction = BULGE * predicted
        sign_ahead = follow(links, vertex, predicted, most_correction, space)
        if leap == 0 and sign_ahead != sign:
            length *= SHORTENED
            if length < SHORTEST_STEP:
                leap = 1
                crossings = crossings + 1
            if crossings > MOST_LEAPS:
                return end, step + 1, False
            continue
        if sign_ahead == 0.0:
            leap += 1
            if leap > len(LEAPS):
                return end, step + 1, False
            continue
        moved = distance(AHEAD, HERE, space)
        if end > begin + 1 and passes_start(links, moved, space):
            return end, step + 1, True
        sign = sign_ahead
        turn = LARGEST_TURN  # of the tangent
        if leap == 0:
            turn = math.sqrt(max(0.0, 1.0 - dot(AHEAD + 1, HERE + 1, space) ** 2))
        for j in range(n):
            change = (space[AHEAD + 1, j] - space[HERE + 1, j]) / moved
            vertices[end, j] = space[HERE, j] = space[AHEAD, j]
            space[HERE + 1, j] = space[AHEAD + 1, j]
            space[HERE + 2, j] = space[STEADY + 2, j] if leap > 0 else change
            if moved >= STEADY_STEP:
                space[STEADY, j], space[STEADY + 1, j] = space[AHEAD, j], space[AHEAD + 1, j]
                space[STEADY + 2, j] = change
        length *= min(max(WANTED_TURN / max(turn, LEAST_TURN), LEAST_CHANGE), MOST_CHANGE)
        length = min(max(length, SHORTEST_STEP), LONGEST_CURVE_STEP)
        if leap > 0:
            length = STEADY_STEP
        end = end + 1
        leap = 0
    return end, most, False


def follow(links: Array, vertex: int, length: float, most_correction: float, space: Array) -> float:
    """Predict a step from the row of a ``vertex`` (tangent and curvature follow), and correct it
    into ``AHEAD`` by less than ``most_correction``.

    Returns:
        sign of the determinant there; 0 if the step fails.
    """
    n = space.shape[1] - 2
    tangent = vertex + 1
    curvature = vertex + 2
    for j in range(n):
        step = length * space[tangent, j] + 0.5 * length**2 * space[curvature, j]
        space[AHEAD, j] = space[GUESS, j] = space[vertex, j] + step
    arrived, sign = correct(links, AHEAD, tangent, MOST_CORRECTIONS, space)
    take_tangent(AHEAD, space)
    near = distance(AHEAD, GUESS, space) < most_correction
    if arrived and near and dot(AHEAD + 1, tangent, space) > math.cos(LARGEST_TURN):
        return sign
    return 0.0


def passes_start(links: Array, moved: float, space: Array) -> bool:
    """Whether the step from ``HERE`` to ``AHEAD``, of length ``moved``, passes ``START``.

    ``IMAGE`` becomes ``START``, ``GUESS`` the nearest point of the step.
    """
    n = space.shape[1] - 2
    along = 0.0
    squared_aside = 0.0
    for j in range(n):
        space[IMAGE, j] = wrap(space[START, j] - space[HERE, j])
        space[GUESS, j] = (space[AHEAD, j] - space[HERE, j]) / moved
        along += space[IMAGE, j] * space[GUESS, j]
    for j in range(n):
        squared_aside += (space[IMAGE, j] - along * space[GUESS, j]) ** 2
        space[IMAGE, j] += space[HERE, j]
        space[GUESS, j] = space[HERE, j] + along * space[GUESS, j]
    aside = math.sqrt(squared_aside)
    if not 0.0 < along <= PAST_START * moved or aside >= ASIDE_START * moved:
        return False
    return curve_meets_plane(links, START + 1, space)


# --- Newton's method


def correct(links: Array, row: int, tangent: int, most: int, space: Array) -> tuple[bool, float]:
    """Move a ``row`` across the ``tangent`` (another row) to a solution in at most ``most`` steps;
    leave the null vector of J in the last column of the matrix.

    Returns:
        whether it arrived, and the sign of det [J; tᵀ].
    """
    n = space.shape[1] - 2
    sign = 0.0
    for step in range(most + 1):
        residual = linearise(links, row, n - 1, space)
        for i in range(n - 1):
            for j in range(n):
                space[MATRIX + i, j] = space[EQUATIONS + i, j]
            space[MATRIX + i, n], space[MATRIX + i, n + 1] = -space[EQUATIONS + i, n], 0.0
        for j in range(n):
            space[MATRIX + n - 1, j] = space[tangent, j]
        space[MATRIX + n - 1, n], space[MATRIX + n - 1, n + 1] = 0.0, 1.0
        sign = solve(space)
        if residual <= CORRECTED_RESIDUAL:
            return True, sign
        length = step_length(space)
        if step == most or not length < np.inf:  # the derivative is singular
            break
        for j in range(n):
            space[row, j] += space[MATRIX + j, n]
        if length < SURE_STEP and residual_after(n - 1, space) <= CLOSE_ENOUGH:
            return True, sign
    return False, sign


def tangent_at(links: Array, row: int, space: Array) -> float:
    """Put the tangent at the solution in a ``row`` into the next row; return the sign of the
    determinant. Any border not orthogonal to the tangent works.
    """
    for j in range(space.shape[1] - 2):
        space[row + 1, j] = math.sqrt(2.0 + j)
    _, sign = correct(links, row, row + 1, 0, space)
    take_tangent(row, space)
    return sign


def take_tangent(row: int, space: Array) -> None:
    """Put the unit null vector of J, which :func:`correct` left, into the row after ``row``."""
    n = space.shape[1] - 2
    square = 0.0
    for j in range(n):
        square += space[MATRIX + j, n + 1] ** 2
    for j in range(n):
        space[row + 1, j] = space[MATRIX + j, n + 1] / math.sqrt(square)


def polish(links: Array, count: int, most: int, space: Array) -> float:
    """Move ``HERE`` to the nearest solution of ``count`` equations by damped least-norm steps, the
    best angles into ``BEST``; return their residual.
    """
    n = space.shape[1] - 2
    least = np.inf
    for step in range(most + 1):
        residual = linearise(links, HERE, count, space)
        if residual < least or step == 0:
            least = residual
            for j in range(n):
                space[BEST, j] = space[HERE, j]
        if residual <= POLISHED or step == most:
            break
        least_norm_step(count, space)
        length = step_length(space)
        if not length < np.inf:
            break
        part = min(1.0, LONGEST_POLISH / max(length, 1e-300))
        for j in range(n):
            space[HERE, j] += part * space[MATRIX + j, n]
        if length < SURE_STEP and residual_after(count, space) <= CLOSE_ENOUGH:
            for j in range(n):
                space[BEST, j] = space[HERE, j]
            return 0.0
    return least


def least_norm_step(count: int, space: Array) -> None:
    """Shortest step that solves the linear equations, damped near singular J, into column n of the
    matrix; by Cholesky's factor of ``J Jᵀ``.
    """
    n = space.shape[1] - 2
    damping = 0.0
    for i in range(count):
        for j in range(n):
            damping += DAMPING * space[EQUATIONS + i, j] ** 2
    for i in range(count):
        right = -space[EQUATIONS + i, n]
        for k in range(i + 1):
            product = 0.0
            for j in range(n):
                product += space[EQUATIONS + i, j] * space[EQUATIONS + k, j]
            for j in range(k):
                product -= space[MATRIX + i, j] * space[MATRIX + k, j]
            if k < i:
                space[MATRIX + i, k] = product / space[MATRIX + k, k]
                right -= space[MATRIX + i, k] * space[MATRIX + k, n + 1]
            else:
                space[MATRIX + i, i] = math.sqrt(product + damping) if damping > 0.0 else 1.0
        space[MATRIX + i, n + 1] = right / space[MATRIX + i, i]
    for j in range(n):
        space[MATRIX + j, n] = 0.0
    for i in range(count - 1, -1, -1):
        factor = space[MATRIX + i, n + 1] / space[MATRIX + i, i]
        for k in range(i):
            space[MATRIX + k, n + 1] -= factor * space[MATRIX + i, k]
        for j in range(n):
            space[MATRIX + j, n] += factor * space[EQUATIONS + i, j]


def residual_after(count: int, space: Array) -> float:
    """Largest residual after the step, to first order."""
    n = space.shape[1] - 2
    largest = 0.0
    for i in range(count):
        residual = space[EQUATIONS + i, n]
        for j in range(n):
            residual += space[EQUATIONS + i, j] * space[MATRIX + j, n]
        largest = max(largest, abs(residual))
    return largest


def step_length(space: Array) -> float:
    """Of the step in column n of the matrix [rad]."""
    n = space.shape[1] - 2
    square = 0.0
    for j in range(n):
        square += space[MATRIX + j, n] ** 2
    return math.sqrt(square)


def solve(space: Array) -> float:
    """Gauss's elimination: solutions replace the right sides, the last two columns.

    Returns:
        sign of the determinant. The solution of a singular matrix is not finite.
    """
    sign = 1.0
    width = space.shape[1]
    size = width - 2
    for k in range(size):
        row = MATRIX + k
        pivot = row
        for i in range(row + 1, MATRIX + size):
            if abs(space[i, k]) > abs(space[pivot, k]):
                pivot = i
        if pivot != row:
            sign = -sign
        inverse_pivot = 1.0 / space[pivot, k]
        sign = math.copysign(sign, sign * inverse_pivot)
        space[pivot, k] = space[row, k]
        for j in range(k + 1, width):
            scaled = inverse_pivot * space[pivot, j]
            space[pivot, j] = space[row, j]
            space[row, j] = scaled
        for i in range(MATRIX, MATRIX + size):
            factor = space[i, k]
            if i != row:
                for j in range(k + 1, width):
                    space[i, j] -= factor * space[row, j]
    return sign


# --- the equations


def linearise(links: Array, row: int, count: int, space: Array) -> float:
    """Put the tip's frame, joint axes and ``count`` equations at the angles of a ``row`` into the
    space; return the largest value.
    """
    n = space.shape[1] - 2
    largest = 0.0
    for j in range(n):
        space[COSINES, j], space[COSINES + 1, j] = math.cos(space[row, j]), math.sin(space[row, j])
    for i in range(3):  # the components of a frame's axes x, y, z and origin o along base axis i
        x = links[0, i, 0]
        y = links[0, i, 1]
        z = links[0, i, 2]
        o = links[0, i, 3]
        o -= space[GOAL, i]
        for j in range(n):
            space[AXES + i, j], space[AXES + 3 + i, j] = z, o
            cosine = space[COSINES, j]
            sine = space[COSINES + 1, j]
            k = j + 1
            x, y = cosine * x + sine * y, cosine * y - sine * x
            o += x * links[k, 0, 3] + y * links[k, 1, 3] + z * links[k, 2, 3]
            x, y, z = (
                x * links[k, 0, 0] + y * links[k, 1, 0] + z * links[k, 2, 0],
                x * links[k, 0, 1] + y * links[k, 1, 1] + z * links[k, 2, 1],
                x * links[k, 0, 2] + y * links[k, 1, 2] + z * links[k, 2, 2],
            )
        space[TIP + i, 0], space[TIP + i, 1], space[TIP + i, 2] = x, y, z
        space[TIP + i, 3] = space[EQUATIONS + i, n] = o
    for j in range(n):
        for i in range(3):
            k = (i + 1) % 3
            m = (i + 2) % 3
            lever_k = space[TIP + k, 3] - space[AXES + 3 + k, j]
            lever_m = space[TIP + m, 3] - space[AXES + 3 + m, j]
            translation = space[AXES + k, j] * lever_m - space[AXES + m, j] * lever_k
            space[EQUATIONS + i, j] = translation
    if count == POINT_AND_AXIS:
        axis_equations(space)
    elif count > POINT_AND_AXIS:
        rotation_equations(space)
    for i in range(count):
        largest = max(largest, abs(space[EQUATIONS + i, n]))
    return largest


def axis_equations(space: Array) -> None:
    """Deviation of the tip's z axis d from that of the base, ``f = (d_x, d_y) θ/sin θ``, and its
    derivative by the joints: joint axis z moves d by ``z × d`` = (u, v, w).

    Unlike the sine, θ has no zero at π: spread starts arrive four times as often.
    """
    n = space.shape[1] - 2
    d0 = space[TIP, 2]
    d1 = space[TIP + 1, 2]
    d2 = space[TIP + 2, 2]
    across = math.sqrt(d0**2 + d1**2)
    stretch = 1.0
    stretch_by_aside = 0.0
    stretch_by_d2 = 0.0
    if across >= STRAIGHT:
        stretch = math.atan2(across, d2) / across
        stretch_by_aside = (d2 - stretch) / across**2
        stretch_by_d2 = -1.0
    for j in range(n):
        z0 = space[AXES, j]
        z1 = space[AXES + 1, j]
        z2 = space[AXES + 2, j]
        u = z1 * d2 - z2 * d1
        v = z2 * d0 - z0 * d2
        w = z0 * d1 - z1 * d0
        stretch_change = stretch_by_aside * (d0 * u + d1 * v) + stretch_by_d2 * w
        space[EQUATIONS + 3, j] = stretch * u + d0 * stretch_change
        space[EQUATIONS + 4, j] = stretch * v + d1 * stretch_change
    space[EQUATIONS + 3, n], space[EQUATIONS + 4, n] = stretch * d0, stretch * d1
    if across < STRAIGHT and d2 < 0.0:
        space[EQUATIONS + 3, n] = math.pi  # any direction is as wrong as another


def rotation_equations(space: Array) -> None:
    """Rotation of the tip's frame as axis times angle φ, and its derivative by the joints.

    ``φ = log R``; for a rotation ω before R ``∂φ/∂ω = 1 - ½ [φ] + c [φ]²``, c = 1/φ² - (1 + cos
    φ)/(2 φ sin φ) (Murray, Li, Sastry 1994, 2.3: inverse of the left Jacobian).
    """
    n = space.shape[1] - 2
    s0 = space[TIP + 2, 1] - space[TIP + 1, 2]
    s1 = space[TIP, 2] - space[TIP + 2, 0]
    s2 = space[TIP + 1, 0] - space[TIP, 1]
    sine = 0.5 * math.sqrt(s0**2 + s1**2 + s2**2)
    cosine = 0.5 * (space[TIP, 0] + space[TIP + 1, 1] + space[TIP + 2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    stretch = 0.5
    if sine >= STRAIGHT:
        stretch = 0.5 * angle / sine
    p0 = stretch * s0
    p1 = stretch * s1
    p2 = stretch * s2
    if sine < STRAIGHT and cosine < 0.0:
        p0 = math.pi  # any axis is as wrong as another
    c = 1.0 / 12.0 + angle**2 / 720.0
    if angle >= SERIES:
        c = 1.0 / angle**2 - (1.0 + cosine) / (2.0 * angle * max(sine, STRAIGHT))
    for j in range(n):
        z0 = space[AXES, j]
        z1 = space[AXES + 1, j]
        z2 = space[AXES + 2, j]
        u = p1 * z2 - p2 * z1
        v = p2 * z0 - p0 * z2
        w = p0 * z1 - p1 * z0
        space[EQUATIONS + 3, j] = z0 - 0.5 * u + c * (p1 * w - p2 * v)
        space[EQUATIONS + 4, j] = z1 - 0.5 * v + c * (p2 * u - p0 * w)
        space[EQUATIONS + 5, j] = z2 - 0.5 * w + c * (p0 * v - p1 * u)
    space[EQUATIONS + 3, n], space[EQUATIONS + 4, n], space[EQUATIONS + 5, n] = p0, p1, p2


# --- small things


def working_space(n: int) -> Array:
    """Array for ``n`` angles, with the rows above and two more columns for equations."""
    return np.empty((MATRIX + n, n + 2))


def distance(a: int, b: int, space: Array) -> float:
    """Between the angles in two rows [rad]."""
    square = 0.0
    for j in range(space.shape[1] - 2):
        square += (space[a, j] - space[b, j]) ** 2
    return math.sqrt(square)


def dot(a: int, b: int, space: Array) -> float:
    """Scalar product of two rows of n numbers."""
    total = 0.0
    for j in range(space.shape[1] - 2):
        total += space[a, j] * space[b, j]
    return total


def wrap(angle: float) -> float:
    """The angle in -π to π."""
    revolutions = math.floor(angle * (0.5 / math.pi) + 0.5)
    return angle - 2 * math.pi * revolutions


LINKS = "f8[:, :, ::1]"
ROWS = "f8[:, ::1]"
FLAGS = "b1[::1]"
INTEGERS = "i8[::1]"
HELPERS = (
    (wrap, "f8(f8)"),
    (dot, f"f8(i8, i8, {ROWS})"),
    (distance, f"f8(i8, i8, {ROWS})"),
    (rotation_equations, f"void({ROWS})"),
    (axis_equations, f"void({ROWS})"),
    (linearise, f"f8({LINKS}, i8, i8, {ROWS})"),
    (solve, f"f8({ROWS})"),
    (step_length, f"f8({ROWS})"),
    (residual_after, f"f8(i8, {ROWS})"),
    (take_tangent, f"void(i8, {ROWS})"),
    (least_norm_step, INLINED),
    (polish, INLINED),
    (correct, f"Tuple((b1, f8))({LINKS}, i8, i8, i8, {ROWS})"),
    (tangent_at, f"f8({LINKS}, i8, {ROWS})"),
    (curve_meets_plane, f"b1({LINKS}, i8, {ROWS})"),
    (is_at_chord, f"b1(i8, i8, {ROWS}, {ROWS})"),
    (nearest_vertices, f"UniTuple(i8, 3)(i8, i8, {ROWS}, {ROWS})"),
    (on_curve, f"b1({LINKS}, {ROWS}, i8, i8, {ROWS}, {INTEGERS}, {ROWS})"),
    (passes_start, INLINED),
    (follow, INLINED),
    (trace, INLINED),
    (repeats_earlier_curve, INLINED),
    (number_seeds_on, INLINED),
)
"""Functions the loops call, with numba's signatures, each after those that it calls itself."""
NEWTON = Loop(newton, f"void({LINKS}, {ROWS}, i8, {ROWS}, {LINKS}, {FLAGS}, {ROWS})", HELPERS)
CURVES = Loop(
    curves,
    f"UniTuple(i8, 2)({LINKS}, f8[::1], {ROWS}, {FLAGS}, i8, i8, {ROWS}, {INTEGERS}, {FLAGS}, "
    f"{INTEGERS}, {ROWS})",
    HELPERS,
)
