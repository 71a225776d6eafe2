"""Columns of measurement and acceptance files, and mistakes in their names."""

from __future__ import annotations

import difflib
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, Literal

from aacmm_pin._support import plausible
from aacmm_pin._support.file_problems import Problems, first_few, shortened
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import count
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


# --- mistakes in a header

SPELLING_SIMILARITY = 0.9
"""Similarity (difflib) of a misspelt name: one wrong letter in ten."""
OF_ANGLES = ("deg", "rad", "mrad", "gon", "arcsec")
OTHER_UNITS = {*OF_ANGLES, "m", "cm", "um", "µm", "in", "inch", "k", "f", "ms", "min", "nmm"}
SPELLED = {"°c": "c", "°": "deg", "θ": "theta"}


def check_header(names: Sequence[object], nq: int | None, problems: Problems) -> None:
    """Check the columns of a measurement file; ``nq`` joints, or any for None.

    Raises:
        MeasurementFileError: a name is missing, repeated, misspelt, or needs another column.
    """
    texts = checked_names(names, MEASUREMENT_FILE, problems)
    degrees, radians = (column.among(texts) for column in READING_COLUMNS)
    if degrees and radians:
        came = (
            f"{', '.join(map(shortened, degrees))} are in degrees, and "
            f"{', '.join(map(shortened, radians))} in radians"
        )
        problems.add("", f"{came}; expected one unit for all joints")
        problems.stop()
    theta = degrees or radians
    joints = len(theta)
    for column in MEASUREMENT_FILE:
        present = column.among(texts) if column.is_numbered else []
        (form, *_) = column.names
        of_each_joint = joints and form not in (LINK_TEMPERATURE, *THETA.values())
        expected = named(form, joints if of_each_joint else len(present))
        if present and present != expected:
            for_each_joint = f", one for each of the {joints} joints" if of_each_joint else ""
            missing = [name for name in expected if name not in present]
            remedy = f"; add {missing[0]}" if missing else ""
            problems.add(
                span(present),
                f"the columns are {first_few(map(shortened, present))}; expected numbers from 1 "
                f"without a gap{for_each_joint}{remedy}",
            )
    if not joints:
        came = first_few(map(repr, names)) or "nothing"
        problems.add(
            "",
            f"no angles; expected columns theta1_deg … or theta1_rad …; the header has {came}; "
            "configurations computes the angles of a pose",
        )
    elif nq is not None and joints != nq:
        all_joints = span(named(THETA["rad" if radians else "deg"], nq))
        problems.add(
            span(theta),
            f"the file has angles of {joints} joints; expected {all_joints}, because the arm has "
            f"{count(nq, 'joint')}",
        )
    _check_companions({*texts}, problems)
    row_temperatures = column_of(LINK_TEMPERATURE.replace("#", "1")).among(texts)
    if row_temperatures and "temperature_c" in texts:
        problems.add(
            "temperature_c",
            f"stated together with {span(row_temperatures)}; expected either temperature_c for "
            "the whole arm, or one column for each DH row",
        )
    if 0 < len(row_temperatures) < joints:
        problems.add(
            span(row_temperatures),
            f"{len(row_temperatures)} columns; expected {joints} or more, one for each DH row; for "
            "the whole arm use temperature_c",
        )
    problems.stop()


def checked_names(
    names: Sequence[object], columns: Sequence[Column], problems: Problems
) -> list[str]:
    """The names as text, known names in place of similar ones; mistakes go to ``problems``."""
    texts = [name if isinstance(name, str) else "" for name in names]
    for number, name in enumerate(names, start=1):
        if not isinstance(name, str) or not name.strip():
            came = "no name" if isinstance(name, str) else f"the name {name!r}"
            expected = "expected a name for each column"
            problems.add("", f"column {number} of {len(names)} has {came}; {expected}")
    for name, times in Counter(texts).items():
        if times > 1 and name.strip():
            problems.add(name, f"{times} columns have this name; expected each name once")
    unknown = [name for name in dict.fromkeys(texts) if column_of(name, columns) is UNKNOWN_COLUMN]
    meant = {name: near_miss(name, texts, columns) or name for name in unknown}
    for name, intended in meant.items():
        if intended != name:
            unit = column_of(intended, columns).unit
            in_unit = f" with numbers in {unit}" if unit else ""
            problems.add(
                name,
                f"unknown name; expected {shortened(intended)}{in_unit}; rename the column, or use "
                "a less similar name if it has other values",
            )
    return list(dict.fromkeys(meant.get(name, name) for name in texts))


def near_miss(name: str, present: Sequence[str], columns: Sequence[Column]) -> str | None:
    """The name or form that was meant: the same letters, or a missing one that is similar or has
    another unit; else None.
    """
    # A reference or an orientation would be lost in silence.
    with_unit = f"{name.lower()}_mm"
    if with_unit in REFERENCE and with_unit not in present:
        return with_unit
    if name.lower().startswith(EULER):
        return f"{EULER}ORDER_a_deg (or b, c) with ORDER {', '.join(EULER_ORDERS)}"
    possible = single_names(columns)
    if digits := re.search("[0-9]+", name):
        number = digits[0].lstrip("0") or "0"
        possible = tuple(form.replace("#", number) for form in numbered_forms(columns))
    by_letters = {_letters(other): other for other in possible}
    if _letters(name) in by_letters:
        return by_letters[_letters(name)]
    present_stems = {_stem(other) for other in possible if other in present}
    missing = {
        letters: other for letters, other in by_letters.items() if _stem(other) not in present_stems
    }
    if name.rpartition("_")[2] in OTHER_UNITS:
        for other in missing.values():
            if _stem(other) == _stem(name):
                return other
    close = difflib.get_close_matches(_letters(name), missing, n=1, cutoff=SPELLING_SIMILARITY)
    return missing[close[0]] if close else None


def similar_labels(labels: Iterable[str]) -> list[str]:
    """Pairs that differ only in case, other signs, leading zeros, or ``.0``."""
    spellings: dict[str, list[str]] = {}
    for label in filter(None, labels):
        key = re.sub(r"\.0$|[\W_]|(?<!\d)0+(?=\d)", "", label.casefold())
        spellings.setdefault(key, []).append(label)
    return [f"{same[0]!r} and {same[1]!r}" for same in spellings.values() if len(same) > 1]


def _stem(name: str) -> str:
    """The name without its unit."""
    return name.rpartition("_")[0] or name


def _letters(name: str) -> str:
    text = name.casefold()
    for sign, letters in SPELLED.items():
        text = text.replace(sign, letters)
    return "".join(c for c in text if c.isalnum())


def _check_companions(names: set[str], problems: Problems) -> None:
    groups = [column.names for column in MEASUREMENT_FILE if len(column.names) > 1]
    for group in (*groups, BAR):
        present = [column for column in group if column in names]
        missing = [column for column in group if column not in names]
        if present and missing:
            expected = f"expected all of {', '.join(group)}"
            problems.add(
                ", ".join(missing), f"missing, but the file has {', '.join(present)}; {expected}"
            )
    forms = [form for form in ORIENTATIONS if names.intersection(form)]
    if len(forms) > 1:
        problems.add(
            ", ".join(map(span, forms)),
            "orientations in two forms; expected one of these forms",
        )
    needs = {REFERENCE_U[0]: REFERENCE, ORIENTATION_U: (*forms, *ORIENTATIONS)[0]}
    for u, values in needs.items():
        if u in names and not names.intersection(values):
            problems.add(u, f"uncertainty without values; expected also {', '.join(values)}")
    if names.intersection(BAR) and "seat" not in names:
        problems.add(
            "seat",
            "missing, but the file has bar; expected the label of the seat at each end of a bar",
        )
