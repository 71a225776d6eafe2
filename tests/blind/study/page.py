"""The page of the documentation with the table of a study, and whether the diagnosis code has changed since."""

from __future__ import annotations

import subprocess
from datetime import datetime
from pathlib import Path

import pandas as pd

from blind.study import sources
from blind.study.outcomes import table

FORM = """# Diagnosis, measured

*This page is written by `{command}`; do not edit it.*

<!-- generated: study-age {digest} -->

| | |
|---|---|
| commit | `{commit}` |
| date | {date} |
| command | `{command}` |
| diagnosis code | `{digest}` |

`python -m tests.blind.study` hides faults in files that a plant without a line of this package makes (exact physics, small
unmodelled terms always on), asks `aacmm-pin diagnose` for each at the shell, and only then looks at the truth.

Files of many arms and kinds of evidence (`tests/blind/regimes.py`), by number of records. `sure and wrong`: of
the verdicts `explained`, those that name a cause that is neither hidden nor, by the cosine of the effects beside all that is
refitted (over 0.95), the same as a hidden one; an `inconclusive` verdict is an abstention. `hidden cause named`: one of the
hidden causes, or the same as one, is among the findings, whatever the verdict. `stated minus true`: mean of the stated
probabilities less the share of the names that are those of hidden causes: a probability is of this very name, so that one
which is only like a hidden cause does not count here.

{table}
"""


def write(path: Path, counted: pd.DataFrame, date: datetime, command: str) -> None:
    """The page of these figures, which are of the present diagnosis code.

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
        table=table(counted),
    )
    path.write_text(text, encoding="utf-8")


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=sources.ROOT, capture_output=True, text=True, check=True).stdout.strip()
