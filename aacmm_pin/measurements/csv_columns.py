"""Columns of measurement and acceptance files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, Literal

from aacmm_pin._support import plausible
from aacmm_pin._support.plausible import Range
from aacmm_pin.effects import CONDITION_ENTRIES
from aacmm_pin.effects import Column as Column

AngleUnit = Literal["deg", "rad"]


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
"""Written beside the coordinates."""
_TURNS = plausible.MOST_TURNS * 2.0 * math.pi + 1e-9
_NO_DEGREES = "degrees, in columns theta1_deg …"
_ONE_TURN = 2.0 * math.pi + 1e-9
_TURN = Range(-_ONE_TURN, _ONE_TURN, "rad", "degrees")


def _reference(
    field: str, names: tuple[str, ...], unit: str = "", range: Range | None = None, **more: Any
) -> Column:
    """Columns of reference data, which a record may lack."""
    return Column(field, names, "none", unit, range, may_be_empty=True, of_reference=True, **more)


_FEATURE_DIAMETER = _reference("feature_diameter", DIAMETERS[:1], "mm", plausible.DIAMETER)
_PROBE_DIAMETER = _reference("probe_diameter", DIAMETERS[1:], "mm", plausible.PROBE_DIAMETER)
_ORIENTATION_COLUMNS = (
    _reference("orientation", ROTATION_VECTOR, "rad", _TURN),
    *(_reference("orientation", form, "°", _TURN) for form in ROTATION_ORDERS),
)
DEGREES = Column("q", (THETA["deg"],), "none", "°", plausible.READING)
RADIANS = Column("q", (THETA["rad"],), "none", "rad", Range(-_TURNS, _TURNS, "rad", _NO_DEGREES))
READING_COLUMNS = (DEGREES, RADIANS)
RECORD_COLUMNS = (
    _reference("reference", REFERENCE, "mm", plausible.COORDINATE),
    _reference("reference_u", REFERENCE_U, "mm", plausible.LENGTH_NOISE, above_zero=True),
    _reference("orientation", ORIENTATION, "1"),
    _reference("orientation_u", (ORIENTATION_U,), "rad", plausible.ROTATION_NOISE, above_zero=True),
    *map(CONDITION_ENTRIES.__getitem__, AT_FRONT),
    Column("bar", ("bar",), "groups", of_reference=True),
    _reference("bar_end", ("bar_end",)),
    _reference("bar_length", ("bar_length_mm",), "mm", plausible.BAR_LENGTH),
    _reference("bar_length_u", (BAR_U,), "mm", plausible.LENGTH_NOISE, above_zero=True),
    _FEATURE_DIAMETER,
    _PROBE_DIAMETER,
    _reference("feature_kind", (FEATURE_KIND,)),
    *(column for name, column in CONDITION_ENTRIES.items() if name not in AT_FRONT),
    Column("operator", ("operator",), "joints"),
    Column("record", ("record",), "none"),
)
"""Columns of a measurement file besides the angles, in the order of writing.

Others are kept unchanged, as covariates that may act anywhere.
"""
PROBED_POINT_LABELS = (FEATURE, "test", "position", "repeat", "length_id", "part")
PROBED_POINT_COLUMNS = (
    *(Column(name, (name,), "none") for name in PROBED_POINT_LABELS),
    _FEATURE_DIAMETER,
    Column("length", ("length_mm",), "none", "mm", plausible.BAR_LENGTH, True),
    Column("u_length", ("u_length_mm",), "none", "mm", plausible.LENGTH_NOISE, True),
    _PROBE_DIAMETER,
)
"""Further ones of an acceptance file."""
RELATION_COLUMNS = (
    Column("a", ("feature_a",), "none"),
    Column("b", ("feature_b",), "none"),
    Column("distance", ("distance_mm",), "none", "mm", plausible.COORDINATE, True),
    Column("distance_u", ("u_distance_mm",), "none", "mm", plausible.LENGTH_NOISE, True, True),
    Column("angle", ("angle_deg",), "none", "°", Range(0.0, math.pi, "rad")),
    Column("angle_u", ("u_angle_deg",), "none", "°", plausible.ROTATION_NOISE, above_zero=True),
)
LABELS = tuple(
    column.names[0] for column in RECORD_COLUMNS if column.is_label and column.covariate != "none"
)
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


def span(names: Sequence[str]) -> str:
    """First and last of ``names``."""
    if len(names) == 1:
        return names[0]
    return f"{names[0]} … {names[-1]}"
