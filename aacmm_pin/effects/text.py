"""Causes as text, in commands and in Python, and as entries of arm files."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from aacmm_pin._support.plausible import LARGEST_U_RATIO, MOST_TYPICAL, expected_words
from aacmm_pin._support.units import in_radians, number
from aacmm_pin.arm import Arm, DiscrepancyEntry, EffectEntry
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.effect import (
    Effect,
    fields_of,
    require_names,
    require_row,
    values_by_key,
)
from aacmm_pin.effects.registry import cause_named
from aacmm_pin.effects.smooth_discrepancy import Discrepancy, discrepancy_of
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, ArmFileError, UnknownNameError

if TYPE_CHECKING:
    from aacmm_pin.effects.error_model import ErrorModel

STRICT = ConfigDict(strict=True, allow_inf_nan=False)
VALUES_IN_TEXT = 6

AnyEffect = TypeVar("AnyEffect", bound=Effect)


def cause_of(text: str, model: ErrorModel, present: Collection[str] = ()) -> Effect:
    """The cause that a text states: ``cause[:place][,name=value…]``.

    Examples are ``joint_compliance:2`` and ``joint_periodic_error:6,order=7,amplitude_rad=2e-5``.
    Names are fields or parameters as in arm files; ``joint=2`` may replace the place. Values of
    names that end in ``_rad`` may have a unit: ``20urad``, ``1.65arcsec``, ``0.5mdeg``. Without
    parameters, the values are those of the same cause in the model, else zero, which means a
    typical magnitude.

    Args:
        model: arm with or without causes, for default values.
        present: conditions of the records (``Conditions.present``), for defaults of fields.

    Raises:
        UnknownNameError: a cause, field or parameter is unknown.
        AacmmError: a field is missing or invalid, or the arm does not have the row.
    """
    cause, *details = re.split("[:,]", text, maxsplit=1)
    kind = cause_named(cause)
    location = kind.location_field()
    fields = {}
    parameters = {}
    for number_of_item, item in enumerate(filter(None, ",".join(details).split(","))):
        name, equals, value = item.partition("=")
        if not equals and number_of_item == 0 and location is not None:  # as in encoder_gain:3
            name = location
            value = item
        elif not (equals and name):
            raise AacmmError(f"{text!r}: {item!r} has no value; expected {_form(kind)}")
        if name in fields or name in parameters:
            raise AacmmError(f"{text!r}: {name} occurs twice; expected each name once")
        if name in fields_of(kind):
            fields[name] = _field(kind, name, value)
        else:
            parameters[name] = _number(text, name, value)
    try:
        defaults = kind.default_fields(fields, model.arm, tuple(present))
        effect = require_row(effect_from(kind, defaults | fields, parameters), model.arm)
    except UnknownNameError as error:
        names = [*fields_of(kind), *error.known]
        raise UnknownNameError(f"parameter of {cause}", error.name, names, f"in {text!r}") from None
    except AacmmError as error:
        raise AacmmError(f"{error}; the form is {_form(kind)}") from None
    if not parameters:
        in_model = (other for other in model.effects if other.identity == effect.identity)
        effect = next(in_model, effect)
    return effect


def text_of(effect: Effect) -> str:
    """The text from which :func:`cause_of` makes the cause, with values if they are few."""
    if not any(effect.values) or len(effect.terms) > VALUES_IN_TEXT:
        return effect.key
    parameters = effect.file_values().items()
    values = ",".join(f"{name}={value:.4g}" for name, value in parameters)
    return f"{effect.key}{',' if ':' in effect.key else ':'}{values}"


def _field(kind: type[Effect], name: str, value: str) -> Any:
    """The text as the declared type; unchanged if impossible: the cause refuses it."""
    declared = get_type_hints(kind)[name]
    try:
        if name.endswith("_rad"):
            return in_radians(value)
        unchecked = value.split("+") if "tuple" in str(declared) else value
        return TypeAdapter(declared).validate_python(unchecked)
    except (ValidationError, ValueError):
        return value


def _number(text: str, name: str, value: str) -> float:
    is_angle = name.endswith("_rad")
    try:
        return in_radians(value) if is_angle else number(value)
    except ValueError:
        example = ", such as 8urad" if is_angle else ""
        raise AacmmError(f"{text!r}: {name} is {value!r}; expected a number{example}") from None


def _form(kind: type[Effect]) -> str:
    location = kind.location_field()
    field = kind.nonlinear.field
    place = f":{location.upper()}" if location else ""
    return f"{kind.cause}{place},{f'{field}=…,' if field else ''}NAME=VALUE"


def effect_from(
    kind: type[AnyEffect],
    stated: Mapping[str, Any],
    parameters: Mapping[str, float],
    uncertainty: Mapping[str, float] | None = None,
) -> AnyEffect:
    """The cause that a file states by fields, parameters and their u.

    Raises:
        UnknownNameError: the cause has no field or parameter of this name.
        AacmmError: a field is missing or invalid, or a number is implausible.
    """
    require_names(stated, fields_of(kind), f"field of {kind.cause}")
    missing = [name for name in fields_of(kind) if name not in stated and not hasattr(kind, name)]
    if missing:
        raise AacmmError(f"{kind.cause}: {', '.join(missing)} is missing; expected a value")
    declared = get_type_hints(kind)
    fields = {}
    for name, value in stated.items():
        try:
            fields[name] = TypeAdapter(declared[name], config=STRICT).validate_python(value)
        except ValidationError as error:
            expected = expected_words(error.errors()[0])
            came = reprlib.repr(value)
            raise AacmmError(f"{kind.cause}: {name} is {came}; expected {expected}") from None
    u = dict(uncertainty or {})
    nonlinear_u = float(u.pop(kind.nonlinear.field, 0.0))
    without_values = kind(**fields, nonlinear_u=nonlinear_u)
    values = without_values.from_file(parameters)
    return require_plausible(
        without_values.at(values, values_by_key(without_values, u, "uncertainty"))
    )


def require_plausible(effect: AnyEffect) -> AnyEffect:
    """The cause, after a check that a file can state its values and u.

    Raises:
        AacmmError: a value or u is implausibly large, or a ``positive`` value without u is below
            zero. Estimates, with u, may be negative.
    """
    for term, value, u in zip(effect.terms, effect.values, effect.u, strict=True):
        most = MOST_TYPICAL * term.typical if term.largest is None else term.largest
        _require_at_most(f"{effect.label}: {term.key}", value, most, term.scale)
        most_u = LARGEST_U_RATIO * term.typical
        _require_at_most(f"{effect.label}: u of {term.key}", u, most_u, term.scale)
        if term.positive and value < 0 and u == 0:
            came = f"{effect.label}: {term.key} is {value / term.scale:g}"
            raise AacmmError(f"{came}; expected 0 or more")
    return effect


def _require_at_most(name: str, number: float, most: float, scale: float) -> None:
    if abs(number) > most:
        raise AacmmError(f"{name} is {number / scale:g}; expected at most {most / scale:g}")


def entries_of(effects: Iterable[Effect]) -> dict[str, list[EffectEntry | DiscrepancyEntry]]:
    """The entries of effects in an arm file: causes, and the discrepancy."""
    entries: dict[str, list[EffectEntry | DiscrepancyEntry]] = {"effects": [], "discrepancy": []}
    for effect in effects:
        if isinstance(effect, Discrepancy):
            entries["discrepancy"].append(effect.filed())
            continue
        entry = {"cause": effect.cause, "parameters": effect.file_values()}
        for name in fields_of(type(effect)):
            value = getattr(effect, name)
            if value not in (None, ()):
                entry[name] = list(value) if isinstance(value, tuple) else value
        uncertainty = {}
        if any(effect.u):
            pairs = zip(effect.terms, effect.u, strict=True)
            uncertainty = {term.key: float(u / term.scale) for term, u in pairs}
        if effect.nonlinear_u:
            uncertainty[effect.nonlinear.field] = float(effect.nonlinear_u)
        entries["effects"].append(EffectEntry.model_validate(entry | {"uncertainty": uncertainty}))
    return entries


def effects_of_file(arm: Arm, path: str) -> tuple[Effect, ...]:
    """The effects in the file of an arm; ``path`` is its name in errors.

    Raises:
        ArmFileError: an entry is invalid.
    """
    if arm.file is None:
        return ()
    effects = []
    for section in ("effects", "discrepancy"):
        for k, entry in enumerate(getattr(arm.file, section), start=1):
            try:
                effects.append(_effect_of_entry(entry, arm))
            except (AacmmError, TypeError, ValueError) as error:
                is_name = getattr(error, "name", "") == getattr(entry, "cause", None)
                key = f"{section}[{k}]" + ".cause" * is_name
                raise ArmFileError(path, key, str(error)) from None
    return tuple(effects)


def _effect_of_entry(entry: EffectEntry | DiscrepancyEntry, arm: Arm) -> Effect:
    if isinstance(entry, EffectEntry):
        kind = cause_named(entry.cause)
        effect = effect_from(kind, entry.structure, entry.parameters, entry.uncertainty)
        for key, stated, expected in (
            ("parameters", entry.parameters, effect.file_values()),
            ("uncertainty", entry.uncertainty, [term.key for term in effect.terms]),
        ):
            missing = [name for name in expected if name not in stated]
            if stated and missing:
                came = f"{key} has only {', '.join(stated)}"
                raise AacmmError(f"{effect.label}: {came}; expected also {', '.join(missing)}")
        return require_row(effect, arm)
    discrepancy = require_plausible(discrepancy_of(entry))
    nothing = np.zeros(0)
    conditions = Conditions(0, time=nothing, temperature=nothing)
    discrepancy.displacements(State(arm, np.zeros((0, arm.nq)), conditions, arm.chain.tip))
    return discrepancy
