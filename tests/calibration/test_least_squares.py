"""The least-squares kernel against ``numpy.linalg`` and explicit covariances."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.calibration.least_squares import (
    LinearModel,
    Prior,
    bounded_step,
    inverse_of_factor,
    lower_factor,
    normal_solution,
    remaining_triangle,
    solve_lower,
)
from tests.oracle import close

pytestmark = pytest.mark.fast

SCALES = np.array([1.0, 1e-3, 1e3, 1.0, 10.0])


def model_of(rng: np.random.Generator, alike: float = 1.0, rows: int = 30) -> LinearModel:
    """Of five parameters, the last without prior and the fourth with one that nobody stated; two
    columns alike but for a part.
    """
    columns = rng.normal(size=(rows, 5)) / SCALES
    columns[:, 3] = columns[:, 0] + alike * columns[:, 3]
    prior = np.hstack([np.eye(4, 5), rng.normal(size=(4, 1))])
    stated = prior.copy()
    stated[:, 3] = 0.0
    measured = np.column_stack([columns, rng.normal(size=rows)])
    return LinearModel(measured, Prior(prior, SCALES, stated))


def together(model: LinearModel) -> tuple[np.ndarray, np.ndarray]:
    """All rows, prior included, and their residual, in units of the scales."""
    rows = np.concatenate([model.jacobian * SCALES, model.prior.rows[:, :-1]])
    return rows, np.append(model.residual, model.prior.rows[:, -1])


@pytest.mark.parametrize("alike", [1.0, 1e-8])
def test_solution_and_covariance(rng, alike):
    """By normal equations; and by singular values, where the prior alone tells a difference."""
    model = model_of(rng, alike)
    if alike < 1.0:
        model.prior.rows[[0, 3]] *= 1e-8
    rows, residual = together(model)
    assert (model.normal is None) == (alike < 1.0)
    step = np.linalg.lstsq(rows, -residual, rcond=None)[0]
    tolerance = 1e-9 if alike == 1.0 else 1e-5
    np.testing.assert_allclose(model.solution.best, step, rtol=tolerance)
    left = np.square(residual + rows @ step).sum()
    close(model.cost - model.solution.reduction, left, 1e-9 * model.cost)
    covariance = np.linalg.inv(rows.T @ rows) if alike == 1.0 else np.linalg.pinv(rows)
    covariance = covariance if alike == 1.0 else covariance @ covariance.T
    covariance = covariance * SCALES * SCALES[:, None]
    steps = model.independent_steps
    np.testing.assert_allclose(steps @ steps.T, covariance, rtol=10 * tolerance, atol=1e-12)
    np.testing.assert_allclose(
        model.covariance(np.zeros((5, 0))), covariance, rtol=10 * tolerance, atol=1e-12
    )
    np.testing.assert_allclose(model.lengths, np.linalg.norm(rows, axis=0), rtol=1e-12)


@pytest.mark.parametrize("alike", [1.0, 1e-8])
def test_a_step_in_a_trust_region(rng, alike):
    """The whole one, or as long as the radius, where no other of that length lowers χ² more."""
    model = model_of(rng, alike)
    rows, residual = together(model)
    units = model.lengths
    whole = bounded_step(model, units, np.inf)
    np.testing.assert_allclose(whole.parameters / SCALES, model.solution.best, rtol=1e-4)
    assert whole.reduction == pytest.approx(whole.full_reduction)
    step = bounded_step(model, units, 0.3 * whole.length)
    assert step.length == pytest.approx(0.3 * whole.length, rel=1e-2)
    assert step.full_reduction == whole.full_reduction

    def lowered(x: np.ndarray) -> float:
        return float(residual @ residual - np.square(residual + rows @ x).sum())

    best = step.parameters / SCALES
    assert step.reduction == pytest.approx(lowered(best))
    for _ in range(20):
        other = best + 0.1 * rng.normal(size=5) * np.abs(best)
        other *= step.length / np.linalg.norm(other * units)
        assert lowered(other) <= step.reduction * (1.0 + 1e-3)


def test_leverage_and_parameters_that_the_rows_determine(rng):
    model = model_of(rng)
    rows, _ = together(model)
    hat = rows @ np.linalg.pinv(rows)
    share = model.jacobian @ model.independent_steps
    close(share @ share.T, hat[:30, :30], 1e-12)
    assert model.determined == pytest.approx(np.trace(hat[:30, :30]))


def test_directions_of_which_nothing_is_known(rng):
    """What two equal columns differ in, along which nothing is stated but of the first, which is
    held; one row leaves the column without a prior.
    """
    model = model_of(rng, alike=0.0)
    model.prior.stated[0] = 0.0
    (direction,) = model.unknown.T
    wanted = (np.eye(5)[0] / SCALES[0] - np.eye(5)[3] / SCALES[3]) / np.sqrt(2.0)
    close(direction * np.sign(direction[0]), wanted, 1e-9)
    close(direction / SCALES @ model.covariance(model.unknown), 0.0, 1e-12)
    (alone,) = model_of(rng, rows=0).unknown.T[1:]
    close(np.abs(alone[[0, 1, 2]]), 0.0, 1e-12)


def test_the_triangle_of_many_rows_is_that_of_all(rng, monkeypatch):
    model = model_of(rng)
    monkeypatch.setattr("aacmm_pin.calibration.least_squares.ROWS_AT_ONCE", 7)
    rows, residual = together(model)
    every = np.column_stack([rows, residual])
    close(model.triangle.T @ model.triangle, every.T @ every, 1e-9)


def test_normal_equations_give_way(rng):
    """None where columns are nearly the same, or where one is nothing."""
    rows, residual = rng.normal(size=(30, 4)) * [1.0, 1e3, 1e-3, 1.0], rng.normal(size=30)
    solved = normal_solution(rows.T @ rows, rows.T @ residual)
    assert solved is not None
    np.testing.assert_allclose(
        solved.best, np.linalg.lstsq(rows, -residual, rcond=None)[0], rtol=1e-9
    )
    for last in (rows[:, 0] + 1e-7 * rows[:, 3], 0.0 * residual):
        rows[:, 3] = last
        assert normal_solution(rows.T @ rows, rows.T @ residual) is None


def test_schur_complement(rng):
    for m in (30, 4):
        rows = rng.normal(size=(m, 6))
        found = remaining_triangle(rows, 2)
        gram = rows.T @ rows
        eliminated = gram[2:, :2] @ np.linalg.solve(gram[:2, :2], gram[:2, 2:])
        close(found.T @ found, gram[2:, 2:] - eliminated, 1e-10)


def test_factors(rng):
    """Of a matrix, and of one that is positive definite only to within rounding."""
    rows = rng.normal(size=(30, 4))
    matrix = rows.T @ rows
    factor = lower_factor(matrix, np.diag(matrix))
    np.testing.assert_allclose(factor, np.linalg.cholesky(matrix), rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(inverse_of_factor(factor), np.linalg.inv(matrix), rtol=1e-9)
    assert inverse_of_factor(np.zeros((0, 0))).shape == (0, 0)
    np.testing.assert_allclose(solve_lower(factor, rows.T), np.linalg.solve(factor, rows.T))
    rows[:, 3] = rows[:, 0]
    singular = rows.T @ rows - 1e-13 * np.eye(4)
    factor = lower_factor(singular, np.diag(singular))
    close(factor @ factor.T, singular, 1e-6)
