"""Arms that come as URDF at the command line: postures, accuracy, and what a map says of them."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.cli import app

POINT = ["--point", "400", "100", "300"]
RPY = (170.0, 20.0, -35.0)
POSE = [*POINT, "--rpy-deg", *(str(angle) for angle in RPY)]
HALF_WIDTHS = ["--translation-half-width-mm", "0.05", "--rotation-half-width-rad", "1e-4"]


def run(*words: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def ur5(robot_file: Callable[[str], Path]) -> list[str]:
    return ["--urdf", str(robot_file("ur5_robot.urdf")), "--frame", "tool0"]


@pytest.fixture
def panda(robot_file: Callable[[str], Path]) -> list[str]:
    return ["--urdf", str(robot_file("panda.urdf")), "--frame", "panda_hand_tcp"]


def test_configurations_of_a_pose_in_the_columns_of_all(ur5: list[str]) -> None:
    """The orientation is pin.rpy's; places by Pinocchio."""
    status, out, err = run("configurations", *ur5, *POSE)
    assert (status, "single postures" in err) == (0, True)
    table = pd.read_csv(io.StringIO(out))
    thetas = [f"theta{j}_deg" for j in range(1, 7)]
    columns = ["component", "swivel_deg", *thetas, "within_limits", "broken_limits", "x_mm", "y_mm", "z_mm"]
    assert list(table) == columns
    assert table["swivel_deg"].isna().all()
    pose = pin.SE3(pin.rpy.rpyToMatrix(*(np.array(RPY) * DEG)), np.array([0.4, 0.1, 0.3])).homogeneous
    placed = Arm.from_urdf(ur5[1], "tool0").poses(table[thetas].to_numpy() * DEG).placement
    np.testing.assert_allclose(placed, np.tile(pose, (len(table), 1, 1)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(table[["x_mm", "y_mm", "z_mm"]], np.tile([400, 100, 300], (len(table), 1)), atol=1e-9)


def test_curves_of_a_point_and_an_axis(ur5: list[str], tmp_path: Path) -> None:
    words = [*POINT, "--axis", "0", "0.1", "-1", "--tool-axis", "1", "0", "0", "--count", "20", "-o", tmp_path / "c.csv"]
    assert run("configurations", *ur5, *words)[0] == 0
    table = pd.read_csv(tmp_path / "c.csv")
    assert (table.groupby("component").size() == 20).all()
    q = table[[f"theta{j}_deg" for j in range(1, 7)]].to_numpy() * DEG
    x = Arm.from_urdf(ur5[1], "tool0").poses(q).placement[:, :3, 0]
    np.testing.assert_allclose(x, np.tile([0, 0.1, -1] / np.sqrt(1.01), (len(x), 1)), rtol=0, atol=1e-9)


def test_accuracy_of_single_postures(ur5: list[str], tmp_path: Path) -> None:
    files = ["-o", tmp_path / "a.csv", "--plot", tmp_path / "a.png", "--json", "-"]
    status, out, err = run("accuracy", *ur5, *POSE, *HALF_WIDTHS, *files)
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert summary["schema"] == "aacmm-pin/accuracy/1"
    assert (summary["at"], summary["conditions"], summary["notes"]) == ("tool0", 6, [])
    assert summary["flexibility"] == {"zeta": None, "sectors": [], "arc_fraction": None}
    assert summary["volume_mm3"]["comprehensive"] is None
    assert summary["best"]["swivel_deg"] is None
    assert summary["search"]["unseen_at_most"] < 0.011
    table = pd.read_csv(tmp_path / "a.csv")
    assert len(table) == summary["configurations"] == summary["components"]
    assert table["u_mm"].max() == pytest.approx(summary["u_mm"]["max"])
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_accuracy_in_words(panda: list[str]) -> None:
    status, out, err = run("accuracy", *panda, *POSE, *HALF_WIDTHS, "--count", "60")
    assert status == 0
    assert "closed curves" in out
    assert "swivel" not in out
    assert "comprehensive" not in out
    assert "nobody states the noise" in err


def test_a_whole_pose_of_an_arm_file() -> None:
    status, out, err = run("configurations", "sino6", "--tip", *POSE)
    assert status == 0
    table = pd.read_csv(io.StringIO(out))
    assert table["swivel_deg"].notna().all()
    q = table[[f"theta{j}_deg" for j in range(1, 7)]].to_numpy() * DEG
    placed = Arm.load("sino6").poses(q).placement
    np.testing.assert_allclose(placed[:, :3, 3], np.tile([0.4, 0.1, 0.3], (len(q), 1)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        placed[:, :3, :3], np.tile(pin.rpy.rpyToMatrix(*(np.array(RPY) * DEG)), (len(q), 1, 1)), rtol=0, atol=1e-9
    )
    assert "a full pose" in err


def test_a_singular_pose_has_a_note(robot_file: Callable[[str], Path], ur5: list[str]) -> None:
    """Straight wrist: the free motion is told on stderr."""
    pose = Arm.from_urdf(ur5[1], "tool0").poses(np.array([[0.4, -1.1, 1.3, 0.5, 0.0, -0.7]])).placement[0]
    point = [f"{x / MM:.12f}" for x in pose[:3, 3]]
    rpy = [f"{angle / DEG:.15g}" for angle in pin.rpy.matrixToRpy(pose[:3, :3])]
    status, _, err = run("configurations", *ur5, "--point", *point, "--rpy-deg", *rpy)
    assert status == 0
    assert "note: " in err
    assert "families" in err


@pytest.mark.parametrize(
    ("arm", "words", "said"),
    [
        ("ur5", POINT, "6 joints and a point leave 3 joints free; state a point and an axis"),
        ("panda", [*POINT, "--axis", "0", "0", "1"], "state a full pose"),
        ("ur5", ["--point", "4000", "0", "0", "--rpy-deg", "0", "0", "0"], "out of reach"),
    ],
)
def test_what_cannot_be_enumerated(request: pytest.FixtureRequest, arm: str, words: list[str], said: str) -> None:
    status, out, err = run("configurations", *request.getfixturevalue(arm), *words)
    assert (status, out) == (1, "")
    assert said in err


def test_accuracy_of_a_urdf_needs_half_widths(ur5: list[str]) -> None:
    status, _, err = run("accuracy", *ur5, *POSE)
    assert status == 1
    assert "a URDF states no uncertainties; expected --translation-half-width-mm" in err


def test_a_map_needs_a_table(ur5: list[str]) -> None:
    status, _, err = run("map", *ur5)
    assert status == 1
    assert "needs a DH table" in err


@pytest.mark.parametrize(
    "words",
    [
        ["accuracy", "sino6", *POINT, *HALF_WIDTHS],
        ["configurations", "sino6", *POINT, "--rpy-deg", "0", "0", "0"],
        ["configurations", "sino6", "--tip", *POINT, "--axis", "0", "0", "1", "--tool-axis", "0", "0", "1"],
        ["configurations", "sino6", "--tip", *POSE, "--axis", "0", "0", "1"],
        ["configurations", *POINT],
    ],
)
def test_wrong_usage(words: list[str]) -> None:
    assert run(*words)[0] == 2
