"""Angles and references that stand in two files, joined by the label of a record or row by row."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.file_problems import Problems
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.measurements.csv_table import CsvTable
from aacmm_pin.measurements.csv_values import cells_of

RECORD = "record"
"""The column by which the rows of two files are joined."""


def joined(path: str, first: CsvTable, other: str, second: CsvTable) -> pd.DataFrame:
    """The rows of the first file with the columns of the second.

    Rows belong together by :data:`RECORD` if both files have this column, else in their order.

    Raises:
        MeasurementFileError: both files have a column; a label is missing or repeated; or the files
            have other numbers of rows.
    """
    one, two = first.table, second.table
    by_label = RECORD in one and RECORD in two
    for name in one.columns.intersection(two.columns).drop(RECORD, errors="ignore"):
        raise MeasurementFileError(
            other, 1, name, f"{path} also has this column; expected each column in one file only"
        )
    if not by_label:
        if len(one) != len(two):
            raise MeasurementFileError(
                other,
                None,
                RECORD,
                f"{len(two)} rows; expected {len(one)}, as many as in {path}, or the column "
                "`record` in both files",
            )
        return pd.concat([one, two], axis=1)
    _check_labels(path, first, second.table, other)
    _check_labels(other, second, first.table, path)
    row = pd.Index(cells_of(two[RECORD])).get_indexer(pd.Index(cells_of(one[RECORD])))
    in_order = two.iloc[row].reset_index(drop=True)
    return pd.concat([one, in_order.drop(columns=RECORD)], axis=1)


def _check_labels(path: str, file: CsvTable, others: pd.DataFrame, other: str) -> None:
    """Each label of a file stands there once, and in the other file.

    Raises:
        MeasurementFileError: it does not.
    """
    problems = Problems(path, file.lines)
    labels = cells_of(file.table[RECORD])
    again = pd.Series(labels).duplicated().to_numpy()
    problems.at(again, RECORD, "{!r} occurs again; expected each label once", labels)
    missing = ~np.isin(labels, cells_of(others[RECORD]))
    problems.at(missing, RECORD, f"{{!r}}; expected a label that is also in {other}", labels)
    problems.stop()
