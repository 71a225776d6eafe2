"""The straight tube inside a body, what hangs at its end, and how it carries its own weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, axis, end
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError

SHORTEST_TUBE = 1e-3
"""A body shorter than this is no tube [m]."""
BENDS = 0.15
"""A body longer than this bends enough to be asked about [m]."""


def tubes(arm: Arm) -> list[int]:
    """Return the rows of the tubes: bodies that are long enough to bend."""
    _, origin = arm.chain.walk(np.zeros((1, arm.nq)))
    rows = range(1, arm.chain.rows + 1)
    found = []
    for row in rows:
        span = origin[end(row)] - origin[arm.foot(row)]
        if np.linalg.norm(span) > BENDS:
            found.append(row)
    return found


@dataclass(frozen=True, eq=False)
class Tube:
    """A tube along the axis of its row or across it, whichever the body is longer along; the rest
    of the body is rigid.

    Attributes:
        along: unit vector from its clamp to its end (n, 3).
        length: (n, 1) [m].
        rest: from its end to the end of the body (n, 3) [m].
        weight: of what hangs at its end, a lump of the body itself included (n, 3) [N].
        moment: of that about its end (n, 3) [N·m].
        own: weight that is spread evenly over its length (n, 3) [N].
    """

    along: Array
    length: Array
    rest: Array
    weight: Array
    moment: Array
    own: Array

    @staticmethod
    def of(state: State, row: int, label: str) -> Tube:
        """The tube of body ``row``.

        As much of the body's weight is spread over the tube as its centre of mass allows; the rest
        is a lump at the end of the tube or, where the centre of mass is in the nearer half, at its
        clamp.

        Raises:
            AacmmError: the body is too short.
            UnsupportedArmError: the arm states no masses.
        """
        place = axis(row)
        body = row - 1
        span = state.span(row)
        z = state.rotation[place][:, :, 2]
        upward = np.einsum("ni,ni->n", span, z)[:, None] * z
        outward = span - upward
        lengthwise = np.linalg.norm(upward) >= np.linalg.norm(outward)
        tube, clamp = (upward, np.zeros_like(upward)) if lengthwise else (outward, upward)
        length = length_of(tube, state, row, label)
        rest = span - clamp - tube
        from_bearing = state.origin[place] - state.origin[state.bearing(row)]
        from_axis = state.rotation[place] @ state.arm.centres_of_mass[body]
        centre = from_bearing + from_axis - clamp
        part = np.einsum("ni,ni->n", centre, tube)[:, None] / length**2
        share = np.clip(2 * np.minimum(part, 1 - part), 0.0, 1.0)
        own = state.masses[body] * state.arm.gravity
        beyond = state.weight_beyond(row)
        # The first moment of the lump about the end is the body's less that of the tube, whose
        # middle is half a length back.
        lump = np.where(part > 0.5, 1.0, 0.0)
        off = lump * (centre - (1 - share / 2) * tube)
        moment = state.moment(row + 1, state.origin[end(row)])
        moment = moment + np.cross(rest, beyond) + np.cross(off, own)
        weight = beyond + lump * (1 - share) * own
        return Tube(tube / length, length, rest, weight, moment, share * own)

    def across(self, vectors: Array) -> Array:
        """Vectors (n, 3) without their part along the tube."""
        along = np.einsum("ni,ni->n", vectors, self.along)
        return np.asarray(vectors - along[:, None] * self.along)


def length_of(vectors: Array, state: State, row: int, label: str) -> Array:
    """Lengths (n, 1) [m] of vectors along body ``row``.

    Raises:
        AacmmError: too short for a tube.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (length < SHORTEST_TUBE).any():
        raise AacmmError(
            f"{label}: body {row} of {state.arm.name} is {length.min() / MM:.3g} mm long; expected "
            f"a tube of at least {SHORTEST_TUBE / MM:g} mm"
        )
    return np.asarray(length)
