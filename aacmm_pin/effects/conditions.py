"""What is known of records beside their angles: when, how warm, from which side, under which
torque, in which direction probed, at which seat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aacmm_pin._support.checks import Array, Index, Mask, batch, is_no_unit, vector, width_of
from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin.errors import MissingConditionError, ShapeError

Labels = NDArray[np.object_]
"""(n,) of str; "" where a record has none."""

CONDITION_COLUMNS = {
    "time": "time_s",
    "temperature": "temperature_c",
    "link_temperature": "temperature1_c …",
    "approach": "approach1 …",
    "torque": "torque1_nm …",
    "probe_direction": "probe_direction_x …",
    "seat": "seat",
    "marker": "marker",
    "session": "session",
}
"""The column of a measurement file behind each condition."""
CONDITION_UNITS = {
    "time": "s",
    "temperature": "°C",
    "link_temperature": "°C",
    "approach": "1",
    "torque": "N·m",
    "probe_direction": "1",
}
"""What the numbers of a condition are."""
COLD_WORKSHOP, HOT_WORKSHOP = 5.0, 50.0
"""No record is taken where it is always colder, or always warmer; 50 °F are 10 °C [°C]."""
TEMPERATURE_TOLERANCE = 2.0
"""So much warmer or colder, a metre is longer or shorter by 0.02 to 0.05 mm [K]."""
LONGEST_ON = 30 * 86400.0
"""An arm that has been on for longer has settled, or time counts from elsewhere [s]."""


@dataclass(frozen=True, eq=False)
class Conditions(Shown):
    """The conditions of n records; an unknown condition is None.

    Attributes:
        n: number of records.
        time: time ``(n,)`` [s].
        temperature: temperature of the whole arm ``(n,)`` [°C].
        link_temperature: temperature of each DH row ``(n, rows)`` [°C].
        approach: sign of the last motion of each joint ``(n, nq)``: -1, 0 or 1.
        torque: measured joint torques ``(n, nq)`` [N·m].
        probe_direction: unit vector of the motion of the probe towards the surface, in the axes of
            the base ``(n, 3)``; zero if not stated.
        seat: label of the seat ``(n,)``; "" for no seat.
        marker: label of the target on the last body ``(n,)``; "" for no label.
        session: label of the session ``(n,)``; "" for no label.

    Raises:
        ShapeError: an array has a wrong shape, or impossible numbers or labels.
    """

    n: int
    time: Array | None = None
    temperature: Array | None = None
    link_temperature: Array | None = None
    approach: Array | None = None
    torque: Array | None = None
    probe_direction: Array | None = None
    seat: Labels | None = None
    marker: Labels | None = None
    session: Labels | None = None

    def __post_init__(self) -> None:
        """What is given, as arrays of its own."""
        if self.n < 0:
            raise ShapeError(f"conditions have {self.n} records; expected 0 or more")
        for name in self.present:
            values = getattr(self, name)
            given: NDArray[Any]
            if name not in CONDITION_UNITS:
                given = labels_of(name, values, self.n)
            elif name in ("time", "temperature"):
                given = vector(values, self.n, name, CONDITION_UNITS[name])
            elif name == "probe_direction":
                given = _directions(values)
            else:
                given = batch(values, width_of(values), name, CONDITION_UNITS[name])
            if len(given) != self.n:
                raise ShapeError(
                    f"{name} has {len(given)} rows; expected {self.n}, one for each record"
                )
            if name == "approach" and not np.isin(given, (-1.0, 0.0, 1.0)).all():
                raise ShapeError("approach contains other numbers; expected -1, 0 or 1")
            object.__setattr__(self, name, given)

    def take(self, rows: Index | slice | Mask | Sequence[int]) -> Conditions:
        """Return the conditions of some of the records, by indices, a slice or a mask."""
        chosen = {}
        for field in fields(self)[1:]:
            values = getattr(self, field.name)
            chosen[field.name] = None if values is None else values[rows]
        count = (
            len(range(self.n)[rows]) if isinstance(rows, slice) else len(np.arange(self.n)[rows])
        )
        return Conditions(count, **chosen)

    @cached_property
    def times(self) -> Array:
        """The different times in ascending order [s]; empty if the time is unknown."""
        if self.time is None:
            return np.zeros(0)
        return np.unique(self.time)

    @property
    def present(self) -> tuple[str, ...]:
        """The names of the known conditions."""
        names = [field.name for field in fields(self)[1:]]
        return tuple(name for name in names if getattr(self, name) is not None)

    def odd_temperatures(self, reference: float) -> list[Note]:
        """Return notes about temperatures that are implausible for a workshop.

        Args:
            reference: reference temperature of the arm [°C].
        """
        found = []
        for values in (self.temperature, self.link_temperature):
            if values is None or not values.size:
                continue
            data = {
                "least": float(values.min()),
                "most": float(values.max()),
                "reference": reference,
            }
            if data["least"] > HOT_WORKSHOP:
                found.append(Note("temperatures_high", data))
            elif data["most"] < COLD_WORKSHOP:
                found.append(Note("temperatures_low", data))
        return found

    def other_temperatures(self, reference: float) -> list[Note]:
        """Return a note if temperatures differ from the reference temperature of the lengths.

        Args:
            reference: reference temperature of the arm [°C].
        """
        values = self.temperature if self.temperature is not None else self.link_temperature
        if (
            values is None
            or not values.size
            or abs(values - reference).max() < TEMPERATURE_TOLERANCE
        ):
            return []
        data = {"least": float(values.min()), "most": float(values.max()), "reference": reference}
        return [Note("temperatures_other", data)]

    @property
    def odd_clock(self) -> list[Note]:
        """A note if the times cannot count from the moment at which the arm was switched on."""
        time = self.time
        if time is None or not time.size or 0.0 <= time.min() <= LONGEST_ON:
            return []
        return [Note("clock_odd", {"least": float(time.min()), "most": float(time.max())})]

    def require(self, name: str, purpose: str) -> NDArray:  # type: ignore[type-arg]
        """Return the condition ``name``.

        Args:
            name: name of the condition.
            purpose: operation that needs the condition, for the error message.

        Raises:
            MissingConditionError: the condition is unknown; the message names the column.
        """
        values = getattr(self, name)
        if values is None:
            raise MissingConditionError(purpose, CONDITION_COLUMNS[name])
        return np.asarray(values)


class Records(Protocol):
    """The part of records that a cause may use to find its candidates;
    :class:`aacmm_pin.Measurements` have this part.
    """

    @property
    def q(self) -> Array:
        """The joint angles, ``(n, nq)`` [rad]."""

    @property
    def conditions(self) -> Conditions:
        """The conditions of the records."""

    @property
    def known(self) -> Mask:
        """True for records with known coordinates of the tip, ``(n,)``."""


def _directions(values: ArrayLike) -> Array:
    """Unit vectors (n, 3) without what rounding did to their lengths; zeros stay.

    Raises:
        ShapeError: another shape, or another length.
    """
    vectors = batch(values, 3, "probe_direction", "1")
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (is_no_unit(length) & (length > 0.0)).any():
        came = f"lengths of {length.min():g} to {length.max():g}"
        raise ShapeError(
            f"probe_direction has {came}; expected 1, or 0 for records without a direction"
        )
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def labels_of(name: str, values: ArrayLike, n: int) -> Labels:
    """Return the labels of n records as a new array.

    Raises:
        ShapeError: the shape is wrong, or a label is not text.
    """
    labels = np.array(values, dtype=object)
    if labels.shape != (n,):
        raise ShapeError(f"{name} has shape {labels.shape}; expected ({n},) labels")
    for i, label in enumerate(labels):
        if not isinstance(label, str):
            raise ShapeError(f"{name}[{i}] is {label!r}; expected text, or '' for no label")
    return labels
