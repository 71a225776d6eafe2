"""The causes by name: those of the library, and registered ones."""

from __future__ import annotations

import inspect
import itertools
import re
import reprlib
import traceback
from collections.abc import Callable, Iterable, Iterator
from functools import cache, wraps
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from aacmm_pin.arm import Arm, GivenArm, as_arm
from aacmm_pin.effects import compliance, encoder, environment, geometry, time_dependent
from aacmm_pin.effects.conditions import CONDITION_COLUMNS, Records
from aacmm_pin.effects.effect import ROW_FIELDS, Effect, Term
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, CauseError, UnknownNameError

LIBRARY = (encoder, time_dependent, compliance, environment, geometry)


def _defined_in(module: ModuleType) -> Iterator[type[Effect]]:
    for value in vars(module).values():
        is_defined = isinstance(value, type) and value.__module__ == module.__name__
        if is_defined and issubclass(value, Effect) and "cause" in vars(value):
            yield value


CAUSES = {effect.cause: effect for module in LIBRARY for effect in _defined_in(module)}
"""Every cause by its name, in the order of trial."""

EXAMPLE_ROW = 3
EXAMPLE_LABEL = "A"
EXAMPLE_VALUE = 10.0

LARGEST_COLUMN = 1e12
"""Largest displacement per unit of a parameter of your own cause [m/unit, rad/unit]."""

_Own = TypeVar("_Own", bound=type[Effect])
_Method = Callable[[Any, State], list[Any]]


def register(cause: _Own) -> _Own:
    """Register a cause of your own by its name; use it as a decorator of the class.

    ``diagnose`` then tries the cause at the places that ``candidates`` returns. Plans, arm files,
    ``--cause``, pages and pictures accept it. At the shell, ``aacmm-pin --plugin MODULE …`` or an
    entry point in the group ``aacmm_pin.causes`` imports the module that registers it. A program
    must register the cause before it reads an arm file with it. A new definition of the same class,
    as in a notebook, replaces the old. Every result of ``displacements`` and ``exact`` is checked.

    Raises:
        AacmmError: the class is not an :class:`Effect`, or the name is invalid or already
            registered.
        CauseError: ``displacements`` is missing, or an attribute of the class is invalid.
    """
    if not (isinstance(cause, type) and issubclass(cause, Effect)):
        raise AacmmError(f"{cause!r} is no cause; expected a subclass of Effect")
    class_name = cause.__name__
    name = getattr(cause, "cause", None)
    if not (isinstance(name, str) and re.fullmatch("[a-z][a-z0-9_]*", name)):
        raise AacmmError(
            f"{class_name}: cause is {name!r}; expected lower-case letters, digits and _"
        )
    registered = CAUSES.get(name, cause)
    if (registered.__module__, registered.__qualname__) != (cause.__module__, cause.__qualname__):
        other = f"{registered.__module__}.{registered.__qualname__}"
        raise AacmmError(
            f"{class_name}: {other} has already registered the cause {name}; expected another name"
        )
    if cause.__abstractmethods__:
        lacking = ", ".join(sorted(cause.__abstractmethods__))
        raise CauseError(name, f"{class_name} lacks {lacking}; define these methods or properties")
    _check_attributes(cause)
    for method in ("displacements", "exact"):
        function = getattr(cause, method)
        if function is not Effect.exact and not hasattr(function, "__wrapped__"):
            setattr(cause, method, _checked(function, method))
    CAUSES[name] = cause
    return cause


def _check_attributes(cause: type[Effect]) -> None:
    terms = inspect.getattr_static(cause, "terms")
    are_terms = isinstance(terms, tuple) and {*map(type, terms)} == {Term}
    if not (are_terms or isinstance(terms, property)):
        raise CauseError(cause.cause, f"terms is {terms!r}; expected a tuple of Terms")
    needs = inspect.getattr_static(cause, "needs")
    are_columns = isinstance(needs, tuple) and {*needs} <= {*CONDITION_COLUMNS}
    if not (are_columns or isinstance(needs, property)):
        columns = ", ".join(CONDITION_COLUMNS)
        raise CauseError(cause.cause, f"needs is {needs!r}; expected a tuple of some of {columns}")


def _checked(method: _Method, name: str) -> _Method:
    """The method, with a :class:`CauseError` for every error in it or in its result."""
    file = method.__code__.co_filename

    @wraps(method)
    def checked(self: Effect, state: State) -> list[Any]:
        try:
            results = list(method(self, state))
            for result in results:
                _check(self, name, result, state)
        except AacmmError:
            raise
        except (Exception, SystemExit) as error:
            raise CauseError(self.label, f"{name}: {raised(error, file)}") from error
        return results

    return checked


def _check(effect: Effect, method: str, result: Any, state: State) -> None:
    shape: tuple[int, ...] = (6,)
    if method == "displacements":
        place, numbers, shape = result.place, result.columns, (6, len(effect.terms))
    else:
        place, numbers = result
    last = state.arm.chain.tip
    shapes = ((state.n, *shape), (1, *shape))
    if np.shape(numbers) not in shapes:
        came = f"{method}: the shape is {np.shape(numbers)}"
        raise CauseError(effect.label, f"{came}; expected {shapes[0]} or {shapes[1]}")
    if place not in range(last + 1):
        raise CauseError(effect.label, f"{method}: place is {place!r}; expected 0 to {last}")
    is_possible = np.abs(numbers) <= LARGEST_COLUMN
    if not is_possible.all():
        record = np.argwhere(~is_possible)[0, 0] + 1
        raise CauseError(
            effect.label,
            f"{method}: numbers that are not finite, or too large (first: record {record}); "
            f"expected finite numbers within ±{LARGEST_COLUMN:g}",
        )


def raised(error: BaseException, file: str) -> str:
    """An exception as one line, with the last line of ``file`` in its traceback."""
    position = ""
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename == file:
            position = f" ({Path(file).name}, line {frame.lineno})"
    text = str(traceback.TracebackException.from_exception(error))  # whatever its own __str__ does
    return f"{type(error).__name__}: {' '.join(text.split())}{position}"


def cause_named(name: str) -> type[Effect]:
    """The class of a cause.

    Raises:
        UnknownNameError: no cause has this name.
    """
    if name not in CAUSES:
        raise UnknownNameError(
            "cause",
            name,
            list(CAUSES),
            "for your own cause, state --plugin MODULE before the command, or in Python import the "
            "module",
        )
    return CAUSES[name]


def all_candidates(arm: GivenArm, records: Records | None = None) -> Iterator[tuple[Effect, ...]]:
    """Yield each possible cause at each possible place of an arm, as a tuple of variants to try.

    Causes that every calibration fits are omitted. The order is that of :data:`CAUSES`; neighbours
    with the same kind of place are grouped by place.

    Args:
        records: records that must show the causes; None for all that records could show.
    """
    arm = as_arm(arm)
    not_refitted = (cause for cause in CAUSES.values() if not cause.refitted)
    for _, kinds in itertools.groupby(not_refitted, key=lambda cause: cause.location_field()):
        candidates = [_candidates(cause, arm, records) for cause in kinds]
        in_order_of_kinds = itertools.chain.from_iterable(candidates)
        yield from sorted(in_order_of_kinds, key=lambda variants: variants[0].row or 0)


def _candidates(cause: type[Effect], arm: Arm, records: Records | None) -> list[tuple[Effect, ...]]:
    yielded = cause.candidates(arm, records)
    candidates = list(yielded) if isinstance(yielded, Iterable) else [yielded]
    for variants in candidates:
        effects = variants if isinstance(variants, tuple) else ()
        if not effects or not all(isinstance(effect, cause) for effect in effects):
            expected = f"expected tuples of one {cause.__name__} or more"
            came = f"candidates yields {reprlib.repr(variants)}"
            raise CauseError(cause.cause, f"{came}; {expected}")
    return candidates


@cache
def example(cause: type[Effect]) -> Effect | None:
    """An example of a cause in SINO6; None if the cause needs other fields than its place and the
    nonlinear parameter, and :meth:`Effect.default_fields` does not state them.
    """
    location = cause.location_field()
    place = EXAMPLE_ROW if location in ROW_FIELDS else EXAMPLE_LABEL
    required = cause.required_fields()
    values: dict[Any, Any] = {location: place, cause.nonlinear.field: EXAMPLE_VALUE}
    fields = {name: value for name, value in values.items() if name in required}
    fields |= cause.default_fields(fields, Arm.load("sino6"), ())
    return cause(**fields) if required <= {*fields} else None
