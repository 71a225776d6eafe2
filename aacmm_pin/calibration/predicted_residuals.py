"""The residuals that the stated uncertainties of arm and records predict."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.linearisation import seat_columns

RECORDS_FOR_MEAN = 1500
ROUNDING_OF_PRODUCTS = 1e-12


def predicted_rms(at: Fit) -> float:
    """RMS distance of tip and target that the stated uncertainties predict after a fit [m]; nan
    without uncertainties of the arm, or targets.

    The fit takes a part of the errors: with the columns A of parameters and seats, weights W and
    ``C = (Aᵀ W A + P)⁻¹`` of ISO/IEC Guide 98-3 (JCGM 100:2008, eq. 13), ``e - A C Aᵀ W e`` is left
    of the errors e by geometry and noise.
    """
    used = np.flatnonzero(at.used & at.observations.has_target)
    if not (used.size and at.problem.model.covariance().any()):
        return float("nan")
    used = used[:: -(-used.size // RECORDS_FOR_MEAN)]
    noise = at.noise.without_scatter[used, :3, :3]
    whitening = at.noise.whitening[:, :3, :3]
    columns, ties = _columns(at, whitening)
    columns = columns[used]
    whiten = whitening[used]
    times = at.used.sum() / used.size
    flat = columns.reshape(3 * used.size, columns.shape[2])
    precision = times * flat.T @ flat + ties
    # Columns of length one: a direction of seats that stays open is known by rounding alone.
    lengths = np.sqrt(np.diagonal(precision))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    scaled = precision / lengths / lengths[:, None]
    inverse = (
        np.linalg.pinv(scaled, ROUNDING_OF_PRODUCTS, hermitian=True) / lengths / lengths[:, None]
    )
    by_geometry = whiten @ at.by_geometry[used]
    taken = inverse @ (flat.T @ by_geometry.reshape(3 * used.size, by_geometry.shape[2]))
    left = by_geometry - times * columns @ taken
    white = whiten @ noise @ whiten.transpose(0, 2, 1)
    pulled = columns.transpose(0, 2, 1) @ white  # (n, k, 3)
    scatter = times * np.einsum("nki,nil->kl", pulled, columns) + ties
    along = columns @ inverse
    variance = white - 2.0 * along @ pulled + along @ scatter @ along.transpose(0, 2, 1)
    variance = variance + left @ left.transpose(0, 2, 1)
    back = np.linalg.cholesky(at.noise.of_residuals[used, :3, :3])
    covariances = back @ variance @ back.transpose(0, 2, 1)
    return float(np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean()))


def _columns(at: Fit, whitening: Array) -> tuple[Array, Array]:
    """Whitened columns of parameters and seats (n, 3, k), and their prior information (k, k)."""
    observations = at.observations
    of_parameters = whitening @ at.point.prediction.jacobian[:, :3]
    by_seat = observations.by_seats(whitening)
    of_records, of_seats, of_relations = seat_columns(observations, at.point.seats, by_seat)
    count = 3 * len(observations.labels)
    columns = np.concatenate([of_parameters, of_records.reshape(len(by_seat), 3, count)], axis=2)
    ties = np.zeros((columns.shape[2],) * 2)
    first = of_parameters.shape[2]
    of_relations = of_relations.reshape(len(of_relations), count)
    rows = np.concatenate([of_seats.reshape(count, count), of_relations])
    ties[first:, first:] = rows.T @ rows
    return columns, ties
