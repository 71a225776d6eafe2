"""Single-point statistics (eqs. 16-19) against numpy and against the identity that ties them together."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.accuracy.single_point import single_point_statistics
from aacmm_pin.errors import ShapeError


@pytest.mark.parametrize("n", [2, 3, 12, 50])
def test_sigma_is_that_of_numpy(rng: np.random.Generator, n: int) -> None:
    points = 0.5 + 3e-5 * rng.normal(size=(n, 3))
    result = single_point_statistics(points)
    assert result.sigma == pytest.approx(np.sqrt(points.var(axis=0, ddof=1).sum()), rel=1e-12)
    assert (result.n, result.part_n) == (n, 0)
    assert np.isnan(result.part)
    assert np.isnan(result.rest)


@pytest.mark.parametrize("n", [5, 50])
def test_parts_add_up_to_the_whole(rng: np.random.Generator, n: int) -> None:
    """(n - 1) σ² = g ψ_g² + (n - g) ψ_r²: both parts are judged by the mean of all records."""
    points = rng.normal(size=(n, 3)) * [1e-5, 3e-5, 2e-4] + [0.1, -0.7, 0.2]
    for g in range(1, n):
        part = np.zeros(n, dtype=bool)
        part[rng.choice(n, g, replace=False)] = True
        result = single_point_statistics(points, part)
        assert result.part_n == g
        whole = (n - 1) * result.sigma**2
        assert g * result.part**2 + (n - g) * result.rest**2 == pytest.approx(whole, rel=1e-12)
        squares = np.linalg.norm(points - points.mean(axis=0), axis=1) ** 2
        assert result.part == pytest.approx(np.sqrt(squares[part].mean()), rel=1e-12)


def test_by_hand() -> None:
    """Distances 1, 1, 2, 2 from the mean: σ² = 10/3, ψ of the first two 1, of the others 2."""
    points = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]])
    result = single_point_statistics(points, [True, True, False, False])
    assert result.sigma == pytest.approx(np.sqrt(10 / 3))
    assert (result.part, result.rest) == (pytest.approx(1.0), pytest.approx(2.0))


def test_empty_and_whole_parts(rng: np.random.Generator) -> None:
    points = rng.normal(size=(6, 3))
    rms = np.sqrt(5 / 6) * single_point_statistics(points).sigma
    none, every = single_point_statistics(points, np.zeros(6, bool)), single_point_statistics(points, np.ones(6, bool))
    assert np.isnan(none.part)
    assert none.rest == pytest.approx(rms)
    assert every.part == pytest.approx(rms)
    assert np.isnan(every.rest)


def test_equal_records_have_no_spread() -> None:
    result = single_point_statistics(np.tile([0.25, -0.5, 0.125], (7, 1)), np.arange(7) < 3)
    assert (result.sigma, result.part, result.rest) == (0.0, 0.0, 0.0)


def test_a_shift_and_an_order_change_nothing(rng: np.random.Generator) -> None:
    points = 1e-5 * rng.normal(size=(30, 3))
    part = rng.random(30) < 0.4
    order = rng.permutation(30)
    one, other = (
        single_point_statistics(points, part),
        single_point_statistics((points + np.array([1, 2, -3]))[order], part[order]),
    )
    for name in ("sigma", "part", "rest"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9)


@pytest.mark.parametrize(
    ("points", "part", "words"),
    [
        (np.zeros((1, 3)), None, "1 records, expected at least 2"),
        (np.empty((0, 3)), None, "0 records"),
        (np.zeros(3), None, r"indications\[None, :\]"),
        (np.zeros((4, 2)), None, r"\(4, 2\)"),
        ([[0, 0, 0], [0, np.nan, 0]], None, r"indications\[1, 1\] is nan"),
        (np.zeros((3, 3)), [1, 0, 1], "boolean"),
        (np.zeros((3, 3)), [True, False], r"\(2,\)"),
        (np.zeros((3, 3)), [[True, False, True]], r"\(1, 3\)"),
    ],
)
def test_what_cannot_be_used(points: object, part: object, words: str) -> None:
    with pytest.raises(ShapeError, match=words):
        single_point_statistics(points, part)


def test_says_what_it_found() -> None:
    points = np.array([[1e-5, 0, 0], [-1e-5, 0, 0], [0, 2e-5, 0], [0, -2e-5, 0]])
    assert str(single_point_statistics(points)) == "4 records, spread 0.0183 mm"
    text = str(single_point_statistics(points, [True, True, False, False]))
    assert "part (2) 0.0100 mm, rest 0.0200 mm" in text
