"""The cells of a measurement or acceptance file as numbers, in its units, and labels; checks of
units of angles, references, seats and bars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.arrays import MOST_LENGTH_ERROR, Array, is_no_unit
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.plausible import Range
from aacmm_pin.measurements.csv_columns import (
    APPROACH,
    BAR_U,
    DEGREES,
    DIAMETERS,
    FEATURE_KIND,
    MEASUREMENT_FILE,
    ORIENTATION,
    ORIENTATIONS,
    PLANE,
    PROBE_DIRECTION,
    REFERENCE,
    ROLL_PITCH_YAW,
    ROTATION_VECTOR,
    THETA,
    Column,
    check_header,
    column_of,
    named,
    span,
)

ENOUGH_RECORDS = 5
ENOUGH_ANGLES = 10
"""Angles of a joint that show rounding."""
COARSE_DECIMALS = 4
"""Rounding to more adds less than the noise of an encoder."""
WHOLE_TOLERANCE = 1e-6
"""Of a whole number of steps."""
LEAST_PART_IN_ONE_TURN = 0.75
"""Part of the angles within ±2π from which on degrees may be radians."""
SIGNS = (-1.0, 0.0, 1.0)
BAR_ENDS = ("A", "B")
FEWEST_CONTACTS = 4
"""Least contacts of a surface: three determine it, and nothing else."""

Cells = NDArray[np.object_]
"""(n,) of str; "" where there is nothing."""


@dataclass(frozen=True, eq=False)
class Values:
    """The n rows of a table by column, each (n,): numbers in units of the file, and text."""

    n: int
    columns: dict[str, NDArray[Any]]

    def block(self, names: Sequence[str]) -> Array:
        """Columns side by side, (n, len(names)); NaN for a missing one."""
        missing = np.full(self.n, np.nan)
        return np.column_stack([self.columns.get(name, missing) for name in names])

    def label(self, name: str) -> Cells:
        """A column; "" if missing."""
        return self.columns.get(name, np.full(self.n, "", dtype=object))

    def names(self, quantity: Column) -> list[str]:
        """The present columns of a quantity."""
        return quantity.among(self.columns)

    def in_si(self, quantity: Column) -> NDArray[Any] | None:
        """Numbers in SI, or labels, (n,) or (n, columns); None for an absent quantity."""
        names = self.names(quantity)
        if not names:
            return None
        if quantity.is_label:
            return self.columns[names[0]]
        numbers = self.block(names) * quantity.si
        return numbers if quantity.is_numbered or len(names) > 1 else numbers[:, 0]


def read_values(table: pd.DataFrame, columns: Sequence[Column], problems: Problems) -> Values:
    """The cells of known ``columns``, each number in its range; mistakes go to ``problems``.

    Raises:
        MeasurementFileError: a cell is no number.
    """
    values = Values(len(table), {})
    for name in table.columns:
        entry = column_of(name, columns)
        cells = cells_of(table[name])
        is_label = entry.is_label
        values.columns[name] = cells if is_label else _numbers(name, cells, entry, problems)
    problems.stop()
    for entry in columns:
        names = values.names(entry)
        if names and not entry.is_label:
            check_numbers(entry, names, values.block(names), entry.range_in_file, problems)
    return values


def cells_of(column: pd.Series) -> Cells:
    """Cells as unchanged text; "" if empty."""
    stated = column.astype(object).where(column.notna(), "")
    return np.array([*map(str, stated)], dtype=object)


def _numbers(name: str, cells: Cells, column: Column, problems: Problems) -> Array:
    """Cells as numbers, NaN if empty, infinite if invalid."""
    stripped = pd.Series(cells, dtype=object).str.strip()
    numbers = np.array(pd.to_numeric(stripped, errors="coerce"), dtype=np.float64)
    is_empty = (stripped == "").to_numpy()
    is_unreadable = ~np.isfinite(numbers) & ~is_empty
    problems.at(is_unreadable, name, "{!r}; expected a finite number with a decimal point", cells)
    numbers[is_unreadable] = np.inf
    if not column.may_be_empty:
        problems.at(is_empty, name, "empty cell or NaN; expected a number in each row")
    return numbers


def check_numbers(
    column: Column,
    names: Sequence[str],
    numbers: Array,
    valid: Range | None,
    problems: Problems,
) -> None:
    """Check numbers (n, k) of k ``names``; the ``valid`` range is in their unit."""
    stated = ~np.isnan(numbers)
    is_partial = stated.any(axis=1) & ~stated.all(axis=1)
    for k, name in enumerate(names):
        values = numbers[:, k]
        if column.above_zero:
            expected = "expected a standard uncertainty above 0"
            problems.at(values == 0.0, name, f"{{:g}}; {expected}", values)
        if valid is not None:
            message = f"{{:.6g}} {valid.unit}; {valid.expected}"
            outside = valid.outside(values) & np.isfinite(values)
            problems.at(outside, name, message, values)
        problems.at(
            is_partial & ~stated[:, k],
            name,
            f"empty cell or NaN in a row with part of {', '.join(column.names)}; expected all or "
            "none of these values",
        )
    if not column.is_direction:
        return
    length = np.linalg.norm(numbers, axis=1)
    is_no_unit_vector = is_no_unit(length) & np.isfinite(length)
    if column.names == ORIENTATION:
        problems.at(
            is_no_unit_vector,
            span(names),
            "a norm of {:.6g}; expected 1, because these are unit quaternions with the scalar "
            f"first; for other forms use {span(ROTATION_VECTOR)} or {span(ROLL_PITCH_YAW)}",
            length,
        )
    else:
        problems.at(
            is_no_unit_vector & (length > 0.0),
            span(names),
            f"a length of {{:.6g}}; expected 1 ± {MOST_LENGTH_ERROR:g}, or empty cells if there is "
            "no direction",
            length,
        )


# --- records


def read_records(table: pd.DataFrame, nq: int | None, problems: Problems) -> Values:
    """The columns of a measurement file of ``nq`` joints, or of any arm.

    Raises:
        MeasurementFileError: header or cells are invalid or contradict each other, or no records.
    """
    check_header(list(table.columns), nq, problems)
    if not len(table):
        problems.add("", "a header without records; expected one row per record")
    values = read_values(table, MEASUREMENT_FILE, problems)
    theta = values.names(DEGREES)
    degrees = values.block(theta) if theta else np.empty((0, 0))
    if looks_like_radians(degrees):
        in_radians = span(named(THETA["rad"], len(theta)))
        problems.add(
            span(theta),
            f"all angles of {len(degrees)} records lie within ±{np.abs(degrees).max():.4g}°; "
            "expected degrees, but these numbers may be radians. If they are radians, rename the "
            f"columns {in_radians}. If they are degrees, convert them to radians and use these "
            "names.",
        )
    _check_references(values, problems)
    for name in values.names(column_of(f"{APPROACH[:-1]}1")):
        sign = values.columns[name]
        problems.at(~np.isin(sign, SIGNS), name, "{:g}; expected -1, 0 or 1", sign)
    _check_features(values, problems)
    if "bar" in values.columns:
        _check_bars(values, problems)
    problems.stop()
    return values


def looks_like_radians(degrees: Array) -> bool:
    """Whether ``degrees`` (n, nq) are radians: 5 records or more, the largest from 1 to 2π.

    Measurements rotate several joints by tens of degrees.
    """
    if len(degrees) < ENOUGH_RECORDS:
        return False
    largest = np.abs(degrees).max()
    return bool(1.0 < largest <= 2.0 * np.pi)


def mostly_like_radians(degrees: Array) -> bool:
    """Whether most of ``degrees`` (n, nq) are below 2π: radians of few records, or an endless
    wrist.
    """
    sizes = np.abs(degrees[degrees != 0.0])
    if not sizes.size or sizes.max() <= 1.0:
        return False
    return bool(np.mean(sizes <= 2.0 * np.pi) >= LEAST_PART_IN_ONE_TURN)


def rounding_steps(angles: Array) -> Array:
    """Power of ten to which angles (n, nq) of each joint are rounded (nq,), or 0."""
    steps = np.zeros(angles.shape[1])
    for decimals in range(COARSE_DECIMALS, -1, -1):
        scaled = angles * 10.0**decimals
        is_whole = np.abs(scaled - np.rint(scaled)) < WHOLE_TOLERANCE
        steps[is_whole.all(axis=0)] = 10.0**-decimals
    different = pd.DataFrame(angles).nunique().to_numpy()
    return np.where(different < ENOUGH_ANGLES, 0.0, steps)


def _check_references(values: Values, problems: Problems) -> None:
    coordinates = values.block(REFERENCE)
    complete = np.isfinite(coordinates).all(axis=1)
    count = np.count_nonzero(complete)
    seat = values.label("seat")
    seats = {*seat[complete]}
    of_one_seat = len(seats) == 1 and "" not in seats
    if count > 1 and not coordinates[complete].any() and not of_one_seat:
        problems.add(
            span(REFERENCE),
            f"all {count} references are 0, 0, 0; expected the coordinates of each point; leave "
            "unknown coordinates empty; if all records are of one point, label this point in the "
            "column `seat`",
        )
    has_coordinates = np.isfinite(coordinates).any(axis=1)
    for form in ORIENTATIONS:
        has_orientation = np.isfinite(values.block(form)).all(axis=1)
        problems.at(
            has_orientation & ~has_coordinates & (seat == ""),
            span(form),
            f"an orientation without a position; expected also {span(REFERENCE)} or seat",
        )
    is_single = ~pd.Series(seat).duplicated(keep=False).to_numpy()
    problems.at(
        (seat != "") & is_single & ~has_coordinates & (values.label("bar") == ""),
        "seat",
        "only this record has the label {!r}, and it has no coordinates; expected two or more "
        "records with this label, or an empty cell",
        seat,
    )


def _check_features(values: Values, problems: Problems) -> None:
    kind = values.label(FEATURE_KIND)
    is_kind = np.isin(kind, [PLANE, ""])
    problems.at(~is_kind, FEATURE_KIND, f"{{!r}}; expected {PLANE} or an empty cell", kind)
    plane = kind == PLANE
    seat = values.label("seat")
    diameters = values.block(DIAMETERS)
    sphere, probe = np.isfinite(diameters).T
    probe &= ~plane
    problems.at(
        sphere & ~probe,
        DIAMETERS[1],
        "empty cell in a row with the diameter of a feature; expected both diameters",
    )
    has_direction = np.nan_to_num(values.block(PROBE_DIRECTION)).any(axis=1)
    problems.at(
        ~sphere & probe & ~(has_direction & (seat == "")),
        DIAMETERS[0],
        "empty cell in a row with the diameter of a probe; expected both diameters, or "
        f"{span(PROBE_DIRECTION)} in a row without feature and seat",
    )
    labels = pd.Series(seat)
    stated = np.column_stack([diameters, values.block(REFERENCE)])
    for name, numbers in zip((*DIAMETERS, *REFERENCE), stated.T, strict=True):
        problems.of_other_values(name, numbers, sphere & np.isfinite(numbers), labels, "feature")
    has_coordinates = np.isfinite(values.block(REFERENCE)).any(axis=1)
    problems.at(
        plane & (has_coordinates | sphere),
        FEATURE_KIND,
        "plane in a row with coordinates or a diameter; expected empty cells there",
    )
    problems.at(
        plane & (values.label("bar") != ""),
        "bar",
        "a bar in a row of a plane; expected an empty cell",
    )
    contacts = labels.groupby(labels).transform("size").to_numpy()
    without_coordinates = ~labels.isin(seat[has_coordinates]).to_numpy()
    features = (
        ("sphere", sphere, DIAMETERS[0], "a diameter", " without coordinates of its centre"),
        (PLANE, plane, FEATURE_KIND, PLANE, ""),
    )
    for name, rows, column, value, addition in features:
        problems.at(
            rows & (seat == ""),
            column,
            f"{value} in a row without a label in the column feature; expected a label",
        )
        problems.at(
            labels.isin(seat[rows]).to_numpy() & (seat != "") & ~rows,
            column,
            f"empty cell in a row of the {name} {{!r}}; expected {value} in all rows of this "
            f"{name}",
            seat,
        )
        problems.at(
            rows & (contacts < FEWEST_CONTACTS) & without_coordinates,
            "seat",
            f"the {name} {{!r}} has {{}} records{addition}; expected 4 or more",
            seat,
            contacts,
        )


def _check_bars(values: Values, problems: Problems) -> None:
    bar, end, seat = (values.label(name) for name in ("bar", "bar_end", "seat"))
    length, u = values.block(["bar_length_mm", BAR_U]).T
    of_bar = bar != ""
    for name, is_empty in (("seat", seat == ""), ("bar_length_mm", np.isnan(length))):
        problems.at(
            of_bar & is_empty, name, "empty cell in a row of the bar {!r}; expected a value", bar
        )
    groups = pd.Series(bar)
    for name, numbers in (("bar_length_mm", length), (BAR_U, u)):
        problems.of_other_values(name, numbers, of_bar & np.isfinite(numbers), groups, "bar")
    problems.of_other_values(
        "seat", seat, of_bar & (seat != ""), groups + "\0" + end, "end of a bar"
    )
    is_end = of_bar & np.isin(end, BAR_ENDS)
    problems.at(of_bar & ~is_end, "bar_end", "{!r}; expected A or B", end)
    ends = pd.Series(end)
    has_one_end = ends.groupby(bar).transform("nunique").to_numpy() == 1
    problems.at(
        is_end & has_one_end & ~groups.duplicated().to_numpy(),
        "bar_end",
        "the bar {!r} has records of end {} only; expected records of A and B",
        bar,
        end,
    )
    ends_of_seat = ends.groupby([bar, seat]).transform("nunique").to_numpy()
    problems.at(
        is_end & (ends_of_seat == 2) & (seat != ""),
        "seat",
        "{!r} is at both ends of the bar {!r}; expected two seats",
        seat,
        bar,
    )
