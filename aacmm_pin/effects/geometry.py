"""Errors of the geometry: one number of a DH row, or the placement of a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, Parameter, axis, end
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis, rotations, shifts
from aacmm_pin.effects.state import State
from aacmm_pin.errors import UnsupportedArmError


@dataclass(frozen=True)
class _RowValue(Effect):
    """One value of a DH row; the displacement is exact, for two screws about one axis commute."""

    joint: int
    refitted = True
    along_slide = False
    component: ClassVar[int]
    """What the parameter changes: translation along x (0) or z (2), rotation about x, y or z (3, 4,
    5).
    """

    def displacements(self, state: State) -> list[Displacement]:
        """Of the axis for d and θ; for a and α of the end of the body in standard DH, of the body
        before in modified.
        """
        row = state.known_row(self.joint)
        place = axis(row)
        if self.component not in (2, 5):
            is_standard = state.arm.require_dh(self.cause).standard
            place = end(row if is_standard else row - 1)
        columns = np.zeros((1, 6, 1))
        columns[:, self.component] = 1.0
        return [Displacement(place, columns)]


@dataclass(frozen=True)
class JointZeroOffset(_RowValue):
    """The zero of the encoder has an error ``δ``: the body rotates about the joint axis, or moves
    along it.

    Typical magnitude: 1e-4 rad after a factory calibration, up to 0.05 (3°) after assembly. Source:
    any DH calibration; the 2010 zero-offset paper. Aliases: ``seat_error``, if the records have few
    seats; for joint 1, a rotation of the reference frame, which has the same effect.
    """

    cause = "joint_zero_offset"
    words = "zero offset"
    along_slide = True
    component = 5
    terms = (Term("", "rad", 3e-4, "offset_rad"),)

    def displacements(self, state: State) -> list[Displacement]:
        """A unit motion of the joint; a row without joint rotates."""
        place = axis(state.known_row(self.joint))
        if state.arm.chain.moved[place] < 0:
            return super().displacements(state)
        return [about_axis(state, self.joint, np.ones((1, 1)))]


@dataclass(frozen=True)
class LinkLength(_RowValue):
    """The length a of a row has an error: the rest of the arm moves along x of the row.

    Typical magnitude: 2e-5 m. Source: Denavit–Hartenberg. Aliases: ``thermal_expansion``;
    ``stylus_offset``, if the row is the last row.
    """

    cause = "link_length"
    words = "length a"
    prior_weight = 0.2
    component = 0
    terms = (Term("", "m", 5e-5, "a_mm", MM),)


@dataclass(frozen=True)
class JointDistance(_RowValue):
    """The distance d of a row has an error: the rest of the arm moves along the joint axis.

    Typical magnitude: 2e-5 m. Source: Denavit–Hartenberg. Aliases: ``joint_distance`` of a
    neighbouring row with a parallel axis; ``thermal_expansion``; for row 1, the height of the
    reference frame.
    """

    cause = "joint_distance"
    words = "distance d"
    prior_weight = 0.2
    component = 2
    terms = (Term("", "m", 5e-5, "d_mm", MM),)


@dataclass(frozen=True)
class LinkTwist(_RowValue):
    """The twist alpha of a row has an error: the rest of the arm rotates about x of the row.

    Typical magnitude: 5e-5 rad. Source: Denavit–Hartenberg. Aliases: ``bearing_tilt``, if the load
    hardly changes.
    """

    cause = "link_twist"
    words = "twist α"
    prior_weight = 0.2
    component = 3
    terms = (Term("", "rad", 1e-4, "alpha_rad"),)


@dataclass(frozen=True)
class SlideAngle(_RowValue):
    """The angle theta of a prismatic row has an error: the rest of the arm rotates about its axis.

    The zero of such a joint is in the distance d. Typical magnitude: 5e-5 rad. Source:
    Denavit–Hartenberg. Aliases: ``joint_zero_offset`` of a neighbouring row with a parallel axis.
    """

    cause = "slide_angle"
    words = "angle θ"
    prior_weight = 0.2
    component = 5
    terms = (Term("", "rad", 1e-4, "theta_rad"),)


@dataclass(frozen=True)
class LinkTilt(_RowValue):
    """The next axis is tilted about y of the row, which DH cannot state for nearly parallel axes.

    Typical magnitude: 5e-5 rad. Source: Hayati, Mirmirani 1985 (angle β). Aliases:
    ``joint_distance`` of the same row and of the next row, if the axes are far from parallel.
    """

    cause = "link_tilt"
    words = "tilt β"
    component = 4
    terms = (Term("", "rad", 1e-4, "beta_rad"),)


@dataclass(frozen=True)
class JointPlacement(Effect):
    """The placement of a joint has an error: three translations, three rotations in its own axes.

    For arms from a URDF, which have placements instead of DH rows. Records determine some of them
    only in combination. Typical magnitude: 5e-5 m and 1e-4 rad. Aliases: ``joint_placement`` of a
    neighbouring joint.
    """

    joint: int
    cause = "joint_placement"
    words = "placement"
    refitted = True
    terms = (*shifts(5e-5), *rotations(1e-4))

    def displacements(self, state: State) -> list[Displacement]:
        """The unit twists after the placement and before the joint."""
        row = state.known_row(self.joint)
        return [Displacement(end(row - 1), np.eye(6)[None])]


def of_geometry(arm: Arm) -> list[Effect]:
    """The causes for all geometric parameters, in the order of :meth:`Arm.sensitivity`."""
    if arm.dh is None:
        return [JointPlacement(joint=row) for row in range(1, arm.chain.rows + 1)]
    return [of_parameter(arm, parameter) for parameter in arm.parameters]


def of_parameter(arm: Arm, parameter: Parameter) -> Effect:
    """The cause that changes one value of a DH table."""
    row = parameter.joint
    if row is None or arm.dh is None:
        raise UnsupportedArmError(
            f"{arm.name}: {parameter.name} is in no DH table; expected a value of one"
        )
    match parameter.kind:
        case "a":
            return LinkLength(row)
        case "d":
            return JointDistance(row)
        case "alpha":
            return LinkTwist(row)
    return SlideAngle(row) if arm.dh.slides[row - 1] else JointZeroOffset(row)


def joint_zeros(arm: Arm) -> list[Effect]:
    """The causes for the zeros of all joints; of a prismatic joint in a DH table d."""
    zeros: list[Effect] = []
    for row in arm.chain.joint_rows():
        in_distance = arm.dh is not None and arm.dh.slides[row - 1]
        zeros.append(JointDistance(row) if in_distance else JointZeroOffset(row))
    return zeros
