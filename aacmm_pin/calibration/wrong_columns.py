"""Signs and quarter turns of several joint angles at once, orders of columns, or the ratio of one
joint, with which tips meet their targets.

These are too many for a fit of each, so that a few records judge all.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import permutations

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.units import DEG
from aacmm_pin.calibration.problem import Problem, inverse_distances
from aacmm_pin.measurements import Measurements

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
LARGEST_RATIO = 3.0
"""Of a joint's motion to its readings, or inverse."""
RATIOS, REFINEMENTS = 41, 4
"""Each time between the neighbours of the best."""
REWEIGHTED = 10
SMALLEST_SINGULAR = 1e-6
SMALLEST_TRAVEL = 1e-9
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
    if not misfit.size:
        return []
    alike = misfit <= SIMILAR_RATIO * misfit.min()
    simplicity = np.where(alike, changed_joints, arm.nq + 1)
    simplest = np.lexsort((misfit, simplicity))[:NEAREST]
    return [*zip(signs[simplest], degrees[simplest], strict=True)]


def likely_orders(problem: Problem) -> list[tuple[int, ...]]:
    """The joint (from 0) of each column, best first; none for many joints."""
    nq = problem.model.arm.nq
    if nq > MANY_JOINTS:
        return []
    orders = [*permutations(range(nq))][1:]
    misfit = _misfits(problem, lambda readings: readings[:, np.argsort(orders)].transpose(1, 0, 2))
    nearest = np.argsort(misfit, kind="stable")[:FEW_ORDERS]
    return [orders[number] for number in nearest]


def likely_ratios(problem: Problem) -> list[float]:
    """For each joint the best factor of its readings, with any zeros of the joints."""
    ratios = []
    nq = problem.model.arm.nq
    for joint in range(nq):
        grid = np.geomspace(1 / LARGEST_RATIO, LARGEST_RATIO, 2 * RATIOS)
        for _ in range(REFINEMENTS):
            factors = np.ones((grid.size, nq))
            factors[:, joint] = grid
            misfit = _misfits(problem, partial(np.multiply, factors[:, None]), any_zeros=True)
            if not misfit.size:
                return []
            best = int(np.argmin(misfit))
            below, above = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
            grid = np.linspace(below, above, RATIOS)
        ratios.append(float(grid[RATIOS // 2]))
    return ratios


def likely_scales(problem: Problem) -> Array | None:
    """Best factors of the x, y and z coordinates (3,) in any frame; None with too few references.

    The tips are an affine function of the references, a rotation of scaled coordinates: its columns
    are as long as the scales.
    """
    records = problem.measurements
    placed = np.flatnonzero(records.known)
    if placed.size < KNOWN_RECORDS:
        return None
    tips = problem.model.arm.chain.positions(records.q[placed])
    references = np.column_stack([records.reference[placed], np.ones(placed.size)])
    weights = np.ones(placed.size)
    for _ in range(REWEIGHTED):
        root = np.sqrt(weights)[:, None]
        affine = np.linalg.lstsq(root * references, root * tips)[0]
        weights = inverse_distances(np.linalg.norm(tips - references @ affine, axis=1))
    return np.asarray(np.linalg.norm(affine[:3], axis=1))


def _misfits(
    problem: Problem, change: Callable[[Array], Array], *, any_zeros: bool = False
) -> Array:
    """Median distance of tips and targets over the tips' travel (m,), with readings (n, nq) changed
    in m ways (m, n, nq) [rad]; none without references and seats. With ``any_zeros``, zeros and an
    unknown frame are fitted to first order.
    """
    arm, records, external = problem.model.arm, problem.measurements, problem.external
    rows, seats = _judging_records(records)
    if not rows.size:
        return np.empty(0)
    readings = change(records.readings[rows])
    tips = arm.chain.positions(arm.joint_angles(readings.reshape(-1, arm.nq)))
    tips = tips.reshape(len(readings), rows.size, 3)
    centred = tips - np.median(tips, axis=1, keepdims=True)
    travel = np.median(np.linalg.norm(centred, axis=2), axis=1)
    if seats is None:
        deviations = _deviations_from_references(tips, records.reference[rows], external)
    else:
        means = [tips[:, seats == seat].mean(axis=1) for seat in np.unique(seats)]
        deviations = tips - np.stack(means, axis=1)[:, seats]
    if any_zeros:
        _, jacobian = arm.chain.position_and_jacobian(readings.reshape(-1, arm.nq))
        jacobian = jacobian.reshape(*tips.shape, arm.nq)
        if external and seats is None:
            by_rotation = np.cross(np.eye(3), tips[:, :, None]).transpose(0, 1, 3, 2)
            by_translation = np.broadcast_to(np.eye(3), by_rotation.shape)
            jacobian = np.concatenate([jacobian, by_rotation, by_translation], axis=3)
        columns = jacobian.reshape(len(tips), -1, jacobian.shape[3])
        stacked = deviations.reshape(len(tips), -1, 1)
        steps = np.linalg.pinv(columns, SMALLEST_SINGULAR) @ stacked
        deviations = (stacked - columns @ steps).reshape(tips.shape)
    distance = np.median(np.linalg.norm(deviations, axis=2), axis=1)
    return np.asarray(distance / np.maximum(travel, SMALLEST_TRAVEL))


def _judging_records(records: Measurements) -> tuple[Index, Index | None]:
    """Numbers of a few records, and of their seats; None with references."""
    placed = np.flatnonzero(records.known)
    if placed.size:
        spread = np.linspace(0, placed.size - 1, min(KNOWN_RECORDS, placed.size))
        return placed[np.round(spread).astype(np.intp)], None
    seats = sorted(records.seats().values(), key=len, reverse=True)[:SEATS]
    of_seats = [members[:PER_SEAT] for members in seats if len(members) > 1]
    rows = np.concatenate([np.empty(0, dtype=np.intp), *of_seats])
    return rows, np.repeat(np.arange(len(of_seats)), [len(members) for members in of_seats])


def _deviations_from_references(tips: Array, reference: Array, external: bool) -> Array:
    """Tips (m, n, 3) minus references (n, 3), registered to the tips if their frame is unknown (m,
    n, 3) [m].
    """
    if not external:
        return tips - reference
    centred = tips - tips.mean(axis=1, keepdims=True)
    target = reference - reference.mean(axis=0)
    u, _, v = np.linalg.svd(target.T @ centred)
    handedness = np.sign(np.linalg.det(u @ v))
    u[:, :, 2] *= handedness[:, None]
    return np.asarray(centred - target @ (u @ v))
