"""An arm as its TOML file states it, and homogeneous transforms in NumPy: nothing here knows of errors or loads."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SINO6 = Path(__file__).parents[2] / "aacmm_pin" / "arm" / "bundled" / "sino6.toml"
KINDS = ("a", "d", "alpha", "theta_offset")


@dataclass(frozen=True, eq=False)
class Arm:
    """What the file says, in SI units; R rows, nq of them with a joint.

    Attributes:
        values: a, d, alpha, theta_offset (R, 4) [m, m, rad, rad].
        half_width: of the calibration of these (R, 4) [m, m, rad, rad].
        moving: (R,) True where the row has a joint.
        limits: (nq, 2) [rad].
        mass: (R,) [kg]; zero where not stated.
        com: centre of mass of each body in its own frame (R, 3) [m].
        gravity: (3,) in the base frame [m/s²].
        reference_temperature: [°C].
        stylus: axis of the stylus in the last frame (3,).
        standard: convention; False for the modified one.
    """

    values: Array
    half_width: Array
    moving: NDArray[np.bool_]
    limits: Array
    mass: Array
    com: Array
    gravity: Array
    reference_temperature: float
    stylus: Array
    standard: bool = True

    @property
    def rows(self) -> int:
        return len(self.values)

    @property
    def exact(self) -> Array:
        """Geometry as the file says."""
        return self.values

    @property
    def typical(self) -> Array:
        """Deviations of a usual arm (R, 4) [m, m, rad, rad]."""
        return np.tile([2e-4, 2e-4, 5e-4, 5e-4], (self.rows, 1))

    def tubes(self) -> list[int]:
        """Rows (from 1) whose length along d or a exceeds 0.3 m."""
        return [int(i) + 1 for i in np.flatnonzero(np.abs(self.values[:, :2]).max(axis=1) > 0.3)]

    def all_angles(self, q: Array) -> Array:
        """(n, nq) -> (n, R): zero in rows that have no joint."""
        angles = np.zeros((len(q), self.rows))
        angles[:, self.moving] = q
        return angles

    def jacobian(self, q: Array, values: Array | None = None) -> Array:
        """Velocity of the tip per joint rate, (n, 3, nq) [m/rad], of the rigid arm."""
        return jacobian(placements(self.values if values is None else values, self.all_angles(q)), self.moving)


def read_arm(path: Path | str = SINO6) -> Arm:
    """Read an arm file of standard DH rows."""
    arm = arm_of(Path(path).read_text(encoding="utf-8"))
    if not arm.standard:
        raise ValueError(f"{path}: modified-dh, expected standard-dh")
    return arm


def arm_of(text: str) -> Arm:
    """The DH table of the text of an arm file."""
    table = tomllib.loads(text)
    rows = table["joints"]
    moving = np.array([not row.get("fixed", False) for row in rows])
    stylus = np.array(table.get("stylus", {}).get("axis", [1.0, 0.0, 0.0]))
    return Arm(
        values=np.array([_row(row) for row in rows]),
        half_width=np.array([_row(row.get("uncertainty", {})) for row in rows]),
        moving=moving,
        limits=np.array([row.get("limits_rad", [-np.pi, np.pi]) for row, m in zip(rows, moving, strict=True) if m]),
        mass=np.array([row.get("mass_kg", 0.0) for row in rows]),
        com=1e-3 * np.array([row.get("com_mm", [0.0, 0.0, 0.0]) for row in rows]),
        gravity=np.array(table["gravity_m_s2"]),
        reference_temperature=float(table.get("reference_temperature_c", 20.0)),
        stylus=stylus / np.linalg.norm(stylus),
        standard=table["convention"] == "standard-dh",
    )


def _row(row: dict[str, Any]) -> list[float]:
    units = {"a_mm": 1e-3, "d_mm": 1e-3, "alpha_rad": 1.0, "theta_offset_rad": 1.0}
    return [unit * float(row.get(name, 0.0)) for name, unit in units.items()]


# --- transforms, each (n, 4, 4) from values (n,) or (n, 3)


def identity(n: int) -> Array:
    return np.broadcast_to(np.eye(4), (n, 4, 4)).copy()


def turn_z_shift(angle: Array, d: Array) -> Array:
    """Rz(angle) Tz(d)."""
    t = identity(len(angle))
    c, s = np.cos(angle), np.sin(angle)
    t[:, 0, 0], t[:, 0, 1], t[:, 1, 0], t[:, 1, 1], t[:, 2, 3] = c, -s, s, c, d
    return t


def shift_x(a: Array) -> Array:
    """Tx(a)."""
    t = identity(len(a))
    t[:, 0, 3] = a
    return t


def turn_x(angle: Array) -> Array:
    """Rx(angle)."""
    t = identity(len(angle))
    c, s = np.cos(angle), np.sin(angle)
    t[:, 1, 1], t[:, 1, 2], t[:, 2, 1], t[:, 2, 2] = c, -s, s, c
    return t


def rotation(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    k = np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)
    # sinc(angle / pi) = sin(angle) / angle, also at zero
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (k @ k))


def moved(frames: Array, vector: Array, shift: Array | float = 0.0) -> Array:
    """Frames (n, 4, 4) turned in place by rotation vectors (n, 3) of the base, and shifted in the base by (n, 3) [m]."""
    out = frames.copy()
    out[:, :3, :3] = rotation(vector) @ frames[:, :3, :3]
    out[:, :3, 3] += shift
    return out


def placements(values: Array, angles: Array) -> Array:
    """Frames 0..R of the bare table: ``values`` (R, 4), ``angles`` (n, R) -> (n, R + 1, 4, 4)."""
    n, rows = angles.shape
    frames = [identity(n)]
    for i in range(rows):
        a, d, alpha, offset = (np.full(n, value) for value in values[i])
        frames.append(frames[-1] @ turn_z_shift(angles[:, i] + offset, d) @ shift_x(a) @ turn_x(alpha))
    return np.stack(frames, axis=1)


def jacobian(frames: Array, moving: NDArray[np.bool_]) -> Array:
    """Velocity of the tip per joint rate, (n, 3, nq) [m/rad]: z × lever."""
    z, o = frames[:, :-1, :3, 2], frames[:, :-1, :3, 3]
    levers = frames[:, -1:, :3, 3] - o
    return np.cross(z, levers)[:, moving].transpose(0, 2, 1)
