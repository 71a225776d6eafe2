"""Numbers for readers in one style: lengths, shares, counts, p-values, parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Note
from aacmm_pin._support.units import LARGE_IN_MICRO, MM, UM

IN_MM = 1e-4
"""Lengths from this on are in mm, others in µm [m]."""
LEAST_P = 1e-16
"""Smaller probabilities are given as a bound."""
VALUE_FORMATS = {"mm": "z.5f", "rad": "z.7f"}
"""Formats of the values of parameters by unit."""
WORD = re.compile(r"[a-z]+(?:[-'’][a-z]+)*[,.:;]?(?!\S)")
"""A word of a sentence, and no name of a cause, parameter, column or file."""
OF_FILES = (
    "wrong_value",
    "wrong_value_or",
    "wrong_placement",
    "wrong_placement_or",
    "wrong_sign",
    "zeros_off",
    "rows_in_another_frame",
    "beyond_prediction",
)
"""Notes on mistakes in files and options, which come first."""
UNIT = re.compile(r"_(mm3|mm|deg)$")
"""Unit at the end of the name of a column."""
UNIT_SYMBOLS = {"mm3": "mm³", "mm": "mm", "deg": "°"}


def length(value: float) -> str:
    """A length [m] with three digits: ``0.312 mm``, ``52.3 µm``."""
    return lengths([value])[0]


def lengths(values: Iterable[float]) -> list[str]:
    """Lengths [m] with three digits in the unit of the largest: ``0.312 mm``, ``0.0523 mm``."""
    rounded = [float(f"{value:.3g}") for value in values]
    unit, scale = length_unit(max(map(abs, rounded)))
    most = 4 if unit == "mm" else 3
    return [f"{three_digits(value / scale, most)} {unit}" for value in rounded]


def three_digits(value: float, most: int = 3) -> str:
    """A number with three digits, and at most so many decimals."""
    if not value:
        return "0"
    exponent = int(np.floor(np.log10(abs(value)) + 1e-9))
    return f"{value:z.{min(most, max(0, 2 - exponent))}f}"


def length_unit(largest: float) -> tuple[str, float]:
    """Unit of lengths up to ``largest`` [m], and its size [m]."""
    return ("mm", MM) if largest >= IN_MM else ("µm", UM)


def in_one_unit(*frames: pd.DataFrame) -> list[pd.DataFrame]:
    """Tables with units in heads, ``before_mm`` as ``before [µm]``: lengths in mm, or all in µm if
    small.
    """
    of_length = [frame.filter(regex="_mm$") for frame in frames]
    sizes = [float(np.nanmax(np.abs(part))) for part in of_length if part.notna().any(axis=None)]
    unit, scale = length_unit(max(sizes, default=0.0) * MM)
    converted = []
    for frame, part in zip(frames, of_length, strict=True):
        heads = {name: head(str(name)) for name in frame}
        heads |= {name: heads[name].replace("[mm]", f"[{unit}]") for name in part}
        scaled = {str(name): part[name] * (MM / scale) for name in part}
        converted.append(frame.assign(**scaled).rename(columns=heads))
    return converted


def head(name: str) -> str:
    """The name of a column for readers: ``shortest_low_mm`` as ``shortest low [mm]``."""
    unit = UNIT.search(name)
    if unit is None:
        return name
    words = name[: unit.start()].replace("_", " ")
    return f"{words} [{UNIT_SYMBOLS[unit[1]]}]"


def spread(frame: pd.DataFrame, over: str) -> pd.DataFrame:
    """Smallest, median and largest finite value of each column; ``over`` names the rows."""
    numbers = frame.astype(float).replace([np.inf, -np.inf], np.nan)
    table = numbers.agg(["min", "median", "max"]).reset_index(drop=True)
    table.insert(0, over, ["smallest", "median", "largest"])
    return table


def percent(share: float, digits: int = 0) -> str:
    """A share: ``29 %``."""
    return f"{100 * share:z.{digits}f} %"


def other_notes(notes: Iterable[Note]) -> list[Note]:
    """Notes except those on mistakes in files."""
    return [note for note in notes if note.code not in OF_FILES]


def mistakes_in_words(notes: Iterable[Note]) -> str:
    """Sentences on mistakes in files, or ""."""
    return "".join(capital(f"{note}. ") for note in notes if note.code in OF_FILES)


def capital(text: str) -> str:
    """The text with a capital letter, unless it begins with a name such as ``theta_offset3``."""
    if not WORD.match(text):
        return text
    return f"{text[:1].upper()}{text[1:]}"


def p_value(value: float) -> str:
    """A p-value with one digit: ``0.03``, ``0.998``, ``< 1e-16``."""
    if value > 0.9:
        return f"{1.0 - float(f'{1.0 - value:.1g}'):g}"
    return f"{value:.1g}" if value > LEAST_P else f"< {LEAST_P:g}"


def p_equals(value: float) -> str:
    """``p = 0.03``, ``p < 1e-16``."""
    return f"p = {p_value(value)}".replace("= <", "<")


def quantity(value: float, unit: str) -> str:
    """A parameter [SI] with all digits: ``700.95000 mm``, ``0.0100000 rad``."""
    if unit == "m":
        value, unit = value / MM, "mm"
    form = VALUE_FORMATS.get(unit, ".6g")
    return f"{value:{form}} {unit}".removesuffix(" 1")


def small(value: float, unit: str, expanded: float = np.nan) -> str:
    """A change or uncertainty [SI] in its small unit, perhaps ± its expanded uncertainty U with two
    digits: ``30 µm``, ``27.1 µrad``, ``13.5 ± 6.0 µm``.
    """
    if unit in ("m", "mm"):
        name, factor = "µm", 1e3 if unit == "mm" else 1e6
    elif unit.startswith("rad"):
        name, factor = f"µ{unit}", 1e6
    else:
        name, factor = f"ppm{unit.removeprefix('1')}", 1e6
    largest = expanded if expanded > 0.0 else value
    if name[0] == "µ" and abs(largest) * factor >= LARGE_IN_MICRO:
        name, factor = f"m{name[1:]}", factor / 1e3
    if not expanded > 0.0:
        return f"{value * factor:.4g} {name}"
    digits = max(0, 1 - int(np.floor(np.log10(expanded * factor))))
    return f"{value * factor:z.{digits}f} ± {expanded * factor:.{digits}f} {name}"


def vector(values: Iterable[float], form: str = "z.4g") -> str:
    """``(0, 0, -9.81)``."""
    numbers = [f"{round(value, 12):{form}}" for value in values]
    return f"({', '.join(numbers)})"
