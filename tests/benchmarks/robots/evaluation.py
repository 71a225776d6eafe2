"""What the command line makes of one file: the names of ``aacmm-pin diagnose``, and its extended
arm on new records of the same robot.
"""

from __future__ import annotations

import csv
import hashlib
import json
import math
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tests.benchmarks.robots.plain_model import Plain
from tests.benchmarks.robots.robot import FORMS, NOISE_MM, RANGES, Array, Robot, rms

Row = dict[str, Any]
NEW = 2000
"""So many new records test the extended arm."""
ACTS, SILENT = 0.5 * NOISE_MM, 0.1 * NOISE_MM
"""A place with a larger displacement should be found, one with a smaller displacement should not
[mm].
"""
NAMED, SURE = 0.5, 0.95
"""Probabilities from which a place is named and is found."""
ENCODER = {
    "angle",
    "encoder_eccentricity",
    "encoder_ellipticity",
    "encoder_gain",
    "joint_periodic_error",
    "second_periodic_error",
    "joint_error_curve",
}
LOAD = {"load", "joint_compliance", "counterbalance", "bearing_tilt"}
GEOMETRY = {
    "joint_distance",
    "joint_placement",
    "joint_zero_offset",
    "link_length",
    "link_tilt",
    "link_twist",
    "reference_frame",
    "stylus_offset",
}
"""Recalibration fits these, so they are no places."""


def perform(
    robot: Robot, records: int, checkout: Path, cross_validation: bool = True, limit: int = 3600
) -> Row:
    """The row of one file; the package comes from a checkout. A command that fails or takes more
    than so many CPU seconds leaves its message under ``error``.
    """
    measured, new = robot.measured(records), robot.measured(NEW)
    row: Row = {
        "error": None,
        "displacements_mm": measured.displacements_mm,
        "periods": robot.periods(),
        "floor_mm": new.floor_mm,
    }
    options = ["--reference-frame", "external", "--target", "unknown"]
    options += ["--arm-out", "ext.toml", "--json", "out.json"]
    options += [] if cross_validation else ["--no-cross-validation"]
    with TemporaryDirectory() as name:
        shell = Shell(Path(name), checkout, limit)
        data, readings = measured.write(shell.folder), new.write(shell.folder / "new")
        try:
            used = shell.run("diagnose", "robot.toml", data.name, *options)
            shell.run("correct", "ext.toml", str(readings), "-o", "corrected.csv")
        except RuntimeError as error:
            return row | {"error": str(error)}
        said = json.loads((shell.folder / "out.json").read_text())
        tips = _coordinates(shell.folder / "corrected.csv")
    known = np.isfinite(tips).all(axis=1)
    plain = Plain.fitted(measured)
    return row | {
        "cpu_s": used.cpu_s,
        "peak_mb": used.peak_mb,
        "verdict": said["verdict"],
        "rms_mm": said["rms_mm"],
        "rms_new_mm": rms(_left(tips[known], new.coordinates[known])),
        "records_without_tip": int((~known).sum()),
        "findings": [
            {key: f.get(key) for key in ("cause", "joint", "order", "probability")}
            for f in (*said["findings"], *_structure(said))
        ],
        "places": [
            *(
                {"cause": p["depends_on"], "joint": p["joint"], "probability": p["probability"]}
                for p in said["places"]
            ),
            *_structure(said),
        ],
        "plain_mm": plain.rms_mm,
        "plain_new_mm": plain.rms_new_mm(new),
    }


@dataclass(frozen=True)
class Shell:
    """A folder in which ``aacmm-pin`` of a checkout runs, for so many CPU seconds at most."""

    folder: Path
    checkout: Path
    limit: int

    def run(self, *words: str) -> Used:
        """Run a command.

        Raises:
            RuntimeError: with its last message, if it fails.
        """
        environment = os.environ | {"PYTHONPATH": str(self.checkout), "OMP_NUM_THREADS": "1"}
        log = self.folder / "log"
        with log.open("w") as file:
            process = subprocess.Popen(
                [sys.executable, "-m", "aacmm_pin.cli", *words],
                stdout=file,
                stderr=file,
                cwd=self.folder,
                env=environment,
                preexec_fn=self._limit,
            )
            _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            last = (log.read_text().strip().splitlines() or [""])[-1]
            raise RuntimeError(f"{words[0]} ended with {process.returncode}. {last}".strip())
        # ru_maxrss is in kB on Linux
        return Used(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3)

    def _limit(self) -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (self.limit, self.limit))


@dataclass(frozen=True)
class Used:
    """What a command took, with its start."""

    cpu_s: float
    peak_mb: float


def digest(checkout: Path) -> str:
    """Which code a checkout has, files without commit included.

    Raises:
        FileNotFoundError: if it has no package.
    """
    found = hashlib.sha256()
    paths = sorted((checkout / "aacmm_pin").rglob("*.py"))
    if not paths:
        raise FileNotFoundError(f"{checkout}: no folder aacmm_pin with Python files")
    for path in paths:
        found.update(str(path.relative_to(checkout)).encode() + path.read_bytes())
    return found.hexdigest()[:16]


def _coordinates(path: Path) -> Array:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = [f"corrected_{axis}_mm" for axis in "xyz"]
    return np.array([[float(row[name] or "nan") for name in names] for row in rows])


def _left(tips: Array, coordinates: Array) -> Array:
    """Residuals (n, 3) after a rigid registration of tips on coordinates."""
    a, b = tips - tips.mean(0), coordinates - coordinates.mean(0)
    u, _, vt = np.linalg.svd(a.T @ b)
    sign = np.array([1.0, 1.0, np.linalg.det(u @ vt)])
    return b - a @ (u * sign) @ vt


WARMTH = ("thermal_expansion", "temperature")
"""Names of what depends on the temperature: a cause, and structure."""


def place(cause: str, joint: int | None) -> str | None:
    """Where a cause acts, or where errors depend on a quantity; None if it is geometry, which
    recalibration fits.
    """
    if cause in GEOMETRY:
        return None
    if cause in ENCODER:
        return f"encoder:{joint}"
    if cause in LOAD:
        return f"load:{joint}"
    return "temperature" if cause in WARMTH else f"{cause}:{joint}"


def _structure(said: Row) -> list[Row]:
    """Structure over the temperature, which no cause of the library has, as a finding."""
    return [
        {"cause": part["covariate"], "joint": None, "probability": part["probability"]}
        for part in said["discrepancy"]
        if part["covariate"] in WARMTH
    ]


@dataclass(frozen=True)
class Score:
    """Places of a row by what is said of them.

    Attributes:
        found: they displace the target, with a probability of at least 0.95.
        missed: they displace the target, with a lower probability.
        right_form: found ones of which the named causes are the true cause alone.
        wrong_form: the other found ones.
        false: named ones without effect.
    """

    found: tuple[str, ...]
    missed: tuple[str, ...]
    right_form: tuple[str, ...]
    wrong_form: tuple[str, ...]
    false: tuple[str, ...]


def score(row: Row) -> Score:
    """How a row compares with the truth."""
    moved = {name: d for name, d in row["displacements_mm"].items() if name != "room"}
    named: dict[str, list[Row]] = {}
    for finding in row["findings"]:
        where = place(finding["cause"], finding["joint"])
        if where is not None and finding["probability"] >= NAMED:
            named.setdefault(where, []).append(finding)
    sure = {place(p["cause"], p["joint"]) for p in row["places"] if p["probability"] >= SURE}
    acting = [name for name, d in moved.items() if d > ACTS]
    found = [name for name in acting if name in sure]
    right = [name for name in found if _right_form(row, name, named.get(name, []))]
    return Score(
        tuple(found),
        tuple(name for name in acting if name not in found),
        tuple(right),
        tuple(name for name in found if name not in right),
        tuple(name for name in named if moved.get(name, 0.0) < SILENT),
    )


def _right_form(row: Row, where: str, findings: list[Row]) -> bool:
    kind, _, joint = where.partition(":")
    if kind == "temperature":
        return True
    if kind == "load":
        return {f["cause"] for f in findings} == {"joint_compliance"}
    if {f["cause"] for f in findings} != {FORMS[row["forms"][int(joint) - 1]]}:
        return False
    if where not in row["periods"]:
        return True
    # Half a period over the range of the joint is a wave of its own.
    low, high = RANGES[int(joint) - 1]
    nearest = 0.5 * 2 * math.pi / (high - low)
    return all(abs(f["order"] - row["periods"][where]) < nearest for f in findings)


def in_words(row: Row) -> str:
    """One line: what remains, what it takes, names, and what is wrong with them."""
    name = f"{row['seed']}:{row['forms']} {row['records']}"
    if row["error"]:
        return f"{name}: {row['error']}"
    marks = score(row)
    names = ", ".join(
        f"{f['cause']}:{f['joint']}"
        + (f" ({f['order']:.4g}/turn)" if f["order"] else "")
        + f" {f['probability']:.3f}"
        for f in row["findings"]
    )
    wrong = "; ".join(
        f"{label} {', '.join(which)}"
        for label, which in (
            ("MISSED", marks.missed),
            ("FALSE", marks.false),
            ("WRONG FORM", marks.wrong_form),
        )
        if which
    )
    acting = len(marks.found) + len(marks.missed)
    return (
        f"{name}: RMS extended {row['rms_mm']['extended']:.4f} new {row['rms_new_mm']:.4f} (plain "
        f"{row['plain_new_mm']:.4f}, floor {row['floor_mm']:.4f}) mm, "
        f"CPU {row['cpu_s']:.1f} s, peak {row['peak_mb']:.0f} MB, "
        f"found {len(marks.found)}/{acting}, false {len(marks.false)}, form right "
        f"{len(marks.right_form)}/{len(marks.found)}, {row['verdict']}; {names}; {wrong or 'ok'}"
    )
