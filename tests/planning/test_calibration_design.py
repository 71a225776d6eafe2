"""Plans for a calibration, beside every choice that there is, and beside calibrations of many
virtual arms.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from aacmm_pin import Measurements, plan_calibration
from aacmm_pin.arm.random_postures import Room
from aacmm_pin.errors import AacmmError
from aacmm_pin.planning.calibration_design import EXCHANGE_ROUNDS
from aacmm_pin.planning.optimal_design import chosen_records, d_optimality

U_READING, U_REFERENCE = 8e-6, 1.2e-5
NOISE: dict[str, Any] = {"encoder_noise": U_READING, "reference_noise": U_REFERENCE}


def test_exchanges_find_the_best_of_all_choices(rng):
    """Of 495 choices of 4 among 12: the best one, or within 1 % of its determinant's root, in 20
    small problems.
    """
    best = []
    for _ in range(20):
        rows, start = rng.normal(size=(12, 3, 6)), 0.1 * np.eye(6)

        def worth(chosen: Any, rows: np.ndarray = rows, start: np.ndarray = start) -> float:
            return float(
                np.linalg.slogdet(
                    start + np.einsum("nij,nik->jk", rows[[*chosen]], rows[[*chosen]])
                )[1]
            )

        every = [worth(chosen) for chosen in combinations(range(12), 4)]
        score = d_optimality(rows)
        found = worth(chosen_records(rows, start, range(4), score, EXCHANGE_ROUNDS))
        assert np.mean(np.array(every) > found + 1e-9) < 0.02
        best.append(found > max(every) - 6 * 0.01)
    assert np.mean(best) >= 0.7


def test_o1_and_u_are_those_of_dense_algebra(sino6):
    plan = plan_calibration(sino6, 15, postures=60, **NOISE)
    q, u = plan.measurements.q, np.array([p.u for p in sino6.parameters])
    sensitivity, jacobian = sino6.sensitivity(q)[:, :, u > 0] * u[u > 0], sino6.jacobian(q)
    noise = U_READING**2 * jacobian @ jacobian.transpose(0, 2, 1) + U_REFERENCE**2 * np.eye(3)
    white = np.linalg.solve(np.linalg.cholesky(noise), sensitivity).reshape(45, -1)
    values = np.linalg.svd(white, compute_uv=False)
    values = values[values > 1e-9 * values[0]]
    assert plan.o1 == pytest.approx(np.exp(np.log(values).mean()) / np.sqrt(15), rel=1e-6)
    assert plan.ratio > 1.05
    covariance = np.linalg.inv(white.T @ white + np.eye(white.shape[1]))
    pool, _ = Room(sino6).postures(4000, np.random.default_rng(2))
    tips = sino6.sensitivity(pool)[:, :, u > 0] * u[u > 0]
    over_pool = np.sqrt(np.einsum("nij,jk,nik->n", tips, covariance, tips).mean())
    assert plan.u == pytest.approx(over_pool, rel=0.1)


def test_seats_frames_and_existing_records(sino6):
    q, tips = Room(sino6).postures(10, np.random.default_rng(1))
    existing = Measurements.of(q, tips)
    for options in (
        {"scheme": "seats"},
        {"reference_frame": "external"},
        {"existing": existing},
        {"prior": False},
    ):
        plan = plan_calibration(sino6, 12, postures=120, **NOISE, **options)  # type: ignore[arg-type]
        assert plan.ratio > 1.0, options
        assert plan.u < np.median(plan.u_random) * 1.02, options
        assert len(plan.records) == 12
        assert plan.existing == (10 if "existing" in options else 0)


@pytest.mark.parametrize("frame", ["base", "external"])
def test_an_arm_that_is_exact_leaves_nothing_to_calibrate(sino6, frame):
    exact = replace(
        sino6, parameters=tuple(replace(p, u=0.0, half_width=0.0) for p in sino6.parameters)
    )
    with pytest.raises(AacmmError, match="exact"):
        plan_calibration(exact, 3, reference_frame=frame, postures=50)


def test_arms_calibrated_with_the_plan_are_nearer_to_the_truth(sino6):
    """Least squares on drawn arms and noise, 2000 times each: what planned and random records
    leave.
    """
    plan = plan_calibration(sino6, 12, postures=400, **NOISE)
    rng, u = np.random.default_rng(7), np.array([p.u for p in sino6.parameters])
    new = sino6.sensitivity(Room(sino6).postures(500, rng)[0])[:, :, u > 0] * u[u > 0]

    def left(q: np.ndarray) -> tuple[float, float]:
        sensitivity, jacobian = sino6.sensitivity(q)[:, :, u > 0] * u[u > 0], sino6.jacobian(q)
        noise = U_READING**2 * jacobian @ jacobian.transpose(0, 2, 1) + U_REFERENCE**2 * np.eye(3)
        white = np.linalg.solve(np.linalg.cholesky(noise), sensitivity).reshape(3 * len(q), -1)
        true = rng.normal(size=(white.shape[1], 2000))
        data = np.vstack([white @ true + rng.normal(size=(len(white), 2000)), np.zeros_like(true)])
        off = np.linalg.lstsq(np.vstack([white, np.eye(len(true))]), data, rcond=None)[0] - true
        return np.linalg.slogdet(np.cov(off))[1], np.sqrt(np.square(new @ off).sum(axis=1).mean())

    (volume, rms), random = (
        left(plan.measurements.q),
        np.array([left(Room(sino6).postures(12, rng)[0]) for _ in range(5)]),
    )
    assert volume < random[:, 0].min() - 1.0
    assert rms < 0.95 * np.median(random[:, 1])
    assert rms == pytest.approx(plan.u, rel=0.1)
    assert np.median(random[:, 1]) == pytest.approx(np.median(plan.u_random), rel=0.15)
