"""The command line as a user meets it: outputs by the contract, exit statuses, nothing half-written."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import aacmm_pin
from aacmm_pin import Arm
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy.workspace import WorkspaceMap
from aacmm_pin.cli import app
from aacmm_pin.report.demo import run_demo

POINT = ["--point", "33.6323", "-671.8702", "182.9355"]
SMALL = ["--cells", "6", "6"]


def run(*words: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.stdout, result.stderr


def test_help_lists_the_commands_that_work_and_no_others() -> None:
    status, out, _ = run("--help")
    assert status == 0
    measured = ("simulate", "calibrate", "diagnose", "correct", "plan")
    for command in ("demo", "urdf", "configurations", "accuracy", "map", "show", *measured):
        assert f" {command} " in out
    assert " accept " not in out


def test_urdf_is_the_kept_one(tmp_path: Path) -> None:
    target = tmp_path / "sino6.urdf"
    assert run("urdf", "sino6", "-o", target) == (0, "", "")
    kept = Path(__file__).parents[2] / "urdf" / "sino6.urdf"
    assert target.read_bytes() == kept.read_bytes()
    assert run("urdf", "sino6")[1] == kept.read_text(encoding="utf-8")


def test_configurations_csv_reaches_the_point(tmp_path: Path) -> None:
    target = tmp_path / "c.csv"
    assert run("configurations", "sino6", *POINT, "--count", "36", "-o", target)[0] == 0
    table = pd.read_csv(target)
    thetas = [f"theta{j}_deg" for j in range(1, 7)]
    named = ["component", "swivel_deg", *thetas, "within_limits", "broken_limits", "x_mm", "y_mm", "z_mm"]
    assert list(table.columns)[: len(named)] == named
    q = table[thetas].to_numpy() * DEG
    position = Arm.load("sino6").poses(q, "frame5").position / MM
    np.testing.assert_allclose(position, table[["x_mm", "y_mm", "z_mm"]], atol=1e-9)
    np.testing.assert_allclose(position, np.broadcast_to([33.6323, -671.8702, 182.9355], position.shape), atol=1e-9)
    assert table["within_limits"].dtype == bool
    assert table.loc[table["within_limits"], "broken_limits"].isna().all()


def test_configurations_without_a_file_go_to_stdout() -> None:
    status, out, err = run("configurations", "sino6", *POINT, "--count", "12")
    assert status == 0
    assert len(pd.read_csv(io.StringIO(out))) == 48
    assert "flexibility" in err


def test_accuracy_json_is_alone_on_stdout() -> None:
    status, out, err = run("accuracy", "sino6", *POINT, "--json", "-")
    assert (status, err) == (0, "")
    summary = json.loads(out)
    assert summary["schema"] == "aacmm-pin/accuracy/1"
    assert summary["point_mm"] == [33.6323, -671.8702, 182.9355]
    assert summary["configurations"] == 360
    assert 5.1e-3 < summary["volume_mm3"]["min"] < summary["volume_mm3"]["max"] < 8.0e-3
    assert sum(row["share"] for row in summary["budget"]) == pytest.approx(1)
    assert summary["smallest_u"]["u_mm"] == summary["u_mm"]["min"] < summary["best"]["u_mm"]
    assert summary["taken_as_exact"] == []


@pytest.mark.parametrize("method", ["jointwise", "ellipsoid", "monte-carlo"])
def test_accuracy_by_other_methods(method: str) -> None:
    status, out, _ = run("accuracy", "sino6", *POINT, "--method", method, "--count", "6", "--seed", "3", "--json", "-")
    assert status == 0
    summary = json.loads(out)
    assert summary["method"] == method
    assert summary.get("seed") == (3 if method == "monte-carlo" else None)


def test_accuracy_in_words_names_the_best_posture_and_the_budget(tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    status, out, _ = run("accuracy", "sino6", *POINT, "--count", "24", "--plot", picture)
    assert status == 0
    for word in ("smallest volume", "largest u", "theta_offset3", "alpha4", "mm³"):
        assert word in out
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_accuracy_of_the_tip_with_the_stylus_upright() -> None:
    status, out, _ = run("accuracy", "sino6", *POINT, "--tip", "--axis", "0", "0", "-1", "--count", "24", "--json", "-")
    assert status == 0
    assert json.loads(out)["at"] == "tip"


def test_encoder_noise_enters_the_budget() -> None:
    status, out, _ = run("accuracy", "sino6", *POINT, "--count", "6", "--encoder-noise-rad", "2.4e-5", "--json", "-")
    assert status == 0
    assert "encoder_noise1" in {row["parameter"] for row in json.loads(out)["budget"]}


def test_map_writes_netcdf_picture_and_json(tmp_path: Path) -> None:
    target, picture = tmp_path / "m.nc", tmp_path / "m.png"
    status, out, _ = run("map", "sino6", *SMALL, "--sectors", "12", "-o", target, "--plot", picture, "--json", "-")
    assert status == 0
    summary = json.loads(out)
    assert summary["cells"] == [6, 6]
    assert sum(summary["working_sectors"].values()) + summary["unreachable"] == 36
    assert summary["extent_mm"] == {"x": [0, 1200], "z": [-1200, 1200]}
    assert WorkspaceMap.load(target).working_sectors() == {int(k): n for k, n in summary["working_sectors"].items()}
    assert picture.stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["accuracy", "sino7", *POINT], ["sino7", "sino6", "zero6"]),
        (["accuracy", "none.toml", *POINT], ["none.toml", "no such file"]),
        (["accuracy", "sino6", "--point", "1", "2", "nan"], ["point[2]", "nan", "finite"]),
        (["accuracy", "sino6", "--point", "1300", "0", "0"], ["1300.000 mm", "1210.6", "reaches"]),
        (["configurations", "sino6", "--point", "0", "0", "100"], ["100.000 mm", "200.4", "reaches"]),
        (["configurations", "sino6", *POINT, "--tip", "--axis", "0", "0", "0"], ["axis", "direction"]),
        (["accuracy", "sino6", *POINT, "--method", "guess"], ["guess", "zonotope", "ellipsoid"]),
        (["accuracy", "sino6", *POINT, "--encoder-noise-rad", "-1"], ["encoder_noise", "-1", "negative"]),
        (["accuracy", "zero6", "--point", "300", "200", "300"], ["zero6", "uncertainty"]),
        (["map", "zero6", *SMALL], ["zero6", "uncertainty"]),
        (["map", "sino6", *SMALL, "--extent-mm", "500", "100", "0", "100"], ["extent", "500", "x from < x to"]),
        (["map", "sino6", *SMALL, "--method", "monte-carlo"], ["monte-carlo", "ellipsoid"]),
        (["map", "sino6", "--cells", "0", "4"], ["(0, 4)", "at least 1"]),
        (["urdf", "sino6", "-o", "/no/such/folder/a.urdf"], ["/no/such/folder", "does not exist"]),
    ],
)
def test_unusable_input_is_one_message_and_status_1(words: list[str], said: list[str]) -> None:
    status, out, err = run(*words)
    assert (status, out) == (1, "")
    assert err.startswith("aacmm-pin: ")
    assert "Traceback" not in err
    for word in said:
        assert word in err


@pytest.mark.parametrize(
    "words",
    [
        ["nope"],
        ["accuracy", "sino6"],
        ["accuracy", *POINT],
        ["accuracy", "sino6", "--point", "1", "2"],
        ["accuracy", "sino6", "--point", "a", "b", "c"],
        ["accuracy", "sino6", *POINT, "--count", "2"],
        ["accuracy", "sino6", *POINT, "--tip"],
        ["accuracy", "sino6", *POINT, "--axis", "0", "0", "1"],
        ["map", "sino6", "--sectors", "0"],
    ],
)
def test_wrong_usage_is_status_2(words: list[str]) -> None:
    assert run(*words)[0] == 2


ARM = """schema = "aacmm-pin/arm/1"
name = "short"
convention = "standard-dh"
"""
JOINT = """
[[joints]]
a_mm = 1.0
d_mm = 2.0
alpha_rad = 1.5
theta_offset_rad = 0.0
limits_rad = [{limits}]
uncertainty = {{ a_mm = {half}, d_mm = 0.0, alpha_rad = 0.0, theta_offset_rad = 0.0 }}
"""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ARM + JOINT.format(limits="3.0, 1.0", half=0.1), ["joints[1]", "limits_rad", "3.0", "lower"]),
        (ARM + JOINT.format(limits="1.0, 3.0", half=-0.1), ["joints[1].uncertainty.a_mm", "-0.1"]),
        (ARM + JOINT.format(limits="0, 360", half=0.1), ["limits_rad[2]", "360", "degrees"]),
        (ARM + JOINT.format(limits="1.0, 3.0", half=0.1).replace("1.5", "-90.05"), ["alpha_rad", "-90.05", "degrees"]),
        (ARM + "colour = 3\n" + JOINT.format(limits="1.0, 3.0", half=0.1), ["colour", "unknown key"]),
        ("name = ", ["not TOML", "end of document"]),
    ],
)
def test_a_bad_arm_file_is_named_with_its_key(tmp_path: Path, text: str, said: list[str]) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    status, out, err = run("accuracy", path, *POINT)
    assert (status, out) == (1, "")
    for word in ["mine.toml", *said]:
        assert word in err


def test_existing_files_are_kept_unless_forced(tmp_path: Path) -> None:
    target = tmp_path / "c.csv"
    target.write_text("mine")
    words = ["configurations", "sino6", *POINT, "--count", "6", "-o", target]
    status, _, err = run(*words)
    assert status == 1
    assert "--force" in err
    assert target.read_text() == "mine"
    assert run(*words, "--force")[0] == 0
    assert target.read_text().startswith("component")


def test_the_accuracy_of_every_posture_as_csv(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    assert run("accuracy", "sino6", *POINT, "--count", "36", "-o", target, "--json", "-")[0] == 0
    table = pd.read_csv(target)
    assert len(table) == 36
    assert table["within_limits"].all()
    assert (table["largest_deviation_mm"] > table["u_mm"]).all()


def test_rows_without_uncertainty_are_named(tmp_path: Path) -> None:
    text = (Path(aacmm_pin.__file__).parent / "arm" / "bundled" / "sino6.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("uncertainty") or "0.02707" not in line]
    path = tmp_path / "mine.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    status, out, _ = run("accuracy", path, *POINT, "--count", "6")
    assert status == 0
    assert "taken as exact: a3, d3, alpha3, theta_offset3" in out


def test_a_picture_of_an_unknown_kind_leaves_nothing(tmp_path: Path) -> None:
    status, _, err = run("accuracy", "sino6", *POINT, "--count", "6", "--plot", tmp_path / "a.nope")
    assert status == 1
    assert "nope" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("processes", ["1", "2"])
def test_interrupting_a_map_leaves_nothing(tmp_path: Path, processes: str) -> None:
    words = ["map", "sino6", "--cells", "200", "200", "--processes", processes, "-o", str(tmp_path / "m.nc")]
    command = [sys.executable, "-m", "aacmm_pin.cli", *words]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, start_new_session=True) as process:
        try:
            end = time.monotonic() + 120
            while _cpu_seconds(process.pid) < 6.0:  # imports take some two of them
                assert process.poll() is None
                assert time.monotonic() < end
                time.sleep(0.05)
            os.killpg(process.pid, signal.SIGINT)
            out, err = process.communicate(timeout=60)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert process.returncode == 130
    assert out == ""
    assert "interrupted" in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def test_a_demo_that_is_terminated_leaves_nothing(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "aacmm_pin.cli", "demo", "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        end = time.monotonic() + 120
        while not list(tmp_path.iterdir()):  # until it has a folder to write to
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.05)
        process.terminate()
        _, err = process.communicate(timeout=60)
    assert process.returncode == 143
    assert "interrupted" in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


def _cpu_seconds(session: int) -> float:
    """What all processes of a session have worked together [s]."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # one that has just ended
            fields = place.read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12]) if int(fields[3]) == session else 0
    return ticks / os.sysconf("SC_CLK_TCK")


def test_demo_writes_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an arm like SINO6 with another name: without the paper, which is about SINO6 alone and takes most of the time."""
    folder, mine = tmp_path / "out", tmp_path / "mine.toml"
    arm = (Path(aacmm_pin.__file__).parent / "arm" / "bundled" / "sino6.toml").read_text(encoding="utf-8")
    mine.write_text(arm.replace('name = "SINO6"', 'name = "MINE"'), encoding="utf-8")
    monkeypatch.setattr("aacmm_pin.report.demo.run_demo", partial(run_demo, str(mine)))
    status, out, _ = run("demo", "-o", folder, "--cells", "8", "8")
    assert status == 0
    assert "MINE" in out
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "<img" in page
    assert len(page) < 5_000_000
    assert "Table 2" not in page
    assert run("demo", "-o", folder)[0] == 1
