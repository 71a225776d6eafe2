"""Tables at the shell: nothing cut off at eighty columns, nothing coloured in a pipe, the numbers those of the JSON."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aacmm_pin._support.table_cells import cells, spread
from aacmm_pin.arm.arm import Arm
from aacmm_pin.cli.tables import show
from aacmm_pin.effects import EncoderEccentricity, JointCompliance
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.simulate import simulate_measurements

NOISE = ["--encoder-noise-rad", "8e-6"]
POINT = ["--point", "33.6323", "-671.8702", "182.9355"]


def piped(*words: str | Path, columns: int | None = 80) -> str:
    """What a command writes into a pipe."""
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "FORCE_COLOR")}
    if columns is not None:
        environment["COLUMNS"] = str(columns)
    command = [sys.executable, "-m", "aacmm_pin.cli", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def in_one(text: str) -> str:
    """Without line breaks and padding: what was wrapped comes together again."""
    return re.sub(r"\s+", " ", text)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory, sino6: Arm) -> Path:
    path = tmp_path_factory.mktemp("tables") / "data.csv"
    hidden = (EncoderEccentricity(3, values=(1e-4, 0.0)), JointCompliance(2, values=(2e-5,)))
    simulate_measurements(ErrorModel(sino6, hidden), "free", 100, rng=np.random.default_rng(1)).save(path)
    return path


@pytest.fixture(scope="module")
def told(data: Path) -> str:
    return piped("diagnose", "sino6", data, *NOISE, "--no-held-out")


def check(text: str, width: int = 80) -> None:
    assert "…" not in text.replace("θ1 … θn", "").replace("… and", "")
    assert "\x1b" not in text
    table = False
    for line in text.splitlines():
        table = "───" in line or (table and line.strip() != "")
        if table:
            assert len(line) <= width, line


def test_a_diagnosis_in_readable_units(told: str, data: Path) -> None:
    check(told)
    wide = piped("diagnose", "sino6", data, *NOISE, "--no-held-out", columns=200)
    check(wide, 200)
    found = json.loads(piped("diagnose", "sino6", data, *NOISE, "--no-held-out", "--json", "-"))
    assert [f["cause"] for f in found["findings"]] == ["joint_compliance", "encoder_eccentricity"]
    for finding in found["findings"]:
        assert f"{finding['cause']}:{finding['joint']}" in told
        (value, u) = (finding["parameters"][next(iter(finding["parameters"]))][k] * 1e6 for k in ("value", "u"))
        numbers = re.findall(r"(\d+\.?\d*) ± (\d+\.?\d*)", wide)
        assert min(abs(float(a) - value) + abs(float(b) - 2 * u) for a, b in numbers) < 0.2 * u
    assert "compliance 20.10 ± 0.64 µrad/(N·m)" in wide
    assert "(k = 2)" in in_one(told)
    assert "amplitude_rad" not in told
    worst = found["rms_mm"]["simulation"]
    assert f"RMS {worst:.4f} mm simulated" in told


def test_a_calibration(data: Path) -> None:
    text = piped("calibrate", "sino6", data, *NOISE)
    check(text)
    found = json.loads(piped("calibrate", "sino6", data, *NOISE, "--json", "-"))
    for row in found["parameters"]:
        (line,) = (line for line in text.splitlines() if line.split()[:1] == [row["parameter"]])
        assert f"{row['after']:.5f} mm" in line or f"{row['after']:.7f} rad" in line
    for held in found["held_out"]:
        assert f"{held['rms_mm']['calibrated']:.4f}" in text
    excluded = [str(row["row"]) for row in found["records"]["excluded"]]
    assert set(excluded[:10]) <= {line.split()[0] for line in text.splitlines() if line.split()}


def test_accuracy_and_map(tmp_path: Path) -> None:
    check(piped("accuracy", "sino6", *POINT, "--count", "24"))
    target = tmp_path / "m.nc"
    text = piped("map", "sino6", "--cells", "3", "3", "--sectors", "4", "-o", target, "--json", tmp_path / "m.json")
    check(text)
    assert target.exists()
    assert "SINO6: 3 × 3 cells × 4 sectors" in text
    assert "smallest standard uncertainty [µm]" in text


def test_a_plan(tmp_path: Path) -> None:
    quick = ["--records", "4", "--postures", "60", "-o", tmp_path / "p.csv", "--json", tmp_path / "p.json", "--force"]
    text = piped("plan", "sino6", "--split", "bearing_tilt:1", "base_compliance", *quick)
    check(text)
    for words in ("the two do the same", "turn the mount by 90°", "hang 1 kg on the end"):
        assert words in in_one(text)
    text = piped("plan", "sino6", *quick)
    check(text)
    pairs = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))["pairs"]["untold"]
    first = next(pair for pair in pairs if not pair["why_not"])
    line = next(line for line in text.splitlines() if line.split()[:2] == [first["cause"], first["other"]])
    assert float(line.split()[2]) == pytest.approx(first["T"], rel=0.01)


def test_json_is_alone_on_stdout(data: Path) -> None:
    for words in (["calibrate", "sino6", data, *NOISE, "--no-held-out"], ["accuracy", "sino6", *POINT, "--count", "12"]):
        json.loads(piped(*words, "--json", "-"))


def test_with_a_json_file_the_findings_are_told_all_the_same(data: Path, tmp_path: Path) -> None:
    text = piped("calibrate", "sino6", data, *NOISE, "--no-held-out", "--json", tmp_path / "c.json")
    assert "theta_offset3" in text
    assert json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))["schema"] == "aacmm-pin/calibration/1"


def test_where_nothing_says_how_wide_a_row_stays_on_its_line(data: Path) -> None:
    text = piped("calibrate", "sino6", data, *NOISE, "--no-held-out", columns=None)
    assert max(map(len, (line for line in text.splitlines() if "theta_offset" in line))) > 60
    assert "theta_offset3" in text


# Cells ------------------------------------------------------------------------------------------------------------------


def test_cells_are_text() -> None:
    frame = pd.DataFrame(
        {
            "number": [1.23456789, np.nan],
            "whole": pd.array([3, None], dtype="Int64"),
            "flag": [True, False],
            "names": [("a", "b"), ()],
            "word": ["<b>", None],
        }
    )
    text = cells(frame, {"number": ".2f"})
    assert text["number"].tolist() == ["1.23", "–"]
    assert text["whole"].tolist() == ["3", "–"]
    assert text["flag"].tolist() == ["yes", "no"]
    assert text["names"].tolist() == ["a, b", ""]
    assert text["word"].tolist() == ["<b>", "–"]
    assert cells(frame)["number"][0] == "1.23457"
    assert spread([np.nan, 1.0, 4.0, 3.0], ".1f") == {"least": "1.0", "median": "3.0", "largest": "4.0"}
    assert spread([np.nan], ".1f") == {"least": "–", "median": "–", "largest": "–"}


def test_markup_is_text_and_long_cells_are_wrapped(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    words = " ".join(f"word{k}" for k in range(30))
    show(pd.DataFrame({"a [mm]": [1.5, -22.0], "note": ["[red]x[/red] :smile:", words]}), {"a [mm]": ".1f"}, "head")
    out = capsys.readouterr().out
    assert out.startswith("head\n")
    assert "a [mm]" in out
    assert "[red]x[/red] :smile:" in in_one(out)
    assert all(f"word{k}" in out for k in range(30))
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 40
    show(pd.DataFrame({"a": []}), head="nothing")
    assert capsys.readouterr().out == ""
