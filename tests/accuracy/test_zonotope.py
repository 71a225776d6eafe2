"""Zonotopes against determinants one by one, convex hulls of all vertices, and every vector of signs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from aacmm_pin._support.checks import Array
from aacmm_pin.accuracy import zonotope


def vertices(generators: Array) -> Array:
    """All 2^p sums ± g_1 ± g_2 …: (2^p, 3)."""
    return np.array(list(product((-1.0, 1.0), repeat=generators.shape[1]))) @ generators.T


def triple_sum(generators: Array) -> float:
    return 8 * sum(abs(np.linalg.det(generators[:, list(pick)])) for pick in combinations(range(generators.shape[1]), 3))


def _degenerate(rng: np.random.Generator, p: int) -> dict[str, Array]:
    g = rng.normal(size=(3, p))
    flat, twins, nothing, thin = g.copy(), g.copy(), g.copy(), g.copy()
    flat[2] = 0.0
    twins[:, p // 2 :] = twins[:, : p - p // 2] * rng.uniform(-2, 2, p - p // 2)
    nothing[:, ::2] = 0.0
    thin[1:] *= 1e-9
    return {"general": g, "in a plane": flat, "parallel": twins, "zeros": nothing, "needle": thin, "all zero": 0.0 * g}


@pytest.mark.parametrize("p", [3, 4, 7, 24])
def test_volume_is_the_sum_of_determinants(rng: np.random.Generator, p: int) -> None:
    generators = rng.normal(size=(300, 3, p))  # more than one chunk
    volume = zonotope.volume(generators)
    for k in (0, 1, 255, 256, 299):
        assert volume[k] == pytest.approx(triple_sum(generators[k]), rel=1e-12)


@pytest.mark.parametrize("p", [3, 4, 6, 8])
def test_volume_is_that_of_the_hull_of_all_vertices(rng: np.random.Generator, p: int) -> None:
    generators = rng.normal(size=(5, 3, p))
    hulls = [ConvexHull(vertices(g)).volume for g in generators]
    np.testing.assert_allclose(zonotope.volume(generators), hulls, rtol=1e-10)


@pytest.mark.parametrize("p", [0, 1, 2])
def test_fewer_than_three_generators_have_no_volume(rng: np.random.Generator, p: int) -> None:
    np.testing.assert_array_equal(zonotope.volume(rng.normal(size=(4, 3, p))), np.zeros(4))


@pytest.mark.parametrize("kind", ["general", "in a plane", "parallel", "zeros", "needle", "all zero"])
@pytest.mark.parametrize("p", [3, 5, 8])
def test_degenerate_volumes(rng: np.random.Generator, kind: str, p: int) -> None:
    g = _degenerate(rng, p)[kind]
    scale = np.prod(np.abs(g).sum(axis=1).clip(1e-12)) if kind == "needle" else 1.0
    assert zonotope.volume(g[None])[0] == pytest.approx(triple_sum(g), rel=1e-9, abs=1e-14 * scale)


@pytest.mark.parametrize("kind", ["general", "in a plane", "parallel", "zeros", "needle", "all zero"])
@pytest.mark.parametrize("p", [1, 2, 3, 5, 10])
def test_largest_deviation_is_that_of_every_vector_of_signs(rng: np.random.Generator, kind: str, p: int) -> None:
    g = np.stack([_degenerate(rng, p)[kind] for _ in range(6)])
    brute = [np.linalg.norm(vertices(one), axis=1).max() for one in g]
    np.testing.assert_allclose(zonotope.largest_deviation(g), brute, rtol=1e-12, atol=1e-15)


def test_largest_deviation_of_collinear_generators(rng: np.random.Generator) -> None:
    direction = np.array([1.0, 2.0, 2.0]) / 3
    lengths = rng.uniform(-1, 1, 6)
    g = (direction[:, None] * lengths)[None]
    assert zonotope.largest_deviation(g)[0] == pytest.approx(np.abs(lengths).sum(), rel=1e-12)
    assert zonotope.largest_deviation(np.eye(3)[None])[0] == pytest.approx(np.sqrt(3.0))
    assert zonotope.largest_deviation(np.zeros((1, 3, 0)))[0] == 0.0


def test_largest_deviation_with_repeated_whole_numbers(rng: np.random.Generator) -> None:
    """Small integers make many generators lie exactly in the plane of two others."""
    g = rng.integers(-1, 2, size=(200, 3, 8)).astype(float)
    brute = [np.linalg.norm(vertices(one), axis=1).max() for one in g]
    np.testing.assert_allclose(zonotope.largest_deviation(g), brute, rtol=1e-12)


def test_largest_deviation_bounds_the_support(rng: np.random.Generator) -> None:
    g = rng.normal(size=(300, 3, 12))
    d = rng.normal(size=(4000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    support = zonotope.support(g, d).max(axis=1)
    largest = zonotope.largest_deviation(g)
    assert (support <= largest * (1 + 1e-12)).all()
    assert (support > 0.99 * largest).all()


def test_support_is_the_farthest_vertex(rng: np.random.Generator) -> None:
    g = rng.normal(size=(4, 3, 9))
    d = rng.normal(size=(7, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    brute = [[(vertices(one) @ direction).max() for direction in d] for one in g]
    np.testing.assert_allclose(zonotope.support(g, d), brute, rtol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        lambda g: g[:, :, ::-1],
        lambda g: g * np.array([1, -1, 1, -1, -1, 1, 1.0]),
        lambda g: np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0] @ g,
        lambda g: np.array([[1, 0.7, -3], [0, 1, 5], [0, 0, 1]]) @ g,
        lambda g: np.concatenate([g[:, :, :1] / 3, g[:, :, 1:], g[:, :, :1] * 2 / 3], axis=2),
        lambda g: np.concatenate([g, np.zeros((len(g), 3, 2))], axis=2),
    ],
    ids=["order", "signs", "rotation", "shear", "a generator in two parts", "zeros"],
)
def test_volume_does_not_change(rng: np.random.Generator, change: Callable[[Array], Array]) -> None:
    g = rng.normal(size=(20, 3, 7))
    np.testing.assert_allclose(zonotope.volume(change(g)), zonotope.volume(g), rtol=1e-11)


def test_volume_scales_with_the_cube(rng: np.random.Generator) -> None:
    g = rng.normal(size=(3, 3, 6))
    np.testing.assert_allclose(zonotope.volume(1e-6 * g), 1e-18 * zonotope.volume(g), rtol=1e-12)


def test_nothing_in_nothing_out() -> None:
    empty = np.empty((0, 3, 5))
    assert zonotope.volume(empty).shape == (0,)
    assert zonotope.largest_deviation(empty).shape == (0,)


def test_the_generators_stay_as_they_were(rng: np.random.Generator) -> None:
    g = rng.normal(size=(5, 3, 6))
    before = g.copy()
    zonotope.volume(g)
    zonotope.largest_deviation(g)
    zonotope.support(g, np.eye(3))
    np.testing.assert_array_equal(g, before)
