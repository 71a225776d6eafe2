"""The Pinocchio arm: sensitivities against models made anew and finite differences, what it knows
of itself, errors.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.file import ArmFile, load_arm_file
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError, UnsupportedArmError
from tests.by_pinocchio import dh_sensitivity, gravity_moments

H = 1e-6  # step of central differences
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
def one_joint(tmp_path: Path) -> Callable[..., Path]:
    def write(kind: str = "revolute", joint: str = "hinge") -> Path:
        (tmp_path / "one.urdf").write_text(
            ONE_JOINT.format(kind=kind, joint=joint), encoding="utf-8"
        )
        return tmp_path / "one.urdf"

    return write


@pytest.fixture(scope="module")
def robots(robot_file: Callable[[str], Path]) -> list[Arm]:
    """Arms that come as URDF alone; Panda's fingers lie beyond its hand."""
    files = [("ur5_robot.urdf", "ee_link"), ("panda.urdf", "panda_hand")]
    return [
        Arm.from_urdf(robot_file(f), at, translation_half_width=1e-4, rotation_half_width=2e-4)
        for f, at in files
    ]


def within_limits(arm: Arm, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(*arm.limits.T, (n, arm.nq))


def close(found: Array, expected: Array, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


# --- sensitivities


def test_sensitivity_jacobian_and_position_are_pinocchios(
    arm_file: ArmFile, rng: np.random.Generator
) -> None:
    arm = Arm.from_file(arm_file)
    q = within_limits(arm, rng, 10)
    by_pinocchio = dh_sensitivity(
        arm, q, ["tip", *(f"frame{row}" for row in range(1, len(arm_file.joints) + 1))]
    )
    for at, expected in by_pinocchio.items():
        poses = arm.poses(q, at)
        close(arm.sensitivity(q, at), expected)
        close(arm.jacobian(q, at), poses.jacobian[:, :3])
        close(arm.positions(q, at), poses.position)


def test_frames_that_the_table_does_not_know(sino6: Arm, rng: np.random.Generator) -> None:
    """A link frame has a place and a Jacobian; the DH values' effect on it is not known, so nothing
    is made up.
    """
    q = within_limits(sino6, rng, 1)
    close(sino6.positions(q, "link3"), sino6.positions(q, "frame2"))
    assert sino6.jacobian(q, "link3").shape == (1, 3, 6)
    for refused in (
        lambda: sino6.sensitivity(q, "link3"),
        lambda: sino6.perturbed_positions(q, np.zeros((2, 24)), "link3"),
    ):
        with pytest.raises(UnsupportedArmError, match="'link3' is not one of the DH table"):
            refused()


def test_placement_sensitivity_is_the_derivative(
    robots: list[Arm], rng: np.random.Generator
) -> None:
    for robot in robots:
        p = len(robot.parameters)
        assert p == 6 * robot.nq
        for q in within_limits(robot, rng, 5)[:, None]:
            plus, minus = (robot.perturbed_positions(q, step * np.eye(p)) for step in (H, -H))
            close(robot.sensitivity(q)[0], ((plus - minus) / (2 * H)).T, 1e-9)
            close(robot.perturbed_positions(q, np.zeros((1, p))), robot.positions(q), 1e-14)


def test_jacobian_of_urdf_arms_is_the_derivative(one_joint: Callable[..., Path]) -> None:
    for kind in ("revolute", "prismatic"):
        arm, q = Arm.from_urdf(one_joint(kind), "tool"), np.array([[0.7]])
        close(
            arm.jacobian(q)[:, :, 0], (arm.positions(q + H) - arm.positions(q - H)) / (2 * H), 1e-9
        )
        np.testing.assert_array_equal(arm.limits, [[-1, 2]])


def test_each_draw_may_have_its_own_configuration(
    sino6: Arm, robots: list[Arm], rng: np.random.Generator
) -> None:
    for arm in (sino6, *robots):
        q, errors = within_limits(arm, rng, 4), rng.normal(0, 0.01, (4, len(arm.parameters)))
        one_by_one = [arm.perturbed_positions(q[k : k + 1], errors[k : k + 1])[0] for k in range(4)]
        close(arm.perturbed_positions(q, errors), np.array(one_by_one), 1e-14)


def test_perturbed_positions_are_those_of_rebuilt_arms(
    arm_file: ArmFile, rng: np.random.Generator
) -> None:
    arm, draws = Arm.from_file(arm_file), 5
    q = within_limits(arm, rng, 1)
    errors = rng.normal(0, 0.01, (draws, len(arm.parameters)))
    keys, scale = ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"), np.array([MM, MM, 1, 1])
    for k, error in enumerate(errors.reshape(draws, -1, 4) / scale):
        rows = [
            row.model_copy(
                update={key: getattr(row, key) + e for key, e in zip(keys, change, strict=True)}
            )
            for row, change in zip(arm_file.joints, error, strict=True)
        ]
        rebuilt = Arm.from_file(arm_file.model_copy(update={"joints": rows}))
        for at in ("tip", "frame5"):
            close(arm.perturbed_positions(q, errors[k : k + 1], at), rebuilt.poses(q, at).position)


# --- masses


@pytest.mark.parametrize("convention", ["standard-dh", "modified-dh"])
def test_masses_of_the_chain_give_pinocchios_gravity(
    convention: str, rng: np.random.Generator
) -> None:
    """Moments of the weights beyond each joint, by centres of mass of the file on the chain; about
    the axes the generalized gravity of Pinocchio.
    """
    file = load_arm_file("sino6")
    bare = file.joints[-1].model_copy(update={"mass_kg": None, "com_mm": None})
    wall = {"convention": convention, "gravity_m_s2": (3.0, -9.0, 1.0)}
    for rows in (file.joints, [*file.joints[:-1], bare]):
        arm = Arm.from_file(file.model_copy(update=wall | {"joints": rows}))
        q = within_limits(arm, rng, 20)
        rotation, origin = arm.chain.walk(q)
        assert arm.masses is not None
        bodies = [2 * row for row in range(1, 7)]  # the axes of the chain
        centres = np.einsum("rnij,rj->rni", rotation[bodies], arm.centres_of_mass) + origin[bodies]
        forces = np.outer(arm.masses, arm.gravity)
        data = arm.model.createData()
        by_pinocchio = np.array(
            [-pin.computeGeneralizedGravity(arm.model, data, each) for each in q]
        )
        moments = gravity_moments(arm, q)
        for joint, place in enumerate(arm.chain.moving_axes()):
            moment = np.cross(centres[joint:] - origin[place], forces[joint:, None]).sum(axis=0)
            axis = rotation[place][:, :, 2]
            close(np.einsum("ni,ni->n", moment, axis), by_pinocchio[:, joint])
            close(np.einsum("ni,ni->n", moments[:, joint], axis), by_pinocchio[:, joint])


# --- what the arm knows of itself


def test_bundled_arm_in_si(sino6: Arm, zero6: Arm) -> None:
    assert (sino6.name, sino6.nq, sino6.tip, len(sino6.parameters)) == ("SINO6", 6, "tip", 24)
    close(sino6.stylus_axis, [1, 0, 0])
    close(sino6.up, [0, 0, 1])
    assert zero6.masses is None
    arm = load_arm_file("sino6")
    assert arm.stylus is not None
    longer = arm.model_copy(
        update={"stylus": arm.stylus.model_copy(update={"axis": (3.0, 0.0, 4.0)})}
    )
    close(Arm.from_file(longer).stylus_axis, [0.6, 0, 0.8])


def test_frames_and_parameters_of_urdf_arms(robots: list[Arm]) -> None:
    assert [robot.nq for robot in robots] == [6, 7]
    for robot in robots:
        assert [p.name for p in robot.parameters[:7]] == [
            "x1",
            "y1",
            "z1",
            "rx1",
            "ry1",
            "rz1",
            "x2",
        ]
        assert [p.half_width for p in robot.parameters[:6]] == [1e-4] * 3 + [2e-4] * 3
        q = robot.limits.mean(axis=1)[None, :]
        np.testing.assert_array_equal(robot.positions(q), robot.positions(q, robot.tip))
        with pytest.raises(
            UnsupportedArmError,
            match="posture search needs a DH table; this arm came as URDF alone",
        ):
            robot.require_dh("posture search")


def test_shared_name_means_the_link(one_joint: Callable[..., Path]) -> None:
    """URDF lets a link and a joint have one name; the tip is then the link."""
    close(
        Arm.from_urdf(one_joint(joint="tool"), "tool").positions(np.zeros((1, 1))),
        [[0.5, 0, 1]],
        1e-15,
    )


# --- values do not change behind one's back


def test_values_are_copies(
    sino6: Arm, robots: list[Arm], one_joint: Callable[..., Path], rng: np.random.Generator
) -> None:
    q = within_limits(sino6, rng, 3)
    given = q.copy()
    poses = sino6.poses(given)
    given[:] = 0.0
    for name in ("placement", "position", "jacobian", "placement_sensitivity"):
        one_by_one = [getattr(sino6.poses(q[k : k + 1]), name)[0] for k in range(3)]
        np.testing.assert_array_equal(getattr(poses, name), one_by_one)
    sino6.gravity[:] = sino6.up[:] = 0.0
    close(sino6.gravity, [0, 0, -9.81])
    close(sino6.up, [0, 0, 1])
    middle = robots[0].limits.mean(axis=1)[None, :]
    before = robots[0].positions(middle)
    robots[0].perturbed_positions(middle, np.full((1, len(robots[0].parameters)), 0.1))
    np.testing.assert_array_equal(robots[0].positions(middle), before)
    model = pin.buildModelFromUrdf(str(one_joint()))
    arm = Arm.from_model(model, "tool")
    model.jointPlacements[1] = pin.SE3.Identity()
    close(arm.positions(np.zeros((1, 1))), [[0.5, 0, 1]], 1e-15)


# --- errors


def test_unusable_input_is_refused(sino6: Arm, robots: list[Arm]) -> None:
    for method in METHODS:
        with pytest.raises(
            UnknownNameError, match=r"unknown frame 'frame9'; known: .*frame6.*tip"
        ) as caught:
            getattr(sino6, method)(np.zeros((1, 6)), "frame9")
        assert "frame5" in caught.value.known
    for arm in (sino6, robots[1]):
        p, q = len(arm.parameters), np.zeros((1, arm.nq))
        for method in METHODS:
            with pytest.raises(ShapeError, match=r"q\[None, :\]"):
                getattr(arm, method)(np.zeros(arm.nq))
            with pytest.raises(ShapeError, match=r"q\[0, 0\] is nan"):
                getattr(arm, method)(np.full((1, arm.nq), np.nan))
            for degrees in (np.full(arm.nq, -90.0), np.eye(arm.nq)[0] * 90.0):
                with pytest.raises(
                    ShapeError, match=r"q\[0, 0\] is -?90 rad, more than 5 turns: .*degrees"
                ):
                    getattr(arm, method)(degrees[None])
        for errors, said in (
            (np.zeros(p), rf"\({p},\).*errors\[None, :\]"),
            (np.full((1, p), np.nan), r"errors\[0, 0\] is"),
        ):
            with pytest.raises(ShapeError, match=said):
                arm.perturbed_positions(q, errors)
        with pytest.raises(
            ShapeError, match="q has 2 rows, expected 1 or as many as errors has, 1"
        ):
            arm.perturbed_positions(np.zeros((2, arm.nq)), np.zeros((1, p)))


def test_an_endless_joint_counts_many_turns(sino6: Arm) -> None:
    """Most joints tell degrees from radians: one that was turned round and round does not."""
    q = np.array([[0.5, -1.0, 2.0, -1.5, 1.0, 0.3]])
    turned = q + 20 * np.pi * np.array([0, 0, 1, 0, 0, 1])
    np.testing.assert_allclose(sino6.positions(turned), sino6.positions(q), rtol=0, atol=1e-12)


def test_unusable_urdf_is_refused(one_joint: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(UnsupportedArmError, match="one: joint hinge takes more than one number"):
        Arm.from_urdf(one_joint("planar"), "tool")
    model = pin.buildModelFromUrdf(str(one_joint("continuous")))
    with pytest.raises(
        UnsupportedArmError, match="joint hinge takes more than one number; write it as revolute"
    ):
        Arm.from_model(model, "tool")
    with pytest.raises(UnsupportedArmError, match="one: no joint moves frame 'base'"):
        Arm.from_urdf(one_joint(), "base")
    with pytest.raises(UnknownNameError, match=r"unknown frame 'nose'; known: .*body.*tool"):
        Arm.from_urdf(one_joint(), "nose")
    for key in ("translation_half_width", "rotation_half_width"):
        for value in (-1.0, np.nan, np.inf, 5e2):
            with pytest.raises(AacmmError, match=rf"{key} is {value:g} (m|rad), expected 0 to"):
                Arm.from_urdf(one_joint(), "tool", **{key: value})
    with pytest.raises(AacmmError, match=r"none\.urdf: no such file"):
        Arm.from_urdf(tmp_path / "none.urdf", "tool")
    klingon = b'<?xml version="1.0" encoding="klingon"?><robot name="odd"/>'
    for content in (
        b"",
        b"hello",
        b"<robot",
        b"<html/>",
        b'<robot name="empty"/>',
        b"\xff\xfe\x00",
        klingon,
    ):
        (tmp_path / "bad.urdf").write_bytes(content)
        with pytest.raises(AacmmError, match=r"bad\.urdf: (line 1: )?(not a URDF|html|robot)"):
            Arm.from_urdf(tmp_path / "bad.urdf", "tool")
