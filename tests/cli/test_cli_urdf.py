"""Arms that come as URDF at the command line: postures, accuracy, and what a map says of them."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from shell import done, found, refused

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.arm import Arm

POINT = ["--point", "400", "100", "300"]
RPY = (170.0, 20.0, -35.0)
POSE = [*POINT, "--rpy-deg", *(str(angle) for angle in RPY)]
HALF_WIDTHS = ["--translation-half-width-mm", "0.05", "--rotation-half-width-rad", "1e-4"]
THETAS = [f"theta{j}_deg" for j in range(1, 7)]
PLACES = ["x_mm", "y_mm", "z_mm"]


@pytest.fixture
def ur5(robot_file: Callable[[str], Path]) -> list[str]:
    return ["--urdf", str(robot_file("ur5_robot.urdf")), "--frame", "tool0"]


@pytest.fixture
def panda(robot_file: Callable[[str], Path]) -> list[str]:
    return ["--urdf", str(robot_file("panda.urdf")), "--frame", "panda_hand_tcp"]


def test_configurations_of_a_pose(ur5: list[str]) -> None:
    """The orientation is pin.rpy's; places by Pinocchio; of a URDF and of an arm file."""
    pose = pin.SE3(pin.rpy.rpyToMatrix(*(np.array(RPY) * DEG)), np.array([0.4, 0.1, 0.3])).homogeneous
    for words, arm, said in (
        (ur5, Arm.from_urdf(ur5[1], "tool0"), "single postures"),
        (["sino6", "--tip"], Arm.load("sino6"), "a full pose"),
    ):
        out, err = done("configurations", *words, *POSE)
        assert said in err
        table = pd.read_csv(io.StringIO(out))
        assert list(table) == ["component", "swivel_deg", *THETAS, "within_limits", "broken_limits", *PLACES]
        assert (table["swivel_deg"].isna() == (arm.dh is None)).all()
        placed = arm.poses(table[THETAS].to_numpy() * DEG).placement
        np.testing.assert_allclose(placed, np.tile(pose, (len(table), 1, 1)), rtol=0, atol=1e-9)
        np.testing.assert_allclose(table[PLACES], np.tile([400, 100, 300], (len(table), 1)), atol=1e-9)


def test_curves_of_a_point_and_an_axis(ur5: list[str], tmp_path: Path) -> None:
    words = [*POINT, "--axis", "0", "0.1", "-1", "--tool-axis", "1", "0", "0", "--count", "20", "-o", tmp_path / "c.csv"]
    done("configurations", *ur5, *words)
    table = pd.read_csv(tmp_path / "c.csv")
    assert (table.groupby("component").size() == 20).all()
    x = Arm.from_urdf(ur5[1], "tool0").poses(table[THETAS].to_numpy() * DEG).placement[:, :3, 0]
    np.testing.assert_allclose(x, np.tile([0, 0.1, -1] / np.sqrt(1.01), (len(x), 1)), rtol=0, atol=1e-9)


def test_accuracy_of_single_postures_and_of_curves(ur5: list[str], panda: list[str], tmp_path: Path) -> None:
    summary = found("accuracy", *ur5, *POSE, *HALF_WIDTHS, "-o", tmp_path / "a.csv", "--plot", tmp_path / "a.png")
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
    out, err = done("accuracy", *panda, *POSE, *HALF_WIDTHS, "--count", "30")
    assert "closed curves" in out
    assert "swivel" not in out
    assert "comprehensive" not in out
    assert "--encoder-noise-rad" in err


def test_a_singular_pose_has_a_note(ur5: list[str]) -> None:
    """Straight wrist: the free motion is told on stderr."""
    pose = Arm.from_urdf(ur5[1], "tool0").poses(np.array([[0.4, -1.1, 1.3, 0.5, 0.0, -0.7]])).placement[0]
    point = [f"{x / MM:.12f}" for x in pose[:3, 3]]
    rpy = [f"{angle / DEG:.15g}" for angle in pin.rpy.matrixToRpy(pose[:3, :3])]
    _, err = done("configurations", *ur5, "--point", *point, "--rpy-deg", *rpy)
    assert "note: " in err
    assert "families" in err


def test_what_cannot_be(ur5: list[str], panda: list[str]) -> None:
    far = ["--point", "4000", "0", "0", "--rpy-deg", "0", "0", "0"]
    for words, said in (
        (["configurations", *ur5, *POINT], "6 joints and a point leave 3 joints free; state a point and an axis"),
        (["configurations", *panda, *POINT, "--axis", "0", "0", "1"], "state a full pose"),
        (["configurations", *ur5, *far], "out of reach"),
        (["accuracy", *ur5, *POSE], "a URDF states no uncertainties; expected --translation-half-width-mm"),
        (["map", *ur5], "needs a DH table"),
    ):
        refused(*words, said=[said])
