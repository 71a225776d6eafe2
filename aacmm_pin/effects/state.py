"""An arm in n records: places of its chain, weights and conditions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from aacmm_pin._support.arrays import Array, Index
from aacmm_pin.arm import Arm, axis, end
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, UnsupportedArmError


@dataclass(frozen=True, eq=False)
class State:
    """The arm in n records, as the input of a cause; places are those of
    :mod:`aacmm_pin.arm.chain`.

    All vectors are in the base frame. :meth:`in_axes_of` converts them to the axes of a place, in
    which a :class:`~aacmm_pin.effects.Displacement` states its columns.

    Attributes:
        q: joint angles from the readings ``(n, nq)`` [rad].
        target: place whose origin is the target.
        twists: displacements of places; see :meth:`Chain.walk`.
        looked_at: another point of the last body near the target, ``(n, 3)`` [m]; None for the
            target.
        with_rotation: also compute the rotation of the last body, after the translation of the
            point.
    """

    arm: Arm
    q: Array
    conditions: Conditions
    target: int
    twists: Mapping[int, Array] = field(default_factory=dict)
    looked_at: Array | None = None
    with_rotation: bool = False

    @cached_property
    def _frames(self) -> tuple[Array, Array]:
        return self.arm.chain.walk(self.q, self.twists)

    @property
    def rotation(self) -> Array:
        """The axes of every place as columns, ``(places, n, 3, 3)``; z of joint 2 is
        ``rotation[axis(2)][:, :, 2]``.
        """
        return self._frames[0]

    @property
    def origin(self) -> Array:
        """The origin of every place, ``(places, n, 3)`` [m]."""
        return self._frames[1]

    @property
    def n(self) -> int:
        """The number of records."""
        return len(self.q)

    @property
    def coordinates(self) -> int:
        """Three coordinates of a motion, or six with the rotation."""
        return 6 if self.with_rotation else 3

    @property
    def position(self) -> Array:
        """The origin of the target, or ``looked_at``, ``(n, 3)`` [m]."""
        if self.looked_at is not None:
            return self.looked_at
        return np.asarray(self.origin[self.target])

    def joint(self, row: int) -> int:
        """The index (from 0) of the joint of ``row`` (from 1).

        Raises:
            AacmmError: the row does not exist, has no joint, or its joint follows another joint.
        """
        return self._number(self.arm.chain.joint, row)

    def slides(self, row: int) -> bool:
        """Whether the joint of ``row``, which may follow another, is prismatic.

        Raises:
            AacmmError: the row does not exist or has no joint.
        """
        chain = self.arm.chain
        number = self._number(chain.moved, row)
        return bool(chain.slides[number])

    def _number(self, of_places: Index, row: int) -> int:
        """The number at the axis of ``row``, after a check."""
        number = int(of_places[axis(self.known_row(row))])
        if number < 0:
            raise AacmmError(
                f"row {row} of {self.arm.name} is rigid or mimics another joint; expected a row "
                "with an independent joint"
            )
        return number

    def known_row(self, row: int) -> int:
        """``row`` (from 1), after a check.

        Raises:
            AacmmError: the row does not exist.
        """
        rows = self.arm.chain.rows
        if not 1 <= row <= rows:
            raise AacmmError(f"{self.arm.name} has no row {row}; expected 1 to {rows}")
        return row

    def bearing(self, row: int) -> int:
        """The place at which the body of ``row`` begins on the joint axis; :meth:`moment_at_axis`
        is about its origin.

        Raises:
            AacmmError: the row does not exist.
        """
        return self.arm.foot(self.known_row(row))

    def angle(self, row: int) -> Array:
        """The angle or position of the joint of ``row``, ``(n,)`` [rad, m]."""
        return self.q[:, self.joint(row)]

    def reading(self, row: int) -> Array:
        """The reading of the encoder of ``row``, ``(n,)`` [rad; m for a prismatic joint]."""
        readings = self.arm.readings(self.q)
        return readings[:, self.joint(row)]

    def in_axes_of(self, place: int, vectors: Array) -> Array:
        """Vectors of the base, ``(n, 3)`` or ``(3,)``, as components in the axes of ``place``,
        ``(n, 3)``.
        """
        axes = self.rotation[place]
        return np.asarray(np.einsum("nji,nj->ni", axes, np.broadcast_to(vectors, axes.shape[:2])))

    def span(self, row: int) -> Array:
        """The vector from the bearing to the end of body ``row``, ``(n, 3)`` [m]."""
        bearing = self.bearing(row)
        return np.asarray(self.origin[end(row)] - self.origin[bearing])

    @property
    def down(self) -> Array:
        """The unit vector along gravity, ``(n, 3)``."""
        return self.conditions.in_tilted_base(-self.arm.up)

    @cached_property
    def gravity(self) -> Array:
        """The acceleration of gravity, ``(n, 3)`` [m/s²]."""
        return self.conditions.in_tilted_base(self.arm.gravity)

    def moment_at_axis(self, row: int) -> Array:
        """The moment of the weight of body ``row`` and all later about its bearing, ``(n, 3)``
        [N·m].

        Raises:
            UnsupportedArmError: the arm has no masses.
        """
        return self.moment(row, self.origin[self.bearing(row)])

    def along_axis(self, row: int, vectors: Array) -> Array:
        """The component of vectors ``(n, 3, …)`` along the axis of ``row``, ``(n, …)``."""
        z = self.rotation[axis(row)][:, :, 2]
        return np.asarray(np.einsum("ni,ni...->n...", z, vectors))

    def weight_beyond(self, row: int) -> Array:
        """The weight of all bodies after ``row``, ``(n, 3)`` [N]."""
        mass = self.masses[row:].sum()
        return np.asarray(mass * self.gravity)

    def moment(self, row: int, about: Array) -> Array:
        """The moment of the weight of body ``row`` and all later about points ``(n, 3)`` [m]: ``(n,
        3)`` [N·m].
        """
        mass = self.masses[row - 1 :].sum()
        lever = self._first_moments[row - 1] - mass * about
        return np.cross(lever, self.gravity)

    def unit_moments(self, row: int) -> Array:
        """The moment about ``axis(row)`` for unknown masses, ``(n, 3, 3 · bodies)``.

        The static moment is ``Σ (R_k H_k) × g``, with a constant vector H_k for body ``row`` and
        each later one. H_k contains the masses farther out, lumped at the end of the body. Each
        column is for one component of H_k and unit gravity.

        Raises:
            UnsupportedArmError: a joint after ``row`` is prismatic, so that H_k is not constant.
        """
        rows = [k for k in self.arm.chain.joint_rows() if k >= row]
        sliding = [k for k in rows if k > row and self.slides(k)]
        if sliding:
            raise UnsupportedArmError(
                f"{self.arm.name}: joint {sliding[0]} is prismatic; expected revolute joints for "
                "bodies with unknown masses"
            )
        axes = [self.rotation[axis(k)] for k in rows]
        return np.cross(np.concatenate(axes, axis=2), self.down[:, :, None], axis=1)

    @property
    def masses(self) -> Array:
        """The masses of the bodies, ``(rows,)`` [kg].

        Raises:
            UnsupportedArmError: the arm has no masses.
        """
        if self.arm.masses is None:
            raise UnsupportedArmError(
                f"{self.arm.name}: the arm states no masses; state mass_kg of each row for an "
                "effect of gravity"
            )
        return self.arm.masses

    @cached_property
    def _first_moments(self) -> Array:
        """Σ m_k c_k over each body and all beyond, (rows + 1, n, 3) [kg·m]."""
        axes = slice(axis(1), axis(self.arm.chain.rows) + 1, 2)  # every second place
        from_axis = np.einsum("rnij,rj->rni", self.rotation[axes], self.arm.centres_of_mass)
        of_bodies = self.masses[:, None, None] * (self.origin[axes] + from_axis)
        moments = np.zeros((len(of_bodies) + 1, self.n, 3))
        moments[:-1] = np.cumsum(of_bodies[::-1], axis=0)[::-1]
        return moments
