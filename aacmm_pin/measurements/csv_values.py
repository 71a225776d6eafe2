"""The cells of a measurement or acceptance file as numbers, in its units, and labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import MOST_LENGTH_ERROR, Array, is_no_unit
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.plausible import Range
from aacmm_pin.measurements.csv_columns import (
    ORIENTATION,
    ROLL_PITCH_YAW,
    ROTATION_VECTOR,
    Column,
    column_of,
    span,
)

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

    def names(self, entry: Column) -> list[str]:
        """Columns of an entry."""
        return entry.among(self.columns)

    def field(self, entry: Column) -> NDArray[Any] | None:
        """The columns of an entry in SI, or None: (n,), or (n, columns)."""
        names = self.names(entry)
        if not names:
            return None
        if entry.is_label:
            return self.columns[names[0]]
        block = self.block(names) * entry.si
        return block if entry.is_numbered or len(names) > 1 else block[:, 0]


def read_values(table: pd.DataFrame, columns: Sequence[Column], problems: Problems) -> Values:
    """The cells of known ``columns``; mistakes go to ``problems``."""
    values = Values(len(table), {})
    for name in table.columns:
        entry = column_of(name, columns)
        cells = cells_of(table[name])
        is_label = entry.is_label
        values.columns[name] = cells if is_label else _numbers(name, cells, entry, problems)
    return values


def cells_of(column: pd.Series) -> Cells:
    """Cells as unchanged text; "" if empty."""
    cells = np.array(column, dtype=object)
    if set(map(type, cells)) <= {str}:
        return cells
    missing = column.isna().to_numpy()
    texts = ["" if empty else str(cell) for cell, empty in zip(cells, missing, strict=True)]
    return np.array(texts, dtype=object)


def _numbers(name: str, cells: Cells, column: Column, problems: Problems) -> Array:
    """Cells as numbers, NaN if empty, infinite if invalid."""
    stripped = pd.Series(cells, dtype=object).str.strip()
    values = np.array(pd.to_numeric(stripped, errors="coerce"), dtype=np.float64)
    empty = (stripped == "").to_numpy()
    unreadable = ~np.isfinite(values) & ~empty
    problems.at(unreadable, name, "{!r}; expected a finite number with a decimal point", cells)
    values[unreadable] = np.inf
    if not column.may_be_empty:
        problems.at(empty, name, "empty cell or NaN; expected a number in each row")
    return values


def check_values(values: Values, columns: Sequence[Column], problems: Problems) -> None:
    """Check numbers against their columns."""
    for entry in columns:
        names = values.names(entry)
        if names and not entry.is_label:
            check_numbers(entry, names, values.block(names), entry.range_in_file, problems)


def check_numbers(
    column: Column,
    places: Sequence[str],
    numbers: Array,
    possible: Range | None,
    problems: Problems,
) -> None:
    """Check numbers (n, k) of ``places`` against a column, and the ``possible`` range in their
    unit.
    """
    stated = ~np.isnan(numbers)
    partly = stated.any(axis=1) & ~stated.all(axis=1)
    for k, place in enumerate(places):
        component = numbers[:, k]
        if column.above_zero:
            expected = "expected a standard uncertainty above 0"
            problems.at(component == 0.0, place, f"{{:g}}; {expected}", component)
        if possible is not None:
            message = f"{{:.6g}} {possible.unit}; {possible.expected}"
            outside = possible.outside(component) & np.isfinite(component)
            problems.at(outside, place, message, component)
        problems.at(
            partly & ~stated[:, k],
            place,
            f"empty cell or NaN in a row with part of {', '.join(column.names)}; expected all or "
            "none of these values",
        )
    if not column.is_direction:
        return
    length = np.linalg.norm(numbers, axis=1)
    wrong = is_no_unit(length) & np.isfinite(length)
    if column.names == ORIENTATION:
        problems.at(
            wrong,
            span(places),
            "a norm of {:.6g}; expected 1, because these are unit quaternions with the scalar "
            f"first; for other forms use {span(ROTATION_VECTOR)} or {span(ROLL_PITCH_YAW)}",
            length,
        )
    else:
        problems.at(
            wrong & (length > 0.0),
            span(places),
            f"a length of {{:.6g}}; expected 1 ± {MOST_LENGTH_ERROR:g}, or empty cells if there is "
            "no direction",
            length,
        )
