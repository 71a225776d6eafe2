"""A subcommand from its function, and options from dataclasses."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, get_type_hints

import typer

from aacmm_pin._support.text_escaping import without_notes

Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Show results, warnings and errors only."),
]


def command(*examples: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate the function of a subcommand; a parameter that is a dataclass stands for its
    fields.
    """

    def with_options(function: Callable[..., None]) -> Callable[..., None]:
        types = get_type_hints(function)
        groups: dict[str, Any] = {key: kind for key, kind in types.items() if is_dataclass(kind)}

        def run(quiet: bool, **typed: Any) -> None:
            for key, kind in groups.items():
                values = {field.name: typed.pop(field.name) for field in fields(kind)}
                typed[key] = kind(**values)
            with without_notes() if quiet else nullcontext():
                function(**typed)

        options = [*_options(function)]
        quiet = inspect.Parameter(
            "quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet
        )
        run.__signature__ = inspect.Signature([*options, quiet])  # type: ignore[attr-defined]
        run.__doc__ = function.__doc__
        run.examples = examples  # type: ignore[attr-defined]
        return run

    return with_options


def _options(function: Callable[..., Any]) -> Iterator[inspect.Parameter]:
    """Parameters, where fields replace those that are dataclasses."""
    types = get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        if is_dataclass(types[name]):
            yield from _options(types[name])
        else:
            yield parameter.replace(annotation=types[name], kind=parameter.KEYWORD_ONLY)
