"""Smooth functions of what is recorded, as plain data: they have the same values at new records."""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from aacmm_pin._support.checks import Array
from aacmm_pin._support.plausible import expected_words
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

MOST_KNOTS = 50
"""Between so many quantiles the rank of a value is interpolated; fewer different values have their
own.
"""
MOST_FUNCTIONS = 100
"""Functions of one kind in a file; those that diagnosis looks at are 25 at most."""

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Cosines:
    """The functions ``cos kπp`` for k from 0 to ``count``, with the rank p of a value among the
    fitted records.

    p is the share of the fitted records with a smaller value, interpolated between knots. Outside
    the range of the fitted records, p is that of the nearest record.

    Attributes:
        of: ``joint 2``, ``time`` or ``temperature``.
        at_si: values at the knots in ascending order [rad, m for a prismatic joint, s, °C].
        below: number of fitted records below each knot, plus half of the records at the knot.
        records: number of fitted records.
        count: largest k.
    """

    of: str
    at_si: tuple[float, ...]
    below: tuple[float, ...]
    records: int
    count: int
    kind: Literal["cosines"] = "cosines"
    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    def __post_init__(self) -> None:
        if not len(self.at_si) == len(self.below) >= 1 or np.any(np.diff(self.at_si) <= 0.0):
            raise AacmmError(
                f"cosines of {self.of}: at_si does not ascend, or below has another length; "
                "expected ascending at_si, and as many numbers in below"
            )
        if self.records < 1 or not 0 <= self.count <= MOST_FUNCTIONS:
            raise AacmmError(
                f"cosines of {self.of}: records or count is out of range; expected records above "
                f"0, and a count from 0 to {MOST_FUNCTIONS}"
            )

    @property
    def number(self) -> int:
        """The number of functions."""
        return self.count + 1

    @staticmethod
    def over(of: str, values: ArrayLike, count: int) -> Cosines:
        """Return the cosines over the ranks of ``values`` ``(n,)``."""
        numbers = np.asarray(values, dtype=np.float64)
        at, times = np.unique(numbers, return_counts=True)
        below = np.cumsum(times) - 0.5 * times
        if at.size > MOST_KNOTS:
            evenly = np.linspace(below[0], below[-1], MOST_KNOTS)
            knots = np.unique(np.searchsorted(below, evenly))
            at = at[knots]
            below = below[knots]
        return Cosines(of, tuple(at.tolist()), tuple(below.tolist()), numbers.size, count)

    def of_values(self, values: ArrayLike) -> Array:
        """Return the functions of ``values`` ``(n,)``: ``(n, count + 1)``."""
        numbers = np.asarray(values, dtype=np.float64)
        part = np.interp(numbers, self.at_si, self.below) / self.records
        frequency = np.pi * np.arange(self.count + 1)
        return np.cos(frequency * part[:, None])

    def values(self, state: State) -> Array:
        """Return the functions in the records, ``(n, count + 1)``."""
        return self.of_values(_recorded(self.of, state))


@dataclass(frozen=True)
class Waves:
    """The functions ``cos kq`` and ``sin kq`` of one joint, optionally after the constant 1.

    Attributes:
        of: ``joint 2``.
        constant: whether the constant is included.
        order: order k.
    """

    of: str
    constant: bool = False
    order: int = 1
    kind: Literal["waves"] = "waves"
    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    def __post_init__(self) -> None:
        if not 1 <= self.order <= MOST_FUNCTIONS:
            raise AacmmError(
                f"waves of {self.of}: order is {self.order}; expected 1 to {MOST_FUNCTIONS}"
            )

    @property
    def number(self) -> int:
        """The number of functions."""
        return 2 + self.constant

    def values(self, state: State) -> Array:
        """Return the functions in the records, ``(n, 2 or 3)``."""
        angle = self.order * _recorded(self.of, state)
        constant = [np.ones_like(angle)] if self.constant else []
        return np.stack([*constant, np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True)
class Moment:
    """The moment of the weights about the axis of one joint, from the masses of the arm.

    The function may subtract a first-order wave of the joint angle.

    Attributes:
        of: ``joint 2``.
        less_nm: constant, and factors of ``cos q`` and ``sin q``, to subtract [N·m].
    """

    of: str
    less_nm: Point = (0.0, 0.0, 0.0)
    kind: Literal["moment"] = "moment"
    number: ClassVar[int] = 1
    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    @staticmethod
    def beyond_own_angle(of: str, state: State) -> Moment:
        """Return the part of the moment that a first-order wave of the joint angle does not explain
        (least squares).
        """
        whole = Moment(of).values(state)[:, 0]
        first_order = Waves(of, constant=True).values(state)
        (c0, c1, c2), *_ = np.linalg.lstsq(first_order, whole, rcond=None)
        return Moment(of, (float(c0), float(c1), float(c2)))

    def values(self, state: State) -> Array:
        """Return the moment in the records, ``(n, 1)`` [N·m].

        Raises:
            UnsupportedArmError: the arm has no masses.
        """
        row = _row_of(self.of)
        moment = state.along_axis(row, state.moment_at_axis(row))
        less = Waves(self.of, constant=True).values(state) @ self.less_nm
        return np.asarray((moment - less)[:, None])


@dataclass(frozen=True)
class Bumps:
    """The functions ``exp(-½ (r / width)²)`` with the distance r of the tip from each of several
    points.

    Attributes:
        centres_si: points in the base [m].
        width_si: width [m].
    """

    centres_si: tuple[Point, ...]
    width_si: float
    kind: Literal["bumps"] = "bumps"
    of: ClassVar[str] = "place"
    __pydantic_config__: ClassVar[ConfigDict] = _STRICT

    def __post_init__(self) -> None:
        if not (0 < len(self.centres_si) <= MOST_FUNCTIONS and self.width_si > 0.0):
            raise AacmmError(
                "bumps: centres_si or width_si is out of range; expected 1 to "
                f"{MOST_FUNCTIONS} centres_si, and width_si above 0"
            )

    @property
    def number(self) -> int:
        """The number of functions."""
        return len(self.centres_si)

    def values(self, state: State) -> Array:
        """Return the functions in the records, ``(n, centres)``."""
        tip = state.origin[state.arm.chain.tip]
        distance = np.linalg.norm(tip[:, None] - np.array(self.centres_si), axis=2)
        squares = np.square(distance / self.width_si)
        return np.asarray(np.exp(-0.5 * squares))


Smooth = Cosines | Waves | Moment | Bumps
_FILED: TypeAdapter[Smooth] = TypeAdapter(Annotated[Smooth, Field(discriminator="kind")])

RECORDED = ("time", "temperature")
"""Conditions that functions may be of."""
_JOINT = r"joint [1-9]\d{0,2}"
QUANTITIES_OF_KIND = {
    "cosines": "|".join([_JOINT, *RECORDED]),
    "waves": _JOINT,
    "moment": _JOINT,
    "bumps": "place",
}
"""What functions of each kind may be of."""


def product_of(functions: Sequence[Smooth], state: State) -> Array:
    """Return all products of one function of each set, ``(n, m)``, with the last set varying
    fastest.

    Without sets the result is the constant 1, ``(n, 1)``.
    """
    found = np.ones((state.n, 1))
    for each in functions:
        found = products(found, each.values(state))
    return found


def products(one: Array, other: Array) -> Array:
    """Products of each function (n, a) with each other one (n, b), the other one varying fastest
    (n, a · b).
    """
    each = np.einsum("na,nb->nab", one, other)
    return np.asarray(each.reshape(len(one), one.shape[1] * other.shape[1]))


def needs_of(functions: Iterable[Smooth]) -> tuple[str, ...]:
    """Conditions that the functions are of."""
    every = [each.of for each in functions]
    return tuple(name for name in dict.fromkeys(every) if name in RECORDED)


def as_filed(functions: Smooth) -> dict[str, Any]:
    """The functions as a file has them."""
    fields: dict[str, Any] = _FILED.dump_python(functions)
    return {"kind": functions.kind} | fields


def as_read(filed: dict[str, Any]) -> Smooth:
    """The functions that a file has.

    Raises:
        AacmmError: it has none.
    """
    try:
        found = _FILED.validate_json(json.dumps(filed, default=str), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"][1:]))
        came = f"{key + ': ' if key else ''}{reprlib.repr(first['input'])}"
        raise AacmmError(f"functions: {came}; expected {expected_words(first)}") from None
    if not re.fullmatch(QUANTITIES_OF_KIND[found.kind], found.of):
        raise AacmmError(
            f"functions: {found.kind} of {found.of!r}; expected {QUANTITIES_OF_KIND[found.kind]}"
        )
    return found


def _recorded(of: str, state: State) -> Array:
    """What was recorded (n,) [rad, m, s, °C].

    Raises:
        MissingConditionError: the records lack it.
        AacmmError: the arm has no such joint.
    """
    if of.startswith("joint "):
        return state.angle(_row_of(of))
    return state.conditions.require(of, f"the discrepancy that depends on {of}")


def _row_of(joint: str) -> int:
    """Row of ``joint 2``."""
    return int(joint.removeprefix("joint "))
