"""Patterns of spread, their evidence, and parts of records: against hand calculations, quadrature
and brute force.
"""

from __future__ import annotations

import numpy as np
import pytest
from papers.sino6_table3.evidence import evidence
from papers.sino6_table3.patterns import (
    Pattern,
    of_encoder_noise,
)
from papers.sino6_table3.selection_bias import from_mean, log_ratios
from papers.sino6_table3.simulated_touches import TouchedSeats
from scipy.integrate import quad
from scipy.stats import chi2, norm

from aacmm_pin.effects import ErrorModel
from tests.arm_files import by_table

pytestmark = pytest.mark.fast

N = 40


def planar(*lengths: float) -> ErrorModel:
    """An arm in the plane with a joint before each of these lengths [m]."""
    return ErrorModel.of(by_table("planar", [(1e3 * a, 0.0, 0.0, 0.0) for a in lengths], 400.0))


def full_turn(n: int = N) -> np.ndarray:
    return 2 * np.pi * np.arange(n)[:, None] / n - np.pi


def simple(log_spreads: np.ndarray, sd: float = 0.1, **kwargs: object) -> Pattern:
    """A pattern with these logarithms of spreads, whose own sampling error is ``sd``."""
    second = np.exp(2 * np.atleast_2d(log_spreads))
    return Pattern(second, second**2 * (1 + 4 * N * sd**2), N, **kwargs)


def at_one_seat(model: ErrorModel, q: np.ndarray | None = None) -> TouchedSeats:
    return TouchedSeats(model, (full_turn() if q is None else q)[None])


# Patterns: one joint, known
# lever ------------------------------------------------------------


def test_noise_of_one_joint_is_noise_times_lever():
    pattern = of_encoder_noise(at_one_seat(planar(0.8)))
    np.testing.assert_allclose(np.sqrt(pattern.second), 0.8, rtol=1e-12)
    # One normal component: m₄ = 3 m₂², so the logarithm of a spread from n records is uncertain by
    # 1/√(2n).
    np.testing.assert_allclose(pattern.log_sd, 1 / np.sqrt(2 * N), rtol=1e-12)
    q = np.array([[0.1, 0.0], [0.4, np.pi / 2], [1.0, np.pi]])
    pattern = of_encoder_noise(at_one_seat(planar(0.5, 0.3), q), weights=np.array([[2.0, 1.0]]))
    first = np.array([0.8, np.hypot(0.5, 0.3), 0.2])  # distance from the base axis
    assert pattern.second[0, 0] == pytest.approx(np.mean(4 * first**2 + 0.3**2), rel=1e-12)


# Evidence ------------------------------------------------------------


@pytest.mark.parametrize("sizes", [(0.1, 10.0), (0.5, 0.9), (2.0, 2.0)])
def test_evidence_against_quadrature(sizes):
    rng = np.random.default_rng(6)
    logs, y, tau = (
        np.log(2e-5) + 0.4 * rng.normal(size=(3, 4)),
        np.log(3e-5) + 0.2 * rng.normal(size=4),
        0.2,
    )
    found = evidence(simple(logs, sizes=sizes), np.exp(y), tau)
    sd = np.hypot(0.1, tau)
    low, high = np.log(sizes)

    def at(u: float, draw: int) -> float:
        return float(np.exp(norm.logpdf(y, u + logs[draw], sd).sum()))

    if low == high:
        each = [at(low, d) for d in range(3)]
    else:
        each = [
            quad(at, low, high, args=(d,), epsabs=1e-12, limit=200)[0] / (high - low)
            for d in range(3)
        ]
    assert found.log_evidence == pytest.approx(np.log(np.mean(each)), abs=1e-6)
    np.testing.assert_allclose(found.weights, np.array(each) / np.sum(each), rtol=1e-5)


def test_parts_are_judged_by_the_mean_of_all(rng):
    positions = rng.normal(size=(1, 1, 30, 3))
    order = rng.permutation(30)
    distance = np.linalg.norm(positions[0, 0] - positions[0, 0].mean(axis=0), axis=1)
    part, rest = np.square(distance[order[:11]]).mean(), np.square(distance[order[11:]]).mean()
    squares = np.square(from_mean(positions)).sum(axis=3)
    assert log_ratios(squares, order[None], [11])[0, 0] == pytest.approx(
        np.log(part / rest) / 2, rel=1e-12
    )


def test_smallest_deviations_against_the_chi_square_law(rng):
    """Of many normal records the mean square of the nearest share f is 3 F₅(q)/f, q the f-quantile
    of χ²₃.
    """
    share = 0.4
    inside = 3 * chi2.cdf(chi2.ppf(share, 3), 5)
    expected = 0.5 * np.log(inside / share / ((3 - inside) / (1 - share)))
    squares = np.square(from_mean(rng.normal(size=(20, 1, 5000, 3)))).sum(axis=3)
    assert log_ratios(squares, counts=[int(share * 5000)]).mean() == pytest.approx(
        expected, abs=0.01
    )
