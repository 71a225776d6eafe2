"""Orientations: conversions, differences and mean."""

from __future__ import annotations

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import skew
from aacmm_pin.measurements.csv_columns import ORIENTATION, ROTATION_ORDERS, ROTATION_VECTOR


def matrices(quaternions: Array) -> Array:
    """Orientations (n, 3, 3) of unit quaternions (n, 4), scalar first; identity for NaN."""
    filled = np.where(np.isfinite(quaternions), quaternions, [1.0, 0.0, 0.0, 0.0])
    scalar_last = np.roll(filled, -1, axis=1)
    rotations = scipy.spatial.transform.Rotation.from_quat(scalar_last)
    return np.asarray(rotations.as_matrix())


def as_quaternions(form: tuple[str, ...], numbers: Array) -> Array:
    """Quaternions (n, 4), scalar first, from columns of one of :data:`ORIENTATIONS`, in units of
    the file.

    Angles are about :data:`ROTATION_ORDERS`; roll, pitch, yaw: ``Rz(yaw) Ry(pitch) Rx(roll)``. NaN
    stays.
    """
    if form == ORIENTATION:
        return numbers
    is_complete = np.isfinite(numbers).all(axis=1, keepdims=True)
    filled = np.where(is_complete, numbers, 0.0)
    if form == ROTATION_VECTOR:
        rotations = scipy.spatial.transform.Rotation.from_rotvec(filled)
    else:
        rotations = scipy.spatial.transform.Rotation.from_euler(
            ROTATION_ORDERS[form], filled, degrees=True
        )
    return np.where(is_complete, np.roll(rotations.as_quat(), 1, axis=1), np.nan)


def quaternions(orientations: Array) -> Array:
    """Unit quaternions (n, 4), scalar first, of orientations (n, 3, 3)."""
    rotations = scipy.spatial.transform.Rotation.from_matrix(orientations)
    return np.roll(rotations.as_quat(), 1, axis=1)


def rotation_vectors(orientation: Array, start: Array) -> Array:
    """Rotation vectors ``log(R Sᵀ)`` (n, 3) [rad] from ``start`` S to ``orientation`` R."""
    between = orientation @ start.transpose(0, 2, 1)
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(between).as_rotvec())


def inverse_left_jacobian(vectors: Array) -> Array:
    """∂log(exp(δ) exp(φ))/∂δ at δ = 0 for rotation vectors φ (n, 3) [rad]: (n, 3, 3).

    ``I - [φ]/2 + (1/φ² - cot(φ/2)/(2φ)) [φ]²`` (Barfoot 2017, 7.77), with 1/12 for small angles.
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    is_small = angle <= 1e-3
    nonzero = np.where(is_small, 1.0, angle)
    half = 0.5 * nonzero
    factor = (1.0 - half / np.tan(half)) / nonzero**2
    of_square = np.where(is_small, 1.0 / 12.0, factor)
    cross = skew(vectors)
    return np.eye(3) - 0.5 * cross + of_square * (cross @ cross)


def mean(orientations: Array) -> Array:
    """Mean (3, 3) of orientations (n, 3, 3) in the Frobenius norm; identity of none."""
    if not len(orientations):
        return np.eye(3)
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(orientations).mean().as_matrix())
