"""The page of a calibration: self-contained, in agreement with the numbers, and complete for every kind of data."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from test_report import PNG, Page

from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.calibration.perturbed_arm import perturbed_model
from aacmm_pin.effects import EncoderEccentricity
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.report.calibration_findings import calibration_summary, verdict
from aacmm_pin.report.calibration_page import calibration_page
from aacmm_pin.report.scenes.page import viewer_script

mpl.use("Agg")

NAME = "a <b> & c.csv"
TITLES = [
    "1. What came out",
    "2. On records it never saw",
    "3. Residuals",
    "4. Parameters",
    "5. What these data cannot tell",
    "6. Records left out",
    "7. Files",
]


@pytest.fixture(scope="module")
def result(sino6: Arm) -> Calibration:
    true = perturbed_model(ErrorModel(sino6), np.random.default_rng(1))
    data = simulate_measurements(true, "seats", 120, rng=np.random.default_rng(1))
    q = data.q.copy()
    q[7, 1] += 2e-3
    return calibrate(sino6, replace(data, q=q), ["geometry", EncoderEccentricity(3)], encoder_noise=8e-6)


@pytest.fixture(scope="module")
def html(result: Calibration) -> str:
    return written(result)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def written(result: Calibration) -> str:
    return calibration_page(result, calibration_summary(result, NAME, 1), "2026-01-02")


def downloads(page: Page) -> dict[str, bytes]:
    links = [a for a in page.all("a") if "download" in a]
    return {a["download"]: base64.b64decode(a["href"].partition("base64,")[2]) for a in links}


def pictures(page: Page) -> list[str]:
    for image in page.all("img"):
        assert base64.b64decode(image["src"].partition("base64,")[2]).startswith(PNG)
    return [image["alt"] for image in page.all("img")]


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
    assert len(html) < 3_000_000


def test_pyplot_keeps_no_figure(result: Calibration) -> None:
    written(result)
    assert plt.get_fignums() == []


def test_the_verdict_comes_first_and_the_numbers_agree(page: Page, result: Calibration) -> None:
    text = page.text.replace("\u00a0", " ")
    assert text.index(verdict(result)) < text.index("2. On records it never saw", text.index("1. What came out"))
    for value in (result.rms_before, result.rms, result.noise, *(h.rms_after for h in result.held_out)):
        assert f"{value / MM:.4f}" in text
    assert "whole seats" in text
    assert "records at random" in text
    assert "encoder eccentricity of joint 3: amplitude " in text
    assert "Every parameter is told by these data" in text


def test_every_picture_is_there(page: Page) -> None:
    assert pictures(page) == [
        "Histogram of residuals before and after",
        "Residual vectors in space, before and after",
        "Residuals over the angle of each joint",
        "Residuals by seat",
        "Histogram of normalised residuals against the χ distribution",
        "Change of each parameter over its stated uncertainty",
        "Heat map of the correlation of the parameters",
    ]


def test_excluded_records_are_listed(page: Page, result: Calibration) -> None:
    (row,) = result.excluded["row"]
    assert row == 9
    where = page.text.index("6. Records left out", page.text.index("5. What these"))
    assert "1 records that cannot belong" in page.text[where:]
    assert f"{result.excluded['residual_mm'].iloc[0]:.3f}" in page.text[where:]


def test_the_files_inside_come_back(page: Page, result: Calibration) -> None:
    files = downloads(page)
    assert list(files) == ["calibration.json", "residuals.csv", "calibrated.toml"]
    assert json.loads(files["calibration.json"]) == calibration_summary(result, NAME, 1)
    assert len(pd.read_csv(io.BytesIO(files["residuals.csv"]))) == 120
    assert parse_arm_file(files["calibrated.toml"], "inside") == result.model.file()
    assert files["calibrated.toml"].startswith(b"# Calibrated by aacmm-pin on 2026-01-02 (UTC) from a <b> & c.csv")


def test_a_robot_without_seats_or_stated_uncertainties(robot_file: Callable[[str], Path]) -> None:
    arm = Arm.from_urdf(robot_file("ur5_robot.urdf"), "tool0")
    steps = np.random.default_rng(3).normal(0.0, 2e-4, (6, 6))
    data = simulate_measurements(arm.with_placements(steps, None), "free", 60, rng=np.random.default_rng(4))
    result = calibrate(arm, data, encoder_noise=8e-6, hold_out=False)
    page = Page(written(result))
    assert page.open == []
    assert "Residuals by seat" not in pictures(page)
    assert "calibrated.toml" not in downloads(page)
    for words in ("Nothing was held out", "Nobody stated how far off", "ry6: not at all.", "No record was excluded."):
        assert words in page.text


def test_an_unknown_frame_and_what_was_assumed_are_told(sino6: Arm) -> None:
    data = simulate_measurements(sino6, "free", 60, rng=np.random.default_rng(4))
    silent = replace(data, reference_u=np.full_like(data.reference_u, np.nan))
    result = calibrate(sino6, silent, "zero-offsets", reference_frame="external", hold_out=False)
    text = Page(written(result)).text.replace("\u00a0", " ")
    assert "What was found or assumed beside:" in text
    assert "The base stands at (" in text
    assert "obody states the noise of the encoders" in text
    assert "χ² cannot judge the model" in text
