"""The benchmark of robots: its truth, its plain model, its scores and its page."""

import json

import numpy as np
import pytest

from tests.benchmarks.robots.__main__ import main, robot
from tests.benchmarks.robots.evaluation import score
from tests.benchmarks.robots.page import page
from tests.benchmarks.robots.plain_model import Plain, recalibrated
from tests.benchmarks.robots.robot import COMPLIANCE, NOISE_MM, RANGES, Robot, rms

MIXED = Robot.of(11, "cep-lc")


def test_least_squares_recovers_what_is_planted():
    data = MIXED.measured(1500)
    left, columns, angles = recalibrated(data).residuals(data)
    height = MIXED.turn[:, 2][:, None]  # of the base, in the frame of the tracker
    planted = [columns.reshape(-1, 33), np.outer(data.temperature - 23.5, height).reshape(-1, 1)]
    expected = [0.04]
    for j, waves in enumerate(MIXED.waves):
        for f, a, phase in waves:
            angle = f * data.q[:, j]
            two = np.column_stack([np.cos(angle), -np.sin(angle)])
            planted.append((angles[:, :, j, None] * two[:, None]).reshape(-1, 2))
            expected += [a * np.cos(phase), a * np.sin(phase)]
    beyond = 35 * np.cos(data.q[:, 1] + data.q[:, 2])
    for joint, moment in ((2, 90 * np.cos(data.q[:, 1]) + beyond), (3, beyond)):
        planted.append((angles[:, :, joint - 1] * moment[:, None]).reshape(-1, 1))
        expected.append(COMPLIANCE[joint])
    design = np.hstack(planted)
    scale = np.linalg.norm(design, axis=0)
    values, *_ = np.linalg.lstsq(design / scale, left.ravel(), rcond=1e-9)
    remaining = (left.ravel() - design / scale @ values).reshape(-1, 3)
    assert rms(remaining) == pytest.approx(data.floor_mm, rel=0.05)
    found = dict(zip(range(len(expected)), (values / scale)[33:], strict=True))
    assert found[0] == pytest.approx(0.04, rel=0.1)
    last = len(expected) - 1
    assert found[last - 1] == pytest.approx(COMPLIANCE[2], rel=0.1)
    assert found[last] == pytest.approx(COMPLIANCE[3], rel=0.1)
    first_joint = slice(1, 11)
    np.testing.assert_allclose(
        np.array([*found.values()])[first_joint], expected[first_joint], atol=1e-5
    )


def test_the_same_robot_for_any_number_of_records(tmp_path):
    few, many = (MIXED.measured(n) for n in (300, 2000))
    assert few.displacements_mm == pytest.approx(many.displacements_mm, rel=0.15)
    assert "encoder:4" not in few.displacements_mm
    data = few.write(tmp_path)
    assert data.read_bytes() == MIXED.measured(300).write(tmp_path / "again").read_bytes()
    assert json.loads((tmp_path / "truth_300.json").read_text())["forms"] == "cep-lc"


@pytest.mark.long
def test_plain_model_recovers_a_robot():
    data = MIXED.measured(1200)
    plain = Plain.fitted(data)
    assert plain.recalibrated_mm > 5 * plain.rms_mm
    assert plain.rms_new_mm(MIXED.measured(500)) < 1.25 * data.floor_mm
    assert NOISE_MM < plain.noise_mm < data.floor_mm
    angles, found = plain.curve(1)
    inside = (angles > RANGES[0][0] + 0.1) & (angles < RANGES[0][1] - 0.1)
    true = MIXED.encoder_error(1, angles)
    assert np.std((found - true)[inside]) < 0.2 * np.std(true[inside])


ROW = {
    "seed": 11,
    "forms": "cep-lc",
    "records": 300,
    "cross_validation": True,
    "error": None,
    "cpu_s": 10.0,
    "peak_mb": 500.0,
    "verdict": "unexplained",
    "rms_mm": {"recalibrated": 0.4, "extended": 0.1},
    "rms_new_mm": 0.11,
    "plain_new_mm": 0.09,
    "floor_mm": 0.06,
    "periods": {"encoder:3": 13.0},
    "displacements_mm": {
        "encoder:1": 0.2,
        "encoder:2": 0.01,
        "encoder:3": 0.09,
        "encoder:6": 0.002,
        "load:2": 0.2,
        "temperature": 0.02,
        "room": 0.03,
    },
    "findings": [
        {"cause": "joint_error_curve", "joint": 1, "order": None, "probability": 1.0},
        {"cause": "joint_periodic_error", "joint": 3, "order": 20.0, "probability": 1.0},
        {"cause": "counterbalance", "joint": 2, "order": None, "probability": 0.9},
        {"cause": "encoder_gain", "joint": 2, "order": None, "probability": 0.9},
        {"cause": "encoder_gain", "joint": 4, "order": None, "probability": 0.6},
        {"cause": "joint_coupling", "joint": 5, "order": None, "probability": 0.6},
        {"cause": "joint_zero_offset", "joint": 5, "order": None, "probability": 0.6},
        {"cause": "joint_error_curve", "joint": 6, "order": None, "probability": 0.4},
    ],
    "places": [
        {"cause": "angle", "joint": 1, "probability": 1.0},
        {"cause": "angle", "joint": 3, "probability": 1.0},
        {"cause": "load", "joint": 2, "probability": 0.9},
        {"cause": "temperature", "joint": None, "probability": 0.7},
    ],
}


def test_scores_of_places():
    marks = score(ROW)
    assert marks.found == ("encoder:1", "encoder:3")
    assert marks.missed == ("load:2", "temperature")
    assert marks.right_form == ("encoder:1",)
    assert marks.wrong_form == ("encoder:3",)  # another wave
    assert marks.false == ("encoder:4", "joint_coupling:5")


def test_page_has_a_row_for_each_file():
    failed = ROW | {"error": "diagnose ended with 1.", "records": 1200}
    text = page([ROW, failed], "c")
    assert text.count("`11:cep-lc`") == 2
    assert (
        "| 2 of 4 | load:2, temperature | encoder:4, joint_coupling:5 | 1 of 2 | 10 | 500 |" in text
    )
    assert "- `11:cep-lc`, 1200 records: diagnose ended with 1." in text


def test_names_of_robots():
    assert robot("m11").forms == "cep-lc"
    assert robot("4").forms == "cccccc"
    with pytest.raises(Exception, match="six letters"):
        robot("4:xyz")


@pytest.mark.long
def test_command_resumes(tmp_path, capsys):
    words = ["--robots", "20:------", "--records", "100", "-o", str(tmp_path)]
    words += ["--page", str(tmp_path / "page.md"), "--no-cross-validation"]
    main(words)
    first = capsys.readouterr().out
    main(words)
    assert capsys.readouterr().out == first
    assert "RMS extended" in first
    assert len((tmp_path / "runs.jsonl").read_text().split()) > 1
    assert "20:------" in (tmp_path / "page.md").read_text()
