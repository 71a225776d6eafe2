"""A chain with its faults at rest: what :mod:`blind.machine` and :mod:`blind.statics` are for a table of standard DH."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blind.chains import Chain
from blind.conditions import Conditions
from blind.kinematics import Array, identity, moved, rotation, turn_z_shift
from blind.machine import Machine
from blind.statics import INTEGRAL, MOST_ROUNDS, NODES, STOP, STRUT, Elastic, W, X


@dataclass(frozen=True, eq=False)
class Loaded(Conditions):
    """Conditions with a payload at the tip (n,) [kg], and the number of the marker on the last body (n,)."""

    payload: Array
    marker: Array


@dataclass(eq=False)
class Pose:
    """A chain at rest: frames on the axes (n, R, 4, 4); ``frames`` holds the last frame (n, 1, 4, 4)."""

    axes: Array
    frames: Array


@dataclass(frozen=True, eq=False)
class Rig(Machine):
    """A chain whose geometry deviates by ``values`` (R, P) from its file; targets of markers on the last body (M, 3) [m]."""

    arm: Chain
    targets: Array | None = None

    def lengths(self) -> Array:
        return np.asarray(np.abs(self.arm.spans()).max(axis=1))

    def observed(self, q: Array, conditions: Conditions) -> Array:
        tip = super().observed(q, conditions)
        if self.targets is not None:
            assert isinstance(conditions, Loaded)
            last = self.rest(q, conditions).frames[:, -1, :3, :3]
            tip = tip + np.einsum("nij,nj->ni", last, self.targets[conditions.marker.astype(int)])
        return tip

    def torque(self, q: Array, conditions: Loaded) -> Array:
        """What the drives hold (n, nq) [N·m]."""
        pose = self.rest(q, conditions)
        load = _Load.of(self.arm, pose, conditions)
        moments = np.stack([load.beyond(i, pose.axes[:, i, :3, 3]) for i in range(self.arm.rows)], axis=1)
        return -np.einsum("nri,nri->nr", pose.axes[:, :, :3, 2], moments)[:, self.arm.moving]

    def rest(self, q: Array, conditions: Conditions) -> Pose:
        """The arm at rest: rounds until no deflection changes."""
        angles, growth, elastic = self.joint_angles(q, conditions), self.growth(conditions), self.elastic()
        before, after = self.arm.pieces(self.geometry())
        n, rows = angles.shape
        base, joint, slope, sag = np.zeros((n, 3)), *np.zeros((3, rows, n, 3))
        spans, clamps = _tubes(self.arm)
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
            pose = Pose(np.stack(axes, axis=1), frame[:, None])
            if not elastic.any:
                return pose
            load, old = _Load.of(self.arm, pose, conditions), (base, joint.copy(), slope.copy(), sag.copy())
            base = elastic.base * load.beyond(0, np.zeros(3))
            for i in range(rows):
                axis, origin = pose.axes[:, i, :3, 2], pose.axes[:, i, :3, 3]
                joint[i] = 0.0
                if elastic.joint[i] or elastic.tilt[i]:
                    moment = load.beyond(i, origin)
                    about = axis * np.einsum("nk,nk->n", axis, moment)[:, None]
                    joint[i] = elastic.joint[i] * about + elastic.tilt[i] * (moment - about)
                if elastic.spring[i]:
                    joint[i] += elastic.spring[i] * self._strut(i, pose, before)
                if elastic.bend[i] or elastic.twist[i]:
                    slope[i], sag[i] = self._beam(i, pose, load, spans[i], clamps[i], elastic)
            if max(np.abs(a - b).max() for a, b in zip(old, (base, joint, slope, sag), strict=True)) < STOP:
                return pose
        raise RuntimeError(f"no equilibrium after {MOST_ROUNDS} rounds: the arm is too soft")

    def _strut(self, i: int, pose: Pose, before: Array) -> Array:
        """Missing moment of a gas strut (n, 3), one where the body is level; see :func:`blind.statics._strut`."""
        axis, frame = pose.axes[:, i, :3, 2], pose.axes[:, i, :3, :3]
        after = self.arm.pieces(self.values)[1]
        following = (after[i] @ before[i + 1])[:3, 2]
        u = frame @ (following if abs(following[2]) < 0.1 else self.arm.spans()[i] / np.linalg.norm(self.arm.spans()[i]))
        up = -self.arm.gravity / np.linalg.norm(self.arm.gravity)
        length = np.linalg.norm(up - STRUT * u, axis=1) / np.hypot(1.0, STRUT)
        return np.asarray(axis * (np.einsum("nk,nk->n", axis, np.cross(u, -up)) / length)[:, None])

    def _beam(self, i: int, pose: Pose, load: _Load, span: Array, clamp: Array, elastic: Elastic) -> tuple[Array, Array]:
        """Slope and sag of the end of a Bernoulli beam (n, 3); its sections lie where the straight tube has them."""
        frame, length = pose.axes[:, i], float(np.linalg.norm(span))
        start = frame[:, :3, 3] + frame[:, :3, :3] @ clamp
        tube = np.broadcast_to(frame[:, :3, :3] @ span, start.shape)
        points = start[:, None] + X[:, None] * tube[:, None]
        share, lump = _share(self.arm, i, span, clamp)
        mass, along = self.arm.mass[i], tube / length
        first = load.first(i + 1, points)
        if lump is not None:
            at = frame[:, :3, 3] + frame[:, :3, :3] @ lump
            first = first + (1.0 - share) * mass * (at[:, None] - points)
        first = first + share * mass * 0.5 * ((1.0 - X) ** 2)[:, None] * tube[:, None]
        moment = np.cross(first, self.arm.gravity)
        axial = along[:, None] * np.einsum("nki,ni->nk", moment, along)[..., None]
        curvature = elastic.bend[i] * (moment - axial) + elastic.twist[i] * axial
        turned = length * np.einsum("jk,nki->nji", INTEGRAL, curvature)
        slope = length * np.einsum("k,nki->ni", W, curvature)
        return slope, np.einsum("k,nki->ni", W, np.cross(turned, np.broadcast_to(tube[:, None], (len(tube), NODES, 3))))


@dataclass(frozen=True, eq=False)
class _Load:
    """Weights: centres of mass in the base (n, R, 3) [m], and a payload (n,) [kg] at the tip (n, 3) [m]."""

    arm: Chain
    centres: Array
    payload: Array
    tip: Array

    @staticmethod
    def of(arm: Chain, pose: Pose, conditions: Conditions) -> _Load:
        centres = pose.axes[..., :3, 3] + np.einsum("nrij,rj->nri", pose.axes[..., :3, :3], arm.com)
        payload = conditions.payload if isinstance(conditions, Loaded) else np.zeros(len(conditions.time))
        return _Load(arm, centres, payload, pose.frames[:, -1, :3, 3])

    def first(self, row: int, points: Array) -> Array:
        """First moment about points (n, k, 3) of the bodies from index ``row`` on, and the payload [kg·m]."""
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


def _tubes(arm: Chain) -> tuple[Array, Array]:
    """The tube in each body along or across its axis, whichever is longer, and where it is clamped (R, 3) [m]."""
    spans = arm.spans()
    along = spans * [0.0, 0.0, 1.0]
    lengthwise = (np.linalg.norm(along, axis=1) >= np.linalg.norm(spans - along, axis=1))[:, None]
    return np.where(lengthwise, along, spans - along), np.where(lengthwise, 0.0, along)


def _share(arm: Chain, i: int, span: Array, clamp: Array) -> tuple[float, Array | None]:
    """Share of the body that is its uniform tube, and where a lump at its end sits (3,) [m]; None: it is at the clamp."""
    place = float((arm.com[i] - clamp) @ span / (span @ span))
    share = float(np.clip(2.0 * min(place, 1.0 - place), 0.0, 1.0 - 1e-9))
    lump = (arm.com[i] - share * (clamp + 0.5 * span)) / (1.0 - share)
    return share, lump if place > 0.5 else None
