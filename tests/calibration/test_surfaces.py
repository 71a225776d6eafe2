"""Contacts of spheres and planes as equations, by a plant with its own kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from blind.kinematics import Array
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import calibrate, diagnose
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements, best_sphere
from tests.calibration.contacts import (
    CONTACT,
    PROBE,
    READING,
    SPHERE,
    SPHERES,
    Machine,
    Values,
    calibrated,
    drawn,
    file_of,
    planes_of,
)
from tests.few_causes import ECCENTRICITY_ALONE, FEW
from tests.oracle import close


def test_an_independent_least_squares_with_the_centres_agrees(sino6, rng):
    machine = Machine(sino6, drawn(sino6, rng))
    q, sphere = machine.touching(rng)
    q += READING * rng.normal(size=q.shape)
    result = calibrated(sino6, Measurements.from_frame(file_of(q, sphere)))
    values = Values(sino6, result, q)

    def residual(x: Array) -> Array:
        z, centres = x[: values.count], x[values.count :].reshape(-1, 3)
        way = values.tips(z) - centres[sphere]
        distance = np.linalg.norm(way, axis=1)
        scatter = values.scatter(way / distance[:, None])
        return np.concatenate([(distance - 0.5 * (SPHERE + PROBE)) / scatter, z])

    start = np.concatenate([np.zeros(values.count), result.fit.point.seats.ravel()])
    values.agree(least_squares(residual, start, x_scale="jac"), within=0.02)


def test_a_sphere_through_points_of_one_side(rng):
    points = rng.normal(size=(20, 3))
    points[:, 2] = np.abs(points[:, 2])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    centre, radius = best_sphere([0.3, -0.2, 0.5] + 0.0125 * points)
    close(centre, [0.3, -0.2, 0.5], 1e-12)
    assert radius == pytest.approx(0.0125, abs=1e-12)


def test_the_scale_of_a_sphere_is_that_of_its_diameter(sino6, rng):
    """All tips 1e-3 too far away make spheres of unknown centre larger by 1e-3, and nothing else:
    14 µm of a radius.
    """
    q, sphere = Machine(sino6).touching(rng, noise=0.0)
    table = file_of(q, sphere)
    for scale, least, most in ((1.0, 0.0, 1e-6), (1.001, 12e-6, 15e-6)):
        larger = table.assign(
            feature_diameter_mm=(SPHERE * scale + PROBE * (scale - 1)) * 1e3,
        )
        records = Measurements.from_frame(larger)
        # So much noise that nobody looks for a mistake.
        result = calibrated(sino6, records, parameters="zero-offsets", probe_noise=2e-5)
        assert least <= result.rms_before <= most


@FEW
def test_an_eccentric_encoder_is_found_by_spheres_alone(sino6, rng):
    q, sphere = Machine(sino6).touching(rng)
    read = q - 2e-4 * np.cos(q - 0.7) * (np.arange(6) == 2)
    read += READING * rng.normal(size=q.shape)
    records = Measurements.from_frame(file_of(read, sphere))
    result = diagnose(
        sino6, records, encoder_noise=READING, probe_noise=CONTACT, hold_out=False, rng=rng
    )
    assert [finding.label for finding in result.findings] == ["encoder_eccentricity:3"]
    amplitude, u = result.findings[0].parameters["amplitude_rad"]
    assert amplitude == pytest.approx(2e-4, abs=4 * u)


def test_stated_centres_place_the_arm(sino6, rng):
    machine = Machine(sino6)
    q, sphere = machine.touching(rng, noise=0.0)
    table = file_of(q, sphere)
    radius = 0.5 * (SPHERE + PROBE)
    centres = []
    for k in range(SPHERES):
        tips = machine.tips(q[sphere == k])
        found = least_squares(
            lambda c, tips=tips: np.linalg.norm(tips - c, axis=1) - radius, tips.mean(axis=0)
        )
        centres.append(found.x)
    at = 1e3 * np.array(centres)[sphere]
    table[["x_mm", "y_mm", "z_mm"]] = at
    table[["u_x_mm", "u_y_mm", "u_z_mm"]] = 1e-3
    records = Measurements.from_frame(table)
    assert not records.known.any()
    again = Measurements.from_frame(records.to_frame())
    np.testing.assert_allclose(again.contact_radius, radius)
    result = calibrated(sino6, records, parameters="zero-offsets", reference_frame="base")
    np.testing.assert_allclose(result.fit.point.seats, centres, atol=3e-6)
    assert result.rms < 3e-6


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        (file_of, {"probe_diameter_mm": [""] + [3.0] * 95}, "probe_diameter_mm"),
        (file_of, {"feature_diameter_mm": [25.4] * 95 + [25.5]}, "one value"),
        (file_of, {"feature": [f"S{k // 3}" for k in range(96)]}, "4 or more"),
        (file_of, {"seat": "A"}, "one of the two labels"),
        (planes_of, {"feature_kind": "cone"}, "expected plane"),
        (planes_of, {"x_mm": 1.0, "y_mm": 1.0, "z_mm": 1.0}, "with coordinates"),
        (planes_of, {"feature": [f"E{k // 3}" for k in range(96)]}, "4 or more"),
        (planes_of, {"feature_kind": ["plane"] * 95 + [""]}, "of the plane"),
    ],
)
def test_surfaces_that_cannot_be_used_are_named(file, change, said):
    q = np.random.default_rng(1).uniform(-1, 1, (96, 6))
    table = file(q, np.repeat(np.arange(6), 16)).assign(**change)
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.from_frame(table)


@pytest.mark.long
def test_a_wrong_diameter_or_joint_is_named(sino6, rng):
    q, sphere = Machine(sino6).touching(rng)
    table = file_of(q, sphere)
    result = calibrate(
        sino6, Measurements.from_frame(table.assign(probe_diameter_mm=6.0)), hold_out=False
    )
    (note,) = [note for note in result.notes if note.code == "sphere_diameters"]
    assert note.data["off"] == pytest.approx(-3e-3, rel=0.15)
    with pytest.raises(AacmmError, match="joint 3 have the opposite sign"):
        calibrate(sino6, Measurements.from_frame(table.assign(theta3_deg=-table["theta3_deg"])))


def test_planes_count_as_an_independent_least_squares_says(sino6, rng):
    """Flatness of planes nobody placed: values and u, and a 1e-3 larger arm that no plane shows."""
    machine = Machine(sino6, drawn(sino6, rng))
    q, plane = machine.on_planes(rng)
    q += READING * rng.normal(size=q.shape)
    records = Measurements.from_frame(planes_of(q, plane))
    result = calibrated(sino6, records)
    assert chi2.sf(*result.fit.chi2_stated) > 1e-3
    values = Values(sino6, result, q)
    at = values.tips(np.zeros(values.count))
    normals = np.stack(
        [np.linalg.svd(at[plane == k] - at[plane == k].mean(axis=0))[2][2] for k in range(3)]
    )
    offsets = [at[plane == k].mean(axis=0) @ normals[k] for k in range(3)]

    def residual(x: Array) -> Array:
        z, tilted = x[: values.count], x[values.count :].reshape(3, 3)
        rotations = Rotation.from_rotvec(np.cross(normals, tilted))
        normal = rotations.apply(normals)[plane]
        offset = np.sum(tilted * normals, axis=1) + offsets
        above = np.sum(values.tips(z) * normal, axis=1) - offset[plane]
        return np.concatenate([above / values.scatter(normal), z])

    found = least_squares(residual, np.zeros(values.count + 9), x_scale="jac")
    values.agree(found, within=0.03)


@ECCENTRICITY_ALONE
def test_a_cause_is_found_by_planes_and_held_out_planes_are_predicted(sino6, rng):
    machine = Machine(sino6)
    q, plane = machine.on_planes(rng)
    read = q - 3e-4 * np.cos(q - 0.7) * (np.arange(6) == 2) + READING * rng.normal(size=q.shape)
    result = diagnose(
        sino6,
        Measurements.from_frame(planes_of(read, plane)),
        encoder_noise=READING,
        probe_noise=CONTACT,
        rng=rng,
    )
    assert "encoder_eccentricity:3" in [finding.label for finding in result.findings]
    assert result.held_out is not None


@pytest.mark.long
@pytest.mark.parametrize(
    ("spheres", "contacts", "stated"), [(12, 4, True), (4, 15, False), (6, 8, False)]
)
def test_few_contacts_do_not_exclude_one_another(sino6, spheres, contacts, stated):
    """Nothing is wrong in these files; few numbers are left to judge them by."""
    rng = np.random.default_rng(21)
    known = {"encoder_noise": READING, "probe_noise": CONTACT} if stated else {}
    for _ in range(2):
        q, sphere = Machine(sino6, drawn(sino6, rng)).touching(
            rng, spheres=spheres, contacts=contacts
        )
        q += READING * rng.normal(size=q.shape)
        records = Measurements.from_frame(file_of(q, sphere))
        fit = calibrate(sino6, records, hold_out=False, **known).fit
        assert not fit.excluded.any()
        assert fit.chi2.dof > 0
        if stated:
            assert chi2.sf(*fit.chi2_stated) > 1e-3
