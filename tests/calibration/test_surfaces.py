"""Contacts of spheres and planes as equations, by a plant with its own kinematics."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from blind.kinematics import Array
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from aacmm_pin import calibrate, diagnose
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.measurements import Measurements
from tests.oracle import dh_frames

SPHERE, PROBE = 25.4e-3, 3e-3
READING, CONTACT = 8e-6, 3e-6
SPHERES, CONTACTS = 6, 16
ROW = ("a", "d", "alpha", "theta_offset")


class Machine:
    """SINO6 with errors of its parameters (p,), and postures that touch spheres anywhere."""

    def __init__(self, arm: Arm, errors: Array) -> None:
        stated = {p.name: p.value + e for p, e in zip(arm.parameters, errors, strict=True)}
        self.table = np.array([[stated[f"{name}{j}"] for name in ROW] for j in range(1, 7)])

    def tips(self, q: Array) -> Array:
        return dh_frames(self.table, q)[:, :3, 3]

    def at(self, points: Array, start: Array) -> Array:
        """Postures (n, 6) whose tips are at points (n, 3), from postures near by."""
        q = start.copy()
        for _ in range(50):
            off = points - self.tips(q)
            columns = [
                (self.tips(q + 1e-6 * axis) - self.tips(q - 1e-6 * axis)) / 2e-6
                for axis in np.eye(6)
            ]
            jacobian = np.stack(columns, axis=2)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian, rcond=1e-3), off)
            q += np.clip(step, -0.2, 0.2)
        return q[np.linalg.norm(points - self.tips(q), axis=1) < 1e-12]

    def touching(
        self,
        rng: np.random.Generator,
        noise: float = CONTACT,
        spheres: int = SPHERES,
        contacts: int = CONTACTS,
    ) -> tuple[Array, Array]:
        """Postures (n, 6) at contacts with spheres, whose centres are nowhere stated, and the
        number of the sphere of each (n,).
        """
        found, numbers = [], []
        for k in range(spheres):
            start = rng.uniform(-1.2, 1.2, 6)
            centre = self.tips(start[None])[0]
            away = rng.normal(size=(2 * contacts, 3))
            away /= np.linalg.norm(away, axis=1)[:, None]
            points = centre + 0.5 * (SPHERE + PROBE) * away
            points += noise * rng.normal(size=points.shape)
            q = self.at(points, start + rng.uniform(-0.5, 0.5, (len(points), 6)))[:contacts]
            found.append(q)
            numbers += [k] * len(q)
        return np.concatenate(found), np.array(numbers)

    def on_planes(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Postures (n, 6) on planes 1.2 m wide, and the number of the plane of each (n,)."""
        found, numbers = [], []
        for k in range(3):
            start = rng.uniform(-1.2, 1.2, (3 * CONTACTS, 6))
            normal = rng.normal(size=3)
            normal /= np.linalg.norm(normal)
            point = self.tips(start)[0]
            tips = self.tips(start)
            points = tips - np.outer((tips - point) @ normal, normal)
            points += CONTACT * rng.normal(size=points.shape)
            near = np.linalg.norm(points - point, axis=1) < 0.6
            q = self.at(points[near], start[near]) if near.sum() else np.empty((0, 6))
            found.append(q)
            numbers += [k] * len(q)
        return np.concatenate(found), np.array(numbers)


def planes_of(q: Array, plane: Array) -> pd.DataFrame:
    table = pd.DataFrame(np.degrees(q), columns=[f"theta{j}_deg" for j in range(1, 7)])
    return table.assign(feature=[f"E{k}" for k in plane], feature_kind="plane")


def file_of(q: Array, sphere: Array) -> pd.DataFrame:
    table = pd.DataFrame(np.degrees(q), columns=[f"theta{j}_deg" for j in range(1, 7)])
    labels = [f"S{k}" for k in sphere]
    diameters = {"feature_diameter_mm": SPHERE * 1e3, "probe_diameter_mm": PROBE * 1e3}
    return table.assign(feature=labels, **diameters)


def calibrated(arm: Arm, q: Array, sphere: Array) -> Calibration:
    records = Measurements.from_frame(file_of(q, sphere))
    return calibrate(arm, records, encoder_noise=READING, probe_noise=CONTACT, hold_out=False)


def drawn(arm: Arm, rng: np.random.Generator) -> Array:
    return rng.normal(size=len(arm.parameters)) * np.array([p.u for p in arm.parameters])


def test_an_independent_least_squares_with_the_centres_agrees(sino6, rng):
    """Values and covariance, the inverse of the Fisher information (Cramér–Rao)."""
    machine = Machine(sino6, drawn(sino6, rng))
    q, sphere = machine.touching(rng)
    q += READING * rng.normal(size=q.shape)
    result = calibrated(sino6, q, sphere)
    names = [p.name for p in sino6.parameters]
    chosen = [names.index(name) for name in result.parameters["parameter"]]
    u = np.array([p.u for p in sino6.parameters])
    estimated = result.fit.point.seats

    def tips(z: Array) -> Array:
        errors = np.zeros(len(names))
        errors[chosen] = z * u[chosen]
        return Machine(sino6, errors).tips(q)

    best = np.zeros(len(chosen))
    centres = estimated.copy()
    moves = [(Machine(sino6, np.zeros(len(names))).tips(q + 1e-6 * axis)) for axis in np.eye(6)]
    by_reading = np.stack(moves, axis=2) - tips(best)[:, :, None]
    covariance = READING**2 * 1e12 * by_reading @ by_reading.transpose(0, 2, 1)
    covariance += CONTACT**2 * np.eye(3)

    def residual(x: Array) -> Array:
        z, at = x[: len(chosen)], x[len(chosen) :].reshape(-1, 3)
        way = tips(z) - at[sphere]
        distance = np.linalg.norm(way, axis=1)
        normal = way / distance[:, None]
        scatter = np.sqrt(np.einsum("ni,nij,nj->n", normal, covariance, normal))
        return np.concatenate([(distance - 0.5 * (SPHERE + PROBE)) / scatter, z])

    found = least_squares(residual, np.concatenate([best, centres.ravel()]), x_scale="jac")
    z = result.fit.point.x / u[chosen]
    assert np.abs(z - found.x[: len(chosen)]).max() < 0.02
    bound = np.linalg.inv(found.jac.T @ found.jac)[: len(chosen), : len(chosen)]
    stated = result.covariance / np.outer(u[chosen], u[chosen])
    np.testing.assert_allclose(np.diag(stated), np.diag(bound), rtol=0.02)


def test_the_scale_of_a_sphere_is_that_of_its_diameter(sino6, rng):
    """All tips 1e-3 too far away make spheres of unknown centre larger by 1e-3, and nothing else:
    14 µm of a radius that the contacts know within 1 µm.
    """
    q, sphere = Machine(sino6, np.zeros(len(sino6.parameters))).touching(rng, noise=0.0)
    table = file_of(q, sphere)
    for scale, least, most in ((1.0, 0.0, 1e-6), (1.001, 12e-6, 15e-6)):
        larger = table.assign(
            feature_diameter_mm=(SPHERE * scale + PROBE * (scale - 1)) * 1e3,
        )
        records = Measurements.from_frame(larger)
        result = calibrate(
            sino6,
            records,
            ["zero-offsets"],
            prior=True,
            encoder_noise=READING,
            probe_noise=2e-5,  # so much that nobody looks for a mistake
            hold_out=False,
        )
        assert least <= result.rms_before <= most


def test_an_eccentric_encoder_is_found_by_spheres_alone(sino6, rng):
    q, sphere = Machine(sino6, np.zeros(len(sino6.parameters))).touching(rng)
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
    machine = Machine(sino6, np.zeros(len(sino6.parameters)))
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
    result = calibrate(
        sino6,
        records,
        "zero-offsets",
        reference_frame="base",
        encoder_noise=READING,
        probe_noise=CONTACT,
        hold_out=False,
    )
    np.testing.assert_allclose(result.fit.point.seats, centres, atol=3e-6)
    assert result.rms < 3e-6


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"probe_diameter_mm": [""] + [3.0] * 95}, "probe_diameter_mm"),
        ({"feature_diameter_mm": [25.4] * 95 + [25.5]}, "one value"),
        ({"feature": [f"S{k // 3}" for k in range(96)]}, "4 or more"),
        ({"seat": "A"}, "one of the two labels"),
    ],
)
def test_spheres_that_cannot_be_used_are_named(sino6, change, said):
    q = np.random.default_rng(1).uniform(-1, 1, (96, 6))
    table = file_of(q, np.repeat(np.arange(6), 16)).assign(**change)
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.from_frame(table)


@pytest.mark.long
def test_a_wrong_diameter_or_joint_is_named(sino6, rng):
    q, sphere = Machine(sino6, np.zeros(len(sino6.parameters))).touching(rng)
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
    result = calibrate(sino6, records, encoder_noise=READING, probe_noise=CONTACT, hold_out=False)
    assert chi2.sf(*result.fit.chi2_stated) > 1e-3
    names = [p.name for p in sino6.parameters]
    chosen = [names.index(name) for name in result.parameters["parameter"]]
    u = np.array([p.u for p in sino6.parameters])
    count = len(chosen)
    bare = Machine(sino6, np.zeros(len(names)))
    moves = [bare.tips(q + 1e-6 * axis) - bare.tips(q - 1e-6 * axis) for axis in np.eye(6)]
    by_reading = np.stack(moves, axis=2) / 2e-6
    covariance = READING**2 * by_reading @ by_reading.transpose(0, 2, 1) + CONTACT**2 * np.eye(3)

    def tips(z: Array) -> Array:
        errors = np.zeros(len(names))
        errors[chosen] = z * u[chosen]
        return Machine(sino6, errors).tips(q)

    at = tips(np.zeros(count))
    normals = np.stack(
        [np.linalg.svd(at[plane == k] - at[plane == k].mean(axis=0))[2][2] for k in range(3)]
    )
    offsets = [at[plane == k].mean(axis=0) @ normals[k] for k in range(3)]

    def residual(x: Array) -> Array:
        z, tilted = x[:count], x[count:].reshape(3, 3)
        rotations = Rotation.from_rotvec(np.cross(normals, tilted))
        normal = rotations.apply(normals)[plane]
        offset = np.sum(tilted * normals, axis=1) + offsets
        above = np.sum(tips(z) * normal, axis=1) - offset[plane]
        scatter = np.sqrt(np.einsum("ni,nij,nj->n", normal, covariance, normal))
        return np.concatenate([above / scatter, z])

    found = least_squares(residual, np.zeros(count + 9), x_scale="jac")
    assert np.abs(result.fit.point.x / u[chosen] - found.x[:count]).max() < 0.03
    _, remaining = np.split(np.linalg.qr(found.jac[:, ::-1], mode="r"), [9])
    bound = np.linalg.inv(remaining[:, 9:].T @ remaining[:, 9:])[::-1, ::-1]
    stated = result.covariance / np.outer(u[chosen], u[chosen])
    np.testing.assert_allclose(np.diag(stated), np.diag(bound), rtol=0.03)


def test_a_cause_is_found_by_planes_and_held_out_planes_are_predicted(sino6, rng):
    machine = Machine(sino6, np.zeros(len(sino6.parameters)))
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


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"feature_kind": "cone"}, "expected plane"),
        ({"x_mm": 1.0, "y_mm": 1.0, "z_mm": 1.0}, "with coordinates"),
        ({"feature": [f"E{k // 3}" for k in range(24)]}, "4 or more"),
        ({"feature_kind": ["plane"] * 23 + [""]}, "of the plane"),
    ],
)
def test_planes_that_cannot_be_used_are_named(change, said):
    q = np.random.default_rng(1).uniform(-1, 1, (24, 6))
    table = planes_of(q, np.repeat(np.arange(3), 8)).assign(**change)
    with pytest.raises(MeasurementFileError, match=said):
        Measurements.from_frame(table)


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
        assert fit.dof > 0
        if stated:
            assert chi2.sf(*fit.chi2_stated) > 1e-3
