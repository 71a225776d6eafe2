"""Conditions of records, such as time, temperature, torque and labels."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support.arrays import (
    RANGES,
    Array,
    Index,
    Mask,
    batch,
    is_no_unit,
    vector,
    width_of,
)
from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.plausible import Range
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.errors import MissingConditionError, ShapeError

Labels = NDArray[np.object_]
"""(n,) of str; "" if a record has none."""
Covariate = Literal["anywhere", "joints", "groups", "none"]
"""Effects that residuals are compared with; see :class:`Column`."""

SI_OF_UNIT = {"mm": MM, "°": DEG}
NUMBER_IN_NAME = "(0|[1-9][0-9]*)"
"""Numbers in place of #."""


@dataclass(frozen=True)
class Column:
    """Columns of one quantity or label.

    Attributes:
        field: attribute of measurements, conditions or probed points; "" for
            :attr:`aacmm_pin.Measurements.extra`.
        names: one for each component; # stands for the numbers 1, 2, … of joints (temperatures: DH
            rows).
        covariate: what residuals are compared with: ``anywhere``: translations of the tip,
            rotations of joints, lengths; ``joints``: all but lengths; ``groups``: exclusion of
            records with one label; ``none``. Excluded records are compared with all but ``none``.
        unit: of the file; "" for labels.
        range: possible numbers in SI; None for any.
        may_be_empty: whether a number may be missing; a label always may.
        above_zero: whether zero is invalid.
        of_reference: whether it describes the reference, not where the readings put the tip.
        usual: value in planned and simulated records if a cause needs it; None if they compute it.
    """

    field: str
    names: tuple[str, ...]
    covariate: Covariate
    unit: str = ""
    range: Range | None = None
    may_be_empty: bool = False
    above_zero: bool = False
    of_reference: bool = False
    usual: float | None = None

    @property
    def is_label(self) -> bool:
        """Whether cells are text."""
        return not self.unit

    @property
    def is_numbered(self) -> bool:
        """Whether each joint or row has one."""
        return "#" in self.names[0]

    @property
    def is_direction(self) -> bool:
        """Whether they form a unit vector or quaternion."""
        return self.unit == "1" and len(self.names) > 1

    @property
    def si(self) -> float:
        """One unit of the file in SI."""
        return SI_OF_UNIT.get(self.unit, 1.0)

    @property
    def range_in_file(self) -> Range | None:
        """In the unit of the file."""
        if self.range is None or self.si == 1.0:
            return self.range
        return self.range.of_unit(self.unit, self.si)

    def has(self, name: str) -> bool:
        """Whether ``name`` is one of its columns."""
        if self.is_numbered:
            return number_in(name, self.names[0]) is not None
        return name in self.names

    def among(self, names: Collection[str]) -> list[str]:
        """Its columns among ``names``, in order."""
        if self.is_numbered:
            return sorted(filter(self.has, names), key=lambda name: (len(name), name))
        return [name for name in self.names if name in names]

    def quantity(self, name: str) -> str:
        """The quantity of a column, such as ``torque 2``; else its name."""
        if not self.field:
            return name
        number = number_in(name, self.names[0]) if self.is_numbered else None
        return f"{self.field} {number}" if number else self.field


def number_in(name: str, form: str) -> str | None:
    """The number in a name of this form, as text: Python refuses thousands of digits."""
    match = re.fullmatch(form.replace("#", NUMBER_IN_NAME), name)
    return match[1] if match else None


def condition(
    names: tuple[str, ...],
    covariate: Covariate,
    unit: str = "",
    range: Range | None = None,
    **more: Any,
) -> Any:
    """An attribute of :class:`Conditions`, unknown by default, with its :class:`Column`."""
    column = {"names": names, "covariate": covariate, "unit": unit, **more}
    column |= {"range": range or RANGES.get(unit), "may_be_empty": len(names) > 1}
    return field(default=None, metadata=column)


COLD_WORKSHOP, HOT_WORKSHOP = 5.0, 50.0
"""Usual temperatures of records are between these [°C]; 50 °F are 10 °C."""
TEMPERATURE_TOLERANCE = 2.0
"""A difference that changes a metre by 0.02 to 0.05 mm [K]."""
MOUNT_TILT = Range(-np.pi, np.pi, "rad")
"""Tilt of a mount; half a turn if the arm hangs [rad]."""
LONGEST_ON = 30 * 86400.0
"""After this time an arm has settled, or the time counts from another event [s]."""


@dataclass(frozen=True, eq=False)
class Conditions(Shown):
    """The conditions of n records; an unknown condition is None.

    Attributes:
        time: ``(n,)`` [s].
        temperature: of the whole arm ``(n,)`` [°C].
        link_temperature: of each DH row ``(n, rows)`` [°C].
        approach: sign of the last motion of each joint ``(n, nq)``: -1, 0 or 1.
        torque: measured joint torques ``(n, nq)`` [N·m].
        probe_direction: unit vector of the motion of the probe towards the surface, in the base
            ``(n, 3)``; zero if not stated.
        tilt_x: rotation of the mount about x of the base ``(n,)`` [rad]; see
            :meth:`in_tilted_base`.
        tilt_y: the same about y ``(n,)`` [rad].
        seat: label of the seat ``(n,)``; "" for no seat.
        marker: label of the target on the last body ``(n,)``; "" for no label.
        session: label of the session ``(n,)``; "" for no label.

    Raises:
        ShapeError: an array has a wrong shape, or impossible numbers or labels.
    """

    n: int
    time: Array | None = condition(("time_s",), "anywhere", "s")
    temperature: Array | None = condition(("temperature_c",), "anywhere", "°C")
    link_temperature: Array | None = condition(("temperature#_c",), "none", "°C")
    approach: Array | None = condition(("approach#",), "none", "1")
    torque: Array | None = condition(("torque#_nm",), "joints", "N·m")
    probe_direction: Array | None = condition(
        ("probe_direction_x", "probe_direction_y", "probe_direction_z"), "none", "1"
    )
    tilt_x: Array | None = condition(("tilt_x_deg",), "anywhere", "°", range=MOUNT_TILT, usual=0.0)
    tilt_y: Array | None = condition(("tilt_y_deg",), "anywhere", "°", range=MOUNT_TILT, usual=0.0)
    seat: Labels | None = condition(("seat",), "groups", of_reference=True)
    marker: Labels | None = condition(("marker",), "groups")
    session: Labels | None = condition(("session",), "anywhere")

    def __post_init__(self) -> None:
        if self.n < 0:
            raise ShapeError(f"conditions have {self.n} records; expected 0 or more")
        for name in self.present:
            column = CONDITION_ENTRIES[name]
            checked = array_of(column, getattr(self, name), self.n)
            if column.is_direction:
                checked = _unit_vectors(checked, name)
            if column.range is not None:
                column.range.check(checked, name, ShapeError)
            if name == "approach" and not np.isin(checked, (-1.0, 0.0, 1.0)).all():
                raise ShapeError("approach contains other numbers; expected -1, 0 or 1")
            object.__setattr__(self, name, checked)

    def take(self, rows: Index | slice | Mask | Sequence[int]) -> Conditions:
        """The conditions of some of the records."""
        kept = np.arange(self.n)[rows]
        return Conditions(len(kept), **{name: getattr(self, name)[kept] for name in self.present})

    def with_usual(self, needs: Iterable[str], nq: int) -> Conditions:
        """The conditions with the usual values of unknown conditions named in ``needs``."""
        usual: dict[str, Any] = {}
        for name in {*needs}.difference(self.present):
            column = CONDITION_ENTRIES[name]
            if column.usual is not None:
                shape = (self.n, nq) if column.is_numbered else self.n
                usual[name] = np.full(shape, column.usual)
        return replace(self, **usual)

    def in_tilted_base(self, direction: Array) -> Array:
        """A vector of the room, such as gravity, in the tilted base, ``(n, 3)``.

        The rotation vector ``(tilt_x, tilt_y, 0)`` rotates the base from the position for which the
        arm states gravity. A positive ``tilt_x`` lowers the side of -y, a positive ``tilt_y`` that
        of +x.

        Args:
            direction: vector in the base that is not tilted ``(3,)``.
        """
        if self.tilt_x is None and self.tilt_y is None:
            return np.broadcast_to(direction, (self.n, 3))
        from scipy.spatial.transform import Rotation  # takes a while, and few mounts are tilted

        rotation_vectors = np.zeros((self.n, 3))
        for k, angle in enumerate((self.tilt_x, self.tilt_y)):
            if angle is not None:
                rotation_vectors[:, k] = angle
        return np.asarray(Rotation.from_rotvec(rotation_vectors).apply(direction, inverse=True))

    def labels(self, name: str) -> Labels:
        """The ``seat``, ``marker`` or ``session`` of each record, ``(n,)``; "" for no label."""
        labels = getattr(self, name)
        return np.full(self.n, "", dtype=object) if labels is None else labels

    @cached_property
    def times(self) -> Array:
        """The different times in ascending order [s]; empty if the time is unknown."""
        return np.zeros(0) if self.time is None else np.unique(self.time)

    @property
    def present(self) -> tuple[str, ...]:
        """The names of the known conditions."""
        return tuple(name for name in CONDITION_ENTRIES if getattr(self, name) is not None)

    def temperature_notes(self, reference: float, *, are_used: bool) -> list[Note]:
        """A note on temperatures that are implausible in a workshop, if a model uses them; else on
        temperatures that differ from the ``reference`` temperature of the lengths [°C].
        """
        arrays = [v for v in (self.temperature, self.link_temperature) if v is not None]
        values = np.concatenate([np.zeros(0), *map(np.ravel, arrays)])
        if not values.size:
            return []
        least = float(values.min())
        most = float(values.max())
        if are_used:
            codes = {
                "temperatures_high": least > HOT_WORKSHOP,
                "temperatures_low": most < COLD_WORKSHOP,
            }
        else:
            difference = max(reference - least, most - reference)
            codes = {"temperatures_other": difference >= TEMPERATURE_TOLERANCE}
        data = {"least": least, "most": most, "reference": reference}
        return [Note(code, data) for code, applies in codes.items() if applies]

    @property
    def odd_clock(self) -> list[Note]:
        """A note if the times cannot count from switching on."""
        times = self.times
        if not times.size or 0.0 <= times[0] <= LONGEST_ON:
            return []
        return [Note("clock_odd", {"least": float(times[0]), "most": float(times[-1])})]

    def require(self, name: str, purpose: str) -> NDArray:  # type: ignore[type-arg]
        """The condition ``name``, which ``purpose`` needs.

        Raises:
            MissingConditionError: the condition is unknown; the message names the column.
        """
        values = getattr(self, name)
        if values is None:
            raise MissingConditionError(purpose, CONDITION_COLUMNS[name])
        return np.asarray(values)


CONDITION_ENTRIES: dict[str, Column] = {
    attribute.name: Column(attribute.name, **attribute.metadata)
    for attribute in fields(Conditions)
    if attribute.metadata
}
CONDITION_COLUMNS: dict[str, str] = {}
"""The columns of each condition in messages, such as ``approach1 …``."""
for _name, _column in CONDITION_ENTRIES.items():
    _several = _column.is_numbered or len(_column.names) > 1
    CONDITION_COLUMNS[_name] = _column.names[0].replace("#", "1") + " …" * _several


class Records(Protocol):
    """The part of :class:`aacmm_pin.Measurements` in which a cause may find its candidates."""

    @property
    def q(self) -> Array:
        """The joint angles, ``(n, nq)`` [rad]."""

    @property
    def conditions(self) -> Conditions:
        """The conditions of the records."""

    @property
    def known(self) -> Mask:
        """True for records with known coordinates of the tip, ``(n,)``."""


def _unit_vectors(vectors: Array, name: str) -> Array:
    """Vectors (n, 3) with a length near 1, normalised; zeros stay."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (is_no_unit(length) & (length > 0.0)).any():
        came = f"lengths of {length.min():g} to {length.max():g}"
        raise ShapeError(f"{name} has {came}; expected 1, or 0 for records without a direction")
    return vectors / np.where(length > 0.0, length, 1.0)


def array_of(column: Column, values: ArrayLike, n: int) -> NDArray[Any]:
    """The labels or numbers of a column in n records, as a new array.

    Raises:
        ShapeError: the shape is wrong, a number is not finite, or a label is not text.
    """
    name = column.field
    if column.is_label:
        labels = np.array(values, dtype=object)
        if labels.shape != (n,):
            raise ShapeError(f"{name} has shape {labels.shape}; expected ({n},) labels")
        for i, label in enumerate(labels):
            if not isinstance(label, str):
                raise ShapeError(f"{name}[{i}] is {label!r}; expected text, or '' for no label")
        return labels
    unit = column.unit if column.range is None else column.range.unit
    width = width_of(values) if column.is_numbered else len(column.names)
    if not column.is_numbered and width == 1:
        return vector(values, n, name, unit)
    array = batch(values, width, name, unit)
    if len(array) != n:
        raise ShapeError(f"{name} has {len(array)} rows; expected {n}, one for each record")
    return array
