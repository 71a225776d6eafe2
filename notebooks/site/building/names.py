"""Cross-references to the package: by any of the names that a thing has, and a warning where
nothing has the name.
"""

from __future__ import annotations

import builtins
import importlib
import pkgutil
from functools import cache
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import aacmm_pin

ABBREVIATED = {"np": "numpy", "pd": "pandas", "xr": "xarray"}


@cache
def modules() -> tuple[ModuleType, ...]:
    """The package and all that is in it."""
    found = [
        m.name
        for m in pkgutil.walk_packages(aacmm_pin.__path__, "aacmm_pin.")
        if not m.name.endswith("__main__")
    ]
    return (aacmm_pin, *map(importlib.import_module, found))


def things(name: str, inside: str | None) -> list[Any]:
    """What ``name`` may mean where the module or class ``inside`` is spoken of."""
    found = [_of(f"{place}.{name}") for place in (inside, None) if place] + [_of(name)]
    return [
        thing
        for thing in (*found, *(_attribute(module, name) for module in modules()))
        if thing is not None
    ]


def _of(name: str) -> Any:
    parts = name.split(".")
    parts[0] = ABBREVIATED.get(parts[0], parts[0])
    for count in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:count]))
        except (ImportError, ValueError):
            continue
        return _attribute(module, ".".join(parts[count:])) if count < len(parts) else module
    return _attribute(builtins, name)


def _attribute(thing: Any, name: str) -> Any:
    for part in name.split("."):
        fields = getattr(thing, "__dataclass_fields__", {})
        if not hasattr(thing, part) and part in fields:
            return fields[part]
        thing = getattr(thing, part, None)
    return thing


def _resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, shown: nodes.TextElement
) -> nodes.Node | None:
    if node.get("refdomain") != "py":
        return None
    where = ".".join(filter(None, [node.get("py:module"), node.get("py:class")]))
    found = things(node["reftarget"], where)
    domain = env.domains["py"]
    for thing in found:
        if name := documented(tuple(domain.objects)).get(id(thing)):
            return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, shown)
    return shown if found else None


@cache
def documented(names: tuple[str, ...]) -> dict[int, str]:
    """The name under which a thing is in the documentation."""
    return {
        id(thing): name
        for name in names
        if (thing := _of(name)) is not None and not isinstance(thing, int | str)
    }


def setup(app: Sphinx) -> dict[str, Any]:
    """Last of all who resolve."""
    app.connect("missing-reference", _resolve, priority=900)
    return {"parallel_read_safe": True}
