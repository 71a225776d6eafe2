"""The Pinocchio arm: sensitivities against models made anew and finite differences, what it knows
of itself, errors.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError, UnsupportedArmError
from tests.arm_files import changed
from tests.oracle import (
    close,
    derivative,
    dh_sensitivity,
    gravity_torques,
    jacobian_of,
    perturbed_positions,
    postures,
    with_dh_errors,
)

pytestmark = pytest.mark.fast

METHODS = ["poses", "positions", "sensitivity", "jacobian"]

ONE_JOINT = """\
<robot name="one">
  <link name="base"/> <link name="body"/> <link name="tool"/>
  <joint name="{joint}" type="{kind}">
    <parent link="base"/> <child link="body"/>
    <axis xyz="0 0 1"/> <origin xyz="0 0 1" rpy="0.3 0 0"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="tool_fixed" type="fixed">
    <parent link="body"/> <child link="tool"/> <origin xyz="0.5 0 0"/>
  </joint>
</robot>
"""


@pytest.fixture
def one_joint(tmp_path) -> Callable[..., Path]:
    def write(kind: str = "revolute", joint: str = "hinge") -> Path:
        path = tmp_path / "one.urdf"
        path.write_text(ONE_JOINT.format(kind=kind, joint=joint), encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="module")
def robots(robot_file) -> list[Arm]:
    """Arms that come as URDF alone; Panda's fingers lie beyond its hand."""
    files = [("ur5_robot.urdf", "ee_link"), ("panda.urdf", "panda_hand")]
    widths = {"translation_half_width": 1e-4, "rotation_half_width": 2e-4}
    return [Arm.from_urdf(robot_file(file), frame, **widths) for file, frame in files]


# --- sensitivities and errors


def test_sensitivity_jacobian_and_positions_are_pinocchios(arm_file, rng):
    arm = Arm.from_file(arm_file)
    q = postures(arm, rng, 10)
    frames = ["tip", *(f"frame{row}" for row in range(1, len(arm_file.joints) + 1))]
    for at, expected in dh_sensitivity(arm, q, frames).items():
        poses = arm.poses(q, at)
        close(arm.sensitivity(q, at), expected)
        close(arm.jacobian(q, at), jacobian_of(poses)[:, :3])
        close(arm.positions(q, at), poses.position)


def test_sensitivity_of_placements_is_the_derivative(robots, rng):
    for robot in robots:
        for q in postures(robot, rng, 5)[:, None]:
            numeric = derivative(
                lambda errors, robot=robot, q=q: perturbed_positions(robot, q, errors[None])[0],
                np.zeros(6 * robot.nq),
            )
            close(robot.sensitivity(q)[0], numeric, 1e-9)


def test_perturbed_positions_are_those_of_arms_made_anew(arm_file, rng):
    arm, n = Arm.from_file(arm_file), 5
    q, errors = postures(arm, rng, n), rng.normal(0, 0.01, (n, len(arm.parameters)))
    others = [with_dh_errors(arm_file, error) for error in errors]
    for at in ("tip", "frame5"):
        each = [other.poses(q[k : k + 1], at).position[0] for k, other in enumerate(others)]
        close(perturbed_positions(arm, q, errors, at), np.array(each))
        first = [other.poses(q[:1], at).position[0] for other in others]
        close(perturbed_positions(arm, q[:1], errors, at), np.array(first))


@pytest.mark.parametrize("convention", ["standard-dh", "modified-dh"])
def test_masses_and_centres_of_the_chain_give_pinocchios_gravity(convention, rng):
    for bare in ({}, {"mass_kg": None, "com_mm": None}):
        arm = changed("sino6", {6: bare}, convention=convention, gravity_m_s2=(3.0, -9.0, 1.0))
        q = postures(arm, rng, 20)
        rotation, origin = arm.chain.walk(q)
        assert arm.masses is not None
        bodies = [2 * row for row in range(1, 7)]  # the axes of the chain
        centres = np.einsum("rnij,rj->rni", rotation[bodies], arm.centres_of_mass) + origin[bodies]
        forces, expected = np.outer(arm.masses, arm.gravity), gravity_torques(arm, q)
        for joint, place in enumerate(arm.chain.moving_axes()):
            moment = np.cross(centres[joint:] - origin[place], forces[joint:, None]).sum(axis=0)
            torque = np.einsum("ni,ni->n", moment, rotation[place][:, :, 2])
            close(torque, expected[:, joint])


# --- what the arm knows of itself


def test_bundled_arm_in_si(sino6, zero6):
    assert (sino6.name, sino6.nq, sino6.tip, len(sino6.parameters)) == ("SINO6", 6, "tip", 24)
    close(sino6.stylus_axis, [1, 0, 0])
    close(sino6.up, [0, 0, 1])
    assert zero6.masses is None


def test_parameters_of_urdf_arms(robots):
    assert [robot.nq for robot in robots] == [6, 7]
    for robot in robots:
        names = [p.name for p in robot.parameters]
        assert names[:7] == ["x1", "y1", "z1", "rx1", "ry1", "rz1", "x2"]
        assert [p.half_width for p in robot.parameters[:6]] == [1e-4] * 3 + [2e-4] * 3
        with pytest.raises(UnsupportedArmError, match="posture search needs a DH table"):
            robot.require_dh("posture search")


def test_gravity_and_model_are_copies(sino6, one_joint):
    sino6.gravity[:] = sino6.up[:] = 0.0
    close(sino6.gravity, [0, 0, -9.81])
    model = pin.buildModelFromUrdf(str(one_joint()))
    arm = Arm.from_model(model, "tool")
    model.jointPlacements[1] = pin.SE3.Identity()
    close(arm.positions(np.zeros((1, 1))), [[0.5, 0, 1]], 1e-15)


# --- errors


def test_unusable_frames_postures_and_errors_are_refused(sino6, robots):
    for arm in (sino6, robots[1]):
        degrees = np.eye(arm.nq)[:1] * 90.0
        refused: list[tuple[Array, str]] = [
            (np.zeros(arm.nq), r"q\[None, :\]"),
            (np.full((1, arm.nq), np.nan), r"q\[0, 0\] is nan"),
            (degrees, r"q\[0, 0\] is 90 rad, .*more than 5 turns .*degrees"),
        ]
        for method in METHODS:
            with pytest.raises(
                UnknownNameError, match="unknown frame 'frame9'; expected one of "
            ) as caught:
                getattr(arm, method)(np.zeros((1, arm.nq)), "frame9")
            assert arm.tip in caught.value.known
            for q, words in refused:
                with pytest.raises(ShapeError, match=words):
                    getattr(arm, method)(q)


def test_an_endless_joint_counts_many_turns(sino6):
    q = np.array([[0.5, -1.0, 2.0, -1.5, 1.0, 0.3]])
    turned = q + 20 * np.pi * np.array([0, 0, 1, 0, 0, 1])
    close(sino6.positions(turned), sino6.positions(q))


def test_unusable_urdf_is_refused(one_joint):
    with pytest.raises(UnsupportedArmError, match="one: joint hinge"):
        Arm.from_urdf(one_joint("planar"), "tool")
    model = pin.buildModelFromUrdf(str(one_joint("continuous")))
    with pytest.raises(UnsupportedArmError, match="joint hinge"):
        Arm.from_model(model, "tool")
    with pytest.raises(UnsupportedArmError, match=r"one: no joint moves .*'base'"):
        Arm.from_urdf(one_joint(), "base")
    with pytest.raises(
        UnknownNameError, match=r"unknown frame 'nose'; expected one of .*body.*tool"
    ):
        Arm.from_urdf(one_joint(), "nose")
    for key in ("translation_half_width", "rotation_half_width"):
        for value in (-1.0, np.nan, 5e2):
            with pytest.raises(AacmmError, match=rf"{key} is {value:g} (m|rad); expected 0 to"):
                Arm.from_urdf(one_joint(), "tool", **{key: value})
