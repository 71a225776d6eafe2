"""``python -m tests.blind.study.page FOLDER … --table PAGE``: the page of the documentation with a
table for each family.
"""

from __future__ import annotations

import argparse
import inspect
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from blind.families import FAMILIES
from blind.study.outcomes import count, table
from blind.study.stored import stored
from tests.measured import DIAGNOSIS, ROOT, digest, head

Row = dict[str, Any]
FORM = """{head}

This page counts how often `diagnose` names the true cause in simulated files.

`python -m tests.blind.study --family NAME` simulates files of arms with hidden causes of error,
runs `aacmm-pin diagnose` on each file, and compares the result with the truth. The simulator
computes exact physics, and shares no code with this package. Each file also contains small errors
that the package does not model. `tests/blind/families.py` chooses arms, causes and records at
random.

`diagnose` names a cause if the probability of the cause is at least 0.5. A name is false if the
named cause is not hidden in the file. Intervals in parentheses are 95 % intervals.

| column | meaning |
|---|---|
| right | files in which `diagnose` names a hidden cause, or no cause if no cause is hidden |
| explained | files with a hidden cause and the verdict `explained` |
| explained, false name | files with the verdict `explained` and a false name |
| false alarms | files without hidden causes in which `diagnose` names a cause |
| hidden cause named | files with a hidden cause in which `diagnose` names a hidden cause |
| detectable causes named | share of the detectable hidden causes that `diagnose` names with a \
probability of at least 0.95 |
| distinct causes named | share of the detectable hidden causes without alias (λ ≥ 13) that \
`diagnose` names with a probability of at least 0.95 |
| files with false names | files in which `diagnose` names a cause that is not hidden |
| structure named | share of the files with an error that the library lacks (λ ≥ 50) in which \
`diagnose` names all quantities that the error depends on |
| names | number of named causes |
| stated minus true | mean stated probability of the named causes minus the share of true names |
| 0.5 to 0.8, … | mean stated probability of the named causes in this range, and share of true \
names |
| median CPU s | median CPU time of `diagnose` [s] |

Two causes count as the same cause if the cosine of their effects, after a refit of all other
parameters, is above 0.95. The number λ is the increase of χ² if the fit omits a cause or replaces
the cause by another cause. A hidden cause is detectable if the best test detects the cause with a
probability of at least 0.9. The best test knows all other errors, and gives a false alarm in 1 of
10 000 tests.

{tables}
"""


def main(words: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.study.page", description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="folders of studies")
    parser.add_argument("--table", type=Path, required=True, help="page to write")
    asked = parser.parse_args(words)
    rows: dict[tuple[str, int], Row] = {}
    for folder in asked.folders:
        rows |= stored(folder / "runs.jsonl", digest(*DIAGNOSIS))
    write(asked.table, [*rows.values()], f"{parser.prog} {' '.join(words)}")
    return 0


def write(path: Path, rows: Sequence[Row], command: str) -> None:
    """The page of these rows, which are of the present diagnosis code.

    Raises:
        ValueError: the package is not as it was committed.
    """
    words = ["git", "status", "--porcelain", "aacmm_pin"]
    if subprocess.run(words, cwd=ROOT, capture_output=True, check=True).stdout:
        raise ValueError(f"{path}: not written, the package has changes that are not committed")
    title = head("Diagnosis, measured", command, *DIAGNOSIS)
    text = FORM.format(head=title, tables="\n\n".join(tables(rows)))
    path.write_text(text, encoding="utf-8")


def tables(rows: Sequence[Row]) -> list[str]:
    """One for each family, with what its files are."""
    found = []
    for family, drawn in FAMILIES.items():
        if of_family := [row for row in rows if row["family"] == family]:
            found.append(f"## {family}\n\n{inspect.getdoc(drawn)}\n\n{table(count(of_family)[0])}")
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
