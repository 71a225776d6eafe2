"""A plant whose tip touches spheres, planes and cubes; the arm's values by least squares."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pandas as pd
from blind.kinematics import Array
from scipy.optimize import OptimizeResult
from scipy.spatial.transform import Rotation

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.measurements import Measurements
from tests.oracle import dh_frames
from tests.tables import readings

SPHERE, PROBE = 25.4e-3, 3e-3
READING, CONTACT = 8e-6, 3e-6
SPHERES, CONTACTS = 6, 16
ROW = ("a", "d", "alpha", "theta_offset")
EDGE = 0.1
NORMALS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]])
"""Of the faces; the cube stands on the sixth."""
COLUMNS = ("feature_a", "feature_b", "distance_mm", "u_distance_mm", "angle_deg", "u_angle_deg")


class Machine:
    """SINO6 with errors of its parameters (p,), if any, and postures that touch spheres
    anywhere.
    """

    def __init__(self, arm: Arm, errors: Array | float = 0.0) -> None:
        off = np.broadcast_to(errors, len(arm.parameters))
        stated = {p.name: p.value + e for p, e in zip(arm.parameters, off, strict=True)}
        self.table = np.array([[stated[f"{name}{j}"] for name in ROW] for j in range(1, 7)])

    def tips(self, q: Array) -> Array:
        return dh_frames(self.table, q)[:, :3, 3]

    def at(self, points: Array, start: Array) -> Array:
        """Postures (n, 6) whose tips are at points (n, 3), from postures near by."""
        q = start.copy()
        for _ in range(50):
            off = points - self.tips(q)
            far = np.linalg.norm(off, axis=1) > 1e-13
            if not far.any():
                break
            columns = [
                (self.tips(q[far] + 1e-6 * axis) - self.tips(q[far] - 1e-6 * axis)) / 2e-6
                for axis in np.eye(6)
            ]
            jacobian = np.stack(columns, axis=2)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian, rcond=1e-3), off[far])
            q[far] += np.clip(step, -0.2, 0.2)
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
    return readings(q).assign(feature=[f"E{k}" for k in plane], feature_kind="plane")


def on_cube(machine: Machine, rng: np.random.Generator, cubes: int = 1) -> tuple[Array, Array]:
    """Postures (n, 6) at 12 contacts with each of five faces of a cube in so many places, and the
    number of the face of each (n,), 5 a place.
    """
    found, numbers = [], []
    for k in range(5 * cubes):
        if k % 5 == 0:
            start = rng.uniform(-1.2, 1.2, 6)
            centre = machine.tips(start[None])[0]
            turn = Rotation.random(random_state=int(rng.integers(2**31)))
        across = rng.uniform(-0.45, 0.45, (48, 3)) * EDGE
        normal = NORMALS[k % 5]
        local = across * (normal == 0) + (EDGE + PROBE) / 2 * normal
        points = centre + turn.apply(local) + CONTACT * rng.normal(size=local.shape)
        q = machine.at(points, start + rng.uniform(-0.6, 0.6, (len(points), 6)))[:12]
        found.append(q)
        numbers += [k] * len(q)
    return np.concatenate(found), np.array(numbers)


def of_cubes(cubes: int = 1, u_mm: float = 1e-3, u_deg: float = 1e-3) -> pd.DataFrame:
    """What a certificate states of the faces E0 …, 5 a cube."""
    rows = []
    for one, other in combinations(range(5 * cubes), 2):
        if one // 5 == other // 5:
            opposite = NORMALS[one % 5] @ NORMALS[other % 5] < 0
            distance = (EDGE * 1e3, u_mm, 180.0) if opposite else (None, None, 90.0)
            if opposite or {one % 5, other % 5} <= {0, 2, 4}:
                rows.append((f"E{one}", f"E{other}", *distance, u_deg))
    return pd.DataFrame(rows, columns=COLUMNS)


def cube_file(q: Array, face: Array) -> pd.DataFrame:
    return planes_of(q, face).assign(probe_diameter_mm=PROBE * 1e3)


def file_of(q: Array, sphere: Array) -> pd.DataFrame:
    labels = [f"S{k}" for k in sphere]
    diameters = {"feature_diameter_mm": SPHERE * 1e3, "probe_diameter_mm": PROBE * 1e3}
    return readings(q).assign(feature=labels, **diameters)


def drawn(arm: Arm, rng: np.random.Generator) -> Array:
    return rng.normal(size=len(arm.parameters)) * np.array([p.u for p in arm.parameters])


def calibrated(arm: Arm, records: Measurements, **how: object) -> Calibration:
    """With the noise of the plant as stated, unless ``how`` says otherwise."""
    stated = {"encoder_noise": READING, "probe_noise": CONTACT, "hold_out": False}
    return calibrate(arm, records, **(stated | how))  # type: ignore[arg-type]


class Values:
    """The estimated values of an arm by the plant's kinematics, at readings (n, 6)."""

    def __init__(self, arm: Arm, result: Calibration, q: Array) -> None:
        names = [p.name for p in arm.parameters]
        self.arm, self.result, self.q = arm, result, q
        self.chosen = [names.index(name) for name in result.parameters["parameter"]]
        self.count = len(self.chosen)
        self.u = np.array([arm.parameters[k].u for k in self.chosen])
        bare = Machine(arm)
        moves = [bare.tips(q + 1e-6 * axis) - bare.tips(q - 1e-6 * axis) for axis in np.eye(6)]
        by_reading = READING * np.stack(moves, axis=2) / 2e-6
        self.covariance = by_reading @ by_reading.transpose(0, 2, 1) + CONTACT**2 * np.eye(3)

    def tips(self, z: Array) -> Array:
        """Tips (n, 3) with errors of the values in units of their u (count,)."""
        errors = np.zeros(len(self.arm.parameters))
        errors[self.chosen] = z * self.u
        return Machine(self.arm, errors).tips(self.q)

    def scatter(self, normal: Array) -> Array:
        """Standard deviation of the tips along normals (n, 3)."""
        return np.sqrt(np.einsum("ni,nij,nj->n", normal, self.covariance, normal))

    def agree(self, found: OptimizeResult, within: float) -> None:
        """Values and covariance, the inverse of the Fisher information (Cramér–Rao), are those of
        a least squares of these values and others behind them.
        """
        estimate = self.result.fit.point.x / self.u
        assert np.abs(estimate - found.x[: self.count]).max() < within
        others = found.x.size - self.count
        remaining = np.linalg.qr(found.jac[:, ::-1], mode="r")[others:, others:]
        bound = np.linalg.inv(remaining.T @ remaining)[::-1, ::-1]
        stated = self.result.covariance / np.outer(self.u, self.u)
        np.testing.assert_allclose(np.diag(stated), np.diag(bound), rtol=within)
