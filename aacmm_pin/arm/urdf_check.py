"""A URDF file as a Pinocchio model; refuses what Pinocchio would misread.

``continuous`` joints become ``revolute`` with limits of ±2π: Pinocchio would give them two numbers,
cosine and sine.
"""

from __future__ import annotations

import codecs
import hashlib
import math
from pathlib import Path
from typing import Any, NamedTuple

from lxml import etree

from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.plausible import (
    FARTHEST_PLACE,
    LARGEST_ANGLE,
    LARGEST_DEGREES,
    MOST_RATIO,
    like_degrees,
)
from aacmm_pin.arm.file import refuse_ur_file
from aacmm_pin.arm.pinocchio_model import built_model
from aacmm_pin.errors import ArmFileError

FULL_TURN = 2 * math.pi
"""Limit on both sides of a continuous joint [rad]."""
MAX_URDF_BYTES = 20_000_000
"""A humanoid has a quarter of a megabyte."""
MAX_LINKS = 1000
"""Pinocchio and its parser use recursion along the chain."""
IGNORED = (
    *("visual", "collision", "material", "transmission", "gazebo"),
    *("dynamics", "safety_controller", "calibration"),
)
"""Elements without effect here."""
ATTRIBUTES = {"origin": ("xyz", "rpy"), "axis": ("xyz",)}
"""Unknown attributes of these might move a body."""
SHORTEST_AXIS = 1e-3
"""Least size of the largest component."""
CHECKED_PLACES = ("joint/origin", "joint/axis", "link/inertial/origin")
MAX_INERTIA = 1e9
"""Largest mass [kg] or moment [kg m²]."""
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

Element = Any
"""An element of lxml, which has no types."""


class Follower(NamedTuple):
    """Content of ``<mimic>``: ``ratio`` times the independent joint ``leader``, plus ``offset``;
    and its place in words.
    """

    leader: str
    ratio: float
    offset: float
    place: str


def read_urdf(path: str | Path) -> tuple[Any, str, dict[str, Follower]]:
    """The Pinocchio model of a URDF file, its SHA-256, and its mimicking joints by name."""
    name = str(path)
    content = content_of(
        path, MAX_URDF_BYTES, "a URDF", lambda message: ArmFileError(name, "", message)
    )
    refuse_ur_file(name)
    robot = parsed_urdf(content, name)
    links = len(robot.findall("link"))
    if links > MAX_LINKS:
        raise ArmFileError(name, "", f"the file has {links} links; expected at most {MAX_LINKS}")
    etree.strip_elements(robot, *IGNORED, with_tail=False)
    for path_of_place in CHECKED_PLACES:
        for element in robot.iterfind(path_of_place):
            _check_place(element)
    for inertial in robot.iterfind("link/inertial"):
        _check_inertial(inertial)
    joints = {joint.get("name", ""): joint for joint in robot.iterfind("joint")}
    for joint in joints.values():
        if joint.get("type") in ("revolute", "continuous", "prismatic"):
            _check_limits(joint)
    followers = _followers(joints)
    etree.strip_elements(robot, "mimic", with_tail=False)
    model = built_model(etree.tostring(robot, encoding="unicode"), name)
    for joint_name, joint in joints.items():
        if joint.get("type") != "fixed" and joint_name not in model.names:
            raise _error_at(joint, "this joint is in a cycle of links; expected one tree")
    return model, hashlib.sha256(content).hexdigest(), followers


def parsed_urdf(content: bytes, path: str) -> Element:
    """The root element; ``path`` is its name in errors."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, recover=True)
    # As the parser of Pinocchio, pass over what is blank before the XML declaration.
    xml = content.removeprefix(codecs.BOM_UTF8).lstrip()
    try:
        root = etree.fromstring(xml, parser, base_url=path)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ArmFileError(path, "", f"{error}; expected a URDF in well-formed XML") from None
    errors = [error for error in parser.error_log if error.domain_name != "NAMESPACE"]
    if errors or root is None:
        reason = f"line {errors[0].line}: {errors[0].message}" if errors else "no XML element"
        raise ArmFileError(path, "", f"{reason}; expected a URDF in well-formed XML")
    for element in root.iter(etree.Element):
        if "xacro" in element.tag:
            raise _error_at(
                element,
                "this is an element of xacro; expected a URDF; convert the file by xacro FILE -o "
                "FILE.urdf",
            )
    return root


def _error_at(element: Element, message: str) -> ArmFileError:
    """Names the element and those around it, except the root."""
    ancestors = [*element.iterancestors()][:-1]
    names = []
    for part in (*reversed(ancestors), element):
        name = part.get("name")
        names.append(part.tag if name is None else f"{part.tag} {name!r}")
    return ArmFileError(element.getroottree().docinfo.URL, ": ".join(names), message)


def _numbers(element: Element, name: str, default: str, largest: float) -> list[float]:
    """As many numbers of an attribute as its ``default`` has."""
    text = element.get(name, default)
    count = len(default.split())
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count:
        raise _error_at(
            element, f"{name} is {text[:80]!r}; expected {count} number{'s' * (count > 1)}"
        )
    if not all(abs(value) <= largest for value in values):
        hint = "; check that these are radians" if name == "rpy" else ""
        if element.tag == "limit":
            hint = "; without limits, use type continuous"
        raise _error_at(
            element, f"{name} is {text[:80]!r}; expected numbers within ±{largest:g}{hint}"
        )
    return values


def _check_place(element: Element) -> None:
    """Refuse an ``origin`` or ``axis`` with unknown attributes or implausible numbers."""
    if element.tag == "axis" and element.getparent().get("type") in ("fixed", "floating"):
        return
    allowed = ATTRIBUTES[element.tag]
    for name in element.attrib:
        if name not in allowed:
            raise _error_at(
                element, f"unknown attribute {name}; expected only {' and '.join(allowed)}"
            )
    _numbers(element, "rpy", "0 0 0", 2 * FULL_TURN)
    place = _numbers(element, "xyz", "1 0 0", FARTHEST_PLACE)
    if element.tag == "axis" and max(map(abs, place)) < SHORTEST_AXIS:
        raise _error_at(element, f"xyz is {element.get('xyz')!r}; expected a direction, not zero")


def _check_inertial(inertial: Element) -> None:
    for mass in inertial.iterfind("mass"):
        (kilograms,) = _numbers(mass, "value", "0", MAX_INERTIA)
        if kilograms < 0:
            raise _error_at(mass, f"value is {kilograms:g}; expected 0 or more")
    inertia = inertial.find("inertia")
    if inertia is None:
        inertia = etree.SubElement(inertial, "inertia")
    for name in MOMENTS:
        inertia.set(name, inertia.get(name, "0"))
        _numbers(inertia, name, "0", MAX_INERTIA)


def _check_limits(joint: Element) -> None:
    """Refuse limits in wrong order or in degrees; make a continuous joint revolute."""
    limit = joint.find("limit")
    if joint.get("type") == "continuous":
        joint.set("type", "revolute")
        limit = etree.SubElement(joint, "limit") if limit is None else limit
        limit.attrib.update({"lower": repr(-FULL_TURN), "upper": repr(FULL_TURN)})
    if limit is None:
        return
    # URDF wants both, and nothing here reads them.
    limit.attrib.update({"effort": "0", "velocity": "0"})
    (lower,) = _numbers(limit, "lower", "0", LARGEST_ANGLE)
    (upper,) = _numbers(limit, "upper", "0", LARGEST_ANGLE)
    if lower > upper:
        raise _error_at(
            limit, f"lower is {lower:g} and upper {upper:g}; expected the lower limit first"
        )
    for name, angle in {"lower": lower, "upper": upper}.items():
        reason = like_degrees(angle) if joint.get("type") == "revolute" else ""
        if reason and abs(angle) <= LARGEST_DEGREES:  # wider ones stand for none
            raise _error_at(
                limit, f"{name} {reason}; if the joint has no limits, use the type continuous"
            )


def _followers(joints: dict[str, Element]) -> dict[str, Follower]:
    """Mimicking joints by name, each with the independent joint at the end of its chain."""
    followers = {}
    for name, joint in joints.items():
        visited = {name}
        ratio = 1.0
        offset = 0.0
        current = joint
        while current is not None and (mimic := current.find("mimic")) is not None:
            leader = mimic.get("joint", "")
            if leader in visited:
                raise _error_at(
                    mimic,
                    f"joint is {leader!r}, which mimics this joint; expected an independent joint",
                )
            visited.add(leader)
            (offset_of_mimic,) = _numbers(mimic, "offset", "0", LARGEST_ANGLE)
            (multiplier,) = _numbers(mimic, "multiplier", "1", MOST_RATIO)
            offset += ratio * offset_of_mimic
            ratio *= multiplier
            current = joints.get(leader)
            # Fingers of robots that are in use follow a joint that is not there.
            came = f"there is no joint {leader!r}" if current is None else f"joint is {leader!r}"
            followers[name] = Follower(leader, ratio, offset, str(_error_at(mimic, came)))
    return followers
