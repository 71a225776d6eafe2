"""What every cause of error is: a small displacement of some places of the arm, linear in a few parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from numbers import Integral
from typing import Any, ClassVar, Self, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from aacmm_pin._support.checks import Array
from aacmm_pin._support.shown import Shown
from aacmm_pin.arm.chain import axis
from aacmm_pin.arm.parameter import Parameter, Scope
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, UnknownNameError


@dataclass(frozen=True)
class Term:
    """One parameter of a cause.

    Attributes:
        name: what tells it from the other parameters of its cause; "" where there is one.
        unit: SI unit.
        typical: usual magnitude on a measuring arm of 1 to 2.5 m [unit].
        key: how files write it, with their unit.
        scale: one of the file's units in SI.
    """

    name: str
    unit: str
    typical: float
    key: str
    scale: float = 1.0


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
    that prediction, calibration and diagnosis need. Where the physics is not linear it states :meth:`exact` too.

    Attributes:
        values: of the parameters, in the order of ``terms``; () means all zero [SI].
        u: their standard uncertainties; () means zero [SI].
    """

    cause: ClassVar[str]
    """Name of the cause."""
    elastic: ClassVar[bool] = False
    """True where the displacement depends on where the arm is, and so on all the other displacements."""
    of_reference: ClassVar[bool] = False
    """True where it is not the arm that is off but the coordinates it is compared with."""
    scope: ClassVar[Scope] = "arm"

    values: tuple[float, ...] = ()
    u: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            where = getattr(self, field.name)
            if field.name not in ("joint", "link") or where is field.default:
                continue
            if isinstance(where, bool) or not isinstance(where, Integral) or where < 1:
                raise AacmmError(f"{self.cause}: {field.name} is {where!r}, expected the number of a row, from 1")
        for name in ("values", "u"):
            numbers = tuple(float(value) for value in getattr(self, name)) or (0.0,) * len(self.terms)
            if len(numbers) != len(self.terms) or not np.isfinite(numbers).all():
                raise AacmmError(f"{self.label}: {name} is {numbers}, expected {len(self.terms)} finite numbers")
            object.__setattr__(self, name, numbers)
        if any(u < 0 for u in self.u):
            raise AacmmError(f"{self.label}: u is {self.u}, expected numbers that are not negative")

    @property
    def needs(self) -> tuple[str, ...]:
        """Conditions without which the effect cannot be told, see :class:`aacmm_pin.effects.conditions.Conditions`."""
        return ()

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

    def known(self, state: State) -> NDArray[np.bool_]:
        """(n,) True for the records in which the effect is known; here: all of them."""
        return np.ones(state.n, dtype=bool)

    def exact(self, state: State) -> list[tuple[int, Array]]:
        """Displacements at the values, place and twist (n, 6), by exact physics; here: the linear ones."""
        return [(d.place, d.columns @ np.array(self.values)) for d in self.displacements(state)]

    @classmethod
    def structure(cls) -> tuple[str, ...]:
        """Names of the fields that say which one it is: ``joint``, ``order``, …"""
        return tuple(f.name for f in fields(cls) if f.name not in ("values", "u"))

    def inner_widths(self) -> dict[str, float]:
        """Fields with a continuous value that records may tell, and how far off each may be before they do."""
        return {}

    @property
    def label(self) -> str:
        """The cause and where it sits, such as ``encoder_gain:5``."""
        where = next((getattr(self, name) for name in ("joint", "link", "seat", "marker") if hasattr(self, name)), None)
        return self.cause if where is None else f"{self.cause}:{where}"

    @property
    def key(self) -> str:
        """The label with what tells several of one cause at one place apart: ``joint_periodic_error:6,order=7``."""
        inner = [f"{n}={getattr(self, n):g}" for n in ("order", "time_s", "time_constant_s") if hasattr(self, n)]
        return ",".join([self.label, *inner])

    @property
    def row(self) -> int | None:
        """The DH row it belongs to; None for causes of the whole arm."""
        where = getattr(self, "joint", getattr(self, "link", None))
        return None if where is None else int(where)

    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters with their values and uncertainties."""
        names = [f"{self.key}.{t.name}" if t.name else self.key for t in self.terms]
        numbers = zip(names, self.terms, self.values, self.u, strict=True)
        return tuple(Parameter(n, self.cause, self.row, t.unit, value, None, u, self.scope) for n, t, value, u in numbers)

    def at(self, values: Array | tuple[float, ...], u: Array | tuple[float, ...] = ()) -> Self:
        """The same cause with other values."""
        return replace(self, values=tuple(values), u=tuple(u))

    def sensitivity(self, state: State) -> Array:
        """∂(position of the target)/∂parameters: (n, 3, p) [m/unit]. Places behind the target do not matter to it."""
        total = np.zeros((state.n, 3, len(self.terms)))
        for d in self.displacements(state):
            if d.place <= state.target:
                total += moved(state, d)
        return total

    def described(self) -> dict[str, float]:
        """The values as files and people write them."""
        return {t.key: value / t.scale for t, value in zip(self.terms, self.values, strict=True)}

    def described_jacobian(self) -> Array:
        """∂(described values)/∂(parameters), (described, p)."""
        return np.diag([1.0 / t.scale for t in self.terms])

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
        bare = cls(**{name: cls._checked(name, value) for name, value in structure.items()})
        values = bare.values_from(parameters)
        return bare.at(values, bare._by_key(uncertainty or {}))

    @classmethod
    def _checked(cls, name: str, value: Any) -> Any:
        """A field as a file states it, if it has the type that the class declares."""
        adapter = TypeAdapter(get_type_hints(cls)[name], config=ConfigDict(strict=True, allow_inf_nan=False))
        try:
            return adapter.validate_python(tuple(value) if isinstance(value, list) else value)
        except ValidationError as error:
            expected = error.errors()[0]["msg"].removeprefix("Input should be ")
            raise AacmmError(f"{cls.cause}: {name} is {value!r}, expected {expected}") from None

    def values_from(self, parameters: Mapping[str, float]) -> tuple[float, ...]:
        """Values from what a file says; what it leaves out is zero."""
        return self._by_key(parameters)

    def _by_key(self, parameters: Mapping[str, float]) -> tuple[float, ...]:
        keys = [t.key for t in self.terms]
        for key in parameters:
            if key not in keys:
                raise UnknownNameError(f"parameter of {self.label}", key, keys)
        return tuple(float(parameters.get(t.key, 0.0)) * t.scale for t in self.terms)


def moved(state: State, displacement: Displacement) -> Array:
    """What a displacement does to the target: ``R (v + ω × r)``, r the target seen from the place: (n, 3, p)."""
    place, columns = displacement.place, displacement.columns
    lever = state.in_axes_of(place, state.position - state.origin[place])
    v, w = columns[:, :3], columns[:, 3:]
    local = v + np.cross(w, lever[:, :, None], axis=1) if w.any() else np.broadcast_to(v, (state.n, *v.shape[1:]))
    return np.asarray(state.rotation[place] @ local)


def about_axis(state: State, row: int, columns: Array) -> Displacement:
    """Body ``row`` turned about its joint by ``columns`` (n, p) [rad]; shifted along it where the joint slides."""
    component = 2 if state.arm.chain.prismatic[state.joint(row)] else 5
    # Component by component, so that the zeros of the others take no memory: nobody writes there.
    twists = np.zeros((6, *columns.shape)).transpose(1, 0, 2)
    twists[:, component] = columns
    return Displacement(axis(row), twists)


def twist(linear: Array | None = None, angular: Array | None = None) -> Array:
    """Columns (n, 6, p) from their halves (n, 3, p), of which one may be missing."""
    given = linear if linear is not None else angular
    assert given is not None
    halves = [np.zeros_like(given) if half is None else half for half in (linear, angular)]
    return np.concatenate(halves, axis=1)
