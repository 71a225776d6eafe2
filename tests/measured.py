"""Of which code measurements are: what a page of them states at its head, so that it says by itself
when the code has changed since. Standard library alone.
"""

from __future__ import annotations

import ast
import hashlib
import subprocess
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIAGNOSIS = ("diagnosis", "effects")
"""Rooms of a diagnosis, and the causes, which are loaded when they are asked for."""


def commit(checkout: Path = ROOT) -> str:
    """The commit of a checkout, and whether files differ from it."""
    words = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=40"]
    done = subprocess.run(words, capture_output=True, text=True)
    return done.stdout.strip() or "unknown"


def head(title: str, command: str, *rooms: str, **facts: str) -> str:
    """Head of a page of measurements: title, command, whether the code of these rooms and of all
    that they import is still the measured one, and a table of commit, date and facts.
    """
    date = datetime.now(UTC).isoformat(timespec="seconds")
    rows = {"commit": f"`{commit()}`", "date": date, "code": f"`{digest(*rooms)}`"} | facts
    return "\n".join(
        [
            f"# {title}",
            "",
            f"*The command `{command}` writes this page. Do not edit the page.*",
            "",
            f"<!-- generated: code-age {digest(*rooms)} {' '.join(rooms)} -->",
            "",
            "| | |",
            "|---|---|",
            *(f"| {name} | {value} |" for name, value in rows.items()),
        ]
    )


@cache
def digest(*rooms: str) -> str:
    """Hash of every statement of the modules that some rooms need; where these stand, what they
    import, and all text is left out, so that moving code or saying something better does not make
    a measurement of it old.
    """
    found = hashlib.sha256()
    bare = (
        _Bare().visit(node)
        for path in modules(*rooms)
        if path.name != "__init__.py"
        for node in _parsed(path)
    )
    for statement in sorted(ast.dump(node) for node in bare if node is not None):
        found.update(statement.encode())
    return found.hexdigest()[:16]


class _Bare(ast.NodeTransformer):
    """Drops text and imports."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        return None if isinstance(node.value, ast.Constant) else self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("") if isinstance(node.value, str) else node

    def visit_Import(self, node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None


def _parsed(path: Path) -> list[ast.stmt]:
    return ast.parse(path.read_text(encoding="utf-8")).body


def modules(*rooms: str) -> set[Path]:
    """Files of these modules; imports inside functions, which draw pictures, do not count."""
    found: set[Path] = set()
    waiting = {path for room in rooms for path in (ROOT / "aacmm_pin" / room).glob("*.py")}
    while waiting:
        path = waiting.pop()
        found.add(path)
        waiting |= set(_imported(path)) - found
    return found


def _imported(path: Path) -> Iterator[Path]:
    for node in _parsed(path):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            if name.startswith("aacmm_pin."):
                place = ROOT / name.replace(".", "/")
                yield from (
                    p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()
                )
