"""Rows as a page of the documentation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tests.benchmarks.robots.evaluation import ACTS, SILENT, Row, score
from tests.benchmarks.robots.robot import NOISE_MM
from tests.measured import DIAGNOSIS, head

ABOUT = f"""\
`python -m tests.benchmarks.robots` writes files of simulated robots, runs `aacmm-pin diagnose` on
each file with the references in an unknown frame and the target at an unknown place, and compares
the names with the truth. Then `aacmm-pin correct` computes the tips of 2000 new records of the same
robot with the extended arm. The generator and the plain model share no code with the package.

A robot has a seed, and a letter for the encoder of each joint: c error curve of five waves,
e eccentricity, l ellipticity, p one periodic error, - no error. Joints 2 and 3 deflect under
weights, the tip drifts with the temperature, and a smooth field over the room displaces the tip.
No cause of the library describes the field. Each coordinate has noise of {NOISE_MM} mm, which the
files do not state.

A place is the encoder of a joint, the load of a joint, or the temperature. The displacement by a
place is the RMS displacement of the target after geometry, frame and target are fitted again.
Structure over the temperature counts as the place temperature.

| column | meaning |
|---|---|
| recalibrated, extended | RMS residual of the fitted records [mm] |
| new | RMS residual of new records, after a rigid registration [mm] |
| plain new | the same for the plain model: one free function of the angle of each joint, and \
gravity at joints 2 and 3 [mm] |
| floor | RMS distance that noise and field leave on new records if all places are known [mm] |
| found | places with a probability of at least 0.95, of the places that displace the target by \
more than {ACTS:g} mm |
| missed | the other places that displace the target by more than {ACTS:g} mm |
| false | named places that displace the target by less than {SILENT:g} mm |
| form | found places that have the name of the true cause, and no other name |
| CPU, peak | CPU time [s] and peak memory [MB] of `diagnose`, with its start |
"""


def page(rows: Sequence[Row], command: str) -> str:
    """The page of these rows, which a command measured."""
    rows = sorted(rows, key=lambda row: (not row["cross_validation"], row["records"], row["seed"]))
    ended = [row for row in rows if not row["error"]]
    lines = [head("Diagnosis of robots, measured", command, *DIAGNOSIS), "", *ABOUT.splitlines()]
    lines += ["", "## Sums and medians", "", *_table(_summaries(ended))]
    lines += ["", "## Files", "", *_table(_cells(row) for row in ended)]
    failed = [row for row in rows if row["error"]]
    lines += [""] * bool(failed)
    lines += [f"- {_name(row)}, {row['records']} records: {row['error']}" for row in failed]
    return "\n".join(lines) + "\n"


def _summaries(rows: Sequence[Row]) -> list[dict[str, str]]:
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        kind = "only error curves" if set(row["forms"]) == {"c"} else "mixed"
        groups.setdefault((kind, row["records"], row["cross_validation"]), []).append(row)
    return [_summary(*key, of_group) for key, of_group in sorted(groups.items())]


def _summary(kind: str, records: int, validated: bool, rows: Sequence[Row]) -> dict[str, str]:
    scores = [score(row) for row in rows]
    found = sum(len(s.found) for s in scores)
    return {
        "robots": kind,
        "records": str(records),
        "cross-validation": "yes" if validated else "no",
        "files": str(len(rows)),
        "extended": f"{np.median([row['rms_mm']['extended'] for row in rows]):.3f}",
        "new": f"{np.median([row['rms_new_mm'] for row in rows]):.3f}",
        "plain new": f"{np.median([row['plain_new_mm'] for row in rows]):.3f}",
        "floor": f"{np.median([row['floor_mm'] for row in rows]):.3f}",
        "found": f"{found} of {found + sum(len(s.missed) for s in scores)}",
        "false": str(sum(len(s.false) for s in scores)),
        "form": f"{sum(len(s.right_form) for s in scores)} of {found}",
        "CPU": f"{np.median([row['cpu_s'] for row in rows]):.0f}",
        "peak": f"{np.median([row['peak_mb'] for row in rows]):.0f}",
    }


def _cells(row: Row) -> dict[str, str]:
    marks = score(row)
    return {
        "robot": _name(row),
        "records": str(row["records"]),
        "verdict": row["verdict"],
        "recalibrated": f"{row['rms_mm']['recalibrated']:.3f}",
        "extended": f"{row['rms_mm']['extended']:.3f}",
        "new": f"{row['rms_new_mm']:.3f}",
        "plain new": f"{row['plain_new_mm']:.3f}",
        "floor": f"{row['floor_mm']:.3f}",
        "found": f"{len(marks.found)} of {len(marks.found) + len(marks.missed)}",
        "missed": ", ".join(marks.missed),
        "false": ", ".join(marks.false),
        "form": f"{len(marks.right_form)} of {len(marks.found)}",
        "CPU": f"{row['cpu_s']:.0f}",
        "peak": f"{row['peak_mb']:.0f}",
    }


def _name(row: Row) -> str:
    options = "" if row["cross_validation"] else ", no cross-validation"
    return f"`{row['seed']}:{row['forms']}`{options}"


def _table(rows: Iterable[dict[str, str]]) -> list[str]:
    rows = list(rows)
    if not rows:
        return []
    cells = [[*rows[0]], ["---"] * len(rows[0]), *([*row.values()] for row in rows)]
    return [f"| {' | '.join(row)} |" for row in cells]
