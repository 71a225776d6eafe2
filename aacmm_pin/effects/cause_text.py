"""A cause of error as people type it, in every command and in Python: ``cause[:place][,parameter=value…]``."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from aacmm_pin._support.units import in_radians, number
from aacmm_pin.effects.causes import cause_named
from aacmm_pin.effects.effect import Effect, require_row
from aacmm_pin.errors import AacmmError, UnknownNameError

if TYPE_CHECKING:
    from aacmm_pin.effects.error_model import ErrorModel

MOST_VALUES = 6
"""A text states the values of so many parameters at most."""


def cause_of(text: str, model: ErrorModel, present: Collection[str] = ()) -> Effect:
    """The cause that a text names, such as ``joint_compliance:2`` or ``joint_periodic_error:6,order=7,amplitude_rad=2e-5``.

    Names after the place are fields or parameters, as arm files have them; ``joint=2`` may stand for the place. What ends
    in ``_rad`` may carry a unit: ``amplitude_rad=20urad``, ``1.65arcsec``, ``0.5mdeg``. Without parameters it has the
    values of the same cause of the model, if there is one; else all are zero, which stands for a typical size.

    Args:
        text: cause, place, fields, parameters.
        model: the arm.
        present: conditions that the records state (``Conditions.present``), for fields that are left out.

    Raises:
        UnknownNameError: an unknown cause, field or parameter.
        AacmmError: a field is missing or of no use, or the arm has no such row.
    """
    cause, *rest = re.split("[:,]", text, maxsplit=1)
    kind = cause_named(cause)
    fields: dict[str, Any] = {}
    parameters: dict[str, float] = {}
    for item in filter(None, rest[0].split(",") if rest else ()):
        name, equals, value = item.partition("=")
        if not equals and not fields and not parameters and (site := kind.site()) is not None:
            name, value = site, item  # the place alone, as in encoder_gain:3
        elif not (equals and name):
            raise AacmmError(f"{text!r}: {item!r} has no value, expected {_form(kind)}")
        if name in fields or name in parameters:
            raise AacmmError(f"{text!r}: {name} is there twice")
        if name in kind.structure():
            fields[name] = _field(kind, name, value)
        else:
            parameters[name] = _number(text, name, value)
    try:
        completed = kind.completed(fields, model.arm, tuple(present))
        effect = require_row(kind.from_description(completed, parameters), model.arm)
    except UnknownNameError as error:
        raise UnknownNameError(f"name for {cause}", error.name, [*kind.structure(), *error.known], f"in {text!r}") from None
    except AacmmError as error:
        raise AacmmError(f"{text!r}: {error}; expected {_form(kind)}") from None
    same = [e for e in model.effects if e.identity == effect.identity]
    return same[0] if same and not parameters else effect


def stated_cause(text: str, model: ErrorModel) -> Effect:
    """The cause that a text names, with values as a person states them; estimated values may have either sign.

    Raises:
        UnknownNameError, AacmmError: see :func:`cause_of`; a negative value of a parameter that nature has above zero only.
    """
    effect = cause_of(text, model)
    try:
        return effect if effect in model.effects else effect.require_sign()
    except AacmmError as error:
        raise AacmmError(f"{text!r}: {error}") from None


def text_of(effect: Effect) -> str:
    """The text by which :func:`cause_of` finds a cause again, with its values where they are few."""
    if not any(effect.values) or len(effect.terms) > MOST_VALUES:
        return effect.key
    values = ",".join(f"{name}={value:.4g}" for name, value in effect.described().items())
    return f"{effect.key}{',' if ':' in effect.key else ':'}{values}"


def _field(kind: type[Effect], name: str, value: str) -> Any:
    """The text as the type that the cause declares; the text itself where it is none, so that the cause complains of it."""
    declared = get_type_hints(kind)[name]
    try:
        if name.endswith("_rad"):
            return in_radians(value)
        return TypeAdapter(declared).validate_python(value.split("+") if "tuple" in str(declared) else value)
    except (ValidationError, ValueError):
        return value


def _number(text: str, name: str, value: str) -> float:
    try:
        return in_radians(value) if name.endswith("_rad") else number(value)
    except ValueError:
        angle = ", or an angle such as 8urad or 1.65arcsec" if name.endswith("_rad") else ""
        raise AacmmError(f"{text!r}: {name} is {value!r}, expected a number{angle}") from None


def _form(kind: type[Effect]) -> str:
    site = kind.site()
    return ",".join(
        [f"{kind.cause}{f':{site.upper()}' if site else ''}", *(f"{name}=…" for name in kind.inner), "NAME=VALUE"]
    )
