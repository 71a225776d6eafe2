"""Diagnosis of files like those of real robots: ``python -m tests.benchmarks.robots``.

A robot is a name (c1 to c10, m11 to m20) or SEED:FORMS, such as 4:cep-lc. A run that is stored for
the same code of the package is not repeated.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy comes

from tests.benchmarks.robots.evaluation import NEW, Row, digest, in_words, perform
from tests.benchmarks.robots.page import page
from tests.benchmarks.robots.robot import FORMS, Robot

ROOT = Path(__file__).parents[3]
MIXED = "cep-lc pc-elp lcpe-c -cclpe eplc-c ccpel- p-ce-l l-pcce e-c-pl ---pc-"
ROBOTS = {f"c{seed}": Robot.of(seed) for seed in range(1, 11)} | {
    f"m{seed}": Robot.of(seed, forms) for seed, forms in enumerate(MIXED.split(), 11)
}
KEY = ("package", "seed", "forms", "records", "cross_validation")
"""What makes a run another run."""


def robot(name: str) -> Robot:
    if name in ROBOTS:
        return ROBOTS[name]
    seed, _, forms = name.partition(":")
    forms = forms or "cccccc"
    if not seed.isdecimal() or len(forms) != 6 or not set(forms) <= set(FORMS):
        raise argparse.ArgumentTypeError(
            f"{name}: expected one of {', '.join(ROBOTS)}, or SEED:FORMS with six letters of "
            f"{''.join(FORMS)}"
        )
    return Robot.of(int(seed), forms)


def robots(text: str) -> list[Robot]:
    return [robot(name) for name in text.split(",")]


def lengths(text: str) -> list[int]:
    found = [int(number) for number in text.split(",")]
    if NEW in found:
        raise argparse.ArgumentTypeError(f"{text}: the file with {NEW} records has the new records")
    return found


def stored(path: Path) -> dict[tuple[object, ...], Row]:
    """Rows of earlier runs that ended well; not the torn last line of a run that was cut off."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if not row["error"]:
            found[key_of(row)] = row
    return found


def key_of(row: Row) -> tuple[object, ...]:
    return tuple(row[name] for name in KEY)


def main(words: Sequence[str]) -> None:
    parser = argparse.ArgumentParser("python -m tests.benchmarks.robots", description=__doc__)
    parser.add_argument("--robots", type=robots, default=[*ROBOTS.values()], metavar="NAME,…")
    parser.add_argument("--records", type=lengths, default=[300, 1200, 2800], metavar="N,…")
    parser.add_argument(
        "--checkout", type=Path, default=ROOT, help="folder with the package to test"
    )
    parser.add_argument(
        "--no-cross-validation", action="store_true", help="diagnose with this option"
    )
    parser.add_argument(
        "--limit", type=int, default=3600, help="CPU seconds of a command (default 3600)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/robots"), help="folder of runs.jsonl"
    )
    parser.add_argument("--page", type=Path, metavar="FILE", help="page to write")
    given = parser.parse_args(words)
    checkout, validated = given.checkout.resolve(), not given.no_cross_validation
    given.output.mkdir(parents=True, exist_ok=True)
    command = shlex.join(["python", "-m", "tests.benchmarks.robots", *words])
    path = given.output / "runs.jsonl"
    there, rows = stored(path), []
    for records in given.records:
        for one in given.robots:
            asked = {"package": digest(checkout), "seed": one.seed, "forms": one.forms}
            asked |= {"records": records, "cross_validation": validated}
            row = there.get(key_of(asked))
            if row is None:
                row = asked | perform(one, records, checkout, validated, given.limit)
                with path.open("a", encoding="utf-8") as file:
                    # An earlier run may have ended inside a line.
                    file.write("\n" + json.dumps(row) + "\n")
            rows.append(row)
            print(in_words(row), flush=True)
            if given.page:  # after each: a long run may be stopped
                given.page.write_text(page(rows, command), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
