"""``diagnose --json`` for every verdict: the numbers can be what they are called, agree with one
another, and with the text. Which keys there are: tests/test_documented_formats.py.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.diagnosis import THRESHOLDS
from aacmm_pin.diagnosis.verdict import DOUBTS
from aacmm_pin.effects import CAUSES
from tests.cli import shell
from tests.few_causes import FEW

NOISE = "--encoder-noise 8e-6 --u-reference-mm 0.012"
ECCENTRIC = "--cause encoder_eccentricity:joint=3,amplitude_rad=1e-4,phase_rad=0.5"
SHARES = ("probability", "p_value", "threshold", "retained_fraction", "total_variation")
SIZES = ("u", "rms_mm", "noise", "nominal", "recalibrated", "extended", "times", "residual_mm")
UNITS = {"rad", "mm", "c", "s", "nm", "n", "k", "mrad"}
UNITLESS = {"gain", "scale"}


def cells(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """All that is no object and no list, with its key."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from cells(inner, name)
    elif isinstance(value, list):
        for inner in value:
            yield from cells(inner, key)
    else:
        yield key, value


def check_values(found: dict[str, Any]) -> None:
    """Numbers are within their bounds, names are those of the package."""
    for key, value in cells(found):
        if isinstance(value, str):
            assert "nan" not in value.split(), key
            assert "None" not in value, key
        elif key in SHARES and value is not None:
            assert 0.0 <= value <= 1.0, key
        elif key in SIZES and value is not None:
            assert value >= 0.0, key
    assert set(found["doubts"]) <= {*DOUBTS}
    assert sum(part["share"] for part in found["budget"]) == pytest.approx(1.0)
    for finding in found["findings"]:
        assert finding["cause"] in CAUSES
        for name in finding["parameters"]:
            assert name.rsplit("_", 1)[-1] in UNITS or name in UNITLESS, name


def simulated(folder: Path, words: str) -> pd.DataFrame:
    path = folder / "simulated.csv"
    shell.done(f"simulate sino6 {words} -o {path} --force")
    return pd.read_csv(path)


def explained(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, f"--scheme free --records 60 {ECCENTRIC}")
    table.loc[7, "x_mm"] += 3.0
    return table, ""


def nothing(folder: Path) -> tuple[pd.DataFrame, str]:
    probe = "--probe-noise-mm 0.012"
    table = simulated(folder, f"--scheme seats --records 60 --seats 6 {probe}")
    return table, f"{probe} --no-cross-validation"


def too_few(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, f"--scheme free --records 60 {ECCENTRIC}").head(20)
    return table, "--reference-frame external --no-cross-validation"


def by_operator(folder: Path) -> tuple[pd.DataFrame, str]:
    table = simulated(folder, "--scheme free --records 80")
    table["operator"] = np.repeat(["a", "b"], 40)
    table.loc[40:, "z_mm"] += 0.2
    return table, ""


CASES = {
    "explained": explained,
    "no-discrepancy": nothing,
    "ambiguous": too_few,
    "unexplained": by_operator,
}


@FEW
@pytest.mark.parametrize("verdict", CASES)
def test_every_verdict(tmp_path, verdict):
    table, options = CASES[verdict](tmp_path)
    path = tmp_path / "data.csv"
    table.to_csv(path, index=False)
    json_file = tmp_path / "found.json"
    out, _ = shell.done(f"diagnose sino6 {path} {NOISE} {options} --json {json_file}")
    found = json.loads(json_file.read_text(encoding="utf-8"))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    check_values(found)
    assert found["verdict"] == verdict
    assert found["records"]["used"] + len(found["records"]["excluded"]) == len(table)
    agrees(found, out)


def labelled(finding: dict[str, Any]) -> str:
    """Cause and place, as in the sets of causes."""
    places = (finding.get(key) for key in ("joint", "link", "seat", "marker"))
    return ":".join(
        map(str, [finding["cause"], *[place for place in places if place is not None][:1]])
    )


def agrees(found: dict[str, Any], shown: str) -> None:
    """The fields make sense of one another, and the text says the same."""
    assert shown.lower().startswith(found["verdict"].replace("-", " "))
    doubtful = [f for f in found["findings"] if f["probability"] < THRESHOLDS.settled]
    depends = found["unexplained"]["depends_on"]
    assert (found["verdict"] == "unexplained") == bool(depends)
    if not depends:
        assert (found["verdict"] == "no-discrepancy") == (not found["findings"])
        assert (found["verdict"] == "ambiguous") == bool(doubtful)
    shares = [each["probability"] for each in found["alternatives"]]
    assert shares == sorted(shares, reverse=True)
    rest = found["other_alternatives"]["probability"]
    assert sum(shares) + rest == pytest.approx(1.0)
    labels = [labelled(finding) for finding in found["findings"]]
    for label, finding in zip(labels, found["findings"], strict=True):
        inside = sum(
            each["probability"] for each in found["alternatives"] if label in each["causes"]
        )
        assert inside - 1e-9 <= finding["probability"] <= inside + rest + 1e-9
        assert finding["probability"] >= THRESHOLDS.named
    for place in found["places"]:
        there = {label for form in place["forms"] for label in form["causes"]}
        inside = sum(
            each["probability"] for each in found["alternatives"] if there & {*each["causes"]}
        )
        assert inside - 1e-9 <= place["probability"] <= inside + rest + 1e-9
        assert sum(form["probability"] for form in place["forms"]) <= place["probability"] + 1e-9
    for finding in found["findings"]:
        assert all(
            finding["probability"] + alias["probability"] <= 1.0 + 1e-9
            for alias in finding["aliases"]
        )
    rows = {line.split()[0] for line in shown.splitlines() if line.strip()}
    assert {str(record["row"]) for record in found["records"]["excluded"]} <= rows
    for name in depends:
        assert name in shown
    assert found["next_measurements"][1:] in " ".join(shown.split())
    rms = found["rms_mm"]
    assert rms["extended"] <= rms["recalibrated"] + 1e-9
    held = found["held_out"]
    assert (held is None) == (found["verdict"] in ("no-discrepancy", "ambiguous"))
    if held is not None:
        sizes = held["rms_mm"]
        assert held["gain"] == pytest.approx(1.0 - sizes["extended"] / sizes["recalibrated"])
        assert held["gain_ci95"][0] <= held["gain"] <= held["gain_ci95"][1]
