"""Signs and quarter turns of several joint angles at once, and orders of columns, with which tips
meet their targets.

These are too many for a fit of each, so that a few records judge all.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG
from aacmm_pin.calibration.problem import Problem

QUARTERS = (0, 90, -90, 180)
"""Possible offsets of an angle [°]."""
MOST_TURNED = 4
"""So many joints at most are turned; any number is reversed."""
MANY_JOINTS = 7
KNOWN_RECORDS = 16
"""So many records with references judge …"""
SEATS, PER_SEAT = 5, 4
"""… or so many seats, with so many records each."""
SIMILAR_RATIO = 1.5
"""Largest ratio of misfits that are alike."""
NEAREST = 40
"""Number of combinations returned."""
FEW_ORDERS = 5
LEAST_DIVISOR = 1e-9
"""Least divisor [m]."""


def likely_columns(problem: Problem) -> list[tuple[Index, Index]]:
    """Signs (nq,), then shifts (nq,) [°], that undo wrong columns of two joints or more: the best,
    of those alike the simplest first; none for many joints.
    """
    arm = problem.model.arm
    if arm.nq > MANY_JOINTS:
        return []
    # The change of a joint is twice the number of its quarter turn, plus one if it is reversed.
    changes = np.indices((2 * len(QUARTERS),) * arm.nq, dtype=np.int8).reshape(arm.nq, -1).T
    changed_joints = np.count_nonzero(changes, axis=1)
    is_turned = changes > 1
    is_likely = (changed_joints <= MOST_TURNED) | ~is_turned.any(axis=1)
    tried = (changed_joints > 1) & is_likely & ~is_turned[:, arm.chain.prismatic].any(axis=1)
    changes, changed_joints = changes[tried], changed_joints[tried]
    signs = 1 - 2 * (changes % 2)
    degrees = np.array(QUARTERS)[changes // 2]
    misfit = _misfits(problem, lambda readings: signs[:, None] * readings + DEG * degrees[:, None])
    alike = misfit <= SIMILAR_RATIO * misfit.min()
    simplicity = np.where(alike, changed_joints, arm.nq + 1)
    simplest = np.lexsort((misfit, simplicity))[:NEAREST]
    return [*zip(signs[simplest], degrees[simplest], strict=True)]


def likely_orders(problem: Problem) -> list[tuple[int, ...]]:
    """Orders unlike that of the file: the joint (from 0) of each column, best first; none for many
    joints.
    """
    nq = problem.model.arm.nq
    if nq > MANY_JOINTS:
        return []
    orders = [*permutations(range(nq))][1:]
    misfit = _misfits(problem, lambda readings: readings[:, np.argsort(orders)].transpose(1, 0, 2))
    nearest = np.argsort(misfit, kind="stable")[:FEW_ORDERS]
    return [orders[number] for number in nearest]


def _misfits(problem: Problem, change: Callable[[Array], Array]) -> Array:
    """Median distance of tips and targets over the tips' travel (m,), with readings (n, nq) changed
    in m ways (m, n, nq) [rad].
    """
    arm, records = problem.model.arm, problem.measurements
    rows = np.flatnonzero(records.known)
    has_references = bool(rows.size)
    if has_references:
        spread = np.linspace(0, rows.size - 1, min(KNOWN_RECORDS, rows.size))
        rows = rows[np.round(spread).astype(np.intp)]
    else:
        seats = sorted(records.seats().values(), key=len, reverse=True)[:SEATS]
        rows = np.concatenate([members[:PER_SEAT] for members in seats])
    readings = change(records.readings[rows])
    tips = arm.chain.positions(arm.joint_angles(readings.reshape(-1, arm.nq)))
    tips = tips.reshape(len(readings), rows.size, 3)
    centred = tips - np.median(tips, axis=1, keepdims=True)
    travel = np.median(np.linalg.norm(centred, axis=2), axis=1)
    if has_references:
        targets = records.reference[rows]
        deviations = (
            _deviations_after_registration(tips, targets) if problem.external else tips - targets
        )
    else:
        seat = records.conditions.labels("seat")[rows]
        same_seat = seat[:, None] == seat
        deviations = tips - (same_seat / same_seat.sum(axis=1)) @ tips
    distance = np.median(np.linalg.norm(deviations, axis=2), axis=1)
    return np.asarray(distance / np.maximum(travel, LEAST_DIVISOR))


def _deviations_after_registration(tips: Array, targets: Array) -> Array:
    """Tips (m, n, 3) minus targets (n, 3) in the frame of the tips, by least squares [m]."""
    centred = tips - tips.mean(axis=1, keepdims=True)
    target = targets - targets.mean(axis=0)
    u, _, v = np.linalg.svd(target.T @ centred)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ v))[:, None]
    return np.asarray(centred - target @ (u @ v))
