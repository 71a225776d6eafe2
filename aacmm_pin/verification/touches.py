"""Touches of an acceptance test: the columns of their file, and where the tip was."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import MM
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements.acceptance_columns import ACCEPTANCE, LABELS, NEEDED, NUMBERS, ONE_VALUE, READINGS, check_tests
from aacmm_pin.measurements.csv_columns import BAR, REFERENCE, REFERENCE_U, Problems, is_known, near_miss, span
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.records import Measurements

STATED = ("operator", "session", "temperature_c", "probe_diameter_mm", "feature_diameter_mm", "length_mm")
"""Columns that are told of a check as a whole."""
MOST_NAMES = 8
"""So many columns are listed."""
AS_GIVEN = "coordinates of the file"
"""What touches are called whose coordinates the arm's software gave."""


def brief(source: str, most: int) -> str:
    """Whose coordinates, in at most so many characters."""
    return "file" if source == AS_GIVEN else source if len(source) <= most else f"…{source[1 - most :]}"


def read_touches(
    path: str, content: bytes, models: Mapping[str, ErrorModel]
) -> tuple[dict[str, pd.DataFrame], tuple[str, ...], dict[str, tuple[Any, ...]]]:
    """The touches of a file, once for its coordinates, if it has them, and once for each arm that makes some.

    Each table has the columns of :data:`LABELS`, those of :data:`NUMBERS` and ``x``, ``y``, ``z`` in metres, and ``row``,
    the line in the file. The coordinates are those of the probe's centre. Behind them stands how the file was read, and what
    it states of the check as a whole, see :data:`STATED`.

    Raises:
        MeasurementFileError: a column is missing, a cell is not as expected, or the file has nothing that gives coordinates.
        AacmmError: an arm with an effect that does not know these indications.
    """
    table, lines, read_as = read_table(path, content)
    problems = Problems(path, lines)
    touches = what_is_touched(table, problems)
    to_fill = table.columns.isin([*REFERENCE]) | table.columns.str.fullmatch(READINGS)
    empty = to_fill & (table == "").all().to_numpy()
    unfilled, table = [*table.columns[empty]], table.loc[:, ~empty]  # of a procedure either may be filled in
    given = [name for name in REFERENCE if name in table]
    if given and len(given) < 3:
        problems.add(", ".join(set(REFERENCE) - set(given)), f"missing beside {', '.join(given)}")
    points: dict[str, Array] = {}
    if given:
        points[AS_GIVEN] = np.column_stack([_numbers(table, n, plausible.COORDINATE, problems, True) for n in given])
    problems.stop()
    by_arms, odd = _of_indications(table, path, models, unfilled)
    points |= by_arms
    sets = {name: touches.assign(**dict(zip("xyz", at.T, strict=True))) for name, at in points.items()}
    return sets, (*read_as, *odd), {name: _different(table[name]) for name in STATED if name in table}


def what_is_touched(table: pd.DataFrame, problems: Problems) -> pd.DataFrame:
    """The columns of :data:`LABELS` and :data:`NUMBERS` of a table of cells, in metres, and ``row``.

    Raises:
        MeasurementFileError: no touches, or no column ``test``; other ``problems`` are gathered.
    """
    for name, count in table.columns.value_counts().items():
        if count > 1:
            problems.add(str(name), f"is there {count} times, expected each name once in the header")
    for name in map(str, table):
        unknown = name not in ACCEPTANCE and not is_known(name)
        if unknown and (meant := near_miss(name, [*table.columns], ACCEPTANCE)) and meant not in table:
            problems.add(name, f"is not a known name; expected {meant}, or a name that cannot be taken for it")
    if "test" not in table:
        problems.add("test", f"missing; expected which test each touch belongs to: {', '.join(NEEDED)}")
    if not len(table):
        problems.add("", "has a header but no touches")
    problems.stop()
    there = {name: table.get(name, pd.Series("", table.index, dtype=object)).str.strip() for name in LABELS}
    touches = pd.DataFrame(there | {"row": problems.lines})
    for name, (called, range_) in NUMBERS.items():
        touches[called] = _numbers(table, name, range_, problems) if name in table else np.nan
    _check_tests(touches, problems)
    _take_one_value(touches, problems)
    return touches


def _numbers(table: pd.DataFrame, name: str, range_: Range, problems: Problems, needed: bool = False) -> Array:
    """A column as numbers in metres, NaN where it is empty."""
    cells = table[name].str.strip()
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
    expected = "expected a number with a decimal point"
    problems.at(~np.isfinite(values) & ((cells != "").to_numpy() | needed), name, f"is {{!r}}, {expected}", cells.to_numpy())
    in_file = range_.of_unit("mm", MM)
    problems.at(in_file.outside(values), name, f"is {{:.6g}} mm, {in_file.expected}", values)
    return values * MM


def _different(cells: pd.Series) -> tuple[Any, ...]:
    """What stands in a column: each number or label once."""
    texts = pd.Series([cell.strip() for cell in cells if cell.strip()], dtype=object).drop_duplicates()
    numbers = pd.to_numeric(texts, errors="coerce")
    return tuple(texts if numbers.isna().any() else sorted(set(numbers.tolist())))


def _check_tests(touches: pd.DataFrame, problems: Problems) -> None:
    """Known tests, each with the cells that it needs."""
    check_tests(touches, problems)
    for test, columns in NEEDED.items():
        for name in columns:
            called = NUMBERS[name][0] if name in NUMBERS else name
            empty = touches[called].isna() if name in NUMBERS else touches[called] == ""
            bad = (empty & (touches["test"] == test)).to_numpy()
            problems.at(bad, name, f"is empty, expected a value: test {test} needs it")


def _take_one_value(touches: pd.DataFrame, problems: Problems) -> None:
    """What is calibrated is the same for all touches of a length, or sphere; one that states nothing is given it."""
    for labels, columns in ONE_VALUE.items():
        of_these = touches["test"].isin([test for test, needed in NEEDED.items() if columns[0] in needed])
        by = [touches[label] for label in ("test", *labels)]
        for name in columns:
            called = NUMBERS[name][0]
            values, rows = touches[called], touches["row"].where(touches[called].notna())
            first, row = (each.groupby(by).transform("first") for each in (values, rows))
            other = (of_these & values.notna() & (values != first)).to_numpy()
            said = f"is {{:.9g}} mm, but row {{:.0f}} states {{:.9g}} mm; expected one value for one {', '.join(labels)}"
            problems.at(other, name, said, *(each.to_numpy() for each in (values / MM, row, first / MM)))
            touches[called] = first.where(of_these, values)


def _of_indications(
    table: pd.DataFrame, path: str, models: Mapping[str, ErrorModel], unfilled: list[str]
) -> tuple[dict[str, Array], list[str]]:
    """Where each arm with its effects has the tip (n, 3) [m], and what is odd of the readings; ``unfilled`` are columns that
    are empty in every row.
    """
    theirs = [name for name in table if name not in (*ACCEPTANCE, *REFERENCE, *REFERENCE_U, *BAR, "seat")]
    came = ", ".join(table.columns[:MOST_NAMES]) + ", …" * (len(table.columns) > MOST_NAMES)
    if models and not table.columns.str.fullmatch(READINGS).any():
        why = f"no indications: expected columns theta1_deg … beside the arms that were named; there are {came}"
        if theta := [name for name in unfilled if re.fullmatch(READINGS, name)]:
            why = f"{span(theta)}: empty in every row, expected indications"
        raise MeasurementFileError(path, None, "", why)
    found: dict[str, Array] = {}
    odd: dict[str, list[str]] = {}
    for name, model in models.items():
        readings = Measurements.from_frame(table.loc[:, theirs], model.arm.nq, path)
        for text in model.odd_readings(readings.q, readings.conditions):
            odd.setdefault(text, []).append(name)
        try:
            found[name] = model.correct(readings.q, readings.conditions)
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
    if not found and not set(REFERENCE) & set(table):
        expected = "expected x_mm, y_mm, z_mm, or indications theta1_deg … and an arm"
        raise MeasurementFileError(path, None, "", f"no coordinates: {expected}; the columns that are filled in are {came}")
    return found, [f"{', '.join(names)}: {text}" for text, names in odd.items()]
