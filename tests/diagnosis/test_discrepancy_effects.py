"""What diagnosis describes without naming it, as effects of an arm file: the same columns, and
right at new records.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import base_placements, calibrate
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.diagnosis.covariates import covariates
from aacmm_pin.effects import Conditions, ErrorModel
from aacmm_pin.measurements import Measurements
from tests.few_causes import NO_WAVES

NOISE = 15e-6
COUPLING = "joint 2 × joint 4"


@dataclass(frozen=True, eq=False)
class Plant:
    """SINO6 whose joint 4 is turned by what joint 2 does, which no cause of the library is."""

    arm: Arm
    rng: np.random.Generator

    def touched(self, n: int) -> tuple[Array, Array]:
        """Indications (n, 6) [rad], and where the tip really is (n, 3) [m]."""
        low, high = self.arm.limits.T
        q = self.rng.uniform(low, high, (n, 6))
        real = q.copy()
        real[:, 3] += 1.5e-4 * np.cos(q[:, 1] - 0.7) + 0.7e-4 * np.sin(q[:, 1] + q[:, 3])
        return q, self.arm.poses(real).position

    def measured(self, n: int) -> Measurements:
        """The same with noise, and with a clock."""
        q, tip = self.touched(n)
        conditions = Conditions(n, time=np.sort(self.rng.uniform(0.0, 3600.0, n)))
        return Measurements.of(
            q, tip + NOISE * self.rng.standard_normal((n, 3)), conditions=conditions
        )


@pytest.fixture
def plant(sino6, rng) -> Plant:
    return Plant(sino6, rng)


@NO_WAVES
def test_the_arm_of_a_diagnosis_corrects_what_nothing_explains(plant, tmp_path):
    """Beside the geometry, its covariance with that included; a calibration holds it the next
    time.
    """
    noise = {"encoder_noise": 1e-9, "reference_noise": NOISE, "hold_out": False}
    found = diagnose(plant.arm, plant.measured(150), with_discrepancy=True, **noise)
    assert (found.verdict, found.findings) == ("unexplained", ())
    found.model.save(tmp_path / "extended.toml")
    model, (q, tip) = ErrorModel.load(tmp_path / "extended.toml"), plant.touched(200)
    assert [effect.label for effect in model.effects] == [f"discrepancy:{COUPLING} on angle 4"]
    moves = model.sensitivity(q)
    u = np.sqrt(np.einsum("nip,pq,niq->n", moves, model.covariance(), moves))
    off = np.linalg.norm(model.correct(q) - tip, axis=1)
    assert 0.6 < np.sqrt(np.square(off).mean() / np.square(u).mean()) < 1.5
    assert np.square(u).mean() < np.square(0.5 * NOISE)
    again = calibrate(model, plant.measured(100), "geometry", **noise)
    assert again.model.effects == model.effects


@NO_WAVES
def test_the_base_is_that_of_the_arm_with_the_discrepancy(plant):
    data = plant.measured(150)
    rotation = Rotation.from_rotvec([0.3, -0.2, 0.9])
    turned = np.add(rotation.apply(data.reference), [1.0, 2.0, -0.5])
    noise = {"encoder_noise": 1e-9, "reference_noise": NOISE, "hold_out": False}
    found = diagnose(
        plant.arm,
        replace(data, reference=turned),
        reference_frame="external",
        with_discrepancy=True,
        **noise,
    )
    (base,) = base_placements(found.of_model)
    off = found.model.correct(data.q) @ base.rotation.T + base.shift - turned
    assert np.abs(off.mean(axis=0)).max() < 4.0 * NOISE / np.sqrt(150)


def test_new_records_have_no_labels_and_no_unknown_columns(plant):
    q, tip = plant.touched(60)
    extra = pd.DataFrame({"humidity_pct": plant.rng.uniform(30.0, 50.0, 60)})
    session = np.array(["a", "b"] * 30, dtype=object)
    conditions = Conditions(
        60, time=np.arange(60.0), temperature=plant.rng.uniform(19.0, 22.0, 60), session=session
    )
    records = Measurements.of(q, tip, conditions=conditions, extra=extra, operator=session[::-1])
    ways = [(one.name, way) for one in covariates(plant.arm, records) for way in one.variants]
    lost = {name for name, way in ways if way.smooth is None}
    assert lost == {"session", "operator", "humidity_pct"}
    kept = {(name, way.carrier) for name, way in ways if way.smooth is not None}
    assert {
        ("time", "room"),
        ("temperature", "lengths"),
        ("joint 3 × time", "angle 3"),
        ("place", "room"),
    } < kept
