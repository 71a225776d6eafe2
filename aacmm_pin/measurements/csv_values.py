"""The cells of a measurement or acceptance file: numbers in the units of the file, and labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.file_problems import Problems
from aacmm_pin.measurements.csv_columns import MEASUREMENT_FILE, RECORD_COLUMNS, Column, column_of
from aacmm_pin.measurements.csv_header import Header, read_header

Cells = NDArray[np.object_]
"""(n,) of str; "" where there is nothing."""


@dataclass(frozen=True, eq=False)
class Values:
    """What stands in the known columns of a table: numbers (n,) in the units of the file, and
    labels (n,).
    """

    n: int
    numbers: dict[str, Array]
    labels: dict[str, Cells]

    def block(self, names: Sequence[str]) -> Array:
        """The columns ``names`` side by side, (n, len(names)); NaN where one is not there."""
        missing = np.full(self.n, np.nan)
        return np.column_stack([self.numbers.get(name, missing) for name in names])

    def label(self, name: str) -> Cells:
        """The column ``name``; "" where it is not there."""
        return self.labels.get(name, np.full(self.n, "", dtype=object))


def read_values(table: pd.DataFrame, columns: Sequence[Column], problems: Problems) -> Values:
    """The cells of the known ``columns`` of a table, text or numbers; what is wrong with them goes
    to ``problems``.
    """
    numbers: dict[str, Array] = {}
    labels: dict[str, Cells] = {}
    for name in table.columns:
        column = column_of(name, columns)
        if column is None:
            continue
        cells = cells_of(table[name])
        if column.is_label:
            labels[name] = cells
        else:
            numbers[name] = _numbers(name, cells, column, problems)
    return Values(len(table), numbers, labels)


def cells_of(column: pd.Series) -> Cells:
    """Cells as text, exactly as they are; "" where there is nothing."""
    cells = np.array(column, dtype=object)
    if set(map(type, cells)) <= {str}:
        return cells
    missing = column.isna().to_numpy()
    texts = ["" if empty else str(cell) for cell, empty in zip(cells, missing, strict=True)]
    return np.array(texts, dtype=object)


def _numbers(name: str, cells: Cells, column: Column, problems: Problems) -> Array:
    """Cells as numbers, NaN where there is nothing."""
    values = np.array([_number(cell) for cell in cells], dtype=np.float64)
    empty = np.array([not cell.strip() for cell in cells], dtype=bool)
    unreadable = ~np.isfinite(values) & ~empty
    problems.at(unreadable, name, "{!r}; expected a finite number with a decimal point", cells)
    if not column.may_be_empty:
        problems.at(empty, name, "empty cell or NaN; expected a number in each row")
    return values


def _number(cell: str) -> float:
    """A text as a number, NaN where it is none; Python's 1_000 is none."""
    try:
        return np.nan if "_" in cell else float(cell)
    except ValueError:
        return np.nan


def check_numbers(values: Values, columns: Sequence[Column], problems: Problems) -> None:
    """Whether each number can be one of its column, see :class:`Column`."""
    for name, numbers in values.numbers.items():
        column = column_of(name, columns)
        if column is None:
            continue
        if column.above_zero:
            expected = "expected a standard uncertainty above 0"
            problems.at(numbers == 0.0, name, f"{{:g}}; {expected}", numbers)
        if (possible := column.range_in_file) is not None:
            message = f"{{:.6g}} {possible.unit}; {possible.expected}"
            problems.at(possible.outside(numbers), name, message, numbers)


@dataclass(frozen=True, eq=False)
class RecordTable:
    """The columns of a measurement file: header and values in the units of the file."""

    header: Header
    values: Values

    def field(self, column: Column) -> NDArray[Any] | None:
        """What stands in the columns of an entry, in SI; None where there are none.

        (n,) of a single column, (n, columns) of several or of numbered ones.
        """
        names = self.header.names(column)
        if not names:
            return None
        if column.is_label:
            return self.values.labels.get(names[0])
        if names[0] not in self.values.numbers:
            return None
        block = self.values.block(names) * column.si
        return block if column.is_numbered or len(names) > 1 else block[:, 0]

    def fields(self) -> dict[str, NDArray[Any] | None]:
        """What the file states, by the attribute that has it; but for the angles."""
        entries = [column for column in RECORD_COLUMNS if column.field]
        return {column.field: self.field(column) for column in entries}


def read_records(table: pd.DataFrame, nq: int | None, problems: Problems) -> RecordTable:
    """The columns of a measurement file of an arm with ``nq`` joints; None: of any arm.

    Raises:
        MeasurementFileError: the header or a cell is not as expected, or there are no records.
    """
    header = read_header(list(table.columns), nq, problems)
    if not len(table):
        problems.add("", "a header without records; expected one row per record")
    values = read_values(table, MEASUREMENT_FILE, problems)
    problems.stop()
    return RecordTable(header, values)
