"""Squared distances of records from their targets, in standard deviations."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.solver import Solution
from aacmm_pin.calibration.variance_components import (
    information_of_seats,
    squared_distances,
)
from aacmm_pin.measurements import NOTHING_KNOWN


def deleted_distances(solution: Solution) -> Array:
    """Squared distance of each record from where the *others* put its target, over the variance of
    both (n,); infinite without a target.

    Without the record, the others of its seat determine an unknown point; bars do not count.
    """
    observations = solution.observations
    covariance = solution.noise.of_residuals[:, :3, :3].copy()
    deviations = solution.system.deviation.copy()
    touched = np.flatnonzero(observations.seat >= 0)
    if touched.size:
        seat = observations.seat[touched]
        information, _, of_records, pulls = information_of_seats(solution)
        others = np.linalg.inv(information[seat] - of_records + NOTHING_KNOWN * np.eye(3))
        # By one unit of a seat a deviation changes by minus these.
        changes = -observations.by_seats(np.tile(np.eye(3), (len(deviations), 1, 1)))[touched]
        moved = changes @ others @ pulls @ deviations[touched][:, :, None]
        deviations[touched] += moved[:, :, 0]
        covariance[touched] += changes @ others @ changes.transpose(0, 2, 1)
    covariance = observations.counting(covariance)
    deviations = observations.along_normals(deviations[:, None, :])[:, 0]
    has_target = observations.has_target
    turns = np.nan_to_num(solution.system.turn_distance[has_target])
    distances = np.full(len(deviations), np.inf)
    distances[has_target] = (
        squared_distances(deviations[has_target], covariance[has_target]) + turns
    )
    return distances


def studentised_distances(solution: Solution) -> Array:
    """Squared distance of each record over the variance that its share in the parameters leaves
    (n,); infinite without a target.

    ``eᵀ (I - H)⁻¹ e`` with the whitened residual and its block of the hat matrix, prior included
    (internally studentised residuals; Cook and Weisberg 1982).
    """
    system = solution.system
    has_target = solution.observations.has_target
    width = solution.noise.of_residuals.shape[1]
    count = int(has_target.sum())
    rows = slice(width * count)
    steps = system.steps(system.unknown)
    whitened = np.zeros((len(has_target), width, steps.shape[1] + 1))
    whitened[has_target, :, :-1] = (system.jacobian[rows] @ steps).reshape(count, width, -1)
    whitened[has_target, :, -1] = system.residual[rows].reshape(count, width)
    # Each record by itself, without what it shares with others.
    root_weights = np.sqrt(solution.weights)[:, None, None]
    correlation = solution.noise.correlation(solution.noise.whitening * root_weights)
    alone = correlation.whitened_back(whitened)[has_target]
    along = alone[:, :, :-1]
    remaining = np.eye(width) - along @ along.transpose(0, 2, 1)
    distances = np.full(len(has_target), np.inf)
    distances[has_target] = squared_distances(alone[:, :, -1], remaining)
    return distances
