"""The cells of a CSV file as text, however the program that wrote it separates cells and writes
numbers.

pandas reads neither the lines of records nor rows that are too short so that a message could name
them: it fills such rows up, and leaves blank lines and line ends in quotes out of its count.
Python's reader states the line of each row.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Index
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.notes import Note
from aacmm_pin._support.text_escaping import csv_unquoted
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_columns import column_of, columns_of_file

LARGEST_FILE = 100_000_000
"""Bytes of a measurement file that is read, which are a quarter of a million records; its table
takes ten times as much.
"""
SEPARATORS = {";": "semicolons", "\t": "tabulators"}
"""Separators of cells beside commas, and what they are called."""
_NO_HEADER = re.compile(r"\s*#|sep=.?$", re.IGNORECASE)
"""A comment, or a first line such as sep=; of a spreadsheet."""
_EXPONENT = "([eE][+-]?[0-9]+)?"
_WITH_COMMA = re.compile(rf"\s*[+-]?[0-9]*,[0-9]+{_EXPONENT}\s*")
_WITH_POINT = re.compile(rf"\s*[+-]?[0-9]*\.[0-9]*{_EXPONENT}\s*")


class Row(NamedTuple):
    """The cells of a line; the number of the line, and whether it begins like a comment."""

    line: int
    cells: list[str]
    is_comment: bool


def measurement_file(path: str) -> bytes:
    """Its content.

    Raises:
        MeasurementFileError: the file cannot be read.
    """
    expected = "a measurement file, *.csv,"
    return content_of(
        path, LARGEST_FILE, expected, lambda message: MeasurementFileError(path, None, "", message)
    )


def read_table(
    path: str, content: bytes | None = None
) -> tuple[pd.DataFrame, Index, tuple[Note, ...]]:
    """Cells of a CSV file as text, the line of each record, and how the file was read where that is
    not as it usually is.

    Cells may be separated by commas, semicolons or tabulators, with spaces behind them; with the
    latter two, numbers may have decimal commas. Lines that begin with #, and a first one such as
    sep=; of spreadsheets, are left out where they can be no records. Known names of columns may be
    in upper case. With ``content`` nothing is read.

    Raises:
        MeasurementFileError: the file cannot be read, or is not such a table.
    """
    text = _text(path, measurement_file(path) if content is None else content)
    ways: list[str] = []
    separator, spaced = _separation(text)
    if separator in SEPARATORS:
        ways.append(f"{SEPARATORS[separator]} between cells")
    if spaced:
        ways.append("spaces around cells left out")
    rows = list(_rows(path, text, separator, spaced))
    header, lines, records = _records(path, rows, ways)
    cells = [list(column) for column in zip(*records, strict=True)] or [[] for _ in header]
    if separator != ",":
        _write_decimal_points(header, cells, ways)
    table = pd.DataFrame(dict(enumerate(cells)), dtype=object).set_axis(header, axis=1)
    notes = [Note("read_with", {"ways": ways})] if ways else []
    if comments := len(rows) - len(records) - 1:
        notes.append(Note("comments_ignored", {"lines": comments}))
    return table, lines, tuple(notes)


def _separation(text: str) -> tuple[str, bool]:
    """What separates the cells of the header, and whether there are spaces behind it."""
    lines = (line for line in text.splitlines() if line.strip() and not _NO_HEADER.match(line))
    header = next(lines, "")
    separator = next((mark for mark in (",", *SEPARATORS) if mark in header), ",")
    names = next(csv.reader([header], delimiter=separator), [])
    return separator, any(name.startswith(" ") for name in names[1:])


def _rows(path: str, text: str, separator: str, spaced: bool) -> Iterator[Row]:
    """All lines that are not empty.

    Raises:
        MeasurementFileError: quotes are not as in CSV.
    """
    end = 0
    lines = io.StringIO(text, newline="")
    reader = csv.reader(lines, strict=True, delimiter=separator, skipinitialspace=spaced)
    try:
        for cells in reader:
            if cells:
                is_comment = _NO_HEADER.match(cells[0]) is not None
                unquoted = [csv_unquoted(cell) for cell in cells]
                yield Row(
                    end + 1, [cell.strip() for cell in unquoted] if spaced else unquoted, is_comment
                )
            end = reader.line_num
    except csv.Error as error:
        raise MeasurementFileError(
            path, end + 1, "", f"not CSV: {error}; check the quotes"
        ) from None


def _records(
    path: str, rows: Sequence[Row], ways: list[str]
) -> tuple[list[str], Index, list[list[str]]]:
    """The header, and lines and cells of the records: of all rows but comments.

    Raises:
        MeasurementFileError: there are comments only, a row has another number of cells than the
            header, or it begins with # as a label may.
    """
    first = next((k for k, row in enumerate(rows) if not row.is_comment), None)
    if first is None:
        raise MeasurementFileError(
            path, None, "", "has comments only, expected a header and one row a record"
        )
    header = _with_known_names(rows[first].cells, ways)
    column = column_of(header[0], columns_of_file(header))
    may_be_label = column is None or column.is_label  # a number does not begin with #
    records = []
    for row in rows[first + 1 :]:
        if not row.is_comment or (may_be_label and len(row.cells) == len(header)):
            records.append(row)
    problems = Problems(path, np.array([row.line for row in records], dtype=np.intp))
    counts = np.array([len(row.cells) for row in records], dtype=np.intp)
    problems.at(
        counts != len(header),
        "",
        f"{{}} cells, expected {len(header)} as in the header (decimal points; quotes around text "
        "with commas)",
        counts,
    )
    like_comments = np.array([row.is_comment for row in records], dtype=bool)
    problems.at(
        like_comments,
        header[0],
        "begins with # as a comment or a label may; delete the row, or name it otherwise",
    )
    problems.stop()
    return header, problems.lines, [row.cells for row in records]


def _with_known_names(header: list[str], ways: list[str]) -> list[str]:
    """The names, those that are known in lower case so."""
    known = columns_of_file(header)
    lower = [name.lower() if column_of(name.lower(), known) else name for name in header]
    if lower == header or max(Counter(lower).values()) > 1:
        return header
    ways.append("columns in lower case")
    return lower


def _write_decimal_points(header: list[str], columns: list[list[str]], ways: list[str]) -> None:
    """Points in the stead of decimal commas, in all columns of numbers, unless some number has a
    point already.
    """
    known = columns_of_file(header)
    entries = [column_of(name, known) for name in header]
    of_numbers = [k for k, entry in enumerate(entries) if entry is None or not entry.is_label]
    cells = [cell for k in of_numbers for cell in columns[k]]
    if any(map(_WITH_POINT.fullmatch, cells)) or not any(map(_WITH_COMMA.fullmatch, cells)):
        return
    ways.append("decimal commas")
    for k in of_numbers:
        columns[k] = [
            cell.replace(",", ".") if _WITH_COMMA.fullmatch(cell) else cell for cell in columns[k]
        ]


def _text(path: str, content: bytes) -> str:
    """The content as text.

    Raises:
        MeasurementFileError: it is none, or empty.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise MeasurementFileError(
            path,
            line,
            "",
            f"not UTF-8 text (byte {error.start}); expected a CSV file in UTF-8, as every "
            "spreadsheet can save it",
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        expected = "expected a CSV file in UTF-8"
        raise MeasurementFileError(
            path, line, "", f"has a NUL byte: not text, or in UTF-16; {expected}"
        )
    if not text.strip():
        raise MeasurementFileError(
            path, None, "", "is empty, expected a header and one row a record"
        )
    return text
