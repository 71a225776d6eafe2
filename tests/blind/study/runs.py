"""One run: a file is drawn, the command line is asked, and what it said becomes a row beside the
truth.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from typer.testing import CliRunner

from aacmm_pin.cli.root_command import app
from blind.families import family_file
from blind.machine import GEOMETRY
from blind.oracle import ALIKE, Oracle
from blind.regimes import RegimeFile
from blind.study.outcomes import SEEN, key_of
from blind.truth import Hidden

Row = dict[str, Any]
TRIES, FAR_AWAY = 10, 10_000_000


@dataclass(frozen=True)
class Task:
    """The file of a seed in a family, with fields of :class:`~blind.regimes.Regime` that are not
    drawn; ``limit`` is the CPU time that the command may take [s], ``options`` are more of its
    options.
    """

    seed: int
    given: Mapping[str, Any] = field(default_factory=dict)
    limit: float = 60.0
    family: str = "regimes"
    options: tuple[str, ...] = ()


def perform(task: Task) -> Row:
    """The row of a task; what goes wrong stands under ``error``."""
    file = _file(task)
    row: Row = {
        "seed": task.seed,
        "family": task.family,
        "regime": vars(file.regime),
        "error": None,
        "said": None,
    }
    with TemporaryDirectory() as name:
        folder = Path(name)
        file.write(folder)
        start = time.process_time()
        try:
            with _limited(task.limit):
                result = CliRunner().invoke(
                    app, ["diagnose", *file.words(folder), *task.options, "--json", "-"]
                )
            if result.exit_code == 0:
                row["said"] = json.loads(result.stdout)
            else:
                row["error"] = (
                    f"exit status {result.exit_code}: {result.exception!r} "
                    f"{result.output.strip()[-500:]}"
                )
        except Exception as error:  # whatever breaks inside is what the study is about
            row["error"] = str(error) or repr(error)
        row["seconds"] = round(time.process_time() - start, 3)
    made: Row = plain(row | {"truth": _truth(file, row["said"])})
    return made


def _file(task: Task) -> RegimeFile:
    """The file of a seed; of another far away where the arm does not get to the seats that this one
    draws.
    """
    for tried in range(TRIES):
        try:
            return family_file(task.family, task.seed + tried * FAR_AWAY, **task.given)
        except (ValueError, RuntimeError):
            if tried == TRIES - 1:
                raise
    raise AssertionError


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raises :class:`TimeoutError` inside when the process has worked that long."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"more than {seconds:g} s of CPU time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _truth(file: RegimeFile, said: Row | None) -> Row:
    """What was hidden, what the oracle sees of it, and which of the named causes nobody could tell
    from it.

    ``lambda`` of a cause is beside known values of all others, ``power`` beside values of the other
    causes that are fitted; ``rivals`` are other causes that the records do not tell from it.
    """
    oracle = Oracle(file) if file.machine.faults else None
    named = {key_of(finding): finding for finding in (said or {}).get("findings", [])}
    hidden = []
    for fault in file.hidden:
        assert oracle is not None
        seat = fault.parameters.get("seat")
        key = fault.key if seat is None else f"{fault.cause}:{seat}"
        cosines = {
            name: oracle.cosine(fault, finding) for name, finding in named.items() if name != key
        }
        row: Row = {"key": key, "parameters": _parameters(file, fault), "size_um": fault.size_um}
        row |= {
            "lambda": oracle.visible(fault),
            "aliases": {name: c for name, c in cosines.items() if c > ALIKE},
        }
        others = [other for other in file.hidden if other is not fault]
        row |= {
            "lambda_refitted": oracle.visible(fault, others),
            "power": oracle.power(fault, others),
        }
        row["rivals"] = oracle.rivals(fault, others) if row["power"] >= SEEN else {}
        hidden.append(row)
    structure = _structure(file, oracle, named)
    return {
        "hidden": hidden,
        "structure": structure,
        "noise_mm": 1e3 * file.noise_rms,
        "outliers": file.outliers,
    }


def _structure(file: RegimeFile, oracle: Oracle | None, named: Mapping[str, Row]) -> Row | None:
    """What no cause describes: its kind, what names it, its size, and how like it the named causes
    are.
    """
    if file.structure is None or oracle is None:
        return None
    row: Row = {"kind": file.structure.parameters["kind"], "covariates": file.structure.depends_on}
    row |= {"times_noise": file.regime.structure_size, "rms_mm": 1e-3 * file.structure.size_um}
    cosines = {name: oracle.cosine(file.structure, finding) for name, finding in named.items()}
    return row | {"lambda": oracle.visible(file.structure), "cosines": cosines}


def _parameters(file: RegimeFile, fault: Hidden) -> Row:
    """Those of a fault; of a DH value with what the sound arm is off from its file, as a
    calibration finds it.
    """
    if fault.cause not in GEOMETRY or fault.joint is None:
        return dict(fault.parameters)
    name, column, unit = GEOMETRY[fault.cause]
    return {name: file.machine.geometry()[fault.joint - 1, column] / unit}


def plain(value: Any) -> Any:
    """What JSON can hold."""
    if isinstance(value, Mapping):
        return {str(name): plain(content) for name, content in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain(content) for content in value] if isinstance(value, list | tuple) else value
