"""The table of runs: JSON lines that are appended as runs end, so that a study can be stopped and taken up again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

Row = dict[str, Any]


class Results:
    """File of rows; a later row of the same experiment and seed stands for the earlier one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[tuple[str, int], Row] = {}
        for number, row in _lines(path):
            if row is None:
                tqdm.write(f"{path}:{number}: not a whole row (a run that was cut off); it is run again")
            else:
                self.rows[row["experiment"], row["seed"]] = row

    def add(self, row: Row) -> None:
        """Written at once; a torn line of an earlier study is ended first."""
        self.rows[row["experiment"], row["seed"]] = row
        torn = self.path.exists() and self.path.read_bytes()[-1:] not in (b"", b"\n")
        with self.path.open("a", encoding="utf-8") as file:
            file.write("\n" * torn + json.dumps(row) + "\n")

    def has(self, key: tuple[str, int], fresh: bool, retry: bool = False) -> bool:
        """Whether the run is there, with the gain on fresh data where that is asked; ``retry``: and without an error."""
        row = self.rows.get(key)
        if row is None or (retry and row["error"] is not None):
            return False
        return not fresh or row["fresh"] is not None or row["error"] is not None


def _lines(path: Path) -> Iterator[tuple[int, Row | None]]:
    if path.exists():
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                yield number, json.loads(line)
            except json.JSONDecodeError:
                yield number, None
