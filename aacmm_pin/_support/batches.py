"""Long batches in parts, and products of vectors whose batch is the last axis."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array

CHUNK = 2048
"""Rows handled at once: what is made of them stays in the processor's cache."""


def chunks(n: int, size: int = CHUNK) -> list[slice]:
    """Slices that cover ``range(n)`` in parts of ``size``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def cross(u: Array, v: Array) -> Array:
    """u × v of components along the last axis but one (..., 3, n).

    numpy.cross copies, and is several times slower here.
    """
    product = np.empty(np.broadcast_shapes(u.shape, v.shape))
    product[..., 0, :] = u[..., 1, :] * v[..., 2, :] - u[..., 2, :] * v[..., 1, :]
    product[..., 1, :] = u[..., 2, :] * v[..., 0, :] - u[..., 0, :] * v[..., 2, :]
    product[..., 2, :] = u[..., 0, :] * v[..., 1, :] - u[..., 1, :] * v[..., 0, :]
    return product
