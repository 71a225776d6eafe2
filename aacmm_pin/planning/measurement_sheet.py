"""From chosen records to the plan that a person takes to the arm: their order, and the file to be filled in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.effects import Effect
from aacmm_pin.measurements.csv_columns import REFERENCE, REFERENCE_U
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.candidate_records import STEP
from aacmm_pin.planning.detection_power import Power
from aacmm_pin.planning.result import MeasurementPlan, Tried
from aacmm_pin.planning.situation import Asked, Situation

DECIMALS = 6
"""Of angles in degrees."""


def sheet(
    asked: Asked,
    split: tuple[Effect, Effect],
    situation: Situation,
    chosen: list[int],
    before: Power | None,
    after: Power,
    tried: tuple[Tried, ...],
    enough: int | None = None,
) -> MeasurementPlan:
    """The chosen records in the order in which they are taken, as a file to be filled in."""
    records, set_up = situation.pool.take(np.array(chosen)), situation.set_up
    records = records.take(_order(records))
    conditions = records.conditions
    if conditions.time is not None:
        conditions = replace(conditions, time=_spaced(np.round(conditions.time)))
    expected = asked.frame.apply(set_up.model.predict(records.q, conditions))
    stated = conditions.seat is not None and asked.existing is not None
    labels = np.array([f"plan{k}" for k in range(1, records.n + 1)], dtype=object)
    table = Measurements.of(
        records.q,
        records.reference if stated else None,
        records.reference_u if stated and np.isfinite(records.reference_u).all() else None,
        replace(conditions, torque=None),
        record=labels,
    ).to_frame()
    angles = [name for name in table.columns if name.startswith("theta")]
    table[angles] = table[angles].round(DECIMALS)
    if REFERENCE[0] not in table:
        for k, name in enumerate(REFERENCE):
            table.insert(records.nq + k, name, np.full(records.n, np.nan))
    if asked.existing is not None:
        table = _in_columns_of(asked.existing.to_frame(), table)
    return MeasurementPlan(
        model=set_up.model,
        split=split,
        asked=True,
        records=table,
        expected=expected,
        set_up=set_up.words,
        changes_arm=set_up.changes_arm,
        before=before,
        after=after,
        tried=tried,
        pairs=None,
        enough=enough,
        existing=situation.before,
        seed=None,
        notes=("the old records are of another arm file and have no part in the odds",)
        if set_up.changes_arm and asked.existing is not None
        else (),
        measurements=replace(records, conditions=conditions, record=labels),
    )


def _in_columns_of(old: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """New records in the columns of the old ones, so that they can be appended; empty but for an unchanging uncertainty."""
    table = new.reindex(columns=[*old.columns, *new.columns.difference([*old.columns, "record"], sort=False)])
    for name in REFERENCE_U:
        if name in old and name not in new and old[name].nunique(dropna=False) == 1:
            table[name] = old[name].iloc[0]
    return table


def _order(records: Measurements) -> Index:
    """Early before late, cold before warm, seat by seat; then by the first joint, so that the arm swings round once."""
    conditions = records.conditions
    keys: list[Array] = list(np.round(records.q, 2).T[::-1])
    if conditions.seat is not None:
        keys.append(np.unique(conditions.seat.astype(str), return_inverse=True)[1].astype(np.float64))
    if conditions.temperature is not None:
        keys.append(conditions.temperature)
    if conditions.time is not None:
        keys.append(conditions.time)
    return np.asarray(np.lexsort(keys), dtype=np.intp)


def _spaced(time: Array) -> Array:
    """Ascending times with room for one record each."""
    spaced = time.copy()
    for k in range(1, len(spaced)):
        spaced[k] = max(spaced[k], spaced[k - 1] + STEP)
    return spaced
