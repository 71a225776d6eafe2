"""A diagnosis as a document: in agreement with the numbers, and complete for every verdict."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from blind import draw
from matplotlib import pyplot as plt
from typer.testing import CliRunner

from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.cli import app
from aacmm_pin.diagnosis import Alias, Diagnosis, Finding, OddGroup, diagnose
from aacmm_pin.effects import EncoderEccentricity, EncoderGain, JointCompliance, JointZeroOffset, StylusOffset
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.labels import in_words, values_in_words
from aacmm_pin.errors import OutputError
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.report import html, results
from aacmm_pin.report.diagnosis import (
    diagnosis_document,
    gain_in_words,
    group_in_words,
    line_to_remember,
    look_alikes,
    ranking,
    residuals_table,
    unexplained_in_words,
    verdict_in_words,
)
from aacmm_pin.report.numbers import lengths, percent
from aacmm_pin.report.plots.groups import place_in_words
from aacmm_pin.report.scenes.page import viewer_script
from tests.pages import Page

NAME = "a <b> & c.csv"


def written(result: Diagnosis) -> str:
    summary = result.summary() | {"source": NAME, "seed": 1}
    return html.page(diagnosis_document(result, summary, "2026-01-02"))


def pictures(page: Page) -> list[str]:
    return [image["alt"] for image in page.all("img")]


def test_a_page_agrees_with_its_numbers_and_holds_its_files(eccentric: Diagnosis) -> None:
    text = written(eccentric)
    page, held = Page(text), eccentric.held_out
    assert plt.get_fignums() == []
    assert "http" not in text.replace(viewer_script(), "")  # the viewer of scenes names places in its licences
    assert len(text) < 5_000_000
    assert NAME in page.text  # escaped, so that it is text again
    assert "the simulation lacks one cause, encoder eccentricity of joint 1." in page.text
    assert line_to_remember(eccentric) in page.text
    assert all(size in line_to_remember(eccentric) for size in lengths(eccentric.rms.values()))
    assert held is not None
    low, high = held.interval
    assert f"{percent(held.gain)} less" in line_to_remember(eccentric)
    assert f"(95 %: {100 * low:.0f} to {100 * high:.0f} %)" in line_to_remember(eccentric)
    assert values_in_words(eccentric.findings[0].effect, eccentric.findings[0].parameters) in page.text
    assert len(pictures(page)) == 5
    assert "Encoder eccentricity of joint 1, from the records" in pictures(page)
    assert len(eccentric.excluded) == 3
    for row in eccentric.excluded.to_dict("records"):
        assert f"{row['residual_mm']:.3f}" in page.text
    files = page.downloads()
    assert list(files) == ["diagnosis.json", "residuals.csv", "extended.toml"]
    assert json.loads(files["diagnosis.json"]) == json.loads(json.dumps(eccentric.summary() | {"source": NAME, "seed": 1}))
    assert parse_arm_file(files["extended.toml"], "inside") == eccentric.model.file()
    table = pd.read_csv(io.BytesIO(files["residuals.csv"]))
    assert len(table) == 150
    used = table[table["used"]]
    for name in ("simulation", "recalibrated", "extended"):
        assert np.sqrt(np.mean(used[f"{name}_mm"] ** 2)) == pytest.approx(1e3 * eccentric.rms[name])
        parts = used[[f"{axis}_{name}_mm" for axis in "xyz"]].to_numpy()
        np.testing.assert_allclose(np.linalg.norm(parts, axis=1), used[f"{name}_mm"])


def test_other_verdicts(sound: Diagnosis, blind: Callable[..., Diagnosis]) -> None:
    page = Page(written(sound))
    assert "no cause is missing in the simulation" in page.text
    assert "No record was excluded." in page.text
    assert "Residual vectors on a drawing of the arm, simulation and recalibrated" in pictures(page)
    assert "nothing to gain" in gain_in_words(sound)
    page = Page(written(blind("unexplained:operator", 2)))
    assert "the residuals depend on operator, and no known cause has this shape" in page.text
    assert "Structure over operator without a known cause" in pictures(page)
    seat = blind("seat_error", 9, plan="seats")
    (finding,) = seat.findings
    words = in_words(finding.effect)
    page = Page(written(seat))
    assert f"{words[:1].upper()}{words[1:]}, from the records" in pictures(page)
    assert "It moves the stated place by" in page.text
    assert {"row", "seat", "session", "operator", "part", "held_out_extended_mm"} <= set(residuals_table(seat).columns)


def test_a_robot_without_table_or_stated_uncertainties(robot_file: Callable[[str], Path]) -> None:
    arm = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    steps = np.random.default_rng(3).normal(0.0, 2e-4, (6, 6))
    made = ErrorModel(arm.with_placements(steps, None), (EncoderEccentricity(2, values=(4e-4, 0.0)),))
    data = simulate_measurements(made, "free", 150, rng=np.random.default_rng(4))
    page = Page(written(diagnose(arm, data, encoder_noise=8e-6, hold_out=False)))
    assert list(page.downloads()) == ["diagnosis.json", "residuals.csv"]
    assert "that the noise alone gives" in page.text
    assert "Nothing was held out" in page.text


def test_the_command_writes_the_page_and_nothing_else_on_stdout(tmp_path: Path) -> None:
    data, out = tmp_path / "data.csv", tmp_path / "report.html"
    draw(11, None, records=80).write(data)
    noise = ["--encoder-noise-rad", "8e-6", "--reference-noise-mm", "0.012"]
    arguments = ["diagnose", "sino6", str(data), *noise, "--no-held-out", "-o", str(out), "--json", "-"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    page = Page(out.read_text(encoding="utf-8"))
    assert json.loads(page.downloads()["diagnosis.json"]) == json.loads(done.stdout)
    assert f"80 records of {data}" in page.text
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 1
    assert "report.html" in again.stderr


def finding(effect: JointCompliance | JointZeroOffset | StylusOffset, probability: float, *aliases: Alias) -> Finding:
    values = {key: (value, 1e-6) for key, value in effect.described().items()}
    return Finding(effect, values, probability, 0.0, 0.3, aliases)


def test_doubt_is_told_with_the_rivals(eccentric: Diagnosis) -> None:
    others = [(EncoderEccentricity(2), 0.98, 0.29), (EncoderGain(2), 0.5, 0.0002)]
    aliases = [Alias(effect.label, r, p, effect=effect) for effect, r, p in others]
    doubtful = finding(JointCompliance(2, values=(2e-5,), u=(1e-6,)), 0.7, *aliases)
    result = replace(eccentric, verdict="ambiguous", findings=(doubtful,))
    for words in ("compliance under gravity of joint 2 has probability 0.700", "encoder eccentricity of joint 2 0.290"):
        assert words in verdict_in_words(result)
    assert look_alikes(result)["label"].tolist() == ["encoder_eccentricity:2"]  # the other one is out of the question
    assert ranking(result)["p"].tolist() == ["< 1e-300"]


def test_a_cause_less_probable_than_not_is_not_called_found(eccentric: Diagnosis, tmp_path: Path) -> None:
    unlikely = finding(JointCompliance(2, values=(2e-5,), u=(1e-6,)), 0.0002)
    result = replace(eccentric, verdict="unexplained", findings=(unlikely,))
    assert "Causes found" not in written(result)
    assert "less probable than not" in written(result)
    assert "probability < 0.001" in str(result)
    assert "the simulation may lack" in verdict_in_words(replace(result, verdict="inconclusive"))
    both = replace(result, findings=(*eccentric.findings, unlikely))
    assert "Causes found" in written(both)
    results.save(both, tmp_path / "report.html")
    assert verdict_in_words(both) in Page((tmp_path / "report.html").read_text(encoding="utf-8")).text
    with pytest.raises(OutputError, match="exists already"):
        results.save(both, tmp_path / "report.html")


def test_a_group_in_words() -> None:
    assert place_in_words("joint 1", "-39 to 0°") == "joint 1, -39 to 0°"
    assert place_in_words("seat", "P3") == "seat P3"


def test_geometry_and_what_is_alike_in_all_records(eccentric: Diagnosis) -> None:
    moved = finding(JointZeroOffset(4, values=(2e-4,), u=(1e-5,)), 1.0)
    offset = finding(StylusOffset(values=(1e-4, 0.0, 0.0)), 1.0)
    result = replace(eccentric, findings=(moved, offset))
    assert "its geometry is off by unusually much for what was stated: zero offset of joint 4" in verdict_in_words(result)
    page = Page(written(result))
    assert "Geometric values beyond their stated uncertainty" in pictures(page)
    assert not any("from the records" in alt for alt in pictures(page))
    assert "It moves the tip by 0.100 mm" in page.text
    only = replace(eccentric, findings=(moved,))
    assert "no cause is missing in the simulation, but its geometry" in verdict_in_words(only)


def test_what_the_gain_is_worth(eccentric: Diagnosis) -> None:
    held = eccentric.held_out
    assert held is not None
    for interval, words in (
        ((0.4, 0.6), "% less than"),
        ((-0.1, 0.2), "not significantly better"),
        ((0.001, 0.2), "not significantly better"),
        ((-0.4, -0.2), "% more than"),
    ):
        assert words in gain_in_words(replace(eccentric, held_out=replace(held, interval=interval)))


def test_what_is_left(eccentric: Diagnosis) -> None:
    left = replace(eccentric.unexplained, p_value=1e-23)
    assert "p = 1e-23" in unexplained_in_words(replace(eccentric, unexplained=left))
    words = group_in_words(OddGroup("bar B3", 62, 1.41, 3e-7))
    assert all(part in words for part in ("62 records of bar B3", "1.4 times", "p = 3e-07"))
    unstated = replace(eccentric, extended=replace(eccentric.extended, stated=False))
    page = Page(written(unstated))
    assert "The noise was not stated in full" in page.text
