"""Volumes of zonotopes in loops for numba; see :mod:`aacmm_pin.accuracy.zonotope`."""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.compiled import Loop

LARGE_VOLUME = 200_000
"""Generator elements from which the loop is used: NumPy takes 15 ms, the loop 2 ms."""
VOLUME_LANES = 32
"""Zonotopes side by side in wide registers; with 24 generators they fit in the first cache."""


def sum_of_determinants(generators: Array, total: Array) -> None:
    """Sums of :func:`aacmm_pin.accuracy.zonotope.sum_of_determinants`, in the same order."""
    n, _, count = generators.shape
    g = np.empty((count, 3, VOLUME_LANES))
    normal = np.empty((3, VOLUME_LANES))
    sums = np.empty((count, VOLUME_LANES))
    u = normal[0]
    v = normal[1]
    w = normal[2]
    for first in range(0, n, VOLUME_LANES):
        width = min(VOLUME_LANES, n - first)
        for lane in range(width):
            for k in range(count):
                for c in range(3):
                    g[k, c, lane] = generators[first + lane, c, k]
        sums[:] = 0.0
        for j in range(1, count):
            bx = g[j, 0]
            by = g[j, 1]
            bz = g[j, 2]
            for i in range(j):
                ax = g[i, 0]
                ay = g[i, 1]
                az = g[i, 2]
                for lane in range(width):
                    u[lane] = ay[lane] * bz[lane] - az[lane] * by[lane]
                    v[lane] = az[lane] * bx[lane] - ax[lane] * bz[lane]
                    w[lane] = ax[lane] * by[lane] - ay[lane] * bx[lane]
                for k in range(j + 1, count):
                    x = g[k, 0]
                    y = g[k, 1]
                    z = g[k, 2]
                    sum_of_k = sums[k]
                    for lane in range(width):
                        sum_of_k[lane] += abs(
                            u[lane] * x[lane] + v[lane] * y[lane] + w[lane] * z[lane]
                        )
        for lane in range(width):
            total[first + lane] = 0.0
            for k in range(2, count):
                total[first + lane] += sums[k, lane]


VOLUME_LOOP = Loop(sum_of_determinants, "void(f8[:, :, :], f8[::1])", least=LARGE_VOLUME)
