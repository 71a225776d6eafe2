"""A diagnosis as a document: in agreement with the numbers, and complete for every verdict."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from markupsafe import escape
from matplotlib import pyplot as plt

from aacmm_pin import next_measurements
from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.diagnosis import Alias, Diagnosis, Finding
from aacmm_pin.effects import (
    Effect,
    EncoderEccentricity,
    EncoderGain,
    JointCompliance,
    JointZeroOffset,
    StylusOffset,
    values_in_words,
)
from aacmm_pin.report.diagnosis_page import (
    alias_table,
    alternatives,
    diagnosis_document,
    gain_in_words,
    open_forms_in_words,
    places_table,
    ranking,
    residuals_table,
    summary_line,
    unexplained_in_words,
)
from aacmm_pin.report.document import Figure
from aacmm_pin.report.formats import html
from aacmm_pin.report.numbers import lengths
from aacmm_pin.report.scenes.scene import viewer_script
from aacmm_pin.report.verdicts import verdict_in_words
from tests.pages import Page

NAME = "a <b> & c.csv"


def written(result: Diagnosis) -> str:
    summary = result.summary() | {"source": NAME, "seed": 1}
    return html.page(diagnosis_document(result, summary, "2026-01-02"))


def pictures(result: Diagnosis) -> list[str]:
    """What the figures of the document show."""
    blocks = diagnosis_document(result, {"source": NAME, "next_measurements": ""}).blocks
    return [block.alt for block in blocks if isinstance(block, Figure)]


def test_a_page_agrees_with_its_numbers_and_holds_its_files(eccentric):
    text = written(eccentric)
    page, held = Page(text), eccentric.held_out
    assert plt.get_fignums() == []
    # The viewer of scenes names places in its licences.
    assert "http" not in text.replace(escape(viewer_script()), "")
    assert len(text) < 5_000_000
    assert NAME in page.text  # escaped, so that it is text again
    assert verdict_in_words(eccentric) in page.text
    assert "encoder eccentricity of joint 1" in verdict_in_words(eccentric)
    assert summary_line(eccentric) in page.text
    assert all(size in summary_line(eccentric) for size in lengths(eccentric.rms.values()))
    low, high = held.interval
    assert f"(95 % interval: {100 * low:.0f} to {100 * high:.0f} %)" in summary_line(eccentric)
    assert (
        values_in_words(eccentric.findings[0].effect, eccentric.findings[0].parameters) in page.text
    )
    assert [image["alt"] for image in page.all("img")] == pictures(eccentric)
    assert "Encoder eccentricity of joint 1, from the records" in pictures(eccentric)
    assert len(eccentric.excluded) == 3
    for row in eccentric.excluded.to_dict("records"):
        assert f"{row['residual_mm']:.4f}" in page.text
    files = page.downloads()
    assert list(files) == ["diagnosis.json", "residuals.csv", "extended.toml"]
    assert json.loads(files["diagnosis.json"]) == json.loads(
        json.dumps(eccentric.summary() | {"source": NAME, "seed": 1})
    )
    assert parse_arm_file(files["extended.toml"], "inside") == eccentric.model.file()
    table = pd.read_csv(io.BytesIO(files["residuals.csv"]))
    assert len(table) == 80
    used = table[table["used"]]
    for name in ("nominal", "recalibrated", "extended"):
        assert np.sqrt(np.mean(used[f"{name}_mm"] ** 2)) == pytest.approx(1e3 * eccentric.rms[name])
        parts = used[[f"{axis}_{name}_mm" for axis in "xyz"]].to_numpy()
        np.testing.assert_allclose(np.linalg.norm(parts, axis=1), used[f"{name}_mm"])


def test_other_verdicts(sound, blind):
    assert sound.verdict == "no-discrepancy"
    assert "0 %" not in gain_in_words(sound)  # both arms are one
    unknown = blind("unexplained:operator", 2, hold_out=False)
    assert "operator" in verdict_in_words(unknown)
    assert "operator" in " ".join(unexplained_in_words(unknown.unexplained))
    assert any("operator" in picture for picture in pictures(unknown))
    columns = {"row", "session", "operator", "part", "held_out_extended_mm"}
    assert columns <= set(residuals_table(sound).columns)


def finding(effect: Effect, probability: float, *aliases: Alias) -> Finding:
    values = {key: (value, 1e-6) for key, value in effect.file_values().items()}
    return Finding(effect, values, probability, 0.0, 0.3, aliases)


def with_sets(result: Diagnosis, **sets: float) -> Diagnosis:
    """The same with other probabilities of sets of one cause each; ``cause__2`` is one of
    joint 2.
    """
    posterior = result.choice.posterior
    names, blocks = posterior.space.candidates.design.names, posterior.space.candidates.blocks
    labels = {cause.replace("__", ":"): share for cause, share in sets.items()}
    first = {
        label: next(k for k, b in enumerate(blocks) if names[b.candidate] == label)
        for label in labels
    }
    weights = {(first[label],): share for label, share in labels.items()}
    return replace(
        result, choice=replace(result.choice, posterior=replace(posterior, weights=weights))
    )


def test_a_place_can_be_certain_and_its_form_open(eccentric):
    result = with_sets(
        eccentric, encoder_eccentricity__2=0.49, encoder_gain__2=0.47, joint_compliance__2=0.04
    )
    angle, load = result.places
    assert (angle.depends_on, load.depends_on) == ("angle", "load")
    assert angle.probability == pytest.approx(0.96)
    assert list(angle.forms) == [("encoder_eccentricity:2",), ("encoder_gain:2",)]
    assert places_table(result)["probability"].tolist() == ["0.960"]
    said = open_forms_in_words(result)
    assert all(words in said for words in ("Joint 2", "angle", "0.490", "encoder gain 0.470"))
    assert not open_forms_in_words(with_sets(eccentric, encoder_gain__2=0.9, stylus_offset=0.1))


def test_doubt_is_told_with_the_rivals(eccentric):
    others = [(EncoderEccentricity(2), 0.98, 0.29), (EncoderGain(2), 0.5, 0.0002)]
    aliases = [Alias(effect.label, r, p, effect) for effect, r, p in others]
    doubtful = finding(JointCompliance(2, values=(2e-5,), u=(1e-6,)), 0.7, *aliases)
    shares = {"joint_compliance__2": 0.7, "encoder_eccentricity__2": 0.29, "encoder_gain__2": 0.01}
    result = with_sets(replace(eccentric, verdict="ambiguous", findings=(doubtful,)), **shares)
    assert alias_table(result)["label"].tolist()[:1] == ["encoder_eccentricity:2"]
    assert sum(map(float, alternatives(with_sets(eccentric, **shares))["probability"])) == 1.0
    beside = replace(result, verdict="unexplained", doubts=("more causes",))
    for words in ("compliance under gravity of joint 2", "0.700", "0.290"):
        assert words in verdict_in_words(result)
    command = next_measurements(beside)
    assert all(label.replace("__", ":") in command for label in [*shares][:2])
    assert "aacmm-pin plan distinguish sino6" in command
    assert ranking(replace(eccentric, verdict="unexplained"))["p"].tolist()[0] == "< 1e-16"


def test_geometry_and_what_is_alike_in_all_records(eccentric):
    moved = finding(JointZeroOffset(4, values=(2e-4,), u=(1e-5,)), 1.0)
    offset = finding(StylusOffset(values=(1e-4, 0.0, 0.0)), 1.0)
    result = replace(eccentric, findings=(moved, offset))
    assert "zero offset of joint 4" in verdict_in_words(result)
    assert not any("from the records" in alt for alt in pictures(result))
    assert ranking(result)["displacement [mm]"].tolist()[1] == "0.1000"
    assert "no cause" not in verdict_in_words(replace(eccentric, findings=(moved,)))
