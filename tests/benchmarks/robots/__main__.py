"""Diagnosis of files like those of real robots: ``python -m tests.benchmarks.robots``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy comes

from tests.benchmarks.robots.evaluation import evaluated, in_words
from tests.benchmarks.robots.robot import Robot

ROOT = Path(__file__).parents[3]
MIXED = "cep-lc pc-elp lcpe-c -cclpe eplc-c ccpel- p-ce-l l-pcce e-c-pl ---pc-".split()
ROBOTS = {f"c{seed}": f"{seed}:cccccc" for seed in range(1, 11)} | {
    f"m{seed}": f"{seed}:{forms}" for seed, forms in enumerate(MIXED, 11)
}


def robots(text: str) -> dict[str, Robot]:
    """``c1,4:cep-lc``: robots by their names."""
    return {name: _robot(ROBOTS.get(name, name)) for name in text.split(",")}


def _robot(text: str) -> Robot:
    seed, _, forms = text.partition(":")
    return Robot.of(int(seed), forms or "cccccc")


def main(words: Sequence[str]) -> None:
    parser = argparse.ArgumentParser("python -m tests.benchmarks.robots", description=__doc__)
    parser.add_argument("--robots", type=robots, default=",".join(ROBOTS))
    parser.add_argument(
        "--records", type=lambda text: [int(n) for n in text.split(",")], default="300,1200,2800"
    )
    parser.add_argument("--checkout", type=Path, default=ROOT)
    parser.add_argument("--no-cross-validation", action="store_true")
    given = parser.parse_args(words)
    for robot in given.robots.values():
        for records in given.records:
            row = evaluated(
                robot, records, given.checkout.resolve(), not given.no_cross_validation
            )
            print(in_words(row), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
