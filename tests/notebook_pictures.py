"""The cells of notebooks that draw, and those whose outputs have no picture.

``python -m tests.notebook_pictures FOLDER`` looks at the executed notebooks of a folder.
"""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any

DRAWING = re.compile(r"plot(_\w+)?|subplots|figure")
"""Names of functions and methods that draw."""


def draws(source: str) -> bool:
    """Whether a cell draws, functions that it defines left out."""
    statements = [s for s in ast.parse(source).body if not isinstance(s, ast.FunctionDef)]
    nodes = [node for statement in statements for node in ast.walk(statement)]
    calls = [ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call)]
    return any(DRAWING.fullmatch(name.rpartition(".")[2]) for name in calls)


def missing(notebook: dict[str, Any]) -> list[str]:
    """The cells of an executed notebook that draw, and show no picture."""
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return [
        f"{cell['id']}: no picture; expected one at least"
        for cell in cells
        if draws("".join(cell["source"]))
        and not any("image/png" in output.get("data", {}) for output in cell["outputs"])
    ]


def main() -> None:
    """Name the cells without their pictures, and fail if there are any, or no notebooks."""
    paths = sorted(Path(sys.argv[1]).glob("*.ipynb"))
    if not paths:
        sys.exit(f"{sys.argv[1]}: no notebooks; expected some")
    faults = []
    for path in paths:
        notebook = json.loads(path.read_text(encoding="utf-8"))
        faults += [f"{path.name}: {fault}" for fault in missing(notebook)]
    sys.exit("\n".join(faults) or None)


if __name__ == "__main__":
    main()
