"""First placement of targets and base: the nearest for the arm as described.

Base Y, b and offset t of a target are in ``r = Y (p + A t) + b``, for references r, tips p and axes
A of the last body. With W = Yᵀ this is ``W r = p + A t + c``, linear but for W; without t and c, a
quadratic form of W is left. Its minima over the rotations are searched from those of a cube.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import exp, skew
from aacmm_pin.calibration.problem import (
    MOST_REWEIGHTINGS,
    SETTLED_PART,
    Frame,
    Problem,
    inverse_distances,
)

BASINS = 3
"""So many of the lowest minima are compared by sums of distances, which gross errors hardly
change.
"""
ROTATION_TOLERANCE = 0.05
MOST_NEWTON_STEPS = 40
"""Five to twenty do."""
LEAST_ROTATION_STEP = 1e-6
"""Newton's method ends at smaller steps [rad]."""
PLACEMENT_RANK_RATIO = 1e-5
"""Combinations of offsets and shift with a smaller part of the effect stay zero."""
TINY = 1e-300


class _Placement(NamedTuple):
    """Sum of all distances [m]; factors w of the columns; solution z, t and c (m + 3,) [m]."""

    total: float
    w: Array
    z: Array


def first_placement(problem: Problem, tips: Array, by_offset: Array) -> tuple[Frame, Array]:
    """Frame, and offsets of the targets (m,) [m], with the least sum of distances.

    Args:
        problem: with three or more records with coordinates.
        tips: by the arm as described, in its base (n, 3) [m].
        by_offset: derivative of the tips by the offsets (n, 3, m).
    """
    records = problem.measurements
    stating = records.known
    tips, references, linear = tips[stating], records.reference[stating], by_offset[stating]
    if not problem.external:
        equations = _Equations((references - tips)[:, :, None], linear)
        return Frame.identity(), _nearest_placement(equations, None).z
    middle = references.mean(axis=0)
    by_shift = np.broadcast_to(np.eye(3), (len(tips), 3, 3))
    linear = np.concatenate([linear, by_shift], axis=2)
    equations = _Equations.of(tips, references - middle, linear)
    placements = [_nearest_placement(equations, start) for start in _minima(equations)[:BASINS]]
    nearest = min(placements, key=lambda placement: placement.total)
    offsets, shift = np.split(nearest.z, [-3])
    rotation = nearest.w[:9].reshape(3, 3).T
    return Frame(rotation, middle + rotation @ shift), offsets


class _Equations(NamedTuple):
    """``columns w = linear z``: w are the nine numbers of W and -1, and z is what is linear.

    Attributes:
        columns: (n, 3, 10); if the frame is known, their sum (n, 3, 1).
        linear: (n, 3, m).
    """

    columns: Array
    linear: Array

    @staticmethod
    def of(tips: Array, references: Array, linear: Array) -> _Equations:
        """``W reference - tip = linear z`` for each record."""
        n = len(tips)
        by_rotation = np.einsum("ij,nk->nijk", np.eye(3), references).reshape(n, 3, 9)
        return _Equations(np.concatenate([by_rotation, tips[:, :, None]], axis=2), linear)

    def eliminated(self, weights: Array) -> tuple[Array, Array]:
        """z for each column (m, 10), and the columns less ``linear z`` (n, 3, 10)."""
        count = 3 * weights.size
        root = np.sqrt(weights)[:, None, None]
        rows = (root * self.linear).reshape(count, -1)
        columns = (root * self.columns).reshape(count, -1)
        solution = np.asarray(np.linalg.lstsq(rows, columns, PLACEMENT_RANK_RATIO)[0], np.float64)
        return solution, self.columns - self.linear @ solution


def _nearest_placement(equations: _Equations, rotation: Array | None) -> _Placement:
    """The least sum of distances near ``rotation`` W, by inverse distances as weights (Weiszfeld);
    None if the frame is known.
    """
    weights = np.ones(len(equations.columns))
    w = np.ones(1)
    before = np.inf
    for _ in range(MOST_REWEIGHTINGS):
        z_of_columns, residual_columns = equations.eliminated(weights)
        if rotation is not None:
            rotation = _descend(_gram(residual_columns, weights), rotation[None])[0][0]
            w = np.append(rotation, -1.0)
        distances = np.linalg.norm(residual_columns @ w, axis=1)
        total = float(distances.sum())
        if abs(before - total) < SETTLED_PART * total:
            break
        before = total
        weights = inverse_distances(distances)
    return _Placement(total, w, z_of_columns @ w)


def _minima(equations: _Equations) -> list[Array]:
    """Rotations with the least sums of squares nearby, lowest first."""
    weights = np.ones(len(equations.columns))
    _, residual_columns = equations.eliminated(weights)
    cube = scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    rotations, values = _descend(_gram(residual_columns, weights), cube)
    distinct: list[Array] = []
    for rotation in rotations[np.argsort(values)]:
        if all(np.linalg.norm(rotation - other) > ROTATION_TOLERANCE for other in distinct):
            distinct.append(rotation)
    return distinct


def _gram(columns: Array, weights: Array) -> Array:
    weighted = weights[:, None, None] * columns
    return np.asarray(weighted.reshape(-1, 10).T @ columns.reshape(-1, 10))


def _descend(gram: Array, rotations: Array) -> tuple[Array, Array]:
    """The minima of ``(w, -1)ᵀ gram (w, -1)`` near each rotation (k, 3, 3), and its values there
    (k,).

    Newton's method over rotations ω, which add ``[ω] W + [ω]² W / 2``: damped, with absolute
    curvatures, so that no step goes up (Dauphin et al. 2014).
    """
    quadratic, linear = gram[:9, :9], gram[:9, 9]

    def value(w: Array) -> Array:
        form = (w @ quadratic - 2.0 * linear) * w
        return np.asarray(form.sum(axis=1))

    values = value(rotations.reshape(-1, 9))
    damping = np.full(len(rotations), 1e-6)
    for _ in range(MOST_NEWTON_STEPS):
        by_rotation = (skew(np.eye(3)) @ rotations[:, None]).reshape(-1, 3, 9)
        gradient = rotations.reshape(-1, 9) @ quadratic - linear
        slope = by_rotation @ gradient[:, :, None]
        second_order = rotations @ gradient.reshape(-1, 3, 3).transpose(0, 2, 1)
        trace = np.trace(second_order, axis1=1, axis2=2)[:, None, None]
        curvature = by_rotation @ quadratic @ by_rotation.transpose(0, 2, 1) - trace * np.eye(3)
        curvature += 0.5 * (second_order + second_order.transpose(0, 2, 1))
        curvatures, directions = np.linalg.eigh(curvature)
        sizes = np.abs(curvatures) + damping[:, None] * np.trace(quadratic) + TINY
        step = -(directions @ (directions.transpose(0, 2, 1) @ slope / sizes[:, :, None]))[:, :, 0]
        step /= np.maximum(1.0, np.linalg.norm(step, axis=1))[:, None]
        trial = exp(np.hstack([np.zeros_like(step), step]))[:, :3, :3] @ rotations
        trial_values = value(trial.reshape(-1, 9))
        lower = trial_values < values
        rotations = np.where(lower[:, None, None], trial, rotations)
        values = np.where(lower, trial_values, values)
        damping = np.where(lower, damping / 10.0, damping * 10.0)
        if np.abs(step).max() < LEAST_ROTATION_STEP:
            break
    return rotations, values
