"""Points of closed curves, evenly spaced along a path that the caller measures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.errors import AacmmError
from aacmm_pin.postures.continuation import Curve, System, polish

FINER = 8
"""Parts of each piece between vertices when a path is measured."""
STILL = 1e-9
"""A path shorter than this along a whole curve gives no measure of it [m, rad]."""


def evenly(system: System, curves: list[Curve], count: int, path: Callable[[Array], Array]) -> tuple[Array, Index]:
    """``count`` solutions on each curve, evenly spaced along what ``path`` makes of them.

    Args:
        system: the equations that the curves solve.
        curves: at least one.
        count: of each curve.
        path: from solutions in order along a curve (m, k) to places whose distances count (m, any). A curve along which
            it stands still is divided by its angles.

    Returns:
        (curves * count, k) [rad] and the number of the curve of each, from 0.
    """
    guesses = []
    for vertices in _finer(system, curves):
        length = np.linalg.norm(np.diff(path(vertices), axis=0), axis=1)
        if length.sum() < STILL:
            length = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(length)])
        wanted = np.arange(count) * (along[-1] / count)
        guesses.append(np.column_stack([np.interp(wanted, along, column) for column in vertices.T]))
    number = np.repeat(np.arange(len(guesses)), count)
    problem = np.array([c.problem for c in curves])[number]
    return to_solution(system, np.concatenate(guesses), problem), number


def _finer(system: System, curves: list[Curve]) -> list[Array]:
    """Each curve with solutions between its vertices, its first repeated at the end where it is closed."""
    ends = [np.vstack([c.q, c.q[:1] + _turns(c)]) if c.closed else c.q for c in curves]
    rows = [np.arange((len(q) - 1) * FINER + 1) / FINER for q in ends]
    finer = [np.column_stack([np.interp(r, np.arange(len(q)), x) for x in q.T]) for r, q in zip(rows, ends, strict=True)]
    problem = np.repeat([c.problem for c in curves], [len(q) for q in finer])
    solutions = to_solution(system, np.concatenate(finer), problem)
    return np.split(solutions, np.cumsum([len(q) for q in finer])[:-1])


def _turns(curve: Curve) -> Array:
    """Full turns that each joint has made when the curve is back at its start."""
    return np.asarray(np.round((curve.q[-1] - curve.q[0]) / (2 * np.pi)) * 2 * np.pi)


def to_solution(system: System, guess: Array, problem: Index) -> Array:
    """Points between vertices, moved onto the curve.

    Raises:
        AacmmError: some of them do not arrive.
    """
    q, good = polish(system, guess, problem)
    if not good.all():
        raise AacmmError(f"{(~good).sum()} of {len(good)} configurations between those of a curve could not be found")
    return q
