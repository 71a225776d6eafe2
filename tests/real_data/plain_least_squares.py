"""Geometry fitted by nothing but SciPy: a second opinion that shares no code with the package.

Every residual counts alike, nothing is left out, nothing is known beforehand: no other geometry
fits better.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

OF_ROW = 5
"""a, d, alpha, theta and the tilt about y that DH lacks between parallel axes."""


def fitted_distances(rows: Array, q: Array, reference: Array, target: Array) -> Array:
    """Distances after the fit.

    Args:
        rows: standard DH, a, d, alpha (nq, 3) [mm, mm, rad].
        q: (n, nq) [rad].
        reference: in an unknown frame (n, 3) [mm].
        target: about where it sits in the last frame (3,) [mm].

    Returns:
        (n,) [mm].
    """
    nq = len(rows)
    units = np.concatenate(
        [[1, 1, 1, 1e-3, 1e-3, 1e-3], np.tile([1, 1, 1e-3, 1e-3, 1e-3], nq), [1, 1, 1]]
    )
    nothing = np.zeros(6 + OF_ROW * nq + 3)
    first = _tips(np.zeros(6), rows, nothing[6:-3].reshape(nq, -1), q, target)
    turn, _ = Rotation.align_vectors(reference - reference.mean(axis=0), first - first.mean(axis=0))
    shift = reference.mean(axis=0) - turn.apply(first.mean(axis=0))
    start = np.concatenate([shift, turn.as_euler("xyz"), nothing[6:-3], target])

    def residual(steps: Array) -> Array:
        x = start + steps * units
        return (_tips(x[:6], rows, x[6:-3].reshape(nq, -1), q, x[-3:]) - reference).ravel()

    found = least_squares(residual, nothing, max_nfev=60)
    return np.linalg.norm(found.fun.reshape(-1, 3), axis=1)


def _tips(frame: Array, rows: Array, errors: Array, q: Array, target: Array) -> Array:
    place, turn = (
        np.tile(frame[:3], (len(q), 1)),
        np.tile(_turned("xyz", frame[3:]), (len(q), 1, 1)),
    )
    for (a, d, alpha), (da, dd, dalpha, dtheta, tilt), angle in zip(rows, errors, q.T, strict=True):
        place = place + turn[:, :, 2] * (d + dd)
        c, s = np.cos(angle + dtheta)[:, None], np.sin(angle + dtheta)[:, None]
        x, y = turn[:, :, 0], turn[:, :, 1]
        turn = np.stack([c * x + s * y, c * y - s * x, turn[:, :, 2]], axis=2)
        place = place + turn[:, :, 0] * (a + da)
        turn = turn @ _turned("XY", [alpha + dalpha, tilt])
    return place + turn @ target


def _turned(axes: str, angles: ArrayLike) -> Array:
    return Rotation.from_euler(axes, angles).as_matrix()
