"""An arm in n records: where every place of its chain is, which weights pull at it, and under which
conditions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.arm import Arm, axis, end
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError, UnsupportedArmError


@dataclass(frozen=True, eq=False)
class State:
    """What a cause of error may look at. Places are those of :mod:`aacmm_pin.arm.chain`.

    All vectors and axes are in the base frame; :meth:`in_axes_of` turns vectors into the axes of a
    place, in which a :class:`~aacmm_pin.effects.Displacement` states its columns.

    Attributes:
        arm: the arm.
        q: joint angles by the readings (n, nq) [rad].
        conditions: what else is known of the records.
        target: the place whose origin is looked at.
        twists: displacements of places, see :meth:`Chain.walk`.
        looked_at: a point of the last body near the target, whose motion is asked for (n, 3) [m];
            None for the target.
        turns: whether the turn of the last body is asked for too, behind the motion of the point.
    """

    arm: Arm
    q: Array
    conditions: Conditions
    target: int
    twists: Mapping[int, Array] = field(default_factory=dict)
    looked_at: Array | None = None
    turns: bool = False

    @cached_property
    def _frames(self) -> tuple[Array, Array]:
        return self.arm.chain.walk(self.q, self.twists)

    @property
    def rotation(self) -> Array:
        """Axes of every place in the base, as columns: (places, n, 3, 3); ``rotation[axis(2)][:, :,
        2]`` is z of joint 2.
        """
        return self._frames[0]

    @property
    def origin(self) -> Array:
        """Origin of every place in the base (places, n, 3) [m]."""
        return self._frames[1]

    @property
    def n(self) -> int:
        """Number of records."""
        return len(self.q)

    @property
    def coordinates(self) -> int:
        """How many numbers a motion has: three, or six with the turn."""
        return 6 if self.turns else 3

    @property
    def position(self) -> Array:
        """Origin of the target, or what is looked at in its stead, in the base (n, 3) [m]."""
        if self.looked_at is not None:
            return self.looked_at
        return np.asarray(self.origin[self.target])

    def joint(self, row: int) -> int:
        """Number, from 0, of the joint of ``row`` (from 1), which follows no other.

        Raises:
            AacmmError: no such row, or it has no such joint.
        """
        return self._number(self.arm.chain.joint, row)

    def slides(self, row: int) -> bool:
        """Whether the joint of ``row`` slides; it may follow another.

        Raises:
            AacmmError: no such row, or it does not move.
        """
        chain = self.arm.chain
        number = self._number(chain.moved, row)
        return bool(chain.slides[number])

    def _number(self, of_places: Index, row: int) -> int:
        number = int(of_places[axis(self.known_row(row))])
        if number < 0:
            raise AacmmError(
                f"row {row} of {self.arm.name} is rigid or mimics another joint; expected a row "
                "with an independent joint"
            )
        return number

    def known_row(self, row: int) -> int:
        """``row`` itself (from 1), if the arm has it.

        Raises:
            AacmmError: no such row.
        """
        rows = self.arm.chain.rows
        if not 1 <= row <= rows:
            raise AacmmError(f"{self.arm.name} has no row {row}; expected 1 to {rows}")
        return row

    def bearing(self, row: int) -> int:
        """Place of the bearing on the axis of ``row``, where its body begins.

        :meth:`moment_at_axis` is about its origin.

        Raises:
            AacmmError: no such row.
        """
        return self.arm.foot(self.known_row(row))

    def angle(self, row: int) -> Array:
        """Angle of the joint of ``row`` (n,) [rad; m where the joint slides]."""
        return self.q[:, self.joint(row)]

    def reading(self, row: int) -> Array:
        """Indication of the encoder of ``row`` (n,) [rad; m where the joint slides]."""
        readings = self.arm.readings(self.q)
        return readings[:, self.joint(row)]

    def in_axes_of(self, place: int, vectors: Array) -> Array:
        """Vectors of the base (n, 3), or one (3,), as components along the axes of ``place`` (n,
        3).
        """
        turned = self.rotation[place]
        return np.asarray(
            np.einsum("nji,nj->ni", turned, np.broadcast_to(vectors, turned.shape[:2]))
        )

    def span(self, row: int) -> Array:
        """From the bearing to the end of body ``row``, in the base (n, 3) [m]."""
        bearing = self.bearing(row)
        return np.asarray(self.origin[end(row)] - self.origin[bearing])

    @property
    def down(self) -> Array:
        """Unit vector along gravity, in the base (3,)."""
        return -self.arm.up

    def moment_at_axis(self, row: int) -> Array:
        """Moment of the weight of body ``row`` and all beyond about its bearing, in the base (n, 3)
        [N·m].

        Raises:
            UnsupportedArmError: the arm states no masses.
        """
        return self.moment(row, self.origin[self.bearing(row)])

    def along_axis(self, row: int, vectors: Array) -> Array:
        """Part of vectors of the base (n, 3, …) along the axis of ``row`` (n, …): of a moment, what
        turns the joint.
        """
        z = self.rotation[axis(row)][:, :, 2]
        return np.asarray(np.einsum("ni,ni...->n...", z, vectors))

    def weight_beyond(self, row: int) -> Array:
        """Weight of all bodies beyond ``row``, in the base (3,) [N]."""
        mass = self.masses[row:].sum()
        return np.asarray(mass * self.arm.gravity)

    def moment(self, row: int, about: Array) -> Array:
        """The same about points of the base (n, 3) [m]."""
        mass = self.masses[row - 1 :].sum()
        lever = self._first_moments[row - 1] - mass * about
        return np.cross(lever, self.arm.gravity)

    def unit_moments(self, row: int) -> Array:
        """The same moment for unknown masses: columns of the unknown first moments of body ``row``
        and each beyond.

        The static moment about ``axis row`` is ``Σ (R_k H_k) × g`` with one constant vector H_k in
        each body, into which the masses farther out have been gathered at the body's end; for each
        component of H_k and unit gravity: (n, 3, 3 · bodies).

        Raises:
            UnsupportedArmError: a joint beyond ``row`` slides, and H_k is not constant.
        """
        rows = [k for k in self.arm.chain.joint_rows() if k >= row]
        slide = [k for k in rows if k > row and self.slides(k)]
        if slide:
            raise UnsupportedArmError(
                f"{self.arm.name}: joint {slide[0]} is prismatic; expected revolute joints for "
                "bodies with unknown masses"
            )
        columns = [self.rotation[axis(k)] for k in rows]
        return np.cross(np.concatenate(columns, axis=2), self.down[None, :, None], axis=1)

    @property
    def masses(self) -> Array:
        """Masses of the bodies (rows,) [kg].

        Raises:
            UnsupportedArmError: the arm states none.
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
        axes = slice(2, 2 * self.arm.chain.rows + 1, 2)
        from_axis = np.einsum("rnij,rj->rni", self.rotation[axes], self.arm.centres_of_mass)
        of_bodies = self.masses[:, None, None] * (self.origin[axes] + from_axis)
        moments = np.zeros((len(of_bodies) + 1, self.n, 3))
        moments[:-1] = np.cumsum(of_bodies[::-1], axis=0)[::-1]
        return moments
