"""From chosen records to the plan: order, and file to complete."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin.effects import CONDITION_ENTRIES
from aacmm_pin.measurements import REFERENCE, REFERENCE_U, Measurements, column_of
from aacmm_pin.planning.candidate_design import Situation
from aacmm_pin.planning.candidate_records import TIME_STEP
from aacmm_pin.planning.task import Task

SHEET_DECIMALS = 6
"""Of angles in degrees, and of directions."""


def planned_records(task: Task, situation: Situation, chosen: list[int]) -> dict[str, Any]:
    """Fields of :class:`PlanOfRecords`: chosen records in order, and the file to complete."""
    records = situation.pool.take(np.array(chosen))
    conditions = records.conditions
    # Early before late, cold before warm, seat by seat, then by joint 1: the arm swings round once.
    keys: list[NDArray[Any]] = list(np.round(records.q, 2).T[::-1])
    if conditions.seat is not None:
        keys.append(conditions.seat.astype(str))
    keys += [key for key in (conditions.temperature, conditions.time) if key is not None]
    records = records.take(np.lexsort(keys))
    conditions = records.conditions
    if conditions.time is not None:
        steps = TIME_STEP * np.arange(records.n)  # at least, between ascending times
        times = np.maximum.accumulate(np.round(conditions.time) - steps) + steps
        conditions = replace(conditions, time=np.asarray(times))
    labels = np.array([f"plan{k}" for k in range(1, records.n + 1)], dtype=object)
    records = replace(records, conditions=conditions, record=labels)
    model = situation.set_up.model
    return {
        "model": model,
        "records": _sheet(records, task.existing),
        "expected": task.frame.apply(model.predict(records.q, records.conditions)),
        "measurements": records,
        "existing": situation.before,
    }


def _sheet(records: Measurements, existing: Measurements | None) -> pd.DataFrame:
    """The file to complete, with the columns of the existing records.

    Cells to measure are empty, also conditions without planned or existing value. Coordinates of
    known seats and constant u stay.
    """
    has_known_seats = records.conditions.seat is not None and existing is not None
    has_u = has_known_seats and np.isfinite(records.reference_u).all()
    empty = np.full((records.n, 3), np.nan)
    table = replace(
        records,
        reference=records.reference if has_known_seats else empty,
        reference_u=records.reference_u if has_u else empty,
        conditions=replace(records.conditions, torque=None),
    ).to_frame()
    exact = [name for name in table.columns if name.startswith(("theta", "probe_direction"))]
    table[exact] = table[exact].round(SHEET_DECIMALS)
    for name in records.conditions.present:
        usual, values = CONDITION_ENTRIES[name].usual, getattr(records.conditions, name)
        in_existing = existing is not None and name in existing.conditions.present
        if usual is not None and np.all(values == usual) and not in_existing:
            table[[head for head in map(str, table) if column_of(head).field == name]] = np.nan
    if REFERENCE[0] not in table:
        for k, name in enumerate(REFERENCE):
            table.insert(records.nq + k, name, empty[:, k])
    if existing is None:
        return table
    existing_table = existing.to_frame()
    existing_columns = [*existing_table.columns]
    new_columns = table.columns.difference([*existing_columns, "record"], sort=False)
    constant_u = {
        name: existing_table[name].iloc[0]
        for name in REFERENCE_U
        if name in existing_columns
        and name not in table
        and existing_table[name].nunique(dropna=False) == 1
    }
    return table.reindex(columns=[*existing_columns, *new_columns]).assign(**constant_u)
