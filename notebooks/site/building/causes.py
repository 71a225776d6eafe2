"""The table of all causes, from the package's own list of them."""

from __future__ import annotations

import inspect
import re

import numpy as np

from aacmm_pin import Arm
from aacmm_pin.effects import CAUSES, Effect, example, fields_of
from aacmm_pin.effects.conditions import CONDITION_COLUMNS, Conditions
from aacmm_pin.effects.state import State
from aacmm_pin.errors import MissingConditionError, UnsupportedArmError

PLACES = {
    "joint": "joint",
    "link": "tube or body",
    "seat": "seat",
    "marker": "target",
    "session": "session",
}
OPTIONAL = {
    "link": "whole arm, or one body",
    "marker": "tip, or one target",
    "session": "all records, or one session",
}


def causes_table() -> str:
    """Name, place, parameters, size, columns, aliases of every cause, as a Markdown table."""
    head = (
        "| cause (place) | parameters, typical magnitude | needs | aliases |\n|---|---|---|---|\n"
    )
    return head + "\n".join(f"| {' | '.join(_row(cause))} |" for cause in CAUSES.values())


def _row(cause: type[Effect]) -> list[str]:
    effect = example(cause)
    assert effect is not None
    inner = [
        f"`{name}`"
        for name in fields_of(cause)
        if name not in PLACES and name not in ("bodies", "torque")
    ]
    keys = [f"`{key}`" for key in effect.file_values()]
    shown = keys if len(keys) <= 6 else [keys[0], "…", keys[-1]]
    which = f"; fields {', '.join(inner)}" if inner else ""
    return [
        f"{{py:class}}`{cause.cause} <aacmm_pin.effects.{cause.__name__}>` ({_place(cause)})",
        f"{', '.join(shown)}, typically {_size(effect)}{which}",
        _needs(effect),
        _alike(cause),
    ]


def _place(cause: type[Effect]) -> str:
    site = cause.location_field()
    if site is None:
        return "whole arm"
    if cause.refitted and site == "joint":
        return "row"
    return OPTIONAL[site] if getattr(cause, site, "") is None else PLACES[site]


def _needs(effect: Effect) -> str:
    """Columns of the measurement file; and what an arm file without masses and stylus lacks."""
    columns = [f"`{CONDITION_COLUMNS[name]}`" for name in effect.needs]
    arm = Arm.load("zero6")
    assert arm.masses is None
    try:
        effect.displacements(State(arm, np.zeros((1, arm.nq)), Conditions(1), arm.chain.tip))
    except UnsupportedArmError as error:
        columns.append(
            "stylus axis in the arm file" if "stylus" in str(error) else "masses in the arm file"
        )
    except MissingConditionError:
        pass
    return ", ".join(columns) or "–"


def _size(effect: Effect) -> str:
    return ", ".join(
        dict.fromkeys(
            f"{term.typical / size:.3g} {unit}"
            for term in effect.terms
            for unit, size in [term.unit_read]
        )
    )


def _alike(cause: type[Effect]) -> str:
    """The sentence of the docstring that says what it is confused with."""
    text = " ".join((inspect.getdoc(cause) or "").split())
    found = re.search(r"Aliases: (.*?)(?:\.(?= [A-Z])|\.?$)", text)
    return found[1].replace("``", "`") if found else "–"
