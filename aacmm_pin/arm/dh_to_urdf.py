"""URDF of an arm file.

Every DH row becomes a moving link and a frame link, so that its numbers appear unchanged
(``%.17g``). Standard DH puts ``Rz(θ0)`` into the origin of the joint and ``Tz(d) Tx(a) Rx(α)`` into
that of the frame; modified DH puts ``Rx(α) Tx(a)`` into an extra fixed joint. Frames are ``frame1``
... ``frameN`` and ``tip``.

For other programs, a ``stylus_offset`` without marker may shift ``tip``; in this package the error
model adds it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as ET
from xml.sax.saxutils import quoteattr

from aacmm_pin._support.units import MM
from aacmm_pin.arm.file import ArmFile, DHRow

TUBE_RADIUS = 0.018
STYLUS_RADIUS = 0.004
"""Radii of drawn links [m]."""
SHORTEST_DRAWN = 0.005
"""Shorter lengths are residues of a calibration, not drawn [m]."""
BODY_RADIUS = 0.03
"""Radius of the solid sphere whose inertia a body has; statics needs mass and centre alone [m]."""

ZERO = (0.0, 0.0, 0.0)
ALONG_X = (0.0, math.pi / 2, 0.0)
COLORS = {
    "tube": "0.55 0.58 0.62 1",
    "joint": "0.13 0.23 0.36 1",
    "stylus": "0.75 0.1 0.15 1",
    "base": "0.3 0.3 0.32 1",
}


def urdf_text(arm: ArmFile, *, with_stylus_offset: bool = False) -> str:
    """URDF of ``arm`` [m, rad]: joints with limits, visuals, inertials of stated masses; perhaps
    with ``tip`` shifted by its ``stylus_offset``.
    """
    source = _printable(arm.source or arm.name)
    source = source.replace("--", "- -").replace("--", "- -")  # which no comment can hold
    parts = [f"<!-- made by aacmm-pin urdf from: {source} -->"]
    for name, rgba in COLORS.items():
        parts.append(f'<material name="{name}"><color rgba="{rgba}"/></material>')
    stand = _cylinder("base", 0.05, 0.06, (0.0, 0.0, -0.03))
    parts.append(f'<link name="base_link">{stand}</link>')
    frame = "base_link"
    for number, row in enumerate(arm.joints, start=1):
        is_last = number == len(arm.joints)
        parts += _links_of_row(row, number, frame, arm.convention == "standard-dh", is_last)
        frame = f"frame{number}"
    offset: Sequence[float] = ZERO  # of the tip in the last frame [m]
    for effect in arm.effects if with_stylus_offset else ():
        if effect.cause == "stylus_offset" and effect.structure.get("marker") is None:
            offset = [effect.parameters.get(f"{axis}_mm", 0.0) * MM for axis in "xyz"]
    ball = _visual("stylus", f'<sphere radius="{STYLUS_RADIUS:.17g}"/>', ZERO, ZERO)
    parts.append(link_text("tip", frame, offset, ZERO, content=ball))
    return robot_text(_printable(arm.name), parts)


def robot_text(name: str, parts: Iterable[str]) -> str:
    """The file of a URDF with these elements."""
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    robot = ET.XML(f"<robot name={quoteattr(name)}>{''.join(parts)}</robot>", parser)
    ET.indent(robot)
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def link_text(
    name: str,
    parent: str,
    xyz: Sequence[float],
    rpy: Sequence[float],
    *,
    content: str = "",
    joint: str = "",
    kind: str = "fixed",
    limits: Sequence[float] | None = None,
) -> str:
    """A link on ``parent``, and its joint: fixed, or with ``limits`` about or along z [rad, m]."""
    motion = ""
    if limits is not None:
        bounds = f'lower="{limits[0]:.17g}" upper="{limits[1]:.17g}"'
        motion = f'<axis xyz="0 0 1"/><limit {bounds} effort="0" velocity="10"/>'
    return f"""
<link name="{name}">{content}</link>
<joint name="{joint or f"{name}_fixed"}" type="{kind}">
  <parent link="{parent}"/><child link="{name}"/>{_origin(xyz, rpy)}{motion}
</joint>"""


def _links_of_row(row: DHRow, number: int, parent: str, standard: bool, is_last: bool) -> list[str]:
    a = row.a_mm * MM
    d = row.d_mm * MM
    tilt = (row.alpha_rad, 0.0, 0.0)
    links = []
    if not standard:
        tube = _cylinder("tube", TUBE_RADIUS, a, (-a / 2, 0.0, 0.0), ALONG_X)
        links.append(link_text(f"twist{number}", parent, (a, 0.0, 0.0), tilt, content=tube))
        parent = f"twist{number}"
    material, radius = ("stylus", STYLUS_RADIUS) if is_last else ("tube", TUBE_RADIUS)
    drawn = "" if row.fixed else _cylinder("joint", 0.026, 0.06)
    drawn += _cylinder(material, radius, d, (0.0, 0.0, d / 2))
    if standard:
        drawn += _cylinder(material, radius, a, (a / 2, 0.0, d), ALONG_X)
    links.append(
        link_text(
            f"link{number}",
            parent,
            ZERO,
            (0.0, 0.0, row.theta_offset_rad),
            content=drawn,
            joint=f"joint{number}",
            kind="fixed" if row.fixed else row.kind,
            limits=row.limits,
        )
    )
    inertial = ""
    if row.mass_kg is not None:
        centre = _origin([c * MM for c in row.com_mm or ZERO], ZERO)
        i = f"{0.4 * row.mass_kg * BODY_RADIUS**2:.17g}"
        inertial = f"""
<inertial>{centre}<mass value="{row.mass_kg:.17g}"/>
  <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>
</inertial>"""
    xyz, rpy = ((a, 0.0, d), tilt) if standard else ((0.0, 0.0, d), ZERO)
    links.append(link_text(f"frame{number}", f"link{number}", xyz, rpy, content=inertial))
    return links


def _cylinder(
    material: str,
    radius: float,
    length: float,
    xyz: Sequence[float] = ZERO,
    rpy: Sequence[float] = ZERO,
) -> str:
    if abs(length) <= SHORTEST_DRAWN:
        return ""
    shape = f'<cylinder radius="{radius:.17g}" length="{abs(length):.17g}"/>'
    return _visual(material, shape, xyz, rpy)


def _visual(material: str, shape: str, xyz: Sequence[float], rpy: Sequence[float]) -> str:
    return f"""
<visual>{_origin(xyz, rpy)}<geometry>{shape}</geometry><material name="{material}"/></visual>"""


def _origin(xyz: Sequence[float], rpy: Sequence[float]) -> str:
    xyz_text, rpy_text = (" ".join(f"{value:.17g}" for value in values) for values in (xyz, rpy))
    return f'<origin xyz="{xyz_text}" rpy="{rpy_text}"/>'


def _printable(text: str) -> str:
    """``text`` with spaces for control characters, which XML cannot contain."""
    return "".join(c if c.isprintable() else " " for c in text)
