"""The table of all causes, from the package's own list of them."""

from __future__ import annotations

import inspect
import re

import numpy as np

from aacmm_pin import Arm
from aacmm_pin.effects import CAUSES, Effect
from aacmm_pin.effects.conditions import COLUMNS, Conditions
from aacmm_pin.effects.state import State
from aacmm_pin.errors import MissingConditionError, UnsupportedArmError

PLACES = {"joint": "joint", "link": "tube or body", "seat": "seat", "marker": "target"}
OPTIONAL = {"link": "whole arm, or one body", "marker": "tip, or one target"}
GEOMETRY = ("joint_zero_offset", "link_length", "joint_distance", "link_twist", "link_tilt", "joint_placement")
EXAMPLE = {"joint": 1, "link": 3, "order": 3.0, "time_s": 60.0, "time_constant_s": 1800.0, "seat": "A"}
EXAMPLE |= {"lower_rad": -3.0, "upper_rad": 3.0, "coefficients": 24}


def example(cause: type[Effect]) -> Effect:
    """One of its kind, for what cannot be asked of a class."""
    return cause(**{name: EXAMPLE[name] for name in cause.structure() if name in EXAMPLE})


def causes_table() -> str:
    """Name, place, parameters, size, columns, look-alikes of every cause, as a Markdown table."""
    head = "| cause, and where it sits | parameters, and their usual size | needs | looks like |\n|---|---|---|---|\n"
    return head + "\n".join(f"| {' | '.join(_row(cause))} |" for cause in CAUSES.values())


def _row(cause: type[Effect]) -> list[str]:
    effect = example(cause)
    inner = [f"`{name}`" for name in cause.structure() if name not in PLACES and name not in ("bodies", "torque")]
    keys = [f"`{key}`" for key in effect.described()]
    shown = keys if len(keys) <= 6 else [keys[0], "…", keys[-1]]
    which = f"; which one: {', '.join(inner)}" if inner else ""
    return [
        f"{{py:class}}`{cause.cause} <aacmm_pin.effects.{cause.__name__}>` ({_place(cause)})",
        f"{', '.join(shown)}: {_size(effect)}{which}",
        _needs(effect),
        _alike(cause),
    ]


def _place(cause: type[Effect]) -> str:
    name = next((name for name in PLACES if name in cause.structure()), None)
    if name is None:
        return "whole arm"
    if cause.cause in GEOMETRY:
        return "row"
    return OPTIONAL[name] if getattr(cause, name, "") is None else PLACES[name]


def _needs(effect: Effect) -> str:
    """Columns of the measurement file; and what an arm file without masses and stylus lacks."""
    columns = [f"`{COLUMNS[name]}`" for name in effect.needs]
    arm = Arm.load("zero6")
    assert arm.masses is None
    try:
        effect.displacements(State(arm, np.zeros((1, arm.nq)), Conditions(1), arm.chain.tip))
    except UnsupportedArmError as error:
        columns.append("stylus axis in the arm file" if "stylus" in str(error) else "masses in the arm file")
    except MissingConditionError:
        pass
    return ", ".join(columns) or "–"


def _size(effect: Effect) -> str:
    sizes = dict.fromkeys((term.typical, term.unit) for term in effect.terms)
    return ", ".join(_quantity(*size) for size in sizes)


def _quantity(value: float, unit: str) -> str:
    for prefix, factor in (("m", 1e-3), ("µ", 1e-6)):
        if unit.partition("/")[0] in ("rad", "m") and value >= factor:
            return f"{value / factor:g} {prefix}{unit}"
    return f"{value:.0e} {unit}".replace("e-0", "e-") if unit != "1" else f"{value:.0e}".replace("e-0", "e-")


def _alike(cause: type[Effect]) -> str:
    """The sentence of the docstring that says what it is confused with."""
    text = " ".join((inspect.getdoc(cause) or "").split())
    found = re.search(r"Confused with: (.*?)(?:\.(?= [A-Z])|\.?$)", text)
    return found[1].replace("``", "`") if found else "–"
