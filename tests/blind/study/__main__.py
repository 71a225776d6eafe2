"""``python -m tests.blind.study``: run, count, draw."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from pathlib import Path

from tqdm import tqdm

from blind.study import page, sources
from blind.study.experiments import EXPERIMENTS
from blind.study.report import report, version
from blind.study.runs import Task, perform, plain, start_worker
from blind.study.table import Results


def main(words: list[str]) -> int:
    # for the workers, before they load NumPy: threads of a BLAS cost more than they give on small matrices
    os.environ["OMP_NUM_THREADS"] = "1"
    asked = _arguments([e.name for e in EXPERIMENTS]).parse_args(words)
    asked.output.mkdir(parents=True, exist_ok=True)
    results, digest = Results(asked.output / "runs.jsonl"), sources.digest()
    tasks = []
    for experiment in EXPERIMENTS:
        if experiment.name in (asked.only or [e.name for e in EXPERIMENTS]):
            count = experiment.quick if asked.quick else max(1, round(asked.count * experiment.share))
            tasks += [Task(experiment, asked.skip + run, asked.fresh, asked.limit) for run in range(count)]
    chosen = {task.key for task in tasks}
    for task in tasks:  # a run of an experiment that has changed since is another run, as is one of other code for a table
        row = results.rows.get(task.key)
        changed = row is not None and row["arguments"] != plain(task.experiment.arguments(task.run))
        if changed or (row is not None and asked.table and row.get("sources") != digest):
            del results.rows[task.key]
    waiting = [task for task in tasks if not results.has(task.key, task.fresh and task.experiment.fresh, asked.retry)]
    if not asked.evaluate:
        run(waiting, results, asked.jobs, {"version": version(), "sources": digest})
    rows = [row for key, row in results.rows.items() if key in chosen]
    if not rows:
        print(f"{results.path}: no runs of what was asked", file=sys.stderr)
        return 1
    command = "python -m tests.blind.study " + " ".join(words)
    about = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "version": sorted({row["version"] for row in rows}),
    }
    report(rows, asked.output, about)
    if asked.table:
        page.write(asked.table, rows, about["date"], command)
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


def _arguments(names: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.study", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)}")
    parser.add_argument("--count", type=int, default=100, help="runs of each experiment (default 100)")
    parser.add_argument("--skip", type=int, default=0, help="start at this run: seeds that nobody has looked at")
    parser.add_argument("--quick", action="store_true", help="a small subset")
    parser.add_argument("--fresh", action="store_true", help="also measure gains on fresh data")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--limit", type=float, default=60.0, help="CPU seconds a command may take (default 60)")
    parser.add_argument("--retry", action="store_true", help="run again what ended in an error")
    parser.add_argument("--table", type=Path, help="page for the tables; runs of other diagnosis code are run again")
    parser.add_argument("--evaluate", action="store_true", help="run nothing, count what is there")
    parser.add_argument("-o", "--output", type=Path, default=Path("study"), help="folder (default ./study)")
    return parser


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
