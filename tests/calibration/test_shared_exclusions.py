"""Excluded records that are no gross errors: half a file, a run of rows, all that moved a joint;
and gross errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.calibration.shared_exclusions import clusters
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.report.calibration_page import calibration_summary, verdict

RECORDS = 80


def with_a_bad_end(arm: Arm, kind: str, bad: int) -> Calibration:
    """Before the last records the stand is pushed by 8 mm and 3 mrad, or joint 6 is counted the
    other way from then on.
    """
    data = simulate_measurements(arm, "free", RECORDS, rng=np.random.default_rng(2))
    late = np.arange(RECORDS) >= RECORDS - bad
    q, reference = data.q.copy(), data.reference.copy()
    if kind == "moved":
        turn = Rotation.from_rotvec([0.001, 0.002, 0.002]).as_matrix()
        reference[late] = reference[late] @ turn.T + [0.005, -0.006, 0.002]
    else:
        q[late, 5] *= -1.0
    return calibrate(arm, Measurements.of(q, reference), hold_out=False)


@pytest.mark.parametrize("bad", [12, 36])
@pytest.mark.parametrize("kind", ["moved", "counted the other way"])
def test_the_headline_says_that_a_run_of_rows_was_left_out(sino6, kind, bad):
    found = with_a_bad_end(sino6, kind, bad)
    assert np.isin(np.flatnonzero(found.fit.excluded), np.arange(RECORDS - bad, RECORDS)).all()
    out = int(found.fit.excluded.sum())
    assert out >= bad - 1  # where the angle is near 0, its sign hardly matters
    left = found.exclusions
    assert left.doubtful
    assert left.too_many == (out > 0.15 * RECORDS)
    assert (left.shared.name, left.shared.excluded) == ("record", out)
    first, last = (int(found.excluded["row"].iloc[k]) for k in (0, -1))
    assert left.shared.where.endswith(f" {first} to {last}")
    assert f"{out} of {RECORDS} " in verdict(found)
    summary = calibration_summary(found, "data.csv", 1)["records"]["exclusions"]
    assert (summary["doubtful"], summary["shared"]["excluded"]) == (True, out)


def test_scattered_records_that_are_too_many_are_in_the_headline(sino6):
    rng = np.random.default_rng(3)
    data = simulate_measurements(sino6, "free", 100, rng=rng)
    wrong = rng.permutation(100) < 25
    reference = data.reference + wrong[:, None] * 5e-3 * rng.standard_normal((100, 3))
    found = calibrate(sino6, Measurements.of(data.q, reference), hold_out=False)
    assert found.exclusions.too_many
    assert found.exclusions.shared is None
    assert str(int(found.fit.excluded.sum())) in verdict(found).split(".")[0]


@pytest.mark.parametrize("share", [0.0, 0.01, 0.03])
def test_gross_errors_are_nothing_else(sino6, share):
    """Wrong coordinates, and readings wrong by any angle, in files of 20 to 200 records: no word of
    anything shared.
    """
    rng = np.random.default_rng(5)
    for number in (20, 50, 200):
        for _ in range(3):
            data = simulate_measurements(sino6, "free", number, rng=rng)
            wrong = np.argsort(rng.random(number))[: round(share * number)]
            q, reference = data.q.copy(), data.reference.copy()
            reference[wrong[::2]] += 5e-3 * rng.standard_normal((len(wrong[::2]), 3))
            q[wrong[1::2], rng.integers(6, size=len(wrong[1::2]))] += rng.uniform(
                -3.0, 3.0, len(wrong[1::2])
            )
            found = calibrate(sino6, replace(data, q=q, reference=reference), hold_out=False)
            assert not found.exclusions.doubtful
            assert "excluded" not in verdict(found)


def test_one_of_a_few_records_is_a_mishap(sino6):
    data = simulate_measurements(sino6, "free", 8, rng=np.random.default_rng(6))
    reference = data.reference.copy()
    reference[:2] += 0.01
    found = calibrate(sino6, replace(data, reference=reference), hold_out=False)
    assert 1 <= found.fit.excluded.sum() <= 2
    assert not found.exclusions.doubtful


def test_excluded_records_that_are_neighbours(sino6, rng):
    """By brute force: of random ones hardly any seem to be neighbours; those of one time, joint or
    place do.
    """
    data = Measurements.of(random_postures(sino6, 100, rng))
    often = 0
    for count in (3, 5, 15):
        for _ in range(100):
            excluded = rng.permutation(100) < count
            often += bool(clusters(sino6, data, excluded, ~excluded))
    assert often <= 4  # of 300, expected are less than 0.6
    tips = sino6.positions(data.q)
    apart, rows = np.linalg.norm(tips - tips[50], axis=1).argsort(), np.arange(100)
    for inside, name in (
        (rows[96:100], "record"),
        (rows[[40, 43, 48, 60]], ""),
        (rows[40:44], "record"),
        (rows[40:47], "record"),
        (data.q[:, 2].argsort()[20:30], "joint 3"),
        (apart[:8], "place"),
    ):
        excluded = np.isin(rows, inside)
        found = clusters(sino6, data, excluded, ~excluded)
        assert [cluster.shared.name for cluster in found] == ([name] if name else [])
        assert not name or (found[0].records == excluded).all()
        if name == "joint 3":
            angles = np.rad2deg(data.q[inside, 2])
            expected = f"joint 3 [°] from {angles.min():.6g} to {angles.max():.6g}"
            assert found[0].shared.where == expected


@pytest.mark.parametrize("what", ["both ends of a joint", "temperature", "operator"])
def test_what_excluded_records_share(sino6, what):
    """A tenth of the records; those at both ends of a joint are beyond all used ones."""
    rng = np.random.default_rng(7)
    data = Measurements.of(random_postures(sino6, 120, rng))
    temperature = 20.0 + 2.0 * rng.standard_normal(120)
    operator = np.where(rng.random(120) < 0.1, "Bo", "Al").astype(object)
    conditions = replace(data.conditions, temperature=temperature)
    data = replace(data, conditions=conditions, extra=pd.DataFrame({"operator": operator}))
    q = data.q[:, 2]
    excluded, name = {
        "both ends of a joint": (np.abs(q - np.median(q)).argsort().argsort() >= 108, "joint 3"),
        "temperature": (temperature.argsort().argsort() >= 108, "temperature"),
        "operator": (operator == "Bo", "operator"),
    }[what]
    found = clusters(sino6, data, excluded, ~excluded)
    assert min((c.shared for c in found), key=lambda shared: shared.p_value).name == name


def test_repeats_of_one_posture_are_one(sino6, rng):
    data = Measurements.of(np.repeat(random_postures(sino6, 30, rng), 4, axis=0))
    excluded = np.arange(120) // 4 == 7
    assert clusters(sino6, data, excluded, ~excluded) == []


def test_a_session_says_more_than_its_rows(sino6):
    data = simulate_measurements(sino6, "free", RECORDS, rng=np.random.default_rng(2))
    late = np.arange(RECORDS) >= RECORDS - 12
    moved = Measurements.of(data.q, data.reference + late[:, None] * [0.005, -0.006, 0.002])
    session = np.where(late, "b", "a").astype(object)
    told = replace(moved, conditions=replace(moved.conditions, session=session))
    shared = calibrate(sino6, told, hold_out=False).exclusions.shared
    assert (shared.name, shared.excluded) == ("session", 12)
