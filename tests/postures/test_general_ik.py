"""Single postures of six-joint arms against a closed form of UR5's inverse written here, and
against Pinocchio's Newton.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin._support.arrays import Array, spread_angles
from aacmm_pin.arm import Arm
from aacmm_pin.postures import continuation
from aacmm_pin.postures.continuation import FIRST_STEP
from aacmm_pin.postures.general_ik import (
    ENOUGH,
    MOST_STARTS,
    ROUND,
    Isolated,
    ReachingPostures,
    reaching_postures,
    search,
)
from aacmm_pin.postures.pose_equations import Equations
from aacmm_pin.postures.solution_curves import CurveSearch
from tests.again import again
from tests.oracle import by_newton, close, distances, jacobian_of

SAME = 1e-6  # rad


@pytest.fixture(scope="module")
def file(robot_file) -> Path:
    return robot_file("ur5_robot.urdf")


@pytest.fixture(scope="module")
def ur5(file) -> Arm:
    return Arm.from_urdf(file, "tool0")


class ByHand:
    """All postures of UR5 at a pose, by geometry.

    Axes 2, 3, 4 are parallel (y of the turned base); 5 and 6 meet in a point W that lies ``side``
    off the plane of the upper arm. So W gives θ1; the angle between axis 6 and axis 2 gives θ5; the
    rest is a planar arm of two links.
    """

    def __init__(self, file: Path) -> None:
        origins = {}
        for joint in ET.parse(file).getroot().iter("joint"):
            if (origin := joint.find("origin")) is not None:
                origins[joint.get("name")] = np.array(
                    [float(v) for v in str(origin.get("xyz")).split()]
                )
        parts = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
        pan, lift, elbow, wrist1, wrist2, wrist3 = (origins[f"{part}_joint"] for part in parts)
        self.height, self.side = pan[2], lift[1] + elbow[1] + wrist2[1]
        self.upper, self.fore, self.hand = elbow[2], wrist1[2], wrist3[2]
        self.tool = origins["wrist_3_link-tool0_fixed_joint"][1]

    def solutions(self, pose: Array) -> Array:
        """(n, 6) [rad] for ``pose`` (4, 4)."""
        found = []
        wrist = pose[:3, 3] - self.tool * pose[:3, 2]
        reach = np.hypot(wrist[0], wrist[1])
        if reach < abs(self.side):
            return np.empty((0, 6))
        for sign in (1, -1):
            q1 = np.arctan2(wrist[1], wrist[0]) - (
                np.arcsin(self.side / reach) if sign > 0 else np.pi - np.arcsin(self.side / reach)
            )
            for q5 in np.array([1, -1]) * np.arccos(np.clip(self._y(q1) @ pose[:3, 2], -1, 1)):
                found += self._planar(pose, wrist, q1, q5)
        return np.array(found).reshape(-1, 6)

    @staticmethod
    def _y(q1: float) -> Array:
        return np.array([-np.sin(q1), np.cos(q1), 0.0])

    def _planar(self, pose: Array, wrist: Array, q1: float, q5: float) -> list[list[float]]:
        y, z6 = self._y(q1), pose[:3, 2]
        x4 = (np.cos(q5) * y - z6) / np.sin(q5)
        z4 = np.cross(x4, y)
        level = np.array([np.cos(q1), np.sin(q1), 0.0])
        pitch = np.arctan2(-x4[2], x4 @ level) - np.pi  # θ2 + θ3 + θ4
        joint4 = wrist - self.hand * z4 - [0, 0, self.height]
        across, up = joint4 @ level, joint4[2]
        cosine = (across**2 + up**2 - self.upper**2 - self.fore**2) / (2 * self.upper * self.fore)
        if abs(cosine) > 1:
            return []
        solutions = []
        for q3 in (np.arccos(cosine), -np.arccos(cosine)):
            lean = np.arctan2(across, up) - np.arctan2(
                self.fore * np.sin(q3), self.upper + self.fore * np.cos(q3)
            )
            q2, q4 = lean - np.pi / 2, pitch - (lean - np.pi / 2) - q3
            before = np.column_stack([x4, y, z4]) @ pin.utils.rotate("z", q5)
            # A turn about y, by θ6.
            turned = before.T @ pose[:3, :3] @ pin.utils.rotate("x", np.pi / 2)
            solutions.append([q1, q2, q3, q4, q5, np.arctan2(turned[0, 2], turned[0, 0])])
        return solutions


@pytest.fixture(scope="module")
def by_hand(file) -> ByHand:
    return ByHand(file)


def assert_same(found: Array, expected: Array) -> None:
    assert len(found) == len(expected)
    if len(found):
        apart = distances(found, expected)
        assert apart.min(axis=1).max() < SAME
        assert apart.min(axis=0).max() < SAME


def at(arm: Arm, pose: Array, **options: Any) -> ReachingPostures:
    return reaching_postures(arm, pose[:3, 3], rotation=pose[:3, :3], **options)


# --- UR5


def test_all_postures_at_random_reachable_poses(ur5, by_hand, rng):
    counts = set()
    for q in rng.uniform(-np.pi, np.pi, (8, 1, 6)):
        pose = ur5.poses(q).placement[0]
        found = at(ur5, pose)
        assert_same(found.q, by_hand.solutions(pose))
        close(ur5.poses(found.q).placement, np.tile(pose, (len(found), 1, 1)), 1e-9)
        assert not found.notes
        assert found.search.unseen < 0.011
        counts.add(len(found))
    assert max(counts) == 8
    assert len(counts) > 1


@pytest.mark.parametrize("count", [0, 4, again(2), again(6)])
def test_poses_with_fewer_postures(ur5, by_hand, rng, count):
    """Poses from nowhere, the hand turned at random, the tip anywhere in a box that is wider than
    the reach.
    """
    left = 2
    while left:
        pose = pin.SE3(
            pin.Quaternion(rng.normal(size=4)).normalized().toRotationMatrix(),
            rng.uniform(-1, 1, 3),
        ).homogeneous
        if len(expected := by_hand.solutions(pose)) == count:
            found = at(ur5, pose)
            assert_same(found.q, expected)
            assert bool(found.reason) == (count == 0)
            left -= 1


@pytest.mark.parametrize(
    ("q3", "q5"), [(3e-4, 1.0), (1.3, 2e-4), again(-0.01, 0.02), again(np.pi - 5e-4, 0.8)]
)
def test_beside_singular_postures(ur5, by_hand, q3, q5):
    """Beside a stretched or folded elbow two postures are almost one; beside a straight wrist some
    are nearly free.
    """
    poses = ur5.poses(np.array([[0.4, -1.1, q3, 0.5, q5, -0.7]]))
    assert np.linalg.cond(jacobian_of(poses)[0]) > 200  # it is such a place
    pose = poses.placement[0]
    expected = by_hand.solutions(pose)
    found = at(ur5, pose)
    assert len(found) == len(expected)
    assert distances(expected, found.q).min(axis=1).max() < 1e-5


def test_a_stretched_elbow_gives_one_posture_for_two(ur5, by_hand):
    q = np.array([[0.4, -1.1, 0.0, 0.5, 0.9, -0.7]])
    found = at(ur5, ur5.poses(q).placement[0])
    assert distances(q, found.q).min() < 1e-5
    apart = distances(found.q, found.q) + 9 * np.eye(len(found))
    assert apart.min() > 0.1
    assert found.notes[0].code == "nearly_singular"


@pytest.mark.parametrize(
    ("bend", "told"),
    [(1e-3, False), (1e-5, True), again(0.4, False), again(1e-7, True), again(1e-9, True)],
)
def test_next_to_a_straight_wrist_doubts_are_told(ur5, bend, told):
    pose = ur5.poses(np.array([[0.3, -1.2, 1.4, -1.6, bend, 0.4]])).placement[0]
    found = reaching_postures(ur5, pose[:3, 3], rotation=pose[:3, :3])
    assert bool({note.code for note in found.notes} & {"nearly_singular", "starts_stalled"}) == told
    assert told or len(found) == 8


def test_a_straight_wrist_is_told_not_sampled(ur5, by_hand):
    """With θ5 = 0 axes 2, 3, 4 and 6 are parallel, and the elbow sweeps: that is a family. The
    other postures are single.
    """
    q = np.array([[0.4, -1.1, 1.3, 0.5, 0.0, -0.7]])
    pose = ur5.poses(q).placement[0]
    found = at(ur5, pose)
    assert found.notes[0].code == "singular_families_unlisted"
    with np.errstate(invalid="ignore", divide="ignore"):
        expected = by_hand.solutions(pose)
    expected = expected[np.isfinite(expected).all(axis=1) & (np.abs(np.sin(expected[:, 4])) > 1e-3)]
    assert len(expected) == 4
    assert_same(found.q, expected)


def test_newton_by_pinocchio_finds_nothing_more(sino6, rng):
    pose = sino6.poses(rng.uniform(-np.pi, np.pi, (1, 6))).placement[0]
    brute = by_newton(sino6, pose, rng.uniform(-np.pi, np.pi, (300, 6)))
    assert len(brute) > 60
    assert distances(brute, at(sino6, pose).q).min(axis=1).max() < SAME


def test_an_arm_with_five_joints(robot_file, rng):
    """Point and axis are as many conditions as joints."""
    arm = Arm.from_urdf(robot_file("so101.urdf"), "gripper_frame_link")
    assert arm.nq == 5
    for q in rng.uniform(-np.pi, np.pi, (2, 1, 5)):
        pose = arm.poses(q).placement[0]
        found = reaching_postures(arm, pose[:3, 3], axis=pose[:3, 0], tool=[1, 0, 0])
        assert distances(q, found.q).min() < SAME
        reached = arm.poses(found.q).placement
        close(reached[:, :3, 3], np.tile(pose[:3, 3], (len(found), 1)), 1e-9)
        close(reached[:, :3, 0], np.tile(pose[:3, 0], (len(found), 1)), 1e-9)


# --- the search, on equations whose solutions are known


System = Callable[[Array], tuple[Array, Array]]


SYSTEMS: list[System] = []


@pytest.fixture
def in_python(monkeypatch) -> Iterator[None]:
    """The loops as Python runs them, with the equations of :data:`SYSTEMS` in place of an arm's."""

    def linearise(links: Array, row: int, count: int, space: Array) -> float:
        n, first = len(links) - 1, continuation.EQUATIONS
        f, jacobian = SYSTEMS[int(links[0, 0, 0])](space[row, :n].copy())
        space[first : first + count, n] = f
        space[first : first + count, :n] = jacobian
        return float(np.abs(f).max())

    monkeypatch.setattr(continuation, "linearise", linearise)
    for loop in (continuation.NEWTON, continuation.CURVES):
        monkeypatch.setitem(vars(loop), "compiled", loop.loop)
    with np.errstate(all="ignore"):
        yield


def solved(system: System, count: int, joints: int) -> Equations:
    SYSTEMS.append(system)
    return Equations(np.full((joints + 1, 4, 4), len(SYSTEMS) - 1.0), np.zeros((1, 3)), count)


def apart(*each: Callable[[float], tuple[float, float]], joints: int) -> Equations:
    """Equations of one angle each, value and derivative; further angles are free."""

    def system(q: Array) -> tuple[Array, Array]:
        values, jacobian = np.zeros(len(each)), np.zeros((len(each), joints))
        for k, equation in enumerate(each):
            values[k], jacobian[k, k] = equation(q[k])
        return values, jacobian

    return solved(system, len(each), joints)


def cosine(of: float, times: int = 1) -> Callable[[float], tuple[float, float]]:
    return lambda q: (np.cos(times * q) - of, -times * np.sin(times * q))


@pytest.mark.usefixtures("in_python")
def test_all_single_solutions():
    """Two of each angle; some of them nearly coincide; after the first round nothing new came."""
    for a, b in ((1.0, 2.0), (1.0, 0.004)):
        system = apart(cosine(np.cos(a)), cosine(np.cos(b)), joints=2)
        finds = Isolated(system)
        found = search(finds, 2)
        assert_same(finds.q, np.array([[i * a, j * b] for i in (1, -1) for j in (1, -1)]))
        starts = spread_angles(MOST_STARTS, 2)[: found.starts]
        _, good = system.polish(starts, np.zeros(found.starts, np.intp))
        assert found.arrived == good.sum()
        assert found.since_new == good[ROUND:].sum()
        assert not any([found.ended, found.degenerate, len(finds.families)])
        assert found.starts % ROUND == 0
        assert found.since_new >= ENOUGH
        assert found.unseen == 3.0 / found.since_new


@pytest.mark.usefixtures("in_python")
def test_closed_curves():
    """Straight, round a free angle: four of them."""
    finds = CurveSearch(apart(cosine(0.5), cosine(-0.2), joints=3))
    found = search(finds, 3)
    assert len(finds.curves) == len(finds) == 4
    assert not any([found.ended, len(finds.families)])
    for curve in finds.curves:
        assert curve.closed
        assert np.abs(np.ptp(curve.q[:, 2]) - 2 * np.pi) < 0.2


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("gap", [1e-2, 1e-6])
def test_a_trace_stays_on_its_side_of_a_narrow_gap(gap):
    """``cos a + cos b = gap`` nearly crosses itself where one angle is 0 and the other π; its four
    sides are one curve.
    """

    def system(q: Array) -> tuple[Array, Array]:
        return np.cos(q).sum(keepdims=True) - gap, -np.sin(q)[None]

    start = np.array([[np.arccos(gap / 2)] * 2, [np.arccos(gap - np.cos(0.3)), 0.3]])
    for begin in start:
        found = CurveSearch(solved(system, 1, 2))
        found.add(begin[None])
        (curve,) = found.curves
        assert curve.closed
        # No leap as over a crossing.
        assert np.linalg.norm(curve.q[1] - curve.q[0]) == pytest.approx(FIRST_STEP, rel=1e-4)
        assert np.abs(curve.q).sum(axis=1).max() < np.pi
        assert set(map(tuple, np.sign(curve.q).astype(int))) >= {(1, 1), (1, -1), (-1, 1), (-1, -1)}
