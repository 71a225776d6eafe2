"""Zonotopes against determinants one by one, convex hulls of all vertices, and every vector of
signs.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy import zonotope
from tests.oracle import zonotope_volume

pytestmark = pytest.mark.fast


def vertices(generators: Array) -> Array:
    """All 2^p sums ± g_1 ± g_2 …: (2^p, 3)."""
    return np.array(list(product((-1.0, 1.0), repeat=generators.shape[1]))) @ generators.T


def _degenerate(rng: np.random.Generator, p: int) -> dict[str, Array]:
    g = rng.normal(size=(3, p))
    flat, twins, nothing, thin, last = g.copy(), g.copy(), g.copy(), g.copy(), g.copy()
    flat[2] = 0.0
    twins[:, p // 2 :] = twins[:, : p - p // 2] * rng.uniform(-2, 2, p - p // 2)
    nothing[:, ::2] = 0.0
    thin[1:] *= 1e-9
    last[:, :-1] = 0.0
    return {
        "general": g,
        "in a plane": flat,
        "parallel": twins,
        "zeros": nothing,
        "needle": thin,
        "last": last,
        "none": 0.0 * g,
    }


def test_volume_is_the_sum_of_determinants_and_that_of_the_hull(rng):
    for p in (3, 4, 7, 24):
        generators = rng.normal(size=(300, 3, p))  # more than one chunk
        volume = zonotope.volume(generators)
        for k in (0, 255, 256, 299):
            assert volume[k] == pytest.approx(zonotope_volume(generators[k]), rel=1e-12)
            if p < 9:
                assert volume[k] == pytest.approx(
                    ConvexHull(vertices(generators[k])).volume, rel=1e-10
                )


def test_degenerate_generators(rng):
    """Volume against determinants, largest deviation against every vector of signs."""
    for p in (3, 5, 10):
        for kind, g in _degenerate(rng, p).items():
            scale = np.prod(np.abs(g).sum(axis=1).clip(1e-12)) if kind == "needle" else 1.0
            assert zonotope.volume(g[None])[0] == pytest.approx(
                zonotope_volume(g), rel=1e-9, abs=1e-14 * scale
            ), kind
            brute = np.linalg.norm(vertices(g), axis=1).max()
            assert zonotope.largest_deviation(g[None])[0] == pytest.approx(
                brute, rel=1e-12, abs=1e-15
            ), kind
    # Many lie exactly in the plane of two others.
    g = rng.integers(-1, 2, size=(200, 3, 8)).astype(float)
    brute = [np.linalg.norm(vertices(one), axis=1).max() for one in g]
    np.testing.assert_allclose(zonotope.largest_deviation(g), brute, rtol=1e-12)


def test_few_generators_and_none(rng):
    for p in (0, 1, 2):
        g = rng.normal(size=(4, 3, p))
        np.testing.assert_array_equal(zonotope.volume(g), np.zeros(4))
        brute = [np.linalg.norm(vertices(one), axis=1).max() for one in g]
        np.testing.assert_allclose(zonotope.largest_deviation(g), brute, rtol=1e-12)
    empty = np.empty((0, 3, 5))
    assert zonotope.volume(empty).shape == zonotope.largest_deviation(empty).shape == (0,)
