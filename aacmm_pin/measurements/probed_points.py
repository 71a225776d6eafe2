"""Probed points of an acceptance test: what their file states of each, and the records that they
amount to.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.notes import Note
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
    column_of,
    is_reading,
)
from aacmm_pin.measurements.csv_header import checked_names
from aacmm_pin.measurements.csv_values import cells_of, check_numbers, read_values
from aacmm_pin.measurements.record_checks import FEWEST_CONTACTS

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
LENGTH_TESTS = tuple(test for test, needed in NEEDED.items() if "length_mm" in needed)
ONE_VALUE = {
    ("length_id", "position", "repeat"): ("length_mm", "probe_diameter_mm", "u_length_mm"),
    ("feature", "position"): ("feature_diameter_mm", "probe_diameter_mm", "u_length_mm"),
}
"""What distinguishes the lengths, and the spheres, of a test, and the columns in which all points
of one state the same.
"""
LEAST_LENGTH_U = 1e-9
"""A length is not known better, even if its standard uncertainty is stated as zero [m]."""
PREDICTED_ACCURATE = "high"
"""In the column ``part``: a point probed in a posture that was predicted to be accurate."""


def read_probed_points(table: pd.DataFrame, problems: Problems) -> pd.DataFrame:
    """What an acceptance file states of each probed point: a column for each field of
    :data:`PROBED_POINT_COLUMNS`.

    Labels are text, "" where there is none; lengths are in metres, NaN where none is stated;
    ``row`` is the line in the file.

    Raises:
        MeasurementFileError: a name of a column is a mistake, there is no column ``test``, or no
            point; other ``problems`` are gathered.
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
    check_numbers(values, PROBED_POINT_COLUMNS, problems)
    points = pd.DataFrame({"row": problems.lines})
    for column in PROBED_POINT_COLUMNS:
        (name,) = column.names
        if column.is_label:
            points[column.field] = [label.strip() for label in values.label(name)]
        else:
            points[column.field] = values.block([name])[:, 0]
    _check_tests(points, problems)
    _state_one_value(points, problems)
    lengths = [column.field for column in PROBED_POINT_COLUMNS if not column.is_label]
    points[lengths] *= MM
    return points


def _field(name: str) -> str:
    """The field of a column."""
    column = column_of(name, PROBED_POINT_COLUMNS)
    return name if column is None else column.field


def _check_tests(points: pd.DataFrame, problems: Problems) -> None:
    """Known tests, each with the cells that it needs."""
    tests = points["test"].to_numpy()
    parts = points["part"].to_numpy()
    expected = f"expected {PREDICTED_ACCURATE} or an empty cell"
    problems.at(~np.isin(parts, [PREDICTED_ACCURATE, ""]), "part", f"{{!r}}; {expected}", parts)
    expected = f"expected one of {', '.join(NEEDED)}"
    problems.at(~np.isin(tests, list(NEEDED)), "test", f"{{!r}}; {expected}", tests)
    for test, names in NEEDED.items():
        for name in names:
            stated = points[_field(name)]
            empty = (stated.isna() | (stated == "")).to_numpy()
            problems.at(
                empty & (tests == test),
                name,
                f"empty cell; expected a value, because test {test} needs {name}",
            )


def _state_one_value(points: pd.DataFrame, problems: Problems) -> None:
    """What is calibrated is the same for all points of a length, or sphere; one that states nothing
    is given it.
    """
    for labels, names in ONE_VALUE.items():
        tests = [test for test, needed in NEEDED.items() if names[0] in needed]
        of_these = points["test"].isin(tests)
        groups = points.groupby(["test", *labels]).ngroup()
        for name in names:
            values = points[_field(name)].to_numpy()
            stated = of_these & np.isfinite(values)
            first = problems.of_other_values(name, values, stated, groups, ", ".join(labels))
            points[_field(name)] = np.where(of_these & (first >= 0), values[first], values)


def has_probed_points(table: pd.DataFrame) -> bool:
    """Whether a table states readings of probed points: a column ``test`` with a known test, and
    angles.
    """
    if "test" not in table or not any(is_reading(name) for name in table):
        return False
    return any(cell.strip() in NEEDED for cell in cells_of(table["test"]))


def with_features_as_seats(table: pd.DataFrame, problems: Problems) -> pd.DataFrame:
    """The table of a measurement file with its labels of features in the column of seats."""
    feature = cells_of(table[FEATURE])
    seat = cells_of(table["seat"]) if "seat" in table else np.full(len(table), "", dtype=object)
    both = (feature != "") & (seat != "")
    problems.at(
        both, FEATURE, "{!r} in a row with seat {!r}; expected one of the two labels", feature, seat
    )
    return table.drop(columns=FEATURE).assign(seat=np.where(feature != "", feature, seat))


def as_records(table: pd.DataFrame, problems: Problems) -> tuple[pd.DataFrame, tuple[Note, ...]]:
    """The table of a measurement file that states what the probed points state, and how that was
    made.

    A single point is a seat. So is each end of a length that is probed once a repeat, over all
    repeats of its position; the length is a bar between them, longer by the probe's diameter where
    it is probed from opposite sides. Points of a sphere whose diameter and probe are stated lie on
    it; its centre is unknown, and the same in all repeats. Others are not used. If the table has
    seats or bars of its own, these hold. Coordinates are those of the tested arm, and no reference.

    Raises:
        MeasurementFileError: see :func:`read_probed_points`.
    """
    points = read_probed_points(table, problems)
    problems.stop()
    records = table.loc[:, [not _is_of_test(str(name)) for name in table]].reset_index(drop=True)
    notes = [Note("touches_no_reference")] if REFERENCE[0] in table else []
    if {"seat", *BAR} & {*table}:
        return records, tuple(notes)
    seats = _seats_of(points)
    for name in seats.columns.drop("kind"):
        records[name] = seats[name].to_numpy()
    counts = {
        "points": points["position"][seats["kind"] == "point"].nunique(),
        "lengths": seats["bar"][seats["kind"] == "bar"].nunique(),
        "spheres": seats["seat"][seats["kind"] == "sphere"].nunique(),
    }
    notes.append(Note("touches_as_seats", counts))
    if unused := int((seats["kind"] == "").sum()):
        notes.append(Note("touches_unused", {"unused": unused}))
    return records, tuple(notes)


def _is_of_test(name: str) -> bool:
    """Whether a column has no part in records: it is of the test, of its coordinates, or
    planned.
    """
    of_test = column_of(name, PROBED_POINT_COLUMNS) is not None
    return of_test or name in (*REFERENCE, *REFERENCE_U) or name.lower().startswith(PLANNED)


def _ends_in_turn(features: pd.Series) -> NDArray[Any]:
    """The end of a bar, A or B, that each feature of a length is."""
    number, _ = pd.factorize(features)
    return np.where(number % 2 == 0, "A", "B")


def _seats_of(points: pd.DataFrame) -> pd.DataFrame:
    """Seat, bar and sphere of each probed point, in the columns of a measurement file, and its
    ``kind``: ``point``, ``bar``, ``sphere`` or "".
    """
    place = [points[name] for name in ("test", "length_id", "position")]
    probed = points.groupby([*place, points["repeat"], points["feature"]])["test"].transform("size")
    is_bar = points["test"].isin(LENGTH_TESTS) & (probed.groupby(place).transform("max") == 1)
    is_bar &= points.groupby(place)["feature"].transform("nunique") == 2
    is_point = (points["test"] == "single-point") & (probed.groupby(place).transform("sum") > 1)
    bar = points["test"] + " " + points["length_id"] + " in position " + points["position"]
    features = points.groupby(place)["feature"]
    end = features.transform(_ends_in_turn)
    both_sides = points["test"] == "length-bi"
    length = points["length"] + np.where(both_sides, points["probe_diameter"], 0.0)
    diameters = points[["feature_diameter", "probe_diameter"]]
    sphere = points["test"] + " " + points["feature"]
    sphere += (" in position " + points["position"]).where(points["position"] != "", "")
    is_sphere = diameters.notna().all(axis=1) & ~is_bar & ~is_point
    is_sphere &= sphere.where(is_sphere).groupby(sphere).transform("count") >= FEWEST_CONTACTS
    of_kind = {
        "point": (is_point, "point " + points["position"]),
        "bar": (is_bar, bar + ", " + points["feature"]),
        "sphere": (is_sphere, sphere),
    }
    seats = pd.DataFrame({"kind": "", "seat": ""}, index=points.index)
    for kind, (chosen, label) in of_kind.items():
        seats["kind"] = seats["kind"].where(~chosen, kind)
        seats["seat"] = seats["seat"].where(~chosen, label)
    for name, column in zip(diameters, DIAMETERS, strict=True):
        seats[column] = (diameters[name] / MM).astype(object).where(is_sphere, "")
    seats["bar"], seats["bar_end"] = bar.where(is_bar, ""), end.where(is_bar, "")
    seats["bar_length_mm"] = (length / MM).astype(object).where(is_bar, "")
    if points["u_length"].notna().any():
        u = points["u_length"].clip(lower=LEAST_LENGTH_U).groupby(place).transform("max")
        seats[BAR_U] = (u / MM).astype(object).where(is_bar & u.notna(), "")
    return seats
