"""The plan of an acceptance test: an arm without errors that carries it out passes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin import accept
from aacmm_pin._support.units import DEG, MM
from tests.cli import shell
from tests.tables import PLACES

ANGLES = [f"planned_theta{k}_deg" for k in range(1, 7)]


def test_an_exact_arm_passes_its_plan(sino6, tmp_path):
    path = tmp_path / "plan.csv"
    shell.done(f"plan acceptance sino6 --measuring-range-mm 1000 -o {path}")
    plan = pd.read_csv(path)
    tips = sino6.positions(plan[ANGLES].to_numpy() * DEG) / MM
    assert np.abs(tips - plan[[f"planned_{name}" for name in PLACES]]).max(axis=None) < 0.01
    assert tips[:, 2].min() > 0.0  # the base of an arm that stands is on a table
    plan[PLACES] = tips
    plan.to_csv(path, index=False)
    result = accept(path, measuring_range=1.0)
    assert {f.definition.test for f in result.figures} == {*plan["test"]}
    assert all(abs(f.evaluated.largest.value) < 0.01 * MM for f in result.figures)
    longest = result.summary()["longest_length_mm"]
    assert longest["length-uni"] == plan["length_mm"].max()
    bars = plan[plan["test"].isin(["length-uni", "length-bi"])]
    assert (bars.groupby(["test", "length_id", "position"])["repeat"].nunique() == 3).all()
    assert bars["length_mm"].nunique() == 5
    assert bars["position"].nunique() == 7
