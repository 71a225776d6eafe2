"""Weights of eq. 15 and the comprehensive accuracy, against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.accuracy.comprehensive import comprehensive_accuracy, configuration_weights, preferred_theta3

LEVEL = np.array([0.6, -0.8, 0.0])  # on the horizon: theta3k is a right angle


@pytest.mark.parametrize("n", [1, 2, 3, 12, 50])
def test_weights_sum_to_one_and_are_not_negative(rng: np.random.Generator, n: int) -> None:
    for _ in range(20):
        weights = configuration_weights(rng.uniform(-20, 20, n), rng.normal(size=3))
        assert weights.shape == (n,)
        assert weights.sum() == pytest.approx(1.0, abs=1e-14)
        assert (weights >= 0).all()


def test_example_by_hand() -> None:
    """x = 90°, 60°, 0°, 30° from the preferred 90°; Σx = 180°; c = (1 - x/180°)/3."""
    theta3 = np.radians([0.0, -150.0, 90.0, 120.0])
    expected = np.array([1 - 90 / 180, 1 - 60 / 180, 1.0, 1 - 30 / 180]) / 3
    np.testing.assert_allclose(configuration_weights(theta3, LEVEL), expected, rtol=1e-14)
    volumes = np.array([4.0, 3.0, 1.0, 2.0])
    assert comprehensive_accuracy(volumes, theta3, LEVEL) == pytest.approx((4 * 3 + 3 * 4 + 1 * 6 + 2 * 5) / 18, rel=1e-14)


def test_the_elevation_sets_the_preferred_angle() -> None:
    """z is drawn downward in the paper: a point 45° above the horizon of the base prefers 45°, one below 135°."""
    assert preferred_theta3(LEVEL) == pytest.approx(np.pi / 2)
    assert preferred_theta3(np.array([0.3, 0.4, 0.5])) == pytest.approx(np.pi / 4)
    assert preferred_theta3(np.array([0.3, 0.4, -0.5])) == pytest.approx(3 * np.pi / 4)
    assert preferred_theta3(np.array([0.0, 0.0, 1.0])) == pytest.approx(0.0)
    assert preferred_theta3(np.array([0.0, 0.0, -1.0])) == pytest.approx(np.pi)


def test_mirror_images_and_whole_turns_weigh_the_same(rng: np.random.Generator) -> None:
    theta3, point = rng.uniform(-np.pi, np.pi, 12), rng.normal(size=3)
    weights = configuration_weights(theta3, point)
    np.testing.assert_allclose(configuration_weights(-theta3, point), weights, atol=1e-14)
    np.testing.assert_allclose(
        configuration_weights(theta3 + 2 * np.pi * rng.integers(-3, 4, 12), point), weights, atol=1e-13
    )


def test_nearer_to_the_preferred_angle_is_heavier(rng: np.random.Generator) -> None:
    theta3, point = rng.uniform(0, np.pi, 9), np.array([0.5, 0.1, 0.2])
    away = np.abs(theta3 - preferred_theta3(point))
    np.testing.assert_array_equal(np.argsort(configuration_weights(theta3, point)), np.argsort(-away))


def test_one_and_two_configurations() -> None:
    np.testing.assert_array_equal(configuration_weights(np.array([2.0]), LEVEL), [1.0])
    np.testing.assert_allclose(configuration_weights(np.radians([90.0, 0.0]), LEVEL), [1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(configuration_weights(np.radians([60.0, 0.0]), LEVEL), [0.75, 0.25], rtol=1e-14)
    assert comprehensive_accuracy(np.array([7.0]), np.array([1.0]), LEVEL) == 7.0


@pytest.mark.parametrize("n", [2, 3, 12])
@pytest.mark.parametrize("theta3", [np.pi / 2, 0.3, -np.pi / 2])
def test_equal_configurations_weigh_the_same(n: int, theta3: float) -> None:
    np.testing.assert_allclose(configuration_weights(np.full(n, theta3), LEVEL), np.full(n, 1 / n), rtol=1e-12)


def test_twelve_weights_differ_little(rng: np.random.Generator) -> None:
    ratios = []
    for _ in range(50):
        weights = configuration_weights(np.linspace(-np.pi, np.pi, 12, endpoint=False), rng.normal(size=3))
        ratios.append(weights.max() / weights.min())
    assert min(ratios) > 1.05
    assert max(ratios) < 1.25


def test_accuracy_of_equal_volumes_is_theirs(rng: np.random.Generator) -> None:
    assert comprehensive_accuracy(np.full(9, 3e-12), rng.uniform(-3, 3, 9), LEVEL) == pytest.approx(3e-12, rel=1e-12)


def test_accuracy_lies_between_best_and_worst(rng: np.random.Generator) -> None:
    volumes = rng.uniform(1, 5, 12)
    assert volumes.min() < comprehensive_accuracy(volumes, rng.uniform(-3, 3, 12), LEVEL) < volumes.max()


def test_no_configuration() -> None:
    assert configuration_weights(np.empty(0), LEVEL).shape == (0,)
    assert np.isnan(comprehensive_accuracy(np.empty(0), np.empty(0), LEVEL))
