"""simulate, calibrate and correct as a user meets them: the files, what is said, exit statuses,
nothing half-written.
"""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from shell import NOISE, done, found, refused

from aacmm_pin import accuracy_volume
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm
from aacmm_pin.effects import (
    EncoderEccentricity,
    EncoderGain,
    ErrorModel,
    JointErrorCurve,
    StylusOffset,
)
from aacmm_pin.measurements import Measurements
from tests.oracle import close
from tests.tables import PLACES, readings

QUICK = f"{NOISE} --no-cross-validation"
HEADER = "theta1_deg,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg"
CORRECTED = [f"corrected_{name}" for name in PLACES]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Data and truth of a virtual SINO6 that differs from its file."""
    folder = tmp_path_factory.mktemp("data")
    words = "simulate sino6 --scheme seats --records 150 --random-geometry --seed 1"
    done(words, f"-o {folder / 'data.csv'} --arm-out {folder / 'truth.toml'}")
    done(f"calibrate sino6 {folder / 'data.csv'} {QUICK} -o {folder / 'cal.toml'}")
    return folder


@pytest.fixture(scope="module")
def data(folder) -> Path:
    return folder / "data.csv"


@pytest.fixture(scope="module")
def extended(folder) -> Path:
    """Arm file with an eccentricity and thermal expansion, and readings of that arm in warm.csv."""
    wave = "encoder_eccentricity:joint=3,amplitude_rad=1e-4,phase_rad=0.5"
    effects = f"--cause {wave} --cause thermal_expansion:expansion_per_k=2e-5"
    words = f"simulate sino6 --scheme free --records 150 {effects}"
    done(words, f"-o {folder / 'warm.csv'} --arm-out {folder / 'extended.toml'}")
    return folder / "extended.toml"


# simulate ------------------------------------------------------------


def test_every_plan_gives_a_file_that_can_be_read(tmp_path):
    target = tmp_path / "d.csv"
    for words, known, seats, bars in (
        ("free", 40, 0, 0),
        ("seats --seats 4", 40, 4, 0),
        ("seats --seats 4 --no-seat-coordinates", 0, 4, 0),
        ("ball-bar --seats 4 --bar-length-mm 400", 0, 4, 2),
        ("ball-bar --seats 2", 0, 2, 1),
        ("single-point", 0, 1, 0),
    ):
        out, err = done("simulate sino6 --scheme", words, f"--records 40 -o {target} --force")
        assert out == ""
        read = Measurements.read(target, 6)
        assert (read.n, read.known.sum(), len(read.seats()), len(read.bars())) == (
            40,
            known,
            seats,
            bars,
        ), words
        for word in (
            "seed 1",
            "40 records",
            "8 µrad",
            "0.012 mm",
        ):
            assert word in err
        assert ("--bar-length-mm" in err) == (words == "ball-bar --seats 2")
        if bars:
            assert read.bars()[0].length == pytest.approx(0.4 if bars == 2 else 0.5, abs=1e-4)


# calibrate ------------------------------------------------------------


def test_a_calibrated_file_tells_where_it_comes_from_and_comes_back(folder, data, tmp_path):
    text = (folder / "cal.toml").read_text(encoding="utf-8")
    head = text[: text.index("\nschema")]
    assert all(line.startswith("#") or not line for line in head.splitlines())
    for word in (
        str(data),
        "(UTC)",
        "150 records",
        "(0 excluded)",
        "RMS",
        "[covariance]",
        "standard uncertainties",
    ):
        assert word in head
    out, _ = done(f"calibrate {folder / 'cal.toml'} {data} {QUICK} -o {tmp_path / 'again.toml'}")
    assert "held out" in out
    once, twice = (ErrorModel.load(path) for path in (folder / "cal.toml", tmp_path / "again.toml"))
    for a, b in zip(once.parameters, twice.parameters, strict=True):
        assert b.value == pytest.approx(a.value, abs=1e-9 + a.u)


def test_all_files_at_once(data, tmp_path):
    names = {
        "-o": "c.toml",
        "--urdf-out": "c.urdf",
        "--residuals": "r.csv",
        "--plot": "p.png",
        "--report": "r.html",
    }
    files = [word for option, name in names.items() for word in (option, tmp_path / name)]
    done(f"calibrate sino6 {data} {QUICK}", files, f"--json {tmp_path / 'c.json'}")
    assert {path.name for path in tmp_path.iterdir()} == {*names.values(), "c.json"}
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    residuals = pd.read_csv(tmp_path / "r.csv")
    assert len(residuals) == 150
    assert {"row", "seat", "before_mm", "after_mm", "used"} <= set(residuals.columns)
    assert json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))["records"]["used"] == 150
    assert "</html>" in (tmp_path / "r.html").read_text(encoding="utf-8")
    model, arm = ErrorModel.load(tmp_path / "c.toml"), Arm.from_urdf(tmp_path / "c.urdf", "tip")
    q = Measurements.read(data).q
    close(arm.positions(q), model.predict(q), 1e-12)
    refused(f"calibrate sino6 {data} {QUICK} -o {tmp_path / 'c.toml'}")
    done(f"calibrate sino6 {data} {QUICK} -o {tmp_path / 'c.toml'} --force")


def test_one_file_that_cannot_be_written_leaves_none(data, tmp_path, monkeypatch):
    """Files are looked at before the work begins."""

    def work(*_: object, **__: object) -> None:
        raise AssertionError("work began")

    monkeypatch.setattr("aacmm_pin.cli.calibrate.calibrate", work)
    files = f"-o {tmp_path / 'c.toml'} --residuals {tmp_path / 'r.csv'}"
    words = f"calibrate sino6 {data} {QUICK} {files}"
    refused(words, f"--report {tmp_path / 'no' / 'r.html'}", said=["does not exist"])
    refused(words, f"--plot {tmp_path / 'c.toml'}", said=["two results"])
    refused(words, f"--plot {tmp_path / 'c.nope'}", said=[".png"])
    assert list(tmp_path.iterdir()) == []


def test_noise_on_the_command_line_is_in_millimetres(folder, tmp_path):
    table = (
        Measurements.read(folder / "data.csv")
        .to_frame()
        .drop(columns=["u_x_mm", "u_y_mm", "u_z_mm"])
    )
    table.to_csv(tmp_path / "d.csv", index=False)
    stated = found(f"calibrate sino6 {tmp_path / 'd.csv'} {QUICK} --u-reference-mm 0.012")
    file = found(f"calibrate sino6 {folder / 'data.csv'} {QUICK}")
    assert stated["noise_stated"]
    assert stated["chi2"]["value"] == pytest.approx(file["chi2"]["value"], rel=1e-6)


def test_a_urdf_holds_the_stylus_offset_and_says_what_it_does_not(extended, tmp_path):
    offset = StylusOffset(values=(1e-3, 2e-3, 3e-3))
    model = ErrorModel.load(extended).with_effects(offset, StylusOffset("M1", values=(1, 0, 0)))
    model.save(tmp_path / "m.toml")
    done(f"urdf {tmp_path / 'm.toml'} -o {tmp_path / 'm.urdf'}")
    q = np.random.default_rng(1).uniform(*model.arm.limits.T, (50, 6))
    shifted, here = Arm.from_urdf(tmp_path / "m.urdf", "tip"), Arm.load(tmp_path / "m.toml")
    close(shifted.positions(q), ErrorModel(model.arm, (offset,)).predict(q), 1e-12)
    close(here.poses(q).position, model.arm.positions(q), 1e-12)
    tip = ErrorModel(model.arm, (offset,))
    tip.save(tmp_path / "t.toml")
    done(f"simulate {tmp_path / 't.toml'} --scheme free --records 100 -o {tmp_path / 't.csv'}")
    files = f"-o {tmp_path / 'u.toml'} --urdf-out {tmp_path / 'u.urdf'}"
    done(f"calibrate {tmp_path / 't.toml'} {tmp_path / 't.csv'} {QUICK} {files}")
    found = Arm.from_urdf(tmp_path / "u.urdf", "tip").positions(q)
    close(found, ErrorModel.load(tmp_path / "u.toml").predict(q), 1e-12)
    done(f"simulate {extended} --scheme free --records 100 -o {tmp_path / 'd.csv'}")
    _, err = done(
        f"calibrate {extended} {tmp_path / 'd.csv'} {QUICK} --urdf-out {tmp_path / 'c.urdf'}"
    )
    assert "encoder_eccentricity:3, thermal_expansion" in err


# correct ------------------------------------------------------------

ROUNDED = {"mm": 5.1e-7, "deg": 5.1e-9, "rad": 5.1e-10}
"""Half of the last decimal of a computed column, by its unit."""


def most_decimals(cells: pd.Series) -> int:
    return int(
        cells[cells != ""].map(lambda cell: len(cell.partition(".")[2].partition("e")[0])).max()
    )


def test_corrected_coordinates_are_those_of_the_model(extended, folder, tmp_path):
    source = folder / "warm.csv"
    out, err = done(f"correct {extended} {source} {NOISE} -o {tmp_path / 'c.csv'}")
    assert out == ""
    assert "150 of 150 records" in err
    before, after = (
        pd.read_csv(path, dtype=str, na_filter=False) for path in (source, tmp_path / "c.csv")
    )
    assert list(after.columns) == [*before.columns, *CORRECTED, "u_mm"]
    pd.testing.assert_frame_equal(after[before.columns], before)
    model, read = ErrorModel.load(extended), Measurements.read(source, 6)
    tips = after[CORRECTED].to_numpy(dtype=float)
    close(tips, model.correct(read.q, read.conditions) / MM, ROUNDED["mm"])
    u = accuracy_volume(model, read.q, conditions=read.conditions, encoder_noise=8e-6).u / MM
    close(after["u_mm"].to_numpy(dtype=float), u, ROUNDED["mm"])
    assert after[[*CORRECTED, "u_mm"]].apply(most_decimals).max() == 6
    off = np.linalg.norm(tips - read.reference / MM, axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.03


def test_a_file_of_a_spreadsheet_is_corrected_in_its_dialect(folder, tmp_path):
    text = (folder / "warm.csv").read_text()
    source = tmp_path / "warm.csv"
    source.write_text(text.replace(",", ";").replace(".", ","))
    written, _ = done(f"correct sino6 {source}")
    assert (
        written.replace(",", ".").replace(";", ",") == done(f"correct sino6 {folder}/warm.csv")[0]
    )


def test_corrected_orientations_are_those_of_pinocchio_at_the_true_angles(sino6, tmp_path):
    ErrorModel(sino6, (EncoderEccentricity(5, values=(1e-3, 2e-3)),)).save(tmp_path / "arm.toml")
    q = np.random.default_rng(1).uniform(-1, 1, (6, 6))
    true = q.copy()
    true[:, 4] += np.arcsin(1e-3 * np.cos(q[:, 4]) + 2e-3 * np.sin(q[:, 4]))
    table = readings(q, "rad")
    names = [f"corrected_q{c}" for c in "wxyz"]
    stated = table.assign(x_mm=0, y_mm=0, z_mm=0, qw=1, qx=0, qy=0, qz=0)
    for asked, *words in ((table, "--orientation"), (stated,)):
        asked.to_csv(tmp_path / "r.csv", index=False)
        out, _ = done(f"correct {tmp_path / 'arm.toml'} {tmp_path / 'r.csv'} {NOISE}", words)
        turned = Rotation.from_quat(
            pd.read_csv(io.StringIO(out))[names].to_numpy(), scalar_first=True
        )
        close(turned.as_matrix(), sino6.poses(true).placement[:, :3, :3], 5e-9)
        assert pd.read_csv(io.StringIO(out), dtype=str)[names].apply(most_decimals).max() == 9


def test_a_file_with_references_says_what_correction_is_worth(extended, folder, tmp_path):
    source = folder / "warm.csv"
    _, err = done(f"correct {extended} {source} {NOISE} --nominal sino6 -o {tmp_path / 'c.csv'}")
    model, read = ErrorModel.load(extended), Measurements.read(source, 6)
    for tips in (ErrorModel.load("sino6").correct(read.q), model.correct(read.q, read.conditions)):
        off = np.linalg.norm((tips - read.reference)[read.known], axis=1) / MM
        for size in (np.sqrt(np.mean(off**2)), off.max()):
            assert f"{size:.4f} mm" in err


def test_distances_far_beyond_u_are_a_warning(extended, folder, tmp_path):
    """A zero that has moved by 2 mrad; of the corrected arm itself there is none."""
    table = pd.read_csv(folder / "warm.csv")
    for shift, warned in ((0.0, False), (np.rad2deg(2e-3), True)):
        path = tmp_path / "moved.csv"
        table.assign(theta1_deg=table["theta1_deg"] + shift).to_csv(path, index=False)
        _, err = done(f"correct {extended} {path} {NOISE} -o {tmp_path / 'c.csv'} --force")
        assert ("times its standard uncertainty" in err) == warned


def test_lengths_of_bars_are_compared_too(tmp_path):
    sino6 = ErrorModel.load("sino6")
    q = np.array([[0.3, -1.0, 0.4, 0.5, 0.2, 0.1], [1.0, -1.0, 0.4, 0.5, 0.2, 0.1]])
    length = float(np.linalg.norm(np.diff(sino6.predict(q), axis=0))) / MM
    table = readings(np.repeat(q, 2, axis=0), "rad")
    table = table.assign(
        seat=list("PPQQ"), bar="b", bar_end=list("AABB"), bar_length_mm=length - 0.25
    )
    table.to_csv(tmp_path / "r.csv", index=False)
    _, err = done(f"correct sino6 {tmp_path / 'r.csv'} -o {tmp_path / 'c.csv'}")
    assert "1 bar" in err
    assert err.count("0.2500 mm") == 2  # this arm alone: there is no other to compare with


def test_references_of_targets_beside_the_tip_are_not_compared_with_it(sino6, tmp_path):
    q = np.array(
        [
            [0.3, -1.0, 0.4, 0.5, 0.2, 0.1],
            [1.0, -1.0, 0.4, 0.5, 0.2, 0.1],
            [0.2, -1.1, 0.6, 0.5, 0.2, 0.1],
        ]
    )
    tips = sino6.positions(q) / MM + np.array([[0.1, 0, 0], [42.0, 0, 0], [42.0, 0, 0]])
    table = readings(q, "rad").assign(marker=["", "A", "A"])
    table.assign(**dict(zip(PLACES, tips.T, strict=True))).to_csv(tmp_path / "r.csv", index=False)
    _, err = done(f"correct sino6 {tmp_path / 'r.csv'} -o {tmp_path / 'c.csv'}")
    assert "of the targets A" in err
    assert "0.1000 mm" in err
    assert len(pd.read_csv(tmp_path / "c.csv").dropna(subset="corrected_x_mm")) == 3


def test_commands_bring_the_extended_arm_where_the_nominal_has_its_tip(extended, folder, tmp_path):
    """Each with the uncertainty of the point that it reaches."""
    table = pd.read_csv(folder / "warm.csv").filter(regex="theta|temperature")
    table.loc[0, "theta1_deg"] = -10.0
    table.to_csv(tmp_path / "r.csv", index=False)
    words = f"correct {extended} {tmp_path / 'r.csv'} {NOISE} --commands --nominal sino6"
    done(words, f"-o {tmp_path / 'c.csv'}")
    after, read = pd.read_csv(tmp_path / "c.csv"), Measurements.read(tmp_path / "r.csv", 6)
    names = [f"command{j}_deg" for j in range(1, 7)]
    assert list(after.columns) == [*table.columns, *names, "u_mm", "u_aligned_mm"]
    commands = np.radians(after[names].to_numpy())
    there = np.flatnonzero(np.isfinite(commands).all(axis=1))
    assert 0 not in there  # it is outside the limits
    assert len(there) > 100
    assert (np.abs(commands - read.q)[there].max(axis=0) > 1e-6).any()
    model, conditions = ErrorModel.load(extended), read.conditions.take(there)
    tips = model.predict(commands[there], conditions)
    close(tips, Arm.load("sino6").positions(read.q[there]), 1e-9)
    assert after["u_mm"].notna().to_numpy().nonzero()[0].tolist() == there.tolist()
    accuracy = accuracy_volume(model, commands[there], conditions=conditions, encoder_noise=8e-6)
    close(after["u_mm"][there], accuracy.u / MM, ROUNDED["mm"] + 1e-9)
    close(after["u_aligned_mm"][there], accuracy.u_aligned / MM, ROUNDED["mm"] + 1e-9)
    text = pd.read_csv(tmp_path / "c.csv", dtype=str, na_filter=False)
    assert text[names].apply(most_decimals).max() == 8
    away = readings([[0.0] * 6, [0.1] * 6], "rad")
    away.to_csv(tmp_path / "away.csv", index=False)
    words = f"correct zero6 {tmp_path / 'away.csv'} --commands --nominal sino6"
    refused(words, f"-o {tmp_path / 'none.csv'}", said=["away.csv", "--nominal"])
    assert not (tmp_path / "none.csv").exists()


def test_angles_a_turn_outside_the_limits_are_told(sino6, tmp_path):
    """From -180° to 180° where the arm counts from 0° to 360°: its gain makes another error of
    them.
    """
    arm, data = tmp_path / "gain.toml", tmp_path / "r.csv"
    ErrorModel(sino6, (EncoderGain(3, values=(1e-4,), u=(1e-6,)),)).save(arm)
    q = np.random.default_rng(1).uniform(*sino6.limits.T, (40, 6))
    beyond = q[:, 2] > np.pi
    q[:, 2] -= 2 * np.pi * beyond
    table = readings(q, "rad")
    table.assign(**dict(zip(PLACES, sino6.positions(q).T / MM, strict=True))).to_csv(
        data, index=False
    )
    _, err = done(f"correct {arm} {data} {NOISE} -o {tmp_path / 'c.csv'}")
    assert f"{beyond.sum()} of 40 records" in err
    assert "joint 3" in err


def test_readings_need_nothing_but_angles(tmp_path):
    text = "\ufefftheta1_deg,theta2_deg,theta3_deg,theta4_deg,theta5_deg,theta6_deg,seat,note\r\n"
    text += '10,-20,30,-40,50,60,S1,"a, b"\r\n\r\n1e1,-20.0,30,-40,50,60,S2,\r\n'
    (tmp_path / "r.csv").write_text(text, encoding="utf-8", newline="")
    out, err = done(f"correct sino6 {tmp_path / 'r.csv'}")
    assert "use --encoder-noise" in err
    first, second = out.splitlines()[1:]
    assert first.startswith('10,-20,30,-40,50,60,S1,"a, b",')
    assert second.startswith("1e1,-20.0,30,-40,50,60,S2,,")
    assert first.split(",")[-4:] == second.split(",")[-4:]


def test_without_a_stated_uncertainty_u_is_empty(tmp_path):
    (tmp_path / "r.csv").write_text(
        "theta1_rad,theta2_rad,theta3_rad,theta4_rad,theta5_rad,theta6_rad\n1,1,1,1,1,1\n"
    )
    out, err = done(f"correct zero6 {tmp_path / 'r.csv'}")
    assert out.endswith(",\n")
    assert "zero6 states no uncertainty" in err
    assert not done(f"correct zero6 {tmp_path / 'r.csv'} {NOISE}")[0].endswith(",\n")


def test_readings_that_cannot_be_corrected_are_named(extended, tmp_path):
    path = tmp_path / "r.csv"
    for text, said in (
        (HEADER + "\n1,2,3,4,5,x\n", ["row 2", "theta6_deg", "'x'"]),
        (HEADER + ",u_mm\n1,2,3,4,5,6,7\n", ["u_mm"]),
        (HEADER[:-11] + "\n1,2,3,4,5\n", ["5 joints", "6"]),
        (HEADER + "\n1,2,3,4,5,6\n", ["temperature_c", "thermal_expansion"]),
    ):
        path.write_text(text, encoding="utf-8")
        refused(f"correct {extended} {path} -o {tmp_path / 'c.csv'}", said=["r.csv", *said])
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]


def test_a_reading_outside_an_error_curve_is_left_empty_and_listed(sino6, tmp_path):
    curve = JointErrorCurve(
        3, values=(1e-4, 2e-4, 1e-4, 3e-4, 1e-4), lower_rad=0.1, upper_rad=1.0, coefficients=5
    )
    model = ErrorModel(sino6).with_effects(curve)
    model.save(tmp_path / "arm.toml")
    q = np.tile([0.3, 0.2, 0.5, 0.4, 0.1, 0.2], (5, 1))
    q[:, 2] = 0.2, 0.4, 1.0004, 0.8, 1.0
    assert model.known_at(q).tolist() == [[True], [True], [False], [True], [True]]
    assert ErrorModel(sino6).known_at(q).shape == (5, 0)
    columns = [f"theta{j}_rad" for j in range(1, 7)]
    pd.DataFrame(q, columns=columns).to_csv(tmp_path / "r.csv", index=False)
    words = f"correct {tmp_path / 'arm.toml'}"
    _, err = done(words, f"{tmp_path / 'r.csv'} {NOISE} -o {tmp_path / 'c.csv'}")
    (listed,) = (line for line in err.splitlines() if "row" in line)
    for word in ("r.csv", "row 4", "joint_error_curve:3", "0.1", "1 rad"):
        assert word in listed
    table = pd.read_csv(tmp_path / "c.csv")
    inside = [0, 1, 3, 4]
    close(table[CORRECTED].to_numpy()[inside], model.correct(q[inside]) / MM, ROUNDED["mm"])
    assert (table["u_mm"][inside] > 0).all()
    assert table.loc[2, [*CORRECTED, "u_mm"]].isna().all()
    np.testing.assert_array_equal(table[columns], q)
    pd.DataFrame(q[[2, 2]], columns=columns).to_csv(tmp_path / "none.csv", index=False)
    none = f"{tmp_path / 'none.csv'} -o {tmp_path / 'd.csv'}"
    refused(words, none, said=["none.csv", "rows 2, 3"])
    assert not (tmp_path / "d.csv").exists()


def test_an_arm_with_an_error_curve_is_used_where_that_is_known(sino6, tmp_path):
    """Every command that chooses postures itself: all of them within the range, to the digits of a
    file.
    """
    curve = JointErrorCurve(
        3, values=(1e-4, 2e-4, 1e-4, 3e-4, 1e-4), lower_rad=1.0, upper_rad=4.0, coefficients=5
    )
    arm = tmp_path / "arm.toml"
    ErrorModel(sino6).with_effects(curve).save(arm)
    at = "--point 600 0 300"
    for words, column in (
        (f"accuracy {arm} {at}", "theta3_deg"),
        (f"simulate {arm} --scheme free --records 20", "theta3_deg"),
        (f"plan calibration {arm} --records 6 --postures 100", "theta3_deg"),
        (f"plan acceptance {arm} --standard asme-b89.4.22", "planned_theta3_deg"),
    ):
        output = tmp_path / f"{len(list(tmp_path.iterdir()))}.csv"
        _, err = done(words, f"-o {output}")
        assert "229.2°" in err
        angle = np.radians(pd.read_csv(output)[column])
        assert angle.between(1.0 - 1e-3, 4.0 + 1e-3).all()
        assert angle.max() - angle.min() > 1.0
    nowhere = replace(curve, lower_rad=-2.0, upper_rad=-1.0)
    ErrorModel(sino6).with_effects(nowhere).save(arm, force=True)
    refused(
        f"accuracy {arm} {at}",
        said=["no angle within the limits of joint 3", "joint_error_curve:3"],
    )


def test_records_of_another_arm_are_asked_about(folder, tmp_path):
    for arm, asked in (("zero6", True), ("sino6", False)):
        _, err = done(f"correct {arm} {folder / 'data.csv'} -o {tmp_path / f'{arm}.csv'}")
        assert ("--reference-frame external" in err) == asked
