"""The cells of an Excel workbook (``*.xlsx``) as text, with openpyxl (the extra ``excel``)."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from aacmm_pin.errors import MeasurementFileError

MOST_UNPACKED = 500_000_000
"""Bytes of an unpacked workbook that is read."""
_ZIP = b"PK\x03\x04"


class Sheet(NamedTuple):
    """A sheet: its title, how many sheets the workbook has, and number and cells of each row, those
    left out that are empty.
    """

    title: str
    of: int
    rows: list[tuple[int, list[str]]]


def is_workbook(content: bytes) -> bool:
    """Whether the content of a file is that of a workbook, or of another ZIP archive."""
    return content.startswith(_ZIP)


def first_sheet(path: str, content: bytes) -> Sheet:
    """The first sheet of a workbook: numbers as Python writes them, formulas as their last values.

    Raises:
        MeasurementFileError: openpyxl is not installed, it cannot read the file, or the file is too
            large.
    """
    try:
        import openpyxl  # optional
    except ImportError:
        raise MeasurementFileError(
            path,
            None,
            "",
            "this is an Excel workbook; expected a CSV file; save the workbook as CSV, or run "
            "pip install 'aacmm-pin[excel]'",
        ) from None
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size > MOST_UNPACKED:
            raise MeasurementFileError(
                path,
                None,
                "",
                f"the unpacked workbook has {size / 1e6:.0f} MB; expected at most "
                f"{MOST_UNPACKED / 1e6:g} MB",
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions
            book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
            sheet = book.worksheets[0]
            rows = list(_rows(sheet.iter_rows(values_only=True)))
    except MeasurementFileError:
        raise
    except Exception as error:  # whatever the reader makes of the bytes
        raise MeasurementFileError(
            path,
            None,
            "",
            f"openpyxl cannot read this file: {error}; expected an Excel workbook (*.xlsx) or a "
            "CSV file in UTF-8",
        ) from None
    return Sheet(sheet.title, len(book.worksheets), rows)


def _rows(rows: Iterable[tuple[object, ...]]) -> Iterator[tuple[int, list[str]]]:
    """Rows that are not empty, without the empty cells behind the last."""
    for number, row in enumerate(rows, start=1):
        cells = ["" if value is None else str(value) for value in row]
        while cells and not cells[-1].strip():
            cells.pop()
        if cells:
            yield number, cells
