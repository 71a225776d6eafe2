"""What the column table says of diagnosis is what diagnosis does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.effects import Conditions
from aacmm_pin.measurements import Measurements
from aacmm_pin.measurements.csv_columns import RECORD_COLUMNS, Column, named


def names_of(entry: Column) -> list[str]:
    """The names of its columns in a file of six joints."""
    return named(entry.names[0], 6) if entry.is_numbered else [*entry.names]


def test_each_known_column_is_a_covariate_or_says_that_it_is_none(sino6, rng):
    n = 40
    q, label = rng.uniform(-2.0, 2.0, (n, 6)), np.array(["1", "2"] * (n // 2), dtype=object)
    of_joints = rng.uniform(-1.0, 1.0, (n, 6))
    conditions = Conditions(
        n,
        time=rng.uniform(0.0, 5e3, n),
        temperature=rng.uniform(18.0, 22.0, n),
        approach=np.sign(of_joints),
        torque=of_joints,
        tilt_x=rng.uniform(-0.1, 0.1, n),
        tilt_y=rng.uniform(-0.1, 0.1, n),
        seat=label,
        marker=label,
        session=label,
    )
    extra = pd.DataFrame(index=range(n))
    for entry in RECORD_COLUMNS:
        if not entry.field:
            low, high = entry.range_in_file[:2] if entry.range_in_file else (0.0, 1.0)
            for name in names_of(entry):
                extra[name] = label if entry.is_label else rng.uniform(low, high, n)
    stated = Measurements.of(
        q,
        sino6.positions(q),
        np.full((n, 3), 1e-5),
        conditions,
        extra=extra,
        bar=np.full(n, "long", dtype=object),
        bar_end=np.where(label == "1", "A", "B").astype(object),
        bar_length=np.full(n, 0.5),
        bar_length_u=np.full(n, 1e-5),
        operator=label,
        record=label,
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        orientation_u=np.full(n, 1e-4),
    )
    of_rows = replace(conditions, link_temperature=of_joints + 20.0)
    records = replace(stated, conditions=of_rows)
    tried = {covariate.name for covariate in covariates(sino6, records)}
    for entry in RECORD_COLUMNS:
        found = [entry.quantity(name) in tried for name in names_of(entry)]
        assert found == [entry.covariate in ("anywhere", "joints")] * len(found), entry.names
    compared = [column.entry.names for column in records.covariate_columns()]
    assert {*compared} == {e.names for e in RECORD_COLUMNS if e.covariate != "none"}


def test_bumps_are_as_wide_as_their_centres_are_apart(sino6, rng):
    q = rng.uniform(-2.0, 2.0, (200, 6))
    tips = sino6.positions(q)
    (place,) = (
        each for each in covariates(sino6, Measurements.of(q, tips)) if each.name == "place"
    )
    ((bumps,),) = (way.smooth for way in place.variants)
    apart = np.linalg.norm(tips[:, None] - np.array(bumps.centres_si), axis=2).min(axis=1)
    assert bumps.width_si == pytest.approx(1.5 * np.sqrt(np.mean(apart**2)), rel=1e-3)
