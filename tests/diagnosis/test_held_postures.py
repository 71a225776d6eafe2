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
from aacmm_pin.effects import ErrorModel, JointCompliance
from aacmm_pin.measurements import Measurements

ALONE, SHARED = 1e-5, 2e-5
"""Noise of each record and of each posture [m]."""


@pytest.mark.parametrize("stated", [True, False])
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
        postures = HeldPostures(group, np.full(40, 6.0), SHARED / ALONE)
        noise = RecordNoise(np.tile(np.eye(3) / ALONE, (240, 1, 1)), postures)
        more = noise.added_covariance(found, 1.0)
        step = (found.point.x - found.problem.start)[found.problem.vector.slices[-1]]
        own = found.problem.vector.slices[-1]
        u = np.sqrt(np.diag(found.covariance + more)[own])
        scores.append(step / u)
        as_independent.append(step / np.sqrt(np.diag(found.covariance)[own]))
    assert np.sqrt(np.square(scores).mean()) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.square(as_independent).mean()) > 1.5


def test_an_extended_arm_has_the_u_of_its_causes(sino6):
    """The covariance that its file has is that of the finding, which counts the shared error."""
    rng = np.random.default_rng(22)
    group = np.repeat(np.arange(40), 6)
    q = random_postures(sino6, 40, rng)[group]
    error = ALONE * rng.standard_normal((240, 3)) + SHARED * rng.standard_normal((40, 3))[group]
    hidden = ErrorModel(sino6, (JointCompliance(2, values=(3e-5,)),))
    records = Measurements.of(q, hidden.predict(q) + error)
    noise = {"encoder_noise": 0.0, "reference_noise": ALONE}
    found = diagnose(sino6, records, hold_out=False, progress=False, **noise)
    (finding,) = found.findings
    covariance = found.model.arm.covariance
    (own,) = (k for k, name in enumerate(covariance.parameters) if "compliance" in name)
    in_file, fit_ = covariance.standard_uncertainty_si[own], found.extended
    place = fit_.problem.vector.slices[-1].start
    independent = replace(fit_, added_covariance=0.0).covariance
    assert in_file == pytest.approx(finding.parameters["compliance_rad_per_nm"][1], rel=0.15)
    assert in_file > 1.5 * np.sqrt(independent[place, place])
