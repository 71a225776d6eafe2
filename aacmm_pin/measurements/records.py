"""Measurements of an arm: encoder indications, references where they are known, and conditions;
their CSV file.

The file speaks millimetres and degrees (or radians); :class:`Measurements` speaks SI.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Array, Index, Mask, batch, is_no_unit, vector, width_of
from aacmm_pin._support.display import Shown
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.notes import Note
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, count
from aacmm_pin.arm import Arm
from aacmm_pin.effects import CONDITION_COLUMNS, Conditions, Labels, labels_of
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError
from aacmm_pin.measurements.contacts import at_centres
from aacmm_pin.measurements.csv_columns import (
    APPROACH,
    DIAMETERS,
    FEATURE,
    FEATURE_KIND,
    ORIENTATION_U,
    ORIENTATIONS,
    PLANE,
    PROBE_DIRECTION,
    RECORD_COLUMNS,
    THETA,
    AngleUnit,
    Column,
    Covariate,
    entry_of,
    named,
)
from aacmm_pin.measurements.csv_header import read_header, similar_labels
from aacmm_pin.measurements.csv_table import read_table
from aacmm_pin.measurements.csv_values import (
    RecordTable,
    Values,
    cells_of,
    check_numbers,
    read_records,
    read_values,
)
from aacmm_pin.measurements.joined_files import joined
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.measurements.orientation import as_quaternions
from aacmm_pin.measurements.probed_points import (
    as_records,
    has_probed_points,
    with_features_as_seats,
)
from aacmm_pin.measurements.record_checks import (
    check_records,
    looks_like_radians,
    mostly_like_radians,
    rounding_steps,
)
from aacmm_pin.measurements.repeats import posture_numbers

LEAST_MOTION = 1e-3
"""A joint whose angle changes by less than this from row to row was not moved [rad, m]."""
FIRST_RECORD = 2
"""Line of the first record in a file: the header is line 1."""


class Bar(NamedTuple):
    """Two seats at a known distance, and its standard uncertainty, NaN where it is not
    stated [m].
    """

    bar: str
    seat_a: str
    seat_b: str
    length: float
    u: float


class CovariateColumn(NamedTuple):
    """A column that residuals may depend on.

    Attributes:
        name: in the file.
        values: (n,), numbers in the unit of the file or labels; of an unknown column as they came.
        entry: in the table of columns, which says what it may act on.
    """

    name: str
    values: NDArray[Any] | pd.Series
    entry: Column

    @property
    def quantity(self) -> str:
        """What it is, such as ``torque 2``; the name of a column that no attribute has."""
        return self.entry.quantity(self.name)


@dataclass(frozen=True, eq=False)
class Measurements(Shown):
    """The n records of one arm.

    Attributes:
        q: joint angles ``(n, nq)`` [rad]; for an arm without couplings the readings; see
            :meth:`with_joint_angles`.
        reference: coordinates of the tip ``(n, 3)`` [m]; NaN rows if unknown.
        reference_u: standard uncertainty of ``reference`` ``(n, 3)`` [m]; NaN rows if not stated.
        conditions: conditions of the records.
        bar: label of the ball bar whose end is the seat of the record ``(n,)``; "" for no bar.
        bar_end: end of the bar, ``A``, ``B`` or "" ``(n,)``.
        bar_length: length of the bar ``(n,)`` [m]; NaN for no bar.
        operator: label of the operator ``(n,)``; "" if not stated.
        record: label of the record ``(n,)``; "" if not stated.
        extra: columns without an attribute, unchanged, n rows.
        row: line of each record in the file ``(n,)``, with the header as line 1. For records from a
            table, the line that a file would have.
        source: file name as the caller stated it, or ``table``.
        read_as: unusual properties of the file: separators, decimal commas, excluded comments or
            records, rows of an acceptance test.
        header: names of the columns in the file.
        orientation: orientation of the target in the reference frame, unit quaternions with the
            scalar first ``(n, 4)``; NaN rows if unknown; None without any orientation.
        orientation_u: standard uncertainty of the orientation about each axis ``(n,)`` [rad]; NaN
            if not stated; None without any orientation.
        bar_length_u: standard uncertainty of the bar length ``(n,)`` [m]; NaN if not stated; None
            if never stated.
        feature_diameter: diameter of the sphere that is the seat ``(n,)`` [m]; you probe the sphere
            from outside. NaN if the seat is a point. If the seat is a sphere, the references are
            coordinates of its centre.
        probe_diameter: diameter of the ball of the probe ``(n,)`` [m]. NaN if the references are
            for the tip; see :func:`~aacmm_pin.measurements.contacts.at_centres`.
        feature_kind: ``plane`` if the seat is a plane, otherwise "" ``(n,)``.
        of_encoders: readings, if they differ from ``q``, ``(n, nq)`` [rad]; otherwise None.
    """

    q: Array
    reference: Array
    reference_u: Array
    conditions: Conditions
    bar: Labels | None
    bar_end: Labels | None
    bar_length: Array | None
    operator: Labels | None
    record: Labels | None
    extra: pd.DataFrame
    row: Index
    source: str
    read_as: tuple[Note, ...] = ()
    header: tuple[str, ...] = ()
    orientation: Array | None = None
    orientation_u: Array | None = None
    bar_length_u: Array | None = None
    feature_diameter: Array | None = None
    probe_diameter: Array | None = None
    feature_kind: Labels | None = None
    of_encoders: Array | None = None

    @staticmethod
    def read(
        path: str | Path, nq: int | None = None, references: str | Path | None = None
    ) -> Measurements:
        """Read a measurement file (CSV), and its references from a second file if you state one.

        The column ``record`` connects the rows of the two files. If a file lacks the column
        ``record``, the order of the rows connects the files.

        Args:
            nq: number of joints; None for any number.

        Raises:
            MeasurementFileError: the file cannot be read, is not a measurement file, or has an
                invalid column or cell. The message names row and column of the first ten problems.
        """
        first = read_table(str(path))
        table, lines, read_as, _ = first
        if references is not None:
            table = joined(str(path), first, str(references), read_table(str(references)))
        found = _from_table(table, lines, nq, str(path))
        return replace(found, read_as=read_as + found.read_as, header=tuple(table.columns))

    @staticmethod
    def from_frame(
        table: pd.DataFrame, nq: int | None = None, source: str = "table"
    ) -> Measurements:
        """Make measurements from a table with the columns of a measurement file; cells are numbers
        or text.

        Raises:
            MeasurementFileError: see :meth:`read`. Row numbers count as in a file, with the first
                record in row 2.
        """
        lines = np.arange(len(table)) + FIRST_RECORD
        return _from_table(table, lines, nq, source)

    @staticmethod
    def of(
        q: ArrayLike,
        reference: ArrayLike | None = None,
        reference_u: ArrayLike | None = None,
        conditions: Conditions | None = None,
        *,
        bar: ArrayLike | None = None,
        bar_end: ArrayLike | None = None,
        bar_length: ArrayLike | None = None,
        operator: ArrayLike | None = None,
        record: ArrayLike | None = None,
        orientation: ArrayLike | None = None,
        orientation_u: ArrayLike | None = None,
        bar_length_u: ArrayLike | None = None,
        feature_diameter: ArrayLike | None = None,
        probe_diameter: ArrayLike | None = None,
        feature_kind: ArrayLike | None = None,
        extra: pd.DataFrame | None = None,
        source: str = "table",
    ) -> Measurements:
        """Make measurements from arrays in SI units; None for unknown quantities.

        The arguments are the attributes of the class. Coordinates of contacts become coordinates of
        the tip; see :func:`~aacmm_pin.measurements.contacts.at_centres`. The method checks shapes
        and numbers. Only :meth:`read` also checks whether seats and bars suffice for a calibration.

        Raises:
            ShapeError: an array has a wrong shape or impossible numbers, or ``extra`` has a known
                column.
            MeasurementFileError: the data contradict each other, for example a bar without seat or
                a wrong number of approach directions.
        """
        q = batch(q, width_of(q), "q", "rad")
        n = len(q)
        extra = pd.DataFrame(index=range(n)) if extra is None else extra.reset_index(drop=True)
        if len(extra) != n:
            raise ShapeError(f"extra has {len(extra)} rows; expected {n}, one per record")
        known = Conditions(n) if conditions is None else conditions
        if known.n != n:
            raise ShapeError(f"conditions have {known.n} records; expected {n}")
        unknown = np.full((n, 3), np.nan)
        given = {
            "reference": unknown if reference is None else reference,
            "reference_u": unknown if reference_u is None else reference_u,
            "orientation": orientation,
            "orientation_u": orientation_u,
            "bar": bar,
            "bar_end": bar_end,
            "bar_length": bar_length,
            "bar_length_u": bar_length_u,
            "feature_diameter": feature_diameter,
            "probe_diameter": probe_diameter,
            "feature_kind": feature_kind,
            "operator": operator,
            "record": record,
        }
        entries = {column.field: column for column in RECORD_COLUMNS}
        checked = {name: _checked(entries[name], values, n) for name, values in given.items()}
        row = np.arange(n) + FIRST_RECORD
        measurements = Measurements(
            q=q, conditions=known, extra=extra, row=row, source=source, **checked
        )
        problems = Problems(source, row)
        header = read_header([*measurements.to_frame()], None, problems)
        check_numbers(read_values(extra, RECORD_COLUMNS, problems), RECORD_COLUMNS, problems)
        problems.stop()
        if list(header.extra) != list(extra.columns):
            known_names = [name for name in extra.columns if name not in header.extra]
            raise ShapeError(
                f"extra has columns of known names: {', '.join(known_names)}; expected these as "
                "arguments of their own"
            )
        return at_centres(measurements)

    @property
    def n(self) -> int:
        """The number of records."""
        return int(self.q.shape[0])

    @property
    def nq(self) -> int:
        """The number of joints."""
        return int(self.q.shape[1])

    @property
    def readings(self) -> Array:
        """The readings of the encoders, ``(n, nq)`` [rad]."""
        return self.q if self.of_encoders is None else self.of_encoders

    def with_joint_angles(self, arm: Arm) -> Measurements:
        """Return the records with ``q`` as the joint angles of an arm with couplings.

        Functions of this package that accept an arm and records call this method themselves. For an
        arm without couplings nothing changes.

        Raises:
            ShapeError: the arm has another number of joints.
        """
        if not arm.couplings and self.of_encoders is None:
            return self
        readings = self.readings
        q = arm.joint_angles(readings)
        return replace(self, q=q, of_encoders=readings if arm.couplings else None)

    def with_readings(self, arm: Arm) -> Measurements:
        """Return the records with the readings of an arm at the joint angles ``q``."""
        if not arm.couplings:
            return self
        return replace(self, of_encoders=arm.readings(self.q))

    @property
    def known(self) -> Mask:
        """True for records with a known position of the tip, ``(n,)``."""
        return self.placed & ~self.on_surface

    @property
    def placed(self) -> Mask:
        """True for records with reference coordinates of the tip or of a sphere, ``(n,)``."""
        return np.asarray(np.isfinite(self.reference).all(axis=1))

    @property
    def contact_radius(self) -> Array:
        """The distance between the tip and the centre of the sphere that the record touches,
        ``(n,)`` [m]; NaN for no sphere.
        """
        if self.feature_diameter is None or self.probe_diameter is None:
            return np.full(self.n, np.nan)
        return np.asarray((self.feature_diameter + self.probe_diameter) / 2)

    @property
    def on_sphere(self) -> Mask:
        """True for records that touch a sphere, ``(n,)``."""
        return np.asarray(np.isfinite(self.contact_radius))

    @property
    def on_plane(self) -> Mask:
        """True for records that touch a plane, ``(n,)``."""
        if self.feature_kind is None:
            return np.zeros(self.n, dtype=bool)
        return np.asarray(self.feature_kind == PLANE, dtype=bool)

    @property
    def on_surface(self) -> Mask:
        """True for records that touch a sphere or a plane, ``(n,)``."""
        return self.on_sphere | self.on_plane

    @property
    def oriented(self) -> Mask:
        """True for records that state an orientation, ``(n,)``."""
        if self.orientation is None:
            return np.zeros(self.n, dtype=bool)
        return np.isfinite(self.orientation[:, 0])

    def take(self, rows: Index | slice | Mask | Sequence[int]) -> Measurements:
        """Return some of the records, by indices, a slice or a mask.

        The method does not check whether the remaining seats and bars suffice for a calibration.
        """
        index = np.arange(self.n)[rows]
        arrays: dict[str, Any] = {}
        for field in fields(self):  # not what was worked out from it
            stated = getattr(self, field.name)
            if isinstance(stated, np.ndarray):
                arrays[field.name] = stated[index]
        extra = self.extra.iloc[index].reset_index(drop=True)
        return replace(self, conditions=self.conditions.take(index), extra=extra, **arrays)

    def with_approach_from_order(self) -> Measurements:
        """Return the records with approach directions that follow from the order of the rows.

        The direction is the sign of the change of ``q`` since the row before. A change below
        :data:`LEAST_MOTION` keeps the sign of the row before. Before the first motion of a session,
        the direction is 0. If the arm has couplings, first call :meth:`with_joint_angles`.

        Raises:
            AacmmError: the records already state approach directions.
        """
        if self.conditions.approach is not None:
            raise AacmmError(
                f"{self.source}: the file states approach1 …; expected no such columns with "
                "--approach-from-order; delete the columns, or omit the option"
            )
        step = np.diff(self.q, axis=0, prepend=self.q[:1])
        sign = pd.DataFrame(np.sign(step)).where(np.abs(step) > LEAST_MOTION)
        stated = self.conditions.session
        session = pd.Series([""] * self.n if stated is None else stated)
        sign[~session.duplicated()] = 0.0
        approach = sign.ffill().to_numpy()
        return replace(self, conditions=replace(self.conditions, approach=approach))

    @property
    def order_in_time(self) -> Index:
        """Return the numbers of the records in the order of ``time_s``, ``(n,)``; of the rows if
        the file states no time.
        """
        time = self.conditions.time
        return np.arange(self.n) if time is None else np.argsort(time, kind="stable")

    @property
    def in_order(self) -> bool:
        """Return whether the rows are in the order of measurement: ``time_s`` or, without it,
        numbers in ``record`` increase from row to row.
        """
        clock: ArrayLike | None = self.conditions.time
        if clock is None and self.record is not None:
            clock = pd.to_numeric(pd.Series(self.record), errors="coerce")
        steps = np.diff(np.asarray([] if clock is None else clock, dtype=np.float64))
        return bool(steps.size) and bool((steps >= 0.0).all() and steps.any())

    @cached_property
    def postures(self) -> Index:
        """Return the number of the held posture of each record, ``(n,)``.

        See :func:`aacmm_pin.measurements.repeats.posture_numbers`.
        """
        return posture_numbers(self.q)

    def seats(self) -> dict[str, Index]:
        """Return the records of each seat by its label, in the order of their first records."""
        return _records_by_label(self.conditions.seat)

    def bars(self) -> list[Bar]:
        """Return the ball bars with records of both ends, in the order of their first records."""
        seat = self.conditions.seat
        if self.bar is None or self.bar_end is None or self.bar_length is None or seat is None:
            return []
        stated_u = np.full(self.n, np.nan) if self.bar_length_u is None else self.bar_length_u
        found = []
        for bar, rows in _records_by_label(self.bar).items():
            at_a, at_b = (rows[self.bar_end[rows] == end] for end in ("A", "B"))
            if len(at_a) and len(at_b):
                length = float(self.bar_length[rows[0]])
                u = float(np.fmax.reduce(stated_u[rows]))
                found.append(Bar(bar, seat[at_a[0]], seat[at_b[0]], length, u))
        return found

    def bar_length_errors(self, tips: Array) -> Array:
        """Compute the error of each bar length, ``(b,)`` [m].

        The error is the distance between the mean tips at both ends, minus the stated length.

        Args:
            tips: positions of the tip ``(n, 3)`` [m].
        """
        means = {label: tips[rows].mean(axis=0) for label, rows in self.seats().items()}
        errors = []
        for bar in self.bars():
            way = means[bar.seat_a] - means[bar.seat_b]
            errors.append(np.linalg.norm(way) - bar.length)
        return np.array(errors)

    def to_frame(self, angle_unit: AngleUnit = "deg") -> pd.DataFrame:
        """Return a table with the columns of a measurement file; unknown columns come last.

        Raises:
            UnknownNameError: ``angle_unit`` is neither ``deg`` nor ``rad``.
        """
        if angle_unit not in THETA:
            raise UnknownNameError("angle unit", angle_unit, list(THETA))
        angles = self.readings.T / (DEG if angle_unit == "deg" else 1.0)
        table = dict(zip(named(THETA[angle_unit], self.nq), angles, strict=True))
        stated = np.isfinite(self.reference_u).any()
        left_out = {"reference": not (stated or self.placed.any()), "reference_u": not stated}
        for column in RECORD_COLUMNS:
            if column.field and not left_out.get(column.field):
                table |= self._in_file(column)
        return pd.concat([pd.DataFrame(table), self.extra], axis=1)

    def _in_file(self, column: Column) -> dict[str, NDArray[Any]]:
        """What is stated in the columns of an entry, in their unit; nothing where nothing is."""
        values = getattr(
            self.conditions if column.field in CONDITION_COLUMNS else self, column.field
        )
        if values is None:
            return {}
        if not column.is_label:
            kind = np.int64 if column.names[0] == APPROACH else np.float64
            values = (values / column.si).astype(kind)
        names = named(column.names[0], values.shape[1]) if column.is_numbered else column.names
        return dict(zip(names, np.atleast_2d(values.T), strict=True))

    def covariate_columns(self) -> list[CovariateColumn]:
        """Return the columns that residuals or excluded records may depend on.

        Columns of the whole arm come first, then columns of joints and of groups, then columns of
        :attr:`extra`.
        """
        kinds = get_args(Covariate)
        known = [entry for entry in RECORD_COLUMNS if entry.field]
        known.sort(key=lambda entry: kinds.index(entry.covariate))
        found = []
        for entry in known:
            found += [CovariateColumn(*column, entry) for column in self._in_file(entry).items()]
        for name in map(str, self.extra):
            entry = entry_of(name)
            values = self.extra[name]
            if not entry.is_label:
                values = pd.to_numeric(values, errors="coerce")
            found.append(CovariateColumn(name, values, entry))
        return [column for column in found if column.entry.covariate != "none"]

    def csv(self) -> str:
        """Return the records as CSV text from which :meth:`read` restores the same numbers.

        Angles are in degrees, or in radians if :meth:`read` would interpret the degrees as radians.
        """
        table = self.to_frame("rad" if looks_like_radians(self.readings / DEG) else "deg")
        dates = table.select_dtypes(["datetime", "datetimetz", "timedelta"])
        table[dates.columns] = dates.astype("string")  # without the hour where all are of midnight
        texts = table.select_dtypes(exclude="number").to_numpy().ravel()
        # A lone carriage return ends a line for readers, but is no reason to quote for the writer.
        returns = any("\r" in str(text) for text in texts)
        quoting: Literal[0, 2] = csv.QUOTE_NONNUMERIC if returns else csv.QUOTE_MINIMAL
        return csv_text(table, quoting)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save the records as a CSV file.

        If the save fails, no incomplete file remains.

        Raises:
            OutputError: ``path`` exists and ``force`` is False, or the file cannot be written.
        """
        from aacmm_pin._support.output_files import whole_file

        with whole_file(path, force) as temporary:
            temporary.write_text(self.csv(), encoding="utf-8", newline="")

    def __str__(self) -> str:
        found = f"{self.source}: {count(self.n, 'record')} of {count(self.nq, 'joint')}"
        if self.known.any():
            found += f", {self.known.sum()} with reference coordinates"
        for noun, number in (("seat", len(self.seats())), ("bar", len(self.bars()))):
            found += f", {count(number, noun)}" if number else ""
        if self.extra.columns.empty:
            return found
        return f"{found}, other columns {', '.join(self.extra.columns)}"


def _records_by_label(labels: Labels | None) -> dict[str, Index]:
    """The records of each label, in the order of their first records."""
    if labels is None:
        return {}
    records = pd.Series(np.arange(len(labels))).groupby(labels).indices
    return {
        label: np.asarray(records[label], dtype=np.intp) for label in dict.fromkeys(labels) if label
    }


# --- from a table


GivenRecords = Measurements | str | Path
"""Records, or the path of their file."""


def as_measurements(given: object, arm: Arm) -> Measurements:
    """Records themselves, or those of a file by :meth:`Measurements.read`, with the joint angles
    of an arm.

    Raises:
        MeasurementFileError: see :meth:`Measurements.read`.
        AacmmError: it is something else, or the arm has couplings and another number of joints.
    """
    if isinstance(given, Measurements):
        return given.with_joint_angles(arm)
    if isinstance(given, str | Path):
        return Measurements.read(given, arm.nq).with_joint_angles(arm)
    raise AacmmError(
        f"measurements is of type {type(given).__name__}; expected Measurements, or the path "
        "of a file"
    )


def _from_table(table: pd.DataFrame, lines: Index, nq: int | None, source: str) -> Measurements:
    """The records of a measurement file, or of an acceptance file with readings.

    Raises:
        MeasurementFileError: see :meth:`Measurements.read`.
    """
    read_as: tuple[Note, ...] = ()
    problems = Problems(source, lines)
    if has_probed_points(table):
        table, read_as = as_records(table, problems)
    elif {FEATURE, FEATURE_KIND, *DIAMETERS} & {*table} > {FEATURE}:
        table = with_features_as_seats(table, problems)
    columns = read_records(table, nq, problems)
    check_records(columns, problems)
    found = columns.fields()
    unknown = np.full((len(table), 3), np.nan)
    for name in ("reference", "reference_u"):
        found[name] = unknown if found[name] is None else found[name]
    found["orientation"] = _unit_quaternions(_stated_orientations(columns.values))
    if found["orientation"] is None:
        found["orientation_u"] = None
    directions = np.nan_to_num(columns.values.block(PROBE_DIRECTION))
    has_direction = directions.any(axis=1)
    found["probe_direction"] = directions if has_direction.any() else None
    if has_direction.any() and not has_direction.all():
        rows = lines[~has_direction].tolist()
        read_as = (*read_as, Note("directions_missing", {"rows": rows}))
    conditions = Conditions(len(table), **{name: found.pop(name) for name in CONDITION_COLUMNS})
    theta = columns.values.block(columns.header.theta)
    q = theta * DEG if columns.header.unit == "deg" else theta
    with_values = [
        name for name in columns.header.extra if any(map(str.strip, cells_of(table[name])))
    ]
    extra = table[with_values].reset_index(drop=True)
    stated: dict[str, Any] = dict(found)
    read_as += _notes(columns)
    measurements = Measurements(
        q=q, conditions=conditions, extra=extra, row=lines, source=source, read_as=read_as, **stated
    )
    return at_centres(measurements)


def _notes(columns: RecordTable) -> tuple[Note, ...]:
    """What may be in another unit, and labels that may be mistyped."""
    notes = []
    u = np.nan_to_num(columns.values.block([ORIENTATION_U])).max()
    if u > plausible.USUAL_TURN_NOISE:
        notes.append(Note("orientation_u_large", {"u": float(u)}))
    if columns.header.unit == "deg" and mostly_like_radians(
        columns.values.block(columns.header.theta)
    ):
        notes.append(Note("angles_like_radians", {"turn": 2 * np.pi}))
    notes += _rounded_angles(columns)
    for name in ("seat", "marker", "bar", "session"):
        if pairs := similar_labels(dict.fromkeys(columns.values.label(name).tolist())):
            notes.append(Note("labels_alike", {"column": name, "labels": ", ".join(pairs)}))
    return tuple(notes)


def _rounded_angles(columns: RecordTable) -> list[Note]:
    """That angles are rounded to a step whose standard uncertainty, step/√12 (JCGM 100:2008,
    F.2.2.1), is larger than the usual noise of an encoder.
    """
    unit = columns.header.unit
    steps = rounding_steps(columns.values.block(columns.header.theta))
    step = float(steps.max(initial=0.0))
    u = step * (DEG if unit == "deg" else 1.0) / np.sqrt(12.0)
    if u <= ENCODER:
        return []
    names = np.array(columns.header.theta)[steps == step].tolist()
    sign = "°" if unit == "deg" else " rad"
    return [Note("angles_rounded", {"columns": names, "step": step, "unit": sign, "u": float(u)})]


def _stated_orientations(values: Values) -> Array | None:
    """Quaternions (n, 4) by the columns that a file has for them; None where it has none."""
    for form in ORIENTATIONS:
        if form[0] in values.numbers:
            return as_quaternions(form, values.block(form))
    return None


def _unit_quaternions(quaternions: Array | None) -> Array | None:
    """With the norm of one, which those of a file have but for rounding; None where none is
    stated.
    """
    if quaternions is None or np.isnan(quaternions).all():
        return None
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))


# --- from arrays


def _checked(column: Column, values: ArrayLike | None, n: int) -> Any:
    """What is given for the field of a column, as an array of its own; numbers that are not known
    are NaN where they may be.

    Raises:
        ShapeError: another shape, or numbers or labels that cannot be.
    """
    name = column.field
    if values is None:
        return None
    if column.is_label:
        return labels_of(name, values, n)
    array = _numbers(column, values, n)
    if column.range is not None:
        column.range.check(np.where(np.isnan(array), column.range.most, array), name, ShapeError)
    if column.above_zero and (array == 0.0).any():
        raise ShapeError(f"{name} contains zeros; expected standard uncertainties above 0")
    return _checked_quaternions(array) if name == "orientation" else array


def _numbers(column: Column, values: ArrayLike, n: int) -> Array:
    """Numbers of n records, of each component of a column or of none.

    Raises:
        ShapeError: they are not.
    """
    name = column.field
    width = len(column.names)
    unit = column.range.unit if column.range is not None else column.unit
    if width == 1:
        array = _with_gaps(values, lambda filled: vector(filled, n, name, unit))
    else:
        array = _with_gaps(values, lambda filled: batch(filled, width, name, unit))
    if len(array) != n:
        raise ShapeError(f"{name} has {len(array)} rows; expected {n}, one per record")
    if width > 1:
        unknown = np.isnan(array)
        partly = np.flatnonzero(unknown.any(axis=1) & ~unknown.all(axis=1))
        if partly.size:
            raise ShapeError(
                f"{name}[{partly[0]}] is {array[partly[0]]}; expected numbers, or only NaN if all "
                "are unknown"
            )
    return array


def _checked_quaternions(array: Array) -> Array | None:
    """Unit quaternions without what rounding did to their norms; None where none is stated.

    Raises:
        ShapeError: a norm is off by more than rounding.
    """
    norm = np.linalg.norm(array, axis=1)
    if is_no_unit(norm).any():
        came = f"norms of {np.nanmin(norm):g} to {np.nanmax(norm):g}"
        raise ShapeError(f"orientation has {came}; expected unit quaternions, of norm 1")
    return _unit_quaternions(array)


def _with_gaps(values: ArrayLike, check: Callable[[ArrayLike], Array]) -> Array:
    """``values`` after a ``check`` for which NaN counts as a number; masks stay what they are and
    do not pass it.
    """
    if isinstance(values, np.ma.MaskedArray):
        return check(values)
    unknown = pd.isna(
        values if isinstance(values, np.ndarray) else np.asarray(values, dtype=object)
    )
    array = check(np.where(unknown, 0.0, values) if np.any(unknown) else values)
    array[unknown] = np.nan
    return array
