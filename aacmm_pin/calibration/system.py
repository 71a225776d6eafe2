"""The whitened linear system of one step, with the unknown points of the observations projected out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aacmm_pin.calibration.problem import Prediction
from aacmm_pin.checks import Array
from aacmm_pin.observations import Observation

BackSubstitution = Callable[[Array], list[Array]]
"""From a step of the parameters (p,) to the steps of each observation's nuisances."""


@dataclass(frozen=True, eq=False)
class System:
    """Residual ``r + A δ``, whitened: unit variance, nuisances already at their best.

    Attributes:
        residual: (rows,).
        jacobian: (rows, p).
        distance: squared Mahalanobis distance of each record from its target, (n,); nan where it has none.
        deviation: tip minus target (n, 3) [m]; nan where it has none.
        free: number of rows less the number of nuisances that the rows determine.
        nuisances: how the nuisances follow a step.
    """

    residual: Array
    jacobian: Array
    distance: Array
    deviation: Array
    free: int
    nuisances: BackSubstitution


def assemble(
    prediction: Prediction,
    observations: list[Observation],
    nuisances: list[Array],
    noise: Array,
    weights: Array,
) -> System:
    """The system at a prediction.

    Args:
        prediction: tips and derivative.
        observations: what the records say.
        nuisances: values of each observation's unknown numbers.
        noise: covariance of each tip apart from its target (n, 3, 3) [m²].
        weights: (n,) of the records, 1 for full.
    """
    n = len(prediction.tips)
    residuals, jacobians, free = [], [], 0
    steps: list[tuple[Array, Array, Array] | None] = []
    distance, deviation = np.full(n, np.nan), np.full((n, 3), np.nan)
    for observation, values in zip(observations, nuisances, strict=True):
        records = observation.records
        targets, by_nuisance = observation.targets(values)
        whiten = np.linalg.inv(np.linalg.cholesky(noise[records] + observation.covariance()))
        deviation[records] = prediction.tips[records] - targets
        white = np.einsum("nij,nj->ni", whiten, deviation[records])
        distance[records] = np.einsum("ni,ni->n", white, white)
        root = np.sqrt(weights[records])
        whiten = whiten * root[:, None, None]
        residual = (white * root[:, None]).ravel()
        jacobian = (whiten @ prediction.jacobian[records]).reshape(residual.size, -1)
        if not values.size:
            residuals.append(residual)
            jacobians.append(jacobian)
            steps.append(None)
            free += residual.size
            continue
        tie, by_tie = observation.ties(values)
        residual = np.concatenate([residual, tie])
        jacobian = np.vstack([jacobian, np.zeros((tie.size, jacobian.shape[1]))])
        by = np.vstack([-(whiten @ by_nuisance).reshape(-1, values.size), by_tie])
        q, r = np.linalg.qr(by)
        along, along_jacobian = q.T @ residual, q.T @ jacobian
        steps.append((r, along, along_jacobian))
        residuals.append(residual - q @ along)
        jacobians.append(jacobian - q @ along_jacobian)
        free += residual.size - values.size
    empty = np.empty((0, prediction.jacobian.shape[2]))
    return System(
        np.concatenate([np.empty(0), *residuals]),
        np.vstack([empty, *jacobians]),
        distance,
        deviation,
        free,
        lambda delta: [_back(step, delta) for step in steps],
    )


def _back(step: tuple[Array, Array, Array] | None, delta: Array) -> Array:
    """The nuisances' step: ``-R⁻¹ Qᵀ (r + J δ)``, the smallest one where R is singular."""
    if step is None:
        return np.empty(0)
    r, along, along_jacobian = step
    return np.asarray(-np.linalg.lstsq(r, along + along_jacobian @ delta, rcond=1e-12)[0])
