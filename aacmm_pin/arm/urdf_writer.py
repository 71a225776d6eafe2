"""URDF text from an arm file.

Every DH row becomes one moving link and one frame link behind it, so that no rotation matrix has to be turned into roll,
pitch and yaw and every number of the table appears in the text as it is (``%.17g``): standard DH puts ``Rz(θ0)`` into the
joint's origin and ``Tz(d) Tx(a) Rx(α)`` into the frame's; modified DH puts ``Rx(α) Tx(a)`` into an extra fixed joint before.
Frames are named ``frame1`` ... ``frameN``; ``tip`` is the last. Joints are ``revolute`` (a ``continuous`` joint would give
Pinocchio two numbers for one angle).

A URDF holds geometry. Of the causes of error that an arm file may add, a ``stylus_offset`` without marker can go in: it
shifts ``tip`` in the axes of the last frame. That is for other programs; here the tip stays where the table has it, because
:class:`aacmm_pin.effects.error_model.ErrorModel` adds the offset itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree import ElementTree as ET

from aacmm_pin._support.units import MM
from aacmm_pin.arm.file import ArmFile, Row

TUBE_RADIUS = 0.018
"""Radius at which links are drawn [m]."""
SHORTEST_DRAWN = 0.005
"""Lengths below this are calibration residues, not tubes, and are not drawn [m]."""
BODY_RADIUS = 0.03
"""Radius of the solid sphere whose inertia stands for a body: statics needs mass and centre only [m]."""

_COLORS = {"tube": "0.55 0.58 0.62 1", "joint": "0.13 0.23 0.36 1", "stylus": "0.75 0.1 0.15 1", "base": "0.3 0.3 0.32 1"}


def urdf_text(arm: ArmFile, *, with_stylus_offset: bool = False) -> str:
    """URDF of ``arm``: joints with limits, primitive visuals, inertials from the stated masses.

    Lengths in metres, angles in radians. The text depends on ``arm`` alone, so it can be compared with a stored one.

    Args:
        arm: the arm file; its other effects have no part.
        with_stylus_offset: shift ``tip`` by the arm's ``stylus_offset``, if it has one of the tip itself.
    """
    robot = ET.Element("robot", name=arm.name)
    robot.append(ET.Comment(f" made by aacmm-pin urdf from: {_comment(arm.source or arm.name)} "))
    for name, rgba in _COLORS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    base = ET.SubElement(robot, "link", name="base_link")
    _cylinder(base, "base", 0.05, 0.06, (0.0, 0.0, -0.03), (0.0, 0.0, 0.0))
    parent, last = "base_link", len(arm.joints)
    for number, row in enumerate(arm.joints, start=1):
        parent = _add_row(robot, parent, number, row, arm.convention == "standard-dh", number == last)
    tip = ET.SubElement(robot, "link", name="tip")
    _sphere(tip, "stylus", 0.004)
    _joint(robot, "tip_fixed", "fixed", parent, "tip", _stylus_offset(arm) if with_stylus_offset else (0.0, 0.0, 0.0))
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _stylus_offset(arm: ArmFile) -> tuple[float, ...]:
    """Where the tip is in the last frame [m]."""
    offset = [0.0, 0.0, 0.0]
    for effect in arm.effects:
        if effect.cause == "stylus_offset" and effect.structure.get("marker") is None:
            offset = [effect.parameters.get(f"{axis}_mm", 0.0) * MM for axis in "xyz"]
    return tuple(offset)


def _add_row(robot: ET.Element, parent: str, number: int, row: Row, standard: bool, last: bool) -> str:
    """Append the links and joints of one row; return the name of its frame link."""
    a, d = row.a_mm * MM, row.d_mm * MM
    turn = (0.0, 0.0, row.theta_offset_rad)
    if not standard:
        parent = _fixed_link(robot, parent, f"twist{number}", (a, 0.0, 0.0), (row.alpha_rad, 0.0, 0.0))
        if abs(a) > SHORTEST_DRAWN:
            _cylinder(robot.findall("link")[-1], "tube", TUBE_RADIUS, abs(a), (-a / 2, 0.0, 0.0), (0.0, math.pi / 2, 0.0))
    link = ET.SubElement(robot, "link", name=f"link{number}")
    joint = _joint(robot, f"joint{number}", "fixed" if row.fixed else "revolute", parent, f"link{number}", rpy=turn)
    if row.limits_rad is not None:
        ET.SubElement(joint, "axis", xyz="0 0 1")
        lower, upper = row.limits_rad
        ET.SubElement(joint, "limit", lower=_text(lower), upper=_text(upper), effort="0", velocity="10")
        _cylinder(link, "joint", 0.026, 0.06, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    _draw_lengths(link, d, a if standard else 0.0, 0.004 if last else TUBE_RADIUS, "stylus" if last else "tube")
    offset = (a, 0.0, d) if standard else (0.0, 0.0, d)
    frame = _fixed_link(robot, f"link{number}", f"frame{number}", offset, (row.alpha_rad if standard else 0.0, 0.0, 0.0))
    if row.mass_kg is not None:
        _inertial(robot.findall("link")[-1], row)
    return frame


def _draw_lengths(link: ET.Element, d: float, a: float, radius: float, material: str) -> None:
    """Draw the offsets of a row: along z by d, then along x by a."""
    if abs(d) > SHORTEST_DRAWN:
        _cylinder(link, material, radius, abs(d), (0.0, 0.0, d / 2), (0.0, 0.0, 0.0))
    if abs(a) > SHORTEST_DRAWN:
        _cylinder(link, material, radius, abs(a), (a / 2, 0.0, d), (0.0, math.pi / 2, 0.0))


def _fixed_link(robot: ET.Element, parent: str, name: str, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> str:
    ET.SubElement(robot, "link", name=name)
    _joint(robot, f"{name}_fixed", "fixed", parent, name, xyz, rpy)
    return name


def _joint(
    robot: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    xyz: tuple[float, ...] = (0.0, 0.0, 0.0),
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _origin(joint, xyz, rpy)
    return joint


def _inertial(link: ET.Element, row: Row) -> None:
    mass = row.mass_kg or 0.0
    inertial = ET.SubElement(link, "inertial")
    _origin(inertial, tuple(c * MM for c in row.com_mm or (0.0, 0.0, 0.0)), (0.0, 0.0, 0.0))
    ET.SubElement(inertial, "mass", value=_text(mass))
    moment = _text(0.4 * mass * BODY_RADIUS**2)
    ET.SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")


def _cylinder(
    link: ET.Element, material: str, radius: float, length: float, xyz: tuple[float, ...], rpy: tuple[float, ...]
) -> None:
    geometry = _visual(link, material, xyz, rpy)
    ET.SubElement(geometry, "cylinder", radius=_text(radius), length=_text(length))


def _sphere(link: ET.Element, material: str, radius: float) -> None:
    ET.SubElement(_visual(link, material, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "sphere", radius=_text(radius))


def _visual(link: ET.Element, material: str, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    _origin(visual, xyz, rpy)
    geometry = ET.SubElement(visual, "geometry")
    ET.SubElement(visual, "material", name=material)
    return geometry


def _origin(element: ET.Element, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> None:
    ET.SubElement(element, "origin", xyz=" ".join(_texts(xyz)), rpy=" ".join(_texts(rpy)))


def _texts(values: tuple[float, ...]) -> Iterator[str]:
    return (_text(value) for value in values)


def _comment(text: str) -> str:
    """``text`` without what an XML comment cannot hold: a double hyphen, control characters."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return printable.replace("--", "- -").replace("--", "- -")


def _text(value: float) -> str:
    return f"{value:.17g}"
