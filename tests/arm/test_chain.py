"""The walk along the chain against Pinocchio, against DH tables with other values, and against the
matrix exponential.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from aacmm_pin._support.arrays import ROWS_PER_BATCH, Array
from aacmm_pin._support.compiled import ALWAYS, NEVER, VARIABLE
from aacmm_pin.arm import BASE, Arm, axis, end, exp
from aacmm_pin.arm.poses import Poses
from aacmm_pin.errors import UnknownNameError, UnsupportedArmError
from tests.oracle import (
    close,
    jacobian_of,
    perturbed_positions,
    placement_sensitivity,
    postures,
    twist_matrix,
)

pytestmark = pytest.mark.fast

ROBOTS = [  # file, frame, number of joints that slide
    ("ur5_robot.urdf", "tool0", 0),
    ("panda.urdf", "panda_hand", 0),
    ("panda.urdf", "panda_leftfinger", 1),
    ("tiago.urdf", "arm_tool_link", 1),
]


@pytest.fixture(scope="module")
def robots(robot_file) -> list[Arm]:
    arms = [Arm.from_urdf(robot_file(file), frame) for file, frame, _ in ROBOTS]
    assert [arm.chain.prismatic.sum() for arm in arms] == [sliding for *_, sliding in ROBOTS]
    return arms


def frames(arm: Arm, q: Array, twists: dict[int, Array] | None = None) -> Array:
    """All places as (places, n, 4, 4)."""
    rotation, origin = arm.chain.walk(q, twists)
    found = np.zeros((*rotation.shape[:2], 4, 4))
    found[..., :3, :3], found[..., :3, 3], found[..., 3, 3] = rotation, origin, 1.0
    return found


def test_places_of_a_table_are_its_frames(arm_file, rng):
    arm = Arm.from_file(arm_file)
    q = postures(arm, rng, 50)
    walked = frames(arm, q)
    assert len(walked) == arm.chain.places == 2 * len(arm_file.joints) + 3
    assert arm.chain.rows == len(arm_file.joints)
    assert arm.chain.nq == arm.nq
    close(walked[BASE], np.broadcast_to(np.eye(4), (50, 4, 4)))
    close(walked[arm.chain.tip], arm.poses(q).placement)
    for row in range(1, len(arm_file.joints) + 1):
        name = f"frame{row}"
        assert arm.place(name) == (
            end(row) if arm.dh is not None and arm.dh.standard else axis(row)
        )
        close(walked[arm.place(name)], arm.poses(q, name).placement)


def test_axes_of_a_table_are_the_joints(arm_file, rng):
    """In standard DH an axis has all of Pinocchio's joint frame; in modified DH it stands at d
    along it.
    """
    arm = Arm.from_file(arm_file)
    q, data = postures(arm, rng, 20), arm.model.createData()
    walked, moving = frames(arm, q), arm.chain.moving_axes()
    assert [arm.chain.joint[place] for place in moving] == list(range(arm.nq))
    for k, each in enumerate(q):
        pin.forwardKinematics(arm.model, data, each)
        for joint, place in enumerate(moving, start=1):
            step = data.oMi[joint].homogeneous
            if arm.dh is not None and not arm.dh.standard:
                step[:3, 3] += step[:3, 2] * arm.dh.d[place // 2 - 1]
            close(walked[place, k], step)


def test_places_of_a_robot_are_its_joints_and_placements(robots, rng):
    for robot in robots:
        q, data = postures(robot, rng, 10), robot.model.createData()
        walked = frames(robot, q)
        close(walked[robot.chain.tip], robot.poses(q).placement)
        for k, each in enumerate(q):
            # In the base, of the point that passes its origin.
            jacobian = pin.computeJointJacobians(robot.model, data, each)
            for joint, column in enumerate(jacobian.T, start=1):
                placement = data.oMi[joint - 1] * robot.model.jointPlacements[joint]
                close(walked[end(joint - 1), k], placement.homogeneous)
                close(walked[axis(joint), k, :3, 3], data.oMi[joint].translation)
                close(
                    walked[axis(joint), k, :3, 2],
                    column[:3] if robot.chain.prismatic[joint - 1] else column[3:],
                )


def test_a_frame_that_is_no_place(sino6, robots):
    with pytest.raises(UnsupportedArmError, match="DH table"):
        robots[0].place(robots[0].model.frames[1].name)
    for refused in (
        lambda: sino6.place("base_link"),
        lambda: sino6.sensitivity(np.zeros((1, 6)), "link3"),
    ):
        with pytest.raises(UnsupportedArmError, match="is not in the DH table"):
            refused()
    with pytest.raises(UnknownNameError, match="frame9"):
        sino6.place("frame9")


def test_a_twist_acts_behind_its_place_and_on_all_beyond(robots, rng):
    """Any twist, each component alone, a screw along z; a twist for all records is that twist in
    each.
    """
    for robot, components in product(
        robots, ([0, 1, 2, 3, 4, 5], [2, 5], *([k] for k in range(6)))
    ):
        q = postures(robot, rng, 5)
        plain, twist = frames(robot, q), np.zeros((5, 6))
        twist[:, components] = rng.normal(scale=0.3, size=(5, len(components)))
        motion = np.stack([expm(twist_matrix(each)) for each in twist])
        for place in range(robot.chain.places):
            bent = frames(robot, q, {place: twist})
            np.testing.assert_array_equal(bent[:place], plain[:place])
            carried = plain[place] @ motion @ np.linalg.inv(plain[place])
            close(bent[place:], carried @ plain[place:])
            close(
                frames(robot, q, {place: twist[:1]}),
                frames(robot, q, {place: np.tile(twist[:1], (5, 1))}),
            )


def assert_twins_agree(arm: Arm, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loop and NumPy, in batches that do not fill the loop's lanes, and Pinocchio."""
    for n in (0, 1, 150, ROWS_PER_BATCH + 2):
        q, found = postures(arm, rng, n), []
        for way in (NEVER, ALWAYS):
            monkeypatch.setenv(VARIABLE, way)
            sensitivity = arm.chain.position_and_sensitivity(q)
            jacobian = arm.chain.position_and_jacobian(q)
            found.append([arm.chain.positions(q), *sensitivity, *jacobian])
        for plain, looped in zip(*found, strict=True):
            close(looped, plain, 1e-14)
    poses = arm.poses(q[:5])
    close(found[0][0][:5], poses.position, 1e-13)
    close(found[0][4][:5], jacobian_of(poses)[:, :3], 1e-13)
    if arm.dh is None:
        close(found[0][2][:5], placement_sensitivity(arm, q[:5]), 1e-13)


def test_compiled_loop_and_numpy_agree_for_tables(arm_file, rng, monkeypatch):
    assert_twins_agree(Arm.from_file(arm_file), rng, monkeypatch)


def test_compiled_loop_and_numpy_agree_for_robots(robots, rng, monkeypatch):
    for robot in robots:
        assert_twins_agree(robot, rng, monkeypatch)


def test_errors_of_placements_are_twists_for_pinocchio_too(robots, rng):
    for robot in robots:
        q, errors = postures(robot, rng, 4), rng.normal(scale=0.1, size=(4, 6 * robot.nq))
        moved = np.empty((4, 3))
        for k, error in enumerate(errors):
            model = robot.model.copy()
            for joint, twist in enumerate(error.reshape(-1, 6), start=1):
                model.jointPlacements[joint] = model.jointPlacements[joint] * pin.exp6(twist)
            moved[k] = Poses(model, q[k : k + 1], model.getFrameId(robot.tip)).position
        close(perturbed_positions(robot, q, errors), moved, 1e-13)


def test_exp_is_the_matrix_exponential(rng):
    angles = np.repeat(
        [0.0, 1e-12, 1e-6, 0.999e-3, 1.001e-3, 0.1, 1.0, np.pi - 1e-9, np.pi, 6.0, 40.0], 20
    )
    directions = rng.normal(size=(len(angles), 3))
    w = angles[:, None] * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    twists = np.hstack([rng.normal(size=(len(angles), 3)), w])
    motions, rotation = exp(twists), exp(twists)[:, :3, :3]
    close(motions, np.stack([expm(twist_matrix(twist)) for twist in twists]))
    close(rotation @ rotation.transpose(0, 2, 1), np.broadcast_to(np.eye(3), rotation.shape), 1e-14)
