"""A room imports only rooms above it in the list, no two modules import each other, and only the
arm speaks to Pinocchio.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from itertools import chain
from pathlib import Path

import pytest

import aacmm_pin

pytestmark = pytest.mark.fast

ROOT = Path(aacmm_pin.__file__).parent
ROOMS = [
    "errors",
    "_support",
    "arm",
    "effects",
    "postures",
    "measurements",
    "accuracy",
    "calibration",
    "diagnosis",
    "planning",
    "verification",
    "report",
    "cli",
]
SPEAK_TO_PINOCCHIO = {"arm.arm", "arm.corrected_urdf", "arm.pinocchio_model", "arm.poses"}
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in ROOT.rglob("*.py")
}


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(path: Path, for_types: bool = True) -> Iterator[str]:
    """Dotted names of all that a module imports, wherever in its text; what types alone need may be
    left out.
    """
    statements = [
        node
        for node in tree_of(path).body
        if for_types or not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test))
    ]
    for node in chain.from_iterable(map(ast.walk, statements)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, path
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def module_of(name: str) -> str:
    """The module that a dotted name is, or is defined in."""
    inside = name.removeprefix("aacmm_pin.")
    above = inside.rpartition(".")[0]
    return next(
        m
        for m in (inside, f"{inside}.__init__", above, f"{above}.__init__", "__init__")
        if m in MODULES
    )


def test_rooms_import_in_their_order():
    assert {name.split(".")[0] for name in MODULES} == {*ROOMS, "__init__"}
    found = [
        f"{module} imports {name}"
        for module, path in MODULES.items()
        for name in imports(path)
        if name.startswith("aacmm_pin.") and module != "__init__"
        if ROOMS.index(name.split(".")[1]) > ROOMS.index(module.split(".")[0])
        or (module.split(".")[0], name.split(".")[1]) == ("planning", "diagnosis")
    ]
    assert found == []


def test_no_two_modules_import_each_other():
    inside = {
        module: {module_of(name) for name in imports(path, False) if name.startswith("aacmm_pin.")}
        - {module}
        for module, path in MODULES.items()
    }
    assert len([*TopologicalSorter(inside).static_order()]) >= len(MODULES)


def test_only_the_arm_speaks_to_pinocchio():
    found = {
        module
        for module, path in MODULES.items()
        if any(n.split(".")[0] == "pinocchio" for n in imports(path))
    }
    assert found <= SPEAK_TO_PINOCCHIO
