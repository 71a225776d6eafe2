"""The command line as a user meets it: outputs by the contract, exit statuses, nothing
half-written.
"""

from __future__ import annotations

import contextlib
import io
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
from shell import POINT, done, found, refused, run

import aacmm_pin
from aacmm_pin import Arm, WorkspaceMap
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import load_arm_file
from aacmm_pin.effects import ErrorModel
from aacmm_pin.report.demo import run_demo

SMALL = ["--cells", "6", "6"]
BUNDLED = Path(aacmm_pin.__file__).parent / "arm" / "bundled" / "sino6.toml"


def test_help_lists_the_commands_that_work_and_no_others():
    out, _ = done("--help")
    measured = ("simulate", "calibrate", "diagnose", "correct", "plan", "accept")
    for command in ("demo", "urdf", "configurations", "accuracy", "map", "show", *measured):
        assert f" {command} " in out
    assert done("--version")[0].startswith("aacmm-pin ")


def test_urdf_is_the_kept_one(tmp_path):
    target, kept = tmp_path / "sino6.urdf", Path(__file__).parents[2] / "urdf" / "sino6.urdf"
    assert done("urdf", "sino6", "-o", target) == ("", f"written: {target}\n")
    assert target.read_bytes() == kept.read_bytes()
    assert done("urdf", "sino6")[0] == kept.read_text(encoding="utf-8")


def test_configurations_csv_reaches_the_point(tmp_path):
    target = tmp_path / "c.csv"
    done("configurations", "sino6", *POINT, "--count", "12", "-o", target)
    table = pd.read_csv(target)
    thetas = [f"theta{j}_deg" for j in range(1, 7)]
    named = [
        "component",
        "swivel_deg",
        *thetas,
        "within_limits",
        "broken_limits",
        "x_mm",
        "y_mm",
        "z_mm",
    ]
    assert list(table.columns)[: len(named)] == named
    position = Arm.load("sino6").poses(table[thetas].to_numpy() * DEG, "frame5").position / MM
    np.testing.assert_allclose(position, table[["x_mm", "y_mm", "z_mm"]], atol=1e-9)
    np.testing.assert_allclose(
        position, np.broadcast_to([33.6323, -671.8702, 182.9355], position.shape), atol=1e-9
    )
    assert table["within_limits"].dtype == bool
    assert table.loc[table["within_limits"], "broken_limits"].isna().all()
    out, err = done("configurations", "sino6", *POINT, "--count", "12")
    assert len(table) == 48
    assert out == target.read_text(encoding="utf-8")
    assert "flexibility" in err


def test_accuracy_in_numbers(tmp_path):
    target = tmp_path / "a.csv"
    summary = found("accuracy", "sino6", *POINT, "-o", target)
    assert summary["schema"] == "aacmm-pin/accuracy/1"
    assert summary["point_mm"] == [33.6323, -671.8702, 182.9355]
    assert summary["configurations"] == 360
    assert 5.1e-3 < summary["volume_mm3"]["min"] < summary["volume_mm3"]["max"] < 8.0e-3
    assert sum(row["share"] for row in summary["budget"]) == pytest.approx(1)
    assert summary["smallest_u"]["u_mm"] == summary["u_mm"]["min"] < summary["best"]["u_mm"]
    assert summary["taken_as_exact"] == []
    table = pd.read_csv(target)
    assert len(table) == 360
    assert table["within_limits"].all()
    assert (table["largest_deviation_mm"] > table["u_mm"]).all()
    for method in ("jointwise", "ellipsoid", "monte-carlo"):
        other = found(
            "accuracy", "sino6", *POINT, "--method", method, "--count", "6", "--seed", "3"
        )
        assert (other["method"], other.get("seed")) == (
            method,
            3 if method == "monte-carlo" else None,
        )
    noisy = found("accuracy", "sino6", *POINT, "--count", "6", "--encoder-noise-rad", "2.4e-5")
    assert "encoder_noise1" in {row["parameter"] for row in noisy["budget"]}
    upright = found("accuracy", "sino6", *POINT, "--tip", "--axis", "0", "0", "-1", "--count", "12")
    assert upright["at"] == "tip"


def test_accuracy_in_words_names_the_best_posture_and_the_budget(tmp_path):
    picture, path = tmp_path / "a.png", tmp_path / "mine.toml"
    out, _ = done("accuracy", "sino6", *POINT, "--count", "12", "--plot", picture)
    for word in ("smallest volume", "largest U", "theta_offset3", "alpha4", "mm³"):
        assert word in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    lines = BUNDLED.read_text(encoding="utf-8").splitlines()
    path.write_text(
        "\n".join(
            line for line in lines if not line.startswith("uncertainty") or "0.02707" not in line
        )
    )
    assert "a3, d3, alpha3, theta_offset3" in done("accuracy", path, *POINT, "--count", "6")[0]


def test_map_writes_netcdf_picture_and_json(tmp_path):
    target, picture = tmp_path / "m.nc", tmp_path / "m.png"
    summary = found("map", "sino6", *SMALL, "--sectors", "12", "-o", target, "--plot", picture)
    assert summary["cells"] == [6, 6]
    assert sum(summary["working_sectors"].values()) + summary["unreachable"] == 36
    assert summary["extent_mm"] == {"x": [0, 1220], "z": [-1220, 1220]}
    assert WorkspaceMap.load(target).working_sectors() == {
        int(k): n for k, n in summary["working_sectors"].items()
    }
    assert picture.stat().st_size > 1000


def test_unusable_input_is_one_message_and_status_1():
    for words, said in (
        (["accuracy", "sino7", *POINT], ["sino7", "sino6", "zero6"]),
        (["accuracy", "none.toml", *POINT], ["none.toml", "no such file"]),
        (["accuracy", "sino6", "--point", "1", "2", "nan"], ["point[2]", "nan", "finite"]),
        (["accuracy", "sino6", "--point", "1300", "0", "0"], ["1300.000 mm", "1210.6", "reaches"]),
        (
            ["configurations", "sino6", "--point", "0", "0", "100"],
            ["100.000 mm", "200.4", "reaches"],
        ),
        (
            ["configurations", "sino6", *POINT, "--tip", "--axis", "0", "0", "0"],
            ["axis", "direction"],
        ),
        (["accuracy", "sino6", *POINT, "--method", "guess"], ["guess", "zonotope", "ellipsoid"]),
        (["accuracy", "sino6", *POINT, "--encoder-noise-rad", "-1"], ["--encoder-noise-rad", "-1"]),
        (["accuracy", "zero6", "--point", "300", "200", "300"], ["zero6", "uncertainty"]),
        (["map", "zero6", *SMALL], ["zero6", "uncertainty"]),
        (
            ["map", "sino6", *SMALL, "--extent-mm", "500", "100", "0", "100"],
            ["extent", "500", "x from < x to"],
        ),
        (["map", "sino6", *SMALL, "--method", "monte-carlo"], ["monte-carlo", "ellipsoid"]),
        (["map", "sino6", "--cells", "0", "4"], ["(0, 4)", "at least 1"]),
        (["urdf", "sino6", "-o", "/no/such/folder/a.urdf"], ["/no/such/folder", "does not exist"]),
    ):
        refused(*words, said=said)


def test_a_point_in_metres_is_seen(tmp_path):
    """0.4 0 0.3 mm is beside the shoulder, where nothing reaches; 0.4 0 0.3 m is in reach."""
    metres = ["--point", "0.4", "0.0", "0.3"]
    for words in ([], ["--tip", "--axis", "0", "0", "-1"]):
        refused(
            "configurations", "sino6", *metres, *words, said=["0.4000", "metres", "expected mm"]
        )
    refused("accuracy", "sino6", *POINT, "--to", "0.4", "0", "0.3", said=["metres"])
    assert "metres" not in refused("configurations", "sino6", "--point", "1.9", "0", "0")
    file, path = (
        load_arm_file("sino6"),
        tmp_path / "near.toml",
    )  # the wrist comes to the shoulder, beyond the limits
    third, fourth = ({"d_mm": -500.0, "a_mm": 60.0}, {"limits_rad": (-2.2, 0.0)})
    changed = [
        row.model_copy(update=change)
        for row, change in zip(file.joints[2:4], (third, fourth), strict=True)
    ]
    joints = [*file.joints[:2], *changed, *file.joints[4:]]
    path.write_text(ErrorModel(Arm.from_file(file.model_copy(update={"joints": joints}))).text())
    _, said = done("configurations", path, *metres, "--count", "9")
    assert "0 of them within limits" in said
    assert "note: the same numbers in metres" in said


def test_the_tip_of_an_arm_with_other_than_six_joints(tmp_path):
    """Five conditions: single postures of five joints; seven need the whole pose, with which they
    go round curves.
    """
    file, tip = load_arm_file("sino6"), ["--tip", "--axis", "0", "0", "-1"]
    five, seven = tmp_path / "five.toml", tmp_path / "seven.toml"
    for path, joints in ((five, file.joints[1:]), (seven, [*file.joints, file.joints[1]])):
        path.write_text(
            ErrorModel(Arm.from_file(file.model_copy(update={"joints": joints}))).text()
        )
    arm, q = Arm.load(five), np.array([[0.5, 1.0, 2.0, 0.8, 1.5]])
    point, axis = arm.positions(q)[0] / MM, arm.poses(q).placement[0, :3, :3] @ arm.stylus_axis
    there = ["--point", *map(str, point), "--tip", "--axis", *map(str, axis)]
    table = pd.read_csv(io.StringIO(done("configurations", five, *there)[0]))
    found = table[[f"theta{j}_deg" for j in range(1, 6)]].to_numpy()
    assert np.abs(np.sin(np.radians(found) / 2 - q / 2)).max(axis=1).min() < 1e-6
    refused("accuracy", seven, *POINT, *tip, said=["7 joints", "2 joints free", "full pose"])
    curves, _ = done(
        "configurations", seven, *POINT, "--tip", "--rpy-deg", "180", "0", "0", "--count", "9"
    )
    assert len(curves.splitlines()) > 9


def test_numbers_that_no_option_takes(tmp_path):
    """The same numbers are refused by Python, which says them in SI; work that would fill the
    memory is not begun.
    """
    tip, sizes = ["--tip", "--axis", "0", "0", "-1"], ["map", "sino6", "--cells", "3", "3"]
    bars, plan = (
        ["simulate", "sino6", "--plan", "ball-bar", "--bar-length-mm"],
        ["plan", "sino6", "--records", "5"],
    )
    for words, said in (
        (
            ["accuracy", "sino6", *POINT, "--count", "1000000000"],
            ["count", "1000000000", "400000", "4 GB"],
        ),
        (["configurations", "sino6", *POINT, "--count", "9" * 40], ["count", "400000"]),
        (["map", "sino6", "--cells", "1000000", "1000000"], ["cells", "1000000000000", "4000000"]),
        (
            ["demo", "-o", tmp_path / "out", "--cells", "1000000", "1000000"],
            ["cells", "1000000000000"],
        ),
        ([*sizes, "--sectors", "1000000"], ["sectors", "1000000"]),
        ([*sizes, "--processes", "100000"], ["processes", "100000"]),
        (
            [*sizes, "--extent-mm", "0", "1.2", "-1.2", "1.2"],
            ["SINO6", "out of reach", "--extent-mm"],
        ),
        ([*sizes, "--extent-mm", "0", "1e200", "0", "1"], ["extent[1]", "100 m"]),
        (["accuracy", "sino6", "--point", "1e155", "0", "0"], ["point[0]", "100 m"]),
        (["configurations", "sino6", *tip, "--point", "0", "0", "-1e155"], ["point[2]", "100 m"]),
        (
            ["configurations", "sino6", "--tip", "--rpy-deg", "1e300", "0", "0", *POINT],
            ["--rpy-deg[0]"],
        ),
        (["show", "sino6", "--theta-deg", "0 1e300 0 0 0 0"], ["q[0, 1]"]),
        (
            ["accuracy", "sino6", *POINT, "--encoder-noise-rad", "1.65"],
            ["--encoder-noise-rad", "1.65", "0.005"],
        ),
        (
            ["simulate", "sino6", "--encoder-noise-rad", "1.65"],
            ["--encoder-noise-rad", "1.65", "0.005"],
        ),
        (["simulate", "sino6", "--records", "1000000000"], ["records", "1000000000", "800000"]),
        (
            ["simulate", "sino6", "--seats", "1000000", "--records", "500000"],
            ["seats", "1000000", "20000"],
        ),
        ([*bars, "1e300"], ["bar_length", "1e+297", "100 m"]),
        ([*bars, "nan"], ["bar_length", "nan"]),
        (["plan", "sino6", "--records", "1000000"], ["records", "1000000", "10000"]),
        ([*plan, "--postures", "1000000000"], ["postures", "1000000000"]),
        ([*plan, "--above-mm", "1e300"], ["above", "1e+297"]),
    ):
        refused(*words, said=said)
    for words in (
        ["accuracy", "sino6", *POINT, "--seed", "-1"],
        ["simulate", "sino6", "--records", "1e9"],
    ):
        assert run(*words)[0] == 2, words


def test_angles_carry_their_unit():
    words = ["accuracy", "sino6", *POINT, "--count", 12, "--method", "ellipsoid"]
    least = [
        found(*words, "--encoder-noise-rad", text)["best"]["u_mm"]
        for text in ("1e-4", "100urad", f"{np.degrees(0.1)}mdeg")
    ]
    np.testing.assert_allclose(least, least[0], rtol=1e-12)
    assert run(*words, "--encoder-noise-rad", "8foo")[0] == 2


def test_wrong_usage_is_status_2():
    with_axis = ["--axis", "0", "0", "1"]
    for words in (
        ["nope"],
        ["accuracy", "sino6"],
        ["accuracy", *POINT],
        ["accuracy", "sino6", "--point", "1", "2"],
        ["accuracy", "sino6", "--point", "a", "b", "c"],
        ["accuracy", "sino6", *POINT, "--count", "2"],
        ["accuracy", "sino6", *POINT, "--tip"],
        ["accuracy", "sino6", *POINT, *with_axis],
        ["accuracy", "sino6", *POINT, "--rotation-half-width-rad", "1e-4"],
        ["configurations", "sino6", *POINT, "--rpy-deg", "0", "0", "0"],
        ["configurations", "sino6", "--tip", *POINT, *with_axis, "--tool-axis", "0", "0", "1"],
        ["configurations", "sino6", "--tip", *POINT, *with_axis, "--rpy-deg", "0", "0", "0"],
        ["configurations", *POINT],
        ["map", "sino6", "--sectors", "0"],
        ["simulate"],
        ["simulate", "sino6", "--unknown", "--plan", "free"],
        ["simulate", "sino6", "--plan", "free", "--seats", "3"],
        ["simulate", "sino6", "--plan", "single-point", "--seats", "1"],
        ["simulate", "sino6", "--plan", "single-point", "--reference-noise-mm", "0.1"],
        ["simulate", "sino6", "--unknown", "--reference-noise-mm", "0.1"],
        ["simulate", "sino6", "--bar-length-mm", "300"],
        ["plan", "sino6", "--as-it-stands"],
        ["plan", "sino6", "--length-noise-mm", "0.1"],
        ["simulate", "sino6", "--seed", "-1"],
        ["simulate", "sino6", "--urdf", "a.urdf", "--frame", "tip"],
        ["calibrate"],
        ["calibrate", "sino6"],
        ["calibrate", "sino6", "data.csv", "--frame", "tip"],
        ["calibrate", "sino6", "data.csv", "--urdf", "a.urdf", "--frame", "tip"],
        ["correct", "sino6"],
        ["correct", "sino6", "readings.csv", "--commands"],
        ["correct", "sino6", "readings.csv", "--encoder-noise-rad", "small"],
    ):
        status, out, _ = run(*words)
        assert (status, out) == (2, ""), words


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


def test_a_bad_arm_file_is_named_with_its_key(tmp_path):
    path, good = tmp_path / "mine.toml", JOINT.format(limits="1.0, 3.0", half=0.1)
    for text, said in (
        (
            ARM + JOINT.format(limits="3.0, 1.0", half=0.1),
            ["joints[1]", "limits_rad", "3.0", "lower"],
        ),
        (ARM + JOINT.format(limits="1.0, 3.0", half=-0.1), ["joints[1].uncertainty.a_mm", "-0.1"]),
        (ARM + JOINT.format(limits="0, 360", half=0.1), ["limits_rad[2]", "360", "degrees"]),
        (ARM + good.replace("1.5", "-90.05"), ["alpha_rad", "-90.05", "degrees"]),
        (ARM + "colour = 3\n" + good, ["colour", "unknown key"]),
        ("name = ", ["not TOML", "end of document"]),
    ):
        path.write_text(text, encoding="utf-8")
        refused("accuracy", path, *POINT, said=["mine.toml", *said])


def test_existing_files_are_kept_unless_forced(tmp_path):
    target = tmp_path / "c.csv"
    target.write_text("mine")
    words = ["configurations", "sino6", *POINT, "--count", "6", "-o", target]
    refused(*words, said=["--force"])
    assert target.read_text() == "mine"
    done(*words, "--force")
    assert target.read_text().startswith("component")
    refused(
        "accuracy", "sino6", *POINT, "--count", "6", "--plot", tmp_path / "a.nope", said=["nope"]
    )
    assert list(tmp_path.iterdir()) == [target]


def stopped(words: list[str], sent: signal.Signals, ready: object) -> None:
    """Start a command in a process of its own and send it a signal when it is ``ready``; it leaves
    no word on stdout.
    """
    command = [sys.executable, "-m", "aacmm_pin.cli", *words]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, start_new_session=True) as process:
        try:
            end = time.monotonic() + 120
            while not ready(process.pid):
                assert process.poll() is None
                assert time.monotonic() < end
                time.sleep(0.02)
            os.killpg(process.pid, sent)
            began = time.monotonic()
            out, err = process.communicate(timeout=60)
            assert time.monotonic() - began < 9  # a job of a map takes some ten seconds
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert process.returncode == 128 + sent
    assert out == ""
    assert "interrupted" in err
    assert "Traceback" not in err


def test_what_is_interrupted_or_terminated_leaves_nothing(tmp_path):
    words = [
        "map",
        "sino6",
        "--cells",
        "200",
        "200",
        "--processes",
        "2",
        "-o",
        str(tmp_path / "m.nc"),
    ]
    stopped(
        words, signal.SIGINT, lambda pid: _cpu_seconds(pid) > 5.0
    )  # imports take some two of them
    assert list(tmp_path.iterdir()) == []
    stopped(
        ["demo", "-o", str(tmp_path / "out")], signal.SIGTERM, lambda _: list(tmp_path.iterdir())
    )
    assert list(tmp_path.iterdir()) == []


def _cpu_seconds(session: int) -> float:
    """What all processes of a session have worked together [s]."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # one that has just ended
            fields = place.read_text().rpartition(")")[2].split()
            ticks += int(fields[11]) + int(fields[12]) if int(fields[3]) == session else 0
    return ticks / os.sysconf("SC_CLK_TCK")


def test_demo_writes_the_page(tmp_path, monkeypatch):
    """Of an arm like SINO6 with another name: without the paper, which is about SINO6 alone and
    takes most of the time.
    """
    folder, mine = tmp_path / "out", tmp_path / "mine.toml"
    mine.write_text(
        BUNDLED.read_text(encoding="utf-8").replace('name = "SINO6"', 'name = "MINE"'),
        encoding="utf-8",
    )
    monkeypatch.setattr("aacmm_pin.report.demo.run_demo", partial(run_demo, str(mine)))
    monkeypatch.setattr("aacmm_pin.report.demo.RECORDS", 60)
    assert "MINE" in done("demo", "-o", folder, "--cells", "6", "6")[0]
    page = (folder / "index.html").read_text(encoding="utf-8")
    assert "<img" in page
    assert len(page) < 5_000_000
    assert "Table 2" not in page
    refused("demo", "-o", folder, said=["--force"])
