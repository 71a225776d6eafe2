"""Where an elastic arm comes to rest under its own weight: equilibrium in the deflected pose, iterated until it stands.

All loads are weights, so the moment of what hangs beyond a point P is ``Σ (r_k - P) × m_k g``, and everything elastic turns
the way that moment pulls. A tube is a Bernoulli beam: its section at s turns relative to its neighbour by ``M(s) ds / EI``
across the tube and ``M(s) ds / GJ`` along it. Its weight is spread; see :func:`share_of_tube`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind.kinematics import Arm, Array, identity, moved, rotation, shift_x, turn_x, turn_z_shift

STOP = 1e-14
"""[m] and [rad]: the arm stands when no frame moves by more."""
MOST_ROUNDS = 60
NODES = 8


@dataclass(frozen=True, eq=False)
class Elastic:
    """Flexibilities: of each joint about and across its axis [rad/(N·m)], of each tube 1/EI and 1/GJ [rad/(N·m²)], of the
    base [rad/(N·m)]; and for each joint with a wrong counterbalance the turn when the body is level [rad].
    """

    joint: Array
    tilt: Array
    bend: Array
    twist: Array
    spring: Array
    base: float = 0.0

    @staticmethod
    def rigid(rows: int) -> Elastic:
        return Elastic(*np.zeros((5, rows)))

    @property
    def any(self) -> bool:
        return bool(np.any([self.joint, self.tilt, self.bend, self.twist, self.spring])) or self.base != 0.0


@dataclass(eq=False)
class Shape:
    """Deflections as rotation vectors and shifts in the base: of the base (n, 3), of each joint (R, n, 3), of the end of
    each tube (R, n, 3), and turns of its sections (R, n, NODES, 3).
    """

    base: Array
    joint: Array
    slope: Array
    sag: Array
    sections: Array

    @staticmethod
    def straight(rows: int, n: int) -> Shape:
        joint, slope, sag = np.zeros((3, rows, n, 3))
        return Shape(np.zeros((n, 3)), joint, slope, sag, np.zeros((rows, n, NODES, 3)))

    def change(self, other: Shape) -> float:
        pairs = [(getattr(self, name), getattr(other, name)) for name in ("base", "joint", "slope", "sag")]
        return float(max(np.abs(a - b).max() for a, b in pairs))


@dataclass(frozen=True, eq=False)
class Rest:
    """An arm at rest: frames 0..R (n, R + 1, 4, 4), clamps of the tubes (R, n, 4, 4), its shape, and the rounds it took."""

    frames: Array
    clamps: Array
    shape: Shape
    rounds: int


def settle(arm: Arm, values: Array, angles: Array, elastic: Elastic) -> Rest:
    """Equilibrium for DH ``values`` (n, R, 4) [m, m, rad, rad] and joint ``angles`` (n, R) [rad]."""
    n, rows = angles.shape
    shape = Shape.straight(rows, n)
    for rounds in range(MOST_ROUNDS):
        frames, clamps = _frames(values, angles, shape)
        if not elastic.any:
            return Rest(frames, clamps, shape, 0)
        new = _deflections(arm, values, frames, clamps, shape, elastic)
        if new.change(shape) < STOP:
            return Rest(frames, clamps, shape, rounds)
        shape = new
    raise RuntimeError(f"no equilibrium after {MOST_ROUNDS} rounds: the arm is too soft")


def along_x(values: Array) -> NDArray[np.bool_]:
    """(R,) True where the row is a tube along x (a), False where along z (d)."""
    return np.asarray(np.abs(values[..., 0]) > np.abs(values[..., 1])) if values.ndim == 2 else along_x(values[0])


def _frames(values: Array, angles: Array, shape: Shape) -> tuple[Array, Array]:
    n, rows = angles.shape
    lies_along_x = along_x(values)
    frames = [moved(identity(n), shape.base)]
    clamps = []
    for i in range(rows):
        a, d, alpha, offset = values[:, i].T
        start = moved(frames[-1], shape.joint[i]) @ turn_z_shift(angles[:, i] + offset, np.zeros(n))
        end_of_d = start @ turn_z_shift(np.zeros(n), d)
        clamps.append(end_of_d if lies_along_x[i] else start)
        if lies_along_x[i]:
            end = moved(end_of_d @ shift_x(a), shape.slope[i], shape.sag[i])
        else:
            end = moved(end_of_d, shape.slope[i], shape.sag[i]) @ shift_x(a)
        frames.append(end @ turn_x(alpha))
    return np.stack(frames, axis=1), np.stack(clamps)


def _deflections(arm: Arm, values: Array, frames: Array, clamps: Array, shape: Shape, elastic: Elastic) -> Shape:
    centres = centres_of_mass(arm, frames)
    new = Shape.straight(arm.rows, len(frames))
    new.base = elastic.base * moment_beyond(arm, centres, 0, np.zeros(3))
    for i in range(arm.rows):
        if elastic.joint[i] or elastic.tilt[i]:
            axis, origin = frames[:, i, :3, 2], frames[:, i, :3, 3]
            moment = moment_beyond(arm, centres, i, origin)
            about = axis * np.einsum("nk,nk->n", axis, moment)[:, None]
            new.joint[i] = elastic.joint[i] * about + elastic.tilt[i] * (moment - about)
        if elastic.spring[i]:
            new.joint[i] += elastic.spring[i] * _strut(arm, i, frames)
        if elastic.bend[i] or elastic.twist[i]:
            new.slope[i], new.sag[i], new.sections[i] = _beam(arm, values, i, frames, clamps[i], centres, shape, elastic)
    return new


STRUT = 0.05
"""Lever of the strut on the body over the height of its anchor above the axis."""


def _strut(arm: Arm, i: int, frames: Array) -> Array:
    """Missing moment of a gas strut (n, 3), one where the body is level.

    A strut of constant force from an anchor h above the axis to a point r along the body pulls with the moment
    ``F h r (horizontal part of the body) / length``; too little of it lets the body fall. The turn counts positive about
    ``u × down``, u being the next joint's axis if that stands across this one; the tube lies along it, one way or the other.
    """
    axis, following = frames[:, i, :3, 2], frames[:, i + 1, :3, 2]
    across = np.abs(np.einsum("nk,nk->n", axis, following)).max() < 0.1
    u, along = (following, arm.values[i + 1, 1]) if across else (frames[:, i + 1, :3, 0], arm.values[i, 0])
    up = -arm.gravity / np.linalg.norm(arm.gravity)
    length = np.linalg.norm(up - STRUT * np.sign(along) * u, axis=1) / np.hypot(1.0, STRUT)
    turn = np.einsum("nk,nk->n", axis, np.cross(u, -up)) / length
    return np.asarray(axis * turn[:, None])


def centres_of_mass(arm: Arm, frames: Array) -> Array:
    """Of each body in the base, (n, R, 3) [m]."""
    return np.asarray(frames[:, 1:, :3, 3] + np.einsum("nrij,rj->nri", frames[:, 1:, :3, :3], arm.com))


def moment_beyond(arm: Arm, centres: Array, row: int, point: Array) -> Array:
    """Moment about ``point`` (..., 3) of the bodies from index ``row`` on, (n, 3) [N·m]."""
    mass = arm.mass[row:]
    first = np.einsum("r,nri->ni", mass, centres[:, row:]) - mass.sum() * point
    return np.asarray(np.cross(first, arm.gravity))


# --- one tube


def _cumulative() -> tuple[Array, Array, Array]:
    """Gauss-Legendre nodes and weights on [0, 1], and the matrix that integrates from 0 to each node."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    powers = np.arange(NODES)
    vandermonde = x[:, None] ** powers
    return x, w, (x[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(vandermonde)


X, W, INTEGRAL = _cumulative()


def place_on_tube(arm: Arm, row: int) -> tuple[float, Array, Array]:
    """Where along the tube of index ``row`` its body has its centre of mass (0: at the clamp, 1: at the end), the end of the
    tube in frame ``row`` and the vector from clamp to end there (3,) [m].
    """
    a, d, alpha, _ = arm.values[row]
    if along_x(arm.values)[row]:
        end, tube = np.zeros(3), np.array([a, 0.0, 0.0])
    else:
        end, tube = np.array([-a, 0.0, 0.0]), d * np.array([0.0, np.sin(alpha), np.cos(alpha)])
    return float(1.0 + (arm.com[row] - end) @ tube / (tube @ tube)), end, tube


def share_of_tube(arm: Arm, row: int) -> tuple[float, Array]:
    """How much of the body of index ``row`` is its uniform tube, and where the rest sits in frame ``row`` (3,) [m].

    The rest is a lump at the end of the tube (or at its start), such that the centre of mass is the stated one.
    """
    place, end, tube = place_on_tube(arm, row)
    share = float(np.clip(2.0 * min(place, 1.0 - place), 0.0, 1.0 - 1e-9))
    return share, (arm.com[row] - share * (end - 0.5 * tube)) / (1.0 - share)


def _beam(
    arm: Arm, values: Array, i: int, frames: Array, clamp: Array, centres: Array, shape: Shape, elastic: Elastic
) -> tuple[Array, Array, Array]:
    """Slope and sag of the end (n, 3), turns of the sections (n, NODES, 3)."""
    column = 0 if along_x(values)[i] else 1
    length = np.abs(values[:, i, column])[:, None]
    straight = clamp[:, :3, 2 if column else 0] * np.sign(values[:, i, column])[:, None]
    tangent = np.einsum("nkij,nj->nki", rotation(shape.sections[i]), straight)
    points = clamp[:, None, :3, 3] + length[:, None] * np.einsum("jk,nki->nji", INTEGRAL, tangent)
    moment = _moment_in_tube(arm, i, frames, centres, points, length)
    along = tangent * np.einsum("nki,nki->nk", tangent, moment)[..., None]
    curvature = elastic.bend[i] * (moment - along) + elastic.twist[i] * along
    sections = length[:, None] * np.einsum("jk,nki->nji", INTEGRAL, curvature)
    slope = length * np.einsum("k,nki->ni", W, curvature)
    sag = length * np.einsum("k,nki->ni", W, tangent - straight[:, None])
    return slope, sag, sections


def _moment_in_tube(arm: Arm, i: int, frames: Array, centres: Array, points: Array, length: Array) -> Array:
    """Moment of what lies beyond each section, (n, NODES, 3) [N·m]."""
    share, place = share_of_tube(arm, i)
    lump = frames[:, i + 1, :3, 3] + frames[:, i + 1, :3, :3] @ place
    beyond = arm.mass[i + 1 :]
    first = np.einsum("r,nri->ni", beyond, centres[:, i + 1 :])[:, None] - beyond.sum() * points
    if place_on_tube(arm, i)[0] > 0.5:
        first = first + (1.0 - share) * arm.mass[i] * (lump[:, None] - points)
    whole = np.einsum("k,nki->ni", W, points)[:, None]
    rest_of_tube = whole - np.einsum("jk,nki->nji", INTEGRAL, points) - (1.0 - X)[:, None] * points
    return np.cross(first + share * arm.mass[i] * rest_of_tube, arm.gravity)
