"""What every cause of error is: a small displacement of places of the arm, linear in parameters."""

from __future__ import annotations

import math
import re
import reprlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from numbers import Integral
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.notes import Note
from aacmm_pin._support.plausible import LATEST, MOST_ROWS
from aacmm_pin._support.units import MM, prefixed
from aacmm_pin.arm import Arm, Parameter
from aacmm_pin.arm import axis as axis
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.nonlinear import Nonlinear
from aacmm_pin.effects.state import State
from aacmm_pin.effects.tube import tubes
from aacmm_pin.errors import AacmmError, CauseError, MissingConditionError, UnknownNameError

LOCATION_FIELDS = ("joint", "link", "seat", "marker", "session")
"""Fields that state where a cause sits."""
NUMBERS = ("values", "u", "nonlinear_u")
"""Fields of every cause, which do not state which one it is."""
UNIT_OF_KEY = re.compile(r"_(rad|deg|mm|um|m|s|k|kg|n|nm)?(_?per_\w+)?$")
"""What a key of a file ends with."""


class Reading(NamedTuple):
    """How people read a value of a file: its name, a unit, and how many of these are one of the
    file's.
    """

    name: str
    unit: str
    factor: float


@dataclass(frozen=True)
class Term:
    """One parameter of a cause.

    Attributes:
        name: its name among the parameters of its cause; "" where there is one.
        unit: SI unit.
        typical: typical magnitude on a measuring arm of 1 to 2.5 m [unit].
        key: how files write it, with their unit.
        scale: one of the file's units in SI.
        read_in: the unit in which people read it, and one of it in SI; None for the SI unit with
            the prefix that makes ``typical`` a number of few digits.
        positive: True where nature has it above zero only: a finding that is negative beyond its
            uncertainty explains nothing.
        largest: magnitude beyond which it must be a mistake [unit]; None for a thousand times
            ``typical``.
    """

    name: str
    unit: str
    typical: float
    key: str
    scale: float = 1.0
    read_in: tuple[str, float] | None = None
    positive: bool = False
    largest: float | None = None

    def __post_init__(self) -> None:
        for name in ("typical", "scale"):
            number = getattr(self, name)
            if not (isinstance(number, int | float) and 0.0 < number < math.inf):
                raise AacmmError(
                    f"Term {self.key!r}: {name} is {number!r}; expected a number above 0"
                )

    @property
    def unit_read(self) -> tuple[str, float]:
        """The unit in which people read it, and one of it in SI."""
        return self.read_in or prefixed(self.unit, self.typical)

    @property
    def reading(self) -> Reading:
        """How people read it."""
        unit, size = self.unit_read
        name = UNIT_OF_KEY.sub("", self.key) or self.key
        return Reading(name.replace("_", " "), unit, self.scale / size)


@dataclass(frozen=True, eq=False)
class Displacement:
    """How one place moves per unit of each parameter.

    Attributes:
        place: place of the chain.
        columns: (n, 6, p) or (1, 6, p): v then ω in the axes of the place [m/unit, rad/unit].
    """

    place: int
    columns: Array


class Notation:
    """How files and people write the values of a cause: here each term by its key."""

    def parameters(self, effect: Effect) -> dict[str, float]:
        """The values as a file has them."""
        pairs = zip(effect.terms, effect.values, strict=True)
        return {term.key: value / term.scale for term, value in pairs}

    def jacobian(self, effect: Effect) -> Array:
        """∂(parameters of the file)/∂(values) (parameters, p)."""
        return np.diag([1.0 / term.scale for term in effect.terms])

    def readings(self, effect: Effect) -> dict[str, Reading]:
        """How people read each parameter of the file."""
        return {term.key: term.reading for term in effect.terms}

    def phase_is_free(self, effect: Effect) -> bool:
        """Whether its values stand for their magnitude, in any direction."""
        return False

    def values(self, effect: Effect, parameters: Mapping[str, float]) -> tuple[float, ...]:
        """Values from the parameters of a file; what it leaves out is zero [SI].

        Raises:
            UnknownNameError: a parameter that the cause does not have.
        """
        return values_by_key(effect, parameters, "parameter")


@dataclass(frozen=True, kw_only=True)
class Effect(Shown, ABC):
    """A physical cause of error with the values of its parameters.

    A subclass states its ``cause``, its ``terms``, its :meth:`displacements`, and fields that
    state which one it is: a place (``joint``, ``link``, ``seat`` or ``marker``), an order, …
    The rest has defaults, which a subclass may replace. It may also state ``load``: words for what
    one parameter is multiplied by, on the axis of its picture.

    Attributes:
        values: of the parameters, in the order of ``terms``; () means all zero [SI].
        u: their standard uncertainties; () means zero [SI].
        nonlinear_u: standard uncertainty of the field in :attr:`nonlinear`.
    """

    cause: ClassVar[str]
    """Name of the cause in files and commands."""
    words: ClassVar[str] = ""
    """What people call it; "" for the name of the cause with spaces."""
    elastic: ClassVar[bool] = False
    """True where the displacement depends on where the arm is, and so on other displacements."""
    of_reference: ClassVar[bool] = False
    """True where it is not the arm that is off but the coordinates it is compared with."""
    refitted: ClassVar[bool] = False
    """True for what every calibration fits (geometry, tip, frame): a cause only beyond that."""
    prior_weight: ClassVar[float] = 1.0
    """Weight of its prior probability beside other causes."""
    special_case_of: ClassVar[tuple[str, ...]] = ()
    """Freer causes that can be this one too at its place; the two do not stand beside each other.
    """
    nonlinear: ClassVar[Nonlinear[Any]] = Nonlinear()
    """The field that records determine by trial; the key has its value."""
    notation: ClassVar[Notation] = Notation()
    """How files and people write its values."""

    values: tuple[float, ...] = ()
    u: tuple[float, ...] = ()
    nonlinear_u: float = 0.0

    def __post_init__(self) -> None:
        for name in ("joint", "link"):
            default = getattr(type(self), name, MISSING)
            row = getattr(self, name, default)
            if row is not default and not is_row(row):
                raise AacmmError(
                    f"{self.cause}: {name} is {reprlib.repr(row)}; expected the number of a row, "
                    f"from 1 to at most {MOST_ROWS}"
                )
        count = len(self.terms)
        for name in ("values", "u"):
            numbers = tuple(map(float, getattr(self, name))) or (0.0,) * count
            if len(numbers) != count or not all(map(math.isfinite, numbers)):
                raise AacmmError(
                    f"{self.label}: {name} is {numbers}; expected {count} finite numbers"
                )
            object.__setattr__(self, name, numbers)
        if min(self.u, default=0.0) < 0.0:
            raise AacmmError(f"{self.label}: u is {self.u}; expected 0 or more")
        field = self.nonlinear.field
        above = self.nonlinear.above
        if field and not above < getattr(self, field) <= LATEST:
            expected = f"more than {above:g}, and at most {LATEST:g}"
            raise AacmmError(
                f"{self.label}: {field} is {getattr(self, field)}; expected {expected}"
            )
        if not 0.0 <= self.nonlinear_u <= (LATEST if field else 0.0):
            came = f"{self.label}: u of {field or 'no field'} is {self.nonlinear_u}"
            raise AacmmError(f"{came}; expected a number from 0 to {LATEST:g}")

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]:
        """The parameters."""

    @abstractmethod
    def displacements(self, state: State) -> list[Displacement]:
        """What one unit of each parameter does to which places.

        Raises:
            MissingConditionError: the records lack a condition that the cause depends on.
            UnsupportedArmError: the arm lacks what the cause needs, such as masses.
        """

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """Place and twist (n, 6) at the values, by exact physics; here the linear ones."""
        values = np.array(self.values)
        return [(each.place, each.columns @ values) for each in self.displacements(state)]

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions that it depends on, by their names in :class:`Conditions`."""
        return ()

    @property
    def known_range(self) -> tuple[float, float] | None:
        """Indications of its joint between which it is known [rad]; None for everywhere."""
        return None

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Where the cause could sit: for each place its variants, by the values to try.

        Here the whole arm, if no place need be named; every joint, every tube (a body longer than
        0.15 m), every seat that was touched twice, every target, as the field says; without those
        where :meth:`displacements` raises an :class:`AacmmError`. A class with other fields
        without a default states its own, or has no candidates.

        Args:
            arm: the arm.
            records: as far as they show the cause; None for whatever could be recorded.
        """
        location = cls.location_field()
        nonlinear = cls.nonlinear
        required = {f.name for f in fields(cls) if f.default is MISSING}
        if not required <= {location, nonlinear.field}:
            return
        variants: list[dict[str, Any]] = [{}]
        if nonlinear.field:
            variants = [{nonlinear.field: value} for value in nonlinear.grid(records)]
        places = _places(location, arm, records)
        if location not in required:
            places.insert(0, {})
        for place in places:
            effects = tuple(cls(**place, **variant) for variant in variants)
            if effects and is_possible(effects[0], arm, records):
                yield effects

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """Fields that a person may leave out, by the arm and the conditions in the records."""
        return {}

    @classmethod
    @cache  # asked for thousands of times in a calibration
    def location_field(cls) -> str | None:
        """The field of :data:`LOCATION_FIELDS` that it has; None for the whole arm."""
        return next((name for name in LOCATION_FIELDS if name in fields_of(cls)), None)

    @property
    def place(self) -> int | str | None:
        """Number of the joint or link, or label of the seat or target; None for the whole arm."""
        name = self.location_field()
        return None if name is None else getattr(self, name)

    @property
    def row(self) -> int | None:
        """The DH row it belongs to; None for causes of the whole arm."""
        if self.place is None or self.location_field() not in ("joint", "link"):
            return None
        return int(self.place)

    @property
    def label(self) -> str:
        """The cause and where it sits, such as ``encoder_gain:5``."""
        place = "" if self.place is None else f":{self.place}"
        return f"{self.cause}{place}"

    @property
    def key(self) -> str:
        """The label, with the value in which several of a cause at a place differ: ``…,order=7``.

        It has six digits; of times since 1970, which these do not tell apart, the milliseconds too.
        """
        if not self.nonlinear.field:
            return self.label
        value = self.nonlinear.value(self)
        digits = f"{value:g}" if abs(value) < 1e5 else f"{round(value, 3):.15g}"
        return f"{self.label},{self.nonlinear.field}={digits}"

    @property
    def identity(self) -> tuple[object, ...]:
        """Which cause it is and where it sits, with all fields, whatever its values are."""
        names = fields_of(type(self))
        return (self.cause, *(getattr(self, name) for name in names))

    @property
    def details(self) -> list[str]:
        """In which it differs from others of its cause at its place, for people."""
        return [self.nonlinear.in_words(self)] if self.nonlinear.field else []

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """What whoever applies it to new records should know."""
        return []

    def at(self, values: Sequence[float] | Array, u: Sequence[float] | Array = ()) -> Self:
        """The same cause with other values [SI]."""
        return replace(self, values=tuple(values), u=tuple(u))

    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters with their values and uncertainties."""
        found = []
        for term, value, u in zip(self.terms, self.values, self.u, strict=True):
            name = f"{self.key}.{term.name}" if term.name else self.key
            found.append(Parameter(name, self.cause, self.row, term.unit, value, None, u, "arm"))
        return tuple(found)


@cache
def fields_of(kind: type[Effect]) -> tuple[str, ...]:
    """Names of the fields that state which one it is: ``joint``, ``order``, …"""
    names = [field.name for field in fields(kind)]
    return tuple(name for name in names if name not in NUMBERS)


def values_by_key(effect: Effect, stated: Mapping[str, float], what: str) -> tuple[float, ...]:
    """Numbers of a file, by the keys of the terms, in SI; what is left out is zero.

    Raises:
        UnknownNameError: a key that is of no term; ``what`` says of what.
    """
    keys = [term.key for term in effect.terms]
    for key in stated:
        if key not in keys:
            raise UnknownNameError(f"{what} of {effect.label}", key, keys)
    return tuple(float(stated.get(term.key, 0.0)) * term.scale for term in effect.terms)


def require_row(effect: Effect, arm: Arm) -> Effect:
    """The effect, if the arm has the row on which it sits.

    Raises:
        AacmmError: it has not.
    """
    if effect.row is not None and effect.row > arm.chain.rows:
        raise AacmmError(
            f"{effect.label}: {arm.name} has no such row; expected 1 to {arm.chain.rows}"
        )
    return effect


def is_possible(effect: Effect, arm: Arm, records: Records | None) -> bool:
    """Whether the arm can have the effect, and the records, if any, have the columns that it
    depends on.
    """
    conditions = Conditions(1) if records is None else records.conditions.take([0])
    q = np.zeros((1, arm.nq)) if records is None else records.q[:1]
    try:
        effect.displacements(State(arm, q, conditions, arm.chain.tip))
    except CauseError:  # a mistake of the class, and none of the place
        raise
    except MissingConditionError:
        return records is None
    except AacmmError:
        return False
    return True


def corrects_seat(effect: Effect) -> bool:
    """Whether it is the stated place of a seat that is off."""
    return effect.of_reference and effect.location_field() == "seat"


def _places(location: str | None, arm: Arm, records: Records | None) -> list[dict[str, Any]]:
    """The places where a cause with the field ``location`` could sit, as that field."""
    found: Sequence[Any] = []
    if location == "joint":
        found = arm.chain.moving_rows()
    elif location == "link":
        found = tubes(arm)
    elif location is not None and records is not None:
        labels = getattr(records.conditions, location)
        touched = Counter(label for label in ([] if labels is None else labels) if label)
        least = 2 if location == "seat" else 1
        found = [label for label, count in touched.items() if count >= least]
    return [{str(location): place} for place in found]


def is_row(row: Any) -> bool:
    """Whether it can be the number of a row, from 1."""
    if isinstance(row, bool) or not isinstance(row, Integral):
        return False
    return 1 <= int(row) <= MOST_ROWS


def shifts(typical: float, largest: float | None = None) -> tuple[Term, ...]:
    """Three shifts along x, y and z, in millimetres in files."""
    terms = (Term(name, "m", typical, f"{name}_mm", MM, largest=largest) for name in "xyz")
    return tuple(terms)


def turns(typical: float) -> tuple[Term, ...]:
    """Three turns about x, y and z."""
    names = ("rx", "ry", "rz")
    return tuple(Term(name, "rad", typical, f"{name}_rad") for name in names)


def sensitivity(effect: Effect, state: State) -> Array:
    """∂(position of the target)/∂parameters (n, 3, p) [m/unit].

    Places behind the target do not matter to it. With ``state.turns`` (n, 6, p): the turn of the
    last body behind it [rad/unit].
    """
    total = np.zeros((state.n, state.coordinates, len(effect.terms)))
    for displacement in effect.displacements(state):
        if displacement.place <= state.target:
            total += point_sensitivity(state, displacement)
    return total


def point_sensitivity(state: State, displacement: Displacement) -> Array:
    """What a displacement does to the target: ``R (v + ω × r)`` (n, 3, p), r its lever.

    With ``state.turns`` the turn ``R ω`` behind it: (n, 6, p), as ``LOCAL_WORLD_ALIGNED`` has it.
    """
    rotation = state.rotation[displacement.place]
    columns = displacement.columns
    lever = state.position - state.origin[displacement.place]
    motion = None
    moving = [columns[:, k].any() for k in range(6)]
    for k in np.flatnonzero(moving):  # most displacements have one component, or three
        direction = rotation[:, :, k % 3]
        by_unit = direction if k < 3 else np.cross(direction, lever)
        own = by_unit[:, :, None] * columns[:, k, None]
        motion = own if motion is None else np.add(motion, own, out=motion)
    if motion is None:
        motion = np.zeros((state.n, 3, columns.shape[2]))
    if not state.turns:
        return motion
    return np.concatenate([motion, rotation @ columns[:, 3:]], axis=1)


def about_axis(state: State, row: int, columns: Array) -> Displacement:
    """Body ``row`` turned about its joint by ``columns`` (n, p) [rad]; along it if the joint
    slides.
    """
    component = 2 if state.slides(row) else 5
    # Component by component, so that the zeros of the others take no memory: nobody writes there.
    twists = np.zeros((6, *columns.shape)).transpose(1, 0, 2)
    twists[:, component] = columns
    return Displacement(axis(row), twists)


def of_encoder(state: State, row: int, columns: Array) -> list[Displacement]:
    """The joints whose angles the reading of ``row`` is a part of, by ``columns`` (n, p) [rad] that
    are added to this reading.
    """
    chain = state.arm.chain
    ratios = chain.drive.matrix @ state.arm.coupling_matrix[:, state.joint(row)]
    parts = zip(chain.joint_rows(), ratios.tolist(), strict=True)
    return [about_axis(state, joint, ratio * columns) for joint, ratio in parts if ratio]


def twist(linear: Array | None = None, angular: Array | None = None) -> Array:
    """Columns (n, 6, p) of a displacement, from shifts and turns in the axes of its place.

    Args:
        linear: shift per unit of each of p parameters (n, 3, p) [m/unit]; None for none.
        angular: turn per unit of each (n, 3, p) [rad/unit]; None for none.
    """
    given = linear if linear is not None else angular
    assert given is not None
    halves = [np.zeros_like(given) if half is None else half for half in (linear, angular)]
    return np.concatenate(halves, axis=1)
