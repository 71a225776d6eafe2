"""The base class of causes of error: small displacements, linear in parameters."""

from __future__ import annotations

import math
import re
import reprlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from numbers import Integral
from typing import Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.plausible import LATEST, MOST_ROWS
from aacmm_pin._support.units import MM, count, prefixed
from aacmm_pin.arm import Arm, Parameter, end
from aacmm_pin.arm import axis as axis
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, CauseError, MissingConditionError, UnknownNameError

ROW_FIELDS = ("joint", "link")
LOCATION_FIELDS = (*ROW_FIELDS, "seat", "marker", "session")
"""Fields that state the place of a cause."""
NUMBERS = ("values", "u", "nonlinear_u")
"""Fields of every cause that do not identify it."""
UNIT_OF_KEY = re.compile(r"_(rad|deg|mm|um|m|s|k|kg|n|nm)?(_?per_\w+)?$")

BENDS = 0.15
"""A longer body is a tube, whose bending matters [m]."""
RELATIVE_STEP = 1e-4
WARM_UP_TIMES = (600.0, 1800.0, 5400.0)
"""Usual time constants of a warm-up [s]."""
TIME_CONSTANTS = 15
"""Time constants to try near the best of the grid."""
PRIOR_FACTOR = 3.0
"""Factor, at one standard deviation, to which a time constant is known beforehand."""


class Reading(NamedTuple):
    """How outputs show a value of a file: name, unit, and factor of the value."""

    name: str
    unit: str
    factor: float


@dataclass(frozen=True)
class Term:
    """One parameter of a cause.

    Attributes:
        name: name within the cause; "" for the only parameter.
        unit: SI unit.
        typical: typical magnitude in a measuring arm of 1 to 2.5 m [unit].
        key: name in files, with the unit.
        scale: unit of the file in SI units.
        read_in: unit in outputs, and its size in SI units; None for the SI unit with a suitable
            prefix.
        positive: True if the parameter is physically above zero; a significantly negative estimate
            explains nothing.
        largest: largest plausible magnitude [unit]; None for a thousand times ``typical``.
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
        if not (0.0 < self.typical < math.inf and 0.0 < self.scale < math.inf):
            came = f"typical is {self.typical}, scale is {self.scale}"
            raise AacmmError(f"Term {self.key!r}: {came}; expected numbers above 0")

    @property
    def unit_read(self) -> tuple[str, float]:
        """Return ``read_in``, or its default."""
        return self.read_in or prefixed(self.unit, self.typical)

    @property
    def reading(self) -> Reading:
        """The form in outputs of a value of a file."""
        unit, size = self.unit_read
        name = UNIT_OF_KEY.sub("", self.key) or self.key
        return Reading(name.replace("_", " "), unit, self.scale / size)


@dataclass(frozen=True, eq=False)
class Displacement:
    """The displacement of one place for one unit of each parameter.

    Attributes:
        columns: translation v, then rotation ω in its axes, ``(n, 6, p)`` or ``(1, 6, p)`` [m/unit,
            rad/unit].
    """

    place: int
    columns: Array


E = TypeVar("E", bound="Effect")


@dataclass(frozen=True)
class Nonlinear(Generic[E]):
    """The nonlinear parameter of a cause, whose value the records determine by trial.

    A search tries the values of :meth:`grid`, and refines the most probable with :meth:`refine`.
    All methods have defaults for a cause without nonlinear parameter.

    Attributes:
        field: field of the effect with the parameter; "" for none.
        above: valid values are above this number.
        words: format of the value in outputs, with ``value``, and ``minutes`` for a time; "" for
            the name of the field and the value.
    """

    field: str = ""
    unit: str = "1"
    above: float = 0.0
    words: str = ""

    def value(self, effect: E) -> float:
        """The value of an effect."""
        return float(getattr(effect, self.field))

    def at(self, effect: E, value: float) -> E:
        """The effect with another value."""
        field: dict[str, Any] = {self.field: value}
        return replace(effect, **field)

    def in_words(self, effect: E) -> str:
        """The value as text."""
        value = self.value(effect)
        if not self.words:
            return f"{self.field.replace('_', ' ')} {value:.4g}"
        return self.words.format(value=value, minutes=value / 60.0)

    def grid(self, records: Records | None) -> Sequence[float]:
        """The values to try; default none, so that ``candidates`` must state them."""
        return ()

    def refine(self, effect: E, records: Records) -> list[E]:
        """The effect with values near its own, in ascending order; default itself."""
        return [effect]

    def prior_sd(self, effect: E) -> float:
        """The prior standard deviation of the value; 0 if the cause is not smooth in it."""
        return 0.0

    def prior_probability(self, effect: E, records: Records) -> float:
        """The prior probability of the value, up to a common factor."""
        return 1.0

    def is_preferred(self, effect: E) -> bool:
        """Whether the value is common in machines, and so more probable than its neighbours."""
        return False

    def gap(self, effect: E, records: Records) -> float:
        """The time between the two records around a step; 0 for no step."""
        return 0.0

    def with_coverage_interval(self, effect: E, low: float, high: float, records: Records) -> E:
        """The effect with the 95 % interval of its value; default unchanged."""
        return effect

    def extrapolation_terms(self, effect: E) -> tuple[Effect, ...]:
        """Effects with value zero whose u is the uncertainty outside the records."""
        return ()


@dataclass(frozen=True)
class TimeConstant(Nonlinear[E]):
    """The time constant of a warm-up after the arm is switched on [s]."""

    unit: str = "s"
    above: float = 1e-3
    words: str = "time constant {minutes:.0f} min"

    def grid(self, records: Records | None) -> Sequence[float]:
        """The usual time constants and a longer one, if the records have different times."""
        if records is not None and records.conditions.times.size < 2:
            return ()
        return (*WARM_UP_TIMES, PRIOR_FACTOR * WARM_UP_TIMES[-1])

    def refine(self, effect: E, records: Records) -> list[E]:
        """The effect with time constants from a third to three times its own."""
        constants = self.value(effect) * np.geomspace(
            1 / PRIOR_FACTOR, PRIOR_FACTOR, TIME_CONSTANTS
        )
        return [self.at(effect, constant) for constant in constants.tolist()]

    def prior_sd(self, effect: E) -> float:
        """Twice the value, known beforehand to a factor of about three."""
        return 2.0 * self.value(effect)

    def prior_probability(self, effect: E, records: Records) -> float:
        """A log-normal probability, with a factor of three, outside usual time constants."""
        value = self.value(effect)
        usual = np.clip(value, WARM_UP_TIMES[0], WARM_UP_TIMES[-1])
        factors = np.log(value / usual) / np.log(PRIOR_FACTOR)
        return float(np.exp(-0.5 * factors**2))


@dataclass(frozen=True, kw_only=True)
class Effect(Shown, ABC):
    """A cause of error with the values of its parameters.

    A subclass states ``cause``, ``terms``, :meth:`displacements`, and fields such as its place
    (``joint``, ``link``, ``seat`` or ``marker``) or an order. All other attributes have defaults.
    For pictures, ``load`` may name the quantity to which the displacement is proportional.

    Attributes:
        values: of the parameters in the order of ``terms`` [SI]; () for zero.
        u: standard uncertainties of the values [SI]; () for zero.
        nonlinear_u: standard uncertainty of the field in :attr:`nonlinear`.
    """

    cause: ClassVar[str]
    """The name in files and commands."""
    words: ClassVar[str] = ""
    """The name in outputs; "" for ``cause`` with spaces."""
    elastic: ClassVar[bool] = False
    """True if the displacement depends on the deflected posture."""
    of_reference: ClassVar[bool] = False
    """True if the reference coordinates have the error, and not the arm."""
    refitted: ClassVar[bool] = False
    """True for parameters that every calibration fits (geometry, tip, frame): only a change beyond
    their uncertainty counts as a cause.
    """
    along_slide: ClassVar[bool] = True
    """True if rad in the units of the parameters means m at a prismatic joint."""
    prior_weight: ClassVar[float] = 1.0
    """The prior weight relative to other causes."""
    function_of: ClassVar[str] = ""
    """What the displacement depends on, such as ``angle``: causes of one joint or body with the
    same word are forms of one place. "" for a place of its own.
    """
    free_form: ClassVar[bool] = False
    """True if the cause can be every function of its place, and so acts there alone."""
    remedy: ClassVar[str] = ""
    """What to do with the records, if the set-up has the error and not the arm; else ""."""
    of_fit: ClassVar[tuple[str, ...]] = ()
    """Fields that a fit states beside the values, such as the range of the records."""
    follows: ClassVar[str] = ""
    """The cause without which this is not tried at a place, such as the first periodic error."""
    nonlinear: ClassVar[Nonlinear[Any]] = Nonlinear()
    """The field whose value the records determine by trial; :attr:`key` contains it."""

    values: tuple[float, ...] = ()
    u: tuple[float, ...] = ()
    nonlinear_u: float = 0.0

    def __post_init__(self) -> None:
        location = str(self.location_field())
        is_default = self.place is getattr(type(self), location, MISSING)
        if location in ROW_FIELDS and not is_default and not is_row(self.place):
            raise AacmmError(
                f"{self.cause}: {location} is {reprlib.repr(self.place)}; expected the number of "
                f"a row, from 1 to at most {MOST_ROWS}"
            )
        size = len(self.terms)
        for name, least in (("values", -math.inf), ("u", 0.0)):
            numbers = tuple(map(float, getattr(self, name))) or (0.0,) * size
            is_valid = [math.isfinite(number) and number >= least for number in numbers]
            if len(numbers) != size or not all(is_valid):
                expected = count(size, "finite number") + ", 0 or more" * (name == "u")
                raise AacmmError(f"{self.label}: {name} is {numbers}; expected {expected}")
            object.__setattr__(self, name, numbers)
        field = self.nonlinear.field
        above = self.nonlinear.above
        if field and not above < getattr(self, field) <= LATEST:
            expected = f"more than {above:g}, and at most {LATEST:g}"
            raise AacmmError(
                f"{self.label}: {field} is {getattr(self, field)}; expected {expected}"
            )

    @property
    @abstractmethod
    def terms(self) -> tuple[Term, ...]:
        """The parameters of the cause."""

    @abstractmethod
    def displacements(self, state: State) -> list[Displacement]:
        """The displacements of places for one unit of each parameter.

        Raises:
            MissingConditionError: the records lack a condition that the cause needs.
            UnsupportedArmError: the arm lacks a property that the cause needs, such as masses.
        """

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """Places and their exact twists ``(n, 6)`` at the values; default the linear twists."""
        values = np.array(self.values)
        return [
            (displacement.place, displacement.columns @ values)
            for displacement in self.displacements(state)
        ]

    @property
    def needs(self) -> tuple[str, ...]:
        """The names of the required conditions in :class:`Conditions`."""
        return ()

    @property
    def known_range(self) -> tuple[float, float] | None:
        """The joint angles between which the cause is known [rad]; None for all."""
        return None

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """The possible places of the cause, each with its variants to try.

        By default, the field of the place decides: every joint, tube (body longer than 0.15 m),
        seat with at least two records, or target; without such a field, the whole arm. Places at
        which :meth:`displacements` raises an :class:`AacmmError` are omitted. A class with other
        fields without default must replace this method, or has no candidates.

        Args:
            records: records that must show the cause; None for all places that records could show.
        """
        location = cls.location_field()
        nonlinear = cls.nonlinear
        required = cls.required_fields()
        if not required <= {location, nonlinear.field}:
            return
        variants: list[dict[str, Any]] = [{}]
        if nonlinear.field:
            variants = [{nonlinear.field: value} for value in nonlinear.grid(records)]
        places: Sequence[Any] = []
        if location == "joint":
            places = arm.chain.moving_rows()
        elif location == "link":
            places = tubes(arm)
        elif location is not None and records is not None:
            counts = Counter(filter(None, records.conditions.labels(location)))
            least = 2 if location == "seat" else 1
            places = [label for label, count in counts.items() if count >= least]
        locations = [{str(location): place} for place in places]
        if location not in required:
            locations.insert(0, {})
        for location_fields in locations:
            effects = tuple(cls(**location_fields, **variant) for variant in variants)
            if effects and is_possible(effects[0], arm, records):
                yield effects

    @classmethod
    def required_fields(cls) -> set[str]:
        """The names of the fields without default."""
        return {field.name for field in fields(cls) if field.default is MISSING}

    def basis(self, arm: Arm, records: Records) -> Effect | None:
        """An effect whose functions can represent this cause in the records, or None."""
        return None

    def in_basis(self, basis: Effect) -> Array:
        """The parameters of the basis for one unit of each parameter ``(b, p)``."""
        return np.eye(len(basis.terms))[:, : len(self.terms)]

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """Defaults of optional fields for an arm and the conditions ``present``."""
        return {}

    @classmethod
    @cache  # asked for thousands of times in a calibration
    def location_field(cls) -> str | None:
        """One of :data:`LOCATION_FIELDS`; None for the whole arm."""
        return next((name for name in LOCATION_FIELDS if name in fields_of(cls)), None)

    @property
    def place(self) -> int | str | None:
        """The number of the joint or link, or the label of the seat or target, or None."""
        name = self.location_field()
        return None if name is None else getattr(self, name)

    @property
    def row(self) -> int | None:
        """The DH row of the cause; None for the whole arm."""
        if self.place is None or self.location_field() not in ROW_FIELDS:
            return None
        return int(self.place)

    @property
    def label(self) -> str:
        """The name and the place of the cause, such as ``encoder_gain:5``."""
        place = "" if self.place is None else f":{self.place}"
        return f"{self.cause}{place}"

    @property
    def key(self) -> str:
        """The label with the nonlinear value, such as ``…,order=7``: different for each variant.

        The value has six digits; a time since 1970 also milliseconds.
        """
        if not self.nonlinear.field:
            return self.label
        value = self.nonlinear.value(self)
        digits = f"{value:g}" if abs(value) < 1e5 else f"{round(value, 3):.15g}"
        return f"{self.label},{self.nonlinear.field}={digits}"

    @property
    def identity(self) -> tuple[object, ...]:
        """The name, the place and all other fields, without the values and ``of_fit``."""
        names = [name for name in fields_of(type(self)) if name not in self.of_fit]
        return (self.cause, *(getattr(self, name) for name in names))

    @property
    def details(self) -> list[str]:
        """How the cause differs from other variants at its place, as texts."""
        return [self.nonlinear.in_words(self)] if self.nonlinear.field else []

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """Notes on records to which the estimated values do not apply."""
        return []

    def at(self, values: Sequence[float] | Array, u: Sequence[float] | Array = ()) -> Self:
        """The cause with other values and uncertainties [SI]."""
        return replace(self, values=tuple(values), u=tuple(u))

    def file_values(self) -> dict[str, float]:
        """The values with the names and units of a file."""
        pairs = zip(self.terms, self.values, strict=True)
        return {term.key: value / term.scale for term, value in pairs}

    def file_jacobian(self) -> Array:
        """∂(values of the file)/∂(values), ``(numbers, p)``."""
        return np.diag([1.0 / term.scale for term in self.terms])

    def from_file(self, file_values: Mapping[str, float]) -> tuple[float, ...]:
        """Values [SI] from the numbers of a file; a missing number is zero.

        Raises:
            UnknownNameError: the cause has no parameter of this name.
        """
        return values_by_key(self, file_values, "parameter")

    def readings(self) -> dict[str, Reading]:
        """The form in outputs of each number of a file."""
        return {term.key: term.reading for term in self.terms}

    @property
    def phase_is_free(self) -> bool:
        """Whether the values state only a magnitude."""
        return False

    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the cause with values and uncertainties."""
        parameters = []
        for term, value, u in zip(self.terms, self.values, self.u, strict=True):
            name = f"{self.key}.{term.name}" if term.name else self.key
            parameters.append(Parameter(name, self.cause, self.row, term.unit, value, None, u))
        return tuple(parameters)


@cache
def fields_of(kind: type[Effect]) -> tuple[str, ...]:
    """The fields that identify a cause, such as ``joint`` and ``order``."""
    positional_first = sorted(fields(kind), key=lambda field: field.kw_only is True)
    return tuple(field.name for field in positional_first if field.name not in NUMBERS)


def require_names(stated: Iterable[str], names: Sequence[str], what: str) -> None:
    """Check names of a file.

    Raises:
        UnknownNameError: a name is none of ``names``, which ``what`` describes.
    """
    for name in stated:
        if name not in names:
            raise UnknownNameError(what, name, list(names))


def values_by_key(effect: Effect, stated: Mapping[str, float], what: str) -> tuple[float, ...]:
    """Numbers of a file by the keys of the terms [SI]; missing numbers are zero.

    Raises:
        UnknownNameError: a key belongs to no term.
    """
    require_names(stated, [term.key for term in effect.terms], f"{what} of {effect.label}")
    return tuple(float(stated.get(term.key, 0.0)) * term.scale for term in effect.terms)


def require_row(effect: Effect, arm: Arm) -> Effect:
    """The effect, after a check of its row.

    Raises:
        AacmmError: the arm does not have the row.
    """
    if effect.row is not None and effect.row > arm.chain.rows:
        raise AacmmError(
            f"{effect.label}: {arm.name} has no joint or link of this number; expected a "
            f"number from 1 to {arm.chain.rows}"
        )
    return effect


def is_possible(effect: Effect, arm: Arm, records: Records | None) -> bool:
    """Whether the arm can have the effect, and the records have its conditions."""
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
    """Whether the cause is an error of the stated place of a seat."""
    return effect.of_reference and effect.location_field() == "seat"


def tubes(arm: Arm) -> list[int]:
    """Rows of the bodies that are long enough to bend."""
    _, origin = arm.chain.at_zero
    spans = {row: origin[end(row)] - origin[arm.foot(row)] for row in range(1, arm.chain.rows + 1)}
    return [row for row, span in spans.items() if np.linalg.norm(span) > BENDS]


def is_row(row: Any) -> bool:
    """Whether it can be the number of a row, from 1."""
    if isinstance(row, bool) or not isinstance(row, Integral):
        return False
    return 1 <= int(row) <= MOST_ROWS


def shifts(typical: float, largest: float | None = None) -> tuple[Term, ...]:
    """Three translations along x, y and z, in millimetres in files."""
    return tuple(Term(name, "m", typical, f"{name}_mm", MM, largest=largest) for name in "xyz")


def rotations(typical: float) -> tuple[Term, ...]:
    """Three rotations about x, y and z."""
    names = ("rx", "ry", "rz")
    return tuple(Term(name, "rad", typical, f"{name}_rad") for name in names)


def sensitivity(effect: Effect, state: State) -> Array:
    """∂(position of the target)/∂parameters, ``(n, 3, p)`` [m/unit]; with ``state.with_rotation``
    also the rotation of the last body, ``(n, 6, p)`` [m/unit, rad/unit].
    """
    total = np.zeros((state.n, state.coordinates, len(effect.terms)))
    for displacement in effect.displacements(state):
        if displacement.place <= state.target:
            total += point_sensitivity(state, displacement)
    return total


def point_sensitivity(state: State, displacement: Displacement) -> Array:
    """Displacement of the target by a displaced place, ``R (v + ω × r)`` with the lever r: ``(n, 3,
    p)``; with ``state.with_rotation`` also ``R ω``: ``(n, 6, p)``, as in ``LOCAL_WORLD_ALIGNED``.
    """
    rotation = state.rotation[displacement.place]
    columns = displacement.columns
    lever = state.position - state.origin[displacement.place]
    motion = None
    is_present = [columns[:, k].any() for k in range(6)]
    for k in np.flatnonzero(is_present):  # most displacements have one component, or three
        direction = rotation[:, :, k % 3]
        by_unit = direction if k < 3 else np.cross(direction, lever)
        of_component = by_unit[:, :, None] * columns[:, k, None]
        motion = of_component if motion is None else np.add(motion, of_component, out=motion)
    if motion is None:
        motion = np.zeros((state.n, 3, columns.shape[2]))
    if not state.with_rotation:
        return motion
    return np.concatenate([motion, rotation @ columns[:, 3:]], axis=1)


def about_axis(state: State, row: int, columns: Array) -> Displacement:
    """The rotation of body ``row`` about its joint axis by ``columns`` ``(n, p)`` [rad/unit]; for a
    prismatic joint, the translation along it [m/unit].
    """
    component = 2 if state.slides(row) else 5
    # Transposed, so that zeros of the other components take no memory: nothing writes there.
    twists = np.zeros((6, *columns.shape)).transpose(1, 0, 2)
    twists[:, component] = columns
    return Displacement(axis(row), twists)


def encoder_displacements(state: State, row: int, columns: Array) -> list[Displacement]:
    """Rotations of all joints whose angles contain the reading of ``row``, by its errors
    ``columns`` (n, p) [rad].
    """
    chain = state.arm.chain
    ratios = chain.drive.matrix @ state.arm.coupling_matrix[:, state.joint(row)]
    joints = zip(chain.joint_rows(), ratios.tolist(), strict=True)
    return [about_axis(state, joint, ratio * columns) for joint, ratio in joints if ratio]


def twist(linear: Array | None = None, angular: Array | None = None) -> Array:
    """The columns ``(n, 6, p)`` of a displacement in the axes of the place.

    Args:
        linear: translation per unit of each parameter ``(n, 3, p)`` [m/unit]; None for zero.
        angular: rotation per unit of each parameter ``(n, 3, p)`` [rad/unit]; None for zero.
    """
    present = linear if linear is not None else angular
    assert present is not None
    halves = [np.zeros_like(present) if half is None else half for half in (linear, angular)]
    return np.concatenate(halves, axis=1)


def extra_uncertainty_effects(effect: Effect) -> tuple[Effect, ...]:
    """Effects with value zero, whose u is the uncertainty beyond that of the values."""
    nonlinear = effect.nonlinear
    terms = nonlinear.extrapolation_terms(effect)
    if effect.nonlinear_u and nonlinear.prior_sd(effect):
        return (*terms, NonlinearSensitivity(base=effect, u=(effect.nonlinear_u,)))
    return terms


@dataclass(frozen=True, eq=False, kw_only=True)
class UncertaintyOf(Effect):
    """An uncertainty of a cause beyond the u of its values."""

    base: Effect
    cause = "uncertainty"

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions that the cause needs."""
        return self.base.needs

    @property
    def label(self) -> str:
        """Label of the cause."""
        return self.base.label

    @property
    def key(self) -> str:
        """Key of the cause."""
        return self.base.key

    @property
    def row(self) -> int | None:
        """DH row of the cause."""
        return self.base.row


class NonlinearSensitivity(UncertaintyOf):
    """Deviation of a nonlinear parameter, such as a time constant."""

    cause = "nonlinear_sensitivity"

    @property
    def terms(self) -> tuple[Term, ...]:
        """The nonlinear parameter."""
        nonlinear = self.base.nonlinear
        name = nonlinear.field
        typical = nonlinear.value(self.base)
        return (Term(name, nonlinear.unit, typical, name),)

    def displacements(self, state: State) -> list[Displacement]:
        """The derivative by the nonlinear parameter."""
        nonlinear = self.base.nonlinear
        values = np.array(self.base.values)
        value = nonlinear.value(self.base)
        step = RELATIVE_STEP * value
        above = nonlinear.at(self.base, value + step).displacements(state)
        below = nonlinear.at(self.base, value - step).displacements(state)
        slopes = []
        for upper, lower in zip(above, below, strict=True):
            slope = (upper.columns - lower.columns) @ values / (2 * step)
            slopes.append(Displacement(upper.place, slope[..., None]))
        return slopes
