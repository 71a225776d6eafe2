"""What a diagnosis may say of records left out, of hysteresis, of seats that moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aacmm_pin import next_measurements
from aacmm_pin.calibration import calibrate, calibrated_model
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.diagnosis.unexplained import exceeds_noise
from aacmm_pin.effects import EncoderEccentricity, ErrorModel, JointHysteresis
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.report.verdicts import verdict_in_words
from tests.cli import shell
from tests.few_causes import ECCENTRICITY_ALONE, FEW
from tests.notes import data_of


def simulated(model: ErrorModel, n: int, rng: np.random.Generator) -> Measurements:
    """Records of touches at known seats that do not state from where each joint came."""
    records = simulate_measurements(model, "seats", n, rng=rng)
    return replace(records, conditions=replace(records.conditions, approach=None))


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
def test_a_curve_that_chases_two_branches_does_not_extend_the_arm(sino6, seed):
    """A free curve follows one branch and excludes the other; judged by the first alone it would
    have a gain.
    """
    truth, rng = (
        ErrorModel(sino6, (JointHysteresis(2, values=(1e-4,)),)),
        np.random.default_rng(seed),
    )
    records = simulated(truth, 120, rng)
    found = diagnose(sino6, records)
    assert found.verdict != "explained"
    assert np.isfinite(found.held_out.extended).sum() == records.n - found.held_out.gross_errors
    new, off = simulate_measurements(truth, "seats", 400, rng=rng), {}
    for name, model in (
        ("recalibrated", calibrated_model(found.recalibrated)),
        ("extended", found.model),
    ):
        off[name] = rms(
            np.linalg.norm(model.predict(new.q, new.conditions) - new.reference, axis=1)
        )
    assert off["extended"] < 1.02 * off["recalibrated"]


@pytest.fixture(scope="module")
def eccentric(sino6) -> Measurements:
    truth = ErrorModel(sino6, (EncoderEccentricity(3, values=(2e-4, 0.0)),))
    return simulated(truth, 80, np.random.default_rng(1))


@pytest.fixture(scope="module")
def named(sino6, eccentric) -> Diagnosis:
    with ECCENTRICITY_ALONE:
        return diagnose(sino6, eccentric, encoder_noise=8e-6)


@ECCENTRICITY_ALONE
def test_gross_errors_do_not_count(sino6, eccentric, named):
    rows = np.array([10, 40, 70])
    wrong = eccentric.reference.copy()
    wrong[rows] += 5e-3
    before = named.held_out
    after = diagnose(sino6, replace(eccentric, reference=wrong), encoder_noise=8e-6).held_out
    assert (before.gross_errors, after.gross_errors) == (0, 3)
    assert np.isnan(after.extended[rows]).all()
    assert after.gain == pytest.approx(before.gain, abs=0.03)


@ECCENTRICITY_ALONE
def test_an_extended_arm_that_is_no_better_explains_nothing(
    eccentric, named, tmp_path, monkeypatch
):
    assert (named.verdict, named.no_better) == ("explained", False)
    monkeypatch.setattr("aacmm_pin.diagnosis.held_out_gain._interval", lambda *_: (-0.1, 0.2))
    (tmp_path / "data.csv").write_text(eccentric.csv())
    arm = tmp_path / "extended.toml"
    words = f"diagnose sino6 {tmp_path / 'data.csv'} {shell.NOISE} --arm-out {arm}"
    out, err = shell.done(words)
    assert out.startswith("Inconclusive")
    assert "held-out" in out.splitlines()[0]
    assert any(line.startswith("warning:") and "held-out" in line for line in err.splitlines())
    assert "held-out" in arm.read_text()


@FEW
def test_columns_that_the_file_lacks_are_listed_with_what_was_not_tried(sino6):
    records = simulate_measurements(ErrorModel(sino6), "seats", 60, rng=np.random.default_rng(1))
    few = replace(records, conditions=replace(records.conditions, approach=None, temperature=None))
    found = diagnose(sino6, few, hold_out=False, encoder_noise=8e-6)
    not_tried = {one["column"]: one["causes"] for one in found.summary()["not_tried"]}
    assert not_tried == {
        "temperature_c": ["thermal_expansion"],
        "probe_direction_x …": ["probe_bending"],
    }
    assert len(data_of(found.notes, "causes_not_tried")) == 1


@FEW
def test_hysteresis_without_the_approach_is_a_scatter_of_readings_that_asks_for_it(sino6):
    rng = np.random.default_rng(7)
    hidden = ErrorModel(sino6, (JointHysteresis(2, values=(5e-5,)),))
    stated = simulate_measurements(hidden, "seats", 120, rng=rng)
    conditions = replace(stated.conditions, approach=None, time=None)
    records = replace(stated, conditions=conditions, record=None)  # in no order that is known
    found = diagnose(sino6, records, hold_out=False, encoder_noise=8e-6)
    (readings,) = found.unexplained.readings
    assert (found.verdict, readings.joint) == ("unexplained", 2)
    assert readings.scatter == pytest.approx(5e-5, rel=0.3)
    assert "joint 2" in verdict_in_words(found)
    assert "--approach-from-order" in next_measurements(found)


@FEW
@pytest.mark.parametrize("hysteresis", [6e-5, 0.0])
def test_hysteresis_without_stated_noise_is_the_joint_whose_readings_scatter_most(
    sino6, hysteresis
):
    """An encoder noise that all joints have is none of a joint."""
    noise = {"encoder_noise": 2e-5 if hysteresis else 1e-4, "reference_noise": 1e-5}
    hidden = ErrorModel(sino6, (JointHysteresis(3, values=(hysteresis,)),))
    stated = simulate_measurements(hidden, "seats", 120, rng=np.random.default_rng(7), **noise)
    conditions = replace(stated.conditions, approach=None, time=None)
    found = diagnose(sino6, replace(stated, conditions=conditions, record=None), hold_out=False)
    assert [readings.joint for readings in found.unexplained.readings] == [3] * bool(hysteresis)
    if hysteresis:
        assert found.verdict in ("unexplained", "partly-explained")
        assert "approach" in next_measurements(found)
        assert "other joints" in str(found.unexplained.readings[0])


@FEW
def test_a_seat_whose_place_is_contradicted_is_in_the_headline(sino6):
    records = simulated(ErrorModel(sino6), 120, np.random.default_rng(11))
    reference, seats = records.reference.copy(), records.conditions.seat
    rows = np.flatnonzero(seats == seats[0])
    reference[rows[len(rows) // 2 :], 0] += 8e-5
    moved = replace(records, reference=reference)
    found = diagnose(sino6, moved, hold_out=False, encoder_noise=8e-6)
    assert found.verdict not in ("no-discrepancy", "explained")
    assert "contradicted references" in found.doubts
    assert f"seat {seats[0]}" in verdict_in_words(found)
    assert f"seat {seats[0]}" in next_measurements(found)


@pytest.mark.long
@pytest.mark.parametrize("timed", [True, False])
def test_a_seat_that_only_the_recalibrated_arm_excludes_is_in_the_headline(sino6, timed):
    """Moved midway by 60 µm: what is added to the noise for it hides that. Only with times it has a
    name.
    """
    noise = {"encoder_noise": 8e-6, "probe_noise": 5e-6, "reference_noise": 5e-6}
    records = simulate_measurements(sino6, "seats", 200, rng=np.random.default_rng(3), **noise)
    seats = records.conditions.require("seat", "test")
    own = np.flatnonzero(seats == seats[0])
    moved = records.q.copy()
    late = own[len(own) // 2 :]
    jacobian = sino6.jacobian(moved[late])
    moved[late] += (np.linalg.pinv(jacobian) @ np.array([6e-5, 0.0, 0.0])[:, None])[:, :, 0]
    conditions = records.conditions if timed else replace(records.conditions, time=None)
    records = replace(records, q=moved, conditions=conditions)
    found = diagnose(sino6, records, hold_out=False, **noise)
    assert f"seat {seats[0]}" in verdict_in_words(found)
    if timed:
        (finding,) = found.findings
        assert (found.verdict, finding.label) == ("explained", f"seat_shift:{seats[0]}")
        off = np.abs(np.array(finding.effect.values) - [6e-5, 0.0, 0.0])
        assert (off < 3.3 * np.array(finding.effect.u)).all()
        return
    assert not found.findings
    assert found.verdict not in ("no-discrepancy", "explained") or any(
        str(seats[0]) in label for label in found.otherwise
    )


@pytest.mark.parametrize(("times", "exceeds"), [(1.0, False), (1.1, False), (1.6, True)])
def test_residuals_much_larger_than_the_stated_noise(sino6, times, exceeds):
    """The same noise in all coordinates, but stated too small."""
    stated = 5e-5
    records = simulate_measurements(
        sino6, "free", 200, reference_noise=times * stated, rng=np.random.default_rng(4)
    )
    records = Measurements.of(records.q, records.reference)
    fitted = calibrate(sino6, records, reference_noise=stated, hold_out=False).fit
    assert exceeds_noise(fitted) == exceeds
