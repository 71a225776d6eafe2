"""Newton's method and continuation for a point of a DH table with four joints, in loops for numba.

They do what :mod:`aacmm_pin.postures.continuation` does in NumPy, where the method and its source are. The constants of both
are here, because numba keeps what it compiled until this file changes. No slices: these take numba seconds to compile.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index

CLOSE_ENOUGH = 1e-12
"""Largest residual of a solution [unit of F: m, or 1 for directions]."""
POLISHED, CORRECTED = 0.02 * CLOSE_ENOUGH, 0.2 * CLOSE_ENOUGH
"""Residuals at which polishing a seed, and correcting a step, end: what is left to gain is rounding."""
MOST_POLISHES, MOST_CORRECTIONS, MOST_MEETINGS = 40, 5, 8
"""Newton steps after which polishing a seed, correcting a step, and meeting a plane (see :func:`on_curves`) give up."""
LONGEST_POLISH = 0.5
"""Of one Newton step from a seed [rad]; longer ones would leave the neighbourhood."""
DAMPING = 1e-14
"""Part of the trace of ``J Jᵀ`` that is added to its diagonal: felt only where J is nearly singular."""
SURE_STEP = 5e-7
"""After a Newton step shorter than this the residual is about the arm's length times step²/2, below 2e-13 m."""
MOST_STEPS, MOST_ROUNDS = 3000, 50
"""Steps, of all curves side by side, and curves of one problem after which a search ends with what it has. Real arms take
fewer than 800 steps and have up to 16 curves."""
SINGULAR = 1e-6
"""A solution is singular where the smallest singular value of the equations' derivative is this part of the largest."""
CLEARLY = 10.0
"""A bound so many times larger than ``SINGULAR`` leaves room for the rounding of a determinant, 1e-8 of its root."""
LONGEST_STEP = 0.40
FIRST_STEP = 0.125 * LONGEST_STEP
"""Of a predictor along the curve [rad]."""
SHORTENED = 0.4
"""A step that failed is tried again at this part of its length."""
STEP_CHANGE = (0.5, 1.8)
"""Least and largest ratio of a step's length to that of the one before, which succeeded."""
MOST_VERTICES = 2000
"""A curve with more is returned unfinished."""
SHORTEST_STEP = 1e-5
"""Nearer than this to a crossing the residual's rounding, over the distance, hides the direction of the curve; a gap that
narrow is a crossing [rad]."""
LARGEST_TURN = 0.30
"""Largest angle between the tangents at the two ends of a step [rad]."""
WANTED_TURN, LEAST_TURN = 0.6 * LARGEST_TURN, 1e-3
"""Angle that the length of the next step aims at, and one below which a piece counts as straight [rad]."""
OFF_GUESS = 0.4
"""Part of a step by which its correction may move it; farther away it may be another curve."""
PAST_START, ASIDE_START = 1.0001, 0.3
"""Parts of a step: so far along it, and so far aside of it, the start is taken for passed and solved for."""
BULGE = 0.1
"""A curve that turns by less than ``LARGEST_TURN`` between vertices leaves the chord by less than this part of it."""
PICKS = 7
"""Vertices of a curve that are looked for on the others."""
NEAREST = 3
"""Vertices of a curve from which a solution is looked for on it: the nearest may be on another strand."""
SAME_POINT = 1e-6
"""Two solutions nearer to each other than this are one [rad]."""


NEWTON = "b1[::1](f8[:, :, ::1], f8[:, ::1], f8[:, ::1], i8, f8[:, ::1], f8[:, :, ::1])"
CURVES = "i8(f8[:, :, ::1], f8[:, ::1], f8[:, ::1], i8[::1], i8, f8[:, ::1], i8[:, ::1], b1[::1])"


def newton(links: Array, goals: Array, tangents: Array, iterations: int, q: Array, jacobians: Array) -> NDArray[np.bool_]:
    """Move four angles until the point is at its goal: as ``polish``, or as ``_correct`` where there are ``tangents``.

    Args:
        links: see :meth:`DHTable.links`, (5, 4, 4).
        goals: places of the point (n, 3) [m].
        tangents: across which to move (n, 4), or (0, 4): the shortest way.
        iterations: steps at most.
        q: angles (n, 4) [rad], moved in place.
        jacobians: (n, 3, 4) [m/rad], filled.

    Returns:
        which arrived (n,).
    """
    good, shortest = np.empty(len(q), dtype=np.bool_), len(tangents) == 0
    work, here, angles, tangent = np.empty((5, 4)), links.copy(), np.empty(4), np.zeros(4)
    for n in range(len(q)):
        start_from(goals, n, links, here)
        copy(q, n, angles)
        if not shortest:
            copy(tangents, n, tangent)
        good[n] = meet(here, tangent, shortest, iterations, angles, work)
        for j in range(4):
            q[n, j] = angles[j]
            for k in range(3):
                jacobians[n, k, j] = work[k, j]
    return good


def curves(
    links: Array,
    goals: Array,
    seeds: Array,
    ends: Index,
    first: int,
    vertices: Array,
    pieces: Index,
    ordinary: NDArray[np.bool_],
) -> int:
    """Follow all curves of some problems, as ``all_curves`` does, but leave problems with anything singular.

    Args:
        links: see :meth:`DHTable.links`, (5, 4, 4).
        goals: places of the point (m, 3) [m].
        seeds: solutions (n, 4) [rad], sorted by problem.
        ends: numbers of the seeds behind the last of each problem (m,).
        first: number of the problem to begin with.
        vertices: filled with the vertices of all curves (any, 4) [rad]; where they may not suffice for a problem, this ends.
        pieces: filled with the problem, first vertex and number of vertices of each curve (any, 3); behind the last, -1.
        ordinary: filled: False where a seed is singular, a curve comes to a crossing, or a limit of work is met (m,).

    Returns:
        the number of the problem behind the last one that was looked at.
    """
    count, is_open, tangents = 0, np.ones(len(seeds), dtype=np.bool_), np.empty_like(seeds)
    here, work, q, tangent = links.copy(), np.empty((5, 4)), np.empty(4), np.empty(4)
    for problem in range(first, len(goals)):
        used = pieces[count - 1, 1] + pieces[count - 1, 2] if count > 0 else 0
        if used + MOST_STEPS + MOST_VERTICES > len(vertices) or count + MOST_ROUNDS >= len(pieces):
            pieces[count, 0] = -1
            return problem
        start_from(goals, problem, links, here)
        before, room, begin, end = count, used + MOST_STEPS, ends[problem - 1] if problem > 0 else 0, ends[problem]
        ordinary[problem] = True
        for seed in range(begin, end):
            if not is_regular(here, seeds, seed, q, tangent, work):
                ordinary[problem] = False
            for j in range(4):
                tangents[seed, j] = tangent[j]
        for seed in range(begin, end if ordinary[problem] else begin):
            if not is_open[seed]:
                continue
            length = trace(here, seeds, seed, vertices, used, work)
            if length == 0 or used + length > room or count - before == MOST_ROUNDS:
                ordinary[problem], count = False, before
                break
            for other in range(seed + 1, end):
                if is_open[other]:
                    copy(seeds, other, q)
                    copy(tangents, other, tangent)
                    is_open[other] = not on_curve(here, q, tangent, vertices, used, length, work)
            known = False
            for other in range(before, count):
                known = known or is_known(here, vertices, used, length, pieces[other], q, tangent, work)
            if not known:
                pieces[count, 0], pieces[count, 1], pieces[count, 2] = problem, used, length
                used, count = used + length, count + 1
    pieces[count, 0] = -1
    return len(goals)


def is_known(
    links: Array, vertices: Array, first: int, count: int, known: Index, q: Array, tangent: Array, work: Array
) -> bool:
    """Whether most of some vertices all round a curve are on one that is known."""
    on = 0
    for pick in range(PICKS):
        is_regular(links, vertices, first + pick * (count - 1) // (PICKS - 1), q, tangent, work)
        on += on_curve(links, q, tangent, vertices, known[1], known[2], work)
        if 2 * on >= PICKS or 2 * (on + PICKS - 1 - pick) < PICKS:
            break  # the others cannot change it
    return 2 * on >= PICKS


def start_from(goals: Array, number: int, links: Array, here: Array) -> None:
    """Put the base of ``here`` where the point is at the origin when it is at its goal."""
    for k in range(3):
        here[0, k, 3] = links[0, k, 3] - goals[number, k]


def is_regular(links: Array, solutions: Array, number: int, q: Array, tangent: Array, work: Array) -> bool:
    """Whether a solution is clearly not singular; it, and its tangent in one sense or the other, into ``q``, ``tangent``."""
    copy(solutions, number, q)
    look(links, q, work)
    for j in range(4):
        tangent[j] = math.sqrt(2.0 + j)
    null_vector(work, tangent)
    return bool(work[4, 0] > CLEARLY * SINGULAR * work[4, 1])


def trace(links: Array, seeds: Array, number: int, vertices: Array, first: int, work: Array) -> int:
    """Follow the curve through a seed once round: its vertices, from number ``first`` on; how many, 0 where it cannot."""
    q, start, tangent, curvature, began = np.empty(4), np.empty(4), np.empty(4), np.zeros(4), np.empty(4)
    guess, trial, ahead, goal = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    is_regular(links, seeds, number, q, tangent, work)
    sign, length, travelled, count = null_vector(work, tangent), FIRST_STEP, 0.0, 1
    for j in range(4):
        vertices[first, j] = start[j] = q[j]
        began[j] = tangent[j]
    for _ in range(MOST_VERTICES):
        for j in range(4):
            guess[j] = trial[j] = q[j] + length * tangent[j] + 0.5 * length**2 * curvature[j]
            ahead[j] = tangent[j]
        good = meet(links, tangent, False, MOST_CORRECTIONS, trial, work)
        good = null_vector(work, ahead) == sign and good
        cosine = ahead[0] * tangent[0] + ahead[1] * tangent[1] + ahead[2] * tangent[2] + ahead[3] * tangent[3]
        if not (good and cosine > math.cos(LARGEST_TURN) and between(trial, guess) < OFF_GUESS * length):
            length *= SHORTENED
            if length < SHORTEST_STEP:
                return 0
            continue
        distance, along, aside = between(trial, q), 0.0, 0.0
        for j in range(4):
            along += wrap(start[j] - q[j]) * (trial[j] - q[j]) / distance
        for j in range(4):
            aside += (wrap(start[j] - q[j]) - along / distance * (trial[j] - q[j])) ** 2
        near = 0.0 < along <= PAST_START * distance and math.sqrt(aside) < ASIDE_START * distance and travelled > 0.0
        if near:
            for j in range(4):
                guess[j] = q[j] + along / distance * (trial[j] - q[j])
                goal[j] = guess[j] + wrap(start[j] - guess[j])
            if meets(links, guess, goal, began, work):
                return count
        for j in range(4):
            curvature[j] = (ahead[j] - tangent[j]) / distance
            vertices[first + count, j] = q[j] = trial[j]
            tangent[j] = ahead[j]
        travelled, count = travelled + distance, count + 1
        turn = math.sqrt(max(0.0, 1.0 - cosine**2))
        length *= min(max(WANTED_TURN / max(turn, LEAST_TURN), STEP_CHANGE[0]), STEP_CHANGE[1])
        length = min(max(length, SHORTEST_STEP), LONGEST_STEP)
    return 0


def on_curve(
    links: Array,
    q: Array,
    tangent: Array,
    vertices: Array,
    first: int,
    count: int,
    work: Array,
) -> bool:
    """Is the solution ``q`` with this ``tangent`` on the curve with ``count`` vertices from number ``first`` on?"""
    guess, goal, piece, nearest = np.empty(4), np.empty(4), np.empty(4), np.full(NEAREST, first)
    least = np.full(NEAREST, np.inf)
    for vertex in range(first, first + count):
        far = 0.0
        for j in range(4):
            far += wrap(q[j] - vertices[vertex, j]) ** 2
        place = NEAREST
        while place > 0 and far < least[place - 1]:
            place -= 1
        for later in range(NEAREST - 1, place, -1):
            least[later], nearest[later] = least[later - 1], nearest[later - 1]
        if place < NEAREST:
            least[place], nearest[place] = far, vertex
    for k in range(min(NEAREST, count)):
        for side in (1, -1):
            start, other = nearest[k], first + (nearest[k] - first + side) % count
            square, part = 1e-200, 0.0
            for j in range(4):
                piece[j] = wrap(vertices[other, j] - vertices[start, j])
                goal[j] = vertices[start, j] + wrap(q[j] - vertices[start, j])
                square += piece[j] ** 2
                part += piece[j] * (goal[j] - vertices[start, j])
            part = min(max(part / square, 0.0), 1.0)
            for j in range(4):
                guess[j] = vertices[start, j] + part * piece[j]
            if between(goal, guess) >= BULGE * math.sqrt(square) + SAME_POINT:
                continue  # Newton might come from another curve
            if meets(links, guess, goal, tangent, work):
                return True
    return False


def meets(links: Array, guess: Array, goal: Array, tangent: Array, work: Array) -> bool:
    """Does the curve near ``guess``, which moves, cut the plane through ``goal`` across ``tangent`` in ``goal`` itself?"""
    off = 0.0
    for j in range(4):
        off += (guess[j] - goal[j]) * tangent[j]
    for j in range(4):
        guess[j] -= off * tangent[j]
    if not between(guess, goal) < 2 * LONGEST_STEP:
        return False
    good = meet(links, tangent, False, MOST_MEETINGS, guess, work)
    return good and between(guess, goal) < SAME_POINT


def meet(
    links: Array,
    tangent: Array,
    shortest: bool,
    iterations: int,
    q: Array,
    work: Array,
) -> bool:
    """Move ``q`` to a solution, by the shortest way or across ``tangent``; whether it arrived."""
    least, n0, n1, n2, n3 = np.inf, q[0], q[1], q[2], q[3]
    enough = POLISHED if shortest else CORRECTED
    for iteration in range(iterations + 1):
        x, y, z = look(links, q, work)
        size = max(abs(x), abs(y), abs(z))
        if size < least:
            least, n0, n1, n2, n3 = size, q[0], q[1], q[2], q[3]
        if size <= enough or iteration == iterations:
            break
        if shortest:
            across_none(work, -x, -y, -z)
        else:
            across(work, tangent, -x, -y, -z)
        length = math.sqrt(work[3, 0] ** 2 + work[3, 1] ** 2 + work[3, 2] ** 2 + work[3, 3] ** 2)
        if not length < np.inf:  # the derivative is singular
            break
        part = min(1.0, LONGEST_POLISH / max(length, 1e-300)) if shortest else 1.0
        for j in range(4):
            q[j] += part * work[3, j]
        if length < SURE_STEP and left(work, x, y, z) <= CLOSE_ENOUGH:
            return True
    if shortest:
        q[0], q[1], q[2], q[3] = n0, n1, n2, n3
    return least <= (CLOSE_ENOUGH if shortest else CORRECTED)


def look(links: Array, q: Array, work: Array) -> tuple[float, float, float]:
    """The point, and its derivatives by the joints (3, 4)."""
    x, y, z = links[4, 0, 3], links[4, 1, 3], links[4, 2, 3]
    for joint in range(3, -1, -1):
        cosine, sine = math.cos(q[joint]), math.sin(q[joint])
        x, y = cosine * x - sine * y, sine * x + cosine * y
        for k in range(joint + 1, 4):
            u, v = work[0, k], work[1, k]
            work[0, k], work[1, k] = cosine * u - sine * v, sine * u + cosine * v
        work[0, joint], work[1, joint], work[2, joint] = -y, x, 0.0
        a, b, c = links[joint, 0, 0], links[joint, 0, 1], links[joint, 0, 2]
        d, e, f = links[joint, 1, 0], links[joint, 1, 1], links[joint, 1, 2]
        g, h, i = links[joint, 2, 0], links[joint, 2, 1], links[joint, 2, 2]
        x, y, z = (
            a * x + b * y + c * z + links[joint, 0, 3],
            d * x + e * y + f * z + links[joint, 1, 3],
            g * x + h * y + i * z + links[joint, 2, 3],
        )
        for k in range(joint, 4):
            u, v, w = work[0, k], work[1, k], work[2, k]
            work[0, k], work[1, k], work[2, k] = (
                a * u + b * v + c * w,
                d * u + e * v + f * w,
                g * u + h * v + i * w,
            )
    return x, y, z


def null_vector(work: Array, along: Array) -> float:
    """The unit null vector in the sense of ``along``, in its place; the sign of the determinant with ``along`` below.

    By the minors of the derivative; row 4 of ``work`` is then their norm, which is √det(J Jᵀ), and ‖J‖³.
    """
    square, sense, norm = 0.0, 0.0, 0.0
    for j in range(4):
        a, b, c = 0 if j > 0 else 1, 1 if j > 1 else 2, 2 if j > 2 else 3
        minor = (
            work[0, a] * (work[1, b] * work[2, c] - work[1, c] * work[2, b])
            - work[0, b] * (work[1, a] * work[2, c] - work[1, c] * work[2, a])
            + work[0, c] * (work[1, a] * work[2, b] - work[1, b] * work[2, a])
        )
        minor = minor if j % 2 else -minor
        sense += minor * along[j]
        along[j] = minor
        square += minor**2
        norm += work[0, j] ** 2 + work[1, j] ** 2 + work[2, j] ** 2
    work[4, 0], work[4, 1] = math.sqrt(square), norm**1.5
    sign = 1.0 if sense > 0 else -1.0
    for j in range(4):
        along[j] *= sign / max(work[4, 0], 1e-300)
    return sign


def across_none(work: Array, x: float, y: float, z: float) -> None:
    """The least-norm step that closes the gap (x, y, z), damped where the derivative is singular, into row 3."""
    a = b = c = d = e = f = 0.0
    for j in range(4):
        u, v, w = work[0, j], work[1, j], work[2, j]
        a, b, c, d, e, f = a + u * u, b + u * v, c + u * w, d + v * v, e + v * w, f + w * w
    more = DAMPING * (a + d + f) if a + d + f > 0 else 1.0
    a, d, f = a + more, d + more, f + more
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    over = 1.0 / (a * first + b * second + c * third)
    u = over * (first * x + second * y + third * z)
    v = over * (second * x + (a * f - c * c) * y + (b * c - a * e) * z)
    w = over * (third * x + (b * c - a * e) * y + (a * d - b * b) * z)
    for j in range(4):
        work[3, j] = work[0, j] * u + work[1, j] * v + work[2, j] * w


def across(work: Array, t: Array, x: float, y: float, z: float) -> None:
    """The step across ``t`` that closes the gap (x, y, z), into row 3: Cramer's rule with the minors of two rows each."""
    a0, a1, a2, a3 = work[0, 0], work[0, 1], work[0, 2], work[0, 3]
    b0, b1, b2, b3 = work[1, 0], work[1, 1], work[1, 2], work[1, 3]
    c0, c1, c2, c3 = work[2, 0], work[2, 1], work[2, 2], work[2, 3]
    u01, u02, u03 = c0 * t[1] - t[0] * c1, c0 * t[2] - t[0] * c2, c0 * t[3] - t[0] * c3
    u12, u13, u23 = c1 * t[2] - t[1] * c2, c1 * t[3] - t[1] * c3, c2 * t[3] - t[2] * c3
    h0, h1, h2, h3 = x * b0 - y * a0, x * b1 - y * a1, x * b2 - y * a2, x * b3 - y * a3
    v01, v02, v03 = a0 * b1 - b0 * a1, a0 * b2 - b0 * a2, a0 * b3 - b0 * a3
    v12, v13, v23 = a1 * b2 - b1 * a2, a1 * b3 - b1 * a3, a2 * b3 - b2 * a3
    over = 1.0 / (v01 * u23 - v02 * u13 + v03 * u12 + v12 * u03 - v13 * u02 + v23 * u01)
    work[3, 0] = over * (h1 * u23 - h2 * u13 + h3 * u12 + z * (t[1] * v23 - t[2] * v13 + t[3] * v12))
    work[3, 1] = over * (h2 * u03 - h0 * u23 - h3 * u02 - z * (t[0] * v23 - t[2] * v03 + t[3] * v02))
    work[3, 2] = over * (h0 * u13 - h1 * u03 + h3 * u01 + z * (t[0] * v13 - t[1] * v03 + t[3] * v01))
    work[3, 3] = over * (h1 * u02 - h0 * u12 - h2 * u01 - z * (t[0] * v12 - t[1] * v02 + t[2] * v01))


def left(work: Array, x: float, y: float, z: float) -> float:
    """Largest part of the distance that a step leaves, to first order."""
    for joint in range(4):
        step = work[3, joint]
        x, y, z = x + work[0, joint] * step, y + work[1, joint] * step, z + work[2, joint] * step
    return max(abs(x), abs(y), abs(z))


def between(a: Array, b: Array) -> float:
    """Distance of two configurations."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2 + (a[3] - b[3]) ** 2)


def wrap(angle: float) -> float:
    """The same direction between -π and π."""
    return angle - 2 * math.pi * math.floor(angle * (0.5 / math.pi) + 0.5)


def copy(rows: Array, number: int, row: Array) -> None:
    """One of four-number rows."""
    for j in range(4):
        row[j] = rows[number, j]


HELPERS = (
    copy,
    start_from,
    wrap,
    between,
    left,
    across,
    across_none,
    null_vector,
    look,
    is_regular,
    meet,
    meets,
    on_curve,
    trace,
    is_known,
)
"""What the loops call, in an order in which each knows those that it calls itself."""
