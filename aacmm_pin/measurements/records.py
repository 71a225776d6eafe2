"""Measurements of an arm: readings, references and conditions, and their CSV file.

The file has mm and degrees (or rad), :class:`Measurements` SI.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, Index, Mask, batch, width_of
from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, count
from aacmm_pin.arm import Arm
from aacmm_pin.effects import CONDITION_ENTRIES, Conditions, Covariate, Labels, array_of
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError
from aacmm_pin.measurements.csv_columns import (
    APPROACH,
    DEGREES,
    DIAMETERS,
    FEATURE,
    FEATURE_KIND,
    ORIENTATION_U,
    ORIENTATIONS,
    PLANE,
    PROBE_DIRECTION,
    RADIANS,
    RECORD_COLUMNS,
    THETA,
    AngleUnit,
    Column,
    check_header,
    column_of,
    named,
    similar_labels,
)
from aacmm_pin.measurements.csv_table import joined_by_record, read_table
from aacmm_pin.measurements.csv_values import (
    Values,
    check_numbers,
    looks_like_radians,
    mostly_like_radians,
    read_records,
    read_values,
    rounding_steps,
)
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.measurements.orientation import as_quaternions
from aacmm_pin.measurements.probed_points import (
    as_records,
    has_probed_points,
    with_features_as_seats,
)
from aacmm_pin.measurements.relations import Relation, read_relations
from aacmm_pin.measurements.repeats import posture_numbers

LEAST_MOTION = 1e-3
"""Least change of a joint between rows that is motion [rad, m]."""
FIRST_RECORD = 2
"""Its line in a file: the header is line 1."""


class Bar(NamedTuple):
    """Two seats, their distance and its standard uncertainty [m], or NaN."""

    bar: str
    seat_a: str
    seat_b: str
    length: float
    u: float


class CovariateColumn(NamedTuple):
    """A column that residuals may depend on.

    Attributes:
        name: in the file.
        values: in the unit of the file, or labels (n,); unknown columns unchanged.
        entry: in the table of columns.
    """

    name: str
    values: pd.Series
    entry: Column

    @property
    def quantity(self) -> str:
        """The quantity, such as ``torque 2``; of an unknown column its name."""
        return self.entry.quantity(self.name)


@dataclass(frozen=True, eq=False)
class Measurements(Shown):
    """The n records of one arm.

    Attributes:
        q: joint angles ``(n, nq)`` [rad]; with couplings, readings until :meth:`with_joint_angles`.
        reference: of the tip ``(n, 3)`` [m]; NaN rows if unknown.
        reference_u: its standard uncertainty ``(n, 3)`` [m]; NaN rows if not stated.
        conditions: of the records.
        bar: label of the ball bar with an end at the seat ``(n,)``; "" for none.
        bar_end: ``A``, ``B`` or "" ``(n,)``.
        bar_length: ``(n,)`` [m]; NaN for no bar.
        operator: label ``(n,)``; "" if not stated.
        record: label ``(n,)``; "" if not stated.
        extra: other columns, unchanged, n rows.
        row: line in the file ``(n,)``, with the header as line 1; of a table as if in a file.
        source: file name as stated, or ``table``.
        read_as: unusual properties of the file, such as separators or omitted comments.
        header: columns of the file.
        orientation: of the target in the reference frame, unit quaternions, scalar first ``(n,
            4)``; NaN rows if unknown; None without any.
        orientation_u: its standard uncertainty about each axis ``(n,)`` [rad]; NaN if not stated;
            None without any.
        bar_length_u: standard uncertainty ``(n,)`` [m]; NaN if not stated; None without any.
        feature_diameter: of the sphere that is the seat, probed from outside ``(n,)`` [m]; NaN for
            a point. References are then those of its centre.
        probe_diameter: of the ball ``(n,)`` [m]; NaN if references are of the tip; see
            :func:`~aacmm_pin.measurements.records.at_centres`.
        feature_kind: ``plane`` or "" ``(n,)``.
        of_encoders: readings, if they differ from ``q``, ``(n, nq)`` [rad], or None.
        relations: distances and angles between planes.
    """

    q: Array
    reference: Array
    reference_u: Array
    conditions: Conditions
    extra: pd.DataFrame
    row: Index
    source: str
    bar: Labels | None = None
    bar_end: Labels | None = None
    bar_length: Array | None = None
    operator: Labels | None = None
    record: Labels | None = None
    read_as: tuple[Note, ...] = ()
    header: tuple[str, ...] = ()
    orientation: Array | None = None
    orientation_u: Array | None = None
    bar_length_u: Array | None = None
    feature_diameter: Array | None = None
    probe_diameter: Array | None = None
    feature_kind: Labels | None = None
    of_encoders: Array | None = None
    relations: tuple[Relation, ...] = ()

    @staticmethod
    def read(
        path: str | Path, nq: int | None = None, references: str | Path | None = None
    ) -> Measurements:
        """Read a measurement file (CSV), perhaps with references from a second file.

        The column ``record`` connects the rows of both; if a file lacks it, their order does.

        Args:
            nq: number of joints; None for any number.

        Raises:
            MeasurementFileError: it is unreadable, or a column or cell invalid; lists the first ten
                problems.
        """
        first = read_table(str(path))
        table, lines, read_as, *_ = first
        if references is not None:
            table = joined_by_record(str(path), first, str(references), read_table(str(references)))
        records = _from_table(table, lines, nq, str(path))
        return replace(records, read_as=read_as + records.read_as, header=tuple(table.columns))

    @staticmethod
    def from_frame(
        table: pd.DataFrame, nq: int | None = None, source: str = "table"
    ) -> Measurements:
        """Make measurements from a table with the columns of a measurement file.

        Raises:
            MeasurementFileError: see :meth:`read`. The first record is row 2.
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
        extra: pd.DataFrame | None = None,
        source: str = "table",
        **attributes: ArrayLike | None,
    ) -> Measurements:
        """Make measurements from arrays in SI units; None for unknown quantities.

        Arguments are attributes of the class; ``attributes`` may be ``orientation``,
        ``orientation_u``, ``bar``, ``bar_end``, ``bar_length``, ``bar_length_u``,
        ``feature_diameter``, ``probe_diameter``, ``feature_kind``, ``operator`` and ``record``.
        Coordinates of contacts become those of the tip; see
        :func:`~aacmm_pin.measurements.records.at_centres`. Only :meth:`read` checks whether seats
        and bars suffice for a calibration.

        Raises:
            ShapeError: a wrong shape, impossible numbers, or a known column in ``extra``.
            MeasurementFileError: contradictions, such as a bar without seat.
        """
        q = batch(q, width_of(q), "q", "rad")
        n = len(q)
        extra = pd.DataFrame(index=range(n)) if extra is None else extra.reset_index(drop=True)
        if len(extra) != n:
            raise ShapeError(f"extra has {len(extra)} rows; expected {n}, one per record")
        conditions = Conditions(n) if conditions is None else conditions
        if conditions.n != n:
            raise ShapeError(f"conditions have {conditions.n} records; expected {n}")
        stated: dict[str, Any] = {"reference": reference, "reference_u": reference_u} | attributes
        for column in RECORD_COLUMNS:
            if stated.get(column.field) is not None:
                stated[column.field] = _checked(column, stated[column.field], n)
        row = np.arange(n) + FIRST_RECORD
        measurements = _measurements(
            q, stated, conditions=conditions, extra=extra, row=row, source=source
        )
        problems = Problems(source, row)
        check_header([*measurements.to_frame()], None, problems)
        if reserved := [name for name in map(str, extra) if column_of(name).field]:
            raise ShapeError(
                f"extra has columns of known names: {', '.join(reserved)}; expected these as "
                "arguments of their own"
            )
        values = read_values(extra, RECORD_COLUMNS, problems)
        problems.stop()
        return replace(measurements, extra=_with_numbers(extra, values))

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

        Functions that take an arm and records do this themselves.

        Raises:
            ShapeError: the arm has another number of joints.
        """
        if not arm.couplings and self.of_encoders is None:
            return self
        readings = self.readings
        q = arm.joint_angles(readings)
        return replace(self, q=q, of_encoders=readings if arm.couplings else None)

    def with_readings(self, arm: Arm) -> Measurements:
        """Return the records with the readings of an arm at ``q``."""
        if not arm.couplings:
            return self
        return replace(self, of_encoders=arm.readings(self.q))

    @property
    def known(self) -> Mask:
        """Records with a known position of the tip, ``(n,)``."""
        return self.placed & ~self.on_surface

    @property
    def placed(self) -> Mask:
        """Records with reference coordinates of the tip or of a sphere, ``(n,)``."""
        return np.asarray(np.isfinite(self.reference).all(axis=1))

    @property
    def contact_radius(self) -> Array:
        """Distance from tip to centre of the touched sphere, ``(n,)`` [m]; NaN for no sphere."""
        if self.feature_diameter is None or self.probe_diameter is None:
            return np.full(self.n, np.nan)
        return (self.feature_diameter + self.probe_diameter) / 2

    @property
    def on_sphere(self) -> Mask:
        """Records that touch a sphere, ``(n,)``."""
        return np.isfinite(self.contact_radius)

    @property
    def on_plane(self) -> Mask:
        """Records that touch a plane, ``(n,)``."""
        if self.feature_kind is None:
            return np.zeros(self.n, dtype=bool)
        return np.asarray(self.feature_kind == PLANE, dtype=bool)

    @property
    def on_surface(self) -> Mask:
        """Records that touch a sphere or plane, ``(n,)``."""
        return self.on_sphere | self.on_plane

    @property
    def oriented(self) -> Mask:
        """Records that state an orientation, ``(n,)``."""
        if self.orientation is None:
            return np.zeros(self.n, dtype=bool)
        return np.isfinite(self.orientation[:, 0])

    def take(self, rows: Index | slice | Mask | Sequence[int]) -> Measurements:
        """Return records by indices, slice or mask; their seats and bars may not suffice for a
        calibration.
        """
        index = np.arange(self.n)[rows]
        arrays: dict[str, Any] = {}
        for field in fields(self):  # without cached properties
            stated = getattr(self, field.name)
            if isinstance(stated, np.ndarray):
                arrays[field.name] = stated[index]
        extra = self.extra.iloc[index].reset_index(drop=True)
        return replace(self, conditions=self.conditions.take(index), extra=extra, **arrays)

    def with_approach_from_order(self) -> Measurements:
        """Return the records with approach directions from the order of the rows.

        The direction is the sign of the change of ``q`` since the row before. A smaller one than
        :data:`LEAST_MOTION` keeps the sign. Before the first motion of a session it is 0. With
        couplings, first call :meth:`with_joint_angles`.

        Raises:
            AacmmError: the records state directions already.
        """
        if self.conditions.approach is not None:
            raise AacmmError(
                f"{self.source}: the file states approach1 …; expected no such columns with "
                "--approach-from-order; delete the columns, or omit the option"
            )
        step = np.diff(self.q, axis=0, prepend=self.q[:1])
        sign = pd.DataFrame(np.sign(step)).where(np.abs(step) > LEAST_MOTION)
        first_of_session = ~pd.Series(self.conditions.labels("session")).duplicated()
        sign[first_of_session] = 0.0
        approach = sign.ffill().to_numpy()
        return replace(self, conditions=replace(self.conditions, approach=approach))

    @property
    def order_in_time(self) -> Index:
        """Return the numbers of the records by ``time_s``, else in the order of rows, ``(n,)``."""
        time = self.conditions.time
        return np.arange(self.n) if time is None else np.argsort(time, kind="stable")

    @property
    def in_order(self) -> bool:
        """Return whether ``time_s``, else numbers in ``record``, increase from row to row."""
        clock: ArrayLike | None = self.conditions.time
        if clock is None and self.record is not None:
            clock = pd.to_numeric(pd.Series(self.record), errors="coerce")
        steps = np.diff(np.asarray([] if clock is None else clock, dtype=np.float64))
        return bool((steps >= 0.0).all() and steps.any())

    @cached_property
    def postures(self) -> Index:
        """Return the number of the posture of each record, ``(n,)``; see
        :func:`aacmm_pin.measurements.repeats.posture_numbers`.
        """
        return posture_numbers(self.q)

    def seats(self) -> dict[str, Index]:
        """Return the records of each seat, by label in the order of appearance."""
        return _records_by_label(self.conditions.seat)

    def bars(self) -> list[Bar]:
        """Return the ball bars with records of both ends, in the order of appearance."""
        seat = self.conditions.seat
        if self.bar is None or self.bar_end is None or self.bar_length is None or seat is None:
            return []
        stated_u = np.full(self.n, np.nan) if self.bar_length_u is None else self.bar_length_u
        bars = []
        for bar, rows in _records_by_label(self.bar).items():
            at_a, at_b = (rows[self.bar_end[rows] == end] for end in ("A", "B"))
            if len(at_a) and len(at_b):
                length = float(self.bar_length[rows[0]])
                u = float(np.fmax.reduce(stated_u[rows]))
                bars.append(Bar(bar, seat[at_a[0]], seat[at_b[0]], length, u))
        return bars

    def with_relations(self, given: str | Path | pd.DataFrame) -> Measurements:
        """Return the records with known distances and angles between planes of one body.

        Args:
            given: file of relations, or a table with its columns.

        Raises:
            MeasurementFileError: it cannot be read, or a row not used; names row and column.
        """
        stated = self.probe_diameter
        diameters = np.full(self.n, np.nan) if stated is None else stated
        probes = {}
        for label, rows in self.seats().items():
            if self.on_plane[rows].all():
                first = float(diameters[rows[0]])
                probes[label] = first if (diameters[rows] == first).all() else np.nan
        return replace(self, relations=read_relations(given, probes, self.source))

    def lengths(self) -> list[tuple[float, float]]:
        """Return the lengths of bars and distances of planes, each with its standard uncertainty
        [m].
        """
        lengths = [(bar.length, bar.u) for bar in self.bars()]
        for relation in self.relations:
            if np.isfinite(relation.distance):
                lengths.append((relation.distance, relation.distance_u))
        return lengths

    def bar_length_errors(self, tips: Array) -> Array:
        """Return the error of each bar length, ``(b,)`` [m]: distance of the mean tips at both
        ends, from tips ``(n, 3)``, minus the stated length.
        """
        means = {label: tips[rows].mean(axis=0) for label, rows in self.seats().items()}
        errors = []
        for bar in self.bars():
            between_ends = means[bar.seat_a] - means[bar.seat_b]
            errors.append(np.linalg.norm(between_ends) - bar.length)
        return np.array(errors)

    def to_frame(self, angle_unit: AngleUnit = "deg") -> pd.DataFrame:
        """Return a table with the columns of a measurement file, unknown ones last.

        Raises:
            UnknownNameError: ``angle_unit`` is neither ``deg`` nor ``rad``.
        """
        if angle_unit not in THETA:
            raise UnknownNameError("angle unit", angle_unit, list(THETA))
        angles = self.readings.T / (DEG if angle_unit == "deg" else 1.0)
        table = dict(zip(named(THETA[angle_unit], self.nq), angles, strict=True))
        left_out = {""}
        if not np.isfinite(self.reference_u).any():
            left_out |= {"reference_u"} if self.placed.any() else {"reference", "reference_u"}
        for column in RECORD_COLUMNS:
            holder = self.conditions if column.field in CONDITION_ENTRIES else self
            values = None if column.field in left_out else getattr(holder, column.field)
            if values is None:
                continue
            if not column.is_label:
                kind = np.int64 if column.names[0] == APPROACH else np.float64
                values = (values / column.si).astype(kind)
            names = named(column.names[0], values.shape[1]) if column.is_numbered else column.names
            table |= dict(zip(names, np.atleast_2d(values.T), strict=True))
        return pd.concat([pd.DataFrame(table), self.extra], axis=1)

    def covariate_columns(self) -> list[CovariateColumn]:
        """Return the columns on which residuals or exclusions may depend: of the whole arm, joints,
        groups, then :attr:`extra`.
        """
        table = self.to_frame()
        columns = [CovariateColumn(name, table[name], column_of(name)) for name in map(str, table)]
        kinds = get_args(Covariate)

        def order(column: CovariateColumn) -> int:
            entry = column.entry
            return kinds.index(entry.covariate) if entry.field else len(kinds)

        acting = (column for column in columns if column.entry.covariate != "none")
        return sorted(acting, key=order)

    def csv(self) -> str:
        """Return CSV text from which :meth:`read` restores the same numbers.

        Angles are in degrees, or in radians if :meth:`read` would take degrees for radians.
        """
        table = self.to_frame("rad" if looks_like_radians(self.readings / DEG) else "deg")
        texts = table.select_dtypes(exclude="number").to_numpy().ravel()
        # A lone carriage return ends a line for readers, but is no reason to quote for the writer.
        has_return = any("\r" in str(text) for text in texts)
        quoting: Literal[0, 2] = csv.QUOTE_NONNUMERIC if has_return else csv.QUOTE_MINIMAL
        return csv_text(table, quoting)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Save as a CSV file, whole or not at all.

        Raises:
            OutputError: ``path`` exists and ``force`` is False, or the file cannot be written.
        """
        from aacmm_pin._support.output_files import whole_file

        with whole_file(path, force) as temporary:
            temporary.write_text(self.csv(), encoding="utf-8", newline="")

    def __str__(self) -> str:
        text = f"{self.source}: {count(self.n, 'record')} of {count(self.nq, 'joint')}"
        if self.known.any():
            text += f", {self.known.sum()} with reference coordinates"
        parts = {"seat": self.seats(), "bar": self.bars(), "relation": self.relations}
        for noun, items in parts.items():
            text += f", {count(len(items), noun)}" if items else ""
        if self.extra.columns.empty:
            return text
        return f"{text}, other columns {', '.join(self.extra.columns)}"


def _records_by_label(labels: Labels | None) -> dict[str, Index]:
    if labels is None:
        return {}
    records = pd.Series(labels).groupby(labels, sort=False).indices
    return {label: np.asarray(records[label]) for label in dict.fromkeys(labels) if label}


# --- from a table


GivenRecords = Measurements | str | Path
"""Records, or the path of their file."""


def as_measurements(given: object, arm: Arm) -> Measurements:
    """Records, perhaps of a file, with the joint angles of an arm.

    Raises:
        MeasurementFileError: see :meth:`Measurements.read`.
        AacmmError: another type, or the arm has couplings and another number of joints.
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
    read_as: tuple[Note, ...] = ()
    problems = Problems(source, lines)
    describes_feature = not {FEATURE_KIND, *DIAMETERS}.isdisjoint(table)
    if has_probed_points(table):
        table, read_as = as_records(table, problems)
    elif FEATURE in table and describes_feature:
        table = with_features_as_seats(table, problems)
    values = read_records(table, nq, problems)
    stated = {column.field: values.in_si(column) for column in RECORD_COLUMNS if column.field}
    for form in ORIENTATIONS:
        if form[0] in values.columns:
            stated["orientation"] = as_quaternions(form, values.block(form))
    directions = np.nan_to_num(values.block(PROBE_DIRECTION))
    has_direction = directions.any(axis=1)
    stated["probe_direction"] = directions if has_direction.any() else None
    if has_direction.any() and not has_direction.all():
        rows = lines[~has_direction].tolist()
        read_as = (*read_as, Note("directions_missing", {"rows": rows}))
    conditions = {name: stated.pop(name) for name in CONDITION_ENTRIES}
    unknown = []
    for name in map(str, table):
        column = column_of(name)
        has_values = column.unit or any(map(str.strip, values.columns[name]))
        if not column.field and has_values:
            unknown.append(name)
    extra = table[unknown].reset_index(drop=True)
    angles = DEGREES if values.names(DEGREES) else RADIANS
    return _measurements(
        values.in_si(angles),
        stated,
        conditions=Conditions(values.n, **conditions),
        extra=_with_numbers(extra, values),
        row=lines,
        source=source,
        read_as=read_as + _notes(values, angles),
    )


def _with_numbers(extra: pd.DataFrame, values: Values) -> pd.DataFrame:
    numbers = {name: values.columns[name] for name in map(str, extra) if column_of(name).unit}
    return extra.assign(**numbers)


def _measurements(q: Any, stated: dict[str, Any], **others: Any) -> Measurements:
    """Records of attributes, with unit quaternions and references of the tip."""
    for name in ("reference", "reference_u"):
        if stated[name] is None:
            stated[name] = np.full((len(q), 3), np.nan)
    orientation = stated.get("orientation")
    if orientation is None or np.isnan(orientation).all():
        stated |= {"orientation": None, "orientation_u": None}
    else:
        norm = np.linalg.norm(orientation, axis=1, keepdims=True)
        stated["orientation"] = orientation / norm
    return at_centres(Measurements(q, **stated, **others))


def at_centres(records: Measurements) -> Measurements:
    """Records with references of the tip, the centre of the probe's ball.

    A record with probe diameter and direction, without feature or seat, states its contact p: the
    centre is ``c = p - r d``. The result has no diameter there, and ``read_as`` a note.
    """
    diameter = records.probe_diameter
    direction = records.conditions.probe_direction
    if diameter is None or direction is None:
        return records
    at_contact = np.isfinite(diameter) & direction.any(axis=1) & records.known
    if records.conditions.seat is not None:
        at_contact &= records.conditions.seat == ""
    if not at_contact.any():
        return records
    radius = np.where(at_contact, diameter / 2, 0.0)
    other_diameters = np.where(at_contact, np.nan, diameter)
    note = Note("contacts_at_centres", {"rows": records.row[at_contact].tolist()})
    return replace(
        records,
        reference=records.reference - radius[:, None] * direction,
        probe_diameter=other_diameters if np.isfinite(other_diameters).any() else None,
        read_as=(*records.read_as, note),
    )


def _notes(values: Values, angles: Column) -> tuple[Note, ...]:
    """An angle is too coarse if the u of its steps, step/√12 (JCGM 100:2008, F.2.2.1), exceeds
    usual noise.
    """
    notes = []
    largest_u = float(np.nan_to_num(values.block([ORIENTATION_U])).max())
    if largest_u > plausible.USUAL_ROTATION_NOISE:
        notes.append(Note("orientation_u_large", {"u": largest_u}))
    names = values.names(angles)
    theta = values.block(names)
    if angles is DEGREES and mostly_like_radians(theta):
        notes.append(Note("angles_like_radians", {"turn": 2 * np.pi}))
    steps = rounding_steps(theta)
    step = float(steps.max(initial=0.0))
    u = step * angles.si / np.sqrt(12.0)
    if u > ENCODER:
        rounded = np.array(names)[steps == step].tolist()
        sign = "°" if angles is DEGREES else " rad"
        data = {"columns": rounded, "step": step, "unit": sign, "u": float(u)}
        notes.append(Note("angles_rounded", data))
    for name in ("seat", "marker", "bar", "session"):
        if pairs := similar_labels(dict.fromkeys(values.label(name).tolist())):
            notes.append(Note("labels_alike", {"column": name, "labels": ", ".join(pairs)}))
    return tuple(notes)


# --- from arrays


def _checked(column: Column, values: ArrayLike, n: int) -> Any:
    """Values of a column as a new array, NaN if unknown."""
    if column.is_label:
        return array_of(column, values, n)
    entries = values if isinstance(values, np.ndarray) else np.asarray(values, dtype=object)
    unknown = pd.isna(entries)
    filled = np.where(unknown, 0.0, values) if np.any(unknown) else values
    array = array_of(column, filled, n)
    array[unknown] = np.nan
    name = column.field
    width = len(column.names)
    components = [f"{name}[#, {k}]" for k in range(width)] if width > 1 else [f"{name}[#]"]
    problems = Problems("", np.arange(n))
    check_numbers(column, components, array.reshape(n, width), column.range, problems)
    for row, component, text in problems.listed:
        raise ShapeError(f"{component.replace('#', str(row))}: {text}")
    return array
