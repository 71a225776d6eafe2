"""Touches of an acceptance test: the columns of their file, and where the tip was."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import MM
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements.csv_columns import BAR, REFERENCE, REFERENCE_U, Problems
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.records import Measurements

NEEDED = {
    "sphere": ("feature", "feature_diameter_mm", "probe_diameter_mm"),
    "location": ("feature", "repeat"),
    "length-uni": ("feature", "position", "repeat", "length_id", "length_mm"),
    "length-bi": ("feature", "position", "repeat", "length_id", "length_mm", "probe_diameter_mm"),
    "effective-diameter": ("feature", "feature_diameter_mm", "probe_diameter_mm", "repeat"),
    "single-point": ("position",),
    "volumetric": ("feature", "position", "length_id", "length_mm"),
}
"""The tests, and the columns that must not be empty in their rows."""
NUMBERS: dict[str, tuple[str, Range]] = {
    "feature_diameter_mm": ("feature_diameter", Range(1e-3, 1.0, "m")),
    "length_mm": ("length", plausible.BAR_LENGTH),
    "u_length_mm": ("u_length", plausible.LENGTH_NOISE),
    "probe_diameter_mm": ("probe_diameter", Range(0.0, 0.1, "m")),
}
"""Columns of numbers, what :func:`read_touches` calls them in metres, and what they can be."""
LABELS = ("feature", "test", "position", "repeat", "length_id")
ACCEPTANCE = (*LABELS, *NUMBERS)
AS_GIVEN = "coordinates of the file"
"""What touches are called whose coordinates the arm's software gave."""


def read_touches(path: str, models: Mapping[str, ErrorModel]) -> tuple[dict[str, pd.DataFrame], tuple[str, ...]]:
    """The touches of a file, once for its coordinates, if it has them, and once for each arm that makes some.

    Each table has the columns of :data:`LABELS`, those of :data:`NUMBERS` and ``x``, ``y``, ``z`` in metres, and ``row``,
    the line in the file. The coordinates are those of the probe's centre. Behind them stands how the file was read.

    Raises:
        MeasurementFileError: a column is missing, a cell is not as expected, or the file has nothing that gives coordinates.
        AacmmError: an arm with an effect that does not know these indications.
    """
    table, lines, read_as = read_table(path)
    problems = Problems(path, lines)
    for name, count in table.columns.value_counts().items():
        if count > 1:
            problems.add(str(name), f"is there {count} times, expected each name once in the header")
    if "test" not in table:
        problems.add("test", f"missing; expected which test each touch belongs to: {', '.join(NEEDED)}")
    if not len(table):
        problems.add("", "has a header but no touches")
    problems.stop()
    there = {name: table.get(name, pd.Series("", table.index, dtype=object)).str.strip() for name in LABELS}
    touches = pd.DataFrame(there | {"row": lines})
    for name, (called, range_) in NUMBERS.items():
        touches[called] = _numbers(table, name, range_, problems) if name in table else np.nan
    _check_tests(touches, problems)
    given = [name for name in REFERENCE if name in table]
    if given and len(given) < 3:
        problems.add(", ".join(set(REFERENCE) - set(given)), f"missing beside {', '.join(given)}")
    points: dict[str, Array] = {}
    if given:
        points[AS_GIVEN] = np.column_stack([_numbers(table, n, plausible.COORDINATE, problems, True) for n in given])
    problems.stop()
    points |= _of_indications(table, path, models)
    return {name: touches.assign(**dict(zip("xyz", at.T, strict=True))) for name, at in points.items()}, read_as


def _numbers(table: pd.DataFrame, name: str, range_: Range, problems: Problems, needed: bool = False) -> Array:
    """A column as numbers in metres, NaN where it is empty."""
    cells = table[name].str.strip()
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
    expected = "expected a number with a decimal point"
    problems.at(~np.isfinite(values) & ((cells != "").to_numpy() | needed), name, f"is {{!r}}, {expected}", cells.to_numpy())
    in_file = range_.of_unit("mm", MM)
    problems.at(in_file.outside(values), name, f"is {{:.6g}} mm, {in_file.expected}", values)
    return values * MM


def _check_tests(touches: pd.DataFrame, problems: Problems) -> None:
    """Known tests, each with the cells that it needs."""
    tests = touches["test"].to_numpy()
    problems.at(~np.isin(tests, list(NEEDED)), "test", f"is {{!r}}, expected one of {', '.join(NEEDED)}", tests)
    for test, columns in NEEDED.items():
        for name in columns:
            called = NUMBERS[name][0] if name in NUMBERS else name
            empty = touches[called].isna() if name in NUMBERS else touches[called] == ""
            bad = (empty & (touches["test"] == test)).to_numpy()
            problems.at(bad, name, f"is empty, expected a value: test {test} needs it")


def _of_indications(table: pd.DataFrame, path: str, models: Mapping[str, ErrorModel]) -> dict[str, Array]:
    """Where each arm with its effects has the tip (n, 3) [m]."""
    theirs = [name for name in table if name not in (*ACCEPTANCE, *REFERENCE, *REFERENCE_U, *BAR, "seat")]
    found: dict[str, Array] = {}
    for name, model in models.items():
        readings = Measurements.from_frame(table.loc[:, theirs], model.arm.nq, path)
        try:
            found[name] = model.correct(readings.q, readings.conditions)
        except AacmmError as error:
            raise AacmmError(f"{path}: {error}") from None
    if not found and not set(REFERENCE) & set(table):
        raise MeasurementFileError(
            path, None, "", "no coordinates: expected x_mm, y_mm, z_mm, or indications theta1_deg … and an arm"
        )
    return found
