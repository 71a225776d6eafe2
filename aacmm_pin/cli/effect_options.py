"""``--effect CAUSE:PLACE,parameter=value``: causes of error as they are typed."""

from __future__ import annotations

from typing import Annotated, Any, get_type_hints

import typer
from pydantic import TypeAdapter, ValidationError

from aacmm_pin.effects import CAUSES, Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.planning.causes import PLACES

EffectTexts = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="CAUSE[:PLACE][,NAME=VALUE…]",
        help="A cause of error, such as encoder_eccentricity:3,amplitude_rad=1e-4; may be given several times.",
    ),
]


def effects_of(texts: list[str] | None) -> list[Effect]:
    """The effects that the options name.

    Raises:
        UnknownNameError: an unknown cause, field or parameter; lists the known.
        AacmmError: a value is missing or of no use.
    """
    return [_effect(text) for text in texts or []]


def known_effects(texts: list[str] | None, model: ErrorModel) -> list[Effect]:
    """The same; one without parameters takes those that ``model`` has for it."""
    found = []
    for effect in effects_of(texts):
        same = [e for e in model.effects if type(e) is type(effect) and e.at(()) == effect]
        found.append(same[0] if same else effect)
    return found


def check_rows(effects: list[Effect], model: ErrorModel) -> None:
    """Refuse an effect on a row that the arm does not have.

    Raises:
        AacmmError: there is one.
    """
    rows = model.arm.chain.rows
    for effect in effects:
        if effect.row is not None and effect.row > rows:
            raise AacmmError(f"--effect {effect.label}: {model.arm.name} has rows 1 to {rows}")


def _effect(text: str) -> Effect:
    cause, _, rest = text.partition(":")
    if cause not in CAUSES:
        raise UnknownNameError("cause", cause, list(CAUSES), "as in --effect encoder_gain:3,gain=1e-5")
    kind = CAUSES[cause]
    structure: dict[str, Any] = {}
    parameters: dict[str, float] = {}
    for item in filter(None, rest.split(",")):
        name, equals, value = item.partition("=")
        if not equals and not structure and not parameters:  # the place alone, as in encoder_gain:3
            name, equals, value = next((n for n in PLACES if n in kind.structure()), ""), "=", item
        if not (equals and name):
            raise AacmmError(f"--effect {text}: {item!r} has no value, expected NAME=VALUE")
        if name in structure or name in parameters:
            raise AacmmError(f"--effect {text}: {name} is there twice")
        if name in kind.structure():
            structure[name] = _field(kind, name, value)
        else:
            parameters[name] = _number(text, name, value)
    try:
        return kind.from_description(structure, parameters)
    except UnknownNameError as error:
        raise UnknownNameError(f"name for {cause}", error.name, [*kind.structure(), *error.known]) from None
    except AacmmError as error:
        raise AacmmError(f"--effect {text}: {error}") from None


def _field(kind: type[Effect], name: str, value: str) -> Any:
    """The text as the type that the cause declares; the text itself where it is none, so that the cause complains of it."""
    declared = get_type_hints(kind)[name]
    try:
        return TypeAdapter(declared).validate_python(value.split("+") if "tuple" in str(declared) else value)
    except ValidationError:
        return value


def _number(text: str, name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise AacmmError(f"--effect {text}: {name} is {value!r}, expected a number") from None
