"""The pictures that cells of notebooks promise, and those that their outputs have.

``python -m tests.notebook_pictures FOLDER`` looks at the executed notebooks of a folder.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NEW_FIGURE = ("subplots", "figure")
"""What makes a figure of pyplot."""
PYPLOT = "plt"
"""Draws on the figure that it made last; all it draws in a cell is one picture, if the cell makes
no figure.
"""
DRAWS = "plot"
"""Methods of this name, and functions whose names begin with it, draw on axes they are given or on
a new figure.
"""


def promised(source: str) -> int:
    """Number of pictures that a cell shows at least: one for each statement that makes a figure,
    functions left out.
    """
    tree = ast.parse(source)
    own = {
        name.id
        for statement in tree.body
        if isinstance(statement, ast.Assign)
        and any(_called(call) in NEW_FIGURE for call in _calls(statement))
        for target in statement.targets
        for name in ast.walk(target)
        if isinstance(name, ast.Name)
    }
    made = sum(
        any(_makes_figure(call, own | {PYPLOT}) for call in _calls(statement))
        for statement in tree.body
    )
    by_pyplot = any(
        _makes_figure(call, own) for statement in tree.body for call in _calls(statement)
    )
    return made or int(by_pyplot)


def missing(notebook: dict[str, Any]) -> list[str]:
    """The cells of an executed notebook that show fewer pictures than they promise."""
    found = []
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        expected = promised("".join(cell["source"]))
        shown = sum("image/png" in output.get("data", {}) for output in cell["outputs"])
        if shown < expected:
            found.append(f"{cell['id']}: pictures: {shown}; expected at least {expected}")
    return found


def _calls(statement: ast.stmt) -> Iterator[ast.Call]:
    """The calls that a statement makes."""
    left: list[ast.AST] = [statement]
    while left:
        node = left.pop()
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.Call):
            yield node
        left += ast.iter_child_nodes(node)


def _called(call: ast.Call) -> str:
    """The last name of what is called."""
    match call.func:
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return ""


def _makes_figure(call: ast.Call, own: set[str]) -> bool:
    """Whether a call makes a figure; not one that draws on axes it is given, or on the cell's
    ``own``.
    """
    name = _called(call)
    if name in NEW_FIGURE:
        return True
    if name != DRAWS and not name.startswith(f"{DRAWS}_"):
        return False
    on = call.func.value if isinstance(call.func, ast.Attribute) else None
    names = {node.id for node in ast.walk(on) if isinstance(node, ast.Name)} if on else set()
    return not names & own and not any(keyword.arg == "ax" for keyword in call.keywords)


def main() -> None:
    """Name the cells without their pictures, and fail if there are any, or no notebooks."""
    paths = sorted(Path(sys.argv[1]).glob("*.ipynb"))
    found = [
        f"{p.name}: {fault}"
        for p in paths
        for fault in missing(json.loads(p.read_text(encoding="utf-8")))
    ]
    sys.exit(
        "\n".join(found)
        if found
        else None
        if paths
        else f"{sys.argv[1]}: no notebooks; expected some"
    )


if __name__ == "__main__":
    main()
