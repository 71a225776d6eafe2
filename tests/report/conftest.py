"""Calibrations and diagnoses that several tests look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import matplotlib as mpl
import numpy as np
import pytest
from blind import draw

from aacmm_pin import ConfigurationCircle, configuration_circle, perturbed_model
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import EncoderEccentricity, ErrorModel
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.few_causes import FEW

mpl.use("Agg")

READINGS = 8e-6
WAVE = EncoderEccentricity(joint=3, values=(2e-4, 0.0))


@pytest.fixture(scope="session")
def blind(tmp_path_factory) -> Callable[..., Diagnosis]:
    """The diagnosis of a file of the plant."""

    @cache
    def of(
        cause: str | None,
        seed: int = 3,
        plan: str = "free",
        outliers: float = 0.0,
        hold_out: bool = True,
    ) -> Diagnosis:
        path = tmp_path_factory.mktemp("blind") / "data.csv"
        draw(seed, cause, plan=plan, records=80, outliers=outliers).write(path)
        probe = 12e-6 if plan != "free" else None
        records = Measurements.read(path)
        noise = {"encoder_noise": READINGS, "reference_noise": 12e-6, "probe_noise": probe}
        with FEW:
            return diagnose(ErrorModel.load("sino6"), records, hold_out=hold_out, **noise)

    return of


@pytest.fixture(scope="session")
def sound(blind) -> Diagnosis:
    """An arm without any cause beside its stated uncertainties."""
    return blind(None, seed=11)


@pytest.fixture(scope="session")
def eccentric(blind) -> Diagnosis:
    """An eccentric encoder 1, three records of 80 are outliers."""
    return blind("encoder_eccentricity", 3, outliers=0.04)


@pytest.fixture(scope="session")
def at_seats() -> Calibration:
    """SINO6 drawn anew, 120 records at twelve seats, two of them slips; with an effect that is not
    there.
    """
    arm = Arm.load("sino6")
    true = perturbed_model(ErrorModel(arm), np.random.default_rng(1))
    data = simulate_measurements(true, "seats", 120, seats=12, rng=np.random.default_rng(1))
    q = data.q.copy()
    q[[3, 50], 1] += 2e-3
    return calibrate(arm, replace(data, q=q), encoder_noise=READINGS)


@pytest.fixture(scope="session")
def with_wave() -> Calibration:
    """SINO6 with an eccentric encoder 3 that the calibration does not know of, free records."""
    arm = Arm.load("sino6")
    data = simulate_measurements(
        ErrorModel(arm, (WAVE,)), "free", 200, rng=np.random.default_rng(2)
    )
    return calibrate(arm, data, encoder_noise=READINGS, hold_out=False)


@pytest.fixture(scope="session")
def circle(sino6) -> ConfigurationCircle:
    """The postures of SINO6 at a seat of its paper."""
    return configuration_circle(sino6, [0.0336323, -0.6718702, 0.1829355], count=36)


@pytest.fixture(scope="module")
def of_robot() -> Calibration:
    """UR5, whose placements have no stated uncertainty, and many of which cannot be determined."""
    arm = Arm.from_urdf("ur5")
    steps = np.random.default_rng(3).normal(0.0, 2e-4, (6, 6))
    data = simulate_measurements(
        arm.with_placements(steps, None), "free", 80, rng=np.random.default_rng(4)
    )
    return calibrate(arm, data, encoder_noise=READINGS, hold_out=False)
