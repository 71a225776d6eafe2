"""The Pinocchio arm: its sensitivities against the closed form and finite differences, its statics, its errors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import table
from aacmm_pin.arm.file import ArmFile, load_arm_file
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError, UnsupportedArmError

H = 1e-6  # step of central differences

ONE_JOINT = """\
<robot name="one">
  <link name="base"/> <link name="body"/> <link name="tool"/>
  <joint name="{joint}" type="{kind}">
    <parent link="base"/> <child link="body"/> <axis xyz="0 0 1"/> <origin xyz="0 0 1" rpy="0.3 0 0"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="tool_fixed" type="fixed"> <parent link="body"/> <child link="tool"/> <origin xyz="0.5 0 0"/> </joint>
</robot>
"""


@pytest.fixture
def arm(arm_file: ArmFile) -> Arm:
    return Arm.from_file(arm_file)


@pytest.fixture
def one_joint(tmp_path: Path) -> Callable[..., Path]:
    def write(kind: str, joint: str = "hinge") -> Path:
        (tmp_path / "one.urdf").write_text(ONE_JOINT.format(kind=kind, joint=joint), encoding="utf-8")
        return tmp_path / "one.urdf"

    return write


@pytest.fixture(params=[("ur5_robot.urdf", "ee_link", 6), ("panda.urdf", "panda_hand", 7)], ids=["ur5", "panda"])
def robot(request: pytest.FixtureRequest, robot_file: Callable[[str], Path]) -> Arm:
    """Arms that come as URDF alone; Panda's fingers lie beyond its hand."""
    file, frame, nq = request.param
    robot = Arm.from_urdf(robot_file(file), frame, translation_half_width=1e-4, rotation_half_width=2e-4)
    assert robot.nq == nq
    return robot


def within_limits(arm: Arm, rng: np.random.Generator, n: int) -> Array:
    return rng.uniform(*arm.limits.T, (n, arm.nq))


# --- sensitivities


def test_two_ways_to_the_sensitivity_agree(arm: Arm, rng: np.random.Generator) -> None:
    q = within_limits(arm, rng, 50)
    for at in ["tip", *(f"frame{row}" for row in range(1, arm.require_dh("this test").rows + 1))]:
        by_pinocchio = arm.poses(q, at).dh_sensitivity()
        np.testing.assert_allclose(by_pinocchio, arm.sensitivity(q, at), rtol=0, atol=1e-12)


def test_two_ways_to_jacobian_and_position_agree(arm: Arm, rng: np.random.Generator) -> None:
    q = within_limits(arm, rng, 50)
    for at in (None, "tip", "frame5", "frame1"):
        poses = arm.poses(q, at)
        np.testing.assert_allclose(poses.jacobian[:, :3], arm.jacobian(q, at), rtol=0, atol=1e-12)
        np.testing.assert_allclose(poses.position, arm.positions(q, at), rtol=0, atol=1e-12)


def test_frames_that_the_table_does_not_know(sino6: Arm, rng: np.random.Generator) -> None:
    """A link frame has a place and a Jacobian; the DH values' effect on it is not known, so nothing is made up."""
    q = within_limits(sino6, rng, 1)
    np.testing.assert_allclose(sino6.positions(q, "link3"), sino6.positions(q, "frame2"), rtol=0, atol=1e-12)
    assert sino6.jacobian(q, "link3").shape == (1, 3, 6)
    with pytest.raises(UnsupportedArmError, match="'link3' is not one of the DH table"):
        sino6.poses(q, "link3").dh_sensitivity()
    with pytest.raises(UnsupportedArmError, match="link3"):
        sino6.sensitivity(q, "link3")
    with pytest.raises(UnsupportedArmError, match="link3"):
        sino6.perturbed_positions(q, np.zeros((2, 24)), "link3")


def test_placement_sensitivity_is_the_derivative(robot: Arm, rng: np.random.Generator) -> None:
    p = len(robot.parameters)
    assert p == 6 * robot.nq
    for q in within_limits(robot, rng, 10)[:, None]:
        plus, minus = (robot.perturbed_positions(q, step * np.eye(p)) for step in (H, -H))
        by_differences = ((plus - minus) / (2 * H)).T
        np.testing.assert_allclose(robot.sensitivity(q)[0], by_differences, rtol=0, atol=1e-9)
        np.testing.assert_allclose(robot.perturbed_positions(q, np.zeros((1, p))), robot.positions(q), rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_jacobian_of_urdf_arms_is_the_derivative(one_joint: Callable[..., Path], kind: str) -> None:
    arm, q = Arm.from_urdf(one_joint(kind), "tool"), np.array([[0.7]])
    by_differences = (arm.positions(q + H) - arm.positions(q - H)) / (2 * H)
    np.testing.assert_allclose(arm.jacobian(q)[:, :, 0], by_differences, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(arm.limits, [[-1, 2]])


def test_each_draw_may_have_its_own_configuration(sino6: Arm, robot: Arm, rng: np.random.Generator) -> None:
    for arm in (sino6, robot):
        q, errors = within_limits(arm, rng, 4), rng.normal(0, 0.01, (4, len(arm.parameters)))
        one_by_one = [arm.perturbed_positions(q[k : k + 1], errors[k : k + 1])[0] for k in range(4)]
        np.testing.assert_allclose(arm.perturbed_positions(q, errors), one_by_one, rtol=0, atol=1e-14)


def test_perturbed_positions_are_those_of_rebuilt_arms(arm_file: ArmFile, rng: np.random.Generator) -> None:
    arm, draws = Arm.from_file(arm_file), 5
    q = within_limits(arm, rng, 1)
    errors = rng.normal(0, 0.01, (draws, len(arm.parameters)))
    keys, scale = ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad"), np.array([MM, MM, 1, 1])
    for at in ("tip", "frame5"):
        found = arm.perturbed_positions(q, errors, at)
        for k, error in enumerate(errors.reshape(draws, -1, 4) / scale):
            rows = [
                row.model_copy(update={key: getattr(row, key) + e for key, e in zip(keys, change, strict=True)})
                for row, change in zip(arm_file.joints, error, strict=True)
            ]
            rebuilt = Arm.from_file(arm_file.model_copy(update={"joints": rows}))
            np.testing.assert_allclose(found[k : k + 1], rebuilt.poses(q, at).position, rtol=0, atol=1e-12)


# --- statics


@pytest.fixture(
    params=[("standard-dh", (0.0, 0.0, -9.81)), ("standard-dh", (3.0, -9.0, 1.0)), ("modified-dh", (3.0, -9.0, 1.0))],
    ids=["table", "wall", "modified"],
)
def heavy(request: pytest.FixtureRequest) -> ArmFile:
    convention, gravity = request.param
    return load_arm_file("sino6").model_copy(update={"convention": convention, "gravity_m_s2": gravity})


def weights(arm: ArmFile, q: Array) -> tuple[Array, Array]:
    """Centres of mass (n, rows, 3) [m] and weights (rows, 3) [N] of the bodies, by the DH table alone."""
    centres = np.array([[*(c * MM for c in row.com_mm or (0, 0, 0)), 1.0] for row in arm.joints])
    masses = np.array([row.mass_kg for row in arm.joints])
    return np.einsum("nrij,rj->nri", arm.dh.placements(q)[:, 1:, :3], centres), np.outer(masses, arm.gravity_m_s2)


def joint_axes(arm: ArmFile, q: Array) -> tuple[Array, Array]:
    """Axis and a point of every joint, both (n, nq, 3)."""
    frames, d = arm.dh.placements(q), arm.dh.d[:, None]
    if arm.convention == "standard-dh":
        return frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
    return frames[:, 1:, :3, 2], frames[:, 1:, :3, 3] - d * frames[:, 1:, :3, 2]


def test_gravity_moments_are_those_of_the_weights_beyond(heavy: ArmFile, rng: np.random.Generator) -> None:
    arm = Arm.from_file(heavy)
    q = within_limits(arm, rng, 20)
    (centres, forces), (_, origins) = weights(heavy, q), joint_axes(heavy, q)
    expected = np.stack(
        [np.cross(centres[:, j:] - origins[:, j : j + 1], forces[j:]).sum(axis=1) for j in range(arm.nq)], axis=1
    )
    np.testing.assert_allclose(arm.poses(q).gravity_moments, expected, rtol=0, atol=1e-12)


def test_gravity_moments_about_the_axes_are_the_generalized_gravity(heavy: ArmFile, rng: np.random.Generator) -> None:
    arm = Arm.from_file(heavy)
    q = within_limits(arm, rng, 20)
    about_axes = np.einsum("nji,nji->nj", joint_axes(heavy, q)[0], arm.poses(q).gravity_moments)
    data = arm.model.createData()
    by_pinocchio = [-pin.computeGeneralizedGravity(arm.model, data, each) for each in q]
    np.testing.assert_allclose(about_axes, by_pinocchio, rtol=0, atol=1e-12)

    def energy(q: Array) -> Array:
        centres, forces = weights(heavy, q)
        return -np.einsum("nri,ri->n", centres, forces)

    steps = H * np.eye(arm.nq)
    by_energy = [-(energy(q + step) - energy(q - step)) / (2 * H) for step in steps]
    np.testing.assert_allclose(about_axes, np.transpose(by_energy), rtol=0, atol=1e-7)


def test_gravity_moments_need_masses(zero6: Arm) -> None:
    with pytest.raises(UnsupportedArmError, match="zero6: gravity moments need masses; the arm states none"):
        _ = zero6.poses(np.zeros((1, 6))).gravity_moments


def test_a_joint_without_weight_beyond_carries_nothing() -> None:
    arm = load_arm_file("sino6")
    bare = arm.joints[-1].model_copy(update={"mass_kg": None, "com_mm": None})
    moments = (
        Arm.from_file(arm.model_copy(update={"joints": [*arm.joints[:-1], bare]})).poses(np.ones((1, 6))).gravity_moments
    )
    np.testing.assert_array_equal(moments[0, 5], 0.0)
    assert np.abs(moments[0, 1]).max() > 1.0


# --- what the arm knows of itself


def test_bundled_arm_in_si(sino6: Arm) -> None:
    assert (sino6.name, sino6.nq, sino6.tip, len(sino6.parameters)) == ("SINO6", 6, "tip", 24)
    np.testing.assert_allclose(sino6.stylus_axis, [1, 0, 0])
    np.testing.assert_allclose(sino6.gravity, [0, 0, -9.81])
    np.testing.assert_allclose(sino6.up, [0, 0, 1])


def test_stylus_axis_has_unit_length() -> None:
    arm = load_arm_file("sino6")
    assert arm.stylus is not None
    longer = arm.model_copy(update={"stylus": arm.stylus.model_copy(update={"axis": (3.0, 0.0, 4.0)})})
    np.testing.assert_allclose(Arm.from_file(longer).stylus_axis, [0.6, 0, 0.8])


def test_frames_and_parameters_of_urdf_arms(robot: Arm) -> None:
    assert [p.name for p in robot.parameters[:7]] == ["x1", "y1", "z1", "rx1", "ry1", "rz1", "x2"]
    assert [p.half_width for p in robot.parameters[:6]] == [1e-4] * 3 + [2e-4] * 3
    q = robot.limits.mean(axis=1)[None, :]
    np.testing.assert_array_equal(robot.positions(q), robot.positions(q, robot.tip))
    with pytest.raises(UnsupportedArmError, match="posture search needs a DH table; this arm came as URDF alone"):
        robot.require_dh("posture search")
    with pytest.raises(UnsupportedArmError, match="DH table"):
        robot.poses(q).dh_sensitivity()


def test_shared_name_means_the_link(one_joint: Callable[..., Path]) -> None:
    """URDF lets a link and a joint have one name; the tip is then the link."""
    arm = Arm.from_urdf(one_joint("revolute", joint="tool"), "tool")
    np.testing.assert_allclose(arm.positions(np.zeros((1, 1))), [[0.5, 0, 1]], atol=1e-15)


# --- values do not change behind one's back


def test_poses_are_independent_of_pinocchio_and_of_the_caller(sino6: Arm, rng: np.random.Generator) -> None:
    q = within_limits(sino6, rng, 3)
    given = q.copy()
    poses = sino6.poses(given)
    given[:] = 0.0
    for name in ("placement", "position", "jacobian", "placement_sensitivity", "gravity_moments"):
        one_by_one = [getattr(sino6.poses(q[k : k + 1]), name)[0] for k in range(3)]
        np.testing.assert_array_equal(getattr(poses, name), one_by_one)


def test_gravity_is_a_copy(sino6: Arm) -> None:
    sino6.gravity[:] = 0.0
    sino6.up[:] = 0.0
    np.testing.assert_array_equal(sino6.gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(sino6.up, [0, 0, 1])


def test_perturbing_leaves_the_model_as_it_was(robot: Arm) -> None:
    q = robot.limits.mean(axis=1)[None, :]
    before = robot.positions(q)
    robot.perturbed_positions(q, np.full((1, len(robot.parameters)), 0.1))
    np.testing.assert_array_equal(robot.positions(q), before)


def test_the_arm_keeps_its_own_model(one_joint: Callable[..., Path]) -> None:
    model = pin.buildModelFromUrdf(str(one_joint("revolute")))
    arm = Arm.from_model(model, "tool")
    model.jointPlacements[1] = pin.SE3.Identity()
    np.testing.assert_allclose(arm.positions(np.zeros((1, 1))), [[0.5, 0, 1]], atol=1e-15)


# --- errors


@pytest.mark.parametrize("method", ["poses", "positions", "sensitivity", "jacobian"])
def test_unknown_frame_lists_the_names(sino6: Arm, method: str) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown frame 'frame9'; known: .*frame6.*tip") as caught:
        getattr(sino6, method)(np.zeros((1, 6)), "frame9")
    assert "frame5" in caught.value.known


@pytest.mark.parametrize("method", ["poses", "positions", "sensitivity", "jacobian"])
def test_unusable_q_is_refused(sino6: Arm, robot: Arm, method: str) -> None:
    for arm in (sino6, robot):
        with pytest.raises(ShapeError, match=r"q\[None, :\]"):
            getattr(arm, method)(np.zeros(arm.nq))
        with pytest.raises(ShapeError, match=r"q\[0, 0\] is nan"):
            getattr(arm, method)(np.full((1, arm.nq), np.nan))


def test_unusable_errors_are_refused(sino6: Arm, robot: Arm) -> None:
    for arm in (sino6, robot):
        p, q = len(arm.parameters), np.zeros((1, arm.nq))
        with pytest.raises(ShapeError, match=rf"errors has shape \({p},\).*errors\[None, :\]"):
            arm.perturbed_positions(q, np.zeros(p))
        with pytest.raises(ShapeError, match=r"errors\[0, 0\] is nan"):
            arm.perturbed_positions(q, np.full((1, p), np.nan))
        with pytest.raises(ShapeError, match="q has 2 rows, expected 1 or as many as errors has, 1"):
            arm.perturbed_positions(np.zeros((2, arm.nq)), np.zeros((1, p)))


def test_joints_of_several_numbers_are_refused(one_joint: Callable[..., Path]) -> None:
    with pytest.raises(UnsupportedArmError, match="one: joint hinge takes more than one number"):
        Arm.from_urdf(one_joint("planar"), "tool")
    model = pin.buildModelFromUrdf(str(one_joint("continuous")))
    with pytest.raises(UnsupportedArmError, match="one: joint hinge takes more than one number; write it as revolute"):
        Arm.from_model(model, "tool")


def test_frame_that_no_joint_moves_is_refused(one_joint: Callable[..., Path]) -> None:
    with pytest.raises(UnsupportedArmError, match="one: no joint moves frame 'base'"):
        Arm.from_urdf(one_joint("revolute"), "base")


def test_unknown_urdf_frame_lists_the_names(one_joint: Callable[..., Path]) -> None:
    with pytest.raises(UnknownNameError, match=r"unknown frame 'nose'; known: .*body.*tool"):
        Arm.from_urdf(one_joint("revolute"), "nose")


@pytest.mark.parametrize("key", ["translation_half_width", "rotation_half_width"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_unusable_half_width_is_refused(one_joint: Callable[..., Path], key: str, value: float) -> None:
    with pytest.raises(AacmmError, match=rf"half-width is {value}, expected a number that is not negative"):
        Arm.from_urdf(one_joint("revolute"), "tool", **{key: value})


def test_missing_urdf_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(AacmmError, match=r"none\.urdf: no such file"):
        Arm.from_urdf(tmp_path / "none.urdf", "tool")


@pytest.mark.parametrize("content", [b"", b"hello", b"<robot", b"<html/>", b'<robot name="empty"/>', b"\xff\xfe\x00"])
def test_not_a_urdf_is_said(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.urdf").write_bytes(content)
    with pytest.raises(AacmmError, match=r"bad\.urdf: not a URDF"):
        Arm.from_urdf(tmp_path / "bad.urdf", "tool")


def test_table_of_the_arm_is_that_of_the_file(arm_file: ArmFile, arm: Arm) -> None:
    dh = arm.require_dh("this test")
    np.testing.assert_array_equal(dh.values(), arm_file.dh.values())
    values = [p.value for p in arm.parameters]
    rebuilt = table(np.reshape(values, (-1, 4)), dh.convention, list(dh.moving))
    np.testing.assert_array_equal(rebuilt.values(), dh.values())
