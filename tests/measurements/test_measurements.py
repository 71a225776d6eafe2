"""Measurement files: every column in its unit, what each mistake is answered with, and that nothing is lost on the way."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, MeasurementFileError, OutputError, ShapeError, UnknownNameError
from aacmm_pin.measurements import csv_columns as measurement_columns
from aacmm_pin.measurements.records import Bar, Measurements

DEG = np.pi / 180

FULL = """\
theta1_deg,theta2_deg,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm,seat,marker,bar,bar_end,bar_length_mm,time_s,temperature1_c,\
temperature2_c,temperature3_c,approach1,approach2,torque1_nm,torque2_nm,session,operator,record,humidity,comment
10,-20.5,100,200,-300,0.01,0.02,0.03,,m1,,,,0,20,21,22,-1,0,0.5,-1.5,s1,Ann,1,45.0,
90,1e1,,,,,,,007,m1,ball,A,500,1.5,20,21,22,1,1,0.5,-1.5,s1,Ann,2,45.5,"a ""b"", c"
-90,45,,,,,,,NA,m2,ball,B,500.0,-1,20,21,22,0,0,0,0,s1,Ann,3,,NaN
180,-45,1,2,3,,,,007,,,,,9,20,21,22,0,0,0,0,s2,Bob,,wet,
"""

SMALL = """\
theta1_deg,theta2_deg,x_mm,y_mm,z_mm
10,20,1,2,3
11,21,1,2,3
"""


@pytest.fixture
def full(tmp_path: Path) -> Measurements:
    return Measurements.read(write(tmp_path, FULL))


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "data.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def error_of(folder: Path, content: str | bytes, nq: int | None = None) -> MeasurementFileError:
    with pytest.raises(MeasurementFileError) as caught:
        Measurements.read(write(folder, content), nq)
    assert str(caught.value).startswith(f"{folder / 'data.csv'}: ")
    assert caught.value.path == str(folder / "data.csv")
    return caught.value


def assert_same(a: Measurements, b: Measurements) -> None:
    """Equal in everything but the source, the lines, and the type that pandas chose for unknown columns of text."""
    tolerance = {"rtol": 1e-15, "atol": 1e-15, "equal_nan": True}
    for name in ("q", "reference", "reference_u", "bar_length"):
        mine, theirs = getattr(a, name), getattr(b, name)
        assert (mine is None) == (theirs is None), name
        if mine is not None:
            np.testing.assert_allclose(mine, theirs, err_msg=name, **tolerance)
    for name in ("bar", "bar_end", "operator", "record"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert a.conditions.n == b.conditions.n == a.n
    assert a.conditions.present == b.conditions.present
    for name in a.conditions.present:
        np.testing.assert_array_equal(getattr(a.conditions, name), getattr(b.conditions, name), err_msg=name)
    pd.testing.assert_frame_equal(a.extra.astype(str), b.extra.astype(str), check_column_type=False)


# --- what is in a file


def test_every_column_is_read_in_its_unit(full: Measurements) -> None:
    assert (full.n, full.nq, full.source.endswith("data.csv")) == (4, 2, True)
    np.testing.assert_allclose(full.q, np.array([[10, -20.5], [90, 10], [-90, 45], [180, -45]]) * DEG, rtol=1e-15)
    nan = [np.nan] * 3
    np.testing.assert_allclose(full.reference, [[0.1, 0.2, -0.3], nan, nan, [1e-3, 2e-3, 3e-3]], rtol=1e-15)
    np.testing.assert_allclose(full.reference_u, [[1e-5, 2e-5, 3e-5], nan, nan, nan], rtol=1e-15)
    np.testing.assert_array_equal(full.known, [True, False, False, True])
    np.testing.assert_array_equal(full.row, [2, 3, 4, 5])
    assert full.bar is not None
    assert full.bar.tolist() == ["", "ball", "ball", ""]
    assert full.bar_end is not None
    assert full.bar_end.tolist() == ["", "A", "B", ""]
    np.testing.assert_array_equal(full.bar_length, [np.nan, 0.5, 0.5, np.nan])
    assert full.operator is not None
    assert full.operator.tolist() == ["Ann", "Ann", "Ann", "Bob"]
    assert full.record is not None
    assert full.record.tolist() == ["1", "2", "3", ""]


def test_conditions_are_read(full: Measurements) -> None:
    known = full.conditions
    assert known.n == 4
    assert known.present == ("time", "link_temperature", "approach", "torque", "seat", "marker", "session")
    np.testing.assert_array_equal(known.time, [0, 1.5, -1, 9])  # running backwards is no mistake
    np.testing.assert_array_equal(known.link_temperature, [[20, 21, 22]] * 4)  # a DH table may have more rows than joints
    np.testing.assert_array_equal(known.approach, [[-1, 0], [1, 1], [0, 0], [0, 0]])
    np.testing.assert_array_equal(known.torque, [[0.5, -1.5]] * 2 + [[0, 0]] * 2)
    assert known.seat is not None
    assert known.seat.tolist() == ["", "007", "NA", "007"]  # labels are text: no number, no missing value
    assert known.marker is not None
    assert known.marker.tolist() == ["m1", "m1", "m2", ""]


def test_unknown_columns_are_kept_as_they_came(full: Measurements) -> None:
    assert full.extra.to_dict("list") == {
        "humidity": ["45.0", "45.5", "", "wet"],
        "comment": ["", 'a "b", c', "NaN", ""],
    }


def test_radians_and_one_temperature(tmp_path: Path) -> None:
    text = "theta2_rad,theta1_rad,temperature_c\n-0.5,31.4,21.5\n"
    measurements = Measurements.read(write(tmp_path, text), nq=2)
    np.testing.assert_array_equal(measurements.q, [[31.4, -0.5]])  # by number, whatever the order of the columns
    np.testing.assert_array_equal(measurements.conditions.temperature, [21.5])
    assert not measurements.known.any()
    assert (measurements.seats(), measurements.bars()) == ({}, [])


def test_spellings_of_text_files(tmp_path: Path) -> None:
    """A byte order mark, other line ends, blank lines, spaces around numbers, a line break within quotes."""
    plain = Measurements.read(write(tmp_path, SMALL))
    for text in (
        "\ufeff" + SMALL,
        SMALL.replace("\n", "\r\n"),
        SMALL.replace("\n", "\r"),
        SMALL.rstrip("\n"),
        SMALL + "\n\n",
        SMALL.replace(",20,", ", 20 ,"),
        SMALL.replace(",20,", ',"20",'),
    ):
        assert_same(Measurements.read(write(tmp_path, text)), plain)
    text = 'theta1_deg,comment\n1,"two\nlines"\n\n2,x\n'
    assert Measurements.read(write(tmp_path, text)).row.tolist() == [2, 5]
    assert error_of(tmp_path, text.replace("2,x", "two,x")).row == 5


def test_from_frame_takes_numbers_and_missing_values() -> None:
    table = pd.DataFrame(
        {
            "theta1_rad": pd.array([1, 2, 3], dtype="Int64"),
            "x_mm": [1.0, np.nan, np.nan],
            "y_mm": pd.array([2.0, None, None], dtype="Float64"),
            "z_mm": ["3", "", None],
            "seat": [7, None, "a b"],
            "session": pd.Categorical(["one", None, "one"]),
            "dew": [0.5, np.nan, 1.5],
        },
        index=[9, 9, 4],
    )
    table.loc[4, ["x_mm", "y_mm", "z_mm"]] = [1.0, 1.0, "1.0"]
    measurements = Measurements.from_frame(table)
    np.testing.assert_array_equal(measurements.q, [[1], [2], [3]])
    np.testing.assert_allclose(measurements.reference, [[1e-3, 2e-3, 3e-3], [np.nan] * 3, [1e-3] * 3])
    assert measurements.conditions.seat is not None
    assert measurements.conditions.seat.tolist() == ["7", "", "a b"]
    assert measurements.conditions.session is not None
    assert measurements.conditions.session.tolist() == ["one", "", "one"]
    pd.testing.assert_frame_equal(measurements.extra, pd.DataFrame({"dew": [0.5, np.nan, 1.5]}))
    assert (measurements.source, measurements.row.tolist()) == ("table", [2, 3, 4])


def test_from_frame_keeps_no_hold_of_the_table() -> None:
    seats = np.array(["a", "a"], dtype=object)
    table = pd.DataFrame({"theta1_rad": [1.0, 2.0], "time_s": [1.0, 2.0], "seat": seats, "dew": [1.0, 2.0]})
    measurements = Measurements.from_frame(table)
    for name, value in {"theta1_rad": 9.0, "time_s": 9.0, "seat": "z", "dew": 9.0}.items():
        table.loc[:, name] = value
    assert measurements.q.tolist() == [[1], [2]]
    np.testing.assert_array_equal(measurements.conditions.time, [1, 2])
    assert measurements.seats().keys() == {"a"}
    assert measurements.extra["dew"].tolist() == [1, 2]


def test_bounds_belong_to_what_is_believed() -> None:
    table = pd.DataFrame({"theta1_rad": [10 * np.pi, -10 * np.pi], "temperature_c": [-50, 150]})
    np.testing.assert_array_equal(Measurements.from_frame(table).q, table[["theta1_rad"]])
    assert Measurements.from_frame(pd.DataFrame({"theta1_deg": [1.0, -1, 1, -1, 0]})).n == 5
    with pytest.raises(MeasurementFileError, match="radians"):
        Measurements.from_frame(pd.DataFrame({"theta1_deg": [2 * np.pi, 0, 0, 0, 0]}))


# --- mistakes: the file

# content, row, words of the answer
FILES: dict[str, tuple[str | bytes, int | None, Sequence[str]]] = {
    "empty": (b"", None, ["is empty", "expected a header"]),
    "blank": (b"\n \n", None, ["is empty"]),
    "header only": (SMALL.splitlines()[0], None, ["has a header but no records"]),
    "not UTF-8": (
        SMALL.replace("z_mm", "z_mm,größe").encode("latin-1"),
        1,
        ["not UTF-8", "byte 39", "expected a CSV file in UTF-8"],
    ),
    "UTF-16": (SMALL.encode("utf-16-le"), None, ["UTF-16", "expected a CSV file in UTF-8"]),
    "UTF-16 with a mark": (SMALL.encode("utf-16"), 1, ["not UTF-8"]),
    "open quote": (SMALL.replace("11,", '11,"'), 3, ["not CSV", "quotes"]),
    "text behind a quote": (SMALL.replace("11,", '"11"x,'), 3, ["not CSV", "quotes"]),
    "short row": (SMALL.replace(",21,1,2,3", ",21,1,2"), 3, ["4 cells, expected 5 as in the header"]),
    "long row": (SMALL.replace("10,20", "10,20,30"), 2, ["6 cells, expected 5"]),
    "short rows": (SMALL + "12\n13,14\n", 4, ["1 cells, expected 5", "and 1 more: row 5"]),
    "decimal commas": (SMALL.replace("10,20", "10,5,20,5"), 2, ["7 cells, expected 5", "decimal points"]),
    "semicolons": (SMALL.replace(",", ";"), 1, ["semicolons", "expected commas between cells", "decimal points"]),
    "semicolons and commas": (
        "theta1_deg;theta2_deg\n1,5;1.234,5\n",
        1,
        ["semicolons", "expected commas between cells", "decimal points"],
    ),
    "comment": ("# arm 7 on Tuesday\n" + SMALL, 1, ["begins with '# arm 7 on Tuesday'", "no comments"]),
    "tabs": (SMALL.replace(",", "\t"), 1, ["tabulators", "expected commas between cells"]),
}


@pytest.mark.parametrize("mistake", FILES)
def test_a_file_that_is_no_table(tmp_path: Path, mistake: str) -> None:
    content, row, words = FILES[mistake]
    error = error_of(tmp_path, content)
    assert error.row == row
    for word in words:
        assert word in str(error)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(MeasurementFileError, match=r"none\.csv: no such file"):
        Measurements.read(tmp_path / "none.csv")
    with pytest.raises(MeasurementFileError, match=r"is a folder, expected a measurement file"):
        Measurements.read(tmp_path)
    with pytest.raises(MeasurementFileError, match="cannot be read: "):
        Measurements.read(write(tmp_path, SMALL) / "inside.csv")


# --- mistakes: the header

# header, number of joints of the arm or None, column, words of the answer
HEADERS: dict[str, tuple[str, int | None, str, Sequence[str]]] = {
    "no name": ("theta1_deg,,x", None, "", ["column 2 of 3 has no name"]),
    "twice": ("theta1_deg,seat,seat", None, "seat", ["2 times", "expected each name once"]),
    "angle twice": ("theta1_deg,theta1_deg", None, "theta1_deg", ["2 times"]),
    "unknown twice": ("theta1_deg,wind,wind", None, "wind", ["2 times"]),
    "no angles": ("a,b,x_mm", None, "", ["no angles", "theta1_deg … (or theta1_rad …)", "'a', 'b', 'x_mm'"]),
    "no header": ("10,20,1", None, "", ["no angles", "first line", "'10', '20', '1'"]),
    "gap": ("theta1_deg,theta3_deg", None, "theta1_deg … theta3_deg", ["numbered 1, 3", "theta2_deg is missing"]),
    "from zero": ("theta0_deg,theta1_deg", None, "theta0_deg … theta1_deg", ["numbered 0, 1", "expected numbers from 1"]),
    "from two": ("theta2_rad", None, "theta2_rad", ["numbered 2", "theta1_rad is missing"]),
    "two units": (
        "theta1_deg,theta2_rad,theta3_deg",
        None,
        "",
        ["theta1_deg, theta3_deg in degrees", "theta2_rad in radians", "expected one unit"],
    ),
    "another arm": (
        "theta1_rad,theta2_rad,theta3_rad",
        2,
        "theta1_rad … theta3_rad",
        ["3 joints", "the arm has 2", "expected theta1_rad … theta2_rad"],
    ),
    "fewer joints": ("theta1_deg", 6, "theta1_deg", ["1 joints", "the arm has 6", "expected theta1_deg … theta6_deg"]),
    "x alone": ("theta1_deg,x_mm", None, "y_mm, z_mm", ["missing beside x_mm", "expected all of x_mm, y_mm, z_mm"]),
    "no y": ("theta1_deg,z_mm,x_mm", None, "y_mm", ["missing beside x_mm, z_mm"]),
    "no u_z": ("theta1_deg,x_mm,y_mm,z_mm,u_x_mm,u_y_mm", None, "u_z_mm", ["missing beside u_x_mm, u_y_mm"]),
    "u without reference": (
        "theta1_deg,u_x_mm,u_y_mm,u_z_mm",
        None,
        "u_x_mm",
        ["reference that is not there", "expected x_mm, y_mm, z_mm"],
    ),
    "no bar_end": ("theta1_deg,seat,bar,bar_length_mm", None, "bar_end", ["missing beside bar, bar_length_mm"]),
    "no bar_length": ("theta1_deg,seat,bar,bar_end", None, "bar_length_mm", ["missing beside bar, bar_end"]),
    "bar alone": ("theta1_deg,seat,bar", None, "bar_end, bar_length_mm", ["missing beside bar"]),
    "bar without seat": ("theta1_deg,bar,bar_end,bar_length_mm", None, "seat", ["missing beside bar"]),
    "both temperatures": (
        "theta1_deg,temperature_c,temperature1_c",
        None,
        "temperature_c",
        ["beside temperature1_c", "expected one temperature, or one for each DH row"],
    ),
    "gap in temperatures": (
        "theta1_deg,temperature1_c,temperature3_c",
        None,
        "temperature1_c … temperature3_c",
        ["numbered 1, 3", "temperature2_c is missing"],
    ),
    "few temperatures": (
        "theta1_deg,theta2_deg,temperature1_c",
        None,
        "temperature1_c",
        ["1 columns", "one for each DH row, so 2 or more", "temperature_c"],
    ),
    "gap in approaches": ("theta1_deg,approach2", None, "approach2", ["numbered 2", "approach1 is missing"]),
    "few approaches": ("theta1_deg,theta2_deg,approach1", None, "approach1", ["1 columns", "each of the 2 joints"]),
    "many approaches": (
        "theta1_deg,approach1,approach2",
        None,
        "approach1 … approach2",
        ["2 columns", "each of the 1 joints"],
    ),
    "gap in torques": ("theta1_deg,torque3_nm", None, "torque3_nm", ["numbered 3", "torque1_nm is missing"]),
    "few torques": ("theta1_deg,theta2_deg,torque1_nm", None, "torque1_nm", ["1 columns", "each of the 2 joints"]),
}


@pytest.mark.parametrize("mistake", HEADERS)
def test_a_header_with_a_mistake(tmp_path: Path, mistake: str) -> None:
    header, nq, column, words = HEADERS[mistake]
    cells = ",".join("1" for _ in header.split(","))
    error = error_of(tmp_path, f"{header}\n{cells}\n{cells}\n", nq)
    assert (error.row, error.column) == (None, column)
    for word in words:
        assert word in str(error)


@pytest.mark.parametrize(
    ("slip", "meant"),
    [
        (" seat", "seat"),
        ("Seat", "seat"),
        ("X_mm", "x_mm"),
        ("x mm", "x_mm"),
        ("x [mm]", "x_mm"),
        ("x-mm", "x_mm"),
        ("x_m", "x_mm"),
        ("z_in", "z_mm"),
        ("ux_mm", "u_x_mm"),
        ("u_x_um", "u_x_mm"),
        ("Theta2_deg", "theta2_deg"),
        ("theta 2 (deg)", "theta2_deg"),
        ("theta2_rad ", "theta2_rad"),
        ("theta02_deg", "theta2_deg"),
        ("thetta2_deg", "theta2_deg"),
        ("theta2_mrad", "theta2_deg"),
        ("aproach1", "approach1"),
        ("approach_1", "approach1"),
        ("torque1_Nm", "torque1_nm"),
        ("torque1_nmm", "torque1_nm"),
        ("temperature_°C", "temperature_c"),
        ("temperature", "temperature_c"),
        ("temperature_k", "temperature_c"),
        ("temperature3_f", "temperature3_c"),
        ("time_ms", "time_s"),
        ("Time s", "time_s"),
        ("bar end", "bar_end"),
        ("bar_lenght_mm", "bar_length_mm"),
        ("bar_length", "bar_length_mm"),
        ("bar_length_m", "bar_length_mm"),
        ("sesion", "session"),
        ("records", "record"),
        ("Operator", "operator"),
        ("MARKER", "marker"),
    ],
)
def test_a_slip_in_a_name_is_no_unknown_column(tmp_path: Path, slip: str, meant: str) -> None:
    error = error_of(tmp_path, f"theta1_deg,{slip}\n1,1\n")
    assert (error.row, error.column) == (None, slip)
    assert f"is not a known name; expected {meant}," in str(error)


def test_a_slip_beside_the_known_column(tmp_path: Path) -> None:
    assert "expected seat" in str(error_of(tmp_path, "theta1_deg,seat,Seat\n1,,\n"))
    for header in ("session,sessions", "temperature_c,temperature_k", "x_mm,y_mm,z_mm,x_m", "time_s,time_ms"):
        names = f"theta1_deg,{header}".split(",")
        text = ",".join(names) + "\n" + ",".join("1" for _ in names) + "\n"
        assert list(Measurements.read(write(tmp_path, text)).extra.columns) == names[-1:]  # then it is another thing


UNRELATED = """
    humidity theta q1 Δx_mm dx_mm nominal_x_mm x_mm_nominal pressure_hpa comment seat_id seat2 marker1 time date
    timestamp load_kg wrist_load_nm rpm1 theta1_deg_raw q1_deg torque_limit_nm room_temperature_c bar_pressure encoder1
    operator_age probe force_n 1 温度
"""


@pytest.mark.parametrize("name", ["x", "y", "Z"])
def test_a_coordinate_without_a_unit_is_refused(name: str) -> None:
    assert measurement_columns._near_miss(name, ["theta1_deg"]) == f"{name.lower()}_mm"
    assert measurement_columns._near_miss(name, ["x_mm", "y_mm", "z_mm"]) is None


@pytest.mark.parametrize("name", UNRELATED.split())
def test_an_unrelated_name_is_an_unknown_column(tmp_path: Path, name: str) -> None:
    measurements = Measurements.read(write(tmp_path, f"theta1_deg,{name}\n1,1\n"))
    assert list(measurements.extra.columns) == [name]


def test_names_of_a_table_are_text() -> None:
    with pytest.raises(MeasurementFileError, match="column 2 of 2 has no name but 7, which is not text"):
        Measurements.from_frame(pd.DataFrame({"theta1_deg": [1.0], 7: [2.0]}))


# --- mistakes: the cells

# column, cell of row 3, words of the answer
CELLS: dict[str, tuple[str, str, Sequence[str]]] = {
    "empty angle": ("theta2_deg", "", ["is empty", "expected a number in every row"]),
    "blank angle": ("theta2_deg", "  ", ["is empty", "expected a number in every row"]),
    "NaN": ("theta1_deg", "nan", ["is 'nan', expected a finite number"]),
    "infinite": ("theta1_deg", "-inf", ["is '-inf', expected a finite number"]),
    "text": ("theta1_deg", "1.5°", ["is '1.5°', expected a finite number"]),
    "python": ("theta1_deg", "1_000", ["is '1_000', expected a finite number"]),
    "decimal comma": ("theta2_deg", '"1,5"', ["is '1,5'", "decimal point, not a decimal comma"]),
    "thousands": ("x_mm", '"1.234,5"', ["is '1.234,5'", "decimal point, not a decimal comma"]),
    "NaN coordinate": ("x_mm", "NaN", ["is 'NaN', expected a finite number"]),
    "infinite coordinate": ("z_mm", "inf", ["is 'inf'"]),
    "partly known": ("y_mm", "", ["is empty in a row that states others of x_mm, y_mm, z_mm", "expected all three or none"]),
    "partly uncertain": ("u_z_mm", "", ["is empty in a row that states others of u_x_mm, u_y_mm, u_z_mm"]),
    "text uncertainty": ("u_z_mm", "?", ["is '?'"]),
    "no uncertainty": ("u_x_mm", "0", ["is 0, expected a standard uncertainty above zero"]),
    "negative uncertainty": ("u_y_mm", "-0.01", ["is -0.01, expected a standard uncertainty above zero"]),
    "time not finite": ("time_s", "inf", ["is 'inf', expected a finite number"]),
    "no time": ("time_s", "", ["is empty"]),
    "kelvin": ("temperature_c", "293.15", ["is 293.15 °C, expected -50 to 150", "kelvin or Fahrenheit"]),
    "cold": ("temperature_c", "-50.1", ["is -50.1 °C"]),
    "no temperature": ("temperature_c", "", ["is empty"]),
    "approach": ("approach2", "2", ["is 2, expected -1, 0 or 1"]),
    "half an approach": ("approach1", "0.5", ["is 0.5, expected -1, 0 or 1"]),
    "torque": ("torque2_nm", "12 Nm", ["is '12 Nm'"]),
    "lonely seat": ("seat", "S9", ["seat 'S9' has this record only", "contributes nothing", "two records or more"]),
    "no end": ("bar_end", "", ["is '', expected A or B"]),
    "wrong end": ("bar_end", "a", ["is 'a', expected A or B"]),
    "no length": ("bar_length_mm", "", ["is empty in a row of bar 'b', expected its length"]),
    "length of zero": ("bar_length_mm", "0", ["is 0, expected a length above zero"]),
    "negative length": ("bar_length_mm", "-500", ["is -500, expected a length above zero"]),
    "bar without seat": ("seat", "", ["is empty in a row of bar 'b'", "label of the seat"]),
}
GOOD = {
    "theta1_deg": "12",
    "theta2_deg": "-3e1",
    "x_mm": "1",
    "y_mm": "2",
    "z_mm": "3",
    "u_x_mm": "0.1",
    "u_y_mm": "0.1",
    "u_z_mm": "0.1",
    "time_s": "5",
    "temperature_c": "20",
    "approach1": "1",
    "approach2": "-1",
    "torque1_nm": "0",
    "torque2_nm": "0",
}
AT_BAR = {"seat": ["p", "p", "q", "q"], "bar": ["b"] * 4, "bar_end": ["A", "A", "B", "B"], "bar_length_mm": ["500"] * 4}


def csv_of(columns: dict[str, list[str]]) -> str:
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("mistake", CELLS)
def test_a_cell_with_a_mistake(tmp_path: Path, mistake: str) -> None:
    column, cell, words = CELLS[mistake]
    with_bar = "bar" in mistake or column.startswith("bar")
    columns = {name: [good] * 4 for name, good in GOOD.items()} | (AT_BAR if with_bar else {"seat": [""] * 4})
    if mistake == "lonely seat":
        columns |= {name: [""] * 4 for name in ("x_mm", "y_mm", "z_mm")}
    Measurements.read(write(tmp_path, csv_of(columns)))
    columns[column] = [columns[column][0], cell, *columns[column][2:]]
    error = error_of(tmp_path, csv_of(columns))
    assert (error.row, error.column) == (3, column)
    assert "more" not in str(error).replace("two records or more", "")
    for word in words:
        assert word in str(error)


def test_numbers_of_a_table_are_looked_at_too() -> None:
    for cell, words in ((np.nan, "is empty"), (np.inf, "is inf, expected a finite number"), ("x", "is 'x'")):
        table = pd.DataFrame({"theta1_deg": [1.0, cell, 3.0]})
        with pytest.raises(MeasurementFileError, match=f"table: row 3, column theta1_deg: {words}"):
            Measurements.from_frame(table)
    for cells in ([True, False], [1j, 2j], pd.to_datetime(["2020-01-01", "2020-01-02"])):
        with pytest.raises(MeasurementFileError, match=r"row 2, column theta1_deg: is '.*', expected a finite number"):
            Measurements.from_frame(pd.DataFrame({"theta1_deg": cells}))


def test_the_first_problems_come_in_one_message(tmp_path: Path) -> None:
    text = "theta1_deg,theta2_deg,x_mm,y_mm,z_mm\n1,a,,,\nb,2,c,,\nd,2,,e,\n1,2,,,\nf,,,,\n"
    lines = str(error_of(tmp_path, text)).splitlines()
    assert len(lines) == 5
    assert all(line.startswith(f"{tmp_path / 'data.csv'}: row ") for line in lines)
    assert "row 3, column theta1_deg: is 'b', expected a finite number (and 2 more: row 4, 6)" in lines[0]
    assert "row 2, column theta2_deg: is 'a'" in lines[1]
    assert "row 6, column theta2_deg: is empty" in lines[2]
    assert "row 3, column x_mm: is 'c'" in lines[3]
    lines = str(error_of(tmp_path, csv_of({f"theta{j}_deg": ["?"] * 6 for j in range(1, 11)}))).splitlines()
    assert len(lines) == 10
    assert lines[-1].endswith("column theta10_deg: is '?', expected a finite number (and 5 more: row 3, 4, 5, 6, 7)")
    names = [f"theta{j}_deg" for j in range(1, 15)]
    lines = str(error_of(tmp_path, csv_of({name: ["?"] * 9 for name in names}))).splitlines()
    assert len(lines) == 11
    assert lines[0].endswith("(and 8 more: row 3, 4, 5, 6, 7, …)")
    assert lines[-1].endswith("and 4 more problems")


# --- mistakes: degrees and radians


def angles(unit: str, values: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({f"theta{j + 1}_{unit}": values[:, j] for j in range(values.shape[1])})


def test_degrees_that_look_like_radians(rng: np.random.Generator) -> None:
    q = rng.uniform(-np.pi, np.pi, size=(5, 6))
    with pytest.raises(MeasurementFileError) as caught:
        Measurements.from_frame(angles("deg", q))
    assert (caught.value.row, caught.value.column) == (None, "theta1_deg … theta6_deg")
    for word in (
        "look like radians",
        "all 5 records",
        "rename the columns to theta1_rad … theta6_rad",
        "from 5 records on",
        "2π",
    ):
        assert word in str(caught.value)
    np.testing.assert_array_equal(Measurements.from_frame(angles("rad", q)).q, q)


def test_degrees_that_are_degrees(rng: np.random.Generator) -> None:
    still = np.full((50, 6), 3.0)
    still[-1, 2] = 6.3  # one angle beyond 2π is enough
    for degrees in (rng.uniform(-3, 3, size=(4, 6)), still, rng.uniform(-1, 1, size=(50, 6)), np.zeros((9, 6))):
        np.testing.assert_allclose(Measurements.from_frame(angles("deg", degrees)).q, degrees * DEG, rtol=1e-15)


def test_radians_that_look_like_degrees() -> None:
    q = np.array([[0.1, 0.2], [0.3, -31.5], [1.0, 90.0]])
    with pytest.raises(MeasurementFileError) as caught:
        Measurements.from_frame(angles("rad", q))
    assert (caught.value.row, caught.value.column) == (3, "theta2_rad")
    for word in ("is -31.5 rad", "at most 5 turns", "rename the columns to theta1_deg", "and 1 more: row 4"):
        assert word in str(caught.value)
    assert Measurements.from_frame(angles("deg", q)).n == 3


# --- mistakes: seats and bars


def test_a_seat_with_one_record_may_have_a_reference_or_a_bar(tmp_path: Path) -> None:
    text = "theta1_deg,x_mm,y_mm,z_mm,seat\n1,1,2,3,one\n2,,,,two\n3,,,,two\n4,,,,\n"
    assert list(Measurements.read(write(tmp_path, text)).seats()) == ["one", "two"]
    text = "theta1_deg,seat,bar,bar_end,bar_length_mm\n1,one,b,A,5\n2,two,b,B,5\n"
    assert Measurements.read(write(tmp_path, text)).bars() == [Bar("b", "one", "two", 0.005)]


# column of AT_BAR, its cells, row, words
BARS: dict[str, tuple[dict[str, list[str]], int, str, Sequence[str]]] = {
    "one end": (
        {"bar_end": ["A"] * 4, "seat": ["p"] * 4},
        2,
        "bar_end",
        ["bar 'b' has records of end A only", "of A and of B"],
    ),
    "two lengths": (
        {"bar_length_mm": ["500", "500.0", "500.1", "500"]},
        4,
        "bar_length_mm",
        ["is 500.1 for bar 'b', which row 2 says is 500.0 long", "expected one length"],
    ),
    "two seats": (
        {"seat": ["p", "p", "q", "r"]},
        5,
        "seat",
        ["is 'r' at end B of bar 'b', which row 4 says is seat 'q'", "expected one seat for each end"],
    ),
    "one seat": ({"seat": ["p"] * 4}, 2, "seat", ["'p' is at both ends of bar 'b'", "expected two seats"]),
    "end without bar": (
        {"bar": ["b", "b", "b", ""], "bar_length_mm": ["5", "5", "5", ""]},
        5,
        "bar_end",
        ["is 'B' in a row without bar"],
    ),
    "length without bar": (
        {"bar": ["b", "b", "b", ""], "bar_end": ["A", "A", "B", ""]},
        5,
        "bar_length_mm",
        ["is 500 in a row without bar"],
    ),
}


@pytest.mark.parametrize("mistake", BARS)
def test_a_bar_that_contradicts_itself(tmp_path: Path, mistake: str) -> None:
    changes, row, column, words = BARS[mistake]
    error = error_of(tmp_path, csv_of({"theta1_deg": ["1"] * 4} | AT_BAR | changes))
    assert (error.row, error.column) == (row, column)
    for word in words:
        assert word in str(error)


def test_a_seat_may_be_an_end_of_several_bars(tmp_path: Path) -> None:
    columns = AT_BAR | {"bar": ["b", "c", "b", "c"], "seat": ["p", "p", "q", "r"], "bar_end": ["A", "B", "B", "A"]}
    measurements = Measurements.read(write(tmp_path, csv_of({"theta1_deg": ["1"] * 4} | columns)))
    assert measurements.bars() == [Bar("b", "p", "q", 0.5), Bar("c", "r", "p", 0.5)]
    assert {seat: rows.tolist() for seat, rows in measurements.seats().items()} == {"p": [0, 1], "q": [2], "r": [3]}


# --- from arrays


def test_of_arrays(rng: np.random.Generator) -> None:
    q = rng.normal(size=(3, 6))
    measurements = Measurements.of(q)
    assert (measurements.n, measurements.nq, measurements.known.any(), measurements.source) == (3, 6, False, "table")
    assert (measurements.conditions.n, measurements.conditions.present) == (3, ())
    assert measurements.extra.shape == (3, 0)
    q[0, 0] = 9
    assert measurements.q[0, 0] != 9
    nan = [np.nan] * 3
    known = Measurements.of([[1.0], [2.0]], reference=[nan, [1, 2, 3]], reference_u=np.array([nan, [0.1] * 3]))
    np.testing.assert_array_equal(known.known, [False, True])
    assert Measurements.of(np.empty((0, 6))).n == 0


ONE = [[1.0, 2.0]]
ARRAYS: dict[str, tuple[dict[str, object], str]] = {
    "one posture": ({"q": [1.0, 2.0]}, r"q has shape \(2,\).*pass q\[None, :\]"),
    "no posture": ({"q": 1.0}, r"q has shape \(\)"),
    "ragged": ({"q": [[1.0, 2.0], [1.0]]}, "q is not an array of numbers|q has shape"),
    "NaN": ({"q": [[1.0, np.nan]]}, r"q\[0, 1\] is nan, expected a finite number"),
    "text": ({"q": [["1", "2"]]}, "q is not an array of numbers"),
    "no coordinates": ({"q": ONE, "reference": [[1.0, 2.0]]}, r"reference has shape \(1, 2\), expected \(n, 3\)"),
    "flat coordinates": ({"q": ONE, "reference": [1.0, 2.0, 3.0]}, r"pass reference\[None, :\]"),
    "many coordinates": ({"q": ONE, "reference": np.ones((2, 3))}, "reference has 2 rows, expected 1"),
    "part of the coordinates": ({"q": ONE, "reference": [[1.0, np.nan, 3.0]]}, r"reference\[0\] is .*NaN for all"),
    "infinite coordinates": ({"q": ONE, "reference": [[1.0, np.inf, 3.0]]}, r"reference\[0, 1\] is inf"),
    "masked coordinates": ({"q": ONE, "reference": np.ma.masked_equal([[1.0, 2.0, 3.0]], 2)}, "masked"),
    "text for coordinates": ({"q": ONE, "reference": [["1", "2", "3"]]}, "reference is not an array of numbers"),
    "no uncertainty": ({"q": ONE, "reference": [[1, 2, 3]], "reference_u": [[1, 0, 1]]}, "reference_u .* not above zero"),
    "labels": ({"q": ONE, "operator": ["a", "b"]}, r"operator has shape \(2,\), expected \(1,\)"),
    "numbers for labels": ({"q": ONE, "record": [3]}, r"record\[0\] is 3, expected text"),
    "lengths": ({"q": ONE, "bar_length": [[1.0]]}, r"bar_length has shape \(1, 1\), expected \(1,\)"),
    "conditions": ({"q": ONE, "conditions": Conditions(2)}, "conditions are of 2 records, expected 1"),
    "time": ({"q": ONE, "conditions": Conditions(1, time=np.array([np.nan]))}, r"time\[0\] is nan"),
    "torque": ({"q": ONE, "conditions": Conditions(1, torque=np.zeros((2, 2)))}, "torque has 2 rows, expected 1"),
    "approach": ({"q": ONE, "conditions": Conditions(1, approach=np.array([[0.5, 1]]))}, "approach holds other numbers"),
    "seat": ({"q": ONE, "conditions": Conditions(1, seat=np.array([None]))}, r"seat\[0\] is None, expected text"),
    "extra": ({"q": ONE, "extra": pd.DataFrame({"a": [1, 2]})}, "extra has 2 rows, expected 1"),
    "known extra": ({"q": ONE, "extra": pd.DataFrame({"seat": ["a"]})}, "extra has columns of known names: seat"),
}


@pytest.mark.parametrize("mistake", ARRAYS)
def test_arrays_with_a_mistake(mistake: str) -> None:
    arguments, words = ARRAYS[mistake]
    with pytest.raises(ShapeError, match=words):
        Measurements.of(**arguments)  # type: ignore[arg-type]


def test_arrays_that_contradict_each_other() -> None:
    for arguments, words in (
        ({"bar": ["b"]}, "missing beside bar"),
        (
            {"conditions": Conditions(1, torque=np.zeros((1, 3)))},
            "torque1_nm … torque3_nm: 3 columns, expected one for each",
        ),
        ({"extra": pd.DataFrame({"Seat": ["a"]})}, "column Seat: is not a known name; expected seat"),
        ({"extra": pd.DataFrame([[1, 2]], columns=["a", "a"])}, "column a: is there 2 times"),
    ):
        with pytest.raises(MeasurementFileError, match=words):
            Measurements.of(ONE, **arguments)  # type: ignore[arg-type]


# --- there and back

WORDS = ["", "NA", "007", "nan", " a b ", 'say "x"', "1,5", "größe 温", "two\nlines", "-", "None", "a\rb", "é;ü\t", "'", "#"]


def random_measurements(rng: np.random.Generator) -> Measurements:
    """Any columns that may stand together, with awkward labels and gaps; seats and bars as a file must have them."""

    def maybe(values: np.ndarray) -> np.ndarray | None:
        return values if rng.random() < 0.5 else None

    def labels() -> np.ndarray:
        return np.array(rng.choice(WORDS, size=n), dtype=object)

    n, nq, unknown = int(rng.integers(8, 40)), int(rng.integers(1, 8)), np.full(3, np.nan)
    reference = rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-6, 2)
    reference_u = rng.uniform(1e-7, 1e-3, size=(n, 3))
    reference[rng.random(n) < rng.random()] = unknown
    reference_u[rng.random(n) < rng.random()] = unknown
    seat = np.array([WORDS[i // 2 % len(WORDS)] for i in rng.permutation(n // 2 * 2)] + [""] * (n % 2), dtype=object)
    with_bar, arm_temperature = rng.random() < 0.3, rng.random() < 0.5
    bar, bar_end, bar_length = np.full((2, n), "", dtype=object), None, np.full(n, np.nan)
    bar, bar_end = bar
    if with_bar:
        rows = rng.permutation(n)[:4]
        bar[rows], bar_end[rows], bar_length[rows] = "2", ["A", "A", "B", "B"], rng.uniform(0.01, 2)
        seat = np.full(n, "", dtype=object)
        seat[rows] = ["p", "p", "NA", "NA"]
    temperature = rng.uniform(-50, 150, size=(n, nq + int(rng.integers(3))))
    return Measurements.of(
        rng.uniform(-1, 1, size=(n, nq)) * 10.0 ** rng.integers(-6, 2),
        maybe(reference),
        maybe(reference_u),
        Conditions(
            n,
            time=maybe(rng.normal(size=n) * 1e5),
            temperature=maybe(temperature[:, 0]) if arm_temperature else None,
            link_temperature=None if arm_temperature else maybe(temperature),
            approach=maybe(rng.integers(-1, 2, size=(n, nq)).astype(float)),
            torque=maybe(rng.normal(size=(n, nq))),
            seat=seat if with_bar else maybe(seat),
            marker=maybe(labels()),
            session=maybe(labels()),
        ),
        bar=bar if with_bar else None,
        bar_end=bar_end if with_bar else None,
        bar_length=bar_length if with_bar else None,
        operator=maybe(labels()),
        record=maybe(labels()),
        extra=pd.DataFrame({name: labels() for name in ("humidity", "a, b", "größe") if rng.random() < 0.5}, index=range(n)),
    )


@pytest.mark.parametrize("seed", range(60))
def test_there_and_back(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    measurements = random_measurements(rng)
    radians = measurements.to_frame("rad")
    assert_same(Measurements.from_frame(radians, measurements.nq), measurements)
    degrees = np.abs(measurements.q / DEG).max()
    if not 1 < degrees <= 2 * np.pi:
        assert_same(Measurements.from_frame(measurements.to_frame()), measurements)
    path = tmp_path / "out.csv"
    measurements.save(path)
    again = Measurements.read(path, measurements.nq)
    assert_same(again, measurements)
    assert again.source == str(path)
    shuffled = radians[rng.permutation(radians.columns)]
    extra = [name for name in shuffled.columns if name in measurements.extra]
    from_shuffled = Measurements.from_frame(shuffled)
    assert list(from_shuffled.extra.columns) == extra
    np.testing.assert_array_equal(from_shuffled.q, measurements.q)
    rows = rng.permutation(measurements.n)
    assert_same(Measurements.from_frame(radians.iloc[rows]), measurements.take(rows))


def test_there_and_back_of_every_column(full: Measurements, tmp_path: Path) -> None:
    assert list(full.to_frame().columns) == FULL.splitlines()[0].replace("approach1", "approach1").split(",")
    full.save(tmp_path / "again.csv")
    assert_same(Measurements.read(tmp_path / "again.csv"), full)


def test_a_saved_file_is_what_another_reader_expects(tmp_path: Path, rng: np.random.Generator) -> None:
    q, reference = rng.uniform(-np.pi, np.pi, size=(50, 6)), rng.normal(size=(50, 3))
    reference[::7] = np.nan
    dew = pd.DataFrame({"dew_c": rng.normal(size=50)})
    path = tmp_path / "out.csv"
    Measurements.of(q, reference, conditions=Conditions(50, approach=np.ones((50, 6))), extra=dew).save(path)
    table = pd.read_csv(path)
    np.testing.assert_allclose(np.deg2rad(table.filter(regex="^theta").to_numpy()), q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(table[["x_mm", "y_mm", "z_mm"]].to_numpy() / 1000, reference, rtol=0, atol=1e-14)
    np.testing.assert_allclose(table["dew_c"], dew["dew_c"], rtol=1e-14)
    assert table["approach6"].dtype.kind == "i"
    assert np.isnan(table["x_mm"]).sum() == 8


def test_small_angles_are_saved_so_that_they_can_be_read(tmp_path: Path) -> None:
    """Within ±6.28° degrees would be taken for radians: then the file has radians."""
    q = np.full((5, 2), 0.05)
    Measurements.of(q).save(tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text().startswith("theta1_rad,")
    np.testing.assert_array_equal(Measurements.read(tmp_path / "out.csv").q, q)
    turns = np.full((5, 2), 99.0)  # beyond what is believed in radians
    Measurements.of(turns).save(tmp_path / "turns.csv")
    np.testing.assert_allclose(Measurements.read(tmp_path / "turns.csv").q, turns, rtol=1e-15)


def test_save_replaces_only_by_force(full: Measurements, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        full.save(path)
    assert path.read_text() == "mine"
    full.save(path, force=True)
    assert_same(Measurements.read(path), full)
    with pytest.raises(OutputError, match="does not exist"):
        full.save(tmp_path / "none" / "out.csv")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["data.csv", "out.csv"]


def test_unknown_columns_of_any_kind_are_saved(tmp_path: Path) -> None:
    extra = pd.DataFrame(
        {"a": ["x", None], "b": [1.5, np.nan], "c": [True, False], "d": pd.to_datetime(["2020-01-01", None])}
    )
    path = tmp_path / "out.csv.gz"  # the name promises what nobody asked for: the file is plain text
    Measurements.of([[1.0], [2.0]], extra=extra).save(path)
    again = Measurements.read(path).extra.to_dict("list")
    assert again == {"a": ["x", ""], "b": ["1.5", ""], "c": ["True", "False"], "d": ["2020-01-01", ""]}


def test_other_angle_units(full: Measurements) -> None:
    with pytest.raises(UnknownNameError, match="'gon'; known: deg, rad"):
        full.to_frame("gon")  # type: ignore[arg-type]


# --- part of it, and what people see


def test_take(full: Measurements) -> None:
    part = full.take([3, 1])
    assert (part.n, part.nq, part.source) == (2, 2, full.source)
    assert part.row.tolist() == [5, 3]  # still the lines of the file
    np.testing.assert_array_equal(part.q, full.q[[3, 1]])
    np.testing.assert_array_equal(part.known, [True, False])
    assert part.conditions.seat is not None
    assert part.conditions.seat.tolist() == ["007", "007"]
    assert part.extra["humidity"].tolist() == ["wet", "45.5"]
    assert part.bars() == []  # one end is not among them
    assert_same(full.take(full.known), full.take(slice(0, 4, 3)))
    assert_same(full.take(np.arange(4)), full)
    assert full.take([]).n == 0
    str(full.take([])), full.take([]).summary()


def test_seats_and_bars(full: Measurements) -> None:
    assert {seat: rows.tolist() for seat, rows in full.seats().items()} == {"007": [1, 3], "NA": [2]}
    assert full.bars() == [Bar("ball", "007", "NA", 0.5)]


def test_summary(full: Measurements) -> None:
    shown = full.summary().set_index("what")["value"].to_dict()
    assert shown == {
        "records": "4",
        "joints": "2",
        "with reference": "2",
        "seats": "2, records of each: 1 to 2",
        "bars": "1, mm: 500",
        "theta1_deg": "-90 to 180",
        "theta2_deg": "-45 to 45",
        "x_mm": "1 to 100",
        "y_mm": "2 to 200",
        "z_mm": "-300 to 3",
        "u_x_mm": "0.01",
        "u_y_mm": "0.02",
        "u_z_mm": "0.03",
        "marker": "2 (m1, m2)",
        "time_s": "-1 to 9",
        "temperature1_c": "20",
        "temperature2_c": "21",
        "temperature3_c": "22",
        "approach1": "-1 to 1",
        "approach2": "0 to 1",
        "torque1_nm": "0 to 0.5",
        "torque2_nm": "-1.5 to 0",
        "session": "2 (s1, s2)",
        "operator": "2 (Ann, Bob)",
        "record": "3 (1, 2, 3)",
        "unknown columns": "humidity, comment (kept; candidates for 'depends on')",
    }
    said = "4 records of 2 joints, 2 with reference, 2 seats, 1 bars, unknown columns humidity, comment"
    assert str(full) == f"{full.source}: {said}"


def test_html_shows_labels_as_they_are() -> None:
    measurements = Measurements.of(
        [[1.0]],
        conditions=Conditions(1, marker=np.array(["<b>"], dtype=object)),
        extra=pd.DataFrame({"<i>": [1]}),
        source="<u>",
    )
    page = measurements._repr_html_()
    assert not {"<b>", "<i>", "<u>"} & {page[i : i + 3] for i in range(len(page))}
    assert "&lt;b&gt;" in page


# --- real files


@pytest.fixture
def real_files() -> list[Path]:
    folder = os.environ.get("AACMM_PIN_REAL_DATA")
    if not folder:
        pytest.skip("AACMM_PIN_REAL_DATA does not name a folder with real measurements")
    files = sorted(Path(folder).glob("*/measurements.csv"))
    assert files
    return files


def test_real_files_load(real_files: list[Path], tmp_path: Path) -> None:
    for file in real_files:
        measurements = Measurements.read(file)
        assert measurements.n == len(pd.read_csv(file)) > 100
        assert measurements.known.any() or measurements.bars()
        assert not len(measurements.extra.columns)
        measurements.save(tmp_path / "copy.csv", force=True)
        assert_same(Measurements.read(tmp_path / "copy.csv", measurements.nq), measurements)
        with pytest.raises(AacmmError, match=f"angles of {measurements.nq} joints, but the arm has 5"):
            Measurements.read(file, nq=5)
