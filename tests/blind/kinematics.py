"""Homogeneous transforms in NumPy, each (n, 4, 4) from values (n,) or (n, 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def identity(n: int) -> Array:
    return np.broadcast_to(np.eye(4), (n, 4, 4)).copy()


def turn_z_shift(angle: Array, d: Array) -> Array:
    """Rz(angle) Tz(d)."""
    t = identity(len(angle))
    c, s = np.cos(angle), np.sin(angle)
    t[:, 0, 0], t[:, 0, 1], t[:, 1, 0], t[:, 1, 1], t[:, 2, 3] = c, -s, s, c, d
    return t


def shift_x(a: Array) -> Array:
    """Tx(a)."""
    t = identity(len(a))
    t[:, 0, 3] = a
    return t


def turn_x(angle: Array) -> Array:
    """Rx(angle)."""
    t = identity(len(angle))
    c, s = np.cos(angle), np.sin(angle)
    t[:, 1, 1], t[:, 1, 2], t[:, 2, 1], t[:, 2, 2] = c, -s, s, c
    return t


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    k = np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2
    )
    # sinc(angle / pi) = sin(angle) / angle, also at zero
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (k @ k)
    )


def moved(frames: Array, vector: Array, shift: Array | float = 0.0) -> Array:
    """Frames (n, 4, 4) turned in place by rotation vectors (n, 3) of the base, and shifted in the
    base by (n, 3) [m].
    """
    out = frames.copy()
    out[:, :3, :3] = rotation(vector) @ frames[:, :3, :3]
    out[:, :3, 3] += shift
    return out
