"""``python -m tests.blind.study.page FOLDER … --table PAGE``: the page of the documentation with a
table for each family.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from blind.families import FAMILIES
from blind.study import sources
from blind.study.outcomes import count, table
from blind.study.stored import stored

Row = dict[str, Any]
FORM = """# Diagnosis, measured

*This page is written by `{command}`; do not edit it.*

<!-- generated: study-age {digest} -->

| | |
|---|---|
| commit | `{commit}` |
| date | {date} |
| command | `{command}` |
| diagnosis code | `{digest}` |

`python -m tests.blind.study --family NAME` hides faults in files that a plant without a line of
this package makes: exact physics, small unmodelled terms always on. It asks `aacmm-pin diagnose`
for each at the shell, and then looks at the truth.
`tests/blind/families.py` draws the files.

A cause is named if its probability is at least 0.5. Intervals cover 95 %.

| column | meaning |
|---|---|
| right | a hidden cause, or the same as one, is named; if nothing is hidden, nothing is named |
| explained | share of the files with a hidden cause that have the verdict `explained` |
| explained with a wrong cause | of these verdicts, those with a false name |
| named where nothing is hidden | a cause is named; an `inconclusive` verdict is an abstention |
| hidden cause named | one of the hidden causes, or the same as one, is named |
| causes seen, stated ≥ 0.95 | of the hidden causes that an oracle sees with power 0.9 |
| causes told apart, stated ≥ 0.95 | of these, those of which every other cause leaves λ ≥ 13 |
| files with false names | a name is not that of a hidden cause, nor the same as one |
| structure named | all covariates of the hidden structure are named; of structures with λ ≥ 50 |
| stated minus true | mean stated probability of findings less the share hidden under this name |
| 0.5 to 0.8, … | mean of the stated probabilities in this bin, and how many of them are true |

Two causes are the same if the cosine of their effects, beside all that is refitted, is above 0.95.
The oracle knows the structure outside the library, fits the other hidden causes, and has a false
alarm in 1 of 10 000 tests.

{tables}
"""


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.study.page", description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="folders of studies")
    parser.add_argument("--table", type=Path, required=True, help="page to write")
    asked = parser.parse_args(words)
    rows: dict[tuple[str, int], Row] = {}
    for folder in asked.folders:
        rows |= stored(folder / "runs.jsonl", sources.digest())
    write(asked.table, [*rows.values()], datetime.now(UTC), f"{parser.prog} {' '.join(words)}")
    return 0


def write(path: Path, rows: Sequence[Row], date: datetime, command: str) -> None:
    """The page of these rows, which are of the present diagnosis code.

    Raises:
        ValueError: the package is not as it was committed.
    """
    if _git("status", "--porcelain", "aacmm_pin"):
        raise ValueError(f"{path}: not written, the package has changes that are not committed")
    text = FORM.format(
        command=command,
        digest=sources.digest(),
        commit=_git("rev-parse", "HEAD"),
        date=date.isoformat(timespec="seconds"),
        tables="\n\n".join(tables(rows)),
    )
    path.write_text(text, encoding="utf-8")


def tables(rows: Sequence[Row]) -> list[str]:
    """One for each family, with what its files are."""
    found = []
    for family, drawn in FAMILIES.items():
        if of_family := [row for row in rows if row["family"] == family]:
            found.append(f"## {family}\n\n{drawn.__doc__}\n\n{table(count(of_family)[0])}")
    return found


def _git(*words: str) -> str:
    return subprocess.run(
        ["git", *words], cwd=sources.ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
