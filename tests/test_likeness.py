"""Files with a wrong unit, exchanged columns or the angles of other records are refused, and the likely mistake is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from aacmm_pin.cli import app

XYZ = ["x_mm", "y_mm", "z_mm"]
THETA = [f"theta{j}_deg" for j in range(1, 7)]
ANY = "are the columns of angles and coordinates, their units and signs, the arm and the reference frame right?"


def scaled(factor: float) -> Callable[[pd.DataFrame], None]:
    def change(table: pd.DataFrame) -> None:
        table[XYZ] *= factor

    return change


def exchanged(table: pd.DataFrame) -> None:
    table[["x_mm", "y_mm"]] = table[["y_mm", "x_mm"]].to_numpy()


def other_sign(table: pd.DataFrame) -> None:
    table["z_mm"] *= -1.0


def other_frame(table: pd.DataFrame) -> None:
    table[XYZ] = Rotation.from_rotvec([0.3, -1.0, 0.5]).apply(table[XYZ].to_numpy()) + np.array([500.0, 20.0, 900.0])


def other_angles(table: pd.DataFrame) -> None:
    table[THETA[1:3]] = table[[THETA[2], THETA[1]]].to_numpy()


MISTAKES = [
    (scaled(1e-3), "base", "its coordinates look as if given in metres, in columns of mm; convert them"),
    (scaled(1e-3), "external", "its coordinates look as if given in metres, in columns of mm; convert them"),
    (scaled(1 / 25.4), "external", "its coordinates look as if given in inches"),
    (exchanged, "external", "two columns exchanged, or one with the other sign?"),
    (other_sign, "base", "two columns exchanged, or one with the other sign?"),
    (other_frame, "base", "is the reference frame external?"),
    (other_angles, "external", ANY),
]


def simulated(folder: Path, plan: str) -> pd.DataFrame:
    path = folder / "simulated.csv"
    done = CliRunner().invoke(app, ["simulate", "sino6", "--plan", plan, "--records", "60", "--seats", "6", "-o", str(path)])
    assert done.exit_code == 0, done.output
    return pd.read_csv(path)


@pytest.mark.parametrize("command", [["calibrate", "--no-held-out"], ["diagnose", "--no-held-out"]], ids=lambda c: c[0])
@pytest.mark.parametrize(("mistake", "frame", "said"), MISTAKES)
def test_a_mistaken_file_is_refused(
    tmp_path: Path, command: list[str], mistake: Callable[[pd.DataFrame], None], frame: str, said: str
) -> None:
    table = simulated(tmp_path, "free")
    mistake(table)
    path, target = tmp_path / "mistaken.csv", tmp_path / "result"
    table.to_csv(path, index=False)
    name, *options = command
    done = CliRunner().invoke(app, [name, "sino6", str(path), "--reference-frame", frame, *options, "-o", str(target)])
    assert done.exit_code == 1
    assert done.stdout == ""
    assert "mistaken.csv does not fit this arm" in done.stderr
    assert said in done.stderr
    assert not target.exists()


def test_seats_without_coordinates_and_the_angles_of_others(tmp_path: Path) -> None:
    table = simulated(tmp_path, "seats").drop(columns=XYZ)
    table[THETA] = np.random.default_rng(3).permutation(table[THETA].to_numpy())
    path = tmp_path / "mistaken.csv"
    table.drop(columns=[c for c in table if c.startswith("u_")]).to_csv(path, index=False)
    done = CliRunner().invoke(app, ["calibrate", "sino6", str(path), "--parameters", "zero-offsets", "--no-held-out"])
    assert done.exit_code == 1
    assert done.stdout == ""


def test_an_arm_far_from_its_table_is_no_mistake(tmp_path: Path) -> None:
    table = simulated(tmp_path, "free")
    table[THETA] += [3.0, -2.0, 2.5, -3.0, 2.0, 1.0]
    path = tmp_path / "assembled.csv"
    table.to_csv(path, index=False)
    done = CliRunner().invoke(app, ["calibrate", "sino6", str(path), "--parameters", "zero-offsets", "--no-held-out"])
    assert done.exit_code == 0, done.output
