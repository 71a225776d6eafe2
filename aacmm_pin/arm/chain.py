"""Kinematics: an arm as a chain of places that may be displaced.

The places, from the base to the tip, with i from 1 to the number of rows:

- ``base``: the base frame;
- ``end 0``: where the base ends and joint 1 begins;
- ``axis i``: on the axis of row i, z along it, moving with body i. In standard DH its origin is
  that of frame i-1, in modified DH that of frame i;
- ``end i``: where body i ends and the next begins;
- ``tip``: the origin of the last frame again, for a stylus that moves on the last body.

Each place is a constant transform after the place before; at an ``axis`` the motion of the joint
follows. A displacement is a twist ξ = (v, ω) in the axes of its place, and acts as ``exp(ξ)`` after
it. Its derivative: a unit translation moves the tip p along the axis, a unit rotation by ``axis ×
(p - o)``, with the origin o of the place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.arrays import Array, Index, Mask, chunks, cross, spread_angles
from aacmm_pin._support.compiled import Loop
from aacmm_pin._support.plausible import REACH_POSTURES, out_of_reach
from aacmm_pin.arm.couplings import Drive, Mimic

OF_A_POSE = 6
"""Joints that a whole pose needs; with fewer, the point alone is reached."""
BASE = 0
V_X, V_Y, V_Z, OMEGA_X, OMEGA_Y, OMEGA_Z = range(6)
"""Components of a twist."""
Z = 2
NO_PLACE = -1
"""Of a parameter or joint that does not move the tip."""
LARGE_BATCH = 14_000
"""Postures from which the compiled loop is used: NumPy takes 6 ms, the loop 3 ms, loading it half a
second. It differs in the last digits.
"""
LANES = 128
"""Postures side by side in wide registers."""
SMALL_ANGLE_SQUARED = 1e-6
"""Below it :func:`exp` uses series [rad²]."""


def axis(row: int) -> int:
    """The place on the axis of ``row`` (from 1)."""
    return 2 * row


def end(row: int) -> int:
    """The place where body ``row`` (0: the base) ends."""
    return 2 * row + 1


@dataclass(frozen=True, eq=False)
class Chain:
    """Constant transforms and joints of a serial arm.

    Attributes:
        constant: transform of each place after the one before (places, 4, 4) [m].
        moved: joint of each place, from 0, counting joints that follow others; -1 for none
            (places,).
        slides: True for prismatic joints (m,).
        parameters: place, or :data:`NO_PLACE`, and twist component of each geometric parameter (p,
            2).
        drive: motion of the m joints by the nq independent ones.
    """

    constant: Array
    moved: NDArray[np.intp]
    slides: Mask
    parameters: Index
    drive: Drive

    @staticmethod
    def of_pieces(
        axes: list[Array],
        ends: list[Array],
        joints: Array | Index,
        slides: Mask,
        parameters: list[tuple[int, int]],
        mimics: Sequence[Mimic] = (),
    ) -> Chain:
        """The chain with transforms (4, 4) [m] before ``axis`` 1 … and ``end`` 0 …, and the joint
        of each axis, -1 if rigid.
        """
        constant = [np.eye(4), ends[0]]
        moved = [-1, -1]
        for before_axis, before_end, number in zip(axes, ends[1:], joints, strict=True):
            constant += [before_axis, before_end]
            moved += [int(number), -1]
        constant.append(np.eye(4))
        moved.append(-1)
        of_parameters = np.array(parameters, dtype=np.intp).reshape(-1, 2)
        drive = Drive.of(len(slides), mimics)
        return Chain(np.stack(constant), np.array(moved), slides, of_parameters, drive)

    @property
    def places(self) -> int:
        """Number of places."""
        return len(self.constant)

    @property
    def rows(self) -> int:
        """Number of DH rows, or of joints of an arm without a table."""
        return (self.places - 3) // 2

    @property
    def tip(self) -> int:
        """The last place."""
        return self.places - 1

    @property
    def nq(self) -> int:
        """Number of independent joints."""
        return len(self.drive.independent)

    @property
    def prismatic(self) -> Mask:
        """True for independent joints that are prismatic (nq,)."""
        return self.slides[self.drive.independent]

    @cached_property
    def joint(self) -> NDArray[np.intp]:
        """Independent joint of each place, from 0; -1 for none (places,)."""
        numbers = np.full(len(self.slides) + 1, -1)
        numbers[self.drive.independent] = np.arange(self.nq)
        return numbers[self.moved]

    def moving_axes(self) -> list[int]:
        """Places that joints move, in order."""
        return np.flatnonzero(self.moved >= 0).tolist()

    def joint_rows(self) -> list[int]:
        """Rows (from 1) with a joint, also one that follows another."""
        return [place // 2 for place in self.moving_axes()]

    def moving_rows(self) -> list[int]:
        """Rows (from 1) with an independent joint."""
        return (np.flatnonzero(self.joint >= 0) // 2).tolist()

    def links(self) -> Array:
        """L of ``L_0 Rz(q_1) L_1 … Rz(q_m) L_m`` (Tz for prismatic joints): (m + 1, 4, 4) [m].

        A screw about a joint axis commutes with the joint, and is put after it.
        """
        links = [np.eye(4)]
        for constant, joint in zip(self.constant, self.moved, strict=True):
            if joint >= 0 and (constant[:2, 2:] == 0.0).all() and constant[2, 2] > 0.0:
                links.append(constant)
                continue
            links[-1] = links[-1] @ constant
            if joint >= 0:
                links.append(np.eye(4))
        return np.stack(links)

    def cut(self, place: int) -> Chain:
        """The chain to ``place``."""
        constant = np.append(self.constant[: place + 1], np.eye(4)[None], axis=0)
        moved = np.append(self.moved[: place + 1], -1)
        reached = self.parameters[:, :1] <= place
        parameters = np.where(reached, self.parameters, NO_PLACE)
        return replace(self, constant=constant, moved=moved, parameters=parameters)

    def positions(self, q: Array) -> Array:
        """Tip (n, 3) [m] at checked ``q`` (n, nq)."""
        return self._differentiated(q, np.empty((0, 2), dtype=np.intp))[0]

    def position_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """Tip (n, 3) [m] at checked ``q`` (n, nq), and its derivative by the joints (n, 3, nq)."""
        twists = np.full((len(self.slides), 2), NO_PLACE)
        moving = self.moving_axes()
        twists[: len(moving), 0] = moving
        twists[:, 1] = np.where(self.slides, V_Z, OMEGA_Z)
        position, columns = self._differentiated(q, twists)
        return position, np.ascontiguousarray(self.drive.by_independent(columns))

    def position_and_sensitivity(self, q: Array) -> tuple[Array, Array]:
        """Tip (n, 3) [m] at checked ``q`` (n, nq), and its derivative by the parameters (n, 3,
        p).
        """
        return self._differentiated(q, self.parameters)

    def _differentiated(self, q: Array, twists: Index) -> tuple[Array, Array]:
        """Tip (n, 3) [m], and its derivative (n, 3, k) by twists: place and component (k, 2)."""
        n = len(q)
        position = np.empty((n, 3))
        columns = np.zeros((3, len(twists), n))
        if loop := LOOP.chosen(n):
            angles = np.ascontiguousarray(self.drive.angles(q))
            loop(self.constant, self.moved, self.slides, twists, angles, position, columns)
        else:
            for part in chunks(n):
                frames = self._frames(q[part], {})
                position[part] = frames[-1, 3].T
                for k, (place, component) in enumerate(twists.tolist()):
                    if place == NO_PLACE:
                        continue
                    derivative = frames[place, component % 3]
                    if component >= OMEGA_X:
                        derivative = cross(derivative, frames[-1, 3] - frames[place, 3])
                    columns[:, k, part] = derivative
        return position, columns.transpose(2, 0, 1)

    def beyond_reach(self) -> str:
        """A sentence if the tip is implausibly far from the base at some postures; else ""."""
        spread = spread_angles(REACH_POSTURES, self.nq) * ~self.prismatic
        return out_of_reach(self.positions(np.vstack([np.zeros(self.nq), spread])))

    def jacobian(self, rotation: Array, origin: Array, point: Array) -> tuple[Array, Array]:
        """Motion of a point (n, 3) [m] of the last body by the joints, at frames of :meth:`walk`.

        Returns:
            translations (n, 3, nq) [m/rad, m/m] and rotations (n, 3, nq).
        """
        places = self.moving_axes()
        z = rotation[places, :, :, 2]
        slides = self.slides[:, None, None]
        translations = np.where(slides, z, np.cross(z, point - origin[places]))
        rotations = np.where(slides, 0.0, z)
        by_all = translations.transpose(1, 2, 0), rotations.transpose(1, 2, 0)
        translations, rotations = map(self.drive.by_independent, by_all)
        return np.ascontiguousarray(translations), rotations

    def walk(self, q: Array, twists: Mapping[int, Array] | None = None) -> tuple[Array, Array]:
        """Frames of all places at checked ``q`` (n, nq), each after its displacement.

        Args:
            q: joint values (n, nq) [rad, m].
            twists: displacement of places: (n, 6) or (1, 6), v then ω in their axes [m, rad].

        Returns:
            rotation (places, n, 3, 3) and origin (places, n, 3) [m], in the base.
        """
        frames = self._frames(q, twists or {}).transpose(0, 3, 2, 1)
        return frames[..., :3], frames[..., 3]

    @cached_property
    def at_zero(self) -> tuple[Array, Array]:
        """Rotation (places, 3, 3) and origin (places, 3) [m] of all places at zero joint values."""
        rotation, origin = self.walk(np.zeros((1, self.nq)))
        return rotation[:, 0], origin[:, 0]

    def _frames(self, q: Array, twists: Mapping[int, Array]) -> Array:
        """Frames as x, y, z and origin; components; records last (places, 4, 3, n): several times
        faster than stacks of products.
        """
        n = len(q)
        frames = np.empty((self.places, 4, 3, n))
        before = np.zeros((4, 3, n))
        before[:3] = np.eye(3)[:, :, None]
        values = self.drive.angles(q).T
        cosine = np.cos(values)
        sine = np.sin(values)
        for place, joint in enumerate(self.moved.tolist()):
            here = frames[place]
            np.matmul(self.constant[place].T, before.reshape(4, -1), out=here.reshape(4, -1))
            if joint >= 0 and self.slides[joint]:
                here[3] += values[joint] * here[Z]
            elif joint >= 0:
                _rotate(here, Z, cosine[joint], sine[joint])
            if place in twists:
                _displace(here, twists[place])
            before = here
        return frames


def _rotate(frames: Array, about: int, cosine: Array, sine: Array) -> None:
    """Rotate frames (x, y, z …; components; n) in place about their own axis ``about``."""
    u = frames[(about + 1) % 3]
    v = frames[(about + 2) % 3]
    rotated_u = cosine * u
    rotated_u += sine * v
    v *= cosine
    v -= sine * u
    u[:] = rotated_u


def _displace(frames: Array, twists: Array) -> None:
    """Displace frames (4, 3, n) in place by twists (n, 6) in their own axes."""
    used_axes = np.flatnonzero(twists.any(axis=0)) % 3
    if not used_axes.size:
        return
    axis = int(used_axes[0])
    if (used_axes != axis).any():
        motions = np.broadcast_to(exp(twists), (frames.shape[2], 4, 4))
        frames[:] = np.einsum("nij,icn->jcn", motions, frames)
        return
    translation = twists[:, axis]
    rotation = twists[:, 3 + axis]
    frames[3] += translation * frames[axis]
    if rotation.any():
        _rotate(frames, axis, np.cos(rotation), np.sin(rotation))


def _differentiate(
    constant: Array,
    joint: Index,
    prismatic: Mask,
    twists: Index,
    angles: Array,
    position: Array,
    columns: Array,
) -> None:  # pragma: no cover, for numba compiles it
    """:meth:`Chain._differentiated` in loops, from angles of all joints (n, m) into ``position``
    (n, 3) and ``columns`` (3, k, n).
    """
    places = len(constant)
    n = len(angles)
    frames = np.zeros((places + 1, 4, 3, LANES))
    for i in range(3):
        frames[0, i, i] = 1.0
    for first in range(0, n, LANES):
        width = min(LANES, n - first)
        for place in range(places):
            before = frames[place]
            here = frames[place + 1]
            transform = constant[place]
            for i in range(3):
                for lane in range(width):
                    for k in range(4):
                        product = transform[3, k] * before[3, i, lane]
                        for m in range(3):
                            product += transform[m, k] * before[m, i, lane]
                        here[k, i, lane] = product
            moving = joint[place]
            for lane in range(width if moving >= 0 else 0):
                angle = angles[first + lane, moving]
                if prismatic[moving]:
                    for i in range(3):
                        here[3, i, lane] += angle * here[2, i, lane]
                    continue
                cosine = math.cos(angle)
                sine = math.sin(angle)
                for i in range(3):
                    u = here[0, i, lane]
                    v = here[1, i, lane]
                    here[0, i, lane] = cosine * u + sine * v
                    here[1, i, lane] = cosine * v - sine * u
        tip = frames[places, 3]
        for lane in range(width):
            for i in range(3):
                position[first + lane, i] = tip[i, lane]
        for k in range(len(twists)):
            place = twists[k, 0]
            component = twists[k, 1]
            if place < 0:
                continue
            axis = frames[place + 1, component % 3]
            origin = frames[place + 1, 3]
            for i in range(3):
                j = (i + 1) % 3
                m = (i + 2) % 3
                for lane in range(width):
                    derivative = axis[i, lane]
                    if component >= 3:
                        derivative = axis[j, lane] * (tip[m, lane] - origin[m, lane])
                        derivative -= axis[m, lane] * (tip[j, lane] - origin[j, lane])
                    columns[i, k, first + lane] = derivative


LOOP = Loop(
    _differentiate,
    "void(f8[:, :, ::1], i8[::1], b1[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1])",
    least=LARGE_BATCH,
)


def exp(twist: Array) -> Array:
    """Rigid motions (n, 4, 4) [m] of twists (n, 6), v then ω [m, rad].

    Rodrigues' formula ``I + A M + B M²`` with M = [[ω], v; 0, 0], and ``C ω (ω · v)`` added to its
    translation; A = sin φ/φ, B = (1 - cos φ)/φ², C = (φ - sin φ)/φ³, φ = |ω| (Murray, Li, Sastry
    1994, eqs. 2.14, 2.36, with [ω]² = ω ωᵀ - φ² I).
    """
    v = twist[:, :3]
    w = twist[:, 3:]
    squared = np.einsum("ni,ni->n", w, w)[:, None, None]
    small = squared < SMALL_ANGLE_SQUARED
    phi = np.sqrt(np.where(small, 1.0, squared))
    a = np.where(small, 1.0 - squared / 6.0, np.sin(phi) / phi)
    b = np.where(small, 0.5 - squared / 24.0, (1.0 - np.cos(phi)) / phi**2)
    c = np.where(small, 1.0 / 6.0 - squared / 120.0, (phi - np.sin(phi)) / phi**3)
    matrix = np.zeros((len(twist), 4, 4))
    matrix[:, :3, :3] = skew(w)
    matrix[:, :3, 3] = v
    motion: Array = np.eye(4) + a * matrix + b * (matrix @ matrix)
    dot = np.einsum("ni,ni->n", w, v)[:, None]
    motion[:, :3, 3] += c[:, 0] * w * dot
    return motion


def skew(w: Array) -> Array:
    """Matrices of the cross products ω × for (n, 3): (n, 3, 3)."""
    cross = np.zeros((len(w), 3, 3))
    cross[:, 2, 1] = w[:, 0]
    cross[:, 0, 2] = w[:, 1]
    cross[:, 1, 0] = w[:, 2]
    return cross - cross.transpose(0, 2, 1)


def rigid_motions(points: Array) -> Array:
    """Motion of points (n, 3) [m] by translation and rotation of their body: (n, 3, 6)."""
    rotations = -skew(points)
    translations = np.broadcast_to(np.eye(3), rotations.shape)
    return np.concatenate([translations, rotations], axis=2)


def screws(angle: Array | float, length: Array | float, axis: int) -> Array:
    """Screw motions about and along x (0) or z (2) [rad, m]: (n, 4, 4)."""
    angle, length = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), length)
    twists = np.zeros((len(angle), 6))
    twists[:, axis], twists[:, 3 + axis] = length, angle
    return exp(twists)
