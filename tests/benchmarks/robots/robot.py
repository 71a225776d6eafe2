"""Measurement files like those of robots in factories, and the truth behind them. No code of the
package.

Six joints in standard DH. A letter for each joint says which error its encoder has (`FORMS`).
Joints 2 and 3 deflect under weights. The height of the tip drifts with the temperature, and a
smooth field over the room displaces the tip. The geometry has errors, and the frame of the tracker
and the place of the target are unknown. The noise is not stated. A seed is the same robot for any
number of records.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Wave = tuple[float, float, float]
"""Periods per turn, amplitude [rad], phase [rad]."""

RIGHT = np.pi / 2
NOMINAL = np.array(
    [
        (0.0, 127.0, RIGHT),
        (-610.0, 0.0, 0.0),
        (-570.0, 0.0, 0.0),
        (0.0, 164.0, RIGHT),
        (0.0, 116.0, -RIGHT),
        (0.0, 92.0, 0.0),
    ]
)
"""a [mm], d [mm], alpha [rad] of each row of the arm file."""
TARGET = np.array([8.0, -6.0, 88.0])
"""Place of the target on the last body [mm]."""
RANGES = ((-2.6, 1.2), (-2.5, -0.4), (-2.0, 2.0), (-2.5, 0.5), (-1.6, 1.6), (-3.0, 3.0))
"""Angles of each joint in the records [rad]."""
FORMS = {
    "c": "joint_error_curve",  # five waves
    "e": "encoder_eccentricity",
    "l": "encoder_ellipticity",
    "p": "joint_periodic_error",  # one wave of 8 to 40 periods per turn
    "-": None,
}
"""Cause of each letter."""
NOISE_MM = 0.03
"""Standard deviation of a coordinate."""
COMPLIANCE = {2: 6e-6, 3: 9e-6}
"""Of the joint under the moment of the weights [rad/(N·m)]."""
DRIFT, WARM = 0.04, 23.5
"""Drift of the height of the tip [mm/K] from this temperature [°C]."""
FIELD_MM, FIELD_WAVES = 0.03, 6
"""The field over the room: so many waves, and their common amplitude."""


@dataclass(frozen=True)
class Robot:
    """A robot by its seed; lengths in mm, angles in rad.

    Attributes:
        waves: error of each encoder.
        rows: true DH rows (6, 3).
        zeros: errors of the zeros (6,).
        field: wave vector, phase and direction of each wave of the room.
        turn: rotation from the base to the frame of the tracker (3, 3).
    """

    seed: int
    forms: str
    waves: tuple[tuple[Wave, ...], ...]
    rows: Array
    zeros: Array
    field: tuple[tuple[Array, float, Array], ...]
    turn: Array

    @staticmethod
    def of(seed: int, forms: str = "cccccc") -> Robot:
        rng = np.random.default_rng(seed)
        waves = tuple(_waves(rng, form) for form in forms)
        rows = NOMINAL + rng.normal(size=NOMINAL.shape) * [0.15, 0.15, 2e-4]
        zeros = rng.normal(size=6) * 3e-4
        field = tuple(
            (rng.normal(size=3) / 500, float(rng.uniform(0, 6.3)), rng.normal(size=3) / 2)
            for _ in range(FIELD_WAVES)
        )
        a = rng.normal(size=3)
        half = _cross_matrix(a * 0.4 / np.linalg.norm(a)) / 2
        turn = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
        return Robot(seed, forms, waves, rows, zeros, field, turn)

    def encoder_error(self, joint: int, angles: Array) -> Array:
        """What the encoder of a joint (1 to 6) hides at these angles [rad]."""
        waves = self.waves[joint - 1]
        return sum((a * np.cos(f * angles + phase) for f, a, phase in waves), 0.0 * angles)

    def periods(self) -> dict[str, float]:
        """Periods per turn at each place with one periodic error."""
        encoders = enumerate(zip(self.forms, self.waves, strict=True), 1)
        return {f"encoder:{j}": waves[0][0] for j, (form, waves) in encoders if form == "p"}

    def measured(self, records: int) -> Measured:
        """The file of so many records."""
        rng = np.random.default_rng([self.seed, records])
        q = np.column_stack([rng.uniform(low, high, records) for low, high in RANGES])
        errors = {("encoder", j): self.encoder_error(j, q[:, j - 1]) for j in range(1, 7)}
        errors |= {("load", j): COMPLIANCE[j] * moment for j, moment in _moments(q).items()}
        true = q.copy()
        for (_, joint), error in errors.items():
            true[:, joint - 1] += error
        true += self.zeros
        tips = chain(true, self.rows, TARGET).tips
        moved: dict[str, Array] = {}
        for (kind, joint), error in errors.items():
            if error.any():
                without = true.copy()
                without[:, joint - 1] -= error
                moved[f"{kind}:{joint}"] = tips - chain(without, self.rows, TARGET).tips
        hours = np.arange(records) / max(records, 1)
        temperature = 23.5 + 2.5 * (1 - np.exp(-6 * hours)) + 0.05 * rng.normal(size=records)
        places = tips.copy()
        places[:, 2] += DRIFT * (temperature - WARM)
        moved["temperature"] = places - tips
        still = places.copy()
        for vector, phase, direction in self.field:
            places += FIELD_MM * np.cos(places @ vector + phase)[:, None] * direction
        moved["room"] = places - still
        seen = places @ self.turn.T + [500.0, -3500.0, -1200.0]
        seen += rng.normal(size=seen.shape) * NOISE_MM
        left = after_recalibration(q, moved)
        return Measured(self, q, seen, temperature, {name: rms(d) for name, d in left.items()})


def _waves(rng: np.random.Generator, form: str) -> tuple[Wave, ...]:
    periods, exponents = rng.uniform(4, 45, 5), rng.uniform(*np.log10([30e-6, 400e-6]), 5)
    phases, period = rng.uniform(0, 2 * np.pi, 5), float(rng.uniform(8, 40))
    if form == "c":
        return tuple(zip(periods.tolist(), (10**exponents).tolist(), phases.tolist(), strict=True))
    if form == "-":
        return ()
    one = {"e": 1.0, "l": 2.0, "p": period}[form]
    return ((one, float(rng.uniform(80e-6, 200e-6)), float(phases[0])),)


def _moments(q: Array) -> dict[int, Array]:
    """Moments of the weights about joints 2 and 3 [N·m]."""
    beyond = 35 * np.cos(q[:, 1] + q[:, 2])
    return {2: 90 * np.cos(q[:, 1]) + beyond, 3: beyond}


@dataclass(frozen=True, eq=False)
class Measured:
    """A measurement file: readings (n, 6) [rad], coordinates (n, 3) [mm], temperatures [°C].

    ``displacements_mm`` has the RMS displacement of the target by each place that acts
    (``encoder:1``, ``load:2``, ``temperature``) and by the ``room``, after geometry, frame and
    target are fitted again.
    """

    robot: Robot
    q: Array
    coordinates: Array
    temperature: Array
    displacements_mm: dict[str, float]

    @property
    def floor_mm(self) -> float:
        """RMS distance that noise and room leave to a model with all other places."""
        return float(np.hypot(NOISE_MM * np.sqrt(3), self.displacements_mm["room"]))

    def write(self, folder: Path) -> Path:
        """``robot.toml``, ``robot_N.csv`` and ``truth_N.json``; the path of the CSV file."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "robot.toml").write_text(arm_file())
        count = len(self.q)
        data = folder / f"robot_{count}.csv"
        np.savetxt(
            data,
            np.column_stack([self.q, self.coordinates, self.temperature, np.arange(count)]),
            delimiter=",",
            comments="",
            fmt=["%.6g"] * 6 + ["%.5f"] * 3 + ["%.2f", "%d"],
            header=",".join(f"theta{j}_rad" for j in range(1, 7))
            + ",x_mm,y_mm,z_mm,temperature_c,record",
        )
        truth = {
            "seed": self.robot.seed,
            "forms": self.robot.forms,
            "waves": self.robot.waves,
            "displacements_mm": self.displacements_mm,
            "floor_mm": self.floor_mm,
        }
        (folder / f"truth_{count}.json").write_text(json.dumps(truth, indent=1) + "\n")
        return data


def arm_file() -> str:
    """The nominal arm, which states no uncertainty."""
    head = 'schema = "aacmm-pin/arm/1"\nname = "robot"\nconvention = "standard-dh"\n'
    return head + "".join(
        f"\n[[joints]]\na_mm = {a}\nd_mm = {d}\nalpha_rad = {alpha!r}\n"
        "theta_offset_rad = 0.0\nlimits_rad = [-6.3, 6.3]\n"
        for a, d, alpha in NOMINAL.tolist()
    )


@dataclass(frozen=True, eq=False)
class Chain:
    """Tips (n, 3), and of each row j the axes and origins (n, 6, 3) before and behind it [mm]."""

    tips: Array
    z: Array
    origin: Array
    next_x: Array
    next_origin: Array
    last: Array
    """Rotation of the last body (n, 3, 3)."""

    def turned_by_joints(self) -> Array:
        """Displacement of the tip for each angle (n, 6, 3) [mm/rad]."""
        return np.cross(self.z, self.tips[:, None] - self.origin)

    def columns(self) -> Array:
        """Displacement of the tip (n, 3, 33) for a, d, alpha and zero of each row, the target, and
        rotation and translation of the base [mm/mm, mm/rad].
        """
        twist = np.cross(self.next_x, self.tips[:, None] - self.next_origin)
        one = np.broadcast_to(np.eye(3), self.last.shape)
        parts = (self.next_x, self.z, twist, self.turned_by_joints())
        turn = -_cross_matrix(self.tips)
        return np.concatenate([*(part.swapaxes(1, 2) for part in parts), self.last, turn, one], 2)


def chain(q: Array, rows: Array, target: Array) -> Chain:
    """Kinematics of standard DH."""
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    frames = [frame]
    for angle, (a, d, alpha) in zip(q.T, rows, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        o = np.zeros_like(c)
        rows_of_step = (
            (c, -s * ca, s * sa, a * c),
            (s, c * ca, -c * sa, a * s),
            (o, o + sa, o + ca, o + d),
            (o, o, o, o + 1),
        )
        step = np.stack([np.stack(row, axis=1) for row in rows_of_step], axis=1)
        frame = frame @ step
        frames.append(frame)
    every = np.stack(frames, 1)
    before, behind = every[:, :-1], every[:, 1:]
    last = frame[:, :3, :3]
    return Chain(
        last @ target + frame[:, :3, 3],
        before[..., :3, 2],
        before[..., :3, 3],
        behind[..., :3, 0],
        behind[..., :3, 3],
        last,
    )


def after_recalibration(q: Array, moved: dict[str, Array]) -> dict[str, Array]:
    """What a fit of geometry, frame and target leaves of displacements (n, 3)."""
    columns = chain(q, NOMINAL, TARGET).columns().reshape(-1, 33)
    columns = columns / np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > 1e-9 * s[0]]
    return {
        name: (d.ravel() - basis @ (basis.T @ d.ravel())).reshape(-1, 3)
        for name, d in moved.items()
    }


def rms(distances: Array) -> float:
    """Root mean square of lengths of rows (n, 3)."""
    return float(np.sqrt(np.sum(distances**2, axis=1).mean()))


def _cross_matrix(a: Array) -> Array:
    """Matrices (…, 3, 3) of the products a × b."""
    x, y, z = np.moveaxis(np.asarray(a), -1, 0)
    o = np.zeros_like(x)
    return np.stack([o, -z, y, z, o, -x, -y, x, o], -1).reshape(*np.shape(a)[:-1], 3, 3)
