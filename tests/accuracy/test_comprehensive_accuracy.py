"""Weights of eq. 15 and the comprehensive accuracy, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.accuracy.comprehensive_accuracy import (
    comprehensive_accuracy,
    configuration_weights,
    preferred_theta3,
)
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
