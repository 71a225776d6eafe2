"""A URDF with corrected joints: Pinocchio finds the calibrated arm in it, and nothing else has
changed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.corrected_urdf import corrected_urdf
from aacmm_pin.errors import AacmmError, UnsupportedArmError
from tests.oracle import close

pytestmark = pytest.mark.fast

ROBOTS = [
    ("ur5_robot.urdf", "tool0"),
    ("panda.urdf", "panda_hand_tcp"),
    ("panda.urdf", "panda_link5"),
]
SHIFT = np.array([1e-3, -2e-3, 3e-3])
SMALL = """<?xml version='1.0'?>
<!-- a comment -->
<robot name="two">
  <link name="base"/><link name="one"/><link name="two"/><link name="tip"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="one"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/><axis xyz="0 0 1"/></joint>
  <joint name="j2" type="revolute"><origin xyz="0.5 0 0" rpy="0 1.5707963267948966 0" ></origin>
    <parent link="one"/><child link="two"/><axis xyz="0 -1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="end" type="fixed"><parent link="two"/><child link="tip"/></joint>
  <transmission name="t"><joint name="j1"/></transmission>
</robot>
"""


@pytest.fixture
def small(tmp_path) -> Arm:
    path = tmp_path / "small.urdf"
    path.write_text(SMALL, encoding="utf-8")
    return Arm.from_urdf(path, "tip")


def moved(arm: Arm, rng: np.random.Generator) -> Arm:
    return arm.with_placements(rng.normal(0.0, 5e-3, (arm.nq, 6)), None)


def reread(text: bytes, tmp_path: Path, frame: str) -> Arm:
    path = tmp_path / "corrected.urdf"
    path.write_bytes(text)
    return Arm.from_urdf(path, frame)


def assert_same(found: Arm, expected: Arm, shift: Array, rng: np.random.Generator) -> None:
    q = rng.uniform(-1.0, 1.0, (100, found.nq))
    poses = expected.poses(q)
    where = poses.position + poses.placement[:, :3, :3] @ shift
    close(found.positions(q), where, 1e-9)
    close(found.poses(q).placement[:, :3, :3], poses.placement[:, :3, :3], 1e-9)


@pytest.mark.parametrize(("name", "frame"), ROBOTS)
def test_pinocchio_finds_the_corrected_arm(name, frame, robot_file, tmp_path, rng):
    arm = Arm.from_urdf(robot_file(name), frame)
    after = moved(arm, rng)
    assert_same(reread(corrected_urdf(after), tmp_path, frame), after, np.zeros(3), rng)
    if frame != "panda_link5":  # which moves by itself: its tip cannot be shifted
        assert_same(reread(corrected_urdf(after, SHIFT), tmp_path, frame), after, SHIFT, rng)


def test_joints_without_an_origin_and_with_odd_tags(small, tmp_path, rng):
    after = moved(small, rng)
    text = corrected_urdf(after, SHIFT)
    assert_same(reread(text, tmp_path, "tip"), after, SHIFT, rng)
    assert b"<!-- a comment -->" in text
    assert text.count(b"<origin") == 3


def test_all_else_stays_as_it_was(robot_file, rng):
    path = robot_file("ur5_robot.urdf")
    arm = Arm.from_urdf(path, "tool0")
    assert corrected_urdf(arm) == path.read_bytes()
    before, after = etree.parse(path), etree.fromstring(corrected_urdf(moved(arm, rng)))
    changed = []
    for one, other in zip(before.getroot().iter(), after.iter(), strict=True):
        assert (one.tag, one.text, [*one.attrib]) == (other.tag, other.text, [*other.attrib])
        changed += [one] * (one.attrib != other.attrib)
    assert [each.tag for each in changed] == ["origin"] * 6


def test_what_is_refused(small, robot_file, tmp_path, rng):
    with pytest.raises(UnsupportedArmError, match=r"no fixed joint .*wrist_3_link"):
        corrected_urdf(Arm.from_urdf(robot_file("ur5_robot.urdf"), "wrist_3_link"), SHIFT)
    with pytest.raises(UnsupportedArmError, match="has a DH table"):
        corrected_urdf(Arm.load("sino6"))
    utf16 = tmp_path / "utf16.urdf"
    utf16.write_bytes(
        SMALL.replace("version='1.0'", "version='1.0' encoding='utf-16'").encode("utf-16")
    )
    after = moved(Arm.from_urdf(utf16, "tip"), rng)
    assert_same(reread(corrected_urdf(after), tmp_path, "tip"), after, np.zeros(3), rng)
    Path(small.source).unlink()
    with pytest.raises(AacmmError, match=r"small\.urdf.*cannot be read"):
        corrected_urdf(small)
