"""Structure that no cause explains: smooth functions of recorded quantities."""

from __future__ import annotations

import itertools
import json
import re
import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin._support.plausible import expected_words
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, DiscrepancyEntry, DiscrepancyPart, axis
from aacmm_pin.effects.conditions import CONDITION_ENTRIES, Conditions
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis, tubes, twist
from aacmm_pin.effects.environment import growth_of_body
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

MOST_KNOTS = 50
"""Quantiles between which the rank of a value is interpolated, at most."""
MOST_FUNCTIONS = 100
"""Functions of one kind in a file; ``diagnose`` uses 25 at most."""

RECORDED = ("time", "temperature")
_JOINT = r"joint [1-9]\d{0,2}"
OfJoint = Annotated[str, Field(pattern=f"^{_JOINT}$")]
OfRecorded = Annotated[str, Field(pattern=f"^({'|'.join([_JOINT, *RECORDED])})$")]
Point = tuple[float, float, float]


class _Strict:
    """Functions of an arm file, which may have no other keys."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class Cosines(_Strict):
    """The functions ``cos kπp`` for k from 0 to ``count``, with the rank p of a value.

    p is the share of the fitted records with a smaller value, interpolated between knots and
    constant outside their range.

    Attributes:
        of: ``joint 2``, ``time`` or ``temperature``.
        at_si: values at the knots in ascending order [rad, m for a prismatic joint, s, °C].
        below: number of fitted records below each knot, plus half of those at the knot.
        records: number of fitted records.
        count: largest k.
    """

    kind: Literal["cosines"] = field(default="cosines", kw_only=True)
    of: OfRecorded
    at_si: tuple[float, ...]
    below: tuple[float, ...]
    records: Annotated[int, Field(ge=1)]
    count: Annotated[int, Field(ge=0, le=MOST_FUNCTIONS)]

    def __post_init__(self) -> None:
        if not len(self.at_si) == len(self.below) >= 1 or np.any(np.diff(self.at_si) <= 0.0):
            raise AacmmError(
                f"cosines of {self.of}: at_si does not ascend, or below has another length; "
                "expected ascending at_si, and as many numbers in below"
            )

    @staticmethod
    def over(of: str, values: ArrayLike, count: int) -> Cosines:
        """The cosines over the ranks of ``values`` ``(n,)``."""
        numbers = np.asarray(values, dtype=np.float64)
        knots, times = np.unique(numbers, return_counts=True)
        below = np.cumsum(times) - 0.5 * times
        if knots.size > MOST_KNOTS:
            evenly_spaced = np.linspace(below[0], below[-1], MOST_KNOTS)
            chosen = np.unique(np.searchsorted(below, evenly_spaced))
            knots = knots[chosen]
            below = below[chosen]
        return Cosines(of, tuple(knots.tolist()), tuple(below.tolist()), numbers.size, count)

    def of_values(self, values: ArrayLike) -> Array:
        """The functions of ``values`` ``(n,)``: ``(n, count + 1)``."""
        numbers = np.asarray(values, dtype=np.float64)
        rank = np.interp(numbers, self.at_si, self.below) / self.records
        frequency = np.pi * np.arange(self.count + 1)
        return np.cos(frequency * rank[:, None])

    def values(self, state: State) -> Array:
        """The functions in the records, ``(n, count + 1)``."""
        return self.of_values(_quantity(self.of, state))


@dataclass(frozen=True)
class Waves(_Strict):
    """The functions ``cos kq`` and ``sin kq`` of one joint, perhaps after the constant 1.

    Attributes:
        of: ``joint 2``.
        constant: whether the constant is included.
        order: k.
        less: what to subtract from the cosine and the sine.
    """

    kind: Literal["waves"] = field(default="waves", kw_only=True)
    of: OfJoint
    constant: bool = False
    order: Annotated[int, Field(ge=1, le=MOST_FUNCTIONS)] = 1
    less: tuple[float, float] = (0.0, 0.0)

    @staticmethod
    def about_mean(of: str, state: State) -> Waves:
        """The first order, less its mean in the records."""
        cosine, sine = Waves(of).values(state).mean(axis=0).tolist()
        return Waves(of, less=(cosine, sine))

    def values(self, state: State) -> Array:
        """The functions in the records, ``(n, 2 or 3)``."""
        angle = self.order * _quantity(self.of, state)
        constant = [np.ones_like(angle)] if self.constant else []
        of_cosine, of_sine = self.less
        return np.stack([*constant, np.cos(angle) - of_cosine, np.sin(angle) - of_sine], axis=1)


@dataclass(frozen=True)
class Moment(_Strict):
    """The moment of the weights about the axis of a joint, less a first-order wave of its angle.

    Attributes:
        of: ``joint 2``.
        less_nm: constant, and factors of ``cos q`` and ``sin q``, to subtract [N·m].
    """

    kind: Literal["moment"] = field(default="moment", kw_only=True)
    of: OfJoint
    less_nm: Point = (0.0, 0.0, 0.0)

    @staticmethod
    def beyond_own_angle(of: str, state: State) -> Moment:
        """The part of the moment that no first-order wave of the angle explains (least squares)."""
        moment = Moment(of).values(state)[:, 0]
        first_order = Waves(of, constant=True).values(state)
        (c0, c1, c2), *_ = np.linalg.lstsq(first_order, moment, rcond=None)
        return Moment(of, (float(c0), float(c1), float(c2)))

    def values(self, state: State) -> Array:
        """The moment in the records, ``(n, 1)`` [N·m].

        Raises:
            UnsupportedArmError: the arm has no masses.
        """
        row = _row_of(self.of)
        moment = state.along_axis(row, state.moment_at_axis(row))
        less = Waves(self.of, constant=True).values(state) @ self.less_nm
        return (moment - less)[:, None]


@dataclass(frozen=True)
class Bumps(_Strict):
    """The functions ``exp(-½ (r / width)²)`` of the distance r of the tip from points.

    Attributes:
        centres_si: points in the base [m].
        width_si: width [m].
    """

    kind: Literal["bumps"] = field(default="bumps", kw_only=True)
    centres_si: Annotated[tuple[Point, ...], Field(min_length=1, max_length=MOST_FUNCTIONS)]
    width_si: Annotated[float, Field(gt=0.0)]
    of: ClassVar[str] = "place"

    def values(self, state: State) -> Array:
        """The functions in the records, ``(n, centres)``."""
        tip = state.origin[state.arm.chain.tip]
        distance = np.linalg.norm(tip[:, None] - np.array(self.centres_si), axis=2)
        squares = np.square(distance / self.width_si)
        return np.asarray(np.exp(-0.5 * squares))


Smooth = Cosines | Waves | Moment | Bumps
_ENTRY: TypeAdapter[Smooth] = TypeAdapter(Annotated[Smooth, Field(discriminator="kind")])


def product_of(functions: Sequence[Smooth], state: State) -> Array:
    """All products of one function of each set, ``(n, m)``, the last varying fastest; 1 without
    sets.
    """
    products = np.ones((state.n, 1))
    for one_set in functions:
        values = one_set.values(state)
        pairs = np.einsum("na,nb->nab", products, values)
        products = pairs.reshape(state.n, products.shape[1] * values.shape[1])
    return products


def functions_of_entry(entry: dict[str, Any]) -> Smooth:
    """The functions of an entry of a file.

    Raises:
        AacmmError: the entry is invalid.
    """
    try:
        return _ENTRY.validate_json(json.dumps(entry, default=str), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"][1:]))
        came = f"{key + ': ' if key else ''}{reprlib.repr(first['input'])}"
        raise AacmmError(f"functions: {came}; expected {expected_words(first)}") from None


def _quantity(of: str, state: State) -> Array:
    """The recorded quantity (n,) [rad, m, s, °C].

    Raises:
        MissingConditionError: the records lack it.
        AacmmError: the arm has no such joint.
    """
    if of.startswith("joint "):
        return state.angle(_row_of(of))
    return state.conditions.require(of, f"the discrepancy that depends on {of}")


def _row_of(joint: str) -> int:
    return int(joint.removeprefix("joint "))


OF_ROW = r"(before|angle|slide|tube) [1-9]\d{0,2}"
CARRIERS = re.compile(f"room|frame|target|lengths|tubes|{OF_ROW}")
"""Names of :class:`Carrier`."""
OF_TIP = dict.fromkeys(("x_mm", "y_mm", "z_mm"), MM)
TURNS = dict.fromkeys(("turn_x_urad", "turn_y_urad", "turn_z_urad"), 1e-6)
GROWTH = {"growth_um_per_m": 1e-6}


class Kind(NamedTuple):
    """A kind of carriers; ``{row}`` stands for the row.

    Attributes:
        quantities: changed quantities with unit, and their size in SI.
        typical: typical magnitude of a coefficient [unit].
    """

    code: str
    quantities: dict[str, float]
    unit: str
    typical: float


CARRIER_KINDS = {
    "room": Kind("tip_shifts_in_room", OF_TIP, "m", 2e-5),
    "frame": Kind("frame_moves", OF_TIP | TURNS, "m", 2e-5),
    "target": Kind("target_elsewhere", OF_TIP, "m", 1e-3),
    "before": Kind("tip_shifts_before_joint", OF_TIP, "m", 2e-5),
    "angle": Kind("joint_angle_off", {"delta{row}_urad": 1e-6}, "rad", 4e-5),
    "slide": Kind("joint_position_off", {"delta{row}_um": 1e-6}, "m", 2e-5),
    "lengths": Kind("lengths_grow", GROWTH, "1", 2e-5),
    "tubes": Kind("tubes_grow", GROWTH, "1", 2e-5),
    "tube": Kind("tube_grows", GROWTH, "1", 2e-5),
}


@dataclass(frozen=True)
class Carrier:
    """The quantity that the functions of a discrepancy change.

    Attributes:
        name: one of these:

    - ``room``: translation of the tip along the axes of the base.
    - ``frame``: the same, and rotation about them; for a rotation, a coefficient in m counts as
      rad.
    - ``target``: translation of the tip along the axes of the last body.
    - ``before j``: translation of the tip along the axes of the body before row j.
    - ``angle j``, ``slide j``: angle or position of joint j.
    - ``lengths``: distance of the tip from the base.
    - ``tubes``, ``tube j``: length of all tubes, or of the body of row j.
    """

    name: str

    def __post_init__(self) -> None:
        if not CARRIERS.fullmatch(self.name):
            raise AacmmError(
                f"acts_on is {self.name!r}; expected room, frame, target, lengths, tubes, or one "
                "of before, angle, slide, tube with the number of a row"
            )

    @property
    def what(self) -> str:
        """The name without the row."""
        return self.name.partition(" ")[0]

    @property
    def kind(self) -> Kind:
        """What carriers of the same name without row have in common."""
        return CARRIER_KINDS[self.what]

    @property
    def row(self) -> int:
        """The row of the joint; only for carriers with a row."""
        return int(self.name.partition(" ")[2])

    @property
    def in_words(self) -> str:
        """The changed quantity as text."""
        _, _, row = self.name.partition(" ")
        return str(Note(self.kind.code, {"row": row}))

    @property
    def quantities(self) -> dict[str, float]:
        """The names of the changed quantities, with their units in SI."""
        _, _, row = self.name.partition(" ")
        return {name.format(row=row): unit for name, unit in self.kind.quantities.items()}

    def displacements(self, state: State, shifts: Array) -> list[Displacement]:
        """The displacements of the places that move, by ``shifts`` along the axes of the carrier
        ``(n, axes, p)`` [m, rad, m/m per unit].
        """
        place = BASE
        match self.what:
            case "angle" | "slide":
                return [about_axis(state, self.row, shifts[:, 0])]
            case "tube":
                return growth_of_body(state, state.known_row(self.row), shifts[:, 0])
            case "tubes":
                grown = [growth_of_body(state, row, shifts[:, 0]) for row in tubes(state.arm)]
                return [*itertools.chain.from_iterable(grown)]
            case "frame":
                return [Displacement(BASE, shifts)]
            case "lengths":
                shifts = state.position[:, :, None] * shifts
            case "before":
                place = axis(state.known_row(self.row)) - 1
            case "target":
                place = state.arm.chain.tip
        return [Displacement(place, twist(shifts))]


@dataclass(frozen=True)
class Discrepancy(Effect):
    """The discrepancy: structure that no cause explains, as smooth functions of recorded
    quantities.

    ``diagnose`` does not try it as a cause; a calibration or diagnosis keeps that of the arm file
    unchanged. Outside the range of the fitted records, functions of time, temperature and ranks
    keep their last values.

    Attributes:
        covariate: what the discrepancy depends on, such as ``joint 2 × joint 4``.
        carrier: the changed quantity.
        functions: sets of functions; the parameters are the coefficients of their products on each
            axis of the carrier. () for the constant 1.
        size: number of parameters.
    """

    covariate: str
    carrier: Carrier
    functions: tuple[Smooth, ...] = field(repr=False)
    size: int
    cause = "discrepancy"

    @property
    def label(self) -> str:
        """The covariate and the changed quantity."""
        return f"{self.cause}:{self.covariate} on {self.carrier.name}"

    @property
    def needs(self) -> tuple[str, ...]:
        """The conditions on which the functions depend."""
        names = dict.fromkeys(functions.of for functions in self.functions)
        return tuple(name for name in names if name in RECORDED)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The coefficients."""
        kind = self.carrier.kind
        names = [f"c{k}" for k in range(1, self.size + 1)]
        return tuple(Term(name, kind.unit, kind.typical, name) for name in names)

    @property
    def details(self) -> list[str]:
        """The covariate and the changed quantity as text."""
        return [f"over {self.covariate}", self.carrier.in_words]

    def displacements(self, state: State) -> list[Displacement]:
        """The functions along the axes of the carrier.

        Raises:
            AacmmError: the number of parameters is not that of the functions and axes.
        """
        functions = product_of(self.functions, state)
        axes = np.eye(len(self.carrier.quantities))
        coefficients = functions.shape[1] * len(axes)
        if coefficients != self.size:
            came = f"{self.label}: {self.size} values"
            raise AacmmError(f"{came}; expected {coefficients}, one for each function and axis")
        shifts = np.einsum("nf,ab->nafb", functions, axes)
        return self.carrier.displacements(state, shifts.reshape(state.n, len(axes), self.size))

    def filed(self) -> DiscrepancyEntry:
        """The entry of the discrepancy in an arm file."""
        functions = [*map(_ENTRY.dump_python, self.functions)]
        return DiscrepancyEntry(
            depends_on=self.covariate,
            parts=[DiscrepancyPart(acts_on=self.carrier.name, functions=functions)],
            values_si=self.values,
            standard_uncertainty_si=self.u if any(self.u) else (),
        )

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """Notes on records outside the fitted range of time or temperature."""
        notes = []
        for functions in self.functions:
            if not (isinstance(functions, Cosines) and functions.of in RECORDED):
                continue
            values = conditions.require(functions.of, self.label)
            low, high = functions.at_si[0], functions.at_si[-1]
            data = {
                "records": int(np.sum((values < low) | (values > high))),
                "of": conditions.n,
                "cause": self.label,
                "condition": functions.of,
                "unit": CONDITION_ENTRIES[functions.of].unit,
                "low": float(low),
                "high": float(high),
            }
            if data["records"]:
                notes.append(Note("outside_fitted_range", data))
        return notes


def discrepancy_of(entry: DiscrepancyEntry) -> Discrepancy:
    """The discrepancy of an entry in an arm file.

    Raises:
        AacmmError: the functions or the carrier are invalid.
    """
    (part,) = entry.parts
    functions = tuple(map(functions_of_entry, part.functions))
    values = entry.values_si
    return Discrepancy(
        entry.depends_on,
        Carrier(part.acts_on),
        functions,
        len(values),
        values=values,
        u=entry.standard_uncertainty_si,
    )
