"""URDF files as they come: what each mistake is answered with, and that nothing else of a good one
changes.
"""

from __future__ import annotations

import importlib.metadata
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from aacmm_pin.arm import Arm
from aacmm_pin.arm.urdf_check import FULL_TURN, MAX_LINKS, read_urdf
from aacmm_pin.errors import ArmFileError, UnsupportedArmError

pytestmark = pytest.mark.fast

GOOD = """\
<?xml version="1.0"?>
<robot name="two">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="0.5"/>
      <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/>
    </inertial>
    <visual><geometry><mesh filename="package://nowhere.stl"/></geometry></visual>
  </link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 1.5 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="upper"/>
    <child link="tip"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.5"/>
  </joint>
</robot>
"""
SLIDE = GOOD[GOOD.index('  <joint name="slide"') : GOOD.index("</robot>")]
# what is replaced, by what, and words of the answer
MISTAKES = [
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "joint 'shoulder': axis: xyz is '0 0 0'"),
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', "3 numbers"),
    ('lower="-1" upper="2"', 'lower="2" upper="-1"', "limit: lower is 2 and upper -1"),
    ('<limit lower="0" upper="0.5"/>', "", "[slide] is of type PRISMATIC without limits; expected"),
    ('lower="-1" upper="2"', 'lower="-90" upper="2"', "limit: lower is -90 rad"),
    ('lower="-1" upper="2"', 'lower="-1e9" upper="2"', "use type continuous"),
    ('rpy="0 1.5 0"', 'rpy="0 90 0"', "radians"),
    ('rpy="0 1.5 0"', 'quat_xyzw="0 0 0 1"', "origin: unknown attribute quat_xyzw"),
    ('mass value="0.5"', 'mass value="-0.5"', "link 'upper': inertial: mass: value is -0.5"),
    ('<child link="tip"/>', '<child link="tool"/>', "child link [tool] of joint [slide]"),
    ('<child link="tip"/>', '<child link="upper"/>', "Two root links found: [base] and [tip]"),
    ('<parent link="upper"/>', '<parent link="tip"/>', "joint 'slide': this joint is in a cycle"),
    ('<link name="tip"/>', '<link name="base"/>', "link 'base' is not unique; expected"),
    ('type="prismatic"', 'type="screw"', "[slide] has no known type [screw]"),
    ("robot", "sdf", "'robot' element"),
    ('<link name="base"/>', '<xacro:include filename="x"/>', "xacro"),
    ('<axis xyz="1 0 0"/>', '<mimic joint="slide"/>', "'slide': mimic: joint is 'slide'"),
    (
        SLIDE,
        "".join(f'<link name="l{i}"/>' for i in range(30_000)),
        f"expected at most {MAX_LINKS}",
    ),
]


def test_each_mistake_is_named(tmp_path, capfd):
    path = tmp_path / "bad.urdf"
    for old, new, words in MISTAKES:
        assert old in GOOD
        path.write_text(GOOD.replace(old, new), encoding="utf-8")
        with pytest.raises(ArmFileError) as caught:
            Arm.from_urdf(path, "tip")
        assert caught.value.path == str(path)
        assert words in str(caught.value)
    assert capfd.readouterr().err == ""


def test_what_is_no_xml(tmp_path):
    path = tmp_path / "bad.urdf"
    entities = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
    many = f'<!DOCTYPE r [<!ENTITY a0 "lol">{entities}]>\n<robot name="&a9;">'
    for content, words in (
        (b"", "XML"),
        (GOOD.replace('<robot name="two">', many).encode(), "entity"),
        (GOOD.encode()[:300], "line 10"),
        (b'<?xml version="1.0" encoding="no-such"?><robot/>', "encoding"),
    ):
        path.write_bytes(content)
        with pytest.raises(ArmFileError, match=words):
            read_urdf(path)
    for there, words in ((tmp_path, "folder"), (Path("/dev/zero"), "20 MB")):
        with pytest.raises(ArmFileError, match=words):
            read_urdf(there)


def test_lengths_in_another_unit_are_seen_by_what_is_reached(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(GOOD.replace('xyz="0 0 0.3"', 'xyz="0 0 300"'), encoding="utf-8")
    with pytest.raises(
        UnsupportedArmError,
        match=r"joint 'shoulder' is 300 m beyond the joint before, .* up to 300",
    ):
        Arm.from_urdf(path, "tip")


def test_what_is_blank_before_the_declaration_is_passed_over(tmp_path):
    """As urdfdom does."""
    path = tmp_path / "arm.urdf"
    for before in ("\n", " \t\n\r\n", "\ufeff\n"):
        path.write_text(before + GOOD, encoding="utf-8", newline="")
        arm = Arm.from_urdf(path, "tip")
        np.testing.assert_array_equal(arm.limits, [[-1, 2], [0, 0.5]])


def test_nothing_of_a_robot_changes():
    """Every robot of example-robot-data as Pinocchio reads it by itself, with its continuous joints
    as turning ones.
    """
    files = importlib.metadata.distribution("example-robot-data").files or []
    compared = 0
    for path in (Path(str(file.locate())) for file in files if file.name.endswith(".urdf")):
        if path.name in ("ur3.urdf", "iris.urdf"):  # an empty robot; limits of 1e16
            with pytest.raises(ArmFileError):
                read_urdf(path)
            continue
        root = ET.parse(path).getroot()
        for joint in root.iterfind(".//joint[@type='continuous']"):
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = (
                ET.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
            )
            limit.attrib.update(lower=repr(-FULL_TURN), upper=repr(FULL_TURN))
        alone = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))
        ours, _, _ = read_urdf(path)
        assert (alone.name, [*alone.names]) == (ours.name, [*ours.names])
        assert [*alone.jointPlacements] == [*ours.jointPlacements], path
        assert [*alone.inertias] == [*ours.inertias]
        assert [(f.name, f.placement) for f in alone.frames] == [
            (f.name, f.placement) for f in ours.frames
        ]
        np.testing.assert_array_equal(alone.lowerPositionLimit, ours.lowerPositionLimit)
        np.testing.assert_array_equal(alone.upperPositionLimit, ours.upperPositionLimit)
        compared += 1
    assert compared > 50
