"""What is said of scatter, of held postures and of the size of structure, beside all that was
found.
"""

from __future__ import annotations

import numpy as np
import pytest

from aacmm_pin import next_measurements
from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.measurements import Measurements
from aacmm_pin.report.diagnosis_page import unexplained_in_words
from tests.again import again
from tests.few_causes import FEW, NO_WAVES

READING, REFERENCE = 8e-6, 1e-5


def diagnosed(
    arm: Arm, q: Array, true: Array, shift: Array | float, rng: np.random.Generator, stated: bool
) -> Diagnosis:
    """Of records whose joints truly stand at ``true`` (n, nq), the references shifted by ``shift``
    (n, 3) [m].
    """
    read = q + READING * rng.standard_normal(q.shape)
    reference = arm.positions(true) + shift + REFERENCE * rng.standard_normal((len(q), 3))
    noise = {"encoder_noise": READING, "reference_noise": REFERENCE} if stated else {}
    return diagnose(arm, Measurements.of(read, reference), hold_out=False, **noise)


@FEW
@pytest.mark.parametrize("stated", [True, again(False)])
def test_records_of_one_posture_share_an_error(sino6, stated):
    rng = np.random.default_rng(1)
    order = rng.permutation(180)
    shared = 2e-5 * rng.standard_normal((60, 3))[order // 3]
    q = random_postures(sino6, 60, rng)[order // 3]
    found = diagnosed(sino6, q, q, shared, rng, stated)
    error = found.unexplained.shared_by_postures
    assert error.rms == pytest.approx(np.sqrt(3.0) * 2e-5, rel=0.2)
    assert error.p_value < 1e-6
    assert (found.verdict, found.findings, found.unexplained.readings) == ("unexplained", (), ())
    assert "another day" in next_measurements(found)
    said = found.summary()["unexplained"]["shared_by_postures"]
    assert said["rms_mm"] == pytest.approx(1e3 * error.rms)


@FEW
def test_records_of_one_posture_that_share_none(sino6):
    rng = np.random.default_rng(2)
    q = np.repeat(random_postures(sino6, 50, rng), 3, axis=0)[rng.permutation(150)]
    found = diagnosed(sino6, q, q, 0.0, rng, False)
    assert (found.verdict, found.unexplained.shared_by_postures) == ("no-discrepancy", None)


@NO_WAVES
def test_two_joints_that_act_together_are_no_scatter(sino6):
    """The size of what is described is that of tips, beside which the noise is left."""
    rng = np.random.default_rng(3)
    q = random_postures(sino6, 240, rng)
    off = np.zeros_like(q)
    off[:, 1] = 1e-4 * np.sin(q[:, 1] + q[:, 4])
    found = diagnosed(sino6, q, q + off, 0.0, rng, True)
    assert found.unexplained.readings == ()
    (structure,) = found.unexplained.discrepancy
    assert structure.covariate == "joint 2 × joint 5"
    left = np.sqrt(found.rms["extended"] ** 2 - found.noise**2)
    assert structure.rms == pytest.approx(left, rel=0.1)


@FEW
def test_readings_that_scatter_have_a_chance(sino6):
    rng = np.random.default_rng(4)
    q = random_postures(sino6, 200, rng)
    true = q.copy()
    true[:, 3] += 6e-5 * rng.standard_normal(200)
    found = diagnosed(sino6, q, true, 0.0, rng, True)
    (readings,) = found.unexplained.readings
    assert (readings.joint, readings.scatter) == (4, pytest.approx(6e-5, rel=0.25))
    assert readings.p_value < 1e-6
    # By the calibrated geometry: densities with the scatter and without; tips scatter too.
    records = found.recalibrated.problem.measurements
    off, jacobian = records.reference - found.model.predict(records.q), sino6.jacobian(records.q)
    noise = READING**2 * jacobian @ jacobian.transpose(0, 2, 1) + REFERENCE**2 * np.eye(3)
    lever = jacobian[:, :, 3, None] * jacobian[:, None, :, 3]

    def log_density(scatter: float) -> float:
        logs = []
        for tip in np.linspace(0.0, 6e-5, 31):
            covariances = noise + tip**2 * np.eye(3) + scatter**2 * lever
            squares = np.einsum("ni,nij,nj->", off, np.linalg.inv(covariances), off)
            logs.append(-0.5 * float(np.linalg.slogdet(covariances)[1].sum() + squares))
        return max(logs)

    ratio = max(map(log_density, np.linspace(4e-5, 8e-5, 11))) - log_density(0.0)
    said = found.summary()["unexplained"]["scattered_readings"][0]
    assert said["log_likelihood_ratio"] == pytest.approx(ratio, rel=0.1)
    assert "p < 1e-16" in " ".join(unexplained_in_words(found.unexplained))
    assert len(found.notes) <= 3
