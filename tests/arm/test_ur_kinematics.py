"""Robots of Universal Robots by their own calibration: the tool is where a product of the matrices
of the controller's Denavit–Hartenberg table has it.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import UR_ROBOTS, Arm, Covariance, UrKinematics, axis
from aacmm_pin.effects import ErrorModel, JointPeriodicError, StylusOffset
from aacmm_pin.errors import ArmFileError, UnknownNameError, UnsupportedArmError
from tests.cli import shell
from tests.oracle import close, dh_frames

# A calibrated UR5, of which d runs away along the parallel axes.
UR5 = {
    "theta": [
        -9.62699668632896e-06,
        -1.43707039992005,
        2.02543119975016,
        -0.588254688694989,
        4.13647390228702e-05,
        8.1737464953645e-06,
    ],
    "a": [
        0.000279332356195598,
        -0.0566854832098269,
        -0.32646702272051,
        1.49388687216263e-05,
        2.23692592990586e-07,
        0.0,
    ],
    "d": [
        0.0888794492754001,
        574.241384579456,
        -507.363402098168,
        -66.7676839353205,
        0.0949734691141216,
        0.0825625014554953,
    ],
    "alpha": [
        1.57033858830411,
        -0.000733893428160216,
        0.00325607356326439,
        1.57040005185553,
        -1.57101000328584,
        0.0,
    ],
}
NOMINAL = {
    "theta": np.zeros(6),
    "a": np.array([0.0, -0.425, -0.39225, 0.0, 0.0, 0.0]),
    "d": np.array([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823]),
    "alpha": np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0]),
}


@pytest.fixture
def controller(tmp_path):
    """The file of a controller: differences from the maker's table."""
    path = tmp_path / "calibration.conf"
    lines = ["[mounting]", "calibration_status = 2", "joint_checksum = [ 0x1, 0x2 ]"]
    for name, values in UR5.items():
        deltas = np.subtract(values, NOMINAL[name]).tolist()
        lines.append(f"delta_{name} = [ {', '.join(f'{value!r}' for value in deltas)} ]")
    path.write_text("\n".join(lines) + "\n")
    return path


def tools(q: Array) -> Array:
    """The tool of the calibrated UR5 (n, 4, 4)."""
    return dh_frames(np.transpose([UR5[key] for key in ("a", "d", "alpha", "theta")]), q)


def test_the_tool_is_where_the_controller_has_it(controller, tmp_path):
    path = tmp_path / "ur5.urdf"
    path.write_text(UrKinematics.read(controller, "ur5").urdf())
    arm = Arm.from_urdf(path, "tool0")
    postures = np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6))
    wanted = tools(postures)
    close(arm.positions(postures), wanted[:, :3, 3], 1e-11)
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    for q, place in zip(postures, wanted, strict=True):
        pin.framesForwardKinematics(model, data, q)
        placement = data.oMf[model.getFrameId("tool0")]
        close(placement.homogeneous, place, 1e-11)
    assert max(np.abs(p.translation).max() for p in arm.model.jointPlacements) < 1.0


def test_a_kinematics_file_there_and_back(controller, tmp_path):
    """The first links are as the maker's own program writes them."""
    shell.done(f"urdf {controller} --ur-robot ur5 -o {tmp_path / 'ur5.urdf'}")
    arm = Arm.from_urdf(tmp_path / "ur5.urdf", "tool0")
    shell.done(
        f"urdf --urdf {tmp_path / 'ur5.urdf'} --frame tool0 --to-ur -o {tmp_path / 'a.yaml'}"
    )
    content = yaml.safe_load((tmp_path / "a.yaml").read_text())["kinematics"]
    first, second = (np.array([*content[link].values()]) for link in ("shoulder", "upper_arm"))
    np.testing.assert_allclose(first, [0, 0, 0.08887944927540013, 0, 0, -9.626996686328957e-06])
    np.testing.assert_allclose(
        second, [0.0002793323561955981, 0, 0, 1.570338588304109, 0, 0], atol=1e-15
    )
    content["hash"] = "calib_12345"
    (tmp_path / "b.yaml").write_text(yaml.safe_dump({"kinematics": content}))
    (tmp_path / "b.urdf").write_text(UrKinematics.read(tmp_path / "b.yaml").urdf())
    back = Arm.from_urdf(tmp_path / "b.urdf", "tool0")
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (9, 6))
    close(back.positions(q), arm.positions(q))
    assert yaml.safe_load(UrKinematics.of(back).text())["kinematics"]["hash"] == "calib_12345"


@pytest.mark.parametrize("robot", UR_ROBOTS)
def test_the_maker_s_table(robot, tmp_path):
    """Without differences; stretched upwards, the reach is the sum of the lengths."""
    path = tmp_path / "calibration.conf"
    zeros = "[0, 0, 0, 0, 0, 0]"
    path.write_text("[mounting]\n" + "\n".join(f"delta_{name} = {zeros}" for name in UR5))
    (tmp_path / "robot.urdf").write_text(UrKinematics.read(path, robot).urdf())
    arm = Arm.from_urdf(tmp_path / "robot.urdf", "tool0")
    (a2, a3), (d1, d4, d5, d6) = UR_ROBOTS[robot]
    position = arm.positions(np.zeros((1, 6)))[0]
    np.testing.assert_allclose(position, [a2 + a3, -d4 - d6, d1 - d5], atol=1e-12)


def test_a_file_that_lacks_a_value_is_refused(controller, tmp_path, sino6):
    text = controller.read_text()
    controller.write_text(text.replace("delta_a", "delta_b"))
    with pytest.raises(ArmFileError, match=r"calibration.conf: delta_a: missing"):
        UrKinematics.read(controller, "ur5").urdf()
    with pytest.raises(UnknownNameError, match="ur5e"):
        UrKinematics.read(controller, "ur6").urdf()
    other = tmp_path / "x.yaml"
    for content, message in (
        ("a: 1", "kinematics: missing"),
        ("{", "x.yaml"),
        ("kinematics: {shoulder: 1}", "kinematics.shoulder: 1; expected"),
    ):
        other.write_text(content)
        with pytest.raises(ArmFileError, match=message):
            UrKinematics.read(other).urdf()
    with pytest.raises(UnsupportedArmError, match="shoulder_pan_joint"):
        UrKinematics.of(sino6)


def test_the_base_of_the_ros_description_is_turned(controller, tmp_path):
    """Its links stand on a frame that is turned by half a turn against the base of the arm."""
    alone = UrKinematics.read(controller, "ur5")
    text = alone.urdf()
    turned = (
        '<link name="base_link" /><joint name="b" type="fixed"><parent link="base_link" />'
        '<child link="base_link_inertia" /><origin xyz="0 0 0" rpy="0 0 3.141592653589793" />'
        "</joint>"
    )
    text = text.replace('"base"', '"base_link_inertia"').replace("</robot>", f"{turned}</robot>")
    (tmp_path / "ros.urdf").write_text(text)
    found = UrKinematics.of(Arm.from_urdf(tmp_path / "ros.urdf", "tool0"))
    close(found.placements, alone.placements)


def test_what_cannot_be_written_is_refused_or_stated(controller, tmp_path):
    """Joints about other axes; numbers in degrees; the table of another robot; causes."""
    with pytest.raises(UnsupportedArmError, match="about x or y"):
        UrKinematics.of(Arm.load("ur5"))
    with pytest.raises(ArmFileError, match="check --ur-robot"):
        UrKinematics.read(controller, "ur10e")
    shell.done(f"urdf {controller} --ur-robot UR5 --to-ur -o {tmp_path / 'a.yaml'}")
    path = tmp_path / "b.yaml"
    text = (tmp_path / "a.yaml").read_text()
    path.write_text(text.replace("roll: 1.57", "roll: 91.57"))
    with pytest.raises(ArmFileError, match=r"kinematics.upper_arm.roll: 91.57.*expected 6.28"):
        UrKinematics.read(path)


def test_a_file_of_the_maker_becomes_a_dh_table(controller, tmp_path):
    """Of both files, as by way of their URDF; other commands name the command that reads them."""
    urdf, kinematics = tmp_path / "ur5.urdf", tmp_path / "ur5.yaml"
    shell.done(f"urdf {controller} --ur-robot ur5 -o {urdf}")
    shell.done(f"urdf {controller} --ur-robot ur5 --to-ur -o {kinematics}")
    postures = np.random.default_rng(3).uniform(-np.pi, np.pi, (20, 6))
    for number, words in enumerate((f"{controller} --ur-robot ur5", kinematics)):
        table = tmp_path / f"{number}.toml"
        shell.done(f"urdf {words} --to-dh -o {table}")
        poses = Arm.load(table).poses(postures).placement
        close(poses, tools(postures), 1e-11)
    for words in (
        f"accuracy {kinematics} --point 400 100 300",
        f"accuracy --urdf {kinematics} --frame tool0 --point 400 100 300",
        f"accuracy {controller} --point 400 100 300",
    ):
        shell.refused(words, said=["of Universal Robots", "aacmm-pin urdf"])


def calibrated(urdf: Path, u: dict[str, float]) -> Path:
    """An arm file of a calibration that found these standard uncertainties [m, rad]."""
    arm = Arm.from_urdf(urdf, "tool0", translation_half_width=3e-4, rotation_half_width=1e-3)
    known = Covariance(
        parameters=tuple(u),
        standard_uncertainty_si=tuple(u.values()),
        correlation=tuple((0.0,) * k for k in range(len(u))),
    )
    path = urdf.with_suffix(".toml")
    cause = JointPeriodicError(2, order=2, values=(1e-4, 0.0))
    target = StylusOffset("A", values=(0.1, 0.0, 0.0))
    moved = arm.with_placements(np.zeros((6, 6)), known)
    ErrorModel(moved, (cause, target)).save(path, force=True)
    return path


def test_what_a_kinematics_file_lacks_of_an_arm_is_stated(controller, tmp_path):
    urdf, out = tmp_path / "ur5.urdf", tmp_path / "out.yaml"
    shell.done(f"urdf {controller} --ur-robot ur5 -o {urdf}")
    _, of_urdf = shell.done(f"urdf --urdf {urdf} --frame tool0 --to-ur -o {out}")
    assert "did not determine" not in of_urdf
    for u, undetermined in (
        ({"x6": 1e-5}, "z6, rz6"),
        ({"z6": 1e-5, "rz6": 1e-3 / 3**0.5}, "rz6"),
        ({"z6": 1e-5, "rz6": 2e-5}, ""),
    ):
        arm = calibrated(urdf, u)
        _, said = shell.done(f"urdf {arm} --to-ur -o {out} --force")
        assert ("warning: the calibration did not determine" in said) == bool(undetermined)
        assert f"determine {undetermined}," in said or not undetermined


def test_the_size_of_causes_that_an_export_drops(controller, tmp_path):
    """By the distances of the tip from the axis of joint 2 in random postures."""
    urdf = tmp_path / "ur5.urdf"
    shell.done(f"urdf {controller} --ur-robot ur5 -o {urdf}")
    arm = Arm.from_urdf(urdf, "tool0")
    q = np.random.default_rng(4).uniform(-2 * np.pi, 2 * np.pi, (20_000, 6))
    rotation, origin = (part[axis(2)] for part in arm.chain.walk(q))
    lever = np.cross(arm.positions(q) - origin, rotation[:, :, 2])
    turn = 1e-4 * np.cos(2 * q[:, 1])
    expected = np.sqrt(np.mean(np.square(turn[:, None] * lever).sum(axis=1))) * 1e3
    file = calibrated(urdf, {"z6": 1e-5, "rz6": 2e-5})
    for option in ("", "--to-dh", "--to-ur"):
        _, said = shell.done(f"urdf {file} {option} -o {tmp_path / 'out'} --force")
        size = re.search(r"joint_periodic_error:2.*displace the tip by (\S+) mm", said)
        assert size is not None
        assert float(size[1]) == pytest.approx(expected, rel=0.1)
        assert "calibrate estimated without these causes" in said
