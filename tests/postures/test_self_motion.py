"""Self-motion curves: Panda against Newton's method and Jacobians by Pinocchio, SINO6 against the
configuration circle.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin import ReachingPostures
from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.postures.general_ik import reaching_postures
from tests.oracle import by_newton, close, gaps, jacobian_of, off_polylines

TURN = 2 * np.pi


@pytest.fixture(scope="module")
def panda(robot_file) -> Arm:
    return Arm.from_urdf(robot_file("panda.urdf"), "panda_hand_tcp")


@pytest.fixture(scope="module")
def poses(panda) -> Array:
    q = np.random.default_rng(5).uniform(*panda.limits.T, (2, 7))
    return panda.poses(q).placement


@pytest.fixture(scope="module")
def motions(panda, poses) -> list[ReachingPostures]:
    return [
        reaching_postures(panda, pose[:3, 3], rotation=pose[:3, :3], count=720) for pose in poses
    ]


def test_every_posture_holds_the_pose(panda, poses, motions):
    for pose, motion in zip(poses, motions, strict=True):
        assert not motion.notes
        assert motion.search.unseen < 0.011
        assert motion.search.unseen == pytest.approx(
            -np.log(0.05) / motion.search.since_new, rel=2e-3
        )
        close(panda.poses(motion.q).placement, np.tile(pose, (len(motion), 1, 1)), 1e-9)


def test_curves_are_closed_even_and_along_the_null_space(panda, motions):
    """Neighbours are equally far apart; the chord between the neighbours of a posture is in the
    Jacobian's null space.
    """
    for motion in motions:
        for number in np.unique(motion.component):
            q = motion.q[motion.component == number]
            way = np.diagonal(gaps(np.roll(q, -1, axis=0), q)).T
            step = np.linalg.norm(way, axis=1)
            assert step.max() < 1.02 * step.min()
            close(motion.travel[motion.component == number], np.cumsum(step) - step, 1e-9)
            chord = way + np.roll(way, 1, axis=0)
            chord /= np.linalg.norm(chord, axis=1)[:, None]
            moved = np.einsum("nij,nj->ni", jacobian_of(panda.poses(q)), chord)
            assert np.abs(moved).max() < 5 * step.max() ** 2  # of second order in the step


def test_newton_by_pinocchio_finds_nothing_beside_the_curves(panda, poses, motions, rng):
    for pose, motion in zip(poses, motions, strict=True):
        brute = by_newton(panda, pose, rng.uniform(-np.pi, np.pi, (150, 7)))
        assert len(brute) > 50
        assert off_polylines(brute, motion.component, motion.q).max() < 3e-4


def test_limits_are_flags(panda, motions):
    """A posture is within limits when every joint is, whole turns apart; the fraction of arc is
    counted on many postures.
    """
    turns = TURN * np.array([-1, 0, 1])
    for motion in motions:
        images = motion.q[:, :, None] + turns
        inside = ((images >= panda.limits[:, :1]) & (images <= panda.limits[:, 1:])).any(axis=2)
        np.testing.assert_array_equal(motion.broken, ~inside)
        weights = [motion.travel[motion.component == n].max() for n in np.unique(motion.component)]
        shares = [
            motion.within_limits[motion.component == n].mean() for n in np.unique(motion.component)
        ]
        assert motion.arc_fraction == pytest.approx(np.average(shares, weights=weights), abs=3e-3)
        assert 0 <= motion.arc_fraction < 1


def test_a_last_axis_along_the_tool_turns_by_itself(rng):
    """UR5 with the axis of its last joint held: nothing but that joint moves, all the way round."""
    ur5 = Arm.from_urdf("ur5")
    pose = ur5.poses(rng.uniform(-np.pi, np.pi, (1, 6))).placement[0]
    motion = reaching_postures(ur5, pose[:3, 3], axis=pose[:3, 2], count=90)
    single = reaching_postures(ur5, pose[:3, 3], rotation=pose[:3, :3])
    assert motion.component.max() == len(single)
    for number in range(1, len(single) + 1):
        q = motion.q[motion.component == number]
        assert np.ptp(q[:, :5], axis=0).max() < 1e-9
        assert np.diff(np.sort(q[:, 5])) == pytest.approx(TURN / 90)


def test_curves_that_cross_are_followed_straight_on(rng):
    """With the tool upright UR5's last axis is level, at times parallel to axes 2 to 4: there J
    loses rank, curves cross.
    """
    ur5, tool = Arm.from_urdf("ur5"), (1.0, 0.0, 0.0)
    motion = reaching_postures(ur5, [0.4, 0.1, 0.3], axis=[0, 0, -1], tool=tool, count=360)
    assert not motion.notes
    assert motion.component.max() == 16
    assert motion.travel.max() < 9.5  # wrong turns at crossings make longer ones
    crossings = np.linalg.svd(jacobian_of(ur5.poses(motion.q)), compute_uv=False)[:, -1] < 1e-2
    assert crossings.any()
    poses = ur5.poses(motion.q).placement
    close(poses[:, :3, 3], np.tile([0.4, 0.1, 0.3], (len(poses), 1)), 1e-9)
    close(poses[:, :3, :3] @ tool, np.tile([0, 0, -1], (len(poses), 1)), 1e-9)
    turn = rng.uniform(-np.pi, np.pi)  # the whole pose, at random about the tool's axis
    pose = poses[0].copy()
    pose[:3, :3] = pin.exp3(np.array([0.0, 0.0, -turn])) @ pose[:3, :3]
    brute = by_newton(ur5, pose, rng.uniform(-np.pi, np.pi, (80, 6)))
    assert len(brute) > 20
    assert off_polylines(brute, motion.component, motion.q).max() < 1e-3
