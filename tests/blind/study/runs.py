"""One run: a file is drawn, the command line is asked, and what it said becomes a row beside the truth."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from typer.testing import CliRunner

from aacmm_pin.cli import app
from blind import Draw, Hidden, draw
from blind.oracle import Oracle, library
from blind.study import regimes
from blind.study.experiments import Experiment

Row = dict[str, Any]
GEOMETRY_NAMES = {
    "a": ("link_length", "a_mm", 1e3),
    "d": ("joint_distance", "d_mm", 1e3),
    "alpha": ("link_twist", "alpha_rad", 1.0),
    "theta_offset": ("joint_zero_offset", "offset_rad", 1.0),
}
"""Cause, parameter and unit of a deviation that ``shifts`` ask for."""
FRESH_RECORDS = 300


class CommandError(Exception):
    """A command that did not end well."""


class TimeLimitError(Exception):
    """A command that takes longer than a study waits for."""


@dataclass(frozen=True)
class Task:
    """Run number ``run`` of an experiment; ``fresh`` measures the gain on fresh data as well, ``limit`` is the CPU time that
    a command may take [s].
    """

    experiment: Experiment
    run: int
    fresh: bool = False
    limit: float = 60.0

    @property
    def key(self) -> tuple[str, int]:
        return self.experiment.name, self.experiment.first + self.run


def perform(task: Task) -> Row:
    """The row of a task; what goes wrong stands under ``error``."""
    arguments = task.experiment.arguments(task.run)
    if task.experiment.kind == "regime":
        said = regimes.perform(arguments, _command, _limited(task.limit))
        return plain({"experiment": task.experiment.name, "kind": task.experiment.kind, **said})
    drawn = draw(**arguments)
    row: Row = {"experiment": task.experiment.name, "seed": arguments["seed"], "kind": task.experiment.kind}
    row |= {"arguments": plain(arguments), "error": None, "said": None, "seconds": None, "fresh": None}
    with TemporaryDirectory() as name:
        folder = Path(name)
        drawn.write(folder / "data.csv")
        start = time.process_time()
        try:
            with _limited(task.limit):
                row["said"] = _diagnosis(folder, task)
        except CommandError as error:
            row["error"] = str(error)
        row["seconds"] = round(time.process_time() - start, 3)
        if task.fresh and task.experiment.fresh and row["error"] is None:
            try:
                with _limited(task.limit):
                    row["fresh"] = _fresh_gain(folder, drawn, task.experiment.options)
            except CommandError as error:
                row["fresh"] = {"error": str(error)}
    return row | {"truth": _truth(drawn, arguments.get("shifts") or {}, task.experiment.likely)}


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raises :class:`TimeLimitError` inside when the process has worked that long."""

    def stop(*_: object) -> None:
        raise TimeLimitError(f"more than {seconds:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def start_worker() -> None:
    """Ctrl-C is the parent's to handle; without a parent there is nothing to do."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def leave() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


def _command(*words: str) -> str:
    """Standard output of ``aacmm-pin``.

    Raises:
        CommandError: exit status other than 0.
    """
    result = CliRunner().invoke(app, list(words))
    if result.exit_code != 0:
        broke = "" if isinstance(result.exception, SystemExit) else f" {result.exception!r}"
        raise CommandError(f"{words[0]}: exit status {result.exit_code}:{broke} {result.output.strip()[-500:]}")
    return result.stdout


def _diagnosis(folder: Path, task: Task) -> Any:
    extended = ["--extended-arm", str(folder / "extended.toml")] if task.fresh and task.experiment.fresh else []
    return json.loads(
        _command("diagnose", "sino6", str(folder / "data.csv"), *task.experiment.options, "--json", "-", *extended)
    )


def _fresh_gain(folder: Path, drawn: Draw, options: list[str]) -> Row:
    """Gain on another run of the same arm, by the corrected tips of the extended and of the recalibrated arm.

    In free space a reference is the tip at the posture with noise; on seats it is the seat, and the contact's noise is in
    the indications: in both the distance from reference to corrected tip is what is left of the fault, and the noise.
    Records beyond the angles of the first run are left out: a curve is known as far as it was measured.
    """
    fresh = drawn.fresh(FRESH_RECORDS)
    measured = ((fresh.read >= drawn.read.min(axis=0)) & (fresh.read <= drawn.read.max(axis=0))).all(axis=1)
    header, *lines = fresh.csv_text.splitlines(keepends=True)
    (folder / "fresh.csv").write_text(header + "".join(compress(lines, measured)), encoding="utf-8")
    _command(
        "calibrate", "sino6", str(folder / "data.csv"), *options, "--no-held-out", "-o", str(folder / "recalibrated.toml")
    )
    rms, without_noise = {}, {}
    for arm in ("recalibrated", "extended"):
        out = folder / f"{arm}.csv"
        _command("correct", str(folder / f"{arm}.toml"), str(folder / "fresh.csv"), "-o", str(out))
        tips = 1e-3 * pd.read_csv(out)[[f"corrected_{axis}_mm" for axis in "xyz"]].to_numpy()
        rms[arm], without_noise[arm] = _rms(tips - fresh.reference[measured]), _rms(tips - fresh.touched[measured])
    return {
        "rms_mm": {name: 1e3 * value for name, value in rms.items()} | {"noise": 1e3 * fresh.oracle_rms},
        "model_rms_mm": {name: 1e3 * value for name, value in without_noise.items()},
        "records": int(measured.sum()),
        "gain": 1.0 - rms["extended"] / rms["recalibrated"],
    }


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def _truth(drawn: Draw, shifts: dict[tuple[int, str], float], likely: bool) -> Row:
    """What was hidden, and what the oracle says of it."""
    oracle = Oracle(drawn) if drawn.truth.hidden or likely else None
    hidden = [_hidden(oracle, fault) for fault in drawn.truth.hidden if oracle is not None]
    for row, kind in shifts:
        cause, parameter, unit = GEOMETRY_NAMES[kind]
        deviation = unit * drawn.truth.geometry[row - 1, ("a", "d", "alpha", "theta_offset").index(kind)]
        hidden.append(plain({"cause": cause, "joint": row, "key": f"{cause}:{row}", "parameters": {parameter: deviation}}))
    probabilities = oracle.probabilities() if oracle is not None and likely else None
    likeliest = _largest(probabilities, hidden)
    as_json: Row = plain({"hidden": hidden, "outliers": drawn.truth.outliers, "probabilities": likeliest})
    return as_json


def _hidden(oracle: Oracle, fault: Hidden) -> Row:
    seat = fault.parameters.get("seat")
    power, retained = oracle.power(fault)
    row: Row = {"cause": fault.cause, "joint": fault.joint, "key": fault.key if seat is None else f"{fault.cause}:{seat}"}
    row |= {"parameters": fault.parameters, "size_um": fault.size_um, "depends_on": fault.depends_on}
    row |= {"lambda": power, "retained_fraction": retained, "columns": _columns(oracle, row["key"])}
    aliases = {key: cosine for key, cosine in oracle.aliases(fault).items() if key != row["key"]}
    as_json: Row = plain(row | {"aliases": aliases})
    return as_json


def _columns(oracle: Oracle, key: str) -> int | None:
    """Number of linear parameters of a cause, None where the library of the oracle does not have it."""
    known = library(oracle.nominal, oracle.plan, float(oracle.conditions.time[-1]))
    return next((len(candidate.faults) for candidate in known if candidate.key == key), None)


def _largest(probabilities: dict[str, float] | None, hidden: list[Row]) -> dict[str, float] | None:
    """The five likeliest, and those of the truth."""
    if probabilities is None:
        return None
    kept = [*list(probabilities)[:5], *(h["key"] for h in hidden), "none"]
    return {key: probabilities[key] for key in probabilities if key in kept}


def plain(value: Any) -> Any:
    """What JSON can hold."""
    if isinstance(value, Mapping):
        return {str(name): plain(content) for name, content in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain(content) for content in value] if isinstance(value, list | tuple) else value
