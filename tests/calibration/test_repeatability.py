"""What repeated postures show, against a simulated robot of known repeatability and drift."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Repeatability
from aacmm_pin.diagnosis import check_measurements
from aacmm_pin.measurements import Measurements
from aacmm_pin.report import check_document, check_summary
from aacmm_pin.report.document import Paragraph
from aacmm_pin.report.repeated_postures import repeatability_in_words
from tests.tables import PLACES, readings

POSTURES, CYCLES, OTHERS = 10, 30, 30
SD = np.array([10e-6, 20e-6, 30e-6])
PERIOD = 20.0


def measured(arm: Arm, seed: int, drift: Any = (0.0, 0.0, 0.0), **columns: Any) -> Measurements:
    """Cycles through the postures, whose readings differ by little, then other postures; every
    posture has an error of its own.
    """
    rng = np.random.default_rng(seed)
    number = np.r_[np.tile(np.arange(POSTURES), CYCLES), POSTURES + np.arange(OTHERS)]
    postures = rng.uniform(-1.5, 1.5, (POSTURES + OTHERS, 6))
    q = postures[number] + rng.normal(0.0, 2e-5, (len(number), 6))
    time = PERIOD * np.arange(len(q))
    error = (
        rng.normal(0.0, 5e-5, (POSTURES + OTHERS, 3))[number] + rng.normal(size=(len(q), 3)) * SD
    )
    error += np.outer(time / time[POSTURES * CYCLES - 1], drift)
    table = readings(q)
    table[PLACES] = (arm.positions(q) + error) * 1e3
    return Measurements.from_frame(table.assign(time_s=time, **columns), nq=6)


def repeats_of(arm: Arm, records: Measurements) -> Repeatability:
    repeats = check_measurements(arm, records).repeatability
    assert repeats is not None
    return repeats


def rp_of(deviations: np.ndarray) -> float:
    """ISO 9283, 7.2.2, written out."""
    distances = np.sqrt(((deviations - deviations.mean(axis=0)) ** 2).sum(axis=1))
    mean = distances.sum() / len(distances)
    return mean + 3 * np.sqrt(((distances - mean) ** 2).sum() / (len(distances) - 1))


def test_repeatability_is_that_of_the_robot(sino6):
    records = measured(sino6, 3)
    repeats = repeats_of(sino6, records)
    assert repeats.cycles.tolist() == [CYCLES] * POSTURES
    # u of a standard deviation with 290 degrees of freedom is 4.2 %.
    np.testing.assert_allclose(repeats.sd, SD, rtol=0.13)
    assert repeats.drift is not None
    assert repeats.drift.p_value > 0.01
    draws = np.random.default_rng(1).normal(size=(2000, CYCLES, 3)) * SD
    of_draws = np.array([rp_of(draw) for draw in draws])
    u = of_draws.std() / np.sqrt(POSTURES)
    assert repeats.rp.mean() == pytest.approx(of_draws.mean(), abs=4 * u)
    tips = sino6.positions(records.q) - records.reference
    by_hand = [rp_of(tips[k : POSTURES * CYCLES : POSTURES]) for k in range(POSTURES)]
    # The geometry that the check fits hardly matters.
    np.testing.assert_allclose(repeats.rp, by_hand, rtol=1e-2)


def test_rp_of_the_noise_of_the_references(sino6):
    """By draws; stated by an option or in columns. Coordinates of a seat are one reference."""
    records = measured(sino6, 6)
    assert np.isnan(repeats_of(sino6, records).rp_of_references)
    stated = check_measurements(sino6, records, reference_noise=2e-5).repeatability
    assert stated is not None
    draws = np.random.default_rng(1).normal(scale=2e-5, size=(200_000, 3))
    assert stated.rp_of_references == pytest.approx(rp_of(draws), rel=0.01)
    assert "72.3 µm" in repeatability_in_words(stated)
    columns = {f"u_{axis}_mm": 0.02 for axis in "xyz"}
    by_columns = repeats_of(sino6, measured(sino6, 6, **columns))
    assert by_columns.rp_of_references == pytest.approx(stated.rp_of_references)
    number = np.r_[np.arange(POSTURES * CYCLES) % POSTURES, POSTURES + np.arange(OTHERS)]
    touched = measured(sino6, 6, seat=[f"S{k}" for k in number], **columns)
    _, first = np.unique(number, return_index=True)
    seated = repeats_of(sino6, replace(touched, reference=touched.reference[first][number]))
    assert np.isnan(seated.rp_of_references)


def test_drift_is_that_of_the_robot(sino6):
    repeats = repeats_of(sino6, measured(sino6, 4, drift=(3e-5, 0.0, -2e-5)))
    assert repeats.drift is not None
    assert repeats.drift.p_value < 1e-10
    # u of a change over the range of n equidistant times is sd √(12 / n).
    u = SD * np.sqrt(12 / (POSTURES * CYCLES))
    assert (np.abs(repeats.drift.change - [-3e-5, 0.0, 2e-5]) < 4 * u).all()
    untimed = replace(repeats, clock=np.arange(len(repeats.posture)), is_timed=False)
    assert untimed.drift is not None
    np.testing.assert_allclose(untimed.drift.change, repeats.drift.change)


def test_the_p_value_of_a_drift_is_uniform_without_one():
    rng = np.random.default_rng(2)
    posture = np.tile(np.arange(5), 4)
    p = []
    for _ in range(1000):
        values = rng.normal(size=(20, 3)) @ [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 3.0]]
        means = np.array([values[posture == number].mean(axis=0) for number in range(5)])
        drift = Repeatability(posture, values - means[posture], rng.random(20), True, values).drift
        assert drift is not None
        p.append(drift.p_value)
    assert np.abs(np.sort(p) - (np.arange(1000) + 0.5) / 1000).max() < 1.63 / np.sqrt(1000)


def test_other_targets_and_copies_are_no_repeats(sino6):
    n = POSTURES * CYCLES + OTHERS
    records = measured(sino6, 5, session=[f"S{k}" for k in range(n)])
    assert check_measurements(sino6, records).repeatability is None
    twice = measured(sino6, 5).take(np.r_[np.arange(POSTURES), np.arange(n - OTHERS, n)].repeat(2))
    check = check_measurements(sino6, twice)
    assert check.repeatability is None
    assert check_summary(check)["repeatability"] is None


def test_what_is_said(sino6):
    check = check_measurements(sino6, measured(sino6, 4, drift=(3e-5, 0.0, 0.0)))
    repeats = check.repeatability
    assert repeats is not None
    content = check_summary(check)["repeatability"]
    np.testing.assert_allclose(np.linalg.norm(content["sd_mm"]), content["rms_mm"])
    assert content["residual_mm"] == pytest.approx(check.calibrated_rms * 1e3)
    assert content["rms_mm"] < content["residual_mm"]
    assert repeatability_in_words(repeats) in [
        block.text for block in check_document(check).blocks if isinstance(block, Paragraph)
    ]
