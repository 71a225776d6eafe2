"""The page of the documentation with the tables of a study, and whether the diagnosis code has changed since."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blind.study import sources
from blind.study.report import tables

FORM = """# Diagnosis, measured

*This page is written by `{command}`; do not edit it.*

<!-- generated: study-age {digest} -->

| | |
|---|---|
| commit | `{commit}` |
| date | {date} |
| command | `{command}` |
| diagnosis code | `{digest}` |
| experiments | {experiments} |

`python -m tests.blind.study` hides faults in files that a plant without a line of this package makes (exact physics, small
unmodelled terms always on), asks `aacmm-pin diagnose` for each at the shell, and only then looks at the truth.

{tables}"""


def write(path: Path, rows: Sequence[dict[str, Any]], date: str, command: str) -> None:
    """The page of these rows.

    Raises:
        ValueError: rows of other diagnosis code are among them, or the package is not as it was committed.
    """
    digest = sources.digest()
    if any(row.get("sources") != digest for row in rows):
        raise ValueError(f"{path}: not written, some runs are of other diagnosis code")
    if _git("status", "--porcelain", "aacmm_pin"):
        raise ValueError(f"{path}: not written, the package has changes that are not committed")
    experiments = ", ".join(f"`{name}`" for name in dict.fromkeys(row["experiment"] for row in rows))
    text = FORM.format(
        command=command,
        digest=digest,
        commit=_git("rev-parse", "HEAD"),
        date=date,
        experiments=experiments,
        tables=tables(rows),
    )
    path.write_text(text, encoding="utf-8")


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=sources.ROOT, capture_output=True, text=True, check=True).stdout.strip()
