"""Measurements of an arm: encoder indications, references where they are known, and conditions; their CSV file.

The file speaks millimetres and degrees (or radians); :class:`Measurements` speaks SI.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support import plausible
from aacmm_pin._support.checks import Array, Index, batch, vector, width_of
from aacmm_pin._support.display import Shown
from aacmm_pin._support.text_escaping import csv_text
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.effects.conditions import COLUMNS, Conditions, Labels, labels_of
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError
from aacmm_pin.measurements import csv_columns as names
from aacmm_pin.measurements.csv_columns import Problems, checked_columns, named, read_header
from aacmm_pin.measurements.csv_table import read_table

FIRST_RECORD = 2
"""Line of the first record in a file: the header is line 1."""
REPEATED = 1e-3
"""Postures whose readings differ by no more than this in any joint are one, repeated [rad; m where a joint slides].

A UR10 sent to one pose 255 times reads within 3e-4 rad, and its other poses are more than 0.03 rad apart; a Fanuc's repeats
state the very same angles. A tip moves by about a millimetre over such a step, and what depends on posture hardly changes.
"""

EXACT = 1e-6
"""What is nearer to a whole number, or half of one, is it: in micrometres, a double at 100 m has 1e-8."""
FINGERPRINT_STEP = 1e-9
"""Numbers of a record that differ by less are the same [rad, m]."""
FINGERPRINT_DIGITS = 12
"""Hexadecimal digits of a fingerprint: among 100 000 records two agree by chance in one file of 50 000."""
UNKNOWN = -(2.0**62)
"""Stands for coordinates that are not known."""
ROUNDED_TO = (1e-3, 1e-4, 1e-5, 1e-6)
"""What angles of another export may be rounded to, the coarsest first [degree] …"""
REFERENCE_ROUNDED_TO = (10 * UM, UM, UM / 10, UM / 100)
"""… and its references [m]."""
MOST_VALUES = 12
"""An unknown column with more values than this is of single records, such as their numbers."""
COPIED = (*names.REFERENCE, *names.ORIENTATION, "seat", "marker", "bar", "bar_end")
"""Columns in which copies agree, beside the angles and the directions of approach."""


class Bar(NamedTuple):
    """Two seats at a known distance, and its standard uncertainty, NaN where it is not stated [m]."""

    bar: str
    seat_a: str
    seat_b: str
    length: float
    u: float


@dataclass(frozen=True, eq=False)
class Measurements(Shown):
    """Records of one arm, n of them.

    Attributes:
        q: encoder indications (n, nq) [rad].
        reference: coordinates of the tip (n, 3) [m], NaN rows where they are not known.
        reference_u: their standard uncertainty (n, 3) [m], NaN rows where it is not stated.
        conditions: what else is known of each record.
        bar: label of the bar that the seat of a record is an end of (n,), "" where none.
        bar_end: ``A``, ``B`` or "" (n,).
        bar_length: length of the bar (n,) [m], NaN where none.
        operator: label (n,), "" where none.
        record: label (n,), "" where none.
        extra: columns of unknown meaning as they came, n rows.
        row: line of each record in the file (n,), the header being line 1; in a table, the line it would have.
        source: the file as the caller named it, or ``table``.
        read_as: how the file was read, where that is not as it usually is: separators, decimal commas, comments left out,
            touches of an acceptance test; records that were left out.
        header: names of the columns of the file, as they stand there.
        orientation: of the target in the frame of the references, unit quaternions with the scalar first (n, 4), NaN rows
            where it is not known; None where it nowhere is.
        orientation_u: its standard uncertainty about each axis (n,) [rad], NaN where it is not stated; None where it
            nowhere is.
        bar_length_u: standard uncertainty of that length (n,) [m], NaN where it is not stated; None where it nowhere is.
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
    read_as: tuple[str, ...] = ()
    header: tuple[str, ...] = ()
    orientation: Array | None = None
    orientation_u: Array | None = None
    bar_length_u: Array | None = None

    @staticmethod
    def read(path: str | Path, nq: int | None = None) -> Measurements:
        """Read a measurement file (CSV) of an arm with ``nq`` joints, of any arm where ``nq`` is None.

        Raises:
            MeasurementFileError: the file cannot be read, is not such a table, or a column or cell is not as expected;
                the message names the row and column of the first ten problems.
        """
        table, lines, read_as = read_table(str(path))
        found = _from_table(table, lines, nq, str(path))
        return replace(found, read_as=read_as + found.read_as, header=tuple(table.columns))

    @staticmethod
    def from_frame(table: pd.DataFrame, nq: int | None = None, source: str = "table") -> Measurements:
        """The same from a table with the columns of a measurement file; cells may be numbers or text.

        Raises:
            MeasurementFileError: see :meth:`read`; rows are counted as in a file, the first record being row 2.
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
        extra: pd.DataFrame | None = None,
        source: str = "table",
    ) -> Measurements:
        """Measurements from arrays in SI units, see the attributes; None where nothing is known.

        Shapes and numbers are checked, but not whether seats and bars suffice for a calibration, as :meth:`read` does.

        Raises:
            ShapeError: an array has another shape or numbers that cannot be, or ``extra`` a known column.
            MeasurementFileError: the columns of a file with these data would contradict each other, such as an
                unknown column named like a known one, a bar without seat, or another number of approaches than joints.
        """
        q = batch(q, width_of(q), "q", "rad")
        n = len(q)
        extra = pd.DataFrame(index=range(n)) if extra is None else extra.reset_index(drop=True)
        if len(extra) != n:
            raise ShapeError(f"extra has {len(extra)} rows, expected {n}: one a record")
        known = Conditions(n) if conditions is None else conditions
        if known.n != n:
            raise ShapeError(f"conditions are of {known.n} records, expected {n}")
        nothing = np.full((n, 3), np.nan)
        given = {"bar": bar, "bar_end": bar_end, "bar_length": bar_length, "operator": operator, "record": record}
        given |= {"orientation": orientation, "orientation_u": orientation_u, "bar_length_u": bar_length_u}
        given |= {"reference": nothing if reference is None else reference}
        given |= {"reference_u": nothing if reference_u is None else reference_u}
        checked = {name: _checked(name, values, n) for name, values in given.items()}
        row = np.arange(n) + FIRST_RECORD
        measurements = Measurements(q=q, conditions=known, extra=extra, row=row, source=source, **checked)
        header = read_header(list(measurements.to_frame().columns), None, Problems(source, measurements.row))
        if list(header.extra) != list(extra.columns):
            known_names = [name for name in extra.columns if name not in header.extra]
            raise ShapeError(f"extra has columns of known names: {', '.join(known_names)}; these are arguments of their own")
        return measurements

    @property
    def n(self) -> int:
        """Number of records."""
        return int(self.q.shape[0])

    @property
    def nq(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) True where the reference is known."""
        return np.asarray(np.isfinite(self.reference).all(axis=1))

    @property
    def oriented(self) -> NDArray[np.bool_]:
        """(n,) True where an orientation is stated."""
        return np.zeros(self.n, dtype=bool) if self.orientation is None else np.isfinite(self.orientation[:, 0])

    def take(self, rows: Index | slice | NDArray[np.bool_] | Sequence[int]) -> Measurements:
        """Some of the records; seats and bars may lose what made them useful, which only reading a file checks."""
        index = np.arange(self.n)[rows]
        stated = {field.name: getattr(self, field.name) for field in fields(self)}  # not what was worked out from it
        arrays: dict[str, Any] = {name: value[index] for name, value in stated.items() if isinstance(value, np.ndarray)}
        extra = self.extra.iloc[index].reset_index(drop=True)
        return replace(self, conditions=self.conditions.take(index), extra=extra, **arrays)

    def copies(self) -> Index:
        """Number of the first record (n,) that each says the same as; its own where it is the first.

        Copies agree in the readings, but for whole turns, in the reference, the labels of what was touched and the
        directions of approach, to the last digit, but for a reference that one of them states rounded to 1e-2 to 1e-5 mm,
        angles that it states rounded to 1e-3 to 1e-6 degrees, or both: no second measurement does, while a file that was
        appended to itself, or to another export of the same measurement, does. All else may be rounded or named in any way.
        """
        alone = self._nearest > DEG * ROUNDED_TO[0]
        if alone.all():
            return np.arange(self.n)
        angles, within = named(names.THETA["deg"], self.nq), np.asarray(np.round(np.mod(self.q / DEG, 360.0), 9) % 360.0)
        table = self.to_frame().reindex(columns=[*COPIED, *named(names.APPROACH, self.nq)])
        table.loc[self.known, list(names.ORIENTATION)] = np.nan
        table = table.assign(alone=np.where(alone, np.arange(self.n), -1), **dict(zip(angles, within.T, strict=True)))
        same, but_for_angles = _numbered(table), _numbered(table.drop(columns=angles))
        but_for_reference, but_for_both = (_numbered(table.drop(columns=[*names.REFERENCE, *more])) for more in ([], angles))
        for step in ROUNDED_TO:
            same = _joined(same, but_for_angles, within / step)
        for size in REFERENCE_ROUNDED_TO if self.known.any() else ():
            same = _joined(same, but_for_reference, self.reference / size)
            for step in ROUNDED_TO:
                same = _joined(same, but_for_both, np.hstack([within / step, self.reference / size]))
        _, first, number = np.unique(same, return_index=True, return_inverse=True)
        return np.asarray(first[number], dtype=np.intp)

    def fingerprints(self) -> tuple[str, ...]:
        """A short text for each record by which it is known again, in whatever file: of its readings and reference.

        Readings are taken to 1e-9 rad and coordinates to a nanometre, so that a unit of angles makes no other record of it.
        """
        return _fingerprints(np.column_stack([self.q, self.reference]))

    def fingerprints_of_standards(self) -> tuple[str, ...]:
        """The same of each seat's stated coordinates and of each bar's length with its u, in which several records share."""
        labels = np.full(self.n, "", dtype=object) if self.conditions.seat is None else self.conditions.seat
        places = np.unique(self.reference[self.known & (labels != "")], axis=0)
        lengths = np.unique([(bar.length, bar.u) for bar in self.bars()], axis=0).reshape(-1, 2)
        each = {"seat": _fingerprints(places), "bar": _fingerprints(lengths)}
        return tuple(f"{what}-{of_it}" for what, found in each.items() for of_it in found)

    @cached_property
    def _nearest(self) -> Array:
        """Largest difference of each record's readings, but for whole turns, from the nearest's (n,), infinite where far."""
        within = np.mod(np.mod(self.q, 2 * np.pi), 2 * np.pi)  # of what is below zero by next to nothing the first gives 2π
        tree = scipy.spatial.KDTree(within, boxsize=2 * np.pi)
        return np.asarray(tree.query(within, 2, p=np.inf, distance_upper_bound=2.0 * REPEATED)[0][:, 1])

    @cached_property
    def postures(self) -> Index:
        """Number of the posture of each record (n,), from 0 in the order of their first records.

        A record within :data:`REPEATED` of a posture's first record repeats it.
        """
        tree = scipy.spatial.KDTree(self.q)
        found = np.full(self.n, -1, dtype=np.intp)
        number = 0
        for k, alone in enumerate((self._nearest > REPEATED).tolist()):
            if found[k] < 0:
                near = np.array([k]) if alone else np.asarray(tree.query_ball_point(self.q[k], REPEATED, p=np.inf))
                found[near[found[near] < 0]] = number
                number += 1
        return found

    def means_of_contacts(self) -> tuple[Measurements, Index]:
        """One record of each contact, with the mean of its readings, for these share its error; and the records that are one
        of several readings.

        Records that follow one another in one posture, with the same reference, labels and directions of approach, and the
        same of what else has a few values, such as a load, are readings of one contact, which was held. All but the angles
        is that of its first record.
        """
        few = [name for name in self.extra if self.extra[name].nunique() <= MOST_VALUES]
        columns = [*COPIED, "session", "operator", *named(names.APPROACH, self.nq), *few]
        same = _numbered(self.to_frame().reindex(columns=columns).assign(posture=self.postures))
        contact = np.cumsum(np.diff(same, prepend=-1) != 0) - 1
        _, first, number, count = np.unique(contact, return_index=True, return_inverse=True, return_counts=True)
        if count.max(initial=1) == 1:
            return self, np.zeros(0, dtype=np.intp)
        means = pd.DataFrame(self.q).groupby(number).mean().to_numpy()
        return replace(self.take(first), q=means), np.flatnonzero(count[number] > 1)

    def seats(self) -> dict[str, Index]:
        """The records of each seat, by its label, in the order of their first records."""
        seat = self.conditions.seat
        if seat is None:
            return {}
        records = pd.Series(np.arange(self.n)).groupby(seat).indices
        return {label: np.asarray(records[label], dtype=np.intp) for label in dict.fromkeys(seat) if label}

    def bars(self) -> list[Bar]:
        """The bars that have records of both ends, in the order of their first records."""
        seat = self.conditions.seat
        if self.bar is None or self.bar_end is None or self.bar_length is None or seat is None:
            return []
        seat_at: dict[tuple[str, str], str] = {}
        length: dict[str, float] = {}
        u: dict[str, float] = {}
        known = np.full(self.n, np.nan) if self.bar_length_u is None else self.bar_length_u
        for bar, end, label, metres, of_it in zip(self.bar, self.bar_end, seat, self.bar_length, known, strict=True):
            if bar:
                seat_at.setdefault((bar, end), label)
                length.setdefault(bar, float(metres))
                u[bar] = float(np.fmax(u.get(bar, np.nan), of_it))
        both = [bar for bar in length if (bar, "A") in seat_at and (bar, "B") in seat_at]
        return [Bar(bar, seat_at[bar, "A"], seat_at[bar, "B"], length[bar], u[bar]) for bar in both]

    def bar_length_errors(self, tips: Array) -> Array:
        """Distance of the mean tips (n, 3) [m] at both ends of each bar, minus its length: (b,) [m]."""
        seat, errors = np.asarray(self.conditions.seat), []
        for bar in self.bars():
            a, b = (tips[seat == label].mean(axis=0) for label in (bar.seat_a, bar.seat_b))
            errors.append(float(np.linalg.norm(a - b)) - bar.length)
        return np.array(errors)

    def to_frame(self, angle_unit: names.AngleUnit = "deg") -> pd.DataFrame:
        """The columns of a measurement file, those that are present, unknown ones last.

        Raises:
            UnknownNameError: ``angle_unit`` is neither ``deg`` nor ``rad``.
        """
        if angle_unit not in names.THETA:
            raise UnknownNameError("angle unit", angle_unit, list(names.THETA))
        angles = self.q.T / (DEG if angle_unit == "deg" else 1.0)
        columns = dict(zip(named(names.THETA[angle_unit], self.nq), angles, strict=True))
        stated = np.isfinite(self.reference_u).any()
        left_out = {"reference": not (stated or self.known.any()), "reference_u": not stated}
        for attribute, (form, unit) in names.FIELDS.items():
            values = getattr(self.conditions if attribute in COLUMNS else self, attribute)
            if values is None or left_out.get(attribute):
                continue
            if values.dtype != object:
                values = (values / unit).astype(np.int64 if attribute == "approach" else np.float64)
            texts = named(form[0], values.shape[1]) if "#" in form[0] else form
            columns |= dict(zip(texts, np.atleast_2d(values.T), strict=True))
        return pd.concat([pd.DataFrame(columns), self.extra], axis=1)

    def csv(self) -> str:
        """The text of a CSV file from which :meth:`read` gives the same numbers back.

        Angles are in degrees, or in radians where :meth:`read` would take the degrees for radians.
        """
        table = self.to_frame("rad" if names.looks_like_radians(self.q / DEG) else "deg")
        dates = table.select_dtypes(["datetime", "datetimetz", "timedelta"])
        table[dates.columns] = dates.astype("string")  # without the hour where all are of midnight
        texts = table.select_dtypes(exclude="number")
        # A lone carriage return ends a line for readers, but is no reason to quote for the writer.
        returns = any(texts[name].astype(str).str.contains("\r", regex=False, na=False).any() for name in texts)
        quoting: Literal[0, 2] = csv.QUOTE_NONNUMERIC if returns else csv.QUOTE_MINIMAL
        return csv_text(table, quoting)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write the file of :meth:`csv`, whole or not at all.

        Raises:
            OutputError: ``path`` exists and ``force`` is not given, or it cannot be written.
        """
        from aacmm_pin._support.output_files import whole_file

        with whole_file(path, force) as temporary:
            temporary.write_text(self.csv(), encoding="utf-8", newline="")

    def __str__(self) -> str:
        unknown = f", unknown columns {', '.join(self.extra.columns)}" if len(self.extra.columns) else ""
        return (
            f"{self.source}: {self.n} records of {self.nq} joints, {self.known.sum()} with reference, "
            f"{len(self.seats())} seats, {len(self.bars())} bars{unknown}"
        )


# --- copies


def _numbered(table: pd.DataFrame) -> Index:
    """A number (n,) that rows share which are alike."""
    return np.asarray(table.groupby(list(table.columns), sort=False, dropna=False).ngroup(), dtype=np.intp)


def _joined(same: Index, but_for_these: Index, values: Array) -> Index:
    """The numbers ``same`` (n,), those of rows of values (n, k) as of the rows of whole numbers that they are rounded to.

    A half is rounded up by some programs, to the even number or down by others.
    """
    whole = (np.abs(values - np.rint(values)) < EXACT).all(axis=1)
    rounded = {(but_for_these[k], *np.rint(values[k])): same[k] for k in np.flatnonzero(whole)}
    others = np.bincount(but_for_these)[but_for_these] > 1
    joined: dict[int, int] = {}
    for k in np.flatnonzero(~whole & others & np.isfinite(values).all(axis=1) & bool(rounded)):
        for near in product(*(sorted({math.floor(m + 0.5 - EXACT), math.floor(m + 0.5 + EXACT)}) for m in values[k])):
            if (but_for_these[k], *near) in rounded:
                joined[same[k]] = rounded[but_for_these[k], *near]
    return np.array([joined.get(number, number) for number in same], dtype=np.intp)


# --- from a table


GivenRecords = Measurements | str | Path
"""Records, or the path of their file."""


def as_measurements(given: object, nq: int) -> Measurements:
    """Records themselves, or those of a file by :meth:`Measurements.read`, of an arm with ``nq`` joints.

    Raises:
        MeasurementFileError: see :meth:`Measurements.read`.
        AacmmError: it is something else.
    """
    if isinstance(given, Measurements):
        return given
    if isinstance(given, str | Path):
        return Measurements.read(given, nq)
    raise AacmmError(f"measurements is of type {type(given).__name__}, expected Measurements, or the path of a file")


def _from_table(table: pd.DataFrame, lines: Index, nq: int | None, source: str) -> Measurements:
    read_as: tuple[str, ...] = ()
    if "test" in table:
        from aacmm_pin.measurements.acceptance_columns import as_records

        table, read_as = as_records(table, lines, source)
    columns = checked_columns(table, lines, nq, source)
    found: dict[str, Any] = {attribute: columns.field(attribute) for attribute in names.FIELDS}
    conditions = Conditions(columns.n, **{name: found.pop(name) for name in COLUMNS})
    for name, of_form in (("reference", names.REFERENCE), ("reference_u", names.REFERENCE_U)):
        found[name] = columns.block(of_form) * MM
    if (turned := _unit(found.pop("orientation"))) is not None:
        found["orientation"] = turned
        u = columns.numbers.get(names.ORIENTATION_U, np.zeros(1))
        if (most := np.nan_to_num(u).max()) > plausible.USUAL_TURN_NOISE:
            read_as += (f"{names.ORIENTATION_U} is {most:g} rad at most, which is {most / DEG:.3g}°: is it in degrees?",)
    else:
        del found["orientation_u"]
    q = columns.block(columns.header.theta) * (DEG if columns.header.unit == "deg" else 1.0)
    if columns.header.unit == "deg" and names.mostly_like_radians(q / DEG):
        read_as += (
            f"most angles lie within ±{2 * np.pi:.4g}° of zero; are they in radians? Then name the columns theta1_rad …",
        )
    for name in ("seat", "marker", "bar", "session"):
        labels = getattr(conditions, name, found.get(name))
        if pairs := names.alike([] if labels is None else dict.fromkeys(labels.tolist())):
            read_as += (f"labels in the column {name} that are nearly the same count as different ones: {', '.join(pairs)}",)
    extra = table[list(columns.header.extra)].reset_index(drop=True)
    return Measurements(q=q, conditions=conditions, extra=extra, row=lines, source=source, read_as=read_as, **found)


def _unit(quaternions: Array | None) -> Array | None:
    """With the norm of one, which those of a file have but for rounding; None where none is stated."""
    if quaternions is None or np.isnan(quaternions).all():
        return None
    return np.asarray(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))


# --- from arrays


def _checked(name: str, values: ArrayLike | None, n: int) -> Any:
    """What is given for an attribute, as an array of its own; numbers that are not known are NaN where they may be.

    Raises:
        ShapeError: another shape, or numbers or labels that cannot be.
    """
    if values is None:
        return None
    if name in names.LABELS:
        return labels_of(name, values, n)
    if name in ("reference", "reference_u", "orientation"):
        width, unit = (4, "1") if name == "orientation" else (3, "m")
        array = _with_gaps(values, lambda filled: batch(filled, width, name, unit))
        partly = np.flatnonzero(np.isnan(array).any(axis=1) & ~np.isnan(array).all(axis=1))
        if partly.size:
            raise ShapeError(f"{name}[{partly[0]}] is {array[partly[0]]}, expected numbers, or NaN for all where not known")
    else:
        array = _with_gaps(values, lambda filled: vector(filled, n, name, "rad" if name == "orientation_u" else "m"))
    if len(array) != n:
        raise ShapeError(f"{name} has {len(array)} rows, expected {n}: one a record")
    if name in names.PLAUSIBLE:
        range_ = names.PLAUSIBLE[name]
        range_.check(np.where(np.isnan(array), range_.most, array), name, ShapeError)
    if name in ("reference_u", "bar_length_u", "orientation_u") and (array == 0.0).any():
        raise ShapeError(f"{name} holds numbers that are not above zero")
    if name == "orientation":
        norm = np.linalg.norm(array, axis=1)
        if (np.abs(norm - 1.0) > names.NOT_ROUNDING).any():
            raise ShapeError(
                f"orientation has norms of {np.nanmin(norm):g} to {np.nanmax(norm):g}, expected unit quaternions"
            )
        return _unit(array)
    return array


def _with_gaps(values: ArrayLike, check: Callable[[ArrayLike], Array]) -> Array:
    """``values`` after a ``check`` for which NaN counts as a number; masks stay what they are and do not pass it."""
    if isinstance(values, np.ma.MaskedArray):
        return check(values)
    unknown = pd.isna(values if isinstance(values, np.ndarray) else np.asarray(values, dtype=object))
    array = check(np.where(unknown, 0.0, values) if np.any(unknown) else values)
    array[unknown] = np.nan
    return array


def _fingerprints(rows: Array) -> tuple[str, ...]:
    numbers = np.nan_to_num(np.rint(rows / FINGERPRINT_STEP), nan=UNKNOWN).astype("<i8")
    return tuple(hashlib.sha256(row.tobytes()).hexdigest()[:FINGERPRINT_DIGITS] for row in numbers)
