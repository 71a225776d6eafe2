"""Hidden effects of a plant that shares no code with the package, found through the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from blind import draw
from typer.testing import CliRunner

from aacmm_pin.cli import app

NOISE = ["--encoder-noise-rad", "8e-6", "--reference-noise-mm", "0.012"]


def diagnosis(folder: Path, *extra: str, seed: int, cause: str | None, **options: Any) -> tuple[dict[str, Any], Any]:
    """What the command says of a file of the plant, and the truth."""
    hidden = draw(seed, cause, **options)
    data = folder / "data.csv"
    hidden.write(data)
    result = CliRunner().invoke(app, ["diagnose", "sino6", str(data), *NOISE, "--json", "-", *extra])
    assert result.exit_code == 0, result.output
    content: dict[str, Any] = json.loads(result.stdout)
    return content, hidden.truth


CAUSES = [
    ("encoder_eccentricity", "free", 3),
    ("encoder_ellipticity", "free", 4),
    ("joint_periodic_error", "free", 5),
    ("joint_compliance", "free", 1),
    ("link_bending", "free", 1),
    ("thermal_expansion", "free", 2),
    ("joint_hysteresis", "seats", 3),
    ("encoder_gain", "seats", 4),
]


@pytest.mark.parametrize(("cause", "plan", "seed"), CAUSES)
def test_a_hidden_cause_is_named(tmp_path: Path, cause: str, plan: str, seed: int) -> None:
    probe = ["--probe-noise-mm", "0.012"] if plan == "seats" else []
    found, truth = diagnosis(tmp_path, *probe, seed=seed, cause=cause, plan=plan)
    (hidden,) = truth.hidden
    named = [(f["cause"], f["joint"]) for f in found["findings"]]
    assert named[0] == (hidden.cause, hidden.joint)
    assert found["verdict"] in ("explained", "ambiguous")
    assert found["held_out"]["rms_mm"]["extended"] <= found["held_out"]["rms_mm"]["recalibrated"] * 1.005


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_nothing_hidden_is_said_to_be_nothing(tmp_path: Path, seed: int) -> None:
    found, _ = diagnosis(tmp_path, seed=seed, cause=None, plan="free", outliers=0.1 if seed == 13 else 0.0)
    assert found["verdict"] == "no-discrepancy"
    assert found["findings"] == []


def test_what_no_cause_explains_is_said_to_be_that(tmp_path: Path) -> None:
    found, _ = diagnosis(tmp_path, seed=2, cause="unexplained:operator", plan="free")
    assert found["verdict"] == "unexplained"
    assert "operator" in found["unexplained"]["depends_on"]


def test_the_extended_arm_is_written_and_used(tmp_path: Path) -> None:
    extended = tmp_path / "extended.toml"
    diagnosis(tmp_path, "--extended-arm", str(extended), seed=3, cause="encoder_eccentricity", plan="free")
    out = tmp_path / "corrected.csv"
    done = CliRunner().invoke(app, ["correct", str(extended), str(tmp_path / "data.csv"), "-o", str(out)])
    assert done.exit_code == 0, done.output
    again = CliRunner().invoke(app, ["diagnose", str(extended), str(tmp_path / "data.csv"), *NOISE, "--json", "-"])
    assert json.loads(again.stdout)["verdict"] == "no-discrepancy"
