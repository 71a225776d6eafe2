"""The direction of a joint's last motion, from the order of the rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import Arm
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from tests.cli.shell import found, refused
from tests.tables import PLACES, readings

HALF_WIDTH = 3e-4
NOISE = 8e-6


def reversals(sino6: Arm, rng: np.random.Generator, n: int = 150) -> pd.DataFrame:
    """A file of an arm whose joint 3 turns ±HALF_WIDTH more or less than its encoder indicates, by
    the sign of its last step.
    """
    q = rng.uniform(-1.2, 1.2, (n, 6))
    turned = q + rng.normal(0, NOISE, q.shape)
    turned[1:, 2] += HALF_WIDTH * np.sign(q[1:, 2] - q[:-1, 2])
    tips = sino6.positions(turned) + rng.normal(0, 1e-5, (n, 3))
    table = readings(q)
    return table.assign(**dict(zip(PLACES, tips.T * 1e3, strict=True)))


def test_signs_of_steps(sino6):
    q = np.zeros((6, 6))
    q[:, 0] = [0.1, 0.3, 0.3, 0.2, 0.2005, 0.4]
    session = ["a", "a", "a", "a", "b", "b"]
    table = readings(q, "rad")
    records = Measurements.from_frame(table.assign(session=session)).with_approach_from_order()
    assert records.conditions.approach[:, 0].tolist() == [0, 1, 1, -1, 0, 1]
    assert not records.conditions.approach[:, 1:].any()
    with pytest.raises(AacmmError, match="approach1"):
        records.with_approach_from_order()


def test_the_option_of_commands(sino6, rng, tmp_path):
    path = tmp_path / "rows.csv"
    table = reversals(sino6, rng, 40)
    table.to_csv(path, index=False)
    missing = [entry["column"] for entry in found(f"check sino6 {path}")["not_tried"]]
    assert "approach1 …" in missing
    stated = found(f"check sino6 {path} --approach-from-order")
    assert "approach1 …" not in [entry["column"] for entry in stated["not_tried"]]
    table.assign(**{f"approach{j}": 1 for j in range(1, 7)}).to_csv(path, index=False)
    refused(f"check sino6 {path} --approach-from-order", said=["rows.csv", "approach1"])
