"""The page of the documentation with the tables of a study, and whether the diagnosis code has changed since."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blind.study import sources
from blind.study.outcomes import count, table

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

One line for each experiment, by number of records where it varies; rates with their Wilson 95 % intervals. `sure and
wrong`: of the verdicts `explained`, those that name a cause that is neither hidden nor, by the cosine of the effects
beside all that is refitted (over 0.95), the same as a hidden one. `named where nothing is hidden`: an `inconclusive`
verdict is an abstention. `hidden cause named`: one of the hidden causes is among the findings, whatever the verdict;
`or one alike`: or the same as one (a free curve is not excused). `covariate named`: a cause outside the library leads
to the verdict `unexplained` with one of its covariates. `oracle names it`: the likeliest cause of an oracle that
knows noise, library and priors. `stated minus true`: mean of the stated probabilities less the share of the names
that are those of hidden causes, with its standard error: a probability is of this very name, so that one which is
only like a hidden cause does not count here. `within ± 1.96 u`: stated parameters of causes rightly named.

{table}
"""


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
        table=table(count(rows)[0]),
    )
    path.write_text(text, encoding="utf-8")


def _git(*words: str) -> str:
    return subprocess.run(["git", *words], cwd=sources.ROOT, capture_output=True, text=True, check=True).stdout.strip()
