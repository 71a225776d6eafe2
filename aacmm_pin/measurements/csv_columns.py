"""Columns of measurement and acceptance files."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Literal

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import RANGES
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.effects import CONDITION_ENTRIES, Covariate

AngleUnit = Literal["deg", "rad"]

SI_OF_UNIT = {"mm": MM, "°": DEG}
NUMBER_IN_NAME = "(0|[1-9][0-9]*)"
"""Numbers in place of #."""


@dataclass(frozen=True)
class Column:
    """Columns of one quantity or label.

    Attributes:
        field: attribute of measurements, conditions or probed points; "" for
            :attr:`aacmm_pin.Measurements.extra`.
        names: one for each component; # stands for the numbers 1, 2, … of joints (temperatures: DH
            rows).
        covariate: what residuals are compared with: ``anywhere``: translations of the tip,
            rotations of joints, lengths; ``joints``: all but lengths; ``groups``: exclusion of
            records with one label; ``none``. Excluded records are compared with all but ``none``.
        unit: of the file; "" for labels.
        range: possible numbers in SI; None for any.
        may_be_empty: whether a number may be missing; a label always may.
        above_zero: whether zero is invalid.
        of_reference: whether it describes the reference, not where the readings put the tip.
    """

    field: str
    names: tuple[str, ...]
    covariate: Covariate
    unit: str = ""
    range: Range | None = None
    may_be_empty: bool = False
    above_zero: bool = False
    of_reference: bool = False

    @property
    def is_label(self) -> bool:
        """Whether cells are text."""
        return not self.unit

    @property
    def is_numbered(self) -> bool:
        """Whether each joint or row has one."""
        return "#" in self.names[0]

    @property
    def is_direction(self) -> bool:
        """Whether they form a unit vector or quaternion."""
        return self.unit == "1" and len(self.names) > 1

    @property
    def si(self) -> float:
        """One unit of the file in SI."""
        return SI_OF_UNIT.get(self.unit, 1.0)

    @property
    def range_in_file(self) -> Range | None:
        """In the unit of the file."""
        if self.range is None or self.si == 1.0:
            return self.range
        return self.range.of_unit(self.unit, self.si)

    def has(self, name: str) -> bool:
        """Whether ``name`` is one of its columns."""
        if self.is_numbered:
            return number_in(name, self.names[0]) is not None
        return name in self.names

    def among(self, names: Collection[str]) -> list[str]:
        """Its columns among ``names``, in order."""
        if self.is_numbered:
            return sorted(filter(self.has, names), key=lambda name: (len(name), name))
        return [name for name in self.names if name in names]

    def quantity(self, name: str) -> str:
        """The quantity of a column, such as ``torque 2``; else its name."""
        if not self.field:
            return name
        number = number_in(name, self.names[0]) if self.is_numbered else None
        return f"{self.field} {number}" if number else self.field


def _condition(field: str) -> Column:
    column = CONDITION_ENTRIES[field]
    return Column(
        field,
        column.names,
        column.covariate,
        column.unit,
        column.range or RANGES.get(column.unit),
        may_be_empty=len(column.names) > 1,
        of_reference=column.of_reference,
    )


THETA: dict[AngleUnit, str] = {"deg": "theta#_deg", "rad": "theta#_rad"}
REFERENCE = ("x_mm", "y_mm", "z_mm")
REFERENCE_U = ("u_x_mm", "u_y_mm", "u_z_mm")
ORIENTATION = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR = ("rx_rad", "ry_rad", "rz_rad")
ROLL_PITCH_YAW = ("roll_deg", "pitch_deg", "yaw_deg")
EULER = "euler_"
"""Begins the columns of angles about axes in another order."""
EULER_ORDERS = (
    *("xyx", "xyz", "xzx", "xzy", "yxy", "yxz"),
    *("yzx", "yzy", "zxy", "zxz", "zyx", "zyz"),
)
EULER_ANGLES = [tuple(f"{EULER}{order}_{angle}_deg" for angle in "abc") for order in EULER_ORDERS]
ROTATION_ORDERS: dict[tuple[str, ...], str] = {
    ROLL_PITCH_YAW: "xyz",
    **dict(zip(EULER_ANGLES, map(str.upper, EULER_ORDERS), strict=True)),
}
"""Axes for SciPy: fixed ones in lower case, rotated ones in upper case."""
ORIENTATIONS = (ORIENTATION, ROTATION_VECTOR, *ROTATION_ORDERS)
"""A file has one; quaternions are written."""
ORIENTATION_U = "u_rot_rad"
PROBE_DIRECTION = CONDITION_ENTRIES["probe_direction"].names
BAR = ("bar", "bar_end", "bar_length_mm")
BAR_U = "u_bar_length_mm"
FEATURE = "feature"
FEATURE_KIND = "feature_kind"
PLANE = "plane"
DIAMETERS = ("feature_diameter_mm", "probe_diameter_mm")
(APPROACH,) = CONDITION_ENTRIES["approach"].names
(LINK_TEMPERATURE,) = CONDITION_ENTRIES["link_temperature"].names

AT_FRONT = ("seat", "marker")
"""Conditions written beside the coordinates."""
_TURNS = plausible.MOST_TURNS * 2.0 * math.pi + 1e-9
_NO_DEGREES = "degrees, in columns theta1_deg …"
_LENGTH = (plausible.BAR_LENGTH, True)
_LENGTH_U = (plausible.LENGTH_NOISE, True, True)
_TURN_U = (plausible.TURN_NOISE, True, True)
_FEATURE_DIAMETER = Column(
    "feature_diameter", DIAMETERS[:1], "none", "mm", plausible.DIAMETER, True, of_reference=True
)
_PROBE_DIAMETER = Column(
    "probe_diameter", DIAMETERS[1:], "none", "mm", plausible.PROBE_DIAMETER, True, of_reference=True
)
_ONE_TURN = 2.0 * math.pi + 1e-9
_TURN = Range(-_ONE_TURN, _ONE_TURN, "rad", "degrees")
_ORIENTATION_COLUMNS = (
    Column("orientation", ROTATION_VECTOR, "none", "rad", _TURN, True, of_reference=True),
    *(
        Column("orientation", form, "none", "°", _TURN, True, of_reference=True)
        for form in ROTATION_ORDERS
    ),
)
DEGREES = Column("q", (THETA["deg"],), "none", "°", plausible.READING)
RADIANS = Column("q", (THETA["rad"],), "none", "rad", Range(-_TURNS, _TURNS, "rad", _NO_DEGREES))
READING_COLUMNS = (DEGREES, RADIANS)
RECORD_COLUMNS = (
    Column("reference", REFERENCE, "none", "mm", plausible.COORDINATE, True, of_reference=True),
    Column("reference_u", REFERENCE_U, "none", "mm", *_LENGTH_U, of_reference=True),
    Column("orientation", ORIENTATION, "none", "1", may_be_empty=True, of_reference=True),
    Column("orientation_u", (ORIENTATION_U,), "none", "rad", *_TURN_U, of_reference=True),
    *map(_condition, AT_FRONT),
    Column("bar", ("bar",), "groups", of_reference=True),
    Column("bar_end", ("bar_end",), "none", of_reference=True),
    Column("bar_length", ("bar_length_mm",), "none", "mm", *_LENGTH, of_reference=True),
    Column("bar_length_u", (BAR_U,), "none", "mm", *_LENGTH_U, of_reference=True),
    _FEATURE_DIAMETER,
    _PROBE_DIAMETER,
    Column("feature_kind", (FEATURE_KIND,), "none", of_reference=True),
    *(_condition(name) for name in CONDITION_ENTRIES if name not in AT_FRONT),
    Column("operator", ("operator",), "joints"),
    Column("record", ("record",), "none"),
)
"""Columns of a measurement file besides the angles, in the order of writing.

Others are kept unchanged, as covariates that may act anywhere.
"""
PROBED_POINT_COLUMNS = (
    Column("feature", (FEATURE,), "none"),
    Column("test", ("test",), "none"),
    Column("position", ("position",), "none"),
    Column("repeat", ("repeat",), "none"),
    Column("length_id", ("length_id",), "none"),
    Column("part", ("part",), "none"),
    _FEATURE_DIAMETER,
    Column("length", ("length_mm",), "none", "mm", *_LENGTH),
    Column("u_length", ("u_length_mm",), "none", "mm", plausible.LENGTH_NOISE, True),
    _PROBE_DIAMETER,
)
"""Further ones of an acceptance file."""
RELATION_COLUMNS = (
    Column("a", ("feature_a",), "none"),
    Column("b", ("feature_b",), "none"),
    Column("distance", ("distance_mm",), "none", "mm", plausible.COORDINATE, True),
    Column("distance_u", ("u_distance_mm",), "none", "mm", *_LENGTH_U),
    Column("angle", ("angle_deg",), "none", "°", Range(0.0, math.pi, "rad")),
    Column("angle_u", ("u_angle_deg",), "none", "°", plausible.TURN_NOISE, above_zero=True),
)
LABELS = tuple(
    column.names[0] for column in RECORD_COLUMNS if column.is_label and column.covariate != "none"
)
"""Labels on which errors of records may depend."""
UNKNOWN_COLUMN = Column("", ("",), "anywhere")
PLANNED = "planned_"
"""Begins columns that a procedure planned, which are no conditions."""

MEASUREMENT_FILE = (*READING_COLUMNS, *RECORD_COLUMNS, *_ORIENTATION_COLUMNS)
ACCEPTANCE_FILE = (*MEASUREMENT_FILE, *PROBED_POINT_COLUMNS)


def columns_of_file(header: Iterable[object]) -> tuple[Column, ...]:
    """Columns that a file with this header may have."""
    return ACCEPTANCE_FILE if "test" in {str(name).lower() for name in header} else MEASUREMENT_FILE


def single_names(columns: Iterable[Column]) -> tuple[str, ...]:
    """Names without #."""
    names = (column.names for column in columns if not column.is_numbered)
    return tuple(chain.from_iterable(names))


def numbered_forms(columns: Iterable[Column]) -> tuple[str, ...]:
    """Names with #."""
    return tuple(column.names[0] for column in columns if column.is_numbered)


def column_of(name: object, columns: Iterable[Column] = MEASUREMENT_FILE) -> Column:
    """The entry of a name, or :data:`UNKNOWN_COLUMN`."""
    return next((column for column in columns if column.has(str(name))), UNKNOWN_COLUMN)


def is_reading(name: object) -> bool:
    """Whether it is a column of angles."""
    return column_of(name, READING_COLUMNS) in READING_COLUMNS


def named(form: str, count: int) -> list[str]:
    """``form`` with the numbers 1 … ``count``."""
    numbers = map(str, range(1, count + 1))
    return [form.replace("#", number) for number in numbers]


def number_in(name: str, form: str) -> str | None:
    """The number in a name of this form, as text: Python refuses thousands of digits."""
    match = re.fullmatch(form.replace("#", NUMBER_IN_NAME), name)
    return match[1] if match else None


def span(names: Sequence[str]) -> str:
    """First and last of ``names``."""
    if len(names) == 1:
        return names[0]
    return f"{names[0]} … {names[-1]}"
