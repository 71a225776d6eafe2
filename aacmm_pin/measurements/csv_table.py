"""The cells of a CSV file as text, however the program that wrote it separates cells and writes numbers."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Index
from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.text_escaping import csv_unquoted
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_columns import LABELS, Problems, is_known

LARGEST_FILE = 100_000_000
"""Bytes of a measurement file that is read, which are a quarter of a million records; its table takes ten times as much."""
SEPARATORS = {";": "semicolons", "\t": "tabulators"}
"""Separators of cells beside commas, and what they are called."""
_COMMA = re.compile(r"\s*[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?\s*")
_POINT = re.compile(r"\s*[+-]?[0-9]*\.[0-9]*([eE][+-]?[0-9]+)?\s*")


def measurement_file(path: str) -> bytes:
    """Its content.

    Raises:
        MeasurementFileError: the file cannot be read.
    """
    expected = "a measurement file, *.csv,"
    return content_of(path, LARGEST_FILE, expected, lambda message: MeasurementFileError(path, None, "", message))


def read_table(path: str, content: bytes | None = None) -> tuple[pd.DataFrame, Index, tuple[str, ...]]:
    """Cells of a CSV file as text, the line of each record, and how the file was read where that is not as it usually is.

    Cells may be separated by commas, semicolons or tabulators, with spaces behind them; with the latter two, numbers may
    have decimal commas. Lines that begin with #, and a first one such as sep=; of
    spreadsheets, are left out where they can be no records. Known names of columns may be in
    upper case. (pandas would fill short rows up and lose count of the lines.) With ``content`` nothing is read.

    Raises:
        MeasurementFileError: the file cannot be read, or is not such a table.
    """
    text = _text(path, measurement_file(path) if content is None else content)
    notes: list[str] = []
    header = _header(path, text, ",")
    separator = next((mark for mark in SEPARATORS if len(header) == 1 and mark in header[0]), ",")
    if separator != ",":
        notes.append(f"{SEPARATORS[separator]} between cells")
        header = _header(path, text, separator)
    spaced = any(name.startswith(" ") for name in header[1:])
    every = list(_rows(path, text, separator, spaced))
    rows = [(line, cells) for line, cells, comment in every if not comment]
    comments = len(every) - len(rows)
    if not rows:
        raise MeasurementFileError(path, None, "", "has comments only, expected a header and one row a record")
    if spaced:
        notes.append("spaces around cells left out")
        rows = [(line, [cell.strip() for cell in cells]) for line, cells in rows]
    if comments:
        notes.append(f"{comments} line{'s' * (comments != 1)} that begin{'s' * (comments == 1)} with # or sep= left out")
    header = _lower_case(rows[0][1], notes)
    problems = Problems(path, np.array([line for line, _ in rows], dtype=np.intp))
    cells_of = np.array([len(cells) for _, cells in rows])
    expected = f"{{}} cells, expected {len(header)} as in the header (decimal points; quotes around text with commas)"
    problems.at(cells_of != len(header), "", expected, cells_of)
    first = np.array([cells[0].strip()[:1] for _, cells in rows])
    first[0] = ""  # the header's
    if {*first} - {"", "#"}:  # where all labels begin with # they are no comments
        problems.at(
            first == "#", header[0], "begins with # as a comment or a label may; delete the row, or name it otherwise"
        )
    problems.stop()
    columns = {k: list(cells[1:]) for k, cells in enumerate(zip(*(cells for _, cells in rows), strict=True))}
    if separator != ",":
        _decimal_points(header, columns, notes)
    table = pd.DataFrame(columns, dtype=object).set_axis(header, axis=1)
    return table, problems.lines[1:], ("the file was read with " + ", ".join(notes),) if notes else ()


def _header(path: str, text: str, separator: str) -> list[str]:
    """The first line that is no comment; no cells where there is none."""
    return next((cells for _, cells, comment in _rows(path, text, separator, strict=False) if not comment), [])


def _rows(
    path: str, text: str, separator: str, spaced: bool = False, strict: bool = True
) -> Iterator[tuple[int, list[str], bool]]:
    """Line and cells of all that is not empty, and whether that is a comment; the first that is none is the header.

    Raises:
        MeasurementFileError: quotes are not as in CSV.
    """
    end = 0
    header: list[str] = []
    reader = csv.reader(io.StringIO(text, newline=""), strict=strict, delimiter=separator, skipinitialspace=spaced)
    try:
        for cells in reader:
            comment = bool(cells) and cells[0].lstrip().startswith("#")
            comment = comment or (not header and bool(cells) and re.fullmatch("sep=.?", cells[0], re.IGNORECASE) is not None)
            if comment and header:  # a label may begin with #, a number does not
                name = header[0].strip().lower()
                comment = len(cells) != len(header) or (is_known(name) and name not in LABELS)
            if cells:
                header = header or ([] if comment else cells)
                yield end + 1, [csv_unquoted(cell) for cell in cells], comment
            end = reader.line_num
    except csv.Error as error:
        raise MeasurementFileError(path, end + 1, "", f"not CSV: {error}; look at the quotes") from None


def _lower_case(header: list[str], notes: list[str]) -> list[str]:
    """The names, those that are known in lower case so."""
    theirs: tuple[str, ...] = ()
    if "test" in map(str.lower, header):
        from aacmm_pin.measurements.acceptance_columns import ACCEPTANCE as theirs
    lower = [name.lower() if is_known(name.lower()) or name.lower() in theirs else name for name in header]
    if lower == header or max(Counter(lower).values()) > 1:
        return header
    notes.append("names of columns in lower case")
    return lower


def _decimal_points(header: list[str], columns: dict[int, list[str]], notes: list[str]) -> None:
    """Points in the stead of decimal commas, in all columns of numbers, unless some number has a point already."""
    numbers = [k for k, name in enumerate(header) if name not in LABELS]
    cells = [cell for k in numbers for cell in columns[k]]
    if any(map(_POINT.fullmatch, cells)) or not any(map(_COMMA.fullmatch, cells)):
        return
    notes.append("decimal commas")
    for k in numbers:
        columns[k] = [cell.replace(",", ".") if _COMMA.fullmatch(cell) else cell for cell in columns[k]]


def _text(path: str, content: bytes) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        expected = "expected a CSV file in UTF-8, as every spreadsheet can save it"
        message = f"not UTF-8 text (byte {error.start}); {expected}"
        raise MeasurementFileError(path, line, "", message) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise MeasurementFileError(path, line, "", "has a NUL byte: not text, or in UTF-16; expected a CSV file in UTF-8")
    if not text.strip():
        raise MeasurementFileError(path, None, "", "is empty, expected a header and one row a record")
    return text
