"""Diagnoses of many files, such as those of a fleet of arms, in one table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.progress import bar
from aacmm_pin._support.units import MM
from aacmm_pin._support.workers import Workers, results
from aacmm_pin.diagnosis.diagnose import diagnose
from aacmm_pin.effects import CAUSES, Effect, ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError, OutputError
from aacmm_pin.measurements import GivenRecords, Measurements, as_measurements

RMS_OF = {
    "rms_as_stated_mm": "nominal",
    "rms_recalibrated_mm": "recalibrated",
    "rms_extended_mm": "extended",
    "noise_mm": "noise",
}
"""Columns of RMS distances, and the name of each in :attr:`aacmm_pin.Diagnosis.rms`."""
GAIN_COLUMNS = ("gain", "gain_low", "gain_high")
COUNT_COLUMNS = ("used", "excluded", "causes_shown", "causes_tried")
COLUMNS = ("arm", "records", "verdict", "causes", *RMS_OF, *GAIN_COLUMNS, *COUNT_COLUMNS, "error")


def diagnose_files(
    pairs: Iterable[tuple[GivenModel, GivenRecords]],
    *,
    approach_from_order: bool = False,
    seed: int = 1,
    workers: Workers = 1,
    progress: bool = True,
    **options: Any,
) -> pd.DataFrame:
    """Diagnose many files, each with its arm; one row for each file.

    If an arm or a file cannot be used, its row states the error. Every diagnosis starts with the
    same ``seed``: a row depends neither on other files nor on ``workers``.

    Args:
        pairs: pairs of an arm and its records, or of the paths of their files.
        approach_from_order: derive the approach directions from the order of the rows; see
            :meth:`aacmm_pin.Measurements.with_approach_from_order`.
        workers: number of processes, or a ``concurrent.futures.Executor``; each file is one task.
        progress: True for a progress bar in a notebook or on stderr.
        options: arguments of :func:`aacmm_pin.diagnose` for all files.

    Returns:
        A table in the order of ``pairs``. Columns: ``arm``, ``records``; ``verdict``; ``causes``
        (probability of each finding by its label); ``rms_as_stated_mm``, ``rms_recalibrated_mm``,
        ``rms_extended_mm``, ``noise_mm`` (RMS residuals); ``gain``, ``gain_low``, ``gain_high`` (on
        held-out records, with the 95 % interval); ``used``, ``excluded`` (numbers of records);
        ``causes_shown``, ``causes_tried`` (causes that the records would show at typical magnitude,
        and all tried); ``error`` ("" if none). Missing values are NaN.
    """
    work = partial(_row, tuple(CAUSES.values()), approach_from_order, seed, options)
    jobs = [*pairs]
    rows: dict[int, dict[str, Any]] = {}
    files_bar = bar(progress, "diagnosis", "file", total=len(jobs))
    with files_bar as moving, results(work, jobs, workers) as worked:
        for number, row in worked:
            rows[number] = row
            moving.update()
    table = pd.DataFrame([rows[number] for number in range(len(jobs))], columns=[*COLUMNS])
    return table.astype(dict.fromkeys(COUNT_COLUMNS, "Int64"))


def _row(
    causes: Iterable[type[Effect]],
    approach_from_order: bool,
    seed: int,
    options: Mapping[str, Any],
    pair: tuple[GivenModel, GivenRecords],
) -> dict[str, Any]:
    """The row of a file, perhaps in another process that does not know all causes."""
    for cause in causes:
        CAUSES.setdefault(cause.cause, cause)
    row: dict[str, Any] = {"arm": _name(pair[0]), "records": _name(pair[1]), "causes": {}}
    try:
        model = ErrorModel.of(pair[0])
        records = as_measurements(pair[1], model.arm)
        if approach_from_order:
            records = records.with_approach_from_order()
        rng = np.random.default_rng(seed)
        diagnosis = diagnose(model, records, rng=rng, progress=False, **options)
    except OutputError:  # a file of the command itself
        raise
    except AacmmError as error:
        return row | {"error": str(error)}
    causes_found = {finding.label: finding.probability for finding in diagnosis.findings}
    row |= {"verdict": diagnosis.verdict, "causes": causes_found, "error": ""}
    row |= {column: diagnosis.rms[model] / MM for column, model in RMS_OF.items()}
    gain = diagnosis.held_out
    if gain is not None:
        row |= dict(zip(GAIN_COLUMNS, (gain.gain, *gain.interval), strict=True))
    counts = (diagnosis.extended.used.sum(), len(diagnosis.excluded), *diagnosis.visible)
    return row | dict(zip(COUNT_COLUMNS, counts, strict=True))


def _name(given: GivenModel | GivenRecords) -> str:
    """The path or name as given; the source of records, the name of an arm."""
    if isinstance(given, str | Path):
        return str(given)
    return given.source if isinstance(given, Measurements) else ErrorModel.arm_of(given).name
