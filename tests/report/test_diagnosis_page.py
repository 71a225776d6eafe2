"""The page of a diagnosis: self-contained, in agreement with the numbers, and right in words for every verdict."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from blind import draw
from matplotlib import pyplot as plt
from test_report import PNG, Page
from typer.testing import CliRunner

from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.cli import app
from aacmm_pin.diagnosis import Alias, Diagnosis, Finding, OddGroup, diagnose
from aacmm_pin.effects import (
    CAUSES,
    EncoderEccentricity,
    EncoderSlip,
    JointCompliance,
    JointErrorCurve,
    JointPeriodicError,
    JointZeroOffset,
    StylusOffset,
)
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.report.diagnosis_findings import (
    gain_in_words,
    group_in_words,
    in_words,
    label_in_words,
    line_to_remember,
    parameters_in_words,
    several_in_words,
    unexplained_in_words,
    verdict_in_words,
)
from aacmm_pin.report.diagnosis_page import diagnosis_page
from aacmm_pin.report.diagnosis_tables import look_alikes, ranking, residuals_table
from aacmm_pin.report.scenes.page import viewer_script

mpl.use("Agg")

NAME = "a <b> & c.csv"
TITLES = [
    "1. What came out",
    "2. What the simulation gets wrong",
    "3. The causes",
    "4. How sure the causes are",
    "5. Residuals on the arm",
    "6. On records it never saw",
    "7. What no cause explains, and records left out",
    "8. What to measure next",
    "9. Files",
]


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Diagnosis]:
    """The diagnosis of a file of the plant."""

    @cache
    def of(cause: str | None, seed: int, plan: str = "free", outliers: float = 0.0) -> Diagnosis:
        path = tmp_path_factory.mktemp("blind") / "data.csv"
        draw(seed, cause, plan=plan, records=150 if plan == "free" else 300, outliers=outliers).write(path)
        return diagnose(
            ErrorModel.load("sino6"),
            Measurements.read(path),
            encoder_noise=8e-6,
            reference_noise=12e-6,
            probe_noise=None if plan == "free" else 12e-6,
        )

    return of


@pytest.fixture(scope="module")
def eccentric(diagnosed: Callable[..., Diagnosis]) -> Diagnosis:
    """An eccentric encoder 1, three records of 150 are outliers."""
    return diagnosed("encoder_eccentricity", 3, outliers=0.02)


@pytest.fixture(scope="module")
def html(eccentric: Diagnosis) -> str:
    return written(eccentric)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def written(result: Diagnosis) -> str:
    return diagnosis_page(result, result.summary() | {"source": NAME, "seed": 1}, "2026-01-02")


def text_of(page: Page) -> str:
    return page.text.replace("\u00a0", " ")


def pictures(page: Page) -> list[str]:
    for image in page.all("img"):
        assert base64.b64decode(image["src"].partition("base64,")[2]).startswith(PNG)
    return [image["alt"] for image in page.all("img")]


def downloads(page: Page) -> dict[str, bytes]:
    links = [a for a in page.all("a") if "download" in a]
    return {a["download"]: base64.b64decode(a["href"].partition("base64,")[2]) for a in links}


# The page -----------------------------------------------------------------------------------------------------------------


def test_the_page_is_whole_and_fetches_nothing(html: str, page: Page) -> None:
    assert page.open == []
    html = html.replace(viewer_script(), "")  # the viewer of scenes names places in its licences
    assert "http:" not in html
    assert "https:" not in html
    for tag, attributes in page.tags:
        assert tag not in {"object", "embed", "base"}
        for name in ("src", "href"):
            assert attributes.get(name, "#").startswith(("data:", "#"))
    for title in TITLES:
        assert title in page.text
    assert NAME in page.text  # escaped, so that it is text again
    assert len(html) < 5_000_000


def test_pyplot_keeps_no_figure(eccentric: Diagnosis) -> None:
    written(eccentric)
    assert plt.get_fignums() == []


def test_the_verdict_comes_first_and_the_numbers_agree(page: Page, eccentric: Diagnosis) -> None:
    text = text_of(page)
    assert "SINO6: the simulation lacks one cause, encoder eccentricity of joint 1." in text
    assert text.index(line_to_remember(eccentric)) < text.index(TITLES[1], text.index(TITLES[0]))
    for value in eccentric.rms.values():
        assert f"{value / MM:.4f}" in text
    held = eccentric.held_out
    assert held is not None
    low, high = held.interval
    interval = f"(95 %: {100 * low:.0f} to {100 * high:.0f} %)"
    assert f"off by {100 * held.gain:.0f} % less than the recalibrated one {interval}" in text
    (finding,) = eccentric.findings
    assert parameters_in_words(finding) in text


def test_every_picture_is_there(page: Page) -> None:
    assert pictures(page) == [
        "RMS of the residuals by the three models",
        "RMS of the residuals by joint range, time, temperature and seat, by the three models",
        "Encoder eccentricity of joint 1, from the records",
        "Residual vectors on a drawing of the arm, recalibrated and extended",
        "RMS of each part that was left out, recalibrated and extended",
    ]


def test_excluded_records_are_listed(page: Page, eccentric: Diagnosis) -> None:
    assert len(eccentric.excluded) == 3
    where = text_of(page)[text_of(page).rindex(TITLES[6]) :]
    assert "3 records that cannot belong" in where
    for row in eccentric.excluded.to_dict("records"):
        assert str(row["row"]) in where
        assert f"{row['residual_mm']:.3f}" in where


def test_the_files_inside_come_back(page: Page, eccentric: Diagnosis) -> None:
    files = downloads(page)
    assert list(files) == ["diagnosis.json", "residuals.csv", "extended.toml"]
    summary = eccentric.summary() | {"source": NAME, "seed": 1}
    assert json.loads(files["diagnosis.json"]) == json.loads(json.dumps(summary))
    table = pd.read_csv(io.BytesIO(files["residuals.csv"]))
    assert len(table) == 150
    used = table[table["used"]]
    for name in ("simulation", "recalibrated", "extended"):
        assert np.sqrt(np.mean(used[f"{name}_mm"] ** 2)) == pytest.approx(eccentric.rms[name] / MM)
        parts = used[[f"{axis}_{name}_mm" for axis in "xyz"]].to_numpy()
        np.testing.assert_allclose(np.linalg.norm(parts, axis=1), used[f"{name}_mm"])
    assert parse_arm_file(files["extended.toml"], "inside") == eccentric.model.file()


def test_a_sound_arm(diagnosed: Callable[..., Diagnosis]) -> None:
    result = diagnosed(None, 11)
    page = Page(written(result))
    text = text_of(page)
    assert "SINO6: no cause is missing in the simulation. Once the arm is recalibrated, the arm agrees" in text
    assert "there is nothing to gain beside recalibration" in text
    assert "No record was excluded." in text
    assert "Residual vectors on a drawing of the arm, simulation and recalibrated" in pictures(page)


def test_what_no_cause_explains_is_not_called_one(diagnosed: Callable[..., Diagnosis]) -> None:
    result = diagnosed("unexplained:operator", 2)
    page = Page(written(result))
    text = text_of(page)
    assert "something in these records depends on operator, and no known cause has its shape" in text
    assert "it is no cause, and not in the extended arm" in text
    assert "there is nothing to gain beside recalibration" in text
    assert "Structure over operator without a known cause" in pictures(page)


def test_the_error_of_a_seat_and_what_residuals_cannot_show(diagnosed: Callable[..., Diagnosis]) -> None:
    result = diagnosed("seat_error", 9, plan="seats")
    (finding,) = result.findings
    assert finding.cause == "seat_error"
    page = Page(written(result))
    assert f"{in_words(finding.effect)[:1].upper()}{in_words(finding.effect)[1:]}, from the records" in pictures(page)
    assert "they hardly show an error of its stated place" in text_of(page)
    assert "It moves the stated place by" in text_of(page)


def test_a_robot_without_table_or_stated_uncertainties(robot_file: Callable[[str], Path]) -> None:
    arm = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    steps = np.random.default_rng(3).normal(0.0, 2e-4, (6, 6))
    wave = EncoderEccentricity(2, values=(4e-4, 0.0))
    made = ErrorModel(arm.with_placements(steps, None), (wave,))
    data = simulate_measurements(made, "free", 250, rng=np.random.default_rng(4))
    result = diagnose(arm, data, encoder_noise=8e-6, hold_out=False)
    page = Page(written(result))
    assert page.open == []
    assert list(downloads(page)) == ["diagnosis.json", "residuals.csv"]
    assert "that the noise gives by itself (the arm states no uncertainty)" in text_of(page)
    assert "Nothing was held out" in text_of(page)


def test_the_command_writes_the_page_and_nothing_else_on_stdout(tmp_path: Path) -> None:
    data, out = tmp_path / "data.csv", tmp_path / "report.html"
    draw(11, None, records=80).write(data)
    noise = ["--encoder-noise-rad", "8e-6", "--reference-noise-mm", "0.012"]
    arguments = ["diagnose", "sino6", str(data), *noise, "-o", str(out), "--json", "-"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    page = Page(out.read_text(encoding="utf-8"))
    assert json.loads(downloads(page)["diagnosis.json"]) == json.loads(done.stdout)
    assert f"80 records of {data}" in text_of(page)
    again = CliRunner().invoke(app, arguments)
    assert again.exit_code == 1
    assert "report.html" in again.stderr


# Words --------------------------------------------------------------------------------------------------------------------


def test_every_cause_has_words() -> None:
    for cause in CAUSES:
        assert not label_in_words(f"{cause}:3").startswith("dependence on")
    assert label_in_words("encoder_gain:5") == "encoder gain of joint 5"
    assert label_in_words("link_bending:3") == "bending of tube 3"
    assert label_in_words("seat_error:P9") == "error of the stated place of seat P9"
    assert label_in_words("joint 4") == "dependence on joint 4"


def test_inner_parameters_are_told() -> None:
    assert in_words(JointPeriodicError(5, 31.57)) == "periodic error of joint 5 (31.57 periods per turn)"
    assert in_words(EncoderSlip(1, 3000.0)) == "encoder slip of joint 1 (at 50.0 min)"


def test_causes_of_one_kind_stand_together() -> None:
    curves = [JointErrorCurve(joint, 0.0, 1.0, 8) for joint in (2, 1, 4)]
    assert several_in_words([*curves, EncoderEccentricity(3)]) == (
        "error curve of joints 1, 2 and 4 and encoder eccentricity of joint 3"
    )


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"amplitude_rad": (1.846e-4, 1.8e-6)}, "amplitude 184.6 ± 3.6 µrad"),
        ({"phase_rad": (-0.9687, 0.0096)}, "phase -55.5 ± 1.1°"),
        ({"compliance_rad_per_nm": (1.201e-5, 1.95e-7)}, "compliance 12.01 ± 0.39 µrad/(N·m)"),
        ({"a_mm": (0.0889, 0.00075)}, "a 88.9 ± 1.5 µm"),
        ({"expansion_per_k": (1.5e-5, 6e-7)}, "expansion 15.0 ± 1.2 µm/(m·K)"),
        ({"gain": (9e-5, 2e-6)}, "gain 90.0 ± 4.0·10⁻⁶"),
        ({f"c{k}_rad": (0.0, 1e-5) for k in range(24)}, "free curve of 24 values"),
    ],
)
def test_values_in_the_units_that_people_read(values: dict[str, tuple[float, float]], said: str) -> None:
    effect = EncoderEccentricity(1)
    assert parameters_in_words(Finding(effect.cause, 1, effect, values, 1.0, 0.0, 1.0, ())) == said


def found(probability: float, *aliases: Alias) -> Finding:
    effect = JointCompliance(2, values=(2e-5,), u=(1e-6,))
    values = {"compliance_rad_per_nm": (2e-5, 1e-6)}
    return Finding(effect.cause, 2, effect, values, probability, 0.0, 0.3, aliases)


def test_doubt_is_told_with_the_rivals(eccentric: Diagnosis) -> None:
    doubtful = found(0.7, Alias("encoder_eccentricity:2", 0.98, 0.29), Alias("encoder_gain:2", 0.97, 0.002))
    result = replace(eccentric, verdict="ambiguous", findings=(doubtful,))
    assert verdict_in_words(result) == (
        "SINO6: the simulation lacks one cause, compliance under gravity of joint 2, but these records do not settle which: "
        "compliance under gravity of joint 2 has probability 0.700, encoder eccentricity of joint 2 0.290."
    )
    assert list(look_alikes(result)["probability"]) == ["0.290", "0.002"]
    assert ranking(result)["p"].iloc[0] == "< 1e-300"


def test_geometry_is_not_called_a_missing_cause(eccentric: Diagnosis) -> None:
    effect = JointZeroOffset(4, values=(2e-4,), u=(1e-5,))
    moved = Finding(effect.cause, 4, effect, {"offset_rad": (2e-4, 1e-5)}, 1.0, 1e-9, 1.0, ())
    result = replace(eccentric, findings=(moved,))
    said = "no cause is missing in the simulation, but its geometry is off by unusually much for what was stated: "
    said += "zero offset of joint 4."
    assert said in verdict_in_words(result)
    page = Page(written(result))
    assert "Geometric values beyond their stated uncertainty" in pictures(page)
    assert "Dots are records" not in page.text


def test_a_cause_alike_in_all_records_is_told_in_words(eccentric: Diagnosis) -> None:
    effect = StylusOffset(values=(1e-4, 0.0, 0.0))
    offset = Finding(effect.cause, None, effect, {"x_mm": (0.1, 0.001)}, 1.0, 0.0, 1.0, ())
    page = Page(written(replace(eccentric, findings=(offset,))))
    assert "Stylus offset: x 100.0 ± 2.0 µm. It moves the tip by 100 µm" in text_of(page)


@pytest.mark.parametrize(
    ("interval", "said"),
    [
        ((0.4, 0.6), "% less than the recalibrated one (95 %: 40 to 60 %)"),
        ((-0.1, 0.2), "is not better than the recalibrated one beyond doubt"),
        ((0.001, 0.2), "is not better than the recalibrated one beyond doubt"),
        ((-0.4, -0.2), "% more than the recalibrated one (95 %: -40 to -20 %)"),
    ],
)
def test_what_the_gain_is_worth(eccentric: Diagnosis, interval: tuple[float, float], said: str) -> None:
    held = eccentric.held_out
    assert held is not None
    assert said in gain_in_words(replace(eccentric, held_out=replace(held, interval=interval)))


def test_structure_that_nothing_names_is_told(eccentric: Diagnosis) -> None:
    assert unexplained_in_words(eccentric).startswith("Nothing that depends on a joint's angle")
    left = replace(eccentric.unexplained, p_value=1e-23)
    assert "Something is left beyond chance (p = 1e-23)" in unexplained_in_words(replace(eccentric, unexplained=left))


def test_a_group_that_does_not_agree_is_named() -> None:
    said = group_in_words(OddGroup("bar B3", 62, 1.41, 3e-7))
    assert said.startswith("The 62 records of bar B3 do not agree with the others")
    assert "1.4 times" in said
    assert "p = 3e-07" in said


def test_unstated_noise_is_told(eccentric: Diagnosis) -> None:
    result = replace(eccentric, extended=replace(eccentric.extended, stated=False, unmodelled=2e-5))
    text = text_of(Page(written(result)))
    assert "The noise was not stated in full" in text
    assert "the residuals scatter by 0.0200 mm per coordinate beyond what was stated" in text


def test_the_file_of_residuals_keeps_labels(diagnosed: Callable[..., Diagnosis]) -> None:
    table = residuals_table(diagnosed("seat_error", 9, plan="seats"))
    assert {"row", "seat", "session", "operator", "part", "held_out_extended_mm"} <= set(table.columns)
