"""The command line as a user meets it: outputs by the contract, exit statuses, nothing
half-written.
"""

from __future__ import annotations

import importlib
import re
import shlex

import numpy as np
import pandas as pd
import pytest
import typer
import xarray as xr
from shell import POINT, done, found, refused, run

from aacmm_pin import Arm, WorkspaceMap
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import arm_text, load_arm_file
from aacmm_pin.cli.root_command import COMMANDS, app
from tests.oracle import close
from tests.tables import PLACES, THETAS

SMALL = "--cells 4 4"


def test_help_lists_all_commands():
    assert all(
        f" {name.split()[-1]} " in done("--help")[0] + done("plan --help")[0] for name in COMMANDS
    )
    assert done("--version")[0].startswith("aacmm-pin ")


def test_configurations_csv_reaches_the_point(tmp_path):
    target = tmp_path / "c.csv"
    done(f"configurations sino6 {POINT} --samples 12 -o {target}")
    table = pd.read_csv(target)
    named = [
        "component",
        "swivel_deg",
        *THETAS,
        "within_limits",
        "broken_limits",
        "x_mm",
        "y_mm",
        "z_mm",
    ]
    assert list(table.columns)[: len(named)] == named
    position = Arm.load("sino6").poses(table[THETAS].to_numpy() * DEG, "frame5").position / MM
    close(position, table[PLACES], 1e-9)
    close(position, np.broadcast_to([33.6323, -671.8702, 182.9355], position.shape), 1e-9)
    assert table["within_limits"].dtype == bool
    assert table.loc[table["within_limits"], "broken_limits"].isna().all()
    out, err = done(f"configurations sino6 {POINT} --samples 12")
    assert len(table) == 48
    assert out == target.read_text(encoding="utf-8")
    assert "flexibility" in err


def test_accuracy_in_numbers(tmp_path):
    target = tmp_path / "a.csv"
    summary = found(f"accuracy sino6 {POINT} -o {target}")
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
        other = found(f"accuracy sino6 {POINT} --method {method} --samples 6 --seed 3")
        assert (other["method"], other.get("seed")) == (
            method,
            3 if method == "monte-carlo" else None,
        )
    noisy = found(f"accuracy sino6 {POINT} --samples 6 --encoder-noise 2.4e-5")
    assert "encoder_noise1" in {row["parameter"] for row in noisy["budget"]}
    upright = found(f"accuracy sino6 {POINT} --axis 0 0 -1 --samples 12")
    assert upright["at"] == "tip"
    assert upright == found(f"accuracy sino6 {POINT} --tip --axis 0 0 -1 --samples 12")


def test_commands_say_which_point_is_there():
    """The wrist, unless the direction of the stylus is stated."""
    words = f"{POINT} --samples 3"
    for command in ("configurations", "accuracy"):
        assert "wrist (frame5)" in done(f"{command} sino6 {words}")[1]
        assert "wrist" not in done(f"{command} sino6 {words} --axis 0 0 -1")[1]


def test_map_writes_netcdf_picture_and_json(tmp_path):
    target, picture = tmp_path / "m.nc", tmp_path / "m.png"
    summary = found(f"map sino6 {SMALL} --sectors 4 -o {target} --plot {picture}")
    assert summary["cells"] == [4, 4]
    assert sum(summary["working_sectors"].values()) + summary["unreachable"] == 16
    assert summary["extent_mm"] == {"x": [0, 1220], "z": [-1220, 1220]}
    assert WorkspaceMap(xr.load_dataset(target), 0.0).working_sectors() == {
        int(k): n for k, n in summary["working_sectors"].items()
    }
    assert picture.stat().st_size > 1000
    assert summary["at"] == "frame5"
    volume = picture.read_bytes()
    words = f"map sino6 {SMALL} --plot {picture} --quantity largest_u_mm --force"
    done(words)
    assert picture.read_bytes() != volume


def test_map_of_the_tip(tmp_path):
    """Worker processes give the same to the last bit."""
    target, other = tmp_path / "m.nc", tmp_path / "other.nc"
    summary = found(f"map sino6 --cells 2 2 --axis 0 0 -2 -o {target}")
    assert (summary["at"], summary["stylus_axis"]) == ("tip", [0.0, 0.0, -1.0])
    out, err = done(f"map sino6 --cells 2 2 --axis 0 0 -1 --workers 2 -o {other}")
    assert "SINO6 at tip" in " ".join(out.split()[:6])
    assert "2 × 2 cells" in out
    assert "held" not in err
    here, there = map(xr.load_dataset, (target, other))
    assert here.attrs["working_point"] == "tip"
    del here.attrs["seconds"], there.attrs["seconds"]
    xr.testing.assert_identical(here, there)


def test_unusable_input_is_one_message_and_status_1():
    for words, said in (
        (f"accuracy sino7 {POINT}", ["sino7", "sino6, zero6"]),
        ("accuracy sino6 --point 1300 0 0", ["1300 mm", "1210.6"]),
        ("urdf sino6 -o /no/such/folder/a.urdf", ["/no/such/folder"]),
    ):
        refused(words, said=said)


def test_a_point_in_metres_is_seen():
    """0.4 0 0.3 mm is beside the shoulder, where nothing reaches; 0.4 0 0.3 m is in reach."""
    refused("configurations sino6 --point 0.4 0.0 0.3", said=["0.4", "metres"])
    refused(f"accuracy sino6 {POINT} --to 0.4 0 0.3", said=["metres"])
    assert "metres" not in refused("configurations sino6 --point 1.9 0 0")


def test_numbers_that_no_option_takes():
    """Python refuses them too; work that would fill the memory is not begun."""
    for words, said in (
        (f"accuracy sino6 {POINT} --samples 1000000000", ["400000", "4 GB"]),
        ("map sino6 --cells 1000000 1000000", ["1000000000000", "4000000"]),
        ("map sino6 --cells 3 3 --extent-mm 0 1.2 -1.2 1.2", ["--extent-mm"]),
        ("plan distinguish sino6 --records 1000000", ["--records", "10000"]),
    ):
        refused(words, said=said)
    assert run("simulate sino6 --records 1e9")[0] == 2


@pytest.mark.parametrize(
    "words",
    [
        "simulate sino6 --encoder-noise 0,5",
        "simulate sino6 --u-reference-mm 0,5",
        "accuracy sino6 --point 400 0,5 300",
    ],
)
def test_an_option_that_is_no_number_is_quoted(words):
    status, _, err = run(words)
    assert (status, "'0,5'; expected a" in err) == (2, True)


def test_half_widths_in_another_unit(tmp_path):
    text = arm_text(load_arm_file("sino6")).replace("a_mm = 0.00852", "a_mm = 100.0")
    (tmp_path / "arm.toml").write_text(text.replace("2.70805e-05", "0.1222"))
    words = f"configurations {tmp_path / 'arm.toml'} {POINT}"
    (length, angle) = [line for line in done(words)[1].splitlines() if "warning: " in line]
    assert ("100 mm" in length, "a1" in length) == (True, True)
    assert ("7°" in angle, "alpha1" in angle) == (True, True)


def test_angles_carry_their_unit():
    words = f"accuracy sino6 {POINT} --samples 12 --method ellipsoid"
    least = [
        found(words, f"--encoder-noise {text}")["best"]["u_mm"]
        for text in ("1e-4", "100urad", f"{np.degrees(0.1)}mdeg")
    ]
    np.testing.assert_allclose(least, least[0], rtol=1e-12)
    assert run(words, "--encoder-noise 8foo")[0] == 2


def test_wrong_usage_is_status_2():
    for words in (
        "nope",
        f"accuracy {POINT}",
        "accuracy sino6 --point a b c",
        f"accuracy sino6 {POINT} --method guess",
        f"accuracy sino6 {POINT} --tip",
        f"map sino6 {SMALL} --quantity largest_u_mm",
        f"map sino6 {SMALL} --plot map.png --quantity u",
        f"accuracy sino6 {POINT} --rotation-half-width 1e-4",
        "simulate sino6 --no-seat-coordinates --scheme free",
        "simulate sino6 --bar-length-mm 300",
        "simulate sino6 --procedure touches.csv --scheme free",
        "simulate sino6 --seed -1",
        "plan distinguish sino6 --keep-set-up",
        "calibrate sino6",
        "calibrate sino6 data.csv --urdf a.urdf --frame tip",
        "correct sino6 readings.csv --commands",
        "urdf my_ur5e.yaml --ur-robot ur5e",
    ):
        status, out, _ = run(words)
        assert (status, out) == (2, ""), words


def test_a_quiet_command_prints_results_and_warnings(tmp_path):
    words = f"configurations sino6 {POINT} --samples 6"
    assert done(words, "--quiet") == (done(words)[0], "")
    readings = pd.DataFrame(np.zeros((1, 6)), columns=THETAS)
    readings.to_csv(tmp_path / "zero.csv", index=False)
    ready = f"correct sino6 {tmp_path / 'zero.csv'}"
    assert "note: " in done(ready)[1]
    assert "note: " not in done(ready, "-q")[1]


def test_demo_is_asked_for_with_its_options(tmp_path, monkeypatch):
    """What it writes: tests/report/test_demo.py."""
    asked = []
    monkeypatch.setattr(
        "aacmm_pin.report.demo_page.run_demo", lambda **given: asked.append(given) or "done"
    )
    assert done(f"demo -o {tmp_path} --cells 6 8 --force")[0] == "done\n"
    assert asked == [{"folder": tmp_path, "cells": (6, 8), "force": True}]


@pytest.mark.parametrize("name", [name for name in COMMANDS if name != "plan"])
def test_examples_of_the_help_have_options_that_exist(name):
    group = typer.main.get_command(app)
    module = re.sub("[ -]", "_", name)
    for line in importlib.import_module(f"aacmm_pin.cli.{module}").run.examples:
        assert line.startswith(f"aacmm-pin {name}")
        command, words = group, shlex.split(line)[1:]
        for word in name.split():
            command, words = command.get_command(None, word), words[1:]
        command.make_context(name, words)
