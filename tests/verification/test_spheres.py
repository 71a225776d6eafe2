"""Spheres against brute force, and against those from which points were made."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin.errors import AacmmError, ShapeError
from aacmm_pin.verification.spheres import fitted_sphere, smallest_sphere

pytestmark = pytest.mark.fast


def by_brute_force(points: Array) -> float:
    """Smallest diameter of those of all pairs, triples and quadruples that have every point
    inside.
    """
    found = [0.0] if np.ptp(points, axis=0).max() == 0 else []
    for count in (2, 3, 4):
        for chosen in combinations(points, count):
            edges = np.array(chosen[1:]) - chosen[0]
            gram = edges @ edges.T  # the centre is chosen[0] + Σ w edge
            if np.linalg.matrix_rank(gram, tol=1e-9 * np.trace(gram)) < count - 1:
                continue
            offset = np.linalg.solve(2 * gram, np.diag(gram)) @ edges
            radius = float(np.linalg.norm(offset))
            if np.all(np.linalg.norm(points - chosen[0] - offset, axis=1) <= radius * (1 + 1e-9)):
                found.append(2 * radius)
    return min(found)


def test_smallest_sphere_is_that_of_brute_force():
    rng = np.random.default_rng(5)
    for number in range(400):
        points = rng.normal(size=(rng.integers(2, 8), 3)) * 10.0 ** rng.integers(-5, 0)
        # In a plane, on a line, in a few places, on a grid with many on one sphere.
        if number % 5 == 1:
            points[:, 2] = 0
        elif number % 5 == 2:
            points = points[:, :1] * np.array([[1.0, 2.0, -1.0]])
        elif number % 5 == 3:
            points = points[rng.integers(0, 2, size=6)]
        elif number % 5 == 4:
            points = rng.integers(0, 2, size=points.shape) * 1e-3
        center, radius = smallest_sphere(points)
        assert 2 * radius == pytest.approx(by_brute_force(points), rel=1e-8, abs=1e-15), points
        assert np.linalg.norm(points - center, axis=1).max() <= radius * (1 + 1e-8) + 1e-15


def test_fitted_sphere():
    rng = np.random.default_rng(2)
    for _ in range(50):
        center, radius, form = rng.normal(size=3), rng.uniform(5e-3, 0.05), 1e-5
        directions = rng.normal(size=(25, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        exact = fitted_sphere(center + radius * directions)
        assert exact.diameter == pytest.approx(2 * radius, rel=1e-10)
        assert exact.center == pytest.approx(center, abs=1e-12)
        assert exact.form < 1e-12
        rough = center + (radius + rng.uniform(-form / 2, form / 2, size=(25, 1))) * directions
        found = fitted_sphere(rough)
        distance = np.linalg.norm(rough - found.center, axis=1)
        assert found.form == pytest.approx(np.ptp(distance), rel=1e-9)
        # At a least-squares sphere radial residuals have no mean and no moment along any direction.
        residual = distance - found.diameter / 2
        outward = (rough - found.center) / distance[:, None]
        assert abs(residual.mean()) < 1e-13
        assert np.abs(residual @ outward).max() < 1e-11
        design = np.column_stack([outward, np.ones(25)])
        covariance = np.linalg.inv(design.T @ design)  # where the noise along radii is one
        assert found.diameter_factor == pytest.approx(2 * np.sqrt(covariance[3, 3]), rel=1e-9)
        hat = design @ covariance @ design.T
        np.testing.assert_allclose(found.leverages, np.diag(hat), rtol=1e-9)


def test_points_without_a_sphere():
    with pytest.raises(ShapeError, match="at least 4"):
        fitted_sphere(np.eye(3))
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 2.0, 0]])
    for away in (0.0, 3.0):
        with pytest.raises(AacmmError, match="plane"):
            fitted_sphere(flat + away)
    assert fitted_sphere([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]]).diameter == pytest.approx(
        2 * np.sqrt(3)
    )
