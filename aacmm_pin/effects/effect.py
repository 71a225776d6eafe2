"""What every cause of error is: a small displacement of some places of the arm, linear in a few parameters."""

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
from typing import Any, ClassVar, NamedTuple, Protocol, Self, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin._support.plausible import LATEST, LEAST_KNOWN, MOST_ROWS, MOST_TYPICAL
from aacmm_pin._support.units import DEG, MM, prefixed
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.chain import axis as axis
from aacmm_pin.arm.file import DiscrepancyEntry, EffectEntry
from aacmm_pin.arm.parameter import Parameter, Scope
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, CauseError, UnknownNameError

PLACES = {"joint": "joint", "link": "link", "seat": "seat", "marker": "target"}
"""Fields that say where a cause sits, and what people call such a place."""
UNIT_OF_KEY = re.compile(r"_(rad|deg|mm|um|m|s|k|kg|n|nm)?(_?per_\w+)?$")
"""What a key of a file ends with."""


class Reading(NamedTuple):
    """How people read a value of a file: what they call it, in which unit, and how many of these make one of the file's."""

    name: str
    unit: str
    factor: float


@dataclass(frozen=True)
class Term:
    """One parameter of a cause.

    Attributes:
        name: what tells it from the other parameters of its cause; "" where there is one.
        unit: SI unit.
        typical: usual magnitude on a measuring arm of 1 to 2.5 m [unit].
        key: how files write it, with their unit.
        scale: one of the file's units in SI.
        read_in: the unit in which people read it, and one of it in SI; None for the SI unit with the prefix that makes
            ``typical`` a number of few digits.
        positive: True where nature has it above zero only: a finding that is surely negative explains nothing.
        largest: magnitude beyond which it must be a mistake [unit]; None for :data:`MOST_TYPICAL` times ``typical``.
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
        for name, number in (("typical", self.typical), ("scale", self.scale)):
            if not (isinstance(number, int | float) and 0.0 < number < math.inf):
                raise AacmmError(f"Term {self.key!r}: {name} is {number!r}, expected a number above 0")

    @property
    def unit_read(self) -> tuple[str, float]:
        """The unit in which people read it, and one of it in SI."""
        return self.read_in or prefixed(self.unit, self.typical)

    @property
    def reading(self) -> Reading:
        """How people read it."""
        unit, size = self.unit_read
        return Reading((UNIT_OF_KEY.sub("", self.key) or self.key).replace("_", " "), unit, self.scale / size)


class Records(Protocol):
    """What a cause may ask of records, to say where it could sit: :class:`aacmm_pin.Measurements` are such."""

    @property
    def q(self) -> Array:
        """Indications of the encoders (n, nq) [rad]."""

    @property
    def conditions(self) -> Conditions:
        """What else is known of the records."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """True where the coordinates of the tip are known (n,)."""


@dataclass(frozen=True, eq=False)
class Displacement:
    """How one place moves per unit of each parameter.

    Attributes:
        place: place of the chain.
        columns: (n, 6, p) or (1, 6, p): v then ω in the axes of the place [m/unit, rad/unit].
    """

    place: int
    columns: Array


@dataclass(frozen=True, kw_only=True)
class Effect(Shown, ABC):
    """A physical cause of error with the values of its parameters.

    A subclass states its fields (which joint, which order, …), its :attr:`terms` and :meth:`displacements`; that is all
    that prediction, calibration, diagnosis, plans and pages need. Where the physics is not linear it states :meth:`exact`
    too. The rest has defaults, which a subclass may replace.

    Attributes:
        values: of the parameters, in the order of ``terms``; () means all zero [SI].
        u: their standard uncertainties; () means zero [SI].
        inner_u: standard uncertainties of the fields in :attr:`inner`; () means zero.
    """

    cause: ClassVar[str]
    """Name of the cause in files and commands."""
    words: ClassVar[str]
    """What people call it; without it the name of the cause with spaces."""
    place_words: ClassVar[str] = ""
    """What people call the place where it sits; "" for joint, link, seat or target, as the field says."""
    whole: ClassVar[str] = ""
    """Words where it is of the whole arm, though it could sit at a place; "" for none."""
    bins: ClassVar[int] = 18
    """Into how many parts of what it depends on the records may be gathered in its picture."""
    elastic: ClassVar[bool] = False
    """True where the displacement depends on where the arm is, and so on all the other displacements."""
    of_reference: ClassVar[bool] = False
    """True where it is not the arm that is off but the coordinates it is compared with."""
    refitted: ClassVar[bool] = False
    """True for the set-up that every calibration fits: geometry, tip and reference frame. It is a cause only beyond that."""
    usual: ClassVar[float] = 1.0
    """How usual it is beside others, before anything was seen: the weight of its prior probability."""
    contained_in: ClassVar[tuple[str, ...]] = ()
    """Names of the freer causes that can be this one too, at the same place; the two do not stand beside each other."""
    inner: ClassVar[tuple[str, ...]] = ()
    """Fields that records tell (order, time, …): a candidate tries several values of them, and a key has them."""
    least_inner: ClassVar[float] = 0.0
    """What is beyond this is a value of such a field."""
    scope: ClassVar[Scope] = "arm"

    values: tuple[float, ...] = ()
    u: tuple[float, ...] = ()
    inner_u: tuple[float, ...] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "cause" in vars(cls) and "words" not in vars(cls):
            cls.words = str(cls.cause).replace("_", " ")

    def __post_init__(self) -> None:
        for field in fields(self):
            where = getattr(self, field.name)
            if field.name not in ("joint", "link") or where is field.default:
                continue
            if isinstance(where, bool) or not isinstance(where, Integral) or not 1 <= int(where) <= MOST_ROWS:
                expected = f"expected the number of a row, from 1 to {MOST_ROWS} at most"
                raise AacmmError(f"{self.cause}: {field.name} is {reprlib.repr(where)}, {expected}")
        for name in ("values", "u"):
            numbers = tuple(float(value) for value in getattr(self, name)) or (0.0,) * len(self.terms)
            if len(numbers) != len(self.terms) or not all(map(math.isfinite, numbers)):
                raise AacmmError(f"{self.label}: {name} is {numbers}, expected {len(self.terms)} finite numbers")
            object.__setattr__(self, name, numbers)
        for name in self.inner:
            if not self.least_inner < getattr(self, name) <= LATEST:
                expected = f"a number above {self.least_inner:g} and not above {LATEST:g}"
                raise AacmmError(f"{self.label}: {name} is {getattr(self, name)}, expected {expected}")
        if len(self.inner_u) not in (0, len(self.inner)) or not all(u <= LATEST for u in self.inner_u):
            of = f"u of {', '.join(self.inner)}"
            raise AacmmError(f"{self.label}: {of} is {self.inner_u}, expected {len(self.inner)} numbers to {LATEST:g}")
        for u in (self.u, self.inner_u):
            if any(number < 0 for number in u):
                raise AacmmError(f"{self.label}: u is {u}, expected numbers that are not negative")

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions without which the effect cannot be told, see :class:`aacmm_pin.effects.conditions.Conditions`."""
        return ()

    @property
    def load(self) -> str:
        """Words for what the displacement is proportional to, where that is neither an angle nor a column of the records.

        They label the axis of its picture; the unit there is that of the displacement over that of the one parameter:
        ``N·m`` for rad by rad/(N·m).
        """
        return "load"

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

    @property
    def known_range(self) -> tuple[float, float] | None:
        """Indications of its joint between which it is known [rad]; None for everywhere."""
        return None

    def known(self, state: State) -> NDArray[np.bool_]:
        """(n,) True for the records in which the effect is known."""
        if self.known_range is None or self.row is None:
            return np.ones(state.n, dtype=bool)
        angle, (low, high) = state.angle(self.row), self.known_range
        return np.asarray((angle >= low) & (angle <= high))

    @property
    def known_where(self) -> str:
        """Words for the range in which it is known, after a comma; "" for everywhere."""
        if self.known_range is None:
            return ""
        low, high = self.known_range
        return f", which is known from {low:g} to {high:g} rad ({low / DEG:g}° to {high / DEG:g}°)"

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """Displacements at the values, place and twist (n, 6), by exact physics; here: the linear ones."""
        return [(d.place, d.columns @ np.array(self.values)) for d in self.displacements(state)]

    @classmethod
    @cache  # asked for thousands of times in a calibration
    def structure(cls) -> tuple[str, ...]:
        """Names of the fields that say which one it is: ``joint``, ``order``, …"""
        return tuple(f.name for f in fields(cls) if f.name not in ("values", "u", "inner_u"))

    @classmethod
    @cache
    def site(cls) -> str | None:
        """The field that says where it sits: ``joint``, ``link``, ``seat`` or ``marker``; None for the whole arm."""
        return next((name for name in PLACES if name in cls.structure()), None)

    @property
    def place(self) -> int | str | None:
        """Number of the joint or link, or label of the seat or target, where it sits; None for the whole arm."""
        name = self.site()
        return None if name is None else getattr(self, name)

    @property
    def label(self) -> str:
        """The cause and where it sits, such as ``encoder_gain:5``."""
        return self.cause if self.place is None else f"{self.cause}:{self.place}"

    @property
    def key(self) -> str:
        """The label with what tells several of one cause at one place apart: ``joint_periodic_error:6,order=7``.

        It has six digits; of times since 1970, which these do not tell apart, the milliseconds too.
        """
        numbers = [(name, float(getattr(self, name))) for name in self.inner]
        return ",".join([self.label, *(f"{n}={x:g}" if abs(x) < 1e5 else f"{n}={round(x, 3):.15g}" for n, x in numbers)])

    @property
    def identity(self) -> tuple[object, ...]:
        """Which cause it is and where it sits, with all fields, whatever its values are."""
        return (self.cause, *(getattr(self, name) for name in self.structure()))

    @property
    def row(self) -> int | None:
        """The DH row it belongs to; None for causes of the whole arm."""
        return int(self.place) if self.place is not None and self.site() in ("joint", "link") else None

    @property
    def corrects_seat(self) -> bool:
        """Whether it is the stated place of a seat that is off."""
        return self.of_reference and self.site() == "seat"

    def inner_in_words(self) -> list[str]:
        """What the records tell of its inner fields, for people."""
        return [f"{name.replace('_', ' ')} {getattr(self, name):.4g}" for name in self.inner]

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Where on an arm the cause could sit: one for each place, each with the values of :attr:`inner` to try.

        Here: the whole arm once, if no place need be named; every joint, every tube (a body longer than 0.15 m), every seat
        that was touched twice, every target, as the field says; but for places where :meth:`displacements` raises an
        :class:`AacmmError`: no such row, no masses, no such column in the records. A class with more fields that have no
        default states its own; without that it has no candidates.

        Args:
            arm: the arm.
            records: as far as they show the cause; None for whatever could be recorded.
        """
        if any(f.default is MISSING and f.name != cls.site() for f in fields(cls)):
            return
        site = cls.site()
        # A field with a default is an attribute of the class.
        whole: list[dict[str, Any]] = [{}] if site is None or hasattr(cls, site) else []
        for place in [*whole, *_places(site, arm, records)]:
            effect = cls(**place)
            if effect._shows(arm, records):
                yield (effect,)

    def _shows(self, arm: Arm, records: Records | None) -> bool:
        if records is None and self.needs:
            return True
        conditions = Conditions(1) if records is None else records.conditions.take([0])
        q = np.zeros((1, arm.nq)) if records is None else records.q[:1]
        try:
            self.displacements(State(arm, q, conditions, arm.chain.tip))
        except CauseError:  # a mistake of the class, and none of the place
            raise
        except AacmmError:
            return False
        return True

    def other_loads(self, arm: Arm) -> tuple[Self, ...]:
        """The same under loads that the arm's file does not have, to be tried beside it where it is known; here: none."""
        return ()

    def refined(self, records: Records) -> list[Self]:
        """The same with inner values near those that were found, in their order; here: itself."""
        return [self]

    def special_cases(self) -> Sequence[Effect]:
        """Causes with fewer values that it is where its values are those, to be tried in its place; here: none."""
        return ()

    def told_between(self, low: float, high: float, records: Records) -> Self:
        """The same, of whose inner value ``records`` tell that it is from ``low`` to ``high`` (95 %); here: itself."""
        return self

    def share(self, records: Records) -> float:
        """How probable its inner value is beside the others that are tried, before anything was seen; here all alike: 1."""
        return 1.0

    def step_width(self, records: Records) -> float:
        """Between the neighbouring records of which one is before and one behind the step of its inner value; here: 0."""
        return 0.0

    def to_be_told(self, conditions: Conditions) -> list[str]:
        """What whoever applies it to new records should know, in words; here: nothing."""
        return []

    @property
    def open_questions(self) -> tuple[Effect, ...]:
        """Causes of value zero whose u stands for what is uncertain of it beside its values and fields; here: none."""
        return ()

    @property
    def exceptional(self) -> bool:
        """Whether its inner value is one that machines are made with, and so likelier than those near it."""
        return False

    @property
    def magnitude_alone(self) -> bool:
        """Whether its values stand for their magnitude, in any direction, such as an amplitude without a phase."""
        return False

    def inner_widths(self) -> dict[str, float]:
        """Fields with a continuous value in which the cause is smooth, and how far off each may be before records tell."""
        return {}

    @classmethod
    def completed(cls, structure: Mapping[str, Any], arm: Arm, present: tuple[str, ...]) -> dict[str, Any]:
        """The fields that a person typed, with those that the arm and the conditions ``present`` in the records give."""
        return dict(structure)

    @property
    def settling_time(self) -> float | None:
        """Time from switching on over which it changes [s]; None for a cause that has none."""
        return None

    @property
    def period(self) -> float | None:
        """Period over the angle of its joint, where its picture is folded into one [rad]; None for the whole range."""
        return None

    def spectrum(self) -> list[tuple[float, float]] | None:
        """Orders [per turn] and amplitudes [rad] of the strongest waves of a free curve; None for others."""
        return None

    def is_of_angle(self, state: State) -> bool:
        """Whether it is a function of the angle of its own joint alone."""
        if self.elastic or self.needs or self.site() != "joint" or self.row is None:
            return False
        number = state.joint(self.row)
        alone = np.zeros_like(state.q)
        alone[:, number] = state.q[:, number]
        whole, own = self.displacements(state), self.displacements(replace(state, q=alone))
        return len(whole) == 1 and np.array_equal(whole[0].columns, own[0].columns)

    def drawn_over(self, state: State) -> tuple[Array, str] | None:
        """What it depends on in every record (n,), and the words and unit of that axis; None for its :attr:`load`."""
        conditions = state.conditions
        if "time" in self.needs:
            return conditions.require("time", self.label) / 60.0, "time [min]"
        if "temperature" in self.needs and conditions.temperature is not None:
            return conditions.temperature, "temperature [°C]"
        if "approach" in self.needs and self.row is not None:
            return conditions.require("approach", self.label)[:, state.joint(self.row)], "direction of the last motion [1]"
        if self.row is None or not self.is_of_angle(state):
            return None
        angle = state.angle(self.row)
        if self.period is None:
            unit, size = state.read_in(self.row)
            return angle / size, f"joint {self.row} [{unit}]"
        words = f"joint {self.row}, folded into one period of {self.period / DEG:.4g}° [°]"
        return np.mod(angle, self.period) / DEG, words

    def slides(self, arm: Arm) -> bool:
        """Whether its values are of a joint that slides, so that those in rad are metres."""
        if self.site() != "joint" or self.row is None or any(term.unit != "rad" for term in self.terms):
            return False
        number = int(arm.chain.joint[axis(self.row)])
        return number >= 0 and bool(arm.chain.prismatic[number])

    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters with their values and uncertainties."""
        names = [f"{self.key}.{t.name}" if t.name else self.key for t in self.terms]
        numbers = zip(names, self.terms, self.values, self.u, strict=True)
        return tuple(Parameter(n, self.cause, self.row, t.unit, value, None, u, self.scope) for n, t, value, u in numbers)

    def at(self, values: Array | tuple[float, ...], u: Array | tuple[float, ...] = ()) -> Self:
        """The same cause with other values."""
        return replace(self, values=tuple(values), u=tuple(u))

    def sensitivity(self, state: State) -> Array:
        """∂(position of the target)/∂parameters: (n, 3, p) [m/unit]. Places behind the target do not matter to it.

        With ``state.turns`` (n, 6, p), the turn of the last body behind it [rad/unit].
        """
        total = np.zeros((state.n, state.coordinates, len(self.terms)))
        for d in self.displacements(state):
            if d.place <= state.target:
                total += moved(state, d)
        return total

    def described(self) -> dict[str, float]:
        """The values as files and people write them."""
        return {t.key: value / t.scale for t, value in zip(self.terms, self.values, strict=True)}

    def readings(self) -> dict[str, Reading]:
        """How people read each of the described values."""
        return {t.key: t.reading for t in self.terms}

    def described_jacobian(self) -> Array:
        """∂(described values)/∂(parameters), (described, p)."""
        return np.diag([1.0 / t.scale for t in self.terms])

    def filed(self) -> EffectEntry | DiscrepancyEntry:
        """The effect as an arm file has it."""
        structure = {name: getattr(self, name) for name in self.structure()}
        stated = {k: list(v) if isinstance(v, tuple) else v for k, v in structure.items() if v not in (None, ())}
        u = {term.key: float(u / term.scale) for term, u in zip(self.terms, self.u, strict=True) if any(self.u)}
        u |= {name: float(u) for name, u in zip(self.inner, self.inner_u, strict=False) if u}
        entry = {"cause": self.cause, **stated, "parameters": self.described(), "uncertainty": u}
        return EffectEntry.model_validate(entry)

    @classmethod
    def from_description(
        cls, structure: Mapping[str, Any], parameters: Mapping[str, float], uncertainty: Mapping[str, float] | None = None
    ) -> Self:
        """The cause from what a file says.

        Raises:
            UnknownNameError: a field or parameter that the cause does not have.
            AacmmError: a field is missing or of no use.
        """
        for name in structure:
            if name not in cls.structure():
                raise UnknownNameError(f"field of {cls.cause}", name, list(cls.structure()))
        missing = [f.name for f in fields(cls) if f.default is MISSING and f.name not in structure]
        if missing:
            raise AacmmError(f"{cls.cause}: missing {', '.join(missing)}")
        u = dict(uncertainty or {})
        inner_u = tuple(float(u.pop(name, 0.0)) for name in cls.inner) if u.keys() & {*cls.inner} else ()
        bare = cls(**{name: cls._checked(name, value) for name, value in structure.items()}, inner_u=inner_u)
        return bare.at(bare.values_from(parameters), bare._by_key(u, "uncertainty")).require_plausible()

    def require_plausible(self) -> Self:
        """The cause itself, if no value or u is beyond what a file can state.

        Raises:
            AacmmError: one is.
        """
        for term, value, u in zip(self.terms, self.values, self.u, strict=True):
            most = MOST_TYPICAL * term.typical if term.largest is None else term.largest
            for what, number, limit in (("", value, most), ("u of ", u, LEAST_KNOWN * term.typical)):
                if abs(number) > limit:
                    came, expected = (f"{size / term.scale:g}" for size in (number, limit))
                    raise AacmmError(f"{self.label}: {what}{term.key} is {came}, expected at most {expected}")
        return self

    def require_sign(self) -> Self:
        """The cause itself, if no value is stated below zero that nature has above zero only.

        A value with a standard uncertainty is an estimate: that may have either sign, as one of zero has every other time.

        Raises:
            AacmmError: one is.
        """
        for term, value, u in zip(self.terms, self.values, self.u, strict=True):
            if term.positive and value < 0 and u == 0:
                number = f"{value / term.scale:g}"
                raise AacmmError(f"{self.label}: {term.key} is {number}, expected a number that is not negative")
        return self

    @classmethod
    def _checked(cls, name: str, value: Any) -> Any:
        """A field as a file states it, if it has the type that the class declares."""
        adapter = TypeAdapter(get_type_hints(cls)[name], config=ConfigDict(strict=True, allow_inf_nan=False))
        try:
            return adapter.validate_python(tuple(value) if isinstance(value, list) else value)
        except ValidationError as error:
            expected = error.errors()[0]["msg"].removeprefix("Input should be ")
            raise AacmmError(f"{cls.cause}: {name} is {reprlib.repr(value)}, expected {expected}") from None

    def values_from(self, parameters: Mapping[str, float]) -> tuple[float, ...]:
        """Values from what a file says; what it leaves out is zero."""
        return self._by_key(parameters)

    def _by_key(self, parameters: Mapping[str, float], what: str = "parameter") -> tuple[float, ...]:
        keys = [t.key for t in self.terms]
        for key in parameters:
            if key not in keys:
                raise UnknownNameError(f"{what} of {self.label}", key, keys)
        return tuple(float(parameters.get(t.key, 0.0)) * t.scale for t in self.terms)


def require_row(effect: Effect, arm: Arm) -> Effect:
    """The effect, if the arm has the row on which it sits.

    Raises:
        AacmmError: it has not.
    """
    if effect.row is not None and not 1 <= effect.row <= arm.chain.rows:
        raise AacmmError(f"{effect.label}: {arm.name} has rows 1 to {arm.chain.rows}")
    return effect


def _places(site: str | None, arm: Arm, records: Records | None) -> list[dict[str, Any]]:
    """The places where a cause with the field ``site`` could sit, as that field."""
    found: list[Any] = []
    if site == "joint":
        found = arm.chain.moving_rows()
    elif site == "link":
        from aacmm_pin.effects.tube import tubes

        found = tubes(arm)
    elif site is not None and records is not None:
        labels = records.conditions.seat if site == "seat" else records.conditions.marker
        touched = Counter(label for label in ([] if labels is None else labels) if label)
        found = [label for label, count in touched.items() if site == "marker" or count > 1]
    return [{str(site): place} for place in found]


def shifts(typical: float, largest: float | None = None) -> tuple[Term, ...]:
    """Three shifts along x, y and z, in millimetres in files."""
    return tuple(Term(name, "m", typical, f"{name}_mm", MM, largest=largest) for name in ("x", "y", "z"))


def turns(typical: float) -> tuple[Term, ...]:
    """Three turns about x, y and z."""
    return tuple(Term(name, "rad", typical, f"{name}_rad") for name in ("rx", "ry", "rz"))


def moved(state: State, displacement: Displacement) -> Array:
    """What a displacement does to the target: ``R (v + ω × r)``, r the target seen from the place: (n, 3, p).

    With ``state.turns`` the turn ``R ω`` behind it: (n, 6, p), as ``LOCAL_WORLD_ALIGNED`` has it.
    """
    rotation, columns = state.rotation[displacement.place], displacement.columns
    lever = state.position - state.origin[displacement.place]
    motion = None
    for k in np.flatnonzero([columns[:, k].any() for k in range(6)]):  # most displacements have one component, or three
        direction = rotation[:, :, k % 3]
        by_unit = direction if k < 3 else np.cross(direction, lever)
        own = by_unit[:, :, None] * columns[:, k, None]
        motion = own if motion is None else np.add(motion, own, out=motion)
    if motion is None:
        motion = np.zeros((state.n, 3, columns.shape[2]))
    return np.concatenate([motion, rotation @ columns[:, 3:]], axis=1) if state.turns else motion


def about_axis(state: State, row: int, columns: Array) -> Displacement:
    """Body ``row`` turned about its joint by ``columns`` (n, p) [rad]; shifted along it where the joint slides."""
    component = 2 if state.arm.chain.prismatic[state.joint(row)] else 5
    # Component by component, so that the zeros of the others take no memory: nobody writes there.
    twists = np.zeros((6, *columns.shape)).transpose(1, 0, 2)
    twists[:, component] = columns
    return Displacement(axis(row), twists)


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
