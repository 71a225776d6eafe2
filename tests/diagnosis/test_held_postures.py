"""Errors that records of one posture share, in the uncertainty of what is fitted to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from aacmm_pin.arm import Arm
from aacmm_pin.arm.random_postures import random_postures
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.parameters import problem_of
from aacmm_pin.calibration.setup import Setup
from aacmm_pin.diagnosis import diagnose
from aacmm_pin.diagnosis.record_noise import RecordNoise
from aacmm_pin.effects import (
    Conditions,
    EncoderEccentricity,
    ErrorModel,
    JointCompliance,
    StylusOffset,
)
from aacmm_pin.measurements import Measurements
from aacmm_pin.measurements.orientation import quaternions
from tests.again import again
from tests.few_causes import FEW

ALONE, SHARED = 1e-5, 2e-5
"""Noise of each record and of each posture [m]."""


@pytest.mark.parametrize("stated", [True, again(False)])
def test_u_counts_an_error_that_records_share(sino6, stated):
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
        whitening = np.tile(np.eye(3) / ALONE, (240, 1, 1))
        noise = RecordNoise(whitening, group, np.full(40, 3.0), SHARED / ALONE)
        more = noise.added_covariance(found, 1.0)
        step = (found.point.x - found.problem.start)[found.problem.vector.slices[-1]]
        own = found.problem.vector.slices[-1]
        u = np.sqrt(np.diag(found.covariance + more)[own])
        scores.append(step / u)
        as_independent.append(step / np.sqrt(np.diag(found.covariance)[own]))
    assert np.sqrt(np.square(scores).mean()) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.square(as_independent).mean()) > 1.5


READING = 5e-4
"""Scatter of the readings, which all targets of a posture share [rad]."""


def _targets(arm: Arm, rng: np.random.Generator, turned: bool = False) -> Measurements:
    """Three targets of each of 40 postures, measured while the encoders were read once."""
    places = {"a": (0.0, 0.05, 0.1), "b": (0.08, 0.0, 0.15), "c": (0.0, -0.08, 0.2)}
    model = ErrorModel(arm, tuple(StylusOffset(one, values=at) for one, at in places.items()))
    marker = np.tile(np.array([*"abc"], dtype=object), 40)
    q = np.repeat(random_postures(arm, 40, rng), 3, axis=0)
    conditions = Conditions(120, marker=marker)
    real = q + np.repeat(READING * rng.standard_normal((40, arm.nq)), 3, axis=0)
    points = model.predict(real, conditions) + ALONE * rng.standard_normal((120, 3))
    if not turned:
        return Measurements.of(q, points, conditions=conditions)
    orientation = quaternions(model.state(real, conditions).rotation[-1])
    u = np.full(120, 1e-5)
    return Measurements.of(
        q, points, conditions=conditions, orientation=orientation, orientation_u=u
    )


@pytest.mark.parametrize("of_readings", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_rows_are_whitened_as_by_the_covariance_of_all(sino6, turned, of_readings):
    """Of stated readings that targets share, and an error of the noise's shape or one of
    readings.
    """
    rng = np.random.default_rng(41)
    records = _targets(sino6, rng, turned).take(np.arange(36))
    width = 6 if turned else 3
    setup = Setup.of(sino6, "base", "unknown", True, READING, ALONE, None, None)
    at = fit(problem_of(ErrorModel(sino6), records, "geometry", setup))
    weights = at.noise.whitening
    ratio = 3.0 if of_readings else 0.7
    alone = RecordNoise.of_postures(at, weights)
    noise = replace(alone, ratio=ratio, of_readings=of_readings)
    by_reading = at.problem.reading_jacobian(at.point.x, at.point.frame)
    together = np.kron(np.eye(12), np.ones((3, 3)))[:, None, :, None]
    stated = np.einsum("nij,mkj->nimk", by_reading * READING, by_reading * READING)
    beyond = by_reading * ratio * of_readings * noise.readings
    covariance = stated + np.einsum("nij,mkj->nimk", beyond, beyond)
    own = np.diag(np.tile([ALONE**2] * 3 + [1e-10] * (width - 3), 36)).reshape(stated.shape)
    unwhitening = np.linalg.inv(weights)
    alike = ratio * (not of_readings) * unwhitening
    like_noise = np.einsum("nij,mkj->nimk", alike, alike)
    rows = unwhitening @ rng.standard_normal((36, width, 4))
    of_all = ((covariance + like_noise) * together + own).reshape(36 * width, -1)
    whitened = noise.whitened(rows).reshape(36 * width, 4)
    flat = rows.reshape(36 * width, 4)
    np.testing.assert_allclose(
        whitened.T @ whitened, flat.T @ np.linalg.solve(of_all, flat), rtol=1e-4
    )
    shared = of_all - (stated * together + own).reshape(of_all.shape)
    columns = at.point.prediction.jacobian.reshape(len(of_all), -1)
    pulls = np.linalg.solve(of_all - shared, columns) @ at.system.covariance(at.unknown)
    wanted = pulls.T @ shared @ pulls
    added = noise.added_covariance(at, 1.0)
    variances = np.diag(at.system.covariance(at.unknown) + wanted)
    scale = np.sqrt(np.outer(variances, variances)) + 1e-30
    np.testing.assert_allclose(added / scale, wanted / scale, atol=1e-3)


@FEW
@pytest.mark.parametrize("stated", [False, again(True)])
def test_targets_share_the_scatter_of_a_reading(sino6, stated):
    """Where it is stated, it is noise; elsewhere it is found, and is no cause."""
    records = _targets(sino6, np.random.default_rng(42))
    noise = {"encoder_noise": READING, "reference_noise": ALONE} if stated else {}
    found = diagnose(sino6, records, target="unknown", hold_out=False, **noise)
    assert not found.findings
    shared = found.unexplained.shared_by_postures
    at = found.choice.fit
    by_reading = at.problem.reading_jacobian(at.point.x, at.point.frame)
    if stated:
        assert shared is None
        assert chi2.sf(*found.recalibrated.chi2_stated) == pytest.approx(0.5, abs=0.49)
        return
    wanted = READING * np.sqrt(np.square(by_reading).sum(axis=(1, 2)).mean())
    assert shared is not None
    assert shared.rms == pytest.approx(wanted, rel=0.1)
    assert shared.times == pytest.approx(wanted / (np.sqrt(3.0) * ALONE), rel=0.2)


@pytest.mark.parametrize("of_readings", [True, False])
@pytest.mark.parametrize("together", [True, False])
def test_the_shape_of_a_shared_error(of_readings, together):
    """Sizes over files as they were drawn; what scatters from record to record is not shared."""
    rng = np.random.default_rng(43)
    group = np.repeat(np.arange(60), 3)
    error = group if together else np.arange(180)
    by_reading = rng.standard_normal((180, 3, 4)) / np.sqrt(4.0)
    whitening = np.tile(np.eye(3), (180, 1, 1))
    noise = RecordNoise(whitening, group, np.full(60, 3.0), by_reading=by_reading)
    noise = replace(noise, readings=np.ones(4))
    sizes = []
    for _ in range(20):
        residual = rng.standard_normal((180, 3))
        if of_readings:
            moved = 8.0 * rng.standard_normal((180, 4))[error]
            residual += np.einsum("nij,nj->ni", by_reading, moved)
        else:
            residual += 8.0 * rng.standard_normal((180, 3))[error]
        found = noise.likeliest(residual, 540.0)
        sizes.append([found.ratio, found.ratio * found.of_readings])
    wanted = 8.0 * together * np.array([1.0, of_readings])
    np.testing.assert_allclose(np.median(sizes, axis=0), wanted, rtol=0.1, atol=0.3)


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


@FEW
@pytest.mark.parametrize("wobble", [2e-3, again(0.0), again(5e-3)])
def test_a_hand_holds_no_posture_exactly(sino6, wobble):
    """What near repeats share is no cause, and its size is found."""
    records = _held(ErrorModel(sino6), 40, np.random.default_rng(32), 3.0 * ALONE, wobble)
    found = diagnose(sino6, records, encoder_noise=0.0, reference_noise=ALONE, hold_out=False)
    assert not found.findings
    assert found.unexplained.shared_by_postures is not None
    assert found.choice.noise.ratio == pytest.approx(3.0, rel=0.2)


@FEW
@pytest.mark.parametrize("seed", [3, again(1), again(9), again(12)])
def test_causes_that_others_imitate_are_no_shared_error(seed):
    """Few postures leave it open which of the causes acts, but not that one does."""
    ur5, rng = Arm.from_urdf("ur5"), np.random.default_rng(seed)
    causes = JointCompliance(2, values=(4e-6,)), EncoderEccentricity(5, values=(2e-4, 3e-4))
    records = _held(ErrorModel(ur5, causes), int(rng.integers(12, 20)), rng)
    found = diagnose(ur5, records, encoder_noise=0.0, reference_noise=ALONE, hold_out=False)
    assert found.unexplained.shared_by_postures is None
    assert found.choice.noise.ratio < 0.5
    assert "joint_compliance:2" in [finding.label for finding in found.findings]
