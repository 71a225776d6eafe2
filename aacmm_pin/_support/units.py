"""Units of files and people: multiply on input, divide on output. Inside all is SI."""

from __future__ import annotations

import math
import re

MM = 1e-3
UM = 1e-6
LARGE_IN_MICRO = 1e4
"""So many µm or µrad are shown in mm or mrad."""
MM3 = MM**3
DEG = math.pi / 180.0
ARCSEC = DEG / 3600.0

ANGLES = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "µrad": 1e-6,
    "deg": DEG,
    "mdeg": 1e-3 * DEG,
    "arcmin": DEG / 60.0,
    "arcsec": ARCSEC,
}
"""Of typed angles, in radians."""
PREFIXES = {
    "k": (1e3, "·10³"),
    "": (1.0, ""),
    "m": (1e-3, "·10⁻³"),
    "µ": (1e-6, "ppm"),
    "n": (1e-9, "·10⁻⁹"),
}
"""Factor of each prefix, largest first, and what replaces it before units that take no prefix."""


def in_radians(text: str) -> float:
    """The angle [rad] typed as ``8e-6``, ``8urad``, ``1.65arcsec``, ``0.5mdeg``.

    Raises:
        ValueError: it is none.
    """
    text = text.strip()
    for unit in sorted(ANGLES, key=len, reverse=True):
        if text.endswith(unit):
            return number(text.removesuffix(unit)) * ANGLES[unit]
    return number(text)


def number(text: str) -> float:
    """A typed number; ``0_06``, which Python reads as 6, is none.

    Raises:
        ValueError: it is none.
    """
    return float(text.replace("_", "?"))


def prefixed(unit: str, size: float) -> tuple[str, float]:
    """Prefixed unit in which ``size`` is 1 to 1000, and its size in SI: ``rad/m``, 1e-4 ->
    ``µrad/m``, 1e-6.
    """
    prefix = next((p for p, (factor, _) in PREFIXES.items() if 0.999 * factor <= abs(size)), "n")
    factor, power = PREFIXES[prefix]
    if re.match(r"(rad|m|N|s|Pa)(?![²³⁴\w])", unit):
        return prefix + unit, factor
    without_one = unit.removeprefix("1")
    gap = "" if without_one[:1] in ("", "/") else " "
    return f"{power}{gap}{without_one}", factor


def plain_mm(length: float) -> str:
    """[m] in mm to 0.1 µm, for a test report: ``1200.027``."""
    return f"{length / MM:z.4f}".rstrip("0").rstrip(".")


def count(number: int, noun: str) -> str:
    """``1 record``, ``12 records``."""
    return f"{number} {noun if number == 1 else f'{noun}s'}"
