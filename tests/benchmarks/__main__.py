"""Measure this package and its peers: ``python -m tests.benchmarks --json FILE --page
notebooks/site/speed.md``.

Each operation and its peers take turns in one run, and medians of CPU time count. Packages of
others are installed from PyPI on first use, each in an environment of its own below
``$XDG_CACHE_HOME/aacmm_pin/peers`` (or ``~/.cache``).
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy comes: one thread, as the loop in C has

from tests.benchmarks.operations import OPERATIONS, Table
from tests.measured import commit, head

ROOMS = ("accuracy", "calibration", "cli", "diagnosis", "postures")
"""Whose code, with all that these rooms import, is measured."""
PACKAGES = ("numpy", "scipy", "pin", "numba")
ABOUT = """\
This page compares the speed of the package with other packages and with plain loops in C. Times
are medians of CPU time on one thread, except if the task states elapsed time. The programs of a
task ran in turns.

`time ratio` is the time of this package (first row of the task) divided by the time of the row. If
the time ratio is below 1, this package is faster. Times do not contain the compilation of loops.
The time of a command contains its start.
"""


def machine() -> str:
    """Kind of processor and number of cores."""
    info = Path("/proc/cpuinfo")
    rows = info.read_text().splitlines() if info.exists() else []
    names = [row.split(":", 1)[1].strip() for row in rows if row.startswith("model name")]
    return (
        f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores, {platform.system()}"
    )


def version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "missing"


def page(report: dict[str, Any]) -> str:
    """The report as a page of the documentation."""
    versions = ", ".join(f"{name} {number}" for name, number in report["versions"].items())
    facts = {"machine": report["machine"], "versions": versions}
    title = head("Speed, measured", report["command"], *ROOMS, **facts)
    lines = [title, "", *ABOUT.splitlines()]
    for operation in report["operations"]:
        lines += ["", f"## {operation['title']}", ""]
        if operation["rows"]:
            lines += _table([_cells(row) for row in operation["rows"]])
        if operation["skipped"]:
            lines += ["", f"Skipped: {'; '.join(operation['skipped'])}."]
    return "\n".join(lines) + "\n"


def _cells(row: dict[str, Any]) -> dict[str, str]:
    return {
        "task": row["what"],
        "program": row["who"],
        "time": _seconds(row["cpu_s"]),
        "time ratio": _number(row["ours_over_this"]),
        "peak memory": _number(row["peak_bytes"], 1e6, " MB"),
        "target": _target(row),
    }


def _table(rows: list[dict[str, str]]) -> list[str]:
    """Rows as Markdown, without columns that have no value."""
    names = [name for name in rows[0] if any(row[name] for row in rows)]
    cells = [names, ["---"] * len(names), *([row[name] for name in names] for row in rows)]
    return [f"| {' | '.join(each)} |" for each in cells]


def _target(row: dict[str, Any]) -> str:
    if row["target"] is None:
        return ""
    most = (
        _number(row["target"]) if row["peak_bytes"] is None else _number(row["target"], 1e6, " MB")
    )
    return f"≤ {most}, {'reached' if row['reached'] else 'missed'}"


def _seconds(value: float | None) -> str:
    return _number(value, 1e-3, " ms") if value is None or value < 1 else _number(value, 1, " s")


def _number(value: float | None, unit: float = 1.0, name: str = "") -> str:
    return (
        ""
        if value is None
        else f"{value / unit:.3g}{name}"
        if value / unit < 1000
        else f"{value / unit:.0f}{name}"
    )


def main(words: Sequence[str]) -> None:
    parser = argparse.ArgumentParser("python -m tests.benchmarks", description=__doc__)
    parser.add_argument("--json", type=Path, required=True, metavar="FILE")
    parser.add_argument("--page", type=Path, metavar="FILE")
    parser.add_argument(
        "--only", nargs="+", choices=OPERATIONS, default=list(OPERATIONS), metavar="NAME"
    )
    parser.add_argument(
        "--quick", action="store_true", help="run the smallest sizes once, to test the command"
    )
    parser.add_argument("--long", action="store_true", help="also run tasks that need many minutes")
    given = parser.parse_args(words)
    given.json.parent.mkdir(parents=True, exist_ok=True)
    report: dict[str, Any] = {
        "commit": commit(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "command": shlex.join(["python", "-m", "tests.benchmarks", *words]),
        "versions": {
            "Python": platform.python_version(),
            **{name: version(name) for name in PACKAGES},
        },
        "operations": [],
    }
    for name in given.only:
        print(name, file=sys.stderr)
        table = Table(given.quick, given.long)
        OPERATIONS[name](table)
        report["operations"].append(
            {"name": name, "title": (OPERATIONS[name].__doc__ or name).strip(" .\n")}
            | table.as_dict(name)
        )
        # After each: a long run may be stopped.
        given.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        if given.page:
            given.page.write_text(page(report), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
