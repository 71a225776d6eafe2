"""Zonotopes ``Σ s_k g_k``, s_k in [-1, 1]: to first order, all displacements within bounds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aacmm_pin._support.arrays import Array, Index, chunks
from aacmm_pin.accuracy.zonotope_loop import VOLUME_LOOP

CHUNK = 256
"""At once: the pair normals of 24 generators then fit in the cache."""
MOST = 4_000_000
"""Signs of generators at once: 32 MB, and some copies."""
FLAT = 1e-13
"""A unit generator that sticks out of a face by less lies in it."""


def volume(generators: Array) -> Array:
    """``8 Σ_{i<j<k} |det(g_i, g_j, g_k)|`` of generators (n, 3, p) [m]: (n,) [m³].

    Source: P. McMullen, "On zonotopes", Trans. AMS 159 (1971); 8 because s has the range [-1, 1].
    """
    volumes = np.empty(len(generators))
    sum_up = VOLUME_LOOP.chosen(generators.size) or sum_of_determinants
    sum_up(np.require(generators, np.float64, "W"), volumes)
    return 8.0 * volumes


def sum_of_determinants(generators: Array, total: Array) -> None:
    """Fill ``Σ_{i<j<k} |det(g_i, g_j, g_k)|`` for generators (n, 3, p) [m]: (n,) [m³]."""
    n, _, count = generators.shape
    total[:] = 0.0
    first, second = _pairs(count)
    for part in chunks(n, CHUNK):
        width = len(total[part])
        g = np.zeros((3, count, max(width, 2)))  # NumPy sums a single column in another order
        g[:, :, :width] = generators[part].transpose(1, 2, 0)
        a = g[:, first]
        b = g[:, second]
        normal = np.stack(
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        )
        for k in range(2, count):
            upto = k * (k - 1) // 2  # the pairs i < j < k come first
            triple = normal[0, :upto] * g[0, k]
            triple += normal[1, :upto] * g[1, k]
            triple += normal[2, :upto] * g[2, k]
            total[part] += np.abs(triple, out=triple).sum(axis=0)[:width]


def largest_deviation(generators: Array) -> Array:
    """Distance of the farthest vertex, ``max_n Σ |n·g_k|``, of generators (n, 3, p) [m]: (n,)
    [m].
    """
    n, _, count = generators.shape
    if count < 2:
        return np.asarray(np.linalg.norm(np.abs(generators).sum(axis=2), axis=1))
    squared_distance = np.zeros(n)
    first, second = _pairs(count)
    for part in chunks(n, max(1, min(CHUNK, MOST // (len(first) * count)))):
        for points in _corners(generators[part], first, second):
            farthest = np.square(points).sum(axis=2).max(axis=1)
            squared_distance[part] = np.maximum(squared_distance[part], farthest)
    return np.sqrt(squared_distance)


def _corners(generators: Array, first: Index, second: Index) -> Iterator[Array]:
    """Points (n, pairs, 3), in two parts, with one of each two opposite vertices.

    A vertex ``Σ_k s_k g_k`` bounds an edge along some g_i of a face of g_i and g_j with the normal
    n = g_i × g_j. Its signs are those of ``n·g_k``; where this is zero, of ``±(n × g_i)·g_k``;
    where this is zero too, of ``±g_i·g_k``. One sign of n × g_i suffices: the edge with the least i
    at a vertex lies between two faces.
    """
    g = generators.transpose(0, 2, 1)  # (n, p, 3)
    length = np.linalg.norm(g, axis=2)
    unit = g / np.where(length > 0, length, 1.0)[:, :, None]
    along = np.where(length[:, first, None] > 0, unit[:, first], unit[:, second])
    normal = np.cross(along, unit[:, second])  # (n, pairs, 3)
    inwards = np.cross(normal, along)
    components = (v @ unit.transpose(0, 2, 1) for v in (normal, inwards, along))
    above, beside, ahead = (
        np.where(np.abs(component) > FLAT, np.sign(component), 0.0) for component in components
    )
    for end_of_edge in (1.0, -1.0):
        in_face = np.where(beside != 0, beside, end_of_edge * ahead)
        sign = np.where(above != 0, above, in_face)
        yield sign @ g


def _pairs(count: int) -> tuple[Index, Index]:
    """Pairs i < j, ordered by j."""
    second, first = np.tril_indices(count, -1)
    return first, second
