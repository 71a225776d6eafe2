"""Tables at the shell: nothing cut off at eighty columns, nothing coloured in a pipe, the numbers
those of the JSON.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from shell import NOISE, POINT, run

from aacmm_pin.effects import CAUSES, EncoderEccentricity, ErrorModel, JointCompliance, example
from aacmm_pin.measurements import simulate_measurements
from aacmm_pin.report import terminal
from aacmm_pin.report.document import Document, Table
from aacmm_pin.report.numbers import length
from tests.few_causes import FEW


def told(*words: object, columns: int | None = 80) -> str:
    """What a command writes at that many columns."""
    status, out, err = run(*words, columns=columns)
    assert status == 0, err
    return out


def in_one(text: str) -> str:
    """Without line breaks and padding: what was wrapped comes together again."""
    return re.sub(r"\s+", " ", text)


@pytest.fixture(scope="module")
def data(tmp_path_factory, sino6) -> Path:
    path = tmp_path_factory.mktemp("tables") / "data.csv"
    hidden = (EncoderEccentricity(3, values=(1e-4, 0.0)), JointCompliance(2, values=(2e-5,)))
    simulate_measurements(
        ErrorModel(sino6, hidden), "free", 100, rng=np.random.default_rng(1)
    ).save(path)
    return path


def check(text: str, width: int = 80) -> None:
    assert "…" not in text.replace("θ1 … θn", "").replace("… and", "")
    assert "\x1b" not in text
    table = False
    for line in text.splitlines():
        table = "───" in line or (table and line.strip() != "")
        if table:
            assert len(line) <= width, line


@FEW
def test_a_diagnosis_in_readable_units(data, tmp_path):
    """At 200 columns; JSON in a file beside it."""
    target = tmp_path / "d.json"
    wide = told(f"diagnose sino6 {data} {NOISE} --no-cross-validation --json {target}", columns=200)
    found = json.loads(target.read_text(encoding="utf-8"))
    check(wide, 200)
    assert [f["cause"] for f in found["findings"]] == ["joint_compliance", "encoder_eccentricity"]
    for finding in found["findings"]:
        assert f"{finding['cause']}:{finding['joint']}" in wide
        (value, u) = (
            finding["parameters"][next(iter(finding["parameters"]))][k] * 1e6
            for k in ("value", "u")
        )
        numbers = re.findall(r"(\d+\.?\d*) ± (\d+\.?\d*)", wide)
        assert min(abs(float(a) - value) + abs(float(b) - 2 * u) for a, b in numbers) < 0.2 * u
    assert re.search(r"compliance 20\.\d\d ± 0\.6\d µrad/\(N·m\)", wide)
    assert "(k = 2)" in wide
    assert "amplitude_rad" not in wide
    assert length(1e-3 * found["rms_mm"]["nominal"]) in wide


def test_a_calibration(data, tmp_path):
    """With a JSON file the findings are told all the same."""
    text = told(f"calibrate sino6 {data} {NOISE} --json {tmp_path / 'c.json'}")
    check(text)
    found = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))
    assert found["schema"] == "aacmm-pin/calibration/1"
    for row in found["parameters"]:
        (line,) = (line for line in text.splitlines() if line.split()[:1] == [row["parameter"]])
        assert f"{row['after']:.5f} mm" in line or f"{row['after']:.7f} rad" in line
    for held in found["held_out"]:
        assert f"{held['rms_mm']['calibrated']:.4f}" in text
    excluded = [str(row["row"]) for row in found["records"]["excluded"]]
    assert set(excluded[:10]) <= {line.split()[0] for line in text.splitlines() if line.split()}


def test_accuracy_map_and_plan(tmp_path):
    check(told(f"accuracy sino6 {POINT} --samples 24"))
    target = tmp_path / "m.nc"
    text = told(f"map sino6 --cells 3 3 --sectors 4 -o {target} --json {tmp_path / 'm.json'}")
    check(text)
    assert target.exists()
    assert "3 × 3 cells" in in_one(text)
    quick = [
        f"--records 4 --postures 60 -o {tmp_path / 'p.csv'} --json {tmp_path / 'p.json'} --force"
    ]
    text = told("plan distinguish sino6 --causes bearing_tilt:1 base_compliance", quick)
    check(text)
    for words in ("the same effect", "rotate the mount by 90°", "1 kg on the end"):
        assert words in in_one(text)
    check(told("plan distinguish sino6", quick))


def test_names_are_in_one_piece_however_narrow_the_terminal_is():
    known = {
        cause.cause + (f":{site.upper()}" if (site := cause.location_field()) else "")
        for cause in CAUSES.values()
    }
    known |= {
        key
        for cause in CAUSES.values()
        if (effect := example(cause))
        for key in [*effect.file_values()][:1]
    }
    known |= {"temperature_c", "time_s"}
    for columns in (40, 80, 200):
        assert known <= set(told("causes", columns=columns).replace(",", " ").split()), columns


def test_markup_is_text_and_long_cells_are_wrapped(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    words = " ".join(f"word{k}" for k in range(30))
    frame = pd.DataFrame({"a [mm]": [1.5, -22.0], "note": ["[red]x[/red] :smile:", words]})
    terminal.show(Document("", [Table(frame, "head", {"a [mm]": ".1f"})]))
    out = capsys.readouterr().out
    assert out.startswith("head:\n")
    assert "a [mm]" in out
    assert "[red]x[/red] :smile:" in in_one(out)
    assert all(f"word{k}" in out for k in range(30))
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 40
    terminal.show(Document("", ["", Table(pd.DataFrame({"a": []}), "nothing")]))
    assert capsys.readouterr().out == ""
