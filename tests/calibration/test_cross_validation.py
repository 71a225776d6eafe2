"""Copies of records count once; repeats of a posture are held out together, and alone tell nothing
of other postures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.calibration import Setup, calibrate
from aacmm_pin.calibration.calibrate import counted_once, held_postures
from aacmm_pin.calibration.cross_validation import fold_numbers, groups_of
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.effects import EncoderEccentricity, ErrorModel
from aacmm_pin.measurements import Measurements, originals, simulate_measurements
from aacmm_pin.report.calibration_page import verdict
from tests.few_causes import ECCENTRICITY_ALONE
from tests.notes import data_of
from tests.tables import PLACES, THETAS


def several(table: pd.DataFrame, times: int) -> Measurements:
    return Measurements.from_frame(pd.concat([table] * times, ignore_index=True))


def test_a_file_appended_to_itself_says_the_same(sino6, rng):
    model = ErrorModel(sino6).with_effects(EncoderEccentricity(3, values=(2e-4, 1e-4)))
    table = simulate_measurements(model, "seats", 60, rng=rng, seats=6).to_frame()
    once, twice = (calibrate(sino6, several(table, k)) for k in (1, 2))
    assert not data_of(once.notes, "copies")
    assert data_of(twice.notes, "copies") == [{"rows": [*range(62, 122)]}]
    pd.testing.assert_frame_equal(once.parameters, twice.parameters)
    assert [h.rms_after for h in once.held_out] == pytest.approx(
        [h.rms_after for h in twice.held_out]
    )


def test_what_makes_a_copy():
    table = pd.DataFrame(
        {
            "theta1_deg": [10.0, 10.0, 10.0, 10.0],
            "theta2_deg": 20.0,
            "x_mm": 1.0,
            "y_mm": 2.0,
            "z_mm": 3.0,
        }
    )
    labels = {
        "record": ["a", "b", "c", "d"],
        "time_s": [0.0, 1.0, 2.0, 3.0],
        "seat": ["A", "A", "B", ""],
    }
    records = Measurements.from_frame(table.assign(**labels))
    assert originals(records).tolist() == [0, 0, 2, 3]
    other = Measurements.from_frame(
        table.assign(z_mm=[3.0, 3.0000001, 3.0, 3.0], approach1=[1, 1, -1, 1], approach2=1)
    )
    assert originals(other).tolist() == [0, 1, 2, 0]
    kept, notes = counted_once(records.take([0, 2, 1]))
    assert kept.row.tolist() == [2, 4]
    assert data_of(notes, "copies") == [{"rows": [3]}]


def test_places_that_several_records_state_to_the_last_digit_are_seats(sino6, rng):
    """Without the column ``seat``, or where one of its cells is empty, all is as with it."""
    data = simulate_measurements(sino6, "seats", 60, rng=rng, seats=6)
    seat = data.conditions.seat
    wanted = calibrate(sino6, data, hold_out=False)
    for labels in (None, np.where(np.arange(60) % 7, seat, "")):
        file = replace(data, conditions=replace(data.conditions, seat=labels))
        found = calibrate(sino6, file, hold_out=False)
        np.testing.assert_allclose(found.parameters["u"], wanted.parameters["u"], rtol=1e-6)
        assert data_of(found.notes, "seats_by_coordinates")
    assert counted_once(data) == (data, [])


def test_repeats_of_a_posture_are_held_out_together(sino6, rng):
    table = simulate_measurements(sino6, "free", 40, rng=rng).to_frame()
    repeats = []
    for session in range(4):
        again = table.copy().assign(session=f"day {session}")
        again[THETAS] += rng.normal(0.0, 5e-4, (40, 6))
        again[PLACES] += rng.normal(0.0, 0.01, (40, 3))
        repeats.append(again)
    records = Measurements.from_frame(pd.concat(repeats, ignore_index=True))
    held = records.take(np.argsort(records.postures, kind="stable"))
    setup = Setup.of(sino6, "base", "tip", True)
    told = [bool(held_postures(counted_once(each)[0], setup)) for each in (records, held)]
    assert told == [False, True]
    postures = records.postures
    assert postures.tolist() == list(range(40)) * 4
    result = calibrate(sino6, records, hold_out=False)
    kind, groups = groups_of(result.fit, np.random.default_rng(1))
    assert kind == "blocks"  # every session has every posture
    for labels in (groups, fold_numbers(result.fit, np.random.default_rng(1))[1]):
        assert len(np.unique(labels)) > 2
        assert len(np.unique(np.column_stack([postures, labels]), axis=0)) == 40


def test_points_beside_seats_are_not_held_out_all_at_once(sino6, rng):
    """Without them, two seats in an unknown frame would leave a rotation open."""
    seats = simulate_measurements(sino6, "seats", 45, rng=rng, seats=3).to_frame()
    seats.loc[seats["seat"] == seats["seat"][0], PLACES] = np.nan
    table = pd.concat([seats, simulate_measurements(sino6, "free", 40, rng=rng).to_frame()])
    records = Measurements.from_frame(table.fillna({"seat": ""}).reset_index(drop=True))
    noise = {"reference_noise": 1.2e-5, "probe_noise": 1e-9}
    result = calibrate(sino6, records, reference_frame="external", **noise, rng=rng)
    by_seats = result.held_out[-1]
    assert by_seats.kind == "seats"
    assert by_seats.rms_after < 1e-4


def test_a_diagnosis_holds_out_few_points_beside_seats_in_several_folds(sino6, rng):
    seats = simulate_measurements(sino6, "seats", 72, rng=rng, seats=6).to_frame()
    points = simulate_measurements(sino6, "free", 7, rng=rng).to_frame()
    records = Measurements.from_frame(pd.concat([seats, points]).fillna({"seat": ""}))
    kind, folds = fold_numbers(calibrate(sino6, records).fit, np.random.default_rng(1))
    assert kind == "seats"
    assert np.unique(folds[72:]).size > 3


def test_readings_of_one_contact_count_as_their_mean(sino6, rng):
    """Contacts of 20 µm, five readings of each: u is as of one reading of each contact, and
    right.
    """
    noise = {"encoder_noise": 2e-6, "probe_noise": 2e-5, "reference_noise": 1e-6}
    once = simulate_measurements(sino6, "seats", 60, rng=rng, seats=6, **noise)
    table = pd.concat([once.to_frame()] * 5).sort_index(kind="stable").reset_index(drop=True)
    table[THETAS] += np.degrees(rng.normal(0.0, 2e-6, (300, 6)))
    again = Measurements.from_frame(table)
    kept, notes = counted_once(again)
    assert kept.q == pytest.approx(again.q.reshape(60, 5, 6).mean(axis=1))
    assert kept.row.tolist() == list(range(2, 302, 5))
    assert [
        (told["contacts"], len(told["rows"])) for told in data_of(notes, "contacts_averaged")
    ] == [(60, 300)]
    wanted, found = (
        calibrate(sino6, each, hold_out=False, **noise).parameters["u"] for each in (once, again)
    )
    np.testing.assert_allclose(found, wanted, rtol=0.01)
    free = table.drop(columns="seat").assign(
        x_mm=table["x_mm"] + np.repeat(rng.normal(0.0, 0.01, 60), 5)
    )
    kept, notes = counted_once(Measurements.from_frame(free))
    assert (kept.n, len(notes)) == (60, 1)  # and no seats
    loaded = free.assign(number=np.arange(300), load=np.arange(300) % 5 // 4)
    assert counted_once(Measurements.from_frame(loaded))[0].n == 120


def test_held_out_residuals_against_an_explicit_refit(sino6, rng):
    data = simulate_measurements(sino6, "free", 200, rng=rng)
    result = calibrate(sino6, data, rng=np.random.default_rng(5))
    kinds = {h.kind: h for h in result.held_out}
    assert set(kinds) == {"records", "blocks"}
    assert result.rms < kinds["records"].rms_after < 1.3 * result.rms
    assert kinds["blocks"].rms_after >= 0.98 * kinds["records"].rms_after
    left_out = np.random.default_rng(1).random(200) < 0.1
    rest, out = calibrate(sino6, data.take(~left_out), hold_out=False), data.take(left_out)
    distance = np.linalg.norm(rest.model.predict(out.q) - out.reference, axis=1)
    assert np.sqrt(np.mean(distance**2)) == pytest.approx(kinds["records"].rms_after, rel=0.35)


@ECCENTRICITY_ALONE
def test_one_posture_tells_nothing_of_others(sino6, rng):
    stated = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
    q = sino6.limits.mean(axis=1) + 0.3 + 8e-6 * rng.normal(size=(30, 6))
    there = sino6.positions(q[:1]) + [1e-3, 0.0, 0.0] + 1.2e-5 * rng.normal(size=(30, 3))
    records = Measurements.of(q, there)
    result = calibrate(sino6, records, **stated)
    assert [told["postures"] for told in data_of(result.notes, "few_postures")] == [1]
    assert result.held_out == ()
    assert "helps" not in verdict(result)
    found = diagnose(sino6, records, **stated)
    assert [told["postures"] for told in data_of(found.notes, "few_postures")] == [1]
    assert found.held_out is None
    assert found.findings == ()
