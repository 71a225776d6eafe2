"""Where an elastic chain comes to rest under its own weight: equilibrium in the deflected pose,
iterated until it stands.

All loads are weights, so the moment of what hangs beyond a point P is ``Σ (r_k - P) × m_k g``, and
everything elastic turns the way that moment pulls. A tube is a Bernoulli beam: its section at s
turns relative to its neighbour by ``M(s) ds / EI`` across the tube and ``M(s) ds / GJ`` along it;
its sections lie where the straight tube has them. The tube of a body runs along its axis or across
it, whichever is longer. Its weight is spread, see :func:`_share`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blind.chains import Chain, Pieces
from blind.kinematics import Array, identity, moved, rotation, turn_z_shift

STOP = 1e-14
"""[m] and [rad]: the arm stands when no frame moves by more."""
MOST_ROUNDS = 60
NODES = 8
STRUT = 0.05
"""Lever of a strut on its body over the height of its anchor above the axis."""


@dataclass(frozen=True, eq=False)
class Elastic:
    """Flexibilities: of each joint about and across its axis [rad/(N·m)], of each tube 1/EI and
    1/GJ [rad/(N·m²)], of the base [rad/(N·m)]; and for each joint with a wrong counterbalance the
    turn when the body is level [rad].
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
        return (
            bool(np.any([self.joint, self.tilt, self.bend, self.twist, self.spring]))
            or self.base != 0.0
        )


@dataclass(frozen=True, eq=False)
class Rest:
    """A chain at rest: frames on the axes (n, R, 4, 4), the last frame (n, 4, 4), and by how much
    each joint has yielded, as rotation vectors in the base (R, n, 3).
    """

    axes: Array
    last: Array
    yielded: Array


def settle(
    arm: Chain, pieces: Pieces, angles: Array, growth: Array, elastic: Elastic, payload: Array
) -> Rest:
    """Equilibrium of ``pieces`` (R, 4, 4) whose shifts have grown by ``growth`` (n, R), for joint
    ``angles`` (n, R) [rad], with a ``payload`` (n,) [kg] at the tip.
    """
    (before, after), (n, rows) = pieces, angles.shape
    base, joint, slope, sag = np.zeros((n, 3)), *np.zeros((3, rows, n, 3))
    spans, clamps = _tubes(arm)
    for _ in range(MOST_ROUNDS):
        frame, axes = moved(identity(n), base), []
        for i in range(rows):
            turned = moved(frame @ _grown(before[i], growth[:, i]), joint[i])
            axes.append(turned @ turn_z_shift(angles[:, i], np.zeros(n)))
            frame = axes[-1] @ _grown(after[i], growth[:, i])
            if elastic.bend[i] or elastic.twist[i]:
                end = axes[-1][:, :3, 3] + axes[-1][:, :3, :3] @ (clamps[i] + spans[i])
                beyond = frame[:, :3, 3] - end
                shift = sag[i] + np.einsum("nij,nj->ni", rotation(slope[i]), beyond) - beyond
                frame = moved(frame, slope[i], shift)
        rest = Rest(np.stack(axes, axis=1), frame, joint)
        if not elastic.any:
            return rest
        load, old = Load.of(arm, rest, payload), (base, joint, slope, sag)
        base, joint = elastic.base * load.beyond(0, np.zeros(3)), np.zeros_like(joint)
        slope, sag = np.zeros_like(slope), np.zeros_like(sag)
        for i in range(rows):
            if elastic.joint[i] or elastic.tilt[i]:
                axis, moment = rest.axes[:, i, :3, 2], load.beyond(i, rest.axes[:, i, :3, 3])
                about = axis * np.einsum("nk,nk->n", axis, moment)[:, None]
                joint[i] = elastic.joint[i] * about + elastic.tilt[i] * (moment - about)
            if elastic.spring[i]:
                joint[i] += elastic.spring[i] * _strut(arm, i, rest, after[i] @ before[i + 1])
            if elastic.bend[i] or elastic.twist[i]:
                slope[i], sag[i] = _beam(arm, i, rest, load, spans[i], clamps[i], elastic)
        if (
            max(np.abs(a - b).max() for a, b in zip(old, (base, joint, slope, sag), strict=True))
            < STOP
        ):
            return rest
    raise RuntimeError(f"no equilibrium after {MOST_ROUNDS} rounds: the arm is too soft")


@dataclass(frozen=True, eq=False)
class Load:
    """Weights: centres of mass in the base (n, R, 3) [m], and a payload (n,) [kg] at the tip (n, 3)
    [m].
    """

    arm: Chain
    centres: Array
    payload: Array
    tip: Array

    @staticmethod
    def of(arm: Chain, rest: Rest, payload: Array) -> Load:
        centres = rest.axes[..., :3, 3] + np.einsum("nrij,rj->nri", rest.axes[..., :3, :3], arm.com)
        return Load(arm, centres, payload, rest.last[:, :3, 3])

    def first(self, row: int, points: Array) -> Array:
        """First moment about points (n, k, 3) of the bodies from index ``row`` on, and the payload
        [kg·m].
        """
        mass = self.arm.mass[row:]
        first = np.einsum("r,nri->ni", mass, self.centres[:, row:])[:, None] - mass.sum() * points
        return np.asarray(first + self.payload[:, None, None] * (self.tip[:, None] - points))

    def beyond(self, row: int, point: Array) -> Array:
        """Moment about a point (n, 3) or (3,) of the same, (n, 3) [N·m]."""
        points = np.broadcast_to(point, self.tip.shape)[:, None]
        return np.asarray(np.cross(self.first(row, points)[:, 0], self.arm.gravity))


def _grown(transform: Array, growth: Array) -> Array:
    """A constant transform with its shift (1 + growth) as long, (n, 4, 4)."""
    out = np.repeat(transform[None], len(growth), axis=0)
    out[:, :3, 3] *= 1.0 + growth[:, None]
    return out


def _strut(arm: Chain, i: int, rest: Rest, following: Array) -> Array:
    """Missing moment of a gas strut (n, 3), one where the body is level.

    A strut of constant force from an anchor h above the axis to a point r along the body pulls with
    the moment ``F h r (horizontal part of the body) / length``; too little of it lets the body
    fall. The turn counts positive about ``u × down``, u being the next joint's axis if that stands
    across this one, else the body's direction.
    """
    axis, frame, span = rest.axes[:, i, :3, 2], rest.axes[:, i, :3, :3], arm.spans()[i]
    across = abs(following[2, 2]) < 0.1
    u = frame @ (following[:3, 2] if across else span / np.linalg.norm(span))
    up = -arm.gravity / np.linalg.norm(arm.gravity)
    length = np.linalg.norm(up - STRUT * u, axis=1) / np.hypot(1.0, STRUT)
    return np.asarray(axis * (np.einsum("nk,nk->n", axis, np.cross(u, -up)) / length)[:, None])


# --- one tube


def _tubes(arm: Chain) -> tuple[Array, Array]:
    """The tube in each body along or across its axis, whichever is longer, and where it is clamped
    (R, 3) [m].
    """
    spans = arm.spans()
    along = spans * [0.0, 0.0, 1.0]
    lengthwise = (np.linalg.norm(along, axis=1) >= np.linalg.norm(spans - along, axis=1))[:, None]
    return np.where(lengthwise, along, spans - along), np.where(lengthwise, 0.0, along)


def _share(arm: Chain, i: int, span: Array, clamp: Array) -> tuple[float, Array | None]:
    """Share of the body that is its uniform tube, and where a lump at its end sits (3,) [m]; None:
    it is at the clamp.

    Tube and lump together have the centre of mass of the body.
    """
    place = float((arm.com[i] - clamp) @ span / (span @ span))
    share = float(np.clip(2.0 * min(place, 1.0 - place), 0.0, 1.0 - 1e-9))
    lump = (arm.com[i] - share * (clamp + 0.5 * span)) / (1.0 - share)
    return share, lump if place > 0.5 else None


def _cumulative() -> tuple[Array, Array, Array]:
    """Gauss-Legendre nodes and weights on [0, 1], and the matrix that integrates from 0 to each
    node.
    """
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    powers = np.arange(NODES)
    vandermonde = x[:, None] ** powers
    return x, w, (x[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(vandermonde)


X, W, INTEGRAL = _cumulative()


def _beam(
    arm: Chain, i: int, rest: Rest, load: Load, span: Array, clamp: Array, elastic: Elastic
) -> tuple[Array, Array]:
    """Slope and sag of the end of a tube (n, 3)."""
    frame, length = rest.axes[:, i], float(np.linalg.norm(span))
    start = frame[:, :3, 3] + frame[:, :3, :3] @ clamp
    tube = np.broadcast_to(frame[:, :3, :3] @ span, start.shape)
    points = start[:, None] + X[:, None] * tube[:, None]
    share, lump = _share(arm, i, span, clamp)
    mass, along = arm.mass[i], tube / length
    first = load.first(i + 1, points)
    if lump is not None:
        at = frame[:, :3, 3] + frame[:, :3, :3] @ lump
        first = first + (1.0 - share) * mass * (at[:, None] - points)
    first = first + share * mass * 0.5 * ((1.0 - X) ** 2)[:, None] * tube[:, None]
    moment = np.cross(first, arm.gravity)
    axial = along[:, None] * np.einsum("nki,ni->nk", moment, along)[..., None]
    curvature = elastic.bend[i] * (moment - axial) + elastic.twist[i] * axial
    turned = length * np.einsum("jk,nki->nji", INTEGRAL, curvature)
    slope = length * np.einsum("k,nki->ni", W, curvature)
    return slope, np.einsum(
        "k,nki->ni", W, np.cross(turned, np.broadcast_to(tube[:, None], (len(tube), NODES, 3)))
    )
