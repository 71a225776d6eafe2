"""Measurement files: every column in its unit, what each mistake is answered with, and that nothing
is lost on the way.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import MeasurementFileError, ShapeError, UnknownNameError
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.records import Bar, Measurements
from tests.again import again
from tests.notes import data_of
from tests.oracle import close
from tests.tables import PLACES

pytestmark = pytest.mark.fast

DEG = np.pi / 180

FULL = """\
theta1_deg,theta2_deg,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm,seat,marker,bar,bar_end,bar_length_mm,u_bar_length_mm,time_s,temperature1_c,\
temperature2_c,temperature3_c,approach1,approach2,torque1_nm,torque2_nm,session,operator,record,humidity,comment
10,-20.5,100,200,-300,0.01,0.02,0.03,,m1,,,,,0,20,21,22,-1,0,0.5,-1.5,s1,Ann,1,45.0,
90,1e1,,,,,,,007,m1,ball,A,500,,1.5,20,21,22,1,1,0.5,-1.5,s1,Ann,2,45.5,"a ""b"", c"
-90,45,,,,,,,NA,m2,ball,B,500.0,0.002,-1,20,21,22,0,0,0,0,s1,Ann,3,,NaN
180,-45,1,2,3,,,,007,,,,,,9,20,21,22,0,0,0,0,s2,Bob,,wet,
"""

SMALL = """\
theta1_deg,theta2_deg,x_mm,y_mm,z_mm
10,20,1,2,3
11,21,1,2,3
"""


@pytest.fixture
def full(tmp_path) -> Measurements:
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
    """Equal in everything but the source, the lines, and the type that pandas chose for unknown
    columns of text.
    """
    tolerance = {"rtol": 1e-15, "atol": 1e-15, "equal_nan": True}
    for name in ("q", "reference", "reference_u", "bar_length", "bar_length_u"):
        mine, theirs = getattr(a, name), getattr(b, name)
        assert (mine is None) == (theirs is None), name
        if mine is not None:
            np.testing.assert_allclose(mine, theirs, err_msg=name, **tolerance)
    for name in ("bar", "bar_end", "operator", "record"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert a.conditions.n == b.conditions.n == a.n
    assert a.conditions.present == b.conditions.present
    for name in a.conditions.present:
        np.testing.assert_array_equal(
            getattr(a.conditions, name), getattr(b.conditions, name), err_msg=name
        )
    pd.testing.assert_frame_equal(a.extra.astype(str), b.extra.astype(str), check_column_type=False)


# --- what is in a file


def test_every_column_is_read_in_its_unit(full):
    assert (full.n, full.nq, full.source.endswith("data.csv")) == (4, 2, True)
    np.testing.assert_allclose(
        full.q, np.array([[10, -20.5], [90, 10], [-90, 45], [180, -45]]) * DEG, rtol=1e-15
    )
    nan = [np.nan] * 3
    np.testing.assert_allclose(
        full.reference, [[0.1, 0.2, -0.3], nan, nan, [1e-3, 2e-3, 3e-3]], rtol=1e-15
    )
    np.testing.assert_allclose(full.reference_u, [[1e-5, 2e-5, 3e-5], nan, nan, nan], rtol=1e-15)
    np.testing.assert_array_equal(full.bar_length, [np.nan, 0.5, 0.5, np.nan])
    known = full.conditions
    assert known.present == (
        "time",
        "link_temperature",
        "approach",
        "torque",
        "seat",
        "marker",
        "session",
    )
    np.testing.assert_array_equal(known.time, [0, 1.5, -1, 9])  # running backwards is no mistake
    # A DH table may have more rows than joints.
    np.testing.assert_array_equal(known.link_temperature, [[20, 21, 22]] * 4)
    np.testing.assert_array_equal(known.approach, [[-1, 0], [1, 1], [0, 0], [0, 0]])
    np.testing.assert_array_equal(known.torque, [[0.5, -1.5]] * 2 + [[0, 0]] * 2)
    lists = {
        "known": [True, False, False, True],
        "row": [2, 3, 4, 5],
        "bar": ["", "ball", "ball", ""],
        "bar_end": ["", "A", "B", ""],
        "operator": ["Ann", "Ann", "Ann", "Bob"],
        "record": ["1", "2", "3", ""],
        "seat": ["", "007", "NA", "007"],  # labels are text: no number, no missing value
        "marker": ["m1", "m1", "m2", ""],
    }
    for name, values in lists.items():
        assert getattr(full if hasattr(full, name) else known, name).tolist() == values, name
    unknown = {"humidity": ["45.0", "45.5", "", "wet"], "comment": ["", 'a "b", c', "NaN", ""]}
    assert full.extra.to_dict("list") == unknown
    assert {seat: rows.tolist() for seat, rows in full.seats().items()} == {
        "007": [1, 3],
        "NA": [2],
    }
    assert full.bars() == [Bar("ball", "007", "NA", 0.5, 2e-6)]


def test_radians_and_one_temperature(tmp_path):
    measurements = Measurements.read(
        write(tmp_path, "theta2_rad,theta1_rad,temperature_c\n-0.5,31.4,21.5\n"), nq=2
    )
    # By number, whatever the order of the columns.
    np.testing.assert_array_equal(measurements.q, [[31.4, -0.5]])
    np.testing.assert_array_equal(measurements.conditions.temperature, [21.5])
    assert (measurements.known.any(), measurements.seats(), measurements.bars()) == (False, {}, [])


def test_spellings_of_text_files(tmp_path):
    """A byte order mark, other line ends, blank lines, spaces around numbers, a line break within
    quotes.
    """
    plain = Measurements.read(write(tmp_path, SMALL))
    other_ends = [SMALL.replace("\n", end) for end in ("\r\n", "\r")]
    spaced, quoted = SMALL.replace(",20,", ", 20 ,"), SMALL.replace(",20,", ',"20",')
    for text in ("\ufeff" + SMALL, *other_ends, SMALL.rstrip("\n"), SMALL + "\n\n", spaced, quoted):
        assert_same(Measurements.read(write(tmp_path, text)), plain)
    text = 'theta1_deg,comment\n1,"two\nlines"\n\n2,x\n'
    assert Measurements.read(write(tmp_path, text)).row.tolist() == [2, 5]
    assert error_of(tmp_path, text.replace("2,x", "two,x")).row == 5


def test_from_frame_takes_numbers_and_missing_values_and_keeps_no_hold_of_the_table():
    columns: dict[str, object] = {
        "theta1_rad": pd.array([1, 2, 3], dtype="Int64"),
        "x_mm": [1.0, np.nan, 1.0],
        "y_mm": pd.array([2.0, None, 1.0], dtype="Float64"),
        "z_mm": ["3", "", "1.0"],
        "seat": [7, None, "a b"],
        "session": pd.Categorical(["one", None, "one"]),
        "dew": [0.5, np.nan, 1.5],
    }
    table = pd.DataFrame(columns, index=[9, 9, 4])
    measurements = Measurements.from_frame(table)
    table.loc[:, "dew"], table.loc[:, "x_mm"] = 9.0, 9.0
    np.testing.assert_array_equal(measurements.q, [[1], [2], [3]])
    np.testing.assert_allclose(
        measurements.reference, [[1e-3, 2e-3, 3e-3], [np.nan] * 3, [1e-3] * 3]
    )
    labels = measurements.conditions.take(np.arange(3))
    assert [list(labels.seat), list(labels.session)] == [["7", "", "a b"], ["one", "", "one"]]  # type: ignore[arg-type]
    pd.testing.assert_frame_equal(measurements.extra, pd.DataFrame({"dew": [0.5, np.nan, 1.5]}))
    assert (measurements.source, measurements.row.tolist()) == ("table", [2, 3, 4])


# --- mistakes: the file

# content, row, what the answer must name
FILES: list[tuple[str | bytes, int | None, str]] = [
    (b"", None, "empty"),
    (SMALL.splitlines()[0], None, "one row per record"),
    (SMALL.replace("z_mm", "z_mm,größe").encode("latin-1"), 1, "byte 39"),
    (SMALL.replace(",21,1,2,3", ",21,1,2"), 3, "4 cells; expected 5"),
    (SMALL.replace("11,", '11,"'), 3, "quotation"),
    (SMALL.replace("10,20", "10,5,20,5"), 2, "decimal points"),
    (
        SMALL.replace(",", ";").replace("10;20", "10,5;20.5"),
        2,
        "decimal point",
    ),  # which of them has the thousands?
    (
        f"Arm 7; July\n\n{SMALL}",
        1,
        "'Arm 7; July'; expected the names of the columns (row 3)",
    ),
    ('# arm\nschema = "aacmm-pin/arm/1"\na_mm = 90,004\n', None, "is an arm file (TOML)"),
]


def test_other_ways_to_write_the_same(tmp_path):
    halves = SMALL.replace("10,20", "10.5,20.25")
    known = Measurements.read(write(tmp_path, halves), 2)
    assert known.read_as == ()
    upper = halves.replace(halves.splitlines()[0], halves.splitlines()[0].upper())
    german = halves.replace(",", ";").replace(".", ",")
    same = {
        german: ("semicolons", "decimal commas"),
        halves.replace(",", ";"): ("semicolons",),
        halves.replace(",", ", "): ("spaces",),
        upper: ("lower-case",),
        f"# arm 7, on Tuesday\n#\n{halves}# the end, at 16:00\n": ("comments_ignored",),
        f"{halves},,,,\n ,,\n\n": (),
        f"# arm 7\n{german.replace(';', '; ').upper()}": (
            "comments_ignored",
            "semicolons",
            "commas",
            "spaces",
            "lower",
        ),
    }
    for content, words in same.items():
        read = Measurements.read(write(tmp_path, content), 2)
        np.testing.assert_array_equal(read.q, known.q)
        np.testing.assert_array_equal(read.reference, known.reference)
        ways = [way for note in read.read_as for way in note.data.get("ways", [note.code])]
        assert (len(ways), [word for word in words if word not in " ".join(ways)]) == (
            len(words),
            [],
        )
    with pytest.raises(MeasurementFileError, match=r"row 3, column record: .*#") as told:
        Measurements.read(write(tmp_path, "record,theta1_deg\n1,10\n#2,20\n3,10\n"), 1)
    assert (told.value.row, told.value.column) == (3, "record")


@pytest.mark.parametrize(("usual", "other"), [(".", ","), (",", ".")])
def test_a_number_with_another_decimal_sign_is_the_one_that_is_named(tmp_path, usual, other):
    rows = [f"{10 * k}.5;{k};text 1{other}5" for k in range(9)]
    rows[4] = rows[4].replace(".", "!", 1)
    text = "\n".join(["theta1_deg;theta2_deg;remark", *rows]).replace(".5;", f"{usual}5;")
    error = error_of(tmp_path, text.replace("!", other))
    assert (error.row, error.column) == (6, "theta1_deg")
    assert f"'40{other}5'" in str(error)
    assert "(also row" not in str(error)


def test_a_table_is_written_in_the_dialect_in_which_it_was_read(tmp_path):
    """Labels are no numbers."""
    for content in (
        "theta1_deg;seat;time_s\n-10,5;1.5;1e1\n3;;-2,5e-1\n",
        "theta1_deg\tx\n-10.5\t1,5 mm\n",
        "theta1_deg,x\n-10.5,a;b\n",
    ):
        file = read_table(str(write(tmp_path, content)))
        assert file.text(file.table) == content
    file = read_table(str(write(tmp_path, "theta1_deg;seat\n-10,5;1.5\n3;\n")))
    added = file.text(file.table.assign(u_mm=[-0.25, np.nan]))
    assert added == "theta1_deg;seat;u_mm\n-10,5;1.5;-0,25\n3;;\n"


def test_a_file_that_is_no_table(tmp_path):
    for content, row, word in FILES:
        error = error_of(tmp_path, content)
        assert (error.row, word in str(error)) == (row, True), str(error)
    with pytest.raises(MeasurementFileError, match=r"/dev/zero: .*larger than 100 MB"):
        Measurements.read("/dev/zero")
    inside = write(tmp_path, SMALL) / "inside.csv"
    for path, said in (
        (tmp_path / "none.csv", "no such file"),
        (tmp_path, "is a folder"),
        (inside, "cannot be read: "),
    ):
        with pytest.raises(MeasurementFileError, match=said):
            Measurements.read(path)


# --- mistakes: the header

# header, number of joints of the arm or None, column, what the answer must name
HEADERS: list[tuple[str, int | None, str, str]] = [
    (
        "theta1_deg,temperature_c,temperature1_c",
        None,
        "temperature_c",
        "temperature1_c",
    ),
    ("theta1_rad,theta2_rad", 1, "theta1_rad … theta2_rad", "2 joints; expected theta1_rad"),
    ("theta1_deg,seat,seat", None, "seat", "2 columns"),
    ("J1 [deg],J2 [deg],x_mm", None, "", "the header has 'J1 [deg]', 'J2 [deg]'"),
    ("theta1_deg,theta3_deg", None, "theta1_deg … theta3_deg", "add theta2_deg"),
    (
        "theta1_deg,theta2_rad,theta3_deg",
        None,
        "",
        "theta1_deg, theta3_deg are in degrees",
    ),
    ("theta1_deg,theta2_deg,temperature1_c", None, "temperature1_c", "2 or more"),
    ("theta1_deg,x_mm", None, "y_mm, z_mm", "expected all of x_mm, y_mm, z_mm"),
    ("theta1_deg,u_x_mm,u_y_mm,u_z_mm", None, "u_x_mm", "x_mm, y_mm, z_mm"),
    ("theta1_deg,bar,bar_end,bar_length_mm", None, "seat", "missing"),
    ("theta1_deg,theta2_deg,torque1_nm", None, "torque1_nm", "each of the 2 joints"),
]
SLIPS = {
    "x_mm": ["x mm", "X [mm]", "x (mm)", "x_m", "x"],
    "theta2_deg": ["theta 2 (deg)", "Theta2 [°]", "θ2 [deg]", "theta02_deg", "thetta2_deg"],
    "approach1": ["aproach1", "approach_1"],
    "temperature_c": ["temperature_°C", "temperature"],
    "bar_length_mm": ["bar_lenght_mm", "bar_length_m"],
    "record": ["records"],
}
UNRELATED = """
    humidity theta q1 Δx_mm dx_mm nominal_x_mm x_mm_nominal pressure_hpa comment seat_id seat2
    marker1 time date timestamp load_kg wrist_load_nm rpm1 theta1_deg_raw q1_deg torque_limit_nm
    room_temperature_c bar_pressure encoder1 operator_age probe force_n 1 温度
"""


def test_a_header_with_a_mistake(tmp_path):
    for header, nq, column, word in HEADERS:
        cells = ",".join("1" for _ in header.split(","))
        error = error_of(tmp_path, f"{header}\n{cells}\n{cells}\n", nq)
        assert (error.row, error.column, word in str(error)) == (None, column, True), str(error)
    with pytest.raises(MeasurementFileError, match="column 2 of 2 has the name 7"):
        Measurements.from_frame(pd.DataFrame({"theta1_deg": [1.0], 7: [2.0]}))


def test_a_slip_in_a_name_is_no_unknown_column(tmp_path):
    for meant, slips in SLIPS.items():
        for slip in slips:
            error = error_of(tmp_path, f"theta1_deg,{slip}\n1,1\n")
            assert (
                error.row,
                error.column,
                re.search(rf"expected {meant}\b", str(error)) is not None,
            ) == (
                None,
                slip,
                True,
            ), str(error)
    assert "expected seat" in str(error_of(tmp_path, "theta1_deg,seat,Seat\n1,,\n"))
    beside = [
        "session,sessions",
        "temperature_c,temperature_k",
        "x_mm,y_mm,z_mm,x_m",
        "time_s,time_ms",
        "x_mm,y_mm,z_mm,x",
    ]
    for header in (*beside, *UNRELATED.split()):  # then it is another thing
        names = f"theta1_deg,{header}".split(",")
        text = ",".join(names) + "\n" + ",".join("1" for _ in names) + "\n"
        assert list(Measurements.read(write(tmp_path, text)).extra.columns) == names[-1:]


# --- mistakes: the cells

# column, cell of row 3, what the answer must name
CELLS: list[tuple[str, str, str]] = [
    ("theta2_deg", "", "empty"),
    ("theta2_deg", '"1,5"', "decimal point"),
    ("u_x_mm", "0", "0; expected a standard uncertainty"),
    ("temperature_c", "293.15", "293.15 °C; expected -100 to 200"),
    ("approach2", "2", "2; expected -1, 0 or 1"),
    ("seat", "S9", "'S9'"),
    ("bar_length_mm", "", "bar 'b'"),
    (
        "bar_length_mm",
        "0.5",
        "0.5 mm; expected 10 to 100000 mm; check the unit (perhaps metres)",
    ),
    ("seat", "", "bar 'b'"),
]
GOOD = {f"{name}_mm": "0.1" for name in ("x", "y", "z", "u_x", "u_y", "u_z")} | {
    "theta1_deg": "12",
    "theta2_deg": "-3e1",
    "time_s": "5",
    "temperature_c": "20",
    "approach1": "1",
    "approach2": "-1",
    "torque1_nm": "0",
    "torque2_nm": "0",
}
AT_BAR = {
    "seat": ["p", "p", "q", "q"],
    "bar": ["b"] * 4,
    "bar_end": ["A", "A", "B", "B"],
    "bar_length_mm": ["500"] * 4,
}


def csv_of(columns: dict[str, list[str]]) -> str:
    rows = [",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]
    return "\n".join(rows) + "\n"


def test_a_cell_with_a_mistake(tmp_path):
    for column, cell, word in CELLS:
        with_bar = "bar" in word or column.startswith("bar")
        columns = {name: [good] * 4 for name, good in GOOD.items()} | (
            AT_BAR if with_bar else {"seat": [""] * 4}
        )
        if column == "seat" and cell:
            columns |= {name: [""] * 4 for name in PLACES}
        Measurements.read(write(tmp_path, csv_of(columns)))
        columns[column] = [columns[column][0], cell, *columns[column][2:]]
        error = error_of(tmp_path, csv_of(columns))
        assert (error.row, error.column, word in str(error)) == (3, column, True), str(error)
        assert "(also row" not in str(error)
        assert len(str(error)) < 500


def test_the_first_problems_come_in_one_message(tmp_path):
    text = "theta1_deg,theta2_deg,x_mm,y_mm,z_mm\n1,a,,,\nb,2,c,,\nd,2,,e,\n1,2,,,\nf,,,,\n"
    lines = str(error_of(tmp_path, text)).splitlines()
    assert len(lines) == 5
    assert all(line.startswith(f"{tmp_path / 'data.csv'}: row ") for line in lines)
    assert "row 3, column theta1_deg: 'b'" in lines[0]
    assert "(also rows 4, 6)" in lines[0]
    assert "row 2, column theta2_deg: 'a'" in lines[1]
    assert "row 6, column theta2_deg: empty" in lines[2]
    assert "row 3, column x_mm: 'c'" in lines[3]


# --- mistakes: degrees and radians


def angles(unit: str, values: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({f"theta{j + 1}_{unit}": values[:, j] for j in range(values.shape[1])})


def test_degrees_that_look_like_radians(rng):
    q = rng.uniform(-np.pi, np.pi, size=(5, 6))
    with pytest.raises(MeasurementFileError) as caught:
        Measurements.from_frame(angles("deg", q))
    assert (caught.value.row, caught.value.column) == (None, "theta1_deg … theta6_deg")
    np.testing.assert_array_equal(Measurements.from_frame(angles("rad", q)).q, q)
    wrist = np.vstack([q, [1.0, 1.0, 1.0, 1.0, 1.0, 40.0]])
    for degrees, noted in (
        (q[:2], True),
        (wrist, True),
        (rng.uniform(-180, 180, (2, 6)), False),
        (np.zeros((9, 6)), False),
    ):
        read_as = Measurements.from_frame(angles("deg", degrees)).read_as
        assert len(data_of(read_as, "angles_like_radians")) == noted


@pytest.mark.parametrize(("unit", "step"), [("deg", 0.01), ("rad", 1e-4)])
def test_rounded_angles_state_their_resolution(rng, unit, step):
    """GUM F.2.2.1; the most frequent standard deviation is that of what rounding takes away."""
    exact = rng.uniform(-1.0, 1.0, (4000, 3)) * (180 if unit == "deg" else np.pi)
    rounded = np.round(exact / step) * step
    rounded[:, 1] = exact[:, 1]
    (data,) = data_of(Measurements.from_frame(angles(unit, rounded)).read_as, "angles_rounded")
    assert data["columns"] == [f"theta1_{unit}", f"theta3_{unit}"]
    assert data["step"] == pytest.approx(step)
    in_rad = DEG if unit == "deg" else 1.0
    assert data["u"] == pytest.approx((rounded[:, 0] - exact[:, 0]).std() * in_rad, rel=0.05)
    for fine in (exact, np.round(exact, 5), np.round(exact[:9], 1)):
        read_as = Measurements.from_frame(angles(unit, fine)).read_as
        assert not data_of(read_as, "angles_rounded")


def test_labels_that_are_nearly_the_same():
    table = angles("deg", np.full((8, 2), 40.0))
    table = table.assign(seat=2 * ["P1", "#p 01", "P10", "1"], session=2 * ["1", "1.0", "2", "10"])
    told = data_of(Measurements.from_frame(table).read_as, "labels_alike")
    seats, sessions = (
        {"column": "seat", "labels": "'P1' and '#p 01'"},
        {"column": "session", "labels": "'1' and '1.0'"},
    )
    assert told == [seats, sessions]


def test_radians_that_look_like_degrees():
    q = np.array([[0.1, 0.2], [0.3, -31.5], [1.0, 90.0]])
    with pytest.raises(MeasurementFileError) as caught:
        Measurements.from_frame(angles("rad", q))
    assert (caught.value.row, caught.value.column) == (3, "theta2_rad")
    assert "-31.5 rad" in str(caught.value)
    assert "(also row 4)" in str(caught.value)
    assert Measurements.from_frame(angles("deg", q)).n == 3


# --- mistakes: seats and bars


def test_references_that_are_all_zero():
    """As a program writes them that has none; one seat may be the origin of its frame."""
    table = angles("deg", np.full((4, 2), 40.0)).assign(x_mm=0.0, y_mm=0.0, z_mm=0.0)
    for seats in ([""] * 4, ["a", "a", "b", "b"], ["a", "a", "a", ""]):
        with pytest.raises(MeasurementFileError) as caught:
            Measurements.from_frame(table.assign(seat=seats))
        assert caught.value.column == "x_mm … z_mm"
    assert Measurements.from_frame(table.assign(seat="a")).known.all()
    table.loc[3, "x_mm"] = 100.0
    assert Measurements.from_frame(table).known.all()


def test_what_seats_and_bars_may_be(tmp_path):
    text = "theta1_deg,x_mm,y_mm,z_mm,seat\n1,1,2,3,one\n2,,,,two\n3,,,,two\n4,,,,\n"
    assert list(Measurements.read(write(tmp_path, text)).seats()) == ["one", "two"]
    text = "theta1_deg,seat,bar,bar_end,bar_length_mm\n1,one,b,A,50\n2,two,b,B,50\n"
    assert Measurements.read(write(tmp_path, text)).bars()[0][:4] == ("b", "one", "two", 0.05)
    columns = AT_BAR | {"bar": ["b", "c", "b", "c"], "seat": ["p", "p", "q", "r"]}
    columns |= {"theta1_deg": ["1"] * 4, "bar_end": ["A", "B", "B", "A"]}
    measurements = Measurements.read(write(tmp_path, csv_of(columns)))
    assert [bar[:4] for bar in measurements.bars()] == [("b", "p", "q", 0.5), ("c", "r", "p", 0.5)]


# columns of AT_BAR, row, column, what the answer must name
BARS: list[tuple[dict[str, list[str]], int, str, str]] = [
    ({"bar_end": ["A"] * 4, "seat": ["p"] * 4}, 2, "bar_end", "'b' has records of end A only"),
    (
        {"u_bar_length_mm": ["0.2", "", "0.002", ""]},
        4,
        "u_bar_length_mm",
        "0.002, but row 2 states 0.2",
    ),
    ({"seat": ["p", "p", "q", "r"]}, 5, "seat", "r, but row 4 states q"),
    ({"seat": ["p"] * 4}, 2, "seat", "'p' is at both ends"),
]


def test_a_bar_that_contradicts_itself(tmp_path):
    for changes, row, column, word in BARS:
        error = error_of(tmp_path, csv_of({"theta1_deg": ["1"] * 4} | AT_BAR | changes))
        assert (error.row, error.column, word in str(error)) == (row, column, True), str(error)


# --- from arrays


ONE = [[1.0, 2.0]]
ARRAYS: list[tuple[dict[str, object], str]] = [
    ({"q": [1.0, 2.0]}, r"q has shape \(2,\).*pass q\[None, :\]"),
    ({"q": [[1.0, np.nan]]}, r"q\[0, 1\] is nan; expected a finite number"),
    ({"q": ONE, "reference": [[1.0, 2.0]]}, r"reference has shape \(1, 2\); expected \(n, 3\)"),
    ({"q": ONE, "reference": [[1.0, np.nan, 3.0]]}, r"reference\[0, 1\]: .*NaN"),
    (
        {"q": ONE, "reference": [[1, 2, 3]], "reference_u": [[1e-3, 0, 1e-3]]},
        r"reference_u\[0, 1\]: 0; .* above 0",
    ),
    ({"q": ONE, "reference": [[1, 2, 1e3]]}, r"reference\[0, 2\] is 1000 m; expected -100 to 100"),
    ({"q": ONE, "conditions": Conditions(2)}, "conditions have 2 records; expected 1"),
]


OF_CONDITIONS: list[tuple[dict[str, Any], str]] = [
    ({"temperature": np.array([-273.15])}, r"temperature\[0\] is -273.15 °C"),
    ({"time": np.array([np.nan])}, r"time\[0\] is nan"),
    ({"seat": np.array([None])}, r"seat\[0\] is None; expected text"),
]


def test_arrays_with_a_mistake():
    for given, words in OF_CONDITIONS:
        with pytest.raises(ShapeError, match=words):
            Conditions(**{"n": 1} | given)
    for arguments, words in ARRAYS:
        with pytest.raises(ShapeError, match=words):
            Measurements.of(**arguments)  # type: ignore[arg-type]


# --- there and back

WORDS = [
    "",
    "NA",
    "007",
    "nan",
    " a b ",
    'say "x"',
    "1,5",
    "größe 温",
    "two\nlines",
    "-",
    "None",
    "a\rb",
    "é;ü\t",
    "'",
    "#",
]


def random_measurements(rng: np.random.Generator) -> Measurements:
    """Any columns that may stand together, with awkward labels and gaps."""
    n, nq = int(rng.integers(8, 40)), int(rng.integers(1, 8))

    def labels() -> np.ndarray:
        return np.array(rng.choice(WORDS, size=n), dtype=object)

    def some(columns: dict[str, Any]) -> dict[str, Any]:
        return {name: values for name, values in columns.items() if rng.random() < 0.6}

    seats = [WORDS[i // 2 % len(WORDS)] for i in rng.permutation(n // 2 * 2)] + [""] * (n % 2)
    conditions = {
        "time": rng.normal(size=n) * 1e5,
        "link_temperature": rng.uniform(-50, 150, size=(n, nq + int(rng.integers(3)))),
        "approach": rng.integers(-1, 2, size=(n, nq)).astype(float),
        "torque": rng.normal(size=(n, nq)),
        "seat": np.array(seats, dtype=object),
        "marker": labels(),
        "session": labels(),
    }
    columns = {
        "reference": rng.normal(size=(n, 3)) * 10.0 ** rng.integers(-6, 2),
        "reference_u": rng.uniform(1e-7, 1e-3, size=(n, 3)),
        "operator": labels(),
        "record": labels(),
        "extra": pd.DataFrame({name: labels() for name in ("humidity", "a, b", "größe")}),
    }
    for name in ("reference", "reference_u"):
        columns[name][rng.random(n) < rng.random()] = np.nan
    q = rng.uniform(-1, 1, size=(n, nq)) * 10.0 ** rng.integers(-6, 2)
    return Measurements.of(q, conditions=Conditions(n, **some(conditions)), **some(columns))


@pytest.mark.parametrize("seed", [*range(3), *map(again, range(3, 10))])
def test_there_and_back(tmp_path, seed):
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


def test_units_and_order_of_columns(full):
    with pytest.raises(UnknownNameError, match="'gon'; expected one of deg, rad"):
        full.to_frame("gon")  # type: ignore[arg-type]
    assert list(full.to_frame().columns) == FULL.splitlines()[0].split(",")
    assert_same(Measurements.from_frame(full.to_frame()), full)


def test_a_saved_file_is_what_another_reader_expects(tmp_path, rng):
    q, reference = rng.uniform(-np.pi, np.pi, size=(50, 6)), rng.normal(size=(50, 3))
    reference[::7] = np.nan
    dew = pd.DataFrame({"dew_c": rng.normal(size=50)})
    path = tmp_path / "out.csv"
    Measurements.of(
        q, reference, conditions=Conditions(50, approach=np.ones((50, 6))), extra=dew
    ).save(path)
    table = pd.read_csv(path)
    close(np.deg2rad(table.filter(regex="^theta").to_numpy()), q, 1e-14)
    close(table[PLACES].to_numpy() / 1000, reference, 1e-14)
    np.testing.assert_allclose(table["dew_c"], dew["dew_c"], rtol=1e-14)
    assert table["approach6"].dtype.kind == "i"
    assert np.isnan(table["x_mm"]).sum() == 8


def test_small_angles_are_saved_so_that_they_can_be_read(tmp_path):
    """Within ±6.28° degrees would be taken for radians: then the file has radians."""
    q = np.full((5, 2), 0.05)
    Measurements.of(q).save(tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text().startswith("theta1_rad,")
    np.testing.assert_array_equal(Measurements.read(tmp_path / "out.csv").q, q)


# --- part of it, and what people see


def test_cells_that_a_spreadsheet_would_compute_are_quoted_and_read_back(tmp_path):
    """Labels, unknown columns and their names; what is a number stays one."""
    labels = ["=1+1", "+cmd", "@sum", "\tt", "'=q", "'plain", "-", "-1.5", "plain", "S3;=1+1"]
    extra = pd.DataFrame({"=name": labels, "self": labels, "number": np.arange(10) - 6.5})
    data = Measurements.of(np.arange(20.0).reshape(10, 2) / 10, operator=labels, extra=extra)
    data.save(tmp_path / "a.csv")
    with open(tmp_path / "a.csv", encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    cells = {cell for row in rows for cell in row} | set(header)
    expected = {"'=1+1", "'+cmd", "'@sum", "''=q", "'plain", "'-", "'=name", "-1.5", "-6.5"}
    assert expected <= cells
    assert not [
        part
        for cell in cells
        for part in re.split("[;\t]", cell)
        if re.match(r"[=+@\t-](?![\d.])", part)
    ]
    read = Measurements.read(tmp_path / "a.csv")
    assert read.operator is not None
    assert list(read.operator) == labels == list(read.extra["=name"]) == list(read.extra["self"])
    read.save(tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "a.csv").read_bytes()
