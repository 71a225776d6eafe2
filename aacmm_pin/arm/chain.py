"""The arm as a chain of places at which something may be displaced, and the walk along it; pure NumPy.

The places, from the base to the tip, with i from 1 to the number of rows:

- ``base``: the base frame;
- ``end 0``: where the base ends and joint 1 begins, not yet turned;
- ``axis i``: on the axis of row i, turned with it, z along the axis: what sits here moves with body i. In standard DH its
  origin is that of frame i-1, in modified DH that of frame i;
- ``end i``: where body i ends and the next begins;
- ``tip``: the origin of the last frame once more, so that a stylus can be shifted apart from the last body.

Each place is a constant transform behind the one before, followed at an ``axis`` by the joint's own motion. A displacement
is a twist ξ = (v, ω) in the axes of its place, and acts as ``exp(ξ)`` behind it; nothing is linearised. Standard DH puts
(d, θ) of row i at ``axis i`` and (a, α) at ``end i``; modified DH puts (a, α) at ``end i-1``. Two screws about one axis
commute, so displacing a place by (δa, δα) is exactly the arm with a + δa, α + δα.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm.dh import DHTable

OF_A_POSE = 6
"""Joints with which an arm can take a whole pose; one with fewer brings only its point."""
BASE = 0


def axis(row: int) -> int:
    """Place on the axis of ``row`` (from 1)."""
    return 2 * row


def end(row: int) -> int:
    """Place where body ``row`` (0 is the base) ends."""
    return 2 * row + 1


@dataclass(frozen=True, eq=False)
class Chain:
    """Constant transforms and joints of a serial arm.

    Attributes:
        constant: constant transform of each place behind the one before (places, 4, 4) [m].
        joint: number of the joint that moves a place, counted from 0; -1 where none (places,).
        prismatic: (nq,) True where a joint slides along z instead of turning about it.
    """

    constant: Array
    joint: NDArray[np.intp]
    prismatic: NDArray[np.bool_]

    @staticmethod
    def of_dh(dh: DHTable) -> Chain:
        """The chain of a DH table; fixed rows have an ``axis`` that does not move."""
        turns, slides, tilts = (screws(*values) for values in ((dh.theta_offset, 0, 2), (0, dh.d, 2), (dh.alpha, dh.a, 0)))
        axes, ends = [], [np.eye(4)]
        for turn, slide, tilt in zip(turns, slides, tilts, strict=True):
            if dh.standard:
                axes.append(turn)
                ends.append(slide @ tilt)
            else:
                ends[-1] = ends[-1] @ tilt
                axes.append(turn @ slide)
                ends.append(np.eye(4))
        numbers = np.where(dh.moving, np.cumsum(dh.moving) - 1, -1)
        return Chain.of_pieces(axes, ends, numbers, np.zeros(dh.nq, dtype=bool))

    @staticmethod
    def of_pieces(axes: list[Array], ends: list[Array], joints: Array | Index, prismatic: NDArray[np.bool_]) -> Chain:
        """The chain with these constant transforms before ``axis`` 1 … and before ``end`` 0 …; ``joints`` of the axes."""
        constant, joint = [np.eye(4), ends[0]], [-1, -1]
        for before_axis, before_end, number in zip(axes, ends[1:], joints, strict=True):
            constant += [before_axis, before_end]
            joint += [int(number), -1]
        return Chain(np.stack([*constant, np.eye(4)]), np.array([*joint, -1]), prismatic)

    @property
    def places(self) -> int:
        """Number of places."""
        return len(self.constant)

    @property
    def rows(self) -> int:
        """Number of rows: DH rows, or joints of an arm without a table."""
        return (self.places - 3) // 2

    @property
    def tip(self) -> int:
        """The last place."""
        return self.places - 1

    @property
    def nq(self) -> int:
        """Number of joints."""
        return len(self.prismatic)

    def moving_axes(self) -> list[int]:
        """The places that the joints move, in the order of the joints."""
        return [int(place) for place in np.flatnonzero(self.joint >= 0)]

    def moving_rows(self) -> list[int]:
        """The rows (from 1) that have a joint, in the order of the joints."""
        return [place // 2 for place in self.moving_axes()]

    def jacobian(self, rotation: Array, origin: Array, point: Array) -> tuple[Array, Array]:
        """Motion of a point (n, 3) [m] of the last body by the joints, from the frames of a :meth:`walk`.

        Returns:
            shifts of the point (n, 3, nq) [m/rad; 1 where a joint slides] and turns of the body (n, 3, nq) [1].
        """
        places = self.moving_axes()
        z = rotation[places, :, :, 2]
        slides = self.prismatic[:, None, None]
        shifts = np.where(slides, z, np.cross(z, point - origin[places]))
        turns = np.where(slides, 0.0, z)
        return np.ascontiguousarray(shifts.transpose(1, 2, 0)), turns.transpose(1, 2, 0)

    def walk(self, q: Array, twists: Mapping[int, Array] | None = None) -> tuple[Array, Array]:
        """Frames of all places for already checked ``q`` (n, nq), each behind the displacement of its own place.

        Args:
            q: joint values (n, nq) [rad, m].
            twists: displacement of some places: (n, 6) or (1, 6), v then ω in the place's axes [m, rad].

        Returns:
            rotation (places, n, 3, 3) and origin (places, n, 3) [m], in the base.
        """
        n = len(q)
        frames = np.empty((self.places, 4, 3, n))  # x, y, z and origin, components, and the records last: see dh
        before, angles = np.zeros((4, 3, n)), q.T
        before[:3] = np.eye(3)[:, :, None]
        cosine, sine = np.cos(angles), _both_signs(np.sin(angles))
        constants, left = self._with_constant(twists or {})
        for place, (constant, joint) in enumerate(zip(constants, self.joint.tolist(), strict=True)):
            here = frames[place]
            np.matmul(constant.T, before.reshape(4, -1), out=here.reshape(4, -1))
            if joint >= 0 and self.prismatic[joint]:
                here[3] += angles[joint] * here[2]
            elif joint >= 0:
                _about_z(here, cosine[joint], sine[joint])
            if place in left and not left[place][:, :5].any():  # as an encoder's error: a third of the work
                turn = left[place][:, 5]
                _about_z(here, np.cos(turn), _both_signs(np.sin(turn)))
            elif place in left:
                here[:] = np.einsum("nij,icn->jcn", np.broadcast_to(exp(left[place]), (n, 4, 4)), here)
            before = here
        return frames[:, :3].transpose(0, 3, 2, 1), frames[:, 3].transpose(0, 2, 1)

    def _with_constant(self, twists: Mapping[int, Array]) -> tuple[Array, Mapping[int, Array]]:
        """The constant transforms with those displacements that are the same in every record, and the others.

        Behind a joint only a screw about its own z can change places with the joint's motion.
        """
        places = np.array([place for place, twist in twists.items() if len(twist) == 1], dtype=np.intp)
        if not places.size:
            return self.constant, twists
        same = np.concatenate([twists[place] for place in places.tolist()])
        before_joint = (self.joint[places] < 0) | ~same[:, [0, 1, 3, 4]].any(axis=1)
        places, constants = places[before_joint], self.constant.copy()
        constants[places] = constants[places] @ exp(same[before_joint])
        return constants, {place: twist for place, twist in twists.items() if place not in places}


def exp(twist: Array) -> Array:
    """Rigid motions (n, 4, 4) [m] of twists (n, 6), v then ω [m, rad], by Rodrigues' formula.

    ``I + A M + B M²`` with M = [[ω], v; 0, 0], and ``C ω (ω · v)`` added to its shift; A = sin φ/φ, B = (1 - cos φ)/φ²,
    C = (φ - sin φ)/φ³, φ = |ω| (Murray, Li, Sastry 1994, eqs. 2.14, 2.36, with [ω]² = ω ωᵀ - φ² I).
    """
    v, w = twist[:, :3], twist[:, 3:]
    squared = np.einsum("ni,ni->n", w, w)[:, None, None]
    small = squared < 1e-6
    phi = np.sqrt(np.where(small, 1.0, squared))
    a = np.where(small, 1.0 - squared / 6.0, np.sin(phi) / phi)
    b = np.where(small, 0.5 - squared / 24.0, (1.0 - np.cos(phi)) / phi**2)
    c = np.where(small, 1.0 / 6.0 - squared / 120.0, (phi - np.sin(phi)) / phi**3)
    matrix = np.zeros((len(twist), 4, 4))
    matrix[:, :3, :3], matrix[:, :3, 3] = skew(w), v
    motion = np.eye(4) + a * matrix + b * (matrix @ matrix)
    motion[:, :3, 3] += c[:, 0] * w * np.einsum("ni,ni->n", w, v)[:, None]
    return np.asarray(motion)


def skew(w: Array) -> Array:
    """Matrices of the cross products ω × for (n, 3): (n, 3, 3)."""
    cross = np.zeros((len(w), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -w[:, 2], w[:, 1], -w[:, 0]
    return cross - cross.transpose(0, 2, 1)


def _about_z(frames: Array, cosine: Array, sine: Array) -> None:
    """Frames (x, y, z …; components; n) turned in place about their own z; ``sine`` as :func:`_both_signs` gives it."""
    turned = frames[1::-1] * sine
    frames[:2] *= cosine
    frames[:2] += turned


def _both_signs(sine: Array) -> Array:
    """Sines (…, n) as x and as y need them (…, 2, 1, n)."""
    return np.stack([sine, -sine], axis=-2)[..., None, :]


def screws(angle: Array | float, length: Array | float, axis: int) -> Array:
    """Screw motions about and along the x (0) or z (2) axis [rad, m]: (n, 4, 4)."""
    angle, length = np.broadcast_arrays(np.asarray(angle, dtype=np.float64), length)
    twists = np.zeros((len(angle), 6))
    twists[:, axis], twists[:, 3 + axis] = length, angle
    return exp(twists)
