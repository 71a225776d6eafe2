"""Newton's method for a point of a DH table in loops for numba; see :mod:`aacmm_pin.postures.continuation`.

Numbers one by one, no slices: these take numba seconds to compile.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array

SIGNATURE = "b1[::1](f8[:, ::1], b1, f8[:, ::1], f8[:, ::1], f8[::1], i8, f8[:, ::1], f8[:, :, ::1])"


def newton(
    rows: Array,
    standard: bool,
    goals: Array,
    tangents: Array,
    limits: Array,
    iterations: int,
    q: Array,
    jacobians: Array,
) -> NDArray[np.bool_]:
    """Move four angles until the point is at its goal: as ``polish``, or as ``_correct`` where there are ``tangents``.

    Args:
        rows: a, d, cos α, sin α, zero offset and 1 where it has a joint, of each row (rows, 6).
        standard: True for standard DH.
        goals: places of the point (n, 3) [m].
        tangents: across which to move (n, 4), or (0, 4): the shortest way.
        limits: residual that is a solution, residual that is not improved, longest step, step after which the residual is
            known, damping.
        iterations: steps at most.
        q: angles (n, 4) [rad], moved in place.
        jacobians: (n, 3, 4) [m/rad], filled.

    Returns:
        which arrived (n,).
    """
    good = np.empty(len(q), dtype=np.bool_)
    seen, matrix, gap, nearest, step = np.empty((3, 5)), np.empty((4, 4)), np.empty(4), np.empty(4), np.empty(4)
    shortest = len(tangents) == 0
    for n in range(len(q)):
        jacobian, least = jacobians[n], np.inf
        for iteration in range(iterations + 1):
            look(rows, standard, q[n], seen)
            size, gap[3] = 0.0, 0.0
            for k in range(3):
                gap[k] = goals[n, k] - seen[k, 0]
                size = max(size, abs(gap[k]))
                for joint in range(4):
                    jacobian[k, joint] = seen[k, 4 - joint]
            if size < least:
                least = size
                for joint in range(4):
                    nearest[joint] = q[n, joint]
            if size <= limits[1] or iteration == iterations:
                break
            for k in range(4):
                step[k] = gap[k]
            if shortest:
                across_none(jacobian, limits[4], matrix, step)
            else:
                for joint in range(4):
                    for k in range(3):
                        matrix[k, joint] = jacobian[k, joint]
                    matrix[3, joint] = tangents[n, joint]
                solve(matrix, step, 4)
            length = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2 + step[3] ** 2)
            if not length < np.inf:  # the derivative is singular
                break
            for joint in range(4):
                q[n, joint] += min(1.0, limits[2] / max(length, 1e-300)) * step[joint]
            if length < limits[3] and left(jacobian, step, gap) <= limits[0]:
                least = 0.0
                for joint in range(4):
                    nearest[joint] = q[n, joint]
                break
        good[n] = least <= limits[0 if shortest else 1]
        for joint in range(4 if shortest else 0):
            q[n, joint] = nearest[joint]
    return good


def look(rows: Array, standard: bool, q: Array, seen: Array) -> None:
    """The point (3,) and, behind it, its derivatives by the joints from the last to the first, as columns of ``seen``."""
    known = 1
    seen[0, 0] = seen[1, 0] = seen[2, 0] = 0.0
    for i in range(len(rows) - 1, -1, -1):
        for half in range(2):
            if (half == 0) == standard:
                for m in range(known):
                    y, z = seen[1, m], seen[2, m]
                    seen[1, m] = rows[i, 2] * y - rows[i, 3] * z
                    seen[2, m] = rows[i, 3] * y + rows[i, 2] * z
                seen[0, 0] += rows[i, 0]
                continue
            turning = rows[i, 5] > 0
            angle = rows[i, 4] + (q[4 - known] if turning else 0.0)
            cosine, sine = math.cos(angle), math.sin(angle)
            for m in range(known):
                x, y = seen[0, m], seen[1, m]
                seen[0, m] = cosine * x - sine * y
                seen[1, m] = sine * x + cosine * y
            if turning:
                seen[0, known], seen[1, known], seen[2, known] = -seen[1, 0], seen[0, 0], 0.0
                known += 1
            seen[2, 0] += rows[i, 1]


def across_none(jacobian: Array, damping: float, matrix: Array, step: Array) -> None:
    """The least-norm step, in place of the gap that it closes."""
    trace = 0.0
    for k in range(3):
        for m in range(3):
            matrix[k, m] = 0.0
            for joint in range(4):
                matrix[k, m] += jacobian[k, joint] * jacobian[m, joint]
        trace += matrix[k, k]
    for k in range(3):
        matrix[k, k] += damping * trace if trace > 0 else 1.0
    solve(matrix, step, 3)
    first, second, third = step[0], step[1], step[2]
    for joint in range(4):
        step[joint] = jacobian[0, joint] * first + jacobian[1, joint] * second + jacobian[2, joint] * third


def solve(matrix: Array, right: Array, count: int) -> None:
    """Elimination with the largest pivot of each column, in place; NaN where there is none."""
    for k in range(count):
        pivot = k
        for m in range(k + 1, count):
            if abs(matrix[m, k]) > abs(matrix[pivot, k]):
                pivot = m
        if matrix[pivot, k] == 0.0:
            right[0] = np.nan
            return
        for m in range(k, count):
            matrix[k, m], matrix[pivot, m] = matrix[pivot, m], matrix[k, m]
        right[k], right[pivot] = right[pivot], right[k]
        for m in range(k + 1, count):
            factor = matrix[m, k] / matrix[k, k]
            for other in range(k + 1, count):
                matrix[m, other] -= factor * matrix[k, other]
            right[m] -= factor * right[k]
    for k in range(count - 1, -1, -1):
        for m in range(k + 1, count):
            right[k] -= matrix[k, m] * right[m]
        right[k] /= matrix[k, k]


def left(jacobian: Array, step: Array, gap: Array) -> float:
    """Largest part of the gap that a step leaves, to first order."""
    largest = 0.0
    for k in range(3):
        value = -gap[k]
        for joint in range(4):
            value += jacobian[k, joint] * step[joint]
        largest = max(largest, abs(value))
    return largest


HELPERS = (solve, look, across_none, left)
"""What the loop calls, in an order in which each knows those that it calls itself."""
