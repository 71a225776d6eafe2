"""What to measure next when a verdict is worth less than it looks."""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration import calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import JointCompliance
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements

NOISE = 8e-6


@pytest.fixture(scope="module")
def records(sino6: Arm) -> Measurements:
    return simulate_measurements(
        ErrorModel(sino6, (JointCompliance(2, values=(2e-5,)),)), "free", 60, rng=np.random.default_rng(3)
    )


def test_noise_stated_a_hundred_times_too_large_is_not_answered_with_more_records(sino6: Arm, records: Measurements) -> None:
    found = diagnose(sino6, records, encoder_noise=100 * NOISE, reference_noise=1e-3, hold_out=False)
    assert found.verdict == "inconclusive"
    assert "unit" in found.next_measurements
    assert "more records" not in found.next_measurements
    assert "far smaller than the stated noise" in found.notes[-1]


@pytest.mark.parametrize("work", [calibrate, diagnose])
def test_noise_in_another_unit_is_refused(sino6: Arm, records: Measurements, work: object) -> None:
    with pytest.raises(AacmmError, match=r"encoder_noise is 8 rad, expected at most 0\.005 rad; is it in another unit"):
        work(sino6, records, encoder_noise=8.0)  # type: ignore[operator]


def test_a_gain_that_is_not_borne_out_asks_for_more_records(sino6: Arm, records: Measurements) -> None:
    few = records.take(np.arange(14))
    found = diagnose(sino6, few, encoder_noise=NOISE)
    assert found.verdict == "explained"
    assert found.held_out is not None
    assert found.held_out.interval[0] <= 0
    assert "more records" in found.next_measurements
