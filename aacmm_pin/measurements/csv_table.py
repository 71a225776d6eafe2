"""The cells of a CSV file or an Excel workbook (``*.xlsx``, by openpyxl), as text.

Python's reader states the line of each row; pandas fills short rows, and skips blank lines.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Index
from aacmm_pin._support.display import Note
from aacmm_pin._support.file_problems import Problems, shortened
from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.text_escaping import csv_text, csv_unquoted
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_columns import (
    ACCEPTANCE_FILE,
    UNKNOWN_COLUMN,
    column_of,
    columns_of_file,
)

LARGEST_FILE = 100_000_000
"""Bytes: a quarter of a million records, whose table takes ten times as much."""
SEPARATORS = {";": "semicolons", "\t": "tabulators"}
_NO_HEADER = re.compile(r"\s*#|sep=.?$", re.IGNORECASE)
"""A comment, or a line such as sep=; of a spreadsheet."""
LAST_HEADER = 30
"""Lines in which the header is searched: a title may precede it."""
_ARM_FILE = re.compile(r"^\s*schema\s*=\s*[\"']aacmm-pin/arm/", re.MULTILINE)
_NUMBER = re.compile(r"\s*[+-]?(?=[.,]?[0-9])[0-9]*([.,]?)[0-9]*([eE][+-]?[0-9]+)?\s*")
"""The first group is the decimal sign."""
DECIMAL_SIGNS = {".": "point", ",": "comma"}


class FileLine(NamedTuple):
    """A line of a file."""

    line: int
    cells: list[str]

    @property
    def is_comment(self) -> bool:
        """Whether the line begins like a comment."""
        return _NO_HEADER.match(self.cells[0]) is not None


class CsvTable(NamedTuple):
    """Cells as text with decimal points, the line of each record (n,), and notes; and how the file
    states cells and numbers.
    """

    table: pd.DataFrame
    lines: Index
    notes: tuple[Note, ...]
    separator: str
    decimal_sign: str

    def text(self, table: pd.DataFrame) -> str:
        """CSV text of a table with the columns of a file, as this file states them."""
        columns: dict[Any, Any] = dict(table.items())
        if self.decimal_sign == ",":
            for k in _numeric([str(name) for name in table]):
                columns[table.columns[k]] = _with_sign(table.iloc[:, k], ",")
        return csv_text(columns, separator=self.separator)


def is_workbook(content: bytes) -> bool:
    """Whether the content is a workbook, or another ZIP archive."""
    return content.startswith(b"PK\x03\x04")


def measurement_file(path: str) -> bytes:
    """The content of a measurement file.

    Raises:
        MeasurementFileError: it cannot be read.
    """
    expected = "a measurement file (*.csv)"
    return content_of(
        path, LARGEST_FILE, expected, lambda message: MeasurementFileError(path, None, "", message)
    )


def read_table(path: str, content: bytes | None = None) -> CsvTable:
    """The cells of a CSV file, or of the first sheet of a workbook; ``content`` replaces reading.

    Separators are commas, semicolons or tabulators, perhaps with spaces; with the latter two,
    numbers may have decimal commas. Lines that begin with # or sep=, and empty rows at the end, are
    omitted if they cannot be records. Known names may be in upper case.

    Raises:
        MeasurementFileError: it cannot be read, or is no such table.
    """
    content = measurement_file(path) if content is None else content
    peculiarities: list[str] = []
    separator = ","
    if is_workbook(content):
        rows = _rows_of_sheet(path, content, peculiarities)
    else:
        text = _text(path, content)
        separator, spaced = _separation(text)
        if separator in SEPARATORS:
            peculiarities.append(f"with {SEPARATORS[separator]} between cells")
        if spaced:
            peculiarities.append("without the spaces around cells")
        rows = list(_rows(path, text, separator, spaced))
    while rows and not any(map(str.strip, rows[-1].cells)):
        rows.pop()
    header, lines, records = _records(path, rows, peculiarities)
    table = pd.DataFrame(records, columns=range(len(header)), dtype=object)
    sign = "." if separator == "," else _decimal_sign_of(header, table, Problems(path, lines))
    if sign == ",":
        peculiarities.append("with decimal commas")
        for k in _numeric(header):
            table[k] = _with_sign(table[k], ".")
    table = table.set_axis(header, axis=1)
    notes = [Note("read_with", {"ways": peculiarities})] if peculiarities else []
    if comments := len(rows) - len(records) - 1:
        notes.append(Note("comments_ignored", {"lines": comments}))
    return CsvTable(table, lines, tuple(notes), separator, sign)


def _rows_of_sheet(path: str, content: bytes, peculiarities: list[str]) -> list[FileLine]:
    """Rows and columns of the first sheet that are not empty: numbers as Python writes them,
    formulas as values.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions
            book = pd.ExcelFile(io.BytesIO(content), engine="openpyxl")
            sheet = book.parse(0, header=None, dtype=object, keep_default_na=False)
    except ImportError:
        raise MeasurementFileError(
            path,
            None,
            "",
            "this is an Excel workbook; expected a CSV file; save the workbook as CSV, or run "
            "pip install 'aacmm-pin[excel]'",
        ) from None
    except Exception as error:  # whatever the reader makes of the bytes
        raise MeasurementFileError(
            path,
            None,
            "",
            f"openpyxl cannot read this file: {error}; expected an Excel workbook (*.xlsx) or a "
            "CSV file in UTF-8",
        ) from None
    if len(book.sheet_names) > 1:
        first, *_ = book.sheet_names
        peculiarities.append(f"from sheet {first!r}, the first of {len(book.sheet_names)}")
    cells = sheet.astype(str)
    has_text = cells != ""
    cells = cells.loc[has_text.any(axis=1), has_text.any(axis=0)]
    return [FileLine(row + 1, [*values]) for row, *values in cells.itertuples()]


def _separation(text: str) -> tuple[str, bool]:
    """The separator of the first line with a known name, else of the first line, and whether spaces
    follow it.
    """
    lines = (line for line in text.splitlines() if line.strip() and not _NO_HEADER.match(line))
    headers = []
    for line in islice(lines, LAST_HEADER):
        for separator in (",", *SEPARATORS):
            if separator in line:
                headers.append((separator, next(csv.reader([line], delimiter=separator))))
    with_names = (header for header in headers if _has_names(header[1]))
    separator, names = next(with_names, headers[0] if headers else (",", []))
    return separator, any(name.startswith(" ") for name in names[1:])


def _has_names(cells: Sequence[str]) -> bool:
    """Whether a cell is a known name."""
    names = [cell.strip().lower() for cell in cells]
    return any(column_of(name, ACCEPTANCE_FILE) is not UNKNOWN_COLUMN for name in names)


def _rows(path: str, text: str, separator: str, spaced: bool) -> Iterator[FileLine]:
    """The rows that are not blank, each with its first line."""
    lines_before = 0
    stream = io.StringIO(text, newline="")
    reader = csv.reader(stream, strict=True, delimiter=separator, skipinitialspace=spaced)
    has_quotes = "'" in text
    try:
        for cells in reader:
            if cells:
                if has_quotes:
                    cells = [*map(csv_unquoted, cells)]
                yield FileLine(lines_before + 1, [*map(str.strip, cells)] if spaced else cells)
            lines_before = reader.line_num
    except csv.Error as error:
        raise MeasurementFileError(
            path, lines_before + 1, "", f"{error}; expected CSV; check the quotation marks"
        ) from None


def _records(
    path: str, rows: Sequence[FileLine], peculiarities: list[str]
) -> tuple[list[str], Index, list[list[str]]]:
    """Header, lines and cells of records."""
    header_row = _header_row(path, rows)
    header = header_row.cells
    columns = columns_of_file(header)
    lower = [
        name if column_of(name.lower(), columns) is UNKNOWN_COLUMN else name.lower()
        for name in header
    ]
    if lower != header and len({*lower}) == len(lower):
        peculiarities.append("with lower-case column names")
        header = lower
    may_be_label = column_of(header[0], columns).is_label  # a number does not begin with #
    records = []
    for row in rows[rows.index(header_row) + 1 :]:
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
    problems.at(
        np.array([row.is_comment for row in records], dtype=bool),
        header[0],
        "the label begins with # as a comment does; expected another label; if the row is a "
        "comment, delete this row",
    )
    problems.stop()
    return header, problems.lines, [row.cells for row in records]


def _header_row(path: str, rows: Sequence[FileLine]) -> FileLine:
    """The first row that is no comment; a title above known names is refused."""
    stated = [row for row in rows if not row.is_comment]
    if not stated:
        raise MeasurementFileError(
            path, None, "", "empty, or only comments; expected a header and one row per record"
        )
    first = stated[0]
    with_names = next((row for row in stated[:LAST_HEADER] if _has_names(row.cells)), first)
    if with_names is not first:
        raise MeasurementFileError(
            path,
            first.line,
            "",
            f"{shortened(first.cells[0])!r}; expected the names of the columns (row "
            f"{with_names.line}); delete the rows above the header, or begin them with #",
        )
    return first


def _numeric(header: Sequence[str]) -> list[int]:
    """Columns that may hold numbers."""
    possible = columns_of_file(header)
    entries = [column_of(name, possible) for name in header]
    return [k for k, entry in enumerate(entries) if entry is UNKNOWN_COLUMN or entry.unit]


def _decimal_sign_of(header: Sequence[str], table: pd.DataFrame, problems: Problems) -> str:
    """The sign of most numbers, which the others must have."""
    numeric = _numeric(header)
    signs = table[numeric].map(_decimal_sign)
    commas, points = (np.count_nonzero(signs == sign) for sign in (",", "."))
    usual, other = (",", ".") if commas > points else (".", ",")
    came = f"{{!r}} with a decimal {DECIMAL_SIGNS[other]}"
    expected = f"expected a decimal {DECIMAL_SIGNS[usual]} as in {max(commas, points)} numbers"
    for k in numeric:
        is_other = (signs[k] == other).to_numpy()
        problems.at(is_other, header[k], f"{came}; {expected}", table[k].to_numpy())
    problems.stop()
    return usual


def _decimal_sign(cell: object) -> str:
    """The sign in a number; "" without one."""
    match = _NUMBER.fullmatch(str(cell))
    return match[1] if match else ""


def _with_sign(cells: Iterable[Any], sign: str) -> list[Any]:
    signs = [(cell, _decimal_sign(cell)) for cell in cells]
    return [str(cell).replace(stated, sign) if stated else cell for cell, stated in signs]


def _text(path: str, content: bytes) -> str:
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
    if _ARM_FILE.search(text):
        raise MeasurementFileError(
            path,
            None,
            "",
            "this is an arm file (TOML); expected a measurement file (CSV); state ARM before DATA",
        )
    return text


def joined_by_record(path: str, first: CsvTable, other: str, second: CsvTable) -> pd.DataFrame:
    """Rows of the first file with the columns of the second, by ``record`` or else in order.

    Raises:
        MeasurementFileError: a column is in both, a value of ``record`` is missing or repeated, or
            the numbers of rows differ.
    """
    table, added = first.table, second.table
    for name in table.columns.intersection(added.columns).drop("record", errors="ignore"):
        raise MeasurementFileError(
            other, 1, name, f"{path} also has this column; expected each column in one file only"
        )
    if "record" in table and "record" in added:
        _check_labels(path, first, added["record"], other)
        _check_labels(other, second, table["record"], path)
        return table.merge(added, how="left", on="record")
    if len(table) != len(added):
        raise MeasurementFileError(
            other,
            None,
            "record",
            f"{len(added)} rows; expected {len(table)}, as many as in {path}, or the column "
            "`record` in both files",
        )
    return pd.concat([table, added], axis=1)


def _check_labels(path: str, file: CsvTable, labels_of_other: pd.Series, other: str) -> None:
    problems = Problems(path, file.lines)
    labels = file.table["record"]
    cells = labels.to_numpy()
    is_repeated = labels.duplicated().to_numpy()
    problems.at(is_repeated, "record", "{!r} occurs again; expected each label once", cells)
    is_missing = ~labels.isin(labels_of_other).to_numpy()
    problems.at(is_missing, "record", f"{{!r}}; expected a label that is also in {other}", cells)
    problems.stop()
