"""Accuracy volumes, covariances and budgets against determinants, Monte Carlo on real models, and
independent numbers.
"""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy import volume
from aacmm_pin.accuracy.volume import (
    COVERED,
    ELLIPSOID_COVERAGE_FACTOR,
    METHODS,
    POSTURES_AT_ONCE,
    accuracy_volume,
)
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel, ThermalExpansion
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError
from aacmm_pin.postures.configurations import configuration_circle
from tests import arm_files
from tests.arm_files import changed
from tests.oracle import close, derivative, jacobian_of, perturbed_positions, zonotope_volume

SEATS_MM = [
    (33.6323, -671.8702, 182.9355),
    (10.1341, -730.7728, 389.9761),
    (-230.0463, -866.3197, 183.1664),
    (37.0566, -1039.2153, 183.183),
    (75.7654, -655.0313, 665.6672),
    (-17.4909, -736.6225, 731.4539),
]
JOINTWISE = [(1.05, 1.42), (1.17, 1.72), (1.21, 1.88), (1.20, 2.07), (1.22, 1.92), (1.22, 2.06)]
"""Least and largest joint-wise volume over the circle of each seat, from an independent analysis
[1e-4 mm³].
"""
FULL = [(51, 79), (60, 91), (56, 91), (65, 100), (68, 97), (76, 106)]
"""The same of the full zonotope."""
ELLIPSOID = [(3.5, 5.5), (4.5, 6.1), (4.7, 6.4), (5.3, 6.5), (5.4, 6.5), (5.8, 6.6)]
"""The same of 4/3 π sqrt(det Σ g gᵀ)."""


@pytest.fixture(scope="session")
def ur5(robot_file) -> Arm:
    return Arm.from_urdf(
        robot_file("ur5_robot.urdf"),
        "ee_link",
        translation_half_width=2e-5,
        rotation_half_width=4e-5,
    )


@pytest.fixture(params=["sino6", "ur5"])
def arm(request) -> Arm:
    chosen: Arm = request.getfixturevalue(request.param)
    return chosen


@pytest.fixture(scope="session")
def nominal() -> Arm:
    """The arm as the analysis took it."""
    return Arm.from_file(arm_files.nominal())


def some(arm: Arm, n: int, seed: int = 5) -> Array:
    return np.random.default_rng(seed).uniform(
        np.maximum(arm.limits[:, 0], -3), np.minimum(arm.limits[:, 1], 3), (n, arm.nq)
    )


def widths(arm: Arm) -> Array:
    return np.array([p.half_width for p in arm.parameters])


def numeric_sensitivity(arm: Arm, q: Array) -> Array:
    """By central differences of the exact positions: (3, parameters)."""
    zero = np.zeros(len(arm.parameters))
    return derivative(lambda errors: perturbed_positions(arm, q, errors[None])[0], zero)


# --- volumes


def test_zonotope_and_jointwise_are_sums_of_determinants(arm):
    q = some(arm, 2)
    full, by_joint = (
        accuracy_volume(arm, q, method=method) for method in ("zonotope", "jointwise")
    )
    joints = np.array([p.joint for p in arm.parameters])
    for k in range(2):
        g = numeric_sensitivity(arm, q[k : k + 1]) * widths(arm)
        assert full.volume[k] == pytest.approx(zonotope_volume(g), rel=1e-6, abs=0.0)
        of_joints = sum(zonotope_volume(g[:, joints == j]) for j in np.unique(joints))
        assert by_joint.volume[k] == pytest.approx(of_joints, rel=1e-6, abs=0.0)
        assert by_joint.volume[k] < 0.2 * full.volume[k]


def test_ellipsoid_is_that_of_the_covariance(arm):
    result = accuracy_volume(arm, some(arm, 4), method="ellipsoid")
    axes = ELLIPSOID_COVERAGE_FACTOR * np.sqrt(np.linalg.eigvalsh(result.covariance))
    np.testing.assert_allclose(result.volume, 4 / 3 * np.pi * axes.prod(axis=1), rtol=1e-9)
    assert pytest.approx(2.80, abs=5e-3) == ELLIPSOID_COVERAGE_FACTOR
    assert chi2.cdf(ELLIPSOID_COVERAGE_FACTOR**2, 3) == pytest.approx(0.95, rel=1e-12)


def test_ellipsoid_holds_95_percent_of_normal_errors(zero6, rng):
    """Encoder noise alone, without uncertain parameters: of 40 000 real readings 95 % ± 0.4 % lie
    in the ellipsoid.
    """
    q = some(zero6, 1)
    result = accuracy_volume(zero6, q, method="ellipsoid", encoder_noise=2e-5)
    read = zero6.poses(q + 2e-5 * rng.normal(size=(40_000, 6))).position - zero6.poses(q).position
    distance = np.einsum("ni,ij,nj->n", read, np.linalg.inv(result.covariance[0]), read)
    assert (distance < ELLIPSOID_COVERAGE_FACTOR**2).mean() == pytest.approx(0.95, abs=0.005)


def test_u_of_a_position_covers_what_is_said(rng):
    """And a part in between where the errors are neither along one direction nor isotropic."""
    assert [chi2.cdf(4, 1), chi2.cdf(12, 3)] == pytest.approx(COVERED, abs=5e-4)
    for variances in rng.dirichlet((0.5, 0.5, 0.5), 20):
        inside = (rng.normal(size=(100_000, 3)) ** 2 @ variances < 4).mean()
        assert COVERED[0] - 3e-3 < inside < COVERED[1] + 1e-3


@pytest.mark.parametrize(("name", "draws", "n"), [("sino6", 3000, 2), ("ur5", 600, 1)])
def test_monte_carlo_hull_nears_the_zonotope_from_inside(name, draws, n, request, rng):
    arm: Arm = request.getfixturevalue(name)
    q = some(arm, n)
    exact = accuracy_volume(arm, q)
    hull = accuracy_volume(arm, q, method="monte-carlo", rng=rng, draws=draws)
    second_order = 1e-3  # errors of 1e-4 relative turn the generators by as much
    assert (hull.volume < exact.volume * (1 + second_order)).all()
    np.testing.assert_allclose(hull.volume, exact.volume, rtol=0.02 if name == "sino6" else 0.1)
    spread = np.trace(hull.covariance, axis1=1, axis2=2) / np.trace(
        exact.covariance, axis1=1, axis2=2
    )
    close(spread, 1.0, 6 / np.sqrt(draws))


@pytest.mark.parametrize(("name", "draws"), [("sino6", 30_000), ("ur5", 2_000)])
def test_covariance_is_that_of_the_real_model(name, draws, request, rng):
    """Rectangular draws of every parameter and normal ones of the readings, moved through the exact
    model.
    """
    arm: Arm = request.getfixturevalue(name)
    q = some(arm, 1, seed=9)
    noise = np.linspace(1e-5, 3e-5, 6)
    covariance = accuracy_volume(arm, q, encoder_noise=noise).covariance[0]
    errors = rng.uniform(-1, 1, (draws, len(arm.parameters))) * widths(arm)
    moved = perturbed_positions(arm, q + noise * rng.normal(size=(draws, 6)), errors)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    close(np.cov(moved.T) / scale, covariance / scale, 7 / np.sqrt(draws))
    s = numeric_sensitivity(arm, q) * widths(arm) / np.sqrt(3)
    jacobian = jacobian_of(arm.poses(q))[0, :3] * noise
    close((s @ s.T + jacobian @ jacobian.T) / scale, covariance / scale, 1e-6)


def test_published_ranges_at_the_six_seats(nominal, sino6):
    """The largest values agree to the printed digits, the least of the zonotope too. The joint-wise
    volume has a narrow dip near θ3 = ±84°, the ellipsoid a shallow one; the analysis saw θ3 about
    every 30° and its least values lie above these, by 7 to 13 % and 2 %.
    """
    for seat, by_joint, full, ellipsoid in zip(SEATS_MM, JOINTWISE, FULL, ELLIPSOID, strict=True):
        for arm, slack in ((nominal, 0.006), (sino6, 0.03))[: 2 if seat in SEATS_MM[:2] else 1]:
            circle = configuration_circle(arm, np.array(seat) * 1e-3)
            q = circle.q[circle.within_limits]
            volume = accuracy_volume(arm, q, at="frame5", method="jointwise").volume * 1e13
            assert volume.max() == pytest.approx(by_joint[1], abs=0.02 + slack)
            assert 0.86 * by_joint[0] < volume.min() < by_joint[0]
            accuracy = accuracy_volume(arm, q, at="frame5")
            assert accuracy.volume.min() * 1e13 == pytest.approx(full[0], abs=1.0)
            assert accuracy.volume.max() * 1e13 == pytest.approx(full[1], abs=1.0)
            covariance = accuracy.covariance
            # Half-widths in place of u.
            volume = 4 / 3 * np.pi * np.sqrt(np.linalg.det(3 * covariance)) * 1e13
            assert volume.min() == pytest.approx(ellipsoid[0], rel=0.03)
            assert volume.max() == pytest.approx(ellipsoid[1], rel=slack, abs=0.06)


def test_largest_deviation_bounds_the_real_model(sino6, rng):
    for q in some(sino6, 2)[:, None]:
        largest = accuracy_volume(sino6, q).largest_deviation[0]
        towards = rng.normal(size=(4000, 3)) @ (sino6.sensitivity(q)[0] * widths(sino6))
        for corners, of_largest in (
            (rng.choice([-1.0, 1.0], (4000, 24)), 0.0),
            (np.sign(towards), 0.998),
        ):
            tips = perturbed_positions(sino6, q, corners * widths(sino6))
            moved = np.linalg.norm(tips - sino6.poses(q).position, axis=1).max()
            assert of_largest * largest < moved < 1.001 * largest


# --- sources


def test_u_aligned_is_what_a_rigid_fit_leaves(ur5, rng):
    """Of arms drawn with a badly known placement of joint 1: each is aligned by the rotation that
    SciPy fits to its tips.
    """
    unplaced = [replace(p, u=20 * p.u) for p in ur5.parameters[:6]]
    arm = replace(ur5, parameters=(*unplaced, *ur5.parameters[6:]))
    u = np.array([p.u for p in arm.parameters])
    draws = 400
    q = rng.uniform(-2, 2, (12, 6))
    nominal = arm.positions(q)
    centre = nominal.mean(axis=0)
    left = np.empty((draws, *nominal.shape))
    for k in range(draws):
        errors = np.tile(u * rng.standard_normal(len(u)), (len(q), 1))
        moved = perturbed_positions(arm, q, errors)
        about = moved - moved.mean(axis=0)
        turn, _ = Rotation.align_vectors(nominal - centre, about)
        left[k] = turn.apply(about) + centre - nominal
    found = accuracy_volume(arm, q, method="ellipsoid")
    assert (found.u > 5 * found.u_aligned).all()
    scatter = np.sqrt(np.square(left).sum(axis=2).mean(axis=0))
    np.testing.assert_allclose(scatter, found.u_aligned, rtol=0.12)


def test_stated_encoder_noise_is_taken_from_the_file(sino6):
    noise, q = 1e-5 * np.arange(1, 7), some(sino6, 2)
    arm = changed("sino6", {k + 1: {"encoder_noise_rad": u} for k, u in enumerate(noise)})
    for mine, given in ((None, noise), (0.0, None)):
        found, expected = (
            accuracy_volume(arm, q, encoder_noise=mine),
            accuracy_volume(sino6, q, encoder_noise=given),
        )
        np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-12)


# --- budget


# --- what cannot be asked


def test_nothing_uncertain_is_an_error_not_perfection(zero6, robot_file):
    bare = Arm.from_urdf(robot_file("ur5_robot.urdf"), "ee_link")
    for arm in (zero6, bare):
        with pytest.raises(AacmmError, match="uncertainty"):
            accuracy_volume(arm, np.zeros((1, 6)))
        assert (
            accuracy_volume(arm, some(arm, 1), method="ellipsoid", encoder_noise=1e-5).volume[0] > 0
        )
        with pytest.raises(AacmmError, match="uncertainty"):
            accuracy_volume(arm, np.zeros((1, 6)), method="ellipsoid", encoder_noise=0.0)
        with pytest.raises(AacmmError, match="half-widths"):
            accuracy_volume(arm, np.zeros((1, 6)), encoder_noise=1e-5)


def test_what_cannot_be_asked(sino6):
    few = {"method": "monte-carlo", "rng": np.random.default_rng(1), "draws": 99}
    asked: list[tuple[dict[str, object], type[Exception], str]] = [
        ({"q": np.zeros(6)}, ShapeError, r"q\[None, :\]"),
        ({"at": "elbow"}, UnknownNameError, "frame5"),
        ({"encoder_noise": 1.65}, AacmmError, "1.65 rad; expected 0 to 0.005"),
        ({"encoder_noise": [1e-5] * 5}, ShapeError, "encoder_noise"),
        ({"method": "box"}, UnknownNameError, ", ".join(METHODS)),
        ({"method": "monte-carlo"}, AacmmError, "rng"),
        (few, AacmmError, "at least 100"),
    ]
    for arguments, error, words in asked:
        with pytest.raises(error, match=words):
            accuracy_volume(sino6, **({"q": np.zeros((1, 6))} | arguments))
    result = accuracy_volume(sino6, np.empty((0, 6)))
    assert result.volume.shape == result.largest_deviation.shape == (0,)
    assert len(result.to_frame()) == 0


# --- size


def test_memory_grows_only_with_the_result(sino6, monkeypatch):
    """Beyond q, volume and covariance, 30 000 configurations need no more than 5 000."""
    # A slow machine may load numba between the two, which takes 20 MB.
    monkeypatch.setenv("AACMM_PIN_COMPILED", "never")
    beyond = []
    for n in (POSTURES_AT_ONCE, 60_000):
        q = some(sino6, n)
        tracemalloc.start()
        result = accuracy_volume(sino6, q)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        beyond.append(peak - result.q.nbytes - result.volume.nbytes - result.covariance.nbytes)
    assert beyond[1] < 1.2 * beyond[0] + 2 * q.nbytes
    assert beyond[1] < 60e6


def test_parts_of_a_batch_have_their_own_conditions(sino6, monkeypatch):
    """Warmth that grows along the batch: what each posture has by itself, in covariance, budget and
    largest deviation.
    """
    monkeypatch.setattr(volume, "POSTURES_AT_ONCE", 50)
    monkeypatch.setattr(volume._parts, "__defaults__", (50,))
    q = some(sino6, 150)
    model = ErrorModel(sino6, (ThermalExpansion(values=(1e-5,), u=(5e-6,)),))
    warmth = Conditions(len(q), temperature=np.linspace(20.0, 60.0, len(q)))
    whole = accuracy_volume(model, q, conditions=warmth, method="ellipsoid")
    last = slice(50, None)
    part = accuracy_volume(model, q[last], conditions=warmth.take(last), method="ellipsoid")
    first = accuracy_volume(model, q[last], conditions=warmth.take(slice(100)), method="ellipsoid")
    np.testing.assert_allclose(whole.covariance[last], part.covariance, rtol=1e-12, atol=1e-25)
    np.testing.assert_allclose(whole.largest_deviation[last], part.largest_deviation, rtol=1e-12)
    assert (part.u > 1.05 * first.u).any()
    assert np.square(whole.budget()["u_mm"]).sum() == pytest.approx(
        1e6 * np.square(whole.u).mean(), rel=1e-12
    )
