"""Plausible numbers for files, options and Python.

Beyond them a number is in another unit, or of no arm; within them nothing overflows.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field, FiniteFloat

from aacmm_pin._support.units import MM, count
from aacmm_pin.errors import AacmmError

LONGEST_LENGTH = 100.0
"""[m]"""
FARTHEST_PLACE = 1e6
"""Along an axis [m]: the common normal of nearly parallel axes is far away. There rounding moves
the tip by 0.1 nm.
"""
REACH_POSTURES = 32
"""Spread postures to estimate the reach."""
SMALLEST_ARM = 1e-6
"""Sum of its lengths [m]."""
LARGEST_ANGLE = 1e4 * 2.0 * math.pi
"""[rad]; a wide limit stands for none."""
MOST_TURNS = 5
"""Limits and readings beyond it are taken for degrees."""
LARGEST_DEGREES = 720.0
"""Angles beyond it are no degrees; wider limits in a URDF stand for none."""
MOST_TYPICAL = 1e3
"""Largest parameter over the usual value on a measuring arm."""
LARGEST_U_RATIO = 1e5
"""Over the usual value."""
LATEST = 1e12
"""[s]; since 1970 it is the year 33 000."""
COLDEST, HOTTEST = -100.0, 200.0
"""[°C]"""
MOST_ROWS = 200
"""Joints and rigid parts."""
MOST_JOINTS = 64
"""Of joints that move the tip."""
MOST_COUPLINGS = 200
"""A joint has a few."""
MOST_RATIO = 1e4
"""Of joint angle per reading; gears have a hundredth."""


class Range(NamedTuple):
    """Possible values in ``unit``; ``perhaps`` names the unit of others."""

    least: float
    most: float
    unit: str
    perhaps: str = ""

    def outside(self, values: ArrayLike) -> NDArray[np.bool_]:
        """Which values are impossible; NaN is possible."""
        array = np.asarray(values, dtype=np.float64)
        return (array < self.least) | (array > self.most)

    def of_unit(self, unit: str, factor: float) -> Range:
        """In another unit of size ``factor``."""
        least, most = self.least / factor, self.most / factor
        return Range(least, most, unit, self.perhaps)

    @property
    def expected(self) -> str:
        """As text of an error."""
        values = f"{self.least:.6g} to {self.most:.6g} {self.unit}"
        perhaps = f" (perhaps {self.perhaps})" if self.perhaps else ""
        return f"expected {values}; check the unit{perhaps}"

    def check(self, values: ArrayLike, name: str, error: type[AacmmError] = AacmmError) -> None:
        """Refuse values outside, and NaN.

        Raises:
            AacmmError: of class ``error``, with the first value.
        """
        array: NDArray[Any] = np.asarray(values, dtype=np.float64)
        if array.size and self.least <= array.min() and array.max() <= self.most:  # NaN is neither
            return
        wrong = np.argwhere(self.outside(array) | np.isnan(array))
        if len(wrong):
            place = f"[{', '.join(map(str, wrong[0]))}]" if array.ndim else ""
            raise error(f"{name}{place} is {array[tuple(wrong[0])]:g} {self.unit}; {self.expected}")


READING = Range(-LARGEST_ANGLE, LARGEST_ANGLE, "rad")
COORDINATE = Range(-LONGEST_LENGTH, LONGEST_LENGTH, "m")
BAR_LENGTH = Range(0.01, LONGEST_LENGTH, "m", "metres")
DIAMETER = Range(1e-3, 1.0, "m")
"""Of a sphere."""
PROBE_DIAMETER = Range(0.0, 0.1, "m")
MPE = Range(1e-9, 1.0, "m")
"""Of a length or a position."""
TEMPERATURE = Range(COLDEST, HOTTEST, "°C", "kelvin or Fahrenheit")
CLOCK = Range(-LATEST, LATEST, "s")
TORQUE = Range(-1e6, 1e6, "N·m")
ENCODER_NOISE = Range(0.0, 5e-3, "rad")
"""Standard uncertainty of a reading [rad; m for prismatic joints]."""
SHIFT_HALF_WIDTH = Range(0.0, 1.0, "m")
TURN_HALF_WIDTH = Range(0.0, math.pi, "rad")
"""Of the placement of a joint; half a turn if unknown."""
WIDEST_HALF_WIDTHS = {"m": 0.012, "rad": 0.12}
"""Wider ones of geometry may be in another unit; U of unstated geometry is 11.5 mm and 0.115
rad.
"""
LENGTH_NOISE = Range(0.0, 0.01, "m")
"""Standard uncertainty of a reference, contact, or length of a bar."""

ROTATION_NOISE = Range(0.0, 0.1, "rad")
"""Standard uncertainty about each axis: laser tracker 5e-5, camera 1e-3."""
USUAL_ROTATION_NOISE = 5e-3
"""A note asks from here whether it is in degrees [rad]."""

LARGEST_COUNTS = {
    "cells": (4_000_000, "4 GB of memory"),
    "count": (400_000, "4 GB of memory"),
    "draws": (4_000_000, "4 GB of memory"),
    "most_starts": (1_000_000, "4 GB of memory"),
    "postures": (400_000, "4 GB of memory"),
    "records": (800_000, "4 GB of memory"),
    "records of a plan": (10_000, "1 hour"),
    "runs": (100_000, "0.5 GB of memory"),
    "seats": (20_000, "4 GB of memory"),
    "sectors": (2_500, "4 GB of memory"),
    "workers": (256, "40 GB of memory"),
}
"""With the memory or time for so many, measured with SINO6."""


def without_nul(value: str) -> str:
    """Refuse a character NUL."""
    if "\0" in value:
        raise ValueError(
            f"the character NUL at place {value.index(chr(0)) + 1}; expected text without NUL"
        )
    return value


def in_one_line(value: str) -> str:
    """Refuse a line end, which would forge output."""
    if value.splitlines() != [value]:
        raise ValueError(f"{value!r}; expected one line of text")
    return value


EXPECTED = {
    "float_parsing": "a number with a decimal point",
    "float_type": "a number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "string_type": "text",
    "string_pattern_mismatch": "text of the form {pattern}",
    "too_long": "at most {max_length} entries",
    "too_short": "at least {min_length} entries",
    "json_invalid": "numbers in brackets",
    "tuple_type": "an array, such as [] or [0.5]",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than_equal": "{le:g} or less",
}
"""By pydantic's code of the problem."""


def expected_words(problem: Any) -> str:
    """What pydantic expected, by one of its ``errors()``."""
    words = EXPECTED.get(problem["type"])
    if words is None:
        return re.sub(r"^\w+ should (be|have) ", "", problem["msg"])
    return words.format(**problem.get("ctx", {}))


NonNegative = Annotated[FiniteFloat, Field(ge=0.0)]


def out_of_reach(tips: ArrayLike) -> str:
    """A sentence if ``tips`` (n, 3) [m] are farther than any arm reaches, else ""."""
    distance = float(np.linalg.norm(tips, axis=1).max())
    if distance <= LONGEST_LENGTH:
        return ""
    return (
        f"the tip is up to {distance:.4g} m from the base; expected {LONGEST_LENGTH:g} m at "
        "most; check the units"
    )


def like_degrees(angle: float, turns: int = MOST_TURNS) -> str:
    """A sentence if [rad] beyond so many turns must be degrees, else ""."""
    if abs(angle) <= turns * 2 * math.pi + 1e-9:
        return ""
    return (
        f"is {angle:g} rad, which is more than {count(turns, 'turn')} and looks like degrees; "
        "expected radians"
    )


def mostly_like_degrees(angles: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of ``angles`` (n, joints) [rad] exceed :data:`MOST_TURNS`; none if few joints do: an
    endless joint may count turns.
    """
    beyond = np.abs(angles) > MOST_TURNS * 2 * math.pi + 1e-9
    joints = np.count_nonzero(angles.any(axis=0))
    return beyond & (2 * np.count_nonzero(beyond.any(axis=0)) > joints)


LengthMm = Annotated[FiniteFloat, Field(ge=-LONGEST_LENGTH / MM, le=LONGEST_LENGTH / MM)]
PlaceMm = Annotated[FiniteFloat, Field(ge=-FARTHEST_PLACE / MM, le=FARTHEST_PLACE / MM)]
"""Along an axis [mm]."""
Angle = Annotated[FiniteFloat, Field(ge=-LARGEST_ANGLE, le=LARGEST_ANGLE)]
"""[rad]."""
AngleHalfWidth = Annotated[FiniteFloat, Field(ge=0.0, le=TURN_HALF_WIDTH.most)]
"""[rad]; half a turn if unknown."""
EncoderNoise = Annotated[FiniteFloat, Field(ge=ENCODER_NOISE.least, le=ENCODER_NOISE.most)]
"""[rad; m for prismatic joints]."""
EncoderNoiseMm = Annotated[
    FiniteFloat, Field(ge=ENCODER_NOISE.least / MM, le=ENCODER_NOISE.most / MM)
]
"""Of a prismatic joint [mm]."""
StandardUncertainty = Annotated[FiniteFloat, Field(ge=0.0, le=1e100)]
"""In SI; its square must be a number, large for a poor fit."""
Mass = Annotated[FiniteFloat, Field(ge=0.0, le=1e5)]
"""[kg]."""
Acceleration = Annotated[FiniteFloat, Field(ge=-100.0, le=100.0)]
"""Component of gravity [m/s²]."""
TemperatureC = Annotated[FiniteFloat, Field(ge=COLDEST, le=HOTTEST)]
"""[°C]."""
Name = Annotated[
    str,
    Field(min_length=1, max_length=200),
    AfterValidator(without_nul),
    AfterValidator(in_one_line),
]
"""Of an arm, a seat, a target or a cause."""
Text = Annotated[str, Field(max_length=10_000), AfterValidator(without_nul)]
"""For people."""
