"""What is said of an arm and its records before a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aacmm_pin.diagnosis import Check, check_measurements
from aacmm_pin.effects import Conditions
from aacmm_pin.measurements import Measurements, simulate_measurements
from tests.cli import shell
from tests.oracle import perturbed_positions


@pytest.fixture(scope="module")
def records(sino6) -> Measurements:
    return simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(5))


def missing(check: Check) -> dict[str, list[str]]:
    return {need: [cause.cause for cause in causes] for need, causes in check.missing.items()}


def test_distance_is_that_of_the_stated_geometry(sino6, records):
    check = check_measurements(sino6, records)
    off = np.linalg.norm(sino6.positions(records.q) - records.reference, axis=1)
    assert check.rms == pytest.approx(np.sqrt(np.mean(off[check.used] ** 2)))
    assert check.used.sum() > 0.9 * records.n
    assert missing(check) == {
        "seat": ["seat_error", "seat_shift"],
        "probe_direction": ["probe_bending"],
    }


@pytest.mark.parametrize("scheme", ["free", "seats"])
def test_predicted_distance_is_the_mean_over_random_arms(sino6, scheme, rng):
    """Of arms drawn within the half-widths, and coordinates within the uncertainty of the file."""
    records = simulate_measurements(sino6, scheme, 60, rng=rng, reference_noise=5e-5)
    check = check_measurements(sino6, records)
    half_widths = np.array([p.half_width for p in sino6.parameters])
    errors = rng.uniform(-1, 1, (2000, half_widths.size)) * half_widths
    square = 0.0
    for q in records.q:
        moved = perturbed_positions(sino6, np.tile(q, (2000, 1)), errors) - sino6.positions(q[None])
        square += np.square(moved).sum(axis=1).mean() / records.n
    square += np.square(records.reference_u).sum(axis=1).mean()
    assert check.predicted_rms == pytest.approx(np.sqrt(square), rel=0.1)


@pytest.mark.parametrize("amplitude", [0.0, 6e-5])
def test_residuals_that_the_stated_noise_does_not_explain_are_noted(sino6, records, amplitude):
    """Of an eccentric encoder within the stated half-widths of the geometry."""
    q = records.q.copy()
    q[:, 2] -= amplitude * np.cos(q[:, 2])
    noise = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
    check = check_measurements(sino6, replace(records, q=q), **noise)
    assert check.rms < check.predicted_rms
    assert ("beyond_noise" in {note.code for note in check.notes}) == (amplitude > 0.0)


def test_causes_that_need_a_column_are_missing_without_it(sino6, records):
    bare = replace(records, conditions=Conditions(records.n))
    lacking = missing(check_measurements(sino6, bare))
    assert lacking["temperature"] == ["thermal_expansion"]
    assert "joint_hysteresis" in lacking["approach"]
    assert "zero_drift" in lacking["time"]


def test_an_external_frame_is_fitted(sino6, records):
    moved = replace(records, reference=records.reference[:, [1, 2, 0]] + 0.5)
    found = check_measurements(sino6, moved, reference_frame="external")
    assert found.rms < 5e-5


def test_rows_outside_the_limits_are_listed(sino6, records):
    angles = np.sort(records.q[:, 1])
    limits = sino6.limits.copy()
    limits[1] = angles[[2, -2]]
    found = check_measurements(replace(sino6, limits=limits), records)
    (note,) = (each for each in found.notes if each.code == "outside_limits")
    assert note.data["joint"] == 2
    own = [row for row, q in zip(records.row, records.q, strict=True) if q[1] in angles[[0, 1, -1]]]
    assert note.data["rows"] == own
    assert note.data["values"] == [angles[0], angles[-1]]
    low, high = np.degrees(limits[1])
    assert f"{low:.5g}° and {high:.5g}°" in str(note)
    codes = [each.code for each in check_measurements(sino6, records).notes]
    assert "outside_limits" not in codes


def test_what_it_says_at_the_shell(tmp_path, records):
    table = records.to_frame().drop(columns="temperature_c")
    table.loc[4, "x_mm"] += 40.0
    table.to_csv(tmp_path / "data.csv", index=False)
    content = shell.found(f"check sino6 {tmp_path / 'data.csv'}")
    assert content["records"] == 60
    assert content["rms_mm"] < 0.05
    assert {"column": "temperature_c", "causes": ["thermal_expansion"]} in content["not_tried"]
    assert "temperature_c" in shell.done(f"check sino6 {tmp_path / 'data.csv'}")[0]
    table["theta3_deg"] *= -1.0
    table.to_csv(tmp_path / "wrong.csv", index=False)
    shell.refused(f"check sino6 {tmp_path / 'wrong.csv'}", said=["joint 3"])
