"""What is plausible of each quantity: types that files, options and Python use alike to refuse what must be a mistake.

A number beyond these limits was stated in another unit, or is no number of an arm; inside them nothing overflows.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, Field, FiniteFloat

from aacmm_pin._support.units import MM

LONGEST = 100.0
"""Largest length, to either side [m]."""
SMALLEST_ARM = 1e-6
"""An arm whose lengths add up to less has none [m]."""
MOST_TURNS = 1e4
"""Largest angle, to either side [turns]: an encoder counts a few, a wide limit stands for none."""
LARGEST_ANGLE = MOST_TURNS * 2.0 * math.pi
"""The same [rad]."""
LARGEST_ENCODER_NOISE = 5e-3
"""Noise of an angle that no encoder has, and no robot's joint: it was stated in another unit [rad]."""
MOST_TYPICAL = 1e5
"""Parameters of causes are at most so many times as large as usual on a measuring arm."""
LATEST = 1e12
"""Largest time, to either side [s]; in seconds since 1970 it is the year 33 000."""
MOST_ROWS = 200
"""Rows of an arm, joints and rigid pieces together."""
MOST_JOINTS = 64
"""Joints that move the tip."""


def _text(value: str) -> str:
    if "\0" in value:
        raise ValueError(f"has the character NUL at place {value.index(chr(0)) + 1}, expected text without it")
    return value


NonNegative = Annotated[FiniteFloat, Field(ge=0.0)]
LengthMm = Annotated[FiniteFloat, Field(ge=-LONGEST / MM, le=LONGEST / MM)]
"""A length, or a place along an axis [mm]."""
Angle = Annotated[FiniteFloat, Field(ge=-LARGEST_ANGLE, le=LARGEST_ANGLE)]
"""[rad]."""
AngleHalfWidth = Annotated[FiniteFloat, Field(ge=0.0, le=math.pi)]
"""Bound of the error of an angle [rad]: half a turn says that nothing is known."""
EncoderNoise = Annotated[FiniteFloat, Field(ge=0.0, le=LARGEST_ENCODER_NOISE)]
"""Standard uncertainty of one reading [rad; m where a joint slides]."""
StandardUncertainty = Annotated[FiniteFloat, Field(ge=0.0, le=1e100)]
"""In SI, of whatever it is; a fit may hardly know a parameter, but its variance is a number."""
Mass = Annotated[FiniteFloat, Field(ge=0.0, le=1e5)]
"""[kg]."""
Acceleration = Annotated[FiniteFloat, Field(ge=-100.0, le=100.0)]
"""A component of the acceleration of gravity [m/s²]."""
TemperatureC = Annotated[FiniteFloat, Field(ge=-100.0, le=200.0)]
"""[°C]."""
Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_text)]
"""Of an arm, a seat, a target or a cause."""
Text = Annotated[str, Field(max_length=10_000), AfterValidator(_text)]
"""What stands in a file for people."""
