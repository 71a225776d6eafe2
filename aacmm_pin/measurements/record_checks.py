"""What the cells of a measurement file say together: units of angles, references, seats and bars
that fit one another.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import MOST_LENGTH_ERROR, Array, is_no_unit
from aacmm_pin._support.file_problems import Problems
from aacmm_pin.measurements.csv_columns import (
    APPROACH,
    BAR_U,
    DIAMETERS,
    FEATURE_KIND,
    MEASUREMENT_FILE,
    ORIENTATION,
    ORIENTATIONS,
    PLANE,
    PROBE_DIRECTION,
    REFERENCE,
    REFERENCE_U,
    ROLL_PITCH_YAW,
    ROTATION_VECTOR,
    THETA,
    named,
    span,
)
from aacmm_pin.measurements.csv_values import RecordTable, Values, check_numbers
from aacmm_pin.measurements.repeats import WHOLE_TOLERANCE

ENOUGH_RECORDS = 5
"""So many records distinguish degrees from radians."""
ENOUGH_ANGLES = 10
"""So many different angles of a joint show that they are rounded."""
COARSE_DECIMALS = 4
"""Rounding to more decimals adds less than the noise of an encoder."""
LEAST_PART_IN_A_TURN = 0.75
"""Part of the angles that are within ±2π where degrees may be radians."""
SIGNS = (-1.0, 0.0, 1.0)
"""Directions of approach."""
BAR_ENDS = ("A", "B")
FEWEST_CONTACTS = 4
"""Three contacts determine a plane, or the centre of a sphere, and nothing else."""


def check_records(table: RecordTable, problems: Problems) -> None:
    """Whether cells that can be read say together what records can say.

    Raises:
        MeasurementFileError: they do not.
    """
    values = table.values
    _check_angles(table, problems)
    _check_references(values, problems)
    for name in table.header.numbered[APPROACH]:
        sign = values.numbers[name]
        problems.at(~np.isin(sign, SIGNS), name, "{:g}; expected -1, 0 or 1", sign)
    check_numbers(values, MEASUREMENT_FILE, problems)
    _check_seats(values, problems)
    _check_spheres(values, problems)
    _check_planes(values, problems)
    if "bar" in values.labels:
        _check_bars(values, problems)
    problems.stop()


def looks_like_radians(degrees: Array) -> bool:
    """Whether ``degrees`` (n, nq) are radians: at least 5 records, and the largest of all angles
    between 1 and 2π.

    Measurements turn several joints by tens of degrees. An arm that stays within ±1° of zero in all
    joints, or fewer records than 5, get the benefit of the doubt.
    """
    if len(degrees) < ENOUGH_RECORDS:
        return False
    largest = np.abs(degrees).max()
    return bool(1.0 < largest <= 2.0 * np.pi)


def mostly_like_radians(degrees: Array) -> bool:
    """Whether most of ``degrees`` (n, nq) would be less than a turn if they were radians: of few
    records, or with an endless wrist.
    """
    sizes = np.abs(degrees[degrees != 0.0])
    if not sizes.size or sizes.max() <= 1.0:
        return False
    return bool(np.mean(sizes <= 2.0 * np.pi) >= LEAST_PART_IN_A_TURN)


def rounding_steps(angles: Array) -> Array:
    """The power of ten that all angles (n, nq) of each joint are multiples of, in their unit (nq,);
    0 where there is none, or a joint has fewer than :data:`ENOUGH_ANGLES` different ones.
    """
    steps = np.zeros(angles.shape[1])
    for decimals in range(COARSE_DECIMALS, -1, -1):
        scaled = angles * 10.0**decimals
        is_whole = np.abs(scaled - np.rint(scaled)) < WHOLE_TOLERANCE
        steps[is_whole.all(axis=0)] = 10.0**-decimals
    different = pd.DataFrame(angles).nunique().to_numpy()
    return np.where(different < ENOUGH_ANGLES, 0.0, steps)


def _check_angles(table: RecordTable, problems: Problems) -> None:
    """Degrees that must be radians."""
    theta = table.header.theta
    q = table.values.block(theta)
    if table.header.unit == "rad" or not looks_like_radians(q):
        return
    largest = np.abs(q).max()
    in_radians = span(named(THETA["rad"], len(theta)))
    problems.add(
        span(theta),
        f"all angles of {len(q)} records lie within ±{largest:.4g}°; expected degrees, but these "
        f"numbers may be radians. If they are radians, rename the columns {in_radians}. If they "
        "are degrees, convert them to radians and use these names.",
    )


def _check_references(values: Values, problems: Problems) -> None:
    """References and directions with all of their components, quaternions and directions of the
    norm 1.
    """
    for names in (REFERENCE, REFERENCE_U, *ORIENTATIONS, PROBE_DIRECTION):
        stated = np.isfinite(values.block(names))
        partly = stated.any(axis=1) & ~stated.all(axis=1)
        for k, name in enumerate(names):
            others = ", ".join(names)
            problems.at(
                partly & ~stated[:, k],
                name,
                f"empty cell in a row with part of {others}; expected all or none of these values",
            )
    _check_zeros(values, problems)
    norm = np.linalg.norm(values.block(ORIENTATION), axis=1)
    problems.at(
        is_no_unit(norm),
        span(ORIENTATION),
        "a norm of {:.6g}; expected 1, because these are unit quaternions with the scalar first; "
        f"for other forms use {span(ROTATION_VECTOR)} or {span(ROLL_PITCH_YAW)}",
        norm,
    )
    length = np.linalg.norm(values.block(PROBE_DIRECTION), axis=1)
    problems.at(
        is_no_unit(length) & (length > 0.0),
        span(PROBE_DIRECTION),
        f"a length of {{:.6g}}; expected 1 ± {MOST_LENGTH_ERROR:g}, or empty cells if there is "
        "no direction",
        length,
    )
    placed = np.isfinite(values.block(REFERENCE)).any(axis=1) | (values.label("seat") != "")
    for form in ORIENTATIONS:
        oriented = np.isfinite(values.block(form)).all(axis=1)
        problems.at(
            oriented & ~placed,
            span(form),
            f"an orientation without a position; expected also {span(REFERENCE)} or seat",
        )


def _check_zeros(values: Values, problems: Problems) -> None:
    """Coordinates that a program wrote as zeros for want of others: no arm brings its tip to the
    origin in every record, but to one seat there.
    """
    coordinates = values.block(REFERENCE)
    known = np.isfinite(coordinates).all(axis=1)
    seats = values.label("seat")[known]
    of_one_seat = len({*seats}) == 1 and seats[0] != ""
    if np.count_nonzero(known) > 1 and not coordinates[known].any() and not of_one_seat:
        problems.add(
            span(REFERENCE),
            f"all {np.count_nonzero(known)} references are 0, 0, 0; expected the coordinates of "
            "each point; leave unknown coordinates empty; if all records are of one point, label "
            "this point in the column `seat`",
        )


def _check_seats(values: Values, problems: Problems) -> None:
    """Each seat has two records, coordinates or a bar."""
    seat = values.label("seat")
    counts = Counter(seat)
    single = np.array([counts[label] == 1 for label in seat], dtype=bool)
    known = np.isfinite(values.block(REFERENCE)).any(axis=1)
    useless = (seat != "") & single & ~known & (values.label("bar") == "")
    problems.at(
        useless,
        "seat",
        "only this record has the label {!r}, and it has no coordinates; expected two or more "
        "records with this label, or an empty cell",
        seat,
    )


def _check_spheres(values: Values, problems: Problems) -> None:
    """Each record of a sphere states its label and both diameters, and each sphere the same in all
    of its records; a probe's diameter alone is that of a contact with a direction.
    """
    seat = values.label("seat")
    diameters = values.block(DIAMETERS)
    feature, probe = np.isfinite(diameters).T
    probe &= values.label(FEATURE_KIND) != PLANE
    problems.at(
        feature & (seat == ""),
        DIAMETERS[0],
        "a diameter in a row without a label in the column feature; expected a label",
    )
    problems.at(
        feature & ~probe,
        DIAMETERS[1],
        "empty cell in a row with the diameter of a feature; expected both diameters",
    )
    directed = np.linalg.norm(values.block(PROBE_DIRECTION), axis=1) > 0.0
    problems.at(
        ~feature & probe & ~(directed & (seat == "")),
        DIAMETERS[0],
        "empty cell in a row with the diameter of a probe; expected both diameters, or "
        f"{span(PROBE_DIRECTION)} in a row without feature and seat",
    )
    labels = pd.Series(seat)
    stated = np.column_stack([diameters, values.block(REFERENCE)])
    for name, numbers in zip((*DIAMETERS, *REFERENCE), stated.T, strict=True):
        problems.of_other_values(name, numbers, feature & np.isfinite(numbers), labels, "feature")
    of_sphere = labels.isin(seat[feature]).to_numpy() & (seat != "")
    problems.at(
        of_sphere & ~feature,
        DIAMETERS[0],
        "empty cell in a row of the sphere {!r}; expected a value in all rows of this sphere",
        seat,
    )
    contacts = labels.groupby(labels).transform("size").to_numpy()
    placed = np.isfinite(values.block(REFERENCE)).any(axis=1)
    placed_sphere = labels.isin(seat[placed]).to_numpy()
    problems.at(
        feature & (contacts < FEWEST_CONTACTS) & ~placed_sphere,
        "seat",
        "the sphere {!r} has {} records without coordinates of its centre; expected 4 or more",
        seat,
        contacts,
    )


def _check_planes(values: Values, problems: Problems) -> None:
    """Each record of a plane states its label, and neither diameter of a sphere nor coordinates;
    each plane has enough contacts.
    """
    kind = values.label(FEATURE_KIND)
    seat = values.label("seat")
    known = np.isin(kind, [PLANE, ""])
    problems.at(~known, FEATURE_KIND, f"{{!r}}; expected {PLANE} or an empty cell", kind)
    plane = kind == PLANE
    problems.at(
        plane & (seat == ""),
        FEATURE_KIND,
        "a plane without a label in the column feature; expected a label",
    )
    labels = pd.Series(seat)
    of_plane = labels.isin(seat[plane]).to_numpy() & (seat != "")
    problems.at(
        of_plane & ~plane,
        FEATURE_KIND,
        "empty cell in a row of the plane {!r}; expected plane",
        seat,
    )
    stated = np.isfinite(values.block((*REFERENCE, DIAMETERS[0]))).any(axis=1)
    problems.at(
        plane & stated,
        FEATURE_KIND,
        "plane in a row with coordinates or a diameter; expected empty cells there",
    )
    problems.at(
        plane & (values.label("bar") != ""),
        "bar",
        "a bar in a row of a plane; expected an empty cell",
    )
    contacts = labels.groupby(labels).transform("size").to_numpy()
    problems.at(
        plane & (contacts < FEWEST_CONTACTS),
        "seat",
        "the plane {!r} has {} records; expected 4 or more",
        seat,
        contacts,
    )


def _check_bars(values: Values, problems: Problems) -> None:
    """Whether the rows of each bar state one length with its u, both ends, and another seat at
    each; other rows none.
    """
    bar, end, seat = (values.label(name) for name in ("bar", "bar_end", "seat"))
    length, u = values.block(["bar_length_mm", BAR_U]).T
    of_bar = bar != ""
    row = np.arange(values.n)
    cells = {"bar_end": (end, end != ""), "bar_length_mm": (length, np.isfinite(length))}
    for name, (stated, is_stated) in cells.items():
        problems.at(
            ~of_bar & is_stated, name, "{} in a row without bar; expected an empty cell", stated
        )
    problems.at(of_bar & ~np.isin(end, BAR_ENDS), "bar_end", "{!r}; expected A or B", end)
    for name, empty in (("seat", seat == ""), ("bar_length_mm", np.isnan(length))):
        problems.at(
            of_bar & empty, name, "empty cell in a row of the bar {!r}; expected a value", bar
        )
    groups = pd.Series(bar)
    for name, numbers in (("bar_length_mm", length), (BAR_U, u)):
        problems.of_other_values(name, numbers, of_bar & np.isfinite(numbers), groups, "bar")
    problems.of_other_values(
        "seat", seat, of_bar & (seat != ""), groups + "\0" + end, "end of a bar"
    )
    table = pd.DataFrame({"bar": bar, "end": end, "seat": seat, "row": row})
    by_bar = table.groupby("bar")
    first = by_bar["row"].transform("first").to_numpy()
    of_bar &= np.isin(end, BAR_ENDS)
    one_end = by_bar["end"].transform("nunique").to_numpy() == 1
    problems.at(
        of_bar & one_end & (row == first),
        "bar_end",
        "the bar {!r} has records of end {} only; expected records of A and B",
        bar,
        end,
    )
    ends_of_seat = table.groupby(["bar", "seat"])["end"].transform("nunique").to_numpy()
    problems.at(
        of_bar & (ends_of_seat == 2) & (seat != ""),
        "seat",
        "{!r} is at both ends of the bar {!r}; expected two seats",
        seat,
        bar,
    )
