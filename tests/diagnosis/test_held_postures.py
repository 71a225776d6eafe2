"""Errors that records of one posture share, in the uncertainty of what is fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.diagnosis.held_postures import HeldPostures, RecordNoise
from aacmm_pin.effects import EncoderEccentricity, ErrorModel, JointCompliance
from aacmm_pin.measurements import Measurements
from tests.again import again

ALONE, SHARED = 1e-5, 2e-5
"""Noise of each record and of each posture [m]."""


@pytest.mark.parametrize("stated", [True, again(False)])
def test_u_counts_an_error_that_records_share(sino6: Arm, stated: bool) -> None:
    """Estimates scatter over files as far as u says: of the geometry and of a cause."""
    rng = np.random.default_rng(21)
    group = np.repeat(np.arange(40), 6)
    q = random_postures(sino6, 40, rng)[group]
    model, cause = ErrorModel(sino6), JointCompliance(2)
    setup = Setup.of(sino6, "base", "tip", True, 0.0, ALONE if stated else None, None, None)
    scores, as_independent = [], []
    for _ in range(40):
        error = ALONE * rng.standard_normal((240, 3)) + SHARED * rng.standard_normal((40, 3))[group]
        records = Measurements.of(q, sino6.positions(q) + error)
        found = fit(problem_of(model, records, [cause], setup))
        postures = HeldPostures(group, np.full(40, 6.0), np.full(40, 3.0), SHARED / ALONE)
        noise = RecordNoise(np.tile(np.eye(3) / ALONE, (240, 1, 1)), postures)
        more = noise.added_covariance(found, 1.0)
        step = (found.point.x - found.problem.start)[found.problem.vector.slices[-1]]
        own = found.problem.vector.slices[-1]
        u = np.sqrt(np.diag(found.covariance + more)[own])
        scores.append(step / u)
        as_independent.append(step / np.sqrt(np.diag(found.covariance)[own]))
    assert np.sqrt(np.square(scores).mean()) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.square(as_independent).mean()) > 1.5


@pytest.mark.long
def test_an_extended_arm_has_the_u_of_its_causes(sino6):
    """The covariance that its file has is that of the finding, which counts the shared error."""
    rng = np.random.default_rng(22)
    group = np.repeat(np.arange(40), 6)
    q = random_postures(sino6, 40, rng)[group]
    error = ALONE * rng.standard_normal((240, 3)) + SHARED * rng.standard_normal((40, 3))[group]
    hidden = ErrorModel(sino6, (JointCompliance(2, values=(3e-5,)),))
    records = Measurements.of(q, hidden.predict(q) + error)
    noise = {"encoder_noise": 0.0, "reference_noise": ALONE}
    found = diagnose(sino6, records, hold_out=False, **noise)
    (finding,) = found.findings
    covariance = found.model.arm.covariance
    (own,) = (k for k, name in enumerate(covariance.parameters) if "compliance" in name)
    in_file, fit_ = covariance.standard_uncertainty_si[own], found.extended
    place = fit_.problem.vector.slices[-1].start
    independent = replace(fit_, added_covariance=0.0).covariance
    assert in_file == pytest.approx(finding.parameters["compliance_rad_per_nm"][1], rel=0.15)
    assert in_file > 1.5 * np.sqrt(independent[place, place])


def _held(
    model: ErrorModel,
    count: int,
    rng: np.random.Generator,
    shared: float = 0.0,
    wobble: float = 0.0,
) -> Measurements:
    """Records of some postures, four to eight of each, which share an error [m], held to within
    ``wobble`` [rad].
    """
    group = np.repeat(np.arange(count), int(rng.integers(4, 9)))
    q = random_postures(model.arm, count, rng)[group]
    q = q + wobble * rng.standard_normal(q.shape)
    error = ALONE * rng.standard_normal((len(q), 3))
    error += shared * rng.standard_normal((count, 3))[group]
    return Measurements.of(q, model.predict(q) + error)


@pytest.mark.parametrize("wobble", [2e-3, again(0.0), again(5e-3)])
def test_a_hand_holds_no_posture_exactly(sino6: Arm, wobble: float) -> None:
    """What near repeats share is no cause, and its size is found."""
    records = _held(ErrorModel(sino6), 40, np.random.default_rng(32), 3.0 * ALONE, wobble)
    found = diagnose(
        sino6, records, encoder_noise=0.0, reference_noise=ALONE, hold_out=False, progress=False
    )
    assert not found.findings
    assert found.unexplained.shared_by_postures is not None
    assert found.choice.noise.postures.ratio == pytest.approx(3.0, rel=0.2)


@pytest.mark.parametrize("seed", [3, again(1), again(9), again(12)])
def test_causes_that_others_imitate_are_no_shared_error(seed: int) -> None:
    """Few postures leave it open which of the causes acts, but not that one does."""
    ur5, rng = Arm.from_urdf("ur5"), np.random.default_rng(seed)
    causes = JointCompliance(2, values=(4e-6,)), EncoderEccentricity(5, values=(2e-4, 3e-4))
    records = _held(ErrorModel(ur5, causes), int(rng.integers(12, 20)), rng)
    found = diagnose(
        ur5, records, encoder_noise=0.0, reference_noise=ALONE, hold_out=False, progress=False
    )
    assert found.unexplained.shared_by_postures is None
    assert found.choice.noise.postures.ratio < 0.5
    assert "joint_compliance:2" in [finding.label for finding in found.findings]
