"""Excel workbooks: the records are those of the same table as CSV, and messages name the row of the
sheet.
"""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import Measurements, accept, simulate_measurements
from aacmm_pin.errors import MeasurementFileError
from aacmm_pin.verification import History
from tests.cli import shell
from tests.verification.probed_points import everything

openpyxl = pytest.importorskip("openpyxl", reason="needs the extra aacmm-pin[excel]")


@pytest.fixture(scope="module")
def table(tmp_path_factory) -> pd.DataFrame:
    """Records at seats, with empty cells, labels that are numbers, and all kinds of numbers."""
    path = tmp_path_factory.mktemp("excel") / "data.csv"
    records = simulate_measurements("sino6", "seats", 40, rng=np.random.default_rng(1))
    records.save(path)
    read = pd.read_csv(path)
    read["seat"] = pd.factorize(read["seat"])[0] + 7
    return read.assign(operator="Zoë", humidity_pct=40.0625 + np.arange(len(read)) / 8)


def workbook(path: Path, rows: list[list[Any]], *others: str) -> Path:
    """A file with these rows in its first sheet."""
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    for title in others:
        book.create_sheet(title).append(["another"])
    book.save(path)
    return path


def rows_of(table: pd.DataFrame) -> list[list[Any]]:
    cells = table.astype(object).where(table.notna(), None)
    return [list(table.columns), *cells.to_numpy().tolist()]


def test_records_are_those_of_the_csv(table, tmp_path):
    table.to_csv(tmp_path / "data.csv", index=False)
    path = workbook(tmp_path / "data.xlsx", rows_of(table))
    excel, text = (Measurements.read(p, 6) for p in (path, tmp_path / "data.csv"))
    # openpyxl writes 16 digits.
    pd.testing.assert_frame_equal(excel.to_frame(), text.to_frame(), rtol=1e-15)
    np.testing.assert_array_equal(excel.row, text.row)
    pd.testing.assert_frame_equal(excel.extra, text.extra)
    assert excel.read_as == text.read_as


def test_rows_are_numbered_as_in_the_sheet(table, tmp_path):
    """Comments, rows and cells that are empty, and blanks beside the table are no records."""
    header, *records = rows_of(table)
    rows = [["# made by hand"], [], [*header, None], records[0], [None] * 3, *records[1:], [None]]
    found = Measurements.read(workbook(tmp_path / "data.xlsx", rows), 6)
    assert found.row[:3].tolist() == [4, 6, 7]
    rows[6] = [*records[2]]
    rows[6][header.index("theta2_deg")] = "1,5"
    with pytest.raises(MeasurementFileError, match=r"row 7, column theta2_deg: '1,5'"):
        Measurements.read(workbook(tmp_path / "text.xlsx", rows), 6)
    rows[6] = [*records[2], "beside"]
    with pytest.raises(MeasurementFileError, match="column 25 of 25 has no name"):
        Measurements.read(workbook(tmp_path / "beside.xlsx", rows), 6)


def test_commands_take_workbooks(table, tmp_path):
    path = workbook(tmp_path / "data.xlsx", rows_of(table))
    shell.done(f"check sino6 {path}")
    shell.done(f"correct sino6 {path} -o {tmp_path / 'corrected.csv'}")
    assert len(pd.read_csv(tmp_path / "corrected.csv")) == len(table)
    points = everything("single-point")
    points.to_csv(tmp_path / "points.csv", index=False)
    probed = workbook(tmp_path / "points.xlsx", rows_of(points))
    excel, text = (accept(tmp_path / f"points.{end}") for end in ("xlsx", "csv"))
    pd.testing.assert_frame_equal(excel.to_frame(), text.to_frame())
    shell.done(f"accept {probed} -o {tmp_path / 'report.html'}")
    history = workbook(tmp_path / "history.xlsx", [["time"]])
    with pytest.raises(MeasurementFileError, match="a workbook"):
        History.read(history)


def test_what_is_no_workbook(table, tmp_path, monkeypatch):
    empty = workbook(tmp_path / "empty.xlsx", [])
    with pytest.raises(MeasurementFileError, match="empty"):
        Measurements.read(empty, 6)
    path = tmp_path / "archive.xlsx"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.txt", "a")
    with pytest.raises(MeasurementFileError, match="expected an Excel workbook"):
        Measurements.read(path, 6)
    workbook(tmp_path / "data.xlsx", rows_of(table))
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(MeasurementFileError, match=r"aacmm-pin\[excel\]"):
        Measurements.read(tmp_path / "data.xlsx", 6)
