"""Many files at once: each row is what a diagnosis of its own says, wherever it was worked out, and
a file that cannot be used is a row.
"""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import ErrorModel, Measurements, diagnose, simulate_measurements
from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import diagnose_files
from aacmm_pin.errors import AacmmError
from tests.cli import shell
from tests.few_causes import ECCENTRICITY_ALONE

NOISE = {"encoder_noise": 8e-6, "reference_noise": 1.2e-5}
OPTIONS = "--encoder-noise 8e-6 --u-reference-mm 0.012"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Files of an eccentric encoder, of nothing, of another arm, and one that is no table."""
    folder = tmp_path_factory.mktemp("fleet")
    bent = ErrorModel("sino6", ["encoder_eccentricity:3,amplitude_rad=3e-4"])
    for name, arm in (("bent", bent), ("good", "sino6")):
        records = simulate_measurements(arm, "free", 60, rng=np.random.default_rng(1))
        records.save(folder / f"{name}.csv")
    table = pd.read_csv(folder / "good.csv")
    table.drop(columns="theta6_deg").to_csv(folder / "other.csv", index=False)
    (folder / "empty.csv").write_text("")
    ErrorModel.load("sino6").save(folder / "arm.toml")
    return folder


@pytest.mark.long
@pytest.mark.parametrize("workers", [1, "threads"])
def test_rows_are_those_of_single_diagnoses(folder, workers):
    paths = [folder / f"{name}.csv" for name in ("bent", "empty", "good", "missing", "other")]
    pairs = [("sino6", path) for path in paths]
    with ThreadPoolExecutor(2) as pool:
        table = diagnose_files(pairs, workers=1 if workers == 1 else pool, **NOISE)
    assert [*table["records"]] == [*map(str, paths)]
    assert {*table["arm"]} == {"sino6"}
    for row in (0, 2):
        found, alone = table.iloc[row], diagnose("sino6", paths[row], **NOISE)
        assert found["error"] == ""
        assert found["verdict"] == alone.verdict
        assert found["causes"] == {one.label: one.probability for one in alone.findings}
        rms = [found[f"rms_{name}_mm"] for name in ("as_stated", "recalibrated", "extended")]
        expected = [alone.rms[name] / MM for name in ("nominal", "recalibrated", "extended")]
        assert (rms, found["noise_mm"]) == (expected, alone.rms["noise"] / MM)
        gain = (found["gain"], found["gain_low"], found["gain_high"])
        assert alone.held_out is not None
        assert gain == (alone.held_out.gain, *alone.held_out.interval)
        assert (found["used"], found["excluded"]) == (60, len(alone.excluded))
        assert (found["causes_shown"], found["causes_tried"]) == alone.visible
    for row in (1, 3, 4):
        found = table.iloc[row]
        with pytest.raises(AacmmError) as raised:
            diagnose("sino6", paths[row])
        assert found["error"] == str(raised.value)
        assert found.drop(["arm", "records", "causes", "error"]).isna().all()


@ECCENTRICITY_ALONE
def test_arms_and_records_need_no_files(folder):
    approach = [f"approach{j}" for j in range(1, 7)]
    table = pd.read_csv(folder / "good.csv").drop(columns=approach)
    arm, records = ErrorModel.load("sino6"), Measurements.from_frame(table, 6)
    options = {"hold_out": False, **NOISE}
    first, second = diagnose_files(
        [(arm, records), ("sino7", records)], approach_from_order=True, progress=False, **options
    ).itertuples()
    assert (first.arm, first.records) == ("SINO6", records.source)
    alone = diagnose(arm, records.with_approach_from_order(), **options)
    assert first.rms_extended_mm == alone.rms["extended"] / MM
    assert np.isnan(first.gain)
    assert "sino7" in second.error
    assert len(diagnose_files([])) == 0


@ECCENTRICITY_ALONE
def test_a_fleet_at_the_shell(folder, tmp_path):
    bent, good, empty = (folder / f"{name}.csv" for name in ("bent", "good", "empty"))
    target = tmp_path / "table.csv"
    words = f"diagnose-files sino6 {bent} {folder / 'arm.toml'} {good} {OPTIONS}"
    out, _ = shell.done(words, "--no-cross-validation", f"-o {target}")
    assert "encoder_eccentricity:3" in out
    table = pd.read_csv(target)
    assert [*table["arm"]] == ["sino6", str(folder / "arm.toml")]
    assert "encoder_eccentricity:3" in table["causes"][0]
    assert table["error"].isna().all()
    status, out, err = shell.run(
        f"diagnose-files sino6 {empty} {good} {OPTIONS} --no-cross-validation --json -"
    )
    assert status == 1
    assert "1 of 2 files" in err.splitlines()[-1]
    rows = json.loads(out)["files"]
    assert [row["records"] for row in rows] == [str(empty), str(good)]
    assert "only comments; expected a header" in rows[0]["error"]
    assert (rows[0]["verdict"], rows[1]["error"]) == (None, "")
    assert rows[1]["verdict"] == "no-discrepancy"


def test_files_of_a_robot_by_its_urdf(tmp_path, robot_file):
    robot = f"--urdf {robot_file('ur5_robot.urdf')} --frame tool0"
    for name in ("one.csv", "two.csv"):
        (tmp_path / name).write_text("theta1_deg,x_mm,y_mm,z_mm\n1,2,3,4\n")
    files = f"{tmp_path / 'one.csv'} {tmp_path / 'two.csv'}"
    status, out, _ = shell.run(f"diagnose-files {robot} {files} --json -")
    rows = json.loads(out)["files"]
    assert status == 1
    assert ["the arm has 6" in row["error"] for row in rows] == [True, True]
    assert shell.run(f"diagnose-files {robot} sino6 {files}")[0] == 2
    assert shell.run(f"diagnose-files --frame tool0 sino6 {files}")[0] == 2


@pytest.mark.parametrize("words", ["data.csv", "sino6", "data.csv sino6", "sino6 data.csv sino6"])
def test_each_file_has_an_arm_and_each_arm_a_file(words):
    assert shell.run(f"diagnose-files {words}")[0] == 2
