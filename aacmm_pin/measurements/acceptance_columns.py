"""Touches of an acceptance test: the columns of their file, and the records of a measurement file that they amount to."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Index
from aacmm_pin._support.plausible import Range
from aacmm_pin.measurements.csv_columns import BAR, BAR_U, REFERENCE, REFERENCE_U, Problems

NEEDED = {
    "sphere": ("feature", "feature_diameter_mm", "probe_diameter_mm"),
    "location": ("feature", "repeat"),
    "length-uni": ("feature", "position", "repeat", "length_id", "length_mm"),
    "length-bi": ("feature", "position", "repeat", "length_id", "length_mm", "probe_diameter_mm"),
    "effective-diameter": ("feature", "feature_diameter_mm", "probe_diameter_mm", "repeat"),
    "single-point": ("position",),
    "volumetric": ("feature", "position", "length_id", "length_mm"),
}
"""The tests, and the columns that must not be empty in their rows."""
NUMBERS: dict[str, tuple[str, Range]] = {
    "feature_diameter_mm": ("feature_diameter", Range(1e-3, 1.0, "m")),
    "length_mm": ("length", plausible.BAR_LENGTH),
    "u_length_mm": ("u_length", plausible.LENGTH_NOISE),
    "probe_diameter_mm": ("probe_diameter", Range(0.0, 0.1, "m")),
}
"""Columns of numbers, what they are called in metres, and what they can be."""
ONE_VALUE = {
    ("length_id", "position", "repeat"): ("length_mm", "probe_diameter_mm", "u_length_mm"),
    ("feature", "position"): ("feature_diameter_mm", "probe_diameter_mm", "u_length_mm"),
}
"""What tells the lengths, and the spheres, of a test apart, and the columns in which all touches of one say the same."""
BEST_LENGTH = 1e-6
"""A length is not known better, even if its standard uncertainty is stated as zero [mm]."""
PART = "high"
"""In the column ``part``: a touch in a posture that was predicted to be accurate."""
PLANNED = "planned_"
"""Begins the columns in which a procedure says where the arm was to be: no conditions of a record."""
READINGS = r"theta\d+_(deg|rad)"
"""Columns of indications."""
LABELS = ("feature", "test", "position", "repeat", "length_id", "part")
ACCEPTANCE = (*LABELS, *NUMBERS)


def check_tests(table: pd.DataFrame, problems: Problems) -> None:
    """Whether every row is of a known test, and of a known part."""
    tests, part = _texts(table, "test").to_numpy(), _texts(table, "part").to_numpy()
    problems.at(~np.isin(part, [PART, ""]), "part", f"is {{!r}}, expected {PART} or an empty cell", part)
    problems.at(~np.isin(tests, list(NEEDED)), "test", f"is {{!r}}, expected one of {', '.join(NEEDED)}", tests)


def as_records(table: pd.DataFrame, lines: Index, source: str) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The table of a measurement file that says what the touches say, and how that was made; another table as it is.

    A single point is a seat. So is each end of a length that is touched once a repeat, over all repeats of its position; the
    length is a bar between them, longer by the probe's diameter where it is touched from opposite sides. Other touches lie
    on spheres of unknown centre, and are not used. Where the table has seats or bars of its own, these hold.
    Coordinates are those of the arm that is tested, and no reference.

    Raises:
        MeasurementFileError: some tests are known, and others not, or a length is no number.
    """
    if not _texts(table, "test").isin(NEEDED).any() or not table.columns.astype(str).str.fullmatch(READINGS).any():
        return table, ()
    table, problems = table.reset_index(drop=True), Problems(source, lines)
    check_tests(table, problems)
    cells = pd.DataFrame({name: _texts(table, name) for name in LABELS})
    known = pd.to_numeric(_texts(table, "length_mm"), errors="coerce")
    probe = pd.to_numeric(_texts(table, "probe_diameter_mm"), errors="coerce")
    length = known + np.where(cells["test"] == "length-bi", probe, 0.0)
    of_length = cells["test"].isin([test for test, needed in NEEDED.items() if "length_mm" in needed])
    problems.at(
        (of_length & length.isna()).to_numpy(), "length_mm", "expected the length, and the probe for length-bi, in numbers"
    )
    problems.stop()
    known_names = (*ACCEPTANCE, *REFERENCE, *REFERENCE_U)
    records = table.drop(columns=[name for name in table if name in known_names or str(name).lower().startswith(PLANNED)])
    notes = ["touches of an acceptance test: coordinates in the file are no reference"] if "x_mm" in table else []
    if {"seat", *BAR} & {*table}:
        return records, tuple(notes)
    place = [cells[name] for name in ("test", "length_id", "position")]
    touched = cells.groupby([*place, cells["repeat"], cells["feature"]])["test"].transform("size")
    is_bar = of_length & (touched.groupby(place).transform("max") == 1)
    is_bar &= cells.groupby(place)["feature"].transform("nunique") == 2
    is_point = (cells["test"] == "single-point") & (touched.groupby(place).transform("sum") > 1)
    name = cells["test"] + " " + cells["length_id"] + " in position " + cells["position"]
    end = cells.groupby(place)["feature"].transform(lambda feature: np.array(["A", "B"])[pd.factorize(feature)[0] % 2])
    records["seat"] = np.where(is_bar, name + ", " + cells["feature"], np.where(is_point, "point " + cells["position"], ""))
    records["bar"], records["bar_end"] = np.where(is_bar, name, ""), np.where(is_bar, end, "")
    records["bar_length_mm"] = length.astype(object).where(is_bar, "")
    if "u_length_mm" in table:
        u = pd.to_numeric(_texts(table, "u_length_mm"), errors="coerce").clip(lower=BEST_LENGTH)
        records[BAR_U] = u.groupby(place).transform("max").astype(object).where(is_bar & u.notna(), "")
    notes.append(
        f"touches of an acceptance test: {cells['position'][is_point].nunique()} single points and the ends of "
        f"{name[is_bar].nunique()} lengths are seats that stood still; {(~is_bar & ~is_point).sum()} touches on "
        "spheres are not used"
    )
    return records, tuple(notes)


def _texts(table: pd.DataFrame, name: str) -> pd.Series:
    """A column as text, "" where there is nothing."""
    column = table.get(name, pd.Series("", table.index)).astype(object)
    return column.where(column.notna(), "").astype(str).str.strip()
