"""A calibration as a document: in agreement with the numbers, and complete for every kind
of data.
"""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pandas as pd
from markupsafe import escape
from matplotlib import pyplot as plt

from aacmm_pin.arm.file import parse_arm_file
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.effects import EncoderEccentricity, ErrorModel, JointCompliance, ThermalExpansion
from aacmm_pin.measurements import simulate_measurements
from aacmm_pin.report.calibration_page import (
    calibration_document,
    calibration_summary,
    comment,
    estimated_causes,
    verdict,
)
from aacmm_pin.report.formats import html
from aacmm_pin.report.numbers import length
from aacmm_pin.report.plots.calibration_plots import parameter_table
from aacmm_pin.report.scenes.scene import viewer_script
from tests.arm_files import changed
from tests.pages import Page

NAME = "a <b> & c.csv"
READINGS = 8e-6


def written(result: Calibration) -> str:
    return html.page(
        calibration_document(result, calibration_summary(result, NAME, 1), "2026-01-02")
    )


def test_a_page_agrees_with_its_numbers_and_holds_its_files(at_seats):
    text = written(at_seats)
    page = Page(text)
    assert plt.get_fignums() == []
    # The viewer of scenes names places in its licences.
    assert "http" not in text.replace(escape(viewer_script()), "")
    assert len(text) < 3_000_000
    assert NAME in page.text  # escaped, so that it is text again
    assert verdict(at_seats) in page.text
    for size in (at_seats.rms_before, at_seats.rms, *(h.rms_after for h in at_seats.held_out)):
        assert f"{1e3 * size:.4f}" in page.text or f"{1e6 * size:.2f}" in page.text
    assert length(at_seats.noise) in page.text
    assert len(page.all("img")) == 3
    for row in at_seats.excluded.to_dict("records"):
        assert f"{row['residual_mm']:.4f}" in page.text
    files = page.downloads()
    assert list(files) == ["calibration.json", "residuals.csv", "calibrated.toml"]
    assert json.loads(files["calibration.json"]) == calibration_summary(at_seats, NAME, 1)
    assert len(pd.read_csv(io.BytesIO(files["residuals.csv"]))) == 120
    assert parse_arm_file(files["calibrated.toml"], "inside") == at_seats.model.file()
    assert files["calibrated.toml"].startswith(
        b"# aacmm-pin wrote this file on 2026-01-02 (UTC) from a <b> & c.csv."
    )


def test_a_robot_without_seats_or_stated_uncertainties(of_robot):
    page = Page(written(of_robot))
    assert "Residuals by seat" not in [image["alt"] for image in page.all("img")]
    assert b"[urdf]" in page.downloads()["calibrated.toml"]
    assert all(combination in page.text for combination in of_robot.undetermined)
    assert of_robot.undetermined
    assert of_robot.undetermined[0] in comment(of_robot, "data.csv", "2026-01-02")


def test_what_is_beyond_its_stated_uncertainty(sino6, of_robot):
    assert parameter_table(of_robot)["stated"].isna().all()
    longer = sino6.file.joints[3].d_mm + 0.1  # stated: within 0.016
    true = changed("sino6", {4: {"d_mm": longer}})
    data = simulate_measurements(true, "free", 150, rng=np.random.default_rng(2))
    known = EncoderEccentricity(3, u=(1e-5, 2e-5))
    result = calibrate(sino6, data, ["geometry", known], encoder_noise=READINGS, hold_out=False)
    table = parameter_table(result)
    assert list(table.loc[table["beyond"], "parameter"]) == ["d4"]
    # Twice the u of a cause.
    np.testing.assert_allclose(parameter_table(result)["stated"][-2:], [2e-5, 4e-5])


def test_causes_with_their_uncertainty(sino6):
    effects = (EncoderEccentricity(3, values=(1.6e-4, 1.2e-4)), ThermalExpansion(values=(2e-5,)))
    data = simulate_measurements(
        ErrorModel(sino6, effects), "free", 200, rng=np.random.default_rng(6)
    )
    wanted = ["zero-offsets", JointCompliance(2), EncoderEccentricity(3), ThermalExpansion()]
    result = calibrate(sino6, data, wanted, encoder_noise=READINGS, hold_out=False)
    _, wave, _ = estimated_causes(result)["value ± U (k = 2)"]
    told = re.fullmatch(r"amplitude (\S+) ± (\S+) µrad, phase (\S+) ± (\S+)°", wave)
    size, of_size, phase, of_phase = map(float, told.groups())
    assert abs(size - 200.0) < 2 * of_size
    assert abs(phase - np.rad2deg(np.arctan2(1.2, 1.6))) < 2 * of_phase
    own, values = result.covariance[-3:-1, -3:-1], result.fit.point.x[-3:-1]
    gradient = values / np.linalg.norm(values)
    np.testing.assert_allclose(of_size, 2e6 * np.sqrt(gradient @ own @ gradient), rtol=0.05)
