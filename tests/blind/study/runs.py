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
from blind import Draw, draw
from blind.oracle import ALIKE, Oracle
from blind.regimes import RegimeFile, regime_file
from blind.study.experiments import Experiment
from blind.study.outcomes import key_of

Row = dict[str, Any]
FRESH_RECORDS = 300
TRIES, FAR_AWAY = 10, 10_000_000


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
    experiment, arguments = task.experiment, task.experiment.arguments(task.run)
    fresh_too = task.fresh and experiment.fresh
    row: Row = {"experiment": experiment.name, "seed": arguments["seed"], "arguments": arguments}
    row |= {"error": None, "said": None, "seconds": None, "fresh": None}
    with TemporaryDirectory() as name:
        folder = Path(name)
        if experiment.regime:
            file: Draw | RegimeFile = _regime_file(arguments)
            file.write(folder)
            words = file.words(folder)
            row["regime"] = vars(file.regime)
        else:
            file = draw(**arguments)
            words = ["sino6", str(file.write(folder / "data.csv")), *experiment.options]
        words += ["--extended-arm", str(folder / "extended.toml")] if fresh_too else []
        start = time.process_time()
        try:
            with _limited(task.limit):
                row["said"] = json.loads(_command("diagnose", *words, "--json", "-"))
        except Exception as error:  # whatever breaks inside is what the study is about
            row["error"] = str(error) or repr(error)
        row["seconds"] = round(time.process_time() - start, 3)
        if fresh_too and isinstance(file, Draw) and row["error"] is None:
            try:
                with _limited(task.limit):
                    row["fresh"] = _fresh_gain(folder, file, experiment.options)
            except CommandError as error:
                row["fresh"] = {"error": str(error)}
    as_json: Row = plain(row | {"truth": _truth(file, row["said"], experiment.likely)})
    return as_json


def _regime_file(arguments: Row) -> RegimeFile:
    """The file of a seed; of another far away where the arm finds too few postures at the seats that this one draws."""
    for tried in range(TRIES):
        try:
            return regime_file(**(arguments | {"seed": arguments["seed"] + tried * FAR_AWAY}))
        except ValueError:
            if tried == TRIES - 1:
                raise
    raise AssertionError


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
    recalibrated = ["--no-held-out", "-o", str(folder / "recalibrated.toml")]
    _command("calibrate", "sino6", str(folder / "data.csv"), *options, *recalibrated)
    rms = {}
    for arm in ("recalibrated", "extended"):
        out = folder / f"{arm}.csv"
        _command("correct", str(folder / f"{arm}.toml"), str(folder / "fresh.csv"), "-o", str(out))
        off = 1e-3 * pd.read_csv(out)[[f"corrected_{axis}_mm" for axis in "xyz"]].to_numpy() - fresh.reference[measured]
        rms[arm] = float(np.sqrt((off**2).sum(axis=1).mean()))
    in_mm = {name: 1e3 * value for name, value in rms.items()} | {"noise": 1e3 * fresh.oracle_rms}
    return {"rms_mm": in_mm, "records": int(measured.sum()), "gain": 1.0 - rms["extended"] / rms["recalibrated"]}


def _truth(file: Draw | RegimeFile, said: Row | None, likely: bool) -> Row:
    """What was hidden, which of the named causes nobody could tell from it, and the oracle's five likeliest causes."""
    oracle = Oracle(file) if file.hidden or likely else None
    named = {key_of(finding): finding for finding in (said or {}).get("findings", [])}
    hidden = []
    for fault in file.hidden:
        assert oracle is not None
        seat = fault.parameters.get("seat")
        row: Row = {"cause": fault.cause, "joint": fault.joint, "parameters": dict(fault.parameters)}
        row |= {"key": fault.key if seat is None else f"{fault.cause}:{seat}", "size_um": fault.size_um}
        row |= {"lambda": oracle.visible(fault), "depends_on": fault.depends_on}
        cosines = {key: oracle.cosine(fault, finding) for key, finding in named.items() if key != row["key"]}
        hidden.append(row | {"aliases": {key: c for key, c in cosines.items() if c > ALIKE}, "cosines": cosines})
    probabilities = oracle.probabilities() if oracle is not None and likely else None
    if probabilities is not None:
        kept = {*list(probabilities)[:5], *(h["key"] for h in hidden), "none"}
        probabilities = {key: p for key, p in probabilities.items() if key in kept}
    return {"hidden": hidden, "outliers": file.outliers, "probabilities": probabilities}


def plain(value: Any) -> Any:
    """What JSON can hold."""
    if isinstance(value, Mapping):
        return {str(name): plain(content) for name, content in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain(content) for content in value] if isinstance(value, list | tuple) else value
