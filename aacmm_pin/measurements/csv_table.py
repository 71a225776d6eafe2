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
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Index
from aacmm_pin._support.file_problems import Problems, shortened
from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.notes import Note
from aacmm_pin._support.text_escaping import csv_text, csv_unquoted
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_columns import ACCEPTANCE_FILE, column_of, columns_of_file
from aacmm_pin.measurements.csv_header import listed, near_miss
from aacmm_pin.measurements.excel_sheet import first_sheet, is_workbook

LARGEST_FILE = 100_000_000
"""Bytes of a measurement file that is read, which are a quarter of a million records; its table
takes ten times as much.
"""
SEPARATORS = {";": "semicolons", "\t": "tabulators"}
"""Separators of cells beside commas, and what they are called."""
_NO_HEADER = re.compile(r"\s*#|sep=.?$", re.IGNORECASE)
"""A comment, or a first line such as sep=; of a spreadsheet."""
LAST_HEADER = 30
"""The header is looked for in so many lines, for a title may stand above it."""
_ARM_FILE = re.compile(r"^\s*schema\s*=\s*[\"']aacmm-pin/arm/", re.MULTILINE)
_NUMBER = re.compile(r"\s*[+-]?(?=[.,]?[0-9])[0-9]*([.,]?)[0-9]*([eE][+-]?[0-9]+)?\s*")
"""A number as cells have it; its decimal sign is the first group."""
DECIMAL_SIGNS = {".": "point", ",": "comma"}


class Row(NamedTuple):
    """The cells of a line; the number of the line, and whether it begins like a comment."""

    line: int
    cells: list[str]
    is_comment: bool


class Dialect(NamedTuple):
    """How a file separates cells, and the decimal sign of its numbers."""

    separator: str = ","
    decimal_sign: str = "."

    def text(self, table: pd.DataFrame) -> str:
        """The CSV text of a table with the columns of a file, in this dialect."""
        columns: dict[Any, Any] = dict(table.items())
        if self.decimal_sign == ",":
            for k in _numeric([str(name) for name in table]):
                columns[table.columns[k]] = _with_sign(table.iloc[:, k], ",")
        return csv_text(columns, separator=self.separator)


class CsvTable(NamedTuple):
    """What a file has: its cells as text, with decimal points; the line of each record (n,); how it
    was read, where that is not as it usually is; and how it is written.
    """

    table: pd.DataFrame
    lines: Index
    notes: tuple[Note, ...]
    dialect: Dialect


def measurement_file(path: str) -> bytes:
    """Its content.

    Raises:
        MeasurementFileError: the file cannot be read.
    """
    expected = "a measurement file (*.csv)"
    return content_of(
        path, LARGEST_FILE, expected, lambda message: MeasurementFileError(path, None, "", message)
    )


def read_table(path: str, content: bytes | None = None) -> CsvTable:
    """Read the cells of a CSV file, or of the first sheet of an Excel workbook.

    Cells may be separated by commas, semicolons or tabulators, with spaces behind them; with the
    latter two, numbers may have decimal commas. Lines that begin with #, and a first one such as
    sep=; of spreadsheets, are left out where they can be no records, and so are rows of empty cells
    at the end. Known names of columns may be in upper case. With ``content`` nothing is read.

    Raises:
        MeasurementFileError: the file cannot be read, or is not such a table.
    """
    content = measurement_file(path) if content is None else content
    ways: list[str] = []
    separator = ","
    if is_workbook(content):
        rows = _rows_of_sheet(path, content, ways)
    else:
        text = _text(path, content)
        separator, spaced = _separation(text)
        if separator in SEPARATORS:
            ways.append(f"with {SEPARATORS[separator]} between cells")
        if spaced:
            ways.append("without the spaces around cells")
        rows = list(_rows(path, text, separator, spaced))
    while rows and not any(cell.strip() for cell in rows[-1].cells):
        rows.pop()
    header, lines, records = _records(path, rows, ways)
    cells = [list(column) for column in zip(*records, strict=True)] or [[] for _ in header]
    sign = "." if separator == "," else _decimal_sign_of(header, cells, Problems(path, lines))
    if sign == ",":
        ways.append("with decimal commas")
        for k in _numeric(header):
            cells[k] = _with_sign(cells[k], ".")
    table = pd.DataFrame(dict(enumerate(cells)), dtype=object).set_axis(header, axis=1)
    notes = [Note("read_with", {"ways": ways})] if ways else []
    if comments := len(rows) - len(records) - 1:
        notes.append(Note("comments_ignored", {"lines": comments}))
    return CsvTable(table, lines, tuple(notes), Dialect(separator, sign))


def _rows_of_sheet(path: str, content: bytes, ways: list[str]) -> list[Row]:
    """The rows of the first sheet of a workbook, with the empty cells at the end of a record that
    the header has names for.

    Raises:
        MeasurementFileError: see :func:`first_sheet`; or the sheet is empty.
    """
    sheet = first_sheet(path, content)
    if not sheet.rows:
        raise MeasurementFileError(
            path, None, "", f"the sheet {sheet.title!r} is empty; expected a header and records"
        )
    if sheet.of > 1:
        ways.append(f"from sheet {sheet.title!r}, the first of {sheet.of}")
    width = 0
    rows = []
    for line, cells in sheet.rows:
        is_comment = _NO_HEADER.match(cells[0]) is not None
        if not is_comment:
            width = width or len(cells)
            cells = cells + [""] * (width - len(cells))
        rows.append(Row(line, cells, is_comment))
    return rows


def _separation(text: str) -> tuple[str, bool]:
    """What separates the cells of the header, and whether there are spaces behind it."""
    lines = (line for line in text.splitlines() if line.strip() and not _NO_HEADER.match(line))
    first = list(islice(lines, LAST_HEADER)) or [""]
    headers = (line for line in first if _has_names(line.split(_separator(line))))
    header = next(headers, first[0])
    separator = _separator(header)
    names = next(csv.reader([header], delimiter=separator), [])
    return separator, any(name.startswith(" ") for name in names[1:])


def _separator(line: str) -> str:
    """What separates the cells of a line."""
    for mark in (",", *SEPARATORS):
        if mark in line:
            return mark
    return ","


def _has_names(cells: Sequence[str]) -> bool:
    """Whether one of the cells is the name of a known column, or two, or the only one, nearly."""
    names = [cell.strip(' "') for cell in cells]
    if any(column_of(name.lower(), ACCEPTANCE_FILE) for name in names):
        return True
    similar = [name for name in names if near_miss(name, names, ACCEPTANCE_FILE)]
    return len(similar) >= min(2, len(names))


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
            path, end + 1, "", f"{error}; expected CSV; check the quotation marks"
        ) from None


def _records(
    path: str, rows: Sequence[Row], ways: list[str]
) -> tuple[list[str], Index, list[list[str]]]:
    """The header, and lines and cells of the records: of all rows but comments.

    Raises:
        MeasurementFileError: there are comments only, a row has another number of cells than the
            header, or it begins with # as a label may.
    """
    own_rows = [k for k, row in enumerate(rows) if not row.is_comment]
    if not own_rows:
        raise MeasurementFileError(
            path, None, "", "only comments; expected a header and one row per record"
        )
    first = own_rows[0]
    headers = (rows[k] for k in own_rows[:LAST_HEADER] if _has_names(rows[k].cells))
    _check_title(path, rows[first], next(headers, rows[first]))
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
        f"{{}} cells; expected {len(header)} as in the header; use decimal points, and quotation "
        "marks around text with commas",
        counts,
    )
    like_comments = np.array([row.is_comment for row in records], dtype=bool)
    problems.at(
        like_comments,
        header[0],
        "the label begins with # as a comment does; expected another label; if the row is a "
        "comment, delete this row",
    )
    problems.stop()
    if len(records) > 1:
        _check_first_record(path, header, records)
    return header, problems.lines, [row.cells for row in records]


def _check_title(path: str, first: Row, header: Row) -> None:
    """Refuse a ``first`` row above the header."""
    if first.line != header.line:
        raise MeasurementFileError(
            path,
            first.line,
            "",
            f"{shortened(first.cells[0])!r}; expected the names of the columns (row "
            f"{header.line}); delete the rows above the header, or begin them with #",
        )


def _check_first_record(path: str, header: list[str], records: Sequence[Row]) -> None:
    """Refuse a row of words, such as units, between the header and the records."""
    numeric = _numeric(header)
    first, second = ([row.cells[k] for k in numeric] for row in records[:2])
    if any(map(_NUMBER.fullmatch, first)) or not any(map(_NUMBER.fullmatch, second)):
        return
    if words := [repr(shortened(cell)) for cell in first if cell.strip()]:
        raise MeasurementFileError(
            path,
            records[0].line,
            "",
            f"{listed(words)}; expected numbers of the first record; delete this row, or begin the "
            "row with #",
        )


def _numeric(header: Sequence[str]) -> list[int]:
    """The columns that may hold numbers: those of numbers, and unknown ones."""
    known = columns_of_file(header)
    entries = [column_of(name, known) for name in header]
    return [k for k, entry in enumerate(entries) if entry is None or not entry.is_label]


def _with_known_names(header: list[str], ways: list[str]) -> list[str]:
    """The names, those that are known in lower case so."""
    known = columns_of_file(header)
    lower = [name.lower() if column_of(name.lower(), known) else name for name in header]
    if lower == header or max(Counter(lower).values()) > 1:
        return header
    ways.append("with lower-case column names")
    return lower


def _decimal_sign_of(
    header: Sequence[str], columns: Sequence[Sequence[str]], problems: Problems
) -> str:
    """The decimal sign of most numbers.

    Raises:
        MeasurementFileError: a number has another one.
    """
    signs = {k: np.array([*map(_decimal_sign, columns[k])]) for k in _numeric(header)}
    commas, points = (sum(np.sum(of == sign) for of in signs.values()) for sign in ",.")
    usual, other = (",", ".") if commas > points else (".", ",")
    came = f"{{!r}} with a decimal {DECIMAL_SIGNS[other]}"
    expected = f"expected a decimal {DECIMAL_SIGNS[usual]} as in {max(commas, points)} numbers"
    for k, of_column in signs.items():
        cells = np.array(columns[k], dtype=object)
        problems.at(of_column == other, header[k], f"{came}; {expected}", cells)
    problems.stop()
    return usual


def _decimal_sign(cell: object) -> str:
    """The decimal sign of a number; "" where there is none."""
    match = _NUMBER.fullmatch(str(cell))
    return match[1] if match else ""


def _with_sign(cells: Iterable[Any], sign: str) -> list[Any]:
    """The cells, in which numbers have this decimal sign."""
    found = [(cell, _decimal_sign(cell)) for cell in cells]
    return [str(cell).replace(own, sign) if own else cell for cell, own in found]


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
            f"byte {error.start} is not UTF-8; expected a CSV file in UTF-8; save the file in this "
            "encoding",
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        expected = "expected a CSV file in UTF-8"
        raise MeasurementFileError(
            path, line, "", f"a NUL byte, as in UTF-16; {expected}; save the file in this encoding"
        )
    if not text.strip():
        raise MeasurementFileError(
            path, None, "", "empty file; expected a header and one row per record"
        )
    if _ARM_FILE.search(text):
        raise MeasurementFileError(
            path,
            None,
            "",
            "this is an arm file (TOML); expected a measurement file (CSV); state ARM before DATA",
        )
    return text
