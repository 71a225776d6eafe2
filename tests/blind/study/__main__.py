"""``python -m tests.blind.study``: run, and count."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from pathlib import Path

from tqdm import tqdm

import aacmm_pin
from blind.study import page, sources
from blind.study.experiments import EXPERIMENTS
from blind.study.outcomes import count, table
from blind.study.results import Results
from blind.study.runs import Task, perform, plain, start_worker


def main(words: list[str]) -> int:
    # for the workers, before they load NumPy: threads of a BLAS cost more than they give on small matrices
    os.environ["OMP_NUM_THREADS"] = "1"
    asked = _arguments([e.name for e in EXPERIMENTS]).parse_args(words)
    asked.output.mkdir(parents=True, exist_ok=True)
    results, digest = Results(asked.output / "runs.jsonl"), sources.digest()
    tasks = []
    for experiment in EXPERIMENTS:
        if experiment.name in (asked.only or [e.name for e in EXPERIMENTS]):
            runs = range(asked.skip, asked.skip + max(1, round(asked.count * experiment.share)))
            tasks += [Task(experiment, number, asked.fresh, asked.limit) for number in runs]
    chosen = {task.key for task in tasks}
    for task in tasks:  # a run of an experiment that has changed since is another run, as is one of other code for a table
        row = results.rows.get(task.key)
        changed = row is not None and row["arguments"] != plain(task.experiment.arguments(task.run))
        if changed or (row is not None and asked.table and row.get("sources") != digest):
            del results.rows[task.key]
    waiting = [task for task in tasks if not results.has(task.key, task.fresh and task.experiment.fresh, asked.retry)]
    run(waiting, results, asked.jobs, {"version": _version(), "sources": digest})
    rows = [row for key, row in results.rows.items() if key in chosen]
    if not rows:
        print(f"{results.path}: no runs of what was asked", file=sys.stderr)
        return 1
    command = "python -m tests.blind.study " + " ".join(words)
    date = datetime.now(UTC).isoformat(timespec="seconds")
    counted, outcomes = count(rows)
    about = {"date": date, "command": command, "version": sorted({row["version"] for row in rows})}
    (asked.output / "study.json").write_text(json.dumps({"about": about, "figures": counted}, indent=1) + "\n")
    outcomes[~outcomes["right"]].to_csv(asked.output / "wrong.csv", index=False)
    print(table(counted))
    print(f"{len(rows)} runs; {int((~outcomes['right']).sum())} of them not answered right: {asked.output / 'wrong.csv'}")
    if asked.table:
        page.write(asked.table, rows, date, command)
    return 0


def run(tasks: list[Task], results: Results, jobs: int, made_by: dict[str, str]) -> None:
    """Rows, with the code that made them, are written as runs end; Ctrl-C waits for the runs under way and keeps them."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, initializer=start_worker) as pool:
        waiting = {pool.submit(perform, task) for task in tasks}
        try:
            for future in tqdm(as_completed(waiting.copy()), total=len(waiting), unit="run", smoothing=0.05):
                results.add(future.result() | made_by)
                waiting.remove(future)
        except KeyboardInterrupt:
            tqdm.write("stopping; the runs under way are waited for")
            pool.shutdown(cancel_futures=True)
            for future in waiting:
                if not future.cancelled():
                    results.add(future.result() | made_by)


def _version() -> str:
    """Of the package, with the commit where there is one."""
    command = ["git", "describe", "--always", "--dirty"]
    said = subprocess.run(command, cwd=sources.ROOT, capture_output=True, text=True, check=False).stdout.strip()
    return f"{aacmm_pin.__version__} {said}".strip()


def _arguments(names: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.study", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--count", type=int, default=100, help="runs of each experiment (default 100)")
    parser.add_argument("--skip", type=int, default=0, help="start at this run: seeds that nobody has looked at")
    parser.add_argument("--fresh", action="store_true", help="also measure gains on fresh data")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--limit", type=float, default=60.0, help="CPU seconds a command may take (default 60)")
    parser.add_argument("--retry", action="store_true", help="run again what ended in an error")
    parser.add_argument("--table", type=Path, help="page for the tables; runs of other diagnosis code are run again")
    parser.add_argument("-o", "--output", type=Path, default=Path("study"), help="folder (default ./study)")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
