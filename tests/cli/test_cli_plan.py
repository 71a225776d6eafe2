"""plan as a user meets it: the file to be filled in, what is said, exit statuses, and the way back through diagnose."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.cli import app
from aacmm_pin.effects import JointCompliance
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements

PAIR = ["--split", "joint_compliance:2", "encoder_eccentricity:2"]
QUICK = ["--records", "20", "--postures", "200", "--encoder-noise-rad", "8e-6", "--reference-noise-mm", "0.012"]


def run(*words: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout, result.stderr


def done(*words: str | Path) -> tuple[str, str]:
    status, out, err = run(*words)
    assert status == 0, err
    return out, err


def filled_in(path: Path, true: ErrorModel, seed: int = 1) -> None:
    """The plan carried out by an arm with errors, its references filled in."""
    rng = np.random.default_rng(seed)
    table = pd.read_csv(path)
    q = Measurements.read(path).q
    tips = true.predict(q - 8e-6 * rng.standard_normal(q.shape)) + 1.2e-5 * rng.standard_normal((len(q), 3))
    table[["x_mm", "y_mm", "z_mm"]] = tips / MM
    table.to_csv(path, index=False)


def test_a_plan_is_filled_in_and_diagnosed(tmp_path: Path, sino6: Arm) -> None:
    old, plan, both = (tmp_path / name for name in ("old.csv", "plan.csv", "both.csv"))
    effect = "joint_compliance:joint=2,compliance_rad_per_nm=1e-5"
    done("simulate", "sino6", "--plan", "free", "--records", "40", "--effect", effect, *QUICK[4:6], "-o", old)
    out, _ = done("plan", "sino6", *PAIR, *QUICK, "--records", "40", "--data", old, "-o", plan)
    assert "40 records to tell joint_compliance:2 from encoder_eccentricity:2, the arm as it stands" in out
    assert not Measurements.read(plan, 6).known.any()
    filled_in(plan, ErrorModel(sino6, (JointCompliance(2, values=(1e-5,)),)))
    assert Measurements.read(plan, 6).known.all()
    tables = [pd.read_csv(path).drop(columns=["u_x_mm", "u_y_mm", "u_z_mm"], errors="ignore") for path in (old, plan)]
    assert set(tables[0].columns) == set(tables[1].columns)  # the new records can be appended to the old ones
    pd.concat(tables).to_csv(both, index=False)
    out, _ = done("diagnose", "sino6", both, *QUICK[4:], "--no-held-out", "--json", "-")
    first = json.loads(out)["findings"][0]
    assert (first["cause"], first["joint"]) == ("joint_compliance", 2)


def test_another_mount_comes_as_an_arm_file(tmp_path: Path, sino6: Arm) -> None:
    plan, arm = tmp_path / "plan.csv", tmp_path / "turned.toml"
    split = ["--split", "bearing_tilt:1", "base_compliance"]
    out, err = done("plan", "sino6", *split, *QUICK, "-o", plan)
    assert "set-up: turn the mount by 90°" in out
    assert "the two do the same in every posture" in " ".join(out.split())
    assert "--set-up-arm FILE" in err
    done("plan", "sino6", *split, *QUICK, "-o", plan, "--set-up-arm", arm, "--force")
    turned = ErrorModel.load(arm).arm
    assert abs(turned.gravity @ sino6.gravity) < 1e-9
    np.testing.assert_array_equal(turned.require_dh("").a, sino6.require_dh("").a)


def test_json_is_alone_on_stdout_and_the_seed_is_in_it(tmp_path: Path) -> None:
    out, err = done("plan", "sino6", *PAIR, *QUICK[:4], "--seed", "7", "--json", "-")
    content = json.loads(out)
    assert (content["schema"], content["seed"], content["records"]) == ("aacmm-pin/plan/1", 7, 20)
    assert content["power"]["decided"] is True
    assert len(content["expected_mm"]) == 20
    assert "nobody states the noise of the encoders" in err
    again = tmp_path / "plan.csv"
    done("plan", "sino6", *PAIR, *QUICK[:4], "--seed", "7", "-o", again)
    printed, _ = done("plan", "sino6", *PAIR, *QUICK[:4], "--seed", "7")
    assert printed == again.read_text()


def test_existing_records_are_taken_into_account(tmp_path: Path) -> None:
    data, plan = tmp_path / "data.csv", tmp_path / "plan.csv"
    done("simulate", "sino6", "--plan", "seats", "--records", "40", "--seats", "5", "-o", data)
    out, _ = done("plan", "sino6", *PAIR, *QUICK, "--data", data, "--reference", "seats", "-o", plan, "--json", "-")
    content = json.loads(out)
    assert content["existing"] == 40
    before, after = content["power"]["before"]["T"], content["power"]["after"]["T"]
    assert min(before) < min(after)
    old, new = Measurements.read(data, 6), Measurements.read(plan, 6)
    assert set(new.seats()) <= set(old.seats())
    both = pd.concat([pd.read_csv(data), pd.read_csv(plan)], ignore_index=True)
    assert Measurements.from_frame(both, 6).n == 60


def test_new_seats_are_left_to_be_measured(tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    done("plan", "sino6", *PAIR, *QUICK, "--reference", "seats", "-o", plan)
    table = pd.read_csv(plan)
    assert table["x_mm"].isna().all()
    assert set(table["seat"]) <= {f"P{k}" for k in range(1, 9)}


def test_everything_at_once(tmp_path: Path) -> None:
    out, err = done("plan", "sino6", *QUICK, "-o", tmp_path / "plan.csv")
    assert "20 records for all causes" in out
    assert "told worst, of what these postures can tell:" in out
    assert "no posture tells bearing_tilt:1 from base_compliance; it takes another set-up: turn the mount" in err
    assert {"temperature_c", "approach1"} <= set(pd.read_csv(tmp_path / "plan.csv").columns)


def test_an_arm_by_its_urdf(tmp_path: Path, robot_file: Callable[[str], Path]) -> None:
    plan = tmp_path / "plan.csv"
    words = ["--urdf", robot_file("ur5_robot.urdf"), "--frame", "tool0", *PAIR, *QUICK, "-o", plan]
    out, _ = done("plan", *words)
    assert "20 records to tell joint_compliance:2" in out
    assert Measurements.read(plan, 6).n == 20
    status, _, err = run("plan", *words, "--force", "--set-up-arm", tmp_path / "arm.toml")
    assert (status, "needs a DH table" in err) == (1, True)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--split", "encoder_gain:9", "base_compliance"], "aacmm-pin: encoder_gain:9: SINO6 has rows 1 to 6"),
        (["--split", "nonsense", "base_compliance"], "aacmm-pin: unknown cause 'nonsense'"),
        ([*PAIR, "--data", "nowhere.csv"], "nowhere.csv: no such file"),
        ([*PAIR, "--reference-frame", "moon"], "unknown reference frame 'moon'"),
        ([*PAIR, "--postures", "3"], "postures is 3"),
    ],
)
def test_bad_input_is_one_message_and_no_file(tmp_path: Path, words: list[str], said: str) -> None:
    plan = tmp_path / "plan.csv"
    status, out, err = run("plan", "sino6", *QUICK, *words, "-o", plan)
    assert (status, out) == (1, "")
    assert said in err
    assert not plan.exists()


def test_a_file_is_not_replaced_without_force(tmp_path: Path) -> None:
    plan = tmp_path / "plan.csv"
    plan.write_text("mine")
    status, _, err = run("plan", "sino6", *PAIR, *QUICK, "-o", plan)
    assert (status, plan.read_text()) == (1, "mine")
    assert "--force replaces it" in err
