"""URDF that came from elsewhere, in the form in which every joint takes one number."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as ET

from aacmm_pin.errors import AacmmError

TURNS = 2 * math.pi
"""Limit, to both sides, of a joint that URDF calls continuous [rad]."""


def read_urdf(path: str | Path) -> str:
    """The text of a URDF file, with its ``continuous`` joints as ``revolute`` ones with limits of ±2π.

    Pinocchio gives a continuous joint two numbers, cosine and sine, which no encoder shows; the motion is the same. What a
    file says of ``lower`` and ``upper`` in a continuous joint has no meaning in URDF and is replaced.

    Raises:
        AacmmError: no such file, or not XML.
    """
    if not Path(path).is_file():
        raise AacmmError(f"{path}: no such file")
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:
        raise AacmmError(f"{path}: not a URDF that Pinocchio can load: {error}") from None
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            _bounded(joint)
    return ET.tostring(root, encoding="unicode")


def _bounded(joint: ET.Element) -> None:
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", effort="0", velocity="0")  # URDF wants them; nothing here reads them
    limit.set("lower", repr(-TURNS))
    limit.set("upper", repr(TURNS))
