"""Probed points of an acceptance test, and the records that they are."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.display import Note
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.units import MM
from aacmm_pin.measurements.csv_columns import (
    ACCEPTANCE_FILE,
    BAR,
    BAR_U,
    DIAMETERS,
    FEATURE,
    PLANNED,
    PROBED_POINT_COLUMNS,
    REFERENCE,
    REFERENCE_U,
    checked_names,
    is_reading,
)
from aacmm_pin.measurements.csv_values import FEWEST_CONTACTS, cells_of, read_values

NEEDED = {
    "sphere": ("feature", "feature_diameter_mm", "probe_diameter_mm"),
    "location": ("feature", "repeat"),
    "length-uni": ("feature", "position", "repeat", "length_id", "length_mm"),
    "length-bi": ("feature", "position", "repeat", "length_id", "length_mm", "probe_diameter_mm"),
    "effective-diameter": ("feature", "feature_diameter_mm", "probe_diameter_mm", "repeat"),
    "single-point": ("position",),
    "volumetric": ("feature", "position", "length_id", "length_mm"),
}
"""The columns that rows of each test must fill in."""
POINT_FIELDS = {column.names[0]: column.field for column in PROBED_POINT_COLUMNS}
LENGTH_TESTS = tuple(test for test, needed in NEEDED.items() if "length_mm" in needed)
ONE_VALUE = {
    ("length_id", "position", "repeat"): ("length_mm", "probe_diameter_mm", "u_length_mm"),
    ("feature", "position"): ("feature_diameter_mm", "probe_diameter_mm", "u_length_mm"),
}
"""Labels of lengths and spheres, and the columns with one value for each."""
LEAST_LENGTH_U = 1e-9
"""Least u of a length, even if stated as zero [m]."""
PREDICTED_ACCURATE = "high"
"""``part`` of a posture with predicted high accuracy."""


def read_probed_points(table: pd.DataFrame, problems: Problems) -> pd.DataFrame:
    """Probed points of an acceptance file, with the fields of
    :data:`PROBED_POINT_COLUMNS`.

    Labels are text, or ""; lengths [m], or NaN; ``row`` is the line in the file.

    Raises:
        MeasurementFileError: a wrong name of a column, no column ``test``, or no point; other
            mistakes go to ``problems``.
    """
    names = checked_names(list(table.columns), ACCEPTANCE_FILE, problems)
    if "test" not in names:
        problems.add(
            "test", f"missing; expected the test of each point, one of {', '.join(NEEDED)}"
        )
    if not len(table):
        problems.add("", "a header without probed points; expected one row per probed point")
    problems.stop()
    values = read_values(table, PROBED_POINT_COLUMNS, problems)
    points = pd.DataFrame({"row": problems.lines})
    lengths = []
    for column in PROBED_POINT_COLUMNS:
        if column.is_label:
            points[column.field] = [label.strip() for label in values.label(column.names[0])]
        else:
            points[column.field] = values.block(column.names)
            lengths.append(column.field)
    tests = points["test"].to_numpy()
    parts = points["part"].to_numpy()
    expected = f"expected {PREDICTED_ACCURATE} or an empty cell"
    problems.at(~np.isin(parts, [PREDICTED_ACCURATE, ""]), "part", f"{{!r}}; {expected}", parts)
    expected = f"expected one of {', '.join(NEEDED)}"
    problems.at(~np.isin(tests, list(NEEDED)), "test", f"{{!r}}; {expected}", tests)
    for test, needed in NEEDED.items():
        for name in needed:
            stated = points[POINT_FIELDS[name]]
            is_empty = (stated.isna() | (stated == "")).to_numpy()
            problems.at(
                is_empty & (tests == test),
                name,
                f"empty cell; expected a value, because test {test} needs {name}",
            )
    for labels, columns in ONE_VALUE.items():
        of_tests = np.isin(tests, [test for test, needed in NEEDED.items() if columns[0] in needed])
        groups = points.groupby(["test", *labels]).ngroup()
        for name in columns:
            numbers = points[POINT_FIELDS[name]].to_numpy()
            is_stated = of_tests & np.isfinite(numbers)
            owner = ", ".join(labels)
            first_row = problems.of_other_values(name, numbers, is_stated, groups, owner)
            completed = np.where(of_tests & (first_row >= 0), numbers[first_row], numbers)
            points[POINT_FIELDS[name]] = completed
    points[lengths] *= MM
    return points


def has_probed_points(table: pd.DataFrame) -> bool:
    """Whether a table has angles and a known ``test``."""
    if "test" not in table or not any(map(is_reading, table)):
        return False
    return bool(table["test"].astype(str).str.strip().isin(NEEDED).any())


def with_features_as_seats(table: pd.DataFrame, problems: Problems) -> pd.DataFrame:
    """A measurement file with features as seats."""
    feature = cells_of(table[FEATURE])
    seat = cells_of(table["seat"]) if "seat" in table else np.full_like(feature, "")
    has_both = (feature != "") & (seat != "")
    problems.at(
        has_both,
        FEATURE,
        "{!r} in a row with seat {!r}; expected one of the two labels",
        feature,
        seat,
    )
    return table.drop(columns=FEATURE).assign(seat=np.where(feature != "", feature, seat))


def as_records(table: pd.DataFrame, problems: Problems) -> tuple[pd.DataFrame, tuple[Note, ...]]:
    """The table of a measurement file of probed points, and notes.

    A single point is a seat, and so is each end of a length with one point a repeat, over all
    repeats of its position. The length is a bar between its ends, longer by the probe diameter if
    probed from opposite sides. Points of a sphere with stated diameters lie on it. Other points are
    not used. Seats or bars of the table have priority. Coordinates are those of the tested arm: no
    reference.

    Raises:
        MeasurementFileError: see :func:`read_probed_points`.
    """
    points = read_probed_points(table, problems)
    problems.stop()
    of_test = [
        name in (*POINT_FIELDS, *REFERENCE, *REFERENCE_U) or name.lower().startswith(PLANNED)
        for name in map(str, table)
    ]
    records = table.loc[:, np.logical_not(of_test)].reset_index(drop=True)
    notes = [Note("touches_no_reference")] if REFERENCE[0] in table else []
    if {"seat", *BAR} & {*table}:
        return records, tuple(notes)
    seats = _seats_of(points)
    kind = seats.pop("kind")
    counts = {
        "points": points["position"][kind == "point"].nunique(),
        "lengths": seats["bar"][kind == "bar"].nunique(),
        "spheres": seats["seat"][kind == "sphere"].nunique(),
    }
    notes.append(Note("touches_as_seats", counts))
    if unused := int((kind == "").sum()):
        notes.append(Note("touches_unused", {"unused": unused}))
    return records.assign(**seats), tuple(notes)


def _seats_of(points: pd.DataFrame) -> pd.DataFrame:
    """Columns of a measurement file, and ``kind``: ``point``, ``bar``, ``sphere`` or ""."""
    test, feature, position = (points[name] for name in ("test", "feature", "position"))
    label_columns = ["test", "length_id", "position"]
    labels = [points[name] for name in label_columns]
    features_of_length = feature.groupby(labels)
    is_single = ~points.duplicated([*label_columns, "repeat", "feature"], keep=False)
    is_bar = test.isin(LENGTH_TESTS) & is_single.groupby(labels).transform("all")
    is_bar &= features_of_length.transform("nunique") == 2
    is_point = (test == "single-point") & points.duplicated(label_columns, keep=False)
    bar_label = test + " " + points["length_id"] + " in position " + position
    bar_end = pd.Series(np.where(feature == features_of_length.transform("first"), "A", "B"))
    opposite = test == "length-bi"
    length = points["length"] + points["probe_diameter"].where(opposite, 0.0)
    diameters = points[["feature_diameter", "probe_diameter"]]
    sphere_label = test + " " + feature + (" in position " + position).where(position != "", "")
    is_sphere = diameters.notna().all(axis=1) & ~is_bar & ~is_point
    is_sphere &= (
        sphere_label.where(is_sphere).groupby(sphere_label).transform("count") >= FEWEST_CONTACTS
    )
    kinds = {
        "point": (is_point, "point " + position),
        "bar": (is_bar, bar_label + ", " + feature),
        "sphere": (is_sphere, sphere_label),
    }
    seats = pd.DataFrame({"kind": "", "seat": ""}, index=points.index)
    for kind, (is_kind, label) in kinds.items():
        seats["kind"] = seats["kind"].where(~is_kind, kind)
        seats["seat"] = seats["seat"].where(~is_kind, label)
    seats[[*DIAMETERS]] = (diameters / MM).where(is_sphere)
    seats["bar"], seats["bar_end"] = bar_label.where(is_bar, ""), bar_end.where(is_bar, "")
    seats["bar_length_mm"] = (length / MM).where(is_bar)
    if points["u_length"].notna().any():
        u = points["u_length"].clip(lower=LEAST_LENGTH_U).groupby(labels).transform("max")
        seats[BAR_U] = (u / MM).where(is_bar)
    return seats
