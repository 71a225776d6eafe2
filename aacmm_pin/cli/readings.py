"""Readings to be corrected: a measurement file of which only angles and conditions count; all columns are kept as text."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pandas as pd

from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_columns import BAR, REFERENCE, REFERENCE_U
from aacmm_pin.measurements.records import FIRST_RECORD, Measurements

OF_REFERENCES = ("seat", *BAR, *REFERENCE, *REFERENCE_U)
"""What says where the tip should be has no part in where the readings put it."""


def read_readings(path: str, nq: int, added: tuple[str, ...]) -> tuple[pd.DataFrame, Measurements]:
    """The table as it stands, and its angles and conditions.

    Args:
        path: the file (CSV).
        nq: joints of the arm.
        added: names of columns that will be added.

    Raises:
        MeasurementFileError: the file cannot be read, its angles or conditions are of no use, or it has a column of a name
            that will be added.
    """
    table = _table(path)
    for name in added:
        if name in table.columns:
            raise MeasurementFileError(path, 1, name, "is there already; expected readings that were not corrected yet")
    of_readings = [name not in OF_REFERENCES for name in table.columns]
    return table, Measurements.from_frame(table.loc[:, of_readings], nq, path)


def _table(path: str) -> pd.DataFrame:
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
        rows = [cells for cells in csv.reader(io.StringIO(text, newline=""), strict=True) if cells]
    except OSError as error:
        raise MeasurementFileError(path, None, "", f"cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise MeasurementFileError(path, None, "", f"not CSV in UTF-8: {error}") from None
    if not rows:
        raise MeasurementFileError(path, None, "", "is empty, expected a header and one row a record")
    for number, cells in enumerate(rows[1:], start=FIRST_RECORD):
        if len(cells) != len(rows[0]):
            expected = f"{len(cells)} cells, expected {len(rows[0])} as in the header"
            raise MeasurementFileError(path, number, "", expected)
    return pd.DataFrame(rows[1:], dtype=object).set_axis(rows[0], axis=1) if rows[1:] else pd.DataFrame(columns=rows[0])
