"""A URDF file, checked before Pinocchio sees it: what it says of links and joints, in the form it is expected to have.

One pass of expat, without entities, gives the elements with their lines; what Pinocchio gets is written anew from the
numbers that were read, without pictures, materials and transmissions. Joints that are ``continuous`` become ``revolute``
with limits of ±2π: Pinocchio would give them two numbers, cosine and sine, which no encoder shows.
"""

from __future__ import annotations

import codecs
import hashlib
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree as ET
from xml.parsers import expat

from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.plausible import FARTHEST, LARGEST_ANGLE, LARGEST_DEGREES, like_degrees
from aacmm_pin.errors import ArmFileError

TURNS = 2 * math.pi
"""Limit, to both sides, of a joint that URDF calls continuous [rad]."""
MOST_BYTES = 20_000_000
"""Size of a file; a humanoid has a quarter of a megabyte."""
DEEPEST = 30
"""Elements inside one another; those of URDF are five."""
MOST_LINKS = 1000
"""More would be a body in pieces; Pinocchio and its parser go along the chain by recursion."""
KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
BOUNDED = ("revolute", "prismatic")
ATTRIBUTES = {"origin": ("xyz", "rpy"), "axis": ("xyz",), "mass": ("value",)}
"""All that may be in these elements: what is not understood might place a body elsewhere."""
LARGEST_INERTIA = 1e9
"""Of a mass [kg] or a moment [kg m²]."""


@dataclass(frozen=True, eq=False)
class _Element:
    """One element of the file.

    Attributes:
        path: the file.
        tag, line, attributes: as it stands there.
        inside: words for what it is part of, such as ``joint 'elbow': ``.
        children: elements in it.
    """

    path: str
    tag: str
    line: int
    attributes: dict[str, str]
    inside: str = ""
    children: list[_Element] = field(default_factory=list)

    def refused(self, message: str) -> ArmFileError:
        """The error that says where and what."""
        return ArmFileError(self.path, f"line {self.line}", f"{self.inside}{self.words}: {message}")

    @property
    def words(self) -> str:
        """What it is, and its name."""
        name = self.attributes.get("name")
        return self.tag if name is None else f"{self.tag} {name!r}"

    def text(self, name: str) -> str:
        """An attribute that must be there."""
        value = self.attributes.get(name, "")
        if not value:
            raise self.refused(f"{name} is missing")
        return value

    def numbers(self, name: str, default: tuple[float, ...] | None, largest: float) -> tuple[float, ...]:
        """The numbers of an attribute, as many as ``default`` has, or one that must be there."""
        if name not in self.attributes and default is not None:
            return default
        text, count = self.text(name), len(default or (0.0,))
        try:
            values = tuple(float(part) for part in text.split() if "_" not in part)
        except ValueError:
            values = ()
        if len(values) != count or len(text.split()) != count:
            raise self.refused(f"{name} is {text[:80]!r}, expected {count} number{'s' * (count > 1)}")
        for value in values:
            if not abs(value) <= largest:
                hint = "; a joint without limits is of type continuous" if self.tag == "limit" else ""
                hint = "; are the angles in degrees?" if name == "rpy" else hint
                raise self.refused(f"{name} is {text[:80]!r}, expected numbers to ±{largest:g}{hint}")
        return values

    def child(self, tag: str) -> _Element | None:
        """The one element of this tag in it; None where there is none."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            raise found[1].refused("is there twice")
        for name in found[0].attributes if found and tag in ATTRIBUTES else ():
            if name not in ATTRIBUTES[tag]:
                raise found[0].refused(f"{name} is not known there, expected {' and '.join(ATTRIBUTES[tag])} alone")
        return found[0] if found else None

    def need(self, tag: str) -> _Element:
        """The one element of this tag, which must be there."""
        child = self.child(tag)
        if child is None:
            raise self.refused(f"{tag} is missing")
        return child


def read_urdf(path: str | Path) -> tuple[str, str, dict[str, tuple[str, str]]]:
    """The links and joints of a URDF file as text for Pinocchio, the SHA-256 of the file, and joints that mimic others.

    A joint that mimics another is one of its own in the text; frames that both move are refused. By its name there is the
    joint that it follows in the end, and words for where that is said.

    Raises:
        ArmFileError: the file cannot be read, is no URDF, or states what no arm has; names the element and its line.
    """
    content = content_of(path, MOST_BYTES, "a URDF", lambda message: ArmFileError(str(path), "", message))
    robot = _parsed(str(path), content)
    if robot.tag != "robot":
        raise robot.refused("expected robot, the root of a URDF")
    links, joints = ([child for child in robot.children if child.tag == tag] for tag in ("link", "joint"))
    if len(links) > MOST_LINKS:
        raise links[MOST_LINKS].refused(f"is one of {len(links)} links, expected at most {MOST_LINKS}")
    named = _by_name(joints)
    _check_tree(robot, _by_name(links), named)
    root = ET.Element("robot", name=robot.text("name"))
    for link in links:
        _add_link(root, link)
    for joint in joints:
        _add_joint(root, joint)
    return ET.tostring(root, encoding="unicode"), hashlib.sha256(content).hexdigest(), _mimics(named)


def _mimics(joints: dict[str, _Element]) -> dict[str, tuple[str, str]]:
    """See :func:`read_urdf`."""
    found: dict[str, tuple[str, str]] = {}
    for name, joint in joints.items():
        mimic, way = joint.child("mimic"), {name}
        said = "" if mimic is None else str(mimic.refused(f"joint is {mimic.text('joint')!r}"))
        while mimic is not None:
            leader = mimic.text("joint")
            if leader in way:
                raise mimic.refused(f"joint is {leader!r}, so that it mimics itself")
            if leader not in joints:  # fingers of robots that are in use have such
                said = str(mimic.refused(f"there is no joint {leader!r}"))
            way.add(leader)
            found[name] = leader, said
            mimic = joints[leader].child("mimic") if leader in joints else None
    return found


def _parsed(path: str, content: bytes) -> _Element:
    """The root of the file."""
    parser = expat.ParserCreate()
    stack: list[_Element] = []
    roots: list[_Element] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        inside = f"{stack[-1].inside}{stack[-1].words}: " if len(stack) > 1 else ""
        element = _Element(path, tag, parser.CurrentLineNumber, attributes, inside)
        if tag.startswith("xacro:"):
            raise element.refused("expected plain URDF; the program xacro makes it")
        if len(stack) >= DEEPEST:
            raise element.refused(f"more than {DEEPEST} elements inside one another")
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def refuse(*_: object) -> NoReturn:
        raise ArmFileError(path, f"line {parser.CurrentLineNumber}", "defines an entity, expected plain URDF without")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: stack.pop()
    parser.EntityDeclHandler = parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(_from_declaration_on(content), True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise ArmFileError(path, "", f"not a URDF: no well-formed XML: {error}") from None
    return roots[0]


def _from_declaration_on(content: bytes) -> bytes:
    """The file with what is blank before its XML declaration behind it, so that lines keep their numbers.

    The parser of Pinocchio passes over it, expat does not.
    """
    begun = content.removeprefix(codecs.BOM_UTF8).lstrip()
    if not begun.startswith(b"<?xml"):
        return content
    declaration, end, rest = begun.partition(b"?>")
    return declaration + end + b"\n" * content[: content.index(begun)].count(b"\n") + rest


def _by_name(elements: list[_Element]) -> dict[str, _Element]:
    found: dict[str, _Element] = {}
    for element in elements:
        name = element.text("name")
        if name in found:
            raise element.refused(f"the name is taken by line {found[name].line}")
        found[name] = element
    return found


def _check_tree(robot: _Element, links: dict[str, _Element], joints: dict[str, _Element]) -> None:
    """Refuse links and joints that make no one tree."""
    above: dict[str, tuple[str, _Element]] = {}
    for joint in joints.values():
        ends = [joint.need(tag) for tag in ("parent", "child")]
        for end in ends:
            if end.text("link") not in links:
                raise end.refused(f"there is no link {end.text('link')!r}")
        before, behind = (end.text("link") for end in ends)
        if behind in above:
            raise ends[1].refused(f"the link {behind!r} is carried already by {above[behind][1].words}")
        above[behind] = before, joint
    roots = [link for name, link in links.items() if name not in above]
    if len(roots) > 1:
        raise roots[1].refused(f"no joint carries it, nor {roots[0].words}; expected one root")
    grounded = {root.text("name") for root in roots}
    for name in links:
        way: list[str] = []
        while name not in grounded:
            if name in way:
                raise above[name][1].refused(f"is part of a cycle: {name!r} carries itself")
            way.append(name)
            name = above[name][0]
        grounded.update(way)
    if not links:
        raise robot.refused("has no link")


def _add_link(root: ET.Element, link: _Element) -> None:
    new = ET.SubElement(root, "link", name=link.text("name"))
    inertial = link.child("inertial")
    if inertial is None:
        return
    body = ET.SubElement(new, "inertial")
    _add_origin(body, inertial)
    mass, inertia = inertial.need("mass"), inertial.child("inertia")
    (kilograms,) = mass.numbers("value", None, LARGEST_INERTIA)
    if kilograms < 0:
        raise mass.refused(f"value is {kilograms:g}, expected a mass that is not negative")
    ET.SubElement(body, "mass", value=repr(kilograms))
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments = [(0.0,) if inertia is None else inertia.numbers(name, (0.0,), LARGEST_INERTIA) for name in names]
    ET.SubElement(body, "inertia", {name: repr(moment) for name, (moment,) in zip(names, moments, strict=True)})


def _add_joint(root: ET.Element, joint: _Element) -> None:
    kind = joint.text("type")
    if kind not in KINDS:
        raise joint.refused(f"type is {kind!r}, expected one of {', '.join(KINDS)}")
    new = ET.SubElement(root, "joint", name=joint.text("name"), type="revolute" if kind == "continuous" else kind)
    for tag in ("parent", "child"):
        ET.SubElement(new, tag, link=joint.need(tag).text("link"))
    _add_origin(new, joint)
    axis = joint.child("axis")
    if axis is not None and kind not in ("fixed", "floating"):
        ET.SubElement(new, "axis", xyz=_text(_direction(axis)))
    if kind == "continuous":
        _add_limit(new, -TURNS, TURNS)
    elif kind in BOUNDED:
        limit = joint.need("limit")
        lower, upper = (limit.numbers(name, (0.0,), LARGEST_ANGLE)[0] for name in ("lower", "upper"))
        if lower > upper:
            raise limit.refused(f"lower is {lower:g} and upper {upper:g}, expected the lower limit first")
        if kind == "revolute":
            _refuse_degrees(limit, lower=lower, upper=upper)
        _add_limit(new, lower, upper)


def _refuse_degrees(limit: _Element, **ends: float) -> None:
    """Refuse limits of a turning joint that look like degrees; wider ones stand for none."""
    for name, angle in ends.items():
        if (refused := like_degrees(angle)) and abs(angle) <= LARGEST_DEGREES:
            raise limit.refused(f"{name} {refused}; a joint without limits is of type continuous")


def _direction(axis: _Element) -> tuple[float, ...]:
    """The axis as it stands; one that is very long or short brought to a size that squares well."""
    values = axis.numbers("xyz", (1.0, 0.0, 0.0), math.inf)
    size = max(abs(value) for value in values)
    if size == 0 or not math.isfinite(size):
        raise axis.refused(f"xyz is {axis.attributes['xyz']!r}, expected a direction")
    return values if 1e-3 < size < 1e3 else tuple(value / size for value in values)


def _add_origin(parent: ET.Element, element: _Element) -> None:
    origin = element.child("origin")
    if origin is not None:
        shift = origin.numbers("xyz", (0.0, 0.0, 0.0), FARTHEST)
        turn = origin.numbers("rpy", (0.0, 0.0, 0.0), 2 * TURNS)
        ET.SubElement(parent, "origin", xyz=_text(shift), rpy=_text(turn))


def _add_limit(joint: ET.Element, lower: float, upper: float) -> None:
    """With the effort and velocity that URDF wants; nothing here reads them."""
    ET.SubElement(joint, "limit", lower=repr(lower), upper=repr(upper), effort="0", velocity="0")


def _text(values: tuple[float, ...]) -> str:
    return " ".join(map(repr, values))
