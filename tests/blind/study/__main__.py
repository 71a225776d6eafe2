"""``python -m tests.blind.study``: run, and count."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from aacmm_pin._support.workers import Workers, results
from blind.families import FAMILIES
from blind.study.outcomes import count, table
from blind.study.runs import Task, perform
from blind.study.stored import stored
from tests.measured import DIAGNOSIS, digest

FIRST = 100_000
"""Seed of the first file."""
Row = dict[str, Any]


def main(words: list[str]) -> int:
    # for the workers, before they load NumPy: threads of a BLAS cost more than they give on small
    # matrices
    os.environ["OMP_NUM_THREADS"] = "1"
    asked = _arguments().parse_args(words)
    asked.output.mkdir(parents=True, exist_ok=True)
    path, code = asked.output / "runs.jsonl", digest(*DIAGNOSIS)
    seeds = range(FIRST + asked.skip, FIRST + asked.skip + asked.count)
    there = {
        seed: row
        for (family, seed), row in stored(path, code).items()
        if family == asked.family and seed in seeds
    }
    tasks = [
        Task(seed, limit=asked.limit, family=asked.family) for seed in seeds if seed not in there
    ]
    rows = [*there.values(), *run(tasks, path, asked.jobs, {"sources": code})]
    counted, outcomes = count(rows)
    outcomes[~outcomes["right"]].to_csv(asked.output / "wrong.csv", index=False)
    print(table(counted))
    print(
        f"{len(rows)} runs; {int((~outcomes['right']).sum())} of them not answered right: "
        f"{asked.output / 'wrong.csv'}"
    )
    return 0


def run(tasks: list[Task], path: Path, workers: Workers, made_by: Row) -> list[Row]:
    """Rows are written as runs end, and the next study takes up what is there.

    ``workers`` work in main threads, as processes do and Dask's do not: a signal ends what takes
    too long.
    """
    rows = []
    with path.open("a", encoding="utf-8") as file, results(perform, tasks, workers) as worked:
        for _, row in tqdm(worked, total=len(tasks), unit="run", smoothing=0.05):
            rows.append(row | made_by)
            # An earlier study may have ended inside a line.
            file.write("\n" + json.dumps(rows[-1]) + "\n")
            file.flush()
    return rows


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.study", description=__doc__)
    parser.add_argument(
        "--family", choices=FAMILIES, default="regimes", help="kind of files (default regimes)"
    )
    parser.add_argument("--count", type=int, default=1000, help="files (default 1000)")
    parser.add_argument(
        "--skip", type=int, default=0, help="start at this one: seeds that nobody has looked at"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument(
        "--limit", type=float, default=60.0, help="CPU seconds a command may take (default 60)"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("study"), help="folder (default ./study)"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
