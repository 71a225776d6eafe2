"""Weights of eq. 15, the comprehensive accuracy and single-point statistics (eqs. 16-19), by hand
and against numpy.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from aacmm_pin.accuracy.comprehensive_accuracy import (
    comprehensive_accuracy,
    configuration_weights,
    preferred_theta3,
)
from aacmm_pin.accuracy.single_point import single_point_statistics
from aacmm_pin.errors import ShapeError
from tests.oracle import close

pytestmark = pytest.mark.fast

LEVEL = np.array([0.6, -0.8, 0.0])  # on the horizon: theta3k is a right angle


def test_weights_by_hand():
    """x = 90°, 60°, 0°, 30° from the preferred 90°; Σx = 180°; c = (1 - x/180°)/3."""
    theta3 = np.radians([0.0, -150.0, 90.0, 120.0])
    expected = np.array([1 - 90 / 180, 1 - 60 / 180, 1.0, 1 - 30 / 180]) / 3
    np.testing.assert_allclose(configuration_weights(theta3, LEVEL), expected, rtol=1e-14)
    volumes = np.array([4.0, 3.0, 1.0, 2.0])
    assert comprehensive_accuracy(volumes, theta3, LEVEL) == pytest.approx(
        (4 * 3 + 3 * 4 + 1 * 6 + 2 * 5) / 18, rel=1e-14
    )
    np.testing.assert_array_equal(configuration_weights(np.array([2.0]), LEVEL), [1.0])
    close(configuration_weights(np.radians([90.0, 0.0]), LEVEL), [1.0, 0.0], 1e-15)
    np.testing.assert_allclose(
        configuration_weights(np.radians([60.0, 0.0]), LEVEL), [0.75, 0.25], rtol=1e-14
    )
    assert comprehensive_accuracy(np.array([7.0]), np.array([1.0]), LEVEL) == 7.0
    assert configuration_weights(np.empty(0), LEVEL).shape == (0,)
    assert np.isnan(comprehensive_accuracy(np.empty(0), np.empty(0), LEVEL))


def test_the_elevation_sets_the_preferred_angle():
    """z is drawn downward in the paper: a point 45° above the horizon of the base prefers 45°, one
    below 135°.
    """
    points = np.array([LEVEL, [0.3, 0.4, 0.5], [0.3, 0.4, -0.5], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    expected = np.radians([90, 45, 135, 0, 180])
    close([preferred_theta3(point) for point in points], expected, 1e-15)


# --- one point


def test_parts_add_up_to_the_whole(rng):
    """(n - 1) σ² = g ψ_g² + (n - g) ψ_r²: both parts are judged by the mean of all records."""
    for n in (2, 5, 50):
        points = rng.normal(size=(n, 3)) * [1e-5, 3e-5, 2e-4] + [0.1, -0.7, 0.2]
        alone = single_point_statistics(points)
        assert alone.sigma == pytest.approx(np.sqrt(points.var(axis=0, ddof=1).sum()), rel=1e-9)
        for g in range(1, n):
            part = rng.permutation(n) < g
            result = single_point_statistics(points, part)
            parts = g * result.part**2 + (n - g) * result.rest**2
            assert parts == pytest.approx((n - 1) * result.sigma**2, rel=1e-12, abs=0.0)
            squares = np.linalg.norm(points - points.mean(axis=0), axis=1) ** 2
            assert result.part == pytest.approx(np.sqrt(squares[part].mean()), rel=1e-12)
        none = single_point_statistics(points, np.zeros(n, dtype=bool))
        assert np.isnan(none.part)
        assert none.rest == pytest.approx(np.sqrt((n - 1) / n) * alone.sigma)


def test_a_point_by_hand():
    """Distances 1, 1, 2, 2 from the mean: σ² = 10/3, ψ of the first two 1, of the others 2."""
    points = 1e-5 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]])
    result = single_point_statistics(points, [True, True, False, False])
    assert result.sigma == pytest.approx(1e-5 * np.sqrt(10 / 3))
    assert (result.part, result.rest) == (pytest.approx(1e-5), pytest.approx(2e-5))
    assert re.findall(r"0\.\d+ mm", str(result)) == ["0.0183 mm", "0.0100 mm", "0.0200 mm"]
    assert re.findall(r"0\.\d+ mm", str(single_point_statistics(points))) == ["0.0183 mm"]


def test_what_cannot_be_used():
    three = np.zeros((3, 3))
    for points, part, words in (
        (np.zeros((1, 3)), None, "1 records; expected at least 2"),
        ([[0, 0, 0], [0, np.nan, 0]], None, r"indications\[1, 1\] is nan"),
        (three, [1, 0, 1], "boolean"),
        (three, [True, False], r"\(2,\)"),
    ):
        with pytest.raises(ShapeError, match=words):
            single_point_statistics(points, part)
