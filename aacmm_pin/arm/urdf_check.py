"""A URDF file, checked before Pinocchio sees it: what it says of links and joints, as it is
expected.

One pass of lxml, without entities, gives the elements with their lines; what Pinocchio gets is
written anew from the numbers that were read, without pictures, materials and transmissions. Joints
that are ``continuous`` become ``revolute`` with limits of ±2π: Pinocchio would give them two
numbers, cosine and sine, which no encoder shows.

yourdfpy is not used here: it keeps no line numbers, accepts truncated files, four numbers in an
``xyz``, two links of one name, cycles and unknown attributes, and needs half a second to import.
"""

from __future__ import annotations

import codecs
import hashlib
import math
from graphlib import CycleError, TopologicalSorter
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
from aacmm_pin.errors import ArmFileError

FULL_TURN = 2 * math.pi
"""Limit, to both sides, of a joint that URDF calls continuous [rad]."""
MAX_URDF_BYTES = 20_000_000
"""Size of a file; a humanoid has a quarter of a megabyte."""
MAX_LINKS = 1000
"""More would be a body in pieces; Pinocchio and its parser go along the chain by recursion."""
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
BOUNDED = ("revolute", "prismatic")
ATTRIBUTES = {"origin": ("xyz", "rpy"), "axis": ("xyz",), "mass": ("value",)}
"""All that may be in these elements: what is not understood might place a body elsewhere."""
MAX_INERTIA = 1e9
"""Of a mass [kg] or a moment [kg m²]."""
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

Element = Any
"""An element of lxml, which has no types."""


class Follower(NamedTuple):
    """What ``<mimic>`` states: ``ratio`` times the value of ``leader``, which follows no other,
    plus ``offset``; and words for where that is stated.
    """

    leader: str
    ratio: float
    offset: float
    place: str


def read_urdf(path: str | Path) -> tuple[str, str, dict[str, Follower]]:
    """The links and joints of a URDF file as text for Pinocchio, its SHA-256, and by name the
    joints that mimic others, which are joints of their own in the text.

    Raises:
        ArmFileError: the file cannot be read, is no URDF, or states what no arm has; names the
            element and its line.
    """
    content = content_of(
        path, MAX_URDF_BYTES, "a URDF", lambda message: ArmFileError(str(path), "", message)
    )
    robot = parsed_urdf(content, str(path))
    if robot.tag != "robot":
        raise _refused(robot, "this is the root element; expected robot, the root of a URDF")
    links = robot.findall("link")
    joints = robot.findall("joint")
    if len(links) > MAX_LINKS:
        raise _refused(
            links[MAX_LINKS], f"the file has {len(links)} links; expected at most {MAX_LINKS}"
        )
    named = _by_name(joints)
    _check_tree(robot, _by_name(links), named)
    root = etree.Element("robot", name=_text(robot, "name"))
    for link in links:
        _add_link(root, link)
    for joint in joints:
        _add_joint(root, joint)
    return (
        etree.tostring(root, encoding="unicode"),
        hashlib.sha256(content).hexdigest(),
        _mimics(named),
    )


def parsed_urdf(content: bytes, path: str) -> Element:
    """The root of the file, comments and blanks in it; ``path`` is what errors call it.

    Raises:
        ArmFileError: it is no well-formed XML, has entities, or is to be made by xacro.
    """
    parser = etree.XMLParser(resolve_entities=False, no_network=True, recover=True)
    try:
        root = etree.fromstring(_from_declaration_on(content), parser, base_url=path)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ArmFileError(path, "", f"{error}; expected a URDF in well-formed XML") from None
    errors = [error for error in parser.error_log if error.domain_name != "NAMESPACE"]
    if errors:
        first = errors[0]
        raise ArmFileError(
            path, f"line {first.line}", f"{first.message}; expected a URDF in well-formed XML"
        )
    if root is None:
        raise ArmFileError(path, "", "no XML element; expected a URDF in well-formed XML")
    if root.getroottree().docinfo.internalDTD is not None:
        raise ArmFileError(
            path,
            "",
            "the file has a DOCTYPE, which may define entities; expected a URDF without DOCTYPE",
        )
    for element in root.iter(etree.Element):
        if "xacro" in element.tag:
            raise _refused(
                element,
                "this is an element of xacro; expected a URDF; convert the file by xacro FILE -o "
                "FILE.urdf",
            )
    return root


def _from_declaration_on(content: bytes) -> bytes:
    """The file with what is blank before its XML declaration behind it, so that lines keep their
    numbers.

    The parser of Pinocchio passes over it, lxml does not.
    """
    begun = content.removeprefix(codecs.BOM_UTF8).lstrip()
    if not begun.startswith(b"<?xml"):
        return content
    declaration, end, rest = begun.partition(b"?>")
    return declaration + end + b"\n" * content[: content.index(begun)].count(b"\n") + rest


def _words(element: Element) -> str:
    """What an element is, and its name."""
    name = element.get("name")
    return str(element.tag) if name is None else f"{element.tag} {name!r}"


def _refused(element: Element, message: str) -> ArmFileError:
    """The error that says where and what."""
    tree = element.getroottree()
    ancestors = [_words(each) for each in element.iterancestors()]
    inside = [*ancestors[-2::-1], _words(element)]
    return ArmFileError(
        tree.docinfo.URL, f"line {element.sourceline}", f"{': '.join(inside)}: {message}"
    )


def _text(element: Element, name: str) -> str:
    """An attribute that must be there."""
    value = element.get(name, "")
    if not value:
        raise _refused(element, f"{name} is missing; expected a value")
    return str(value)


def _numbers(
    element: Element, name: str, default: tuple[float, ...] | None, largest: float
) -> tuple[float, ...]:
    """The numbers of an attribute, as many as ``default`` has, or one that must be there."""
    if default is not None and element.get(name) is None:
        return default
    text = _text(element, name)
    count = len(default or (0.0,))
    try:
        values = tuple(float(part) for part in text.split() if "_" not in part)
    except ValueError:
        values = ()
    if len(values) != count or len(text.split()) != count:
        raise _refused(
            element, f"{name} is {text[:80]!r}; expected {count} number{'s' * (count > 1)}"
        )
    if any(not abs(value) <= largest for value in values):
        hint = "; check that these are radians" if name == "rpy" else ""
        if element.tag == "limit":
            hint = "; without limits, use type continuous"
        raise _refused(
            element, f"{name} is {text[:80]!r}; expected numbers within ±{largest:g}{hint}"
        )
    return values


def _child(element: Element, tag: str) -> Element | None:
    """The one element of this tag in it; None where there is none."""
    found = element.findall(tag)
    if not found:
        return None
    if len(found) > 1:
        raise _refused(found[1], "the element occurs twice; expected one")
    known = ATTRIBUTES.get(tag, ())
    for name in found[0].attrib if known else ():
        if name not in known:
            raise _refused(
                found[0], f"unknown attribute {name}; expected only {' and '.join(known)}"
            )
    return found[0]


def _required(element: Element, tag: str) -> Element:
    """The one element of this tag, which must be there."""
    child = _child(element, tag)
    if child is None:
        raise _refused(element, f"the element {tag} is missing; expected one")
    return child


def _mimics(joints: dict[str, Element]) -> dict[str, Follower]:
    """See :func:`read_urdf`."""
    found: dict[str, Follower] = {}
    for name, joint in joints.items():
        mimic = _child(joint, "mimic")
        passed = {name}
        said = "" if mimic is None else str(_refused(mimic, f"joint is {_text(mimic, 'joint')!r}"))
        ratio, offset = 1.0, 0.0
        while mimic is not None:
            (own_offset,) = _numbers(mimic, "offset", (0.0,), LARGEST_ANGLE)
            (own_ratio,) = _numbers(mimic, "multiplier", (1.0,), MOST_RATIO)
            offset += ratio * own_offset
            ratio *= own_ratio
            leader = _text(mimic, "joint")
            if leader in passed:
                raise _refused(
                    mimic,
                    f"joint is {leader!r}, which mimics this joint; expected an independent joint",
                )
            if leader not in joints:  # fingers of robots that are in use have such
                said = str(_refused(mimic, f"there is no joint {leader!r}"))
            passed.add(leader)
            found[name] = Follower(leader, ratio, offset, said)
            mimic = _child(joints[leader], "mimic") if leader in joints else None
    return found


def _by_name(elements: list[Element]) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in elements:
        name = _text(element, "name")
        if name in found:
            raise _refused(
                element,
                f"the element in line {found[name].sourceline} has the same name; expected unique "
                "names",
            )
        found[name] = element
    return found


def _check_tree(robot: Element, links: dict[str, Element], joints: dict[str, Element]) -> None:
    """Refuse links and joints that make no one tree."""
    if not links:
        raise _refused(robot, "the robot has no link; expected one or more")
    carriers: dict[str, Element] = {}
    parents: dict[str, list[str]] = {}
    for joint in joints.values():
        parent = _required(joint, "parent")
        child = _required(joint, "child")
        for end in (parent, child):
            if _text(end, "link") not in links:
                raise _refused(
                    end, f"there is no link {end.get('link')!r}; expected the name of a link"
                )
        carried = child.get("link")
        if carried in carriers:
            carrier = _words(carriers[carried])
            raise _refused(
                child,
                f"the link {carried!r} is also the child of {carrier}; expected one parent joint",
            )
        carriers[carried] = joint
        parents[carried] = [parent.get("link")]
    roots = [link for name, link in links.items() if name not in carriers]
    if len(roots) > 1:
        raise _refused(
            roots[1],
            f"neither this link nor {_words(roots[0])} is the child of a joint; expected exactly "
            "one link without a parent",
        )
    try:
        TopologicalSorter(parents).prepare()
    except CycleError as error:
        link = error.args[1][0]
        message = f"the link {link!r} carries itself; expected no cycle"
        raise _refused(carriers[link], message) from None


def _add_link(root: Element, link: Element) -> None:
    new = etree.SubElement(root, "link", name=link.get("name"))
    inertial = _child(link, "inertial")
    if inertial is None:
        return
    body = etree.SubElement(new, "inertial")
    _add_origin(body, inertial)
    mass = _required(inertial, "mass")
    inertia = _child(inertial, "inertia")
    (kilograms,) = _numbers(mass, "value", None, MAX_INERTIA)
    if kilograms < 0:
        raise _refused(mass, f"value is {kilograms:g}; expected 0 or more")
    etree.SubElement(body, "mass", value=repr(kilograms))
    moments = etree.SubElement(body, "inertia", dict.fromkeys(MOMENTS, "0"))
    for name in MOMENTS if inertia is not None else ():
        moments.set(name, repr(*_numbers(inertia, name, (0.0,), MAX_INERTIA)))


def _add_joint(root: Element, joint: Element) -> None:
    kind = _text(joint, "type")
    if kind not in JOINT_TYPES:
        raise _refused(joint, f"type is {kind!r}; expected one of {', '.join(JOINT_TYPES)}")
    written = "revolute" if kind == "continuous" else kind
    new = etree.SubElement(root, "joint", name=joint.get("name"), type=written)
    for tag in ("parent", "child"):
        etree.SubElement(new, tag, link=_required(joint, tag).get("link"))
    _add_origin(new, joint)
    axis = _child(joint, "axis")
    if axis is not None and kind not in ("fixed", "floating"):
        etree.SubElement(new, "axis", xyz=_joined(_direction(axis)))
    if kind == "continuous":
        _add_limit(new, -FULL_TURN, FULL_TURN)
    elif kind in BOUNDED:
        _add_limit(new, *_limits(joint, kind))


def _limits(joint: Element, kind: str) -> tuple[float, float]:
    """Limits of a joint [rad, m]."""
    limit = _required(joint, "limit")
    (lower,) = _numbers(limit, "lower", (0.0,), LARGEST_ANGLE)
    (upper,) = _numbers(limit, "upper", (0.0,), LARGEST_ANGLE)
    if lower > upper:
        raise _refused(
            limit, f"lower is {lower:g} and upper {upper:g}; expected the lower limit first"
        )
    for name, angle in {"lower": lower, "upper": upper}.items():
        refused = like_degrees(angle) if kind == "revolute" else None
        if refused and abs(angle) <= LARGEST_DEGREES:  # wider ones stand for none
            raise _refused(
                limit, f"{name} {refused}; if the joint has no limits, use the type continuous"
            )
    return lower, upper


def _direction(axis: Element) -> tuple[float, ...]:
    """The axis as it stands; one that is very long or short brought to a size that squares well."""
    values = _numbers(axis, "xyz", (1.0, 0.0, 0.0), math.inf)
    size = max(abs(value) for value in values)
    if size == 0 or not math.isfinite(size):
        raise _refused(
            axis, f"xyz is {axis.get('xyz')!r}; expected a direction, not zero or infinite"
        )
    return values if 1e-3 < size < 1e3 else tuple(value / size for value in values)


def _add_origin(parent: Element, element: Element) -> None:
    origin = _child(element, "origin")
    if origin is not None:
        shift = _numbers(origin, "xyz", (0.0, 0.0, 0.0), FARTHEST_PLACE)
        turn = _numbers(origin, "rpy", (0.0, 0.0, 0.0), 2 * FULL_TURN)
        etree.SubElement(parent, "origin", xyz=_joined(shift), rpy=_joined(turn))


def _add_limit(joint: Element, lower: float, upper: float) -> None:
    """With the effort and velocity that URDF wants; nothing here reads them."""
    limits = {"lower": repr(lower), "upper": repr(upper), "effort": "0", "velocity": "0"}
    etree.SubElement(joint, "limit", limits)


def _joined(values: tuple[float, ...]) -> str:
    """Numbers that come back to the last bit."""
    return " ".join(map(repr, values))
