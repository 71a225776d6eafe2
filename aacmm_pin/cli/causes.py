"""The causes of error that are known."""

from __future__ import annotations

import inspect
import re
from typing import Annotated

import pandas as pd
import typer

from aacmm_pin.cli.common import command, say
from aacmm_pin.effects import (
    CAUSES,
    CONDITION_COLUMNS,
    Effect,
    cause_in_words,
    cause_named,
    example,
    typical_magnitude_in_words,
)
from aacmm_pin.report import Document, Table, terminal


@command(
    "aacmm-pin causes",
    "aacmm-pin causes encoder_eccentricity",
)
def run(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Cause to describe. Default: all causes.")
    ] = None,
) -> None:
    chosen = list(CAUSES.values()) if name is None else [cause_named(name)]
    terminal.show(Document("Causes", [Table(pd.DataFrame([_row(cause) for cause in chosen]))]))
    if name is not None:
        say(re.sub(r":\w+:`~?([^`]*)`|``", r"\1", inspect.getdoc(chosen[0]) or ""))


def _row(cause: type[Effect]) -> dict[str, str]:
    """How to write a cause, with its place in capitals, and what it needs."""
    effect = example(cause)
    place_field, nonlinear_field = cause.location_field(), cause.nonlinear.field
    place = f":{place_field.upper()}" if place_field else ""
    parameters = [f"{nonlinear_field}=…"] if nonlinear_field else []
    magnitude, needs = "", ""
    if effect is not None:
        keys = list(effect.file_values())
        parameters += keys if len(keys) <= 6 else [keys[0], "…", keys[-1]]
        magnitude = typical_magnitude_in_words(effect)
        needs = ", ".join(CONDITION_COLUMNS[condition] for condition in effect.needs)
    return {
        "cause": f"{cause.cause}{place} ({cause_in_words(cause)})",
        "parameters": ", ".join(parameters),
        "typical magnitude": magnitude,
        "needs": needs,
    }
