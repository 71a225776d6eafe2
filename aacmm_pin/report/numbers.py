"""Numbers as people read them, in one style: lengths, shares, counts, probabilities and p-values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM, UM

IN_MM = 1e-4
"""Lengths from here on stand in mm, smaller ones in µm [m]."""
LEAST_P = 1e-300
"""No smaller chance is told; most computer numbers do not hold one."""
DIGITS = {"mm": "z.5f", "rad": "z.7f"}
"""Formats of the values of parameters by their unit."""


def length(value: float) -> str:
    """A length [m] with three digits: ``0.312 mm``, ``52.3 µm``."""
    return lengths([value])[0]


def lengths(values: Iterable[float]) -> list[str]:
    """Lengths [m] that stand side by side, with three digits in the unit of the largest: ``0.312 mm``, ``0.0523 mm``."""
    rounded = [float(f"{value:.3g}") for value in values]
    unit, scale = length_unit(max(map(abs, rounded)))
    most = 4 if unit == "mm" else 3
    digits = [2 - int(np.floor(np.log10(abs(value / scale)) + 1e-9)) if value else 0 for value in rounded]
    return [f"{value / scale:z.{min(most, max(0, n))}f} {unit}" for value, n in zip(rounded, digits, strict=True)]


def length_unit(largest: float) -> tuple[str, float]:
    """Unit of lengths of which the largest is this [m], and one of it in metres."""
    return ("mm", MM) if largest >= IN_MM else ("µm", UM)


def in_one_unit(frame: pd.DataFrame, names: Sequence[str]) -> tuple[pd.DataFrame, dict[str, str]]:
    """Columns of lengths [m] in mm, or all in µm where all are small, which their heads say; with their formats."""
    largest = np.nanmax(np.abs(frame[list(names)].to_numpy(dtype=float)), initial=0.0)
    (unit, scale), form = length_unit(largest), ".4f" if largest >= IN_MM else ".2f"
    heads = {name: f"{name} [{unit}]" for name in names}
    scaled = frame.assign(**{name: frame[name] / scale for name in names}).rename(columns=heads)
    return scaled, dict.fromkeys(heads.values(), form)


def percent(share: float, digits: int = 0) -> str:
    """A share: ``29 %``."""
    return f"{100 * share:z.{digits}f} %"


def count(number: int, noun: str, several: str = "") -> str:
    """``1 record``, ``12 records``."""
    return f"{number} {noun if number == 1 else several or f'{noun}s'}"


def capital(text: str) -> str:
    """The text with a capital letter in front."""
    return f"{text[:1].upper()}{text[1:]}"


def p_value(value: float) -> str:
    """One digit; a chance that no computer number holds is less than the least."""
    return f"{value:.1g}" if value > LEAST_P else f"< {LEAST_P:g}"


def p_equals(value: float) -> str:
    """``p = 0.03``, ``p < 1e-300``."""
    text = p_value(value)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def quantity(value: float, unit: str) -> str:
    """The value of a parameter [SI] with all its digits: ``700.95000 mm``, ``0.0100000 rad``."""
    value, unit = (value / MM, "mm") if unit == "m" else (value, unit)
    return f"{value:{DIGITS.get(unit, '.6g')}} {unit}".removesuffix(" 1")


def small(value: float, unit: str) -> str:
    """A change or an uncertainty of a parameter [SI] in its small unit: ``30 µm``, ``27.1 µrad``."""
    name, factor = small_unit(unit)
    return f"{value * factor:.4g} {name}"


def small_unit(unit: str) -> tuple[str, float]:
    """The unit of changes of a parameter whose value has ``unit``, and how many of it make one of that."""
    if unit in ("m", "mm"):
        return "µm", 1e6 if unit == "m" else 1e3
    return ("µ" + unit if unit.startswith("rad") else "10⁻⁶" + unit.removeprefix("1")), 1e6


def vector(values: Iterable[float], form: str = "z.4g") -> str:
    """``(0, 0, -9.81)``."""
    return "(" + ", ".join(f"{round(value, 12):{form}}" for value in values) + ")"


def spread(values: Array, form: str) -> dict[str, str]:
    """Least, median and largest of some numbers as text, those that are not finite left out."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    found = (finite.min(), np.median(finite), finite.max()) if finite.size else None
    names = ("least", "median", "largest")
    return {name: f"{found[k]:{form}}" if found else "–" for k, name in enumerate(names)}
