"""Arms that come as URDF at the command line: postures, accuracy, and what a map says of them."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from shell import done, found, refused, run

from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel
from tests.again import again
from tests.oracle import close
from tests.tables import PLACES, THETAS

POINT = "--point 400 100 300"
RPY = (170.0, 20.0, -35.0)
POSE = f"{POINT} --rpy-deg 170 20 -35"
HALF_WIDTHS = "--translation-half-width-mm 0.05 --rotation-half-width 1e-4"


@pytest.fixture
def ur5(robot_file) -> str:
    return f"--urdf {robot_file('ur5_robot.urdf')} --frame tool0"


@pytest.fixture
def panda(robot_file) -> str:
    return f"--urdf {robot_file('panda.urdf')} --frame panda_hand_tcp"


def test_configurations_of_a_pose(ur5):
    """The orientation is pin.rpy's; places by Pinocchio; of a URDF and of an arm file."""
    pose = pin.SE3(
        pin.rpy.rpyToMatrix(*(np.array(RPY) * DEG)), np.array([0.4, 0.1, 0.3])
    ).homogeneous
    for words, arm, said in (
        (ur5, Arm.from_urdf(ur5.split()[1], "tool0"), "single postures"),
        ("sino6 --tip", Arm.load("sino6"), "a full pose"),
    ):
        out, err = done(f"configurations {words} {POSE}")
        assert said in err
        table = pd.read_csv(io.StringIO(out))
        assert list(table) == [
            "component",
            "swivel_deg",
            *THETAS,
            "within_limits",
            "broken_limits",
            *PLACES,
        ]
        assert (table["swivel_deg"].isna() == (arm.dh is None)).all()
        placed = arm.poses(table[THETAS].to_numpy() * DEG).placement
        close(placed, np.tile(pose, (len(table), 1, 1)), 1e-9)
        close(table[PLACES], np.tile([400, 100, 300], (len(table), 1)), 1e-9)


def test_curves_of_a_point_and_an_axis(ur5, tmp_path):
    there = f"{POINT} --axis 0 0.1 -1 --tool-axis 1 0 0"
    done(f"configurations {ur5} {there} --samples 20 -o {tmp_path / 'c.csv'}")
    table = pd.read_csv(tmp_path / "c.csv")
    assert (table.groupby("component").size() == 20).all()
    x = (
        Arm.from_urdf(ur5.split()[1], "tool0")
        .poses(table[THETAS].to_numpy() * DEG)
        .placement[:, :3, 0]
    )
    close(x, np.tile([0, 0.1, -1] / np.sqrt(1.01), (len(x), 1)), 1e-9)


def test_accuracy_of_single_postures_and_of_curves(ur5, panda, tmp_path):
    files = f"-o {tmp_path / 'a.csv'} --plot {tmp_path / 'a.png'}"
    summary = found(f"accuracy {ur5} {POSE} {HALF_WIDTHS} {files}")
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
    out, err = done(f"accuracy {panda} {POSE} {HALF_WIDTHS} --samples 30")
    assert "closed curves" in out
    assert "swivel" not in out
    assert "comprehensive" not in out
    assert "--encoder-noise" in err


@pytest.mark.parametrize("words", ["simulate", "accuracy --point 1 2 3"])
def test_a_robot_without_a_frame_has_its_frames_listed(panda, words):
    urdf = panda.split()[1]
    status, out, err = run(f"{words} --urdf {urdf}", columns=4000)
    assert (status, out) == (2, "")
    count = len(pin.buildModelFromUrdf(urdf).frames)
    assert "panda_hand_tcp" in err
    assert f" … and {count - 20} more" in err


@pytest.fixture(
    params=[
        "ur5_robot.urdf tool0",
        again("panda.urdf panda_hand_tcp"),
    ]
)
def robot(request, robot_file, tmp_path) -> tuple[Path, Path, Path]:
    """An arm file that names a URDF beside it, with moved placements and a cause; records of that
    arm; and the URDF.
    """
    name, frame = request.param.split()
    urdf = Path(shutil.copy(robot_file(name), tmp_path))
    truth, records = tmp_path / "truth.toml", tmp_path / "records.csv"
    cause = "--cause joint_compliance:2,compliance_rad_per_nm=2e-5 --encoder-noise 0"
    drawn = f"{HALF_WIDTHS} --random-geometry {cause}"
    made = f"{drawn} --u-reference-mm 0.001 --scheme free --records 60"
    done(f"simulate --urdf {urdf} --frame {frame} {made} -o {records} --arm-out {truth}")
    return truth, records, urdf


@pytest.mark.parametrize("robot", ["ur5_robot.urdf tool0"], indirect=True)
def test_a_command_that_changes_much_is_told(robot, tmp_path):
    """Where axes 4 and 6 are nearly parallel, small errors ask for large turns of both; that is so
    in rows 2 and 4.
    """
    truth, readings = robot[0], tmp_path / "readings.csv"
    names = [f"theta{j}_rad" for j in range(1, 7)]
    pd.DataFrame([[1, -1, 1, 1, turn, 0] for turn in (0.002, 1, -0.002)], columns=names).to_csv(
        readings, index=False
    )
    _, err = done(f"correct {truth} {readings} --commands -o {tmp_path / 'commands.csv'}")
    warnings = [line for line in err.splitlines() if "near a singular posture" in line]
    assert len(warnings) == 1
    assert "rows 2, 4" in warnings[0]


def test_commands_are_not_for_a_tip_on_a_target(ur5, tmp_path):
    """The URDF has no such tip."""
    arm, readings = tmp_path / "ur5.toml", tmp_path / "readings.csv"
    done(f"simulate {ur5} --scheme free --records 20 -o {readings}")
    done(f"calibrate {ur5} {readings} --target unknown -o {arm}")
    assert "the tip is a target" in refused(f"correct {arm} {readings} --commands")


def test_an_arm_file_of_a_robot_goes_through_every_command(robot, tmp_path):
    truth, records, urdf = robot
    model, measured = ErrorModel.load(truth), pd.read_csv(records)
    thetas = [name for name in measured if name.startswith("theta")]
    q = measured[thetas].to_numpy() * DEG
    corrected, commands = tmp_path / "corrected.csv", tmp_path / "commands.csv"
    _, err = done(f"correct {truth} {records} -o {corrected}")
    assert "60 references" in err
    places = (
        pd.read_csv(corrected)[["corrected_x_mm", "corrected_y_mm", "corrected_z_mm"]].to_numpy()
        * MM
    )
    # In mm with six decimals.
    close(places, model.predict(q), 5.1e-10)
    close(places, measured[PLACES] * MM, 1e-5)
    done(f"correct {truth} {records} --commands -o {commands}")
    sent = pd.read_csv(commands).filter(like="command").to_numpy() * DEG
    arrived = np.isfinite(sent).all(axis=1)
    assert arrived.mean() > 0.9
    wanted = Arm.from_urdf(urdf, model.arm.tip).positions(q)
    close(model.predict(sent[arrived]), wanted[arrived], 1e-9)
    listed = pd.read_csv(io.StringIO(done(f"configurations {truth} {POSE} --samples 6")[0]))
    noise = "--encoder-noise 8e-6 --method ellipsoid"
    assert found(f"accuracy {truth} {POSE} --samples 6 {noise}")["best"]
    done(f"show {truth} {POSE} -o {tmp_path / 'scene.html'}")
    pair = "joint_compliance:2 joint_compliance:3"
    done(f"plan distinguish {truth} --causes {pair} --records 4 --postures 30")
    assert len(listed) >= 6
    dh, again = tmp_path / "dh.toml", tmp_path / "again.urdf"
    for output, option in ((dh, "--to-dh"), (again, "")):
        assert "joint_compliance:2" in done(f"urdf {truth} {option} -o {output}")[1]
    for arm in (Arm.load(dh), Arm.from_urdf(again, model.arm.tip)):
        close(arm.poses(q).placement, model.arm.poses(q).placement, 1e-12)
    refused(f"map {truth}", said=["needs a DH table"])
    touches = measured[thetas].assign(
        test="single-point", feature="P", position=np.arange(60) // 20 + 1
    )
    touches.to_csv(tmp_path / "touches.csv", index=False)
    plain = f"--urdf {urdf} --frame {model.arm.tip}"
    judged = found(f"accept {truth} {plain} {tmp_path / 'touches.csv'}")["figures"]
    for arm, tips in ((truth, places), (urdf, wanted)):
        own = next(figure for figure in judged if figure["coordinates"] == str(arm))
        spread = np.linalg.norm(
            tips - tips.reshape(3, 20, 3).mean(axis=1).repeat(20, axis=0), axis=1
        )
        assert own["value_mm"] == pytest.approx(spread.max() / MM, rel=1e-9, abs=2e-6)
    mpe = f"--mpe {own['figure']}={own['value_mm'] / 2}"
    assert (
        f"diagnose --urdf {urdf} --frame"
        in done(f"accept {plain} {tmp_path / 'touches.csv'} {mpe}")[1]
    )
    refused(f"accept {urdf} {tmp_path / 'touches.csv'}", said=["is a URDF", "--urdf"])
    refused(f"urdf {truth} -o {urdf} --force", said=["this command reads this file"])
    urdf.write_bytes(urdf.read_bytes() + b" ")
    refused(f"correct {truth} {records}", said=["truth.toml: urdf.sha256:", "was changed"])


@pytest.mark.parametrize("robot", ["ur5_robot.urdf tool0"], indirect=True)
def test_a_calibrated_robot_is_a_file(robot, tmp_path):
    truth, records, urdf = robot
    noise = "--encoder-noise 1e-6 --u-reference-mm 0.001"
    arm = f"--urdf {urdf} --frame {ErrorModel.load(truth).arm.tip}"
    words = f"{arm} {records} {HALF_WIDTHS} {noise} --no-cross-validation"
    cal = tmp_path / "cal.toml"
    done(f"calibrate {words} --cause joint_compliance:2 -o {cal}")
    places = pd.read_csv(records)[PLACES] * MM
    q = pd.read_csv(records).filter(like="theta").to_numpy() * DEG
    model = ErrorModel.load(cal)
    assert model.arm.covariance is not None
    assert "joint_compliance:2" in [effect.key for effect in model.effects]
    close(model.predict(q), places, 2e-5)
    assert found(f"accuracy {cal} {POSE} --samples 6")["u_mm"]["max"] < 0.05
    assert "does not contain" in done(f"urdf {cal} --to-dh -o {tmp_path / 'dh.toml'}")[1]
    refused(
        f"calibrate {cal} {records} --urdf-out {urdf} --force",
        said=["this command reads this file"],
    )


def test_an_example_robot_is_its_urdf(ur5):
    by_file, _ = done(f"configurations {ur5} {POSE}")
    by_name, said = done(f"configurations ur5 {POSE}")
    assert by_name == by_file
    assert "tool0" in said
    assert done(f"configurations ur5 --frame tool0 {POSE}")[0] == by_file
