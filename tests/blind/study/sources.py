"""Which code a diagnosis is: the modules that ``aacmm_pin.diagnosis`` imports, as one short hash. Standard library alone."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[3]
START = "aacmm_pin.diagnosis"


def digest() -> str:
    """Of the text of every module that diagnosis needs, itself included."""
    found = hashlib.sha256()
    for path in sorted(modules()):
        found.update(f"{path.relative_to(ROOT).as_posix()}\n".encode() + path.read_bytes())
    return found.hexdigest()[:16]


def modules() -> set[Path]:
    """Files of these modules; imports inside functions, which draw pictures, do not count."""
    package = ROOT / START.replace(".", "/")
    found: set[Path] = set()
    waiting = set(package.glob("*.py"))
    while waiting:
        path = waiting.pop()
        found.add(path)
        waiting |= set(_imported(path)) - found
    return found


def _imported(path: Path) -> Iterator[Path]:
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            if name.startswith("aacmm_pin."):
                place = ROOT / name.replace(".", "/")
                yield from (p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file())
