"""URDF of an arm file.

Every DH row becomes a moving link and a frame link, so that its numbers appear unchanged
(``%.17g``). Standard DH puts ``Rz(θ0)`` into the origin of the joint and ``Tz(d) Tx(a) Rx(α)`` into
that of the frame; modified DH puts ``Rx(α) Tx(a)`` into an extra fixed joint. Frames are ``frame1``
... ``frameN`` and ``tip``. Joints are ``revolute``: Pinocchio has two numbers for a ``continuous``
one.

For other programs, a ``stylus_offset`` without marker may shift ``tip``; in this package the error
model adds it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from aacmm_pin._support.units import MM
from aacmm_pin.arm.file import ArmFile, DHRow

TUBE_RADIUS = 0.018
STYLUS_RADIUS = 0.004
"""Radii of drawn links [m]."""
SHORTEST_DRAWN = 0.005
"""Shorter lengths are residues of a calibration, not drawn [m]."""
BODY_RADIUS = 0.03
"""Radius of the solid sphere whose inertia a body has; statics needs mass and centre alone [m]."""

Triple = tuple[float, ...]
_ZERO: Triple = (0.0, 0.0, 0.0)
_ALONG_X: Triple = (0.0, math.pi / 2, 0.0)
_COLORS = {
    "tube": "0.55 0.58 0.62 1",
    "joint": "0.13 0.23 0.36 1",
    "stylus": "0.75 0.1 0.15 1",
    "base": "0.3 0.3 0.32 1",
}


def urdf_text(arm: ArmFile, *, with_stylus_offset: bool = False) -> str:
    """URDF of ``arm`` [m, rad]: joints with limits, visuals, inertials of stated masses; perhaps
    with ``tip`` shifted by its ``stylus_offset``.
    """
    robot = ET.Element("robot", name=_printable(arm.name))
    source = _printable(arm.source or arm.name)
    source = source.replace("--", "- -").replace("--", "- -")  # which no comment can hold
    robot.append(ET.Comment(f" made by aacmm-pin urdf from: {source} "))
    for name, rgba in _COLORS.items():
        ET.SubElement(ET.SubElement(robot, "material", name=name), "color", rgba=rgba)
    link = ET.SubElement(robot, "link", name="base_link")
    _draw(link, "base", 0.05, 0.06, (0.0, 0.0, -0.03))
    for number, row in enumerate(arm.joints, start=1):
        link = _add_row(
            robot, link, number, row, arm.convention == "standard-dh", number == len(arm.joints)
        )
    offset = _ZERO  # of the tip in the last frame [m]
    for effect in arm.effects if with_stylus_offset else ():
        if effect.cause == "stylus_offset" and effect.structure.get("marker") is None:
            offset = tuple(effect.parameters.get(f"{axis}_mm", 0.0) * MM for axis in "xyz")
    tip = fixed_link(robot, link, "tip", offset, _ZERO)
    _draw(tip, "stylus", STYLUS_RADIUS)
    return xml_text(robot)


def xml_text(robot: ET.Element) -> str:
    """The file of the root element of a URDF."""
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def _add_row(
    robot: ET.Element, parent: ET.Element, number: int, row: DHRow, standard: bool, last: bool
) -> ET.Element:
    a = row.a_mm * MM
    d = row.d_mm * MM
    tilt = (row.alpha_rad, 0.0, 0.0)
    if not standard:
        parent = fixed_link(robot, parent, f"twist{number}", (a, 0.0, 0.0), tilt)
        if abs(a) > SHORTEST_DRAWN:
            _draw(parent, "tube", TUBE_RADIUS, abs(a), (-a / 2, 0.0, 0.0), _ALONG_X)
    names = f"link{number}", f"joint{number}"
    origin = _ZERO, (0.0, 0.0, row.theta_offset_rad)
    if row.limits is None:
        link = ET.SubElement(robot, "link", name=names[0])
        _joint(robot, names[1], "fixed", parent, link, *origin)
    else:
        link = moving_link(robot, parent, *names, row.kind, row.limits, *origin)
        _draw(link, "joint", 0.026, 0.06)
    material, radius = ("stylus", STYLUS_RADIUS) if last else ("tube", TUBE_RADIUS)
    if abs(d) > SHORTEST_DRAWN:
        _draw(link, material, radius, abs(d), (0.0, 0.0, d / 2))
    if standard and abs(a) > SHORTEST_DRAWN:
        _draw(link, material, radius, abs(a), (a / 2, 0.0, d), _ALONG_X)
    frame = fixed_link(
        robot, link, f"frame{number}", (a if standard else 0.0, 0.0, d), tilt if standard else _ZERO
    )
    if row.mass_kg is not None:
        inertial = ET.SubElement(frame, "inertial")
        _origin(inertial, tuple(c * MM for c in row.com_mm or _ZERO), _ZERO)
        ET.SubElement(inertial, "mass", value=_text(row.mass_kg))
        moment = _text(0.4 * row.mass_kg * BODY_RADIUS**2)
        ET.SubElement(
            inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0"
        )
    return frame


def moving_link(
    robot: ET.Element,
    parent: ET.Element,
    name: str,
    joint: str,
    kind: str,
    limits: Sequence[float],
    xyz: Sequence[float],
    rpy: Sequence[float],
) -> ET.Element:
    """Append a link that rotates about, or slides along, z of ``parent`` [rad, m]."""
    link = ET.SubElement(robot, "link", name=name)
    moving = _joint(robot, joint, kind, parent, link, xyz, rpy)
    ET.SubElement(moving, "axis", xyz="0 0 1")
    lower, upper = limits
    ET.SubElement(
        moving, "limit", lower=_text(lower), upper=_text(upper), effort="0", velocity="10"
    )
    return link


def fixed_link(
    robot: ET.Element, parent: ET.Element, name: str, xyz: Sequence[float], rpy: Sequence[float]
) -> ET.Element:
    """Append a link fixed to ``parent``."""
    link = ET.SubElement(robot, "link", name=name)
    _joint(robot, f"{name}_fixed", "fixed", parent, link, xyz, rpy)
    return link


def _joint(
    robot: ET.Element,
    name: str,
    kind: str,
    parent: ET.Element,
    child: ET.Element,
    xyz: Sequence[float],
    rpy: Sequence[float],
) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent.attrib["name"])
    ET.SubElement(joint, "child", link=child.attrib["name"])
    _origin(joint, xyz, rpy)
    return joint


def _draw(
    link: ET.Element,
    material: str,
    radius: float,
    length: float | None = None,
    xyz: Triple = _ZERO,
    rpy: Triple = _ZERO,
) -> None:
    visual = ET.SubElement(link, "visual")
    _origin(visual, xyz, rpy)
    geometry = ET.SubElement(visual, "geometry")
    if length is None:
        ET.SubElement(geometry, "sphere", radius=_text(radius))
    else:
        ET.SubElement(geometry, "cylinder", radius=_text(radius), length=_text(length))
    ET.SubElement(visual, "material", name=material)


def _origin(element: ET.Element, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    ET.SubElement(element, "origin", xyz=_text(*xyz), rpy=_text(*rpy))


def _text(*values: float) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def _printable(text: str) -> str:
    """``text`` with spaces for control characters, which XML cannot contain."""
    return "".join(c if c.isprintable() else " " for c in text)
