"""Long batches in parts, and products of vectors with the batch last."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array

ROWS_PER_BATCH = 2048
"""Their results fit the processor's cache."""


def chunks(n: int, size: int = ROWS_PER_BATCH) -> list[slice]:
    """Slices that cover ``range(n)``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def cross(u: Array, v: Array) -> Array:
    """u × v along the last axis but one (..., 3, n); numpy.cross copies, and is several times
    slower.
    """
    product = np.empty(np.broadcast_shapes(u.shape, v.shape))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        ahead = u[..., j, :] * v[..., k, :]
        product[..., i, :] = ahead - u[..., k, :] * v[..., j, :]
    return product
