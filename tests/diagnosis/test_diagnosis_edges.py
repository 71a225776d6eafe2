"""Files that are few, odd or degenerate: no traceback, no false alarm, no number that means
nothing.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import next_measurements
from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.diagnosis import diagnose, thresholds
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.effects import (
    Conditions,
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointCompliance,
    JointHysteresis,
    StylusOffset,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.report.plots.partial_residuals import partial_residual
from tests.again import again
from tests.arm_files import serial_urdf
from tests.cli import shell
from tests.few_causes import ECCENTRICITY_ALONE, FEW
from tests.notes import data_of

NOISE = "--encoder-noise 8e-6 --u-reference-mm 0.012 --probe-noise-mm 0.012"


def records(folder: Path, words: str) -> pd.DataFrame:
    """Virtual measurements of sino6."""
    path = folder / "simulated.csv"
    probe = "" if "free" in words else "--probe-noise-mm 0.012"
    shell.done(f"simulate sino6 --scheme {words} {probe} -o {path} --force")
    return pd.read_csv(path)


def diagnosed(
    folder: Path, table: pd.DataFrame, words: str = "--no-cross-validation"
) -> dict[str, Any]:
    path = folder / "data.csv"
    table.to_csv(path, index=False)
    return shell.found(f"diagnose sino6 {path} {NOISE} {words}")


def test_records_that_are_too_few_are_not_taken_for_a_plan(sino6):
    data = simulate_measurements(sino6, "seats", 60, rng=np.random.default_rng(1), seats=6).take(
        range(3)
    )
    with pytest.raises(AacmmError, match="expected more records"):
        diagnose(sino6, data, hold_out=False)


@FEW
def test_a_cause_is_named_where_parts_have_seats_with_a_single_record(tmp_path):
    """Few bars are torn into blocks of joint space, where a seat may have one record that nothing
    can be compared with.
    """
    cause = "encoder_eccentricity:joint=3,amplitude_rad=1e-4,phase_rad=0.5"
    plan = "ball-bar --records 80 --seats 8 --bar-length-mm 500"
    found = diagnosed(tmp_path, records(tmp_path, f"{plan} --cause {cause}"))
    assert [(f["cause"], f["joint"]) for f in found["findings"]] == [("encoder_eccentricity", 3)]


@FEW
@pytest.mark.parametrize("seats", ["2", again("8")])
def test_seats_of_unknown_place_show_no_structure_of_their_own(tmp_path, seats):
    """An arm that shrinks to a point meets every seat of unknown place: that is no structure over
    time or temperature.
    """
    table = records(tmp_path, f"seats --records 60 --seats {seats} --no-seat-coordinates")
    found = diagnosed(tmp_path, table)
    assert found["verdict"] == "no-discrepancy"
    assert found["unexplained"]["p_value"] > 1e-3


@FEW
@pytest.mark.parametrize("count", [3, again(5)])
def test_few_records_in_an_unknown_frame(tmp_path, count):
    """The frame is all but all that they tell; what else is refitted is known from before alone."""
    table = records(tmp_path, "free --records 20").head(count)
    found = diagnosed(tmp_path, table, "--reference-frame external")
    assert found["verdict"] == "inconclusive"
    assert found["rms_mm"]["recalibrated"] < found["rms_mm"]["noise"]


@ECCENTRICITY_ALONE
def test_a_clock_that_starts_anew_needs_sessions(tmp_path):
    table = records(tmp_path, "free --records 40").sort_values("time_s")
    table.loc[table.index[20:], "time_s"] -= table["time_s"].iloc[19]
    for session, noted in ((None, True), (["a"] * 20 + ["b"] * 20, False)):
        told = table if session is None else table.assign(session=session)
        codes = diagnosed(tmp_path, told)["note_codes"]
        assert ("clock_restarts" in codes) == noted


def urdf() -> str:
    """Four joints in a row, the third of which slides."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    body = f'<inertial><origin xyz="0.2 0 0"/><mass value="1.5"/>{inertia}</inertial>'
    places = ("0 0 0.2", "0.1 0 0.3", "0.5 0 0", "0.3 0 0")
    joints = [
        ("revolute", axis, place, -1.2, 1.2)
        for axis, place in zip(("0 0 1", "0 1 0", "1 0 0", "0 0 1"), places, strict=True)
    ]
    joints[2] = ("prismatic", *joints[2][1:3], 0, 0.4)
    return serial_urdf(joints, "0.3 0 0", body)


@FEW
def test_a_joint_that_slides_is_read_in_millimetres(tmp_path):
    path = tmp_path / "slider.urdf"
    path.write_text(urdf())
    arm = Arm.from_urdf(path, "tip")
    hidden = JointHysteresis(3, values=(2e-4,)), EncoderEccentricity(1, values=(3e-4, 0.0))
    data = simulate_measurements(ErrorModel(arm, hidden), "free", 100, rng=np.random.default_rng(1))
    found = diagnose(arm, data, encoder_noise=8e-6, hold_out=False)
    shown = {finding.label: str(finding) for finding in found.findings}
    assert shown.keys() == {each.label for each in hidden}
    assert "µm" in shown["joint_hysteresis:3"]
    groups = found.residual_groups
    ends = (
        groups[groups["by"] == "joint 3"]["group"].str.extract(r"(\d+) to (\d+) mm").astype(float)
    )
    assert 300 < ends.max().max() <= 400
    drawn = partial_residual(found, EncoderGain(3, values=(1e-4,)))
    assert "mm" in drawn.x_label
    assert 300 < drawn.x.max() <= 400
    sliding = [c for c in covariates(arm, data) if "joint 3" in c.depends_on]
    assert all("joint3_mm" in c.values and c.values["joint3_mm"].max() <= 400 for c in sliding)
    assert not any(way.carrier == "angle 3" for c in sliding for way in c.variants)


@ECCENTRICITY_ALONE
def test_what_touches_of_a_seat_share_is_predicted(sino6):
    """An arm as it should be, at seats that are less certain than it is."""
    data = simulate_measurements(
        sino6,
        "seats",
        90,
        seats=30,
        rng=np.random.default_rng(3),
        reference_noise=2e-5,
        encoder_noise=8e-6,
    )
    exact = replace(sino6, parameters=tuple(replace(p, u=0.0) for p in sino6.parameters))
    groups = diagnose(
        exact, data, encoder_noise=8e-6, probe_noise=0.0, hold_out=False
    ).residual_groups
    of_joint = groups[groups["by"] == "joint 1"]["times_predicted"]
    assert of_joint.mean() == pytest.approx(1.0, abs=0.2)


# --- what makes a verdict worth less than it looks


@pytest.fixture(scope="module")
def compliant(sino6) -> Measurements:
    model = ErrorModel(sino6, (JointCompliance(2, values=(2e-5,)),))
    return simulate_measurements(model, "free", 60, rng=np.random.default_rng(3))


@FEW
def test_noise_stated_a_hundred_times_too_large_is_not_answered_with_more_records(sino6, compliant):
    early = replace(compliant, conditions=replace(compliant.conditions, time=np.arange(60.0) - 1e9))
    found = diagnose(sino6, early, encoder_noise=8e-4, reference_noise=1e-3, hold_out=False)
    assert data_of(found.notes, "clock_offset") == [{"least": -1e9}]
    assert found.verdict == "inconclusive"
    assert "unit" in next_measurements(found)
    assert "more records" not in next_measurements(found)
    assert "noise_too_large" in [note.code for note in found.notes]
    with pytest.raises(AacmmError, match=r"encoder_noise\[0\] is 8 rad; expected 0 to 0\.005 rad"):
        diagnose(sino6, compliant, encoder_noise=8.0)


@FEW
def test_a_seat_is_not_odd_where_readings_move_far_tips_more(sino6):
    """Noise of the encoders alone, which nobody stated: the seats far out scatter more than those
    near the base.
    """
    noise = np.radians(5 / 3600)
    data = simulate_measurements(
        sino6, "seats", 150, known=False, encoder_noise=noise, rng=np.random.default_rng(1)
    )
    found = diagnose(sino6, data, hold_out=False)
    assert (found.verdict, found.unexplained.groups) == ("no-discrepancy", ())


@FEW
def test_an_arm_that_states_all_its_values_to_be_exact(sino6):
    """Nothing is refitted then, and only causes can explain what is left."""
    exact = replace(
        sino6, parameters=tuple(replace(p, u=0.0, half_width=0.0) for p in sino6.parameters)
    )
    model = ErrorModel(exact, (JointCompliance(2, values=(2e-5,)),))
    found = diagnose(
        exact,
        simulate_measurements(model, "free", 60, rng=np.random.default_rng(3)),
        encoder_noise=8e-6,
        hold_out=False,
    )
    assert (found.verdict, [f.label for f in found.findings]) == (
        "explained",
        ["joint_compliance:2"],
    )


@FEW
@pytest.mark.parametrize("u", [(2e-5, 2e-5, 2e-5), again(())])
def test_a_known_target_is_refitted_once(sino6, rng, u):
    """The place of a target that the arm's file has, with or without u; and one that it does not
    have.
    """
    known = ErrorModel(sino6, (StylusOffset("B", values=(5e-3, 1e-2, -3e-3), u=u),))
    truth = known.with_effects(
        StylusOffset("C", values=(1e-3, 2e-3, 0.0)), EncoderEccentricity(3, values=(1.5e-4, 5e-5))
    )
    q, conditions = (
        random_postures(sino6, 80, rng),
        Conditions(80, marker=np.array(["B", "C"] * 40, dtype=object)),
    )
    measured = truth.predict(q, conditions) + rng.normal(0.0, 1e-5, (80, 3))
    data = Measurements.of(q, measured, conditions=conditions)
    found = diagnose(known, data, encoder_noise=1e-6, reference_noise=1e-5, hold_out=False)
    assert (found.verdict, [finding.label for finding in found.findings]) == (
        "explained",
        ["encoder_eccentricity:3"],
    )
    (other,) = known.input_warnings(q, conditions)
    assert (other.code, other.data["markers"]) == ("markers_unknown", ["C"])


@ECCENTRICITY_ALONE
def test_long_files_are_thinned_evenly(sino6, rng, monkeypatch):
    hidden = EncoderEccentricity(joint=3, values=(1e-4, 0.0))
    data = simulate_measurements(ErrorModel(sino6, (hidden,)), "free", 300, rng=rng)
    few = replace(thresholds.THRESHOLDS, most_records=100)
    monkeypatch.setattr(sys.modules[diagnose.__module__], "THRESHOLDS", few)
    found = diagnose(sino6, data, encoder_noise=8e-6, hold_out=False)
    assert [finding.label for finding in found.findings] == ["encoder_eccentricity:3"]
    rows = found.extended.problem.measurements.row
    assert rows.size == 100
    assert np.diff(rows).tolist().count(3) > 90
    assert data_of(found.notes, "records_spread") == [{"used": 100, "of": 300}]
