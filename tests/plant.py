"""An arm, its measurements and a least squares that share no code with the package: products of 4x4 matrices and SciPy.

All unknowns are explicit here: parameters, the points of the seats, the reference frame, the targets on the last body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from aacmm_pin.arm import Arm
from aacmm_pin.conditions import Conditions
from aacmm_pin.measurements import Measurements

Array = NDArray[np.float64]

KINDS = ("a", "d", "alpha", "theta_offset")


def table_of(arm: Arm) -> Array:
    """Columns a, d, alpha, theta offset (rows, 4) of a bundled arm, all of whose numbers stand in its file."""
    assert arm.file is not None
    return np.array([[r.a_mm / 1000, r.d_mm / 1000, r.alpha_rad, r.theta_offset_rad] for r in arm.file.joints])


def uncertainty_of(arm: Arm) -> Array:
    """Standard uncertainties of the table (rows, 4): rectangular within the half-widths of the file."""
    assert arm.file is not None
    stated = [r.uncertainty for r in arm.file.joints]
    widths = [[s.a_mm / 1000, s.d_mm / 1000, s.alpha_rad, s.theta_offset_rad] if s else [0.0] * 4 for s in stated]
    return np.array(widths, dtype=np.float64) / np.sqrt(3.0)


def tips(table: Array, q: Array, target: Array | None = None) -> Array:
    """Points ``target`` of the last frame (3,) or (n, 3), its origin by default, for standard DH: (n, 3) [m].

    Rows past the joints do not move.
    """
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    angles = np.hstack([q, np.zeros((len(q), len(table) - q.shape[1]))])
    for (a, d, alpha, offset), angle in zip(table, angles.T, strict=True):
        about_z, about_x = np.zeros((len(q), 4, 4)), np.eye(4)
        c, s = np.cos(angle + offset), np.sin(angle + offset)
        about_z[:, 0, 0], about_z[:, 0, 1], about_z[:, 1, 0], about_z[:, 1, 1] = c, -s, s, c
        about_z[:, 2, 2], about_z[:, 3, 3], about_z[:, 2, 3] = 1.0, 1.0, d
        about_x[1:3, 1:3] = [[np.cos(alpha), -np.sin(alpha)], [np.sin(alpha), np.cos(alpha)]]
        about_x[0, 3] = a
        frame = frame @ about_z @ about_x
    shift = np.zeros(3) if target is None else target
    return frame[:, :3, 3] + np.einsum("nij,nj->ni", frame[:, :3, :3], np.broadcast_to(shift, (len(q), 3)))


def by_joints(table: Array, q: Array) -> Array:
    """∂tip/∂q (n, 3, nq) by central differences."""
    steps = 1e-6 * np.eye(q.shape[1])
    return np.stack([(tips(table, q + step) - tips(table, q - step)) / 2e-6 for step in steps], axis=2)


def reaching(table: Array, points: Array, limits: Array, rng: np.random.Generator) -> Array:
    """Postures of many kinds that put the tip on each of the points (n, 3), by Newton from random starts: (n, nq) [rad]."""
    q = np.full((len(points), len(limits)), np.nan)
    for _ in range(200):
        missing = np.flatnonzero(np.isnan(q[:, 0]))
        if not missing.size:
            return q
        guess = rng.uniform(*limits.T, (missing.size, len(limits)))
        for _ in range(12):
            off = points[missing] - tips(table, guess)
            guess += np.clip(np.einsum("nij,nj->ni", np.linalg.pinv(by_joints(table, guess)), off), -0.5, 0.5)
        good = np.linalg.norm(points[missing] - tips(table, guess), axis=1) < 1e-12
        q[missing[good]] = guess[good]
    raise AssertionError("some points are out of reach")


def seats_in_reach(table: Array, count: int, limits: Array, rng: np.random.Generator) -> Array:
    """Points that the arm reaches bent (count, 3) [m]."""
    points = tips(table, rng.uniform(*limits.T, (50 * count, len(limits))))
    distance = np.linalg.norm(points, axis=1)
    return points[(distance > 0.3) & (distance < 1.0)][:count]


@dataclass(frozen=True)
class Noise:
    """Standard uncertainties: of a reading [rad], of references, contacts and bars [m]."""

    encoder: float = 8e-6
    reference: float = 12e-6
    probe: float = 0.0
    length: float = 2e-6

    @property
    def stated(self) -> dict[str, float]:
        """As the arguments of ``calibrate``."""
        names = ("encoder", "reference", "probe", "length")
        return {f"{name}_noise": getattr(self, name) for name in names}


def free_points(table: Array, q: Array, noise: Noise, rng: np.random.Generator) -> Measurements:
    """Every record with a reference of its own."""
    where = tips(table, q + rng.normal(size=q.shape) * noise.encoder)
    return Measurements.of(q, where + rng.normal(size=where.shape) * noise.reference)


def touched(
    table: Array, points: Array, times: int, limits: Array, noise: Noise, rng: np.random.Generator, known: bool
) -> Measurements:
    """Seats at ``points``, each touched that many times; ``known``: measured once, with the noise of the references."""
    seat = np.repeat(np.arange(len(points)), times)
    contact = points[seat] + rng.normal(size=(len(seat), 3)) * noise.probe
    q = reaching(table, contact, limits, rng)
    readings = q + rng.normal(size=q.shape) * noise.encoder
    stated = (points + rng.normal(size=points.shape) * noise.reference)[seat] if known else None
    labels = np.array([f"S{i}" for i in seat], dtype=object)
    return Measurements.of(readings, stated, conditions=Conditions(len(q), seat=labels))


def with_bars(measurements: Measurements, ends: list[tuple[str, str, float]]) -> Measurements:
    """The same records with bars between seats: labels of both ends, and the length as calibrated [m]; no seat twice."""
    seat = measurements.conditions.seat
    bar, end, length = (np.full(len(seat), v, dtype=object) for v in ("", "", np.nan))
    for number, (a, b, metres) in enumerate(ends):
        for label, letter in ((a, "A"), (b, "B")):
            bar[seat == label], end[seat == label], length[seat == label] = f"bar{number}", letter, metres
    return replace(measurements, bar=bar, bar_end=end, bar_length=length.astype(np.float64))


def in_frame(measurements: Measurements, rotation: Array, shift: Array) -> Measurements:
    """The same references in another frame."""
    return replace(measurements, reference=measurements.reference @ rotation.T + shift)


@dataclass(frozen=True)
class Unknowns:
    """Which numbers of the table are unknown, as (row from 0, column), how far off each may be, and what else is unknown."""

    places: list[tuple[int, int]]
    widths: Array
    external: bool = False
    target: bool = False

    @staticmethod
    def stated(arm: Arm, **more: bool) -> Unknowns:
        """All values of the table that are not stated to be exact."""
        u = uncertainty_of(arm)
        places = [(int(i), int(k)) for i, k in zip(*np.nonzero(u), strict=True)]
        return Unknowns(places, np.array([u[place] for place in places]), **more)

    @property
    def names(self) -> list[str]:
        """As an arm names them."""
        return [f"{KINDS[k]}{i + 1}" for i, k in self.places]

    def table(self, nominal: Array, x: Array) -> Array:
        """The table with these values changed by x."""
        moved = nominal.copy()
        for place, value in zip(self.places, x, strict=True):
            moved[place] += value
        return moved

    def errors(self, truth: Array, nominal: Array) -> Array:
        """What a calibration should find."""
        return np.array([(truth - nominal)[place] for place in self.places])


@dataclass
class Layout:
    """Where each unknown stands in one long vector."""

    size: int = 0
    of: dict[str, slice] = field(default_factory=dict)

    def add(self, name: str, count: int) -> None:
        """Put one more at the end."""
        self.of[name] = slice(self.size, self.size + count)
        self.size += count


@dataclass(frozen=True)
class Independent:
    """What the explicit least squares found: changes of the parameters, their covariance, and everything else."""

    x: Array
    covariance: Array
    chi2: float
    rows: int
    unknowns: int
    jacobian: Array


def independent_fit(nominal: Array, measurements: Measurements, unknowns: Unknowns, noise: Noise) -> Independent:
    """Least squares with every unknown explicit, whitened by hand, differentiated numerically."""
    residual, scale, start = problem(nominal, measurements, unknowns, noise)
    found = least_squares(residual, start, jac="3-point", x_scale=1.0, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    p = len(unknowns.places)
    jacobian = found.jac / scale
    covariance = np.linalg.inv(found.jac.T @ found.jac) * np.outer(scale, scale)
    chi2 = 2 * found.cost
    return Independent(found.x[:p] * scale[:p], covariance[:p, :p], chi2, len(found.fun), len(start), jacobian)


def problem(
    nominal: Array, measurements: Measurements, unknowns: Unknowns, noise: Noise
) -> tuple[Callable[[Array], Array], Array, Array]:
    """Residuals of scaled unknowns, their scales, and the start."""
    q, reference, seat = measurements.q, measurements.reference, measurements.conditions.seat
    marker = measurements.conditions.marker
    n = len(q)
    layout = Layout()
    layout.add("x", len(unknowns.places))
    scales, start = [unknowns.widths], [np.zeros(len(unknowns.places))]
    seats = [] if seat is None else [label for label in dict.fromkeys(seat) if label]
    single = [label for label in seats if np.ptp(reference[seat == label], axis=0).max() == 0.0]
    unseen = [label for label in seats if np.isnan(reference[seat == label]).all()]
    first = np.linalg.inv(np.eye(3))
    about = np.zeros(3)
    if unknowns.external:
        known = np.isfinite(reference[:, 0])
        here, there = tips(nominal, q[known]), reference[known]
        rotation, _ = Rotation.align_vectors(there - there.mean(axis=0), here - here.mean(axis=0))
        first, about = rotation.as_matrix(), there.mean(axis=0) - rotation.apply(here.mean(axis=0))
        layout.add("frame", 6)
        scales.append(np.full(6, 1e-4))
        start.append(np.zeros(6))
    for label in single + unseen:
        layout.add(label, 3)
        scales.append(np.full(3, 1e-4))
        at = tips(nominal, q[seat == label]).mean(axis=0) if label in unseen else reference[seat == label][0]
        start.append(at / 1e-4)
    targets = [] if marker is None else list(dict.fromkeys(marker))
    targets = ["target"] if unknowns.target else targets
    for label in targets:
        layout.add(f"on {label}", 3)
        scales.append(np.full(3, 1e-4))
        start.append(np.zeros(3))
    gradient = by_joints(nominal, q)
    covariance = noise.encoder**2 * gradient @ gradient.transpose(0, 2, 1) + noise.probe**2 * np.eye(3)
    grouped = np.zeros(n, dtype=bool) if seat is None else np.isin(seat.astype(str), single + unseen)
    covariance[~grouped] += noise.reference**2 * np.eye(3)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    scale = np.concatenate(scales)

    def residual(z: Array) -> Array:
        y = z * scale
        shift = np.zeros((n, 3))
        for label in targets:
            shift[np.ones(n, dtype=bool) if label == "target" else marker == label] = y[layout.of[f"on {label}"]]
        where = tips(unknowns.table(nominal, y[layout.of["x"]]), q, shift)
        aim, rows = reference.copy(), [z[layout.of["x"]]]
        for label in single + unseen:
            point = y[layout.of[label]]
            aim[seat == label] = point
            if label in single:
                rows.append((point - reference[seat == label][0]) / noise.reference)
        if unknowns.external:
            frame = y[layout.of["frame"]]
            turned = Rotation.from_rotvec(frame[3:]).as_matrix() @ first
            aim = (aim - about - frame[:3]) @ turned  # back in the base, where the readings' noise is
        for bar in measurements.bars():
            far = np.linalg.norm(y[layout.of[bar.seat_a]] - y[layout.of[bar.seat_b]])
            rows.append(np.array([(far - bar.length) / noise.length]))
        rows.append(np.einsum("nij,nj->ni", whiten, where - aim).ravel())
        return np.concatenate(rows)

    return residual, scale, np.concatenate(start)
