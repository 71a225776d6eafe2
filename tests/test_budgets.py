"""No room grows: tokens, sentences below the report and names from inner modules, room by room.

An addition that exceeds a number raises it by what the addition costs, and states the reason in
the commit message. Who makes a room smaller lowers it.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.test_rooms import MODULES, ROOMS, imports, tree_of

TOKENS: dict[str, int] = {
    "errors": 550,
    "_support": 7700,
    "arm": 21950,
    "effects": 28500,
    "postures": 19500,
    "measurements": 22700,
    "accuracy": 10700,
    "calibration": 48750,
    "diagnosis": 43700,
    "planning": 11750,
    "verification": 13350,
    "report": 41750,
    "cli": 17400,
}
"""Code without comments and docstrings: unlike lines, they do not fall when a line is packed
fuller. Each number is what the room had when it was set, with 3 % of slack.
"""
SENTENCES: dict[str, int] = {
    "_support": 2,
    "arm": 1,
    "effects": 1,
}
"""English of six words or more that is no docstring, is not raised and is no label: the report says
it. A label is what a class states of itself, such as ``words = "drift of a zero"``.
"""
INNER: dict[str, int] = {
    "calibration": 1,
    "diagnosis": 31,
    "report": 9,
    "cli": 3,
}
"""Names that a room takes from inner modules of other rooms, and not from their faces."""
CONSTANTS = 0
"""Names of module constants with several values."""

LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
SETS = (ast.Assign, ast.AnnAssign)
SAY_IT = ("report", "cli", "errors")
FREE = ("_support", "errors")
"""Rooms from whose modules everybody takes what is needed."""


def of_room(room: str) -> list[Path]:
    return [path for module, path in MODULES.items() if module.split(".")[0] == room]


def is_docstring(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def docstrings(tree: ast.Module) -> Iterator[ast.Expr]:
    """Of modules, classes and functions, and those behind attributes and constants."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            yield from filter(is_docstring, body)


def tokens(path: Path) -> int:
    said = {(node.lineno, node.col_offset) for node in docstrings(tree_of(path))}
    text = io.StringIO(path.read_text(encoding="utf-8"))
    code = (each for each in tokenize.generate_tokens(text.readline) if each.type not in LAYOUT)
    return sum(not (each.type == tokenize.STRING and each.start in said) for each in code)


def is_error(node: ast.AST) -> bool:
    """What is raised: here, by whoever asked for the error, or by ``problems.stop()``."""
    if not isinstance(node, ast.Call):
        return isinstance(node, ast.Raise)
    name = ast.unparse(node.func)
    return name.endswith("Error") or name.startswith("problems.")


def labels(tree: ast.Module) -> Iterator[ast.expr | None]:
    """What attributes in the bodies of classes are set to."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield from (each.value for each in node.body if isinstance(each, SETS))


def sentences(path: Path) -> int:
    tree = tree_of(path)
    said = {id(node.value) for node in docstrings(tree)} | set(map(id, labels(tree)))
    for error in filter(is_error, ast.walk(tree)):
        said |= {id(node) for node in ast.walk(error)}
    texts = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
    return sum(
        len(re.findall(r"[A-Za-z]{2,}", text.value)) >= 6 for text in texts if id(text) not in said
    )


def from_inner_modules(path: Path) -> int:
    room = path.relative_to(MODULES["__init__"].parent).parts[0].removesuffix(".py")
    taken = [name.split(".") for name in imports(path) if name.startswith("aacmm_pin.")]
    return sum(len(parts) > 3 and parts[1] not in (room, *FREE) for parts in taken)


MEASURES: dict[str, tuple[Callable[[Path], int], str]] = {
    "TOKENS": (tokens, "Delete what the addition makes superfluous"),
    "SENTENCES": (sentences, "Let the report say it"),
    "INNER": (from_inner_modules, "Import what the __init__ of the other room lists"),
}
"""What each table has the numbers of, and what to try before one is raised."""


def measured(measure: Callable[[Path], int]) -> dict[str, int]:
    rooms = [room for room in ROOMS if not (measure is sentences and room in SAY_IT)]
    return {room: sum(map(measure, of_room(room))) for room in rooms}


def advice(table: str, room: str, count: int) -> str:
    """What to do about a number that is exceeded."""
    _, first = MEASURES[table]
    budget = globals()[table].get(room, 0)
    return (
        f"{table}[{room!r}] in tests/test_budgets.py is {budget}, measured {count}. {first}; if "
        f"the addition needs it, write {count} there and state the reason in the commit message."
    )


@pytest.mark.parametrize("table", MEASURES)
def test_no_room_grows(table):
    measure, _ = MEASURES[table]
    budget = globals()[table]
    found = measured(measure)
    over = [advice(table, room, n) for room, n in found.items() if n > budget.get(room, 0)]
    if over:
        pytest.fail("\n".join(over), pytrace=False)


def test_a_constant_has_one_value():
    values = defaultdict[str, set[str]](set)
    for path in MODULES.values():
        for node in tree_of(path).body:
            targets = (
                node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            )
            names = [
                each.id
                for each in targets
                if isinstance(each, ast.Name) and each.id.lstrip("_").isupper()
            ]
            for name in names:
                values[name].add(ast.unparse(node.value))
    several = [name for name, each in values.items() if len(each) > 1]
    if len(several) > CONSTANTS:
        pytest.fail(
            f"CONSTANTS in tests/test_budgets.py is {CONSTANTS}, measured {len(several)}. Give the "
            f"new one of these another name: {', '.join(sorted(several))}",
            pytrace=False,
        )
