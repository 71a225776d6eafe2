"""Rows of earlier studies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def stored(path: Path, digest: str) -> dict[tuple[str, int], Row]:
    """Rows of the given diagnosis code in a file by family and seed; not the torn last line of a
    run that was cut off.
    """
    found: dict[tuple[str, int], Row] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row["sources"] == digest:
            found[row["family"], row["seed"]] = row
    return found
