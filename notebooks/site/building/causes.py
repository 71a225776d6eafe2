"""The table of all causes, from the package's own list of them."""

from __future__ import annotations

import inspect
import re

from aacmm_pin.conditions import COLUMNS
from aacmm_pin.effects import CAUSES, Effect

PLACES = {
    "joint": "joint",
    "link": "tube or body",
    "seat": "seat",
    "marker": "target",
}
GEOMETRY = ("joint_zero_offset", "link_length", "joint_distance", "link_twist", "link_tilt", "joint_placement")
EXAMPLE = {"joint": 1, "link": 3, "order": 3.0, "time_s": 60.0, "time_constant_s": 1800.0, "seat": "A"}
EXAMPLE |= {"lower_rad": -3.0, "upper_rad": 3.0, "coefficients": 24}


def example(cause: type[Effect]) -> Effect:
    """One of its kind, for what cannot be asked of a class."""
    return cause(**{name: EXAMPLE[name] for name in cause.structure() if name in EXAMPLE})


def causes_table() -> str:
    """Name, place, parameters, size, columns, look-alikes of every cause, as a Markdown table."""
    head = "| cause | sits at | parameters | usual size | needs | looks like |\n|---|---|---|---|---|---|\n"
    return head + "\n".join(f"| {' | '.join(_row(cause))} |" for cause in CAUSES.values())


def _row(cause: type[Effect]) -> list[str]:
    effect = example(cause)
    place = next((words for name, words in PLACES.items() if name in cause.structure()), "whole arm")
    inner = [f"`{name}`" for name in cause.structure() if name not in PLACES and name not in ("bodies", "torque")]
    keys = [f"`{key}`" for key in effect.described()]
    shown = keys if len(keys) <= 6 else [keys[0], "…", keys[-1]]
    return [
        f"{{py:class}}`{cause.cause} <aacmm_pin.effects.{cause.__name__}>`",
        "row" if cause.cause in GEOMETRY else place,
        ", ".join([*shown, *(f"({name})" for name in inner)]),
        _size(effect),
        ", ".join(f"`{COLUMNS[name]}`" for name in effect.needs) or "–",
        _alike(cause),
    ]


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
