"""What bends under weight: joints, bearings, tubes, and the spring that should carry it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm import Arm, axis, end
from aacmm_pin.effects.conditions import Records
from aacmm_pin.effects.effect import Displacement, Effect, Term, about_axis, is_possible, twist
from aacmm_pin.effects.gravity import GravityEffect, LoadedEffect, bodies_beyond
from aacmm_pin.effects.state import State
from aacmm_pin.effects.tube import Tube, length_of
from aacmm_pin.errors import AacmmError, UnsupportedArmError

VERTICAL = 0.01
"""An axis within this angle of the vertical has no moment of a weight about it [rad]."""


@dataclass(frozen=True)
class JointCompliance(GravityEffect):
    """The joint deflects about its own axis: ``δθ = c τ``, with the moment τ of the weight about
    the axis.

    This cause applies to a joint that a spring, brake or drive holds (joint 2 of a measuring arm,
    every joint of a robot). A free joint carries no moment about its axis; see ``bearing_tilt``.
    With ``torque=measured``, τ is minus the measured torque of the drive. The unit is rad/(N·m);
    the typical magnitude is 1e-5 to 3e-5. Source: robot calibration with joint stiffness (Whitney,
    Lozinski, Rourke 1986). For measured torques, this cause needs ``torqueN_nm``. Aliases:
    ``encoder_eccentricity`` and ``counterbalance`` of the same joint, if the load rotates with the
    joint; ``base_compliance``; ``torsional_windup``.
    """

    joint: int
    torque: Literal["gravity", "measured"] = "gravity"
    cause: ClassVar[str] = "joint_compliance"
    function_of: ClassVar[str] = "load"
    words: ClassVar[str] = "compliance under gravity"
    flexibility: ClassVar[Term] = Term(
        "", "rad/(N·m)", 2e-5, "compliance_rad_per_nm", positive=True
    )

    def __post_init__(self) -> None:
        """Check the origin of the torque."""
        super().__post_init__()
        if self.torque not in ("gravity", "measured"):
            raise AacmmError(
                f"{self.label}: torque is {self.torque!r}; expected 'gravity' or 'measured'"
            )
        if self.torque == "measured" and (self.bodies or self.load_at is not None):
            raise AacmmError(
                f"{self.label}: torque=measured cannot be combined with bodies or load_at"
            )

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Return a candidate for every revolute joint: with measured torques, and with known or
        unknown weights.

        A first joint with a vertical axis has no variant with weights. Measured torques have noise:
        with measured torques alone this cause would fit worse than causes that use the weights.
        """
        chain = arm.chain
        rows = chain.joint_rows()
        measured = records is not None and records.conditions.torque is not None
        for number, row in enumerate(rows):
            slides = chain.slides[number:]
            follows = row not in chain.moving_rows()
            if follows or slides[0] or (arm.masses is None and slides.any()):
                # no angle that a torque could turn alone; and unknown masses beyond a slide have no
                # constant lever
                continue
            tried = [cls(row, torque="measured")] if measured else []
            moment = number > 0 or not _first_axis_is_vertical(arm)
            if moment and arm.masses is not None:
                tried.append(cls(row))
            elif moment and records is not None:
                bodies = bodies_beyond(arm, row)
                counts = range(1, len(bodies) + 1)
                tried += [cls(row, bodies=bodies[:count]) for count in counts]
            if tried:
                yield tuple(tried)

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """Return ``torque="measured"`` if the records have torques."""
        return {"torque": "measured"} if "torque" in present else {}

    @property
    def needs(self) -> tuple[str, ...]:
        """The condition ``torque`` if the cause uses measured torques."""
        return ("torque",) if self.torque == "measured" else ()

    def displacements(self, state: State) -> list[Displacement]:
        """Return the rotation about the axis, proportional to the moment.

        Raises:
            UnsupportedArmError: the joint is prismatic; see also :meth:`GravityEffect.moments`.
        """
        number = state.joint(self.joint)
        if state.arm.chain.prismatic[number]:
            raise UnsupportedArmError(
                f"{self.label}: joint {self.joint} of {state.arm.name} is prismatic; expected a "
                "revolute joint"
            )
        if self.torque == "measured":
            torques = state.conditions.require("torque", self.label)
            return [about_axis(state, self.joint, -torques[:, number, None])]
        return [
            about_axis(
                state, self.joint, state.along_axis(self.joint, self.moments(state, self.joint))
            )
        ]


def _first_axis_is_vertical(arm: Arm) -> bool:
    rotation, _ = arm.chain.walk(np.zeros((1, arm.nq)))
    place = arm.chain.moving_axes()[0]
    sine = np.linalg.norm(np.cross(rotation[place, 0, :, 2], arm.up))
    return float(sine) < VERTICAL


@dataclass(frozen=True)
class BearingTilt(GravityEffect):
    """The bearing deflects across its axis: ``δφ = C (I - z zᵀ) m``, with the moment m of the
    weight.

    The bearing of a free joint carries all moments except the moment about the axis z. The unit is
    rad/(N·m); the typical magnitude is 2e-6 to 2e-5. Source: angular stiffness of a bearing pair.
    Aliases: ``link_bending`` of the tube after the joint; ``base_compliance``, if the joint is
    joint 1.
    """

    joint: int
    cause: ClassVar[str] = "bearing_tilt"
    function_of: ClassVar[str] = "load"
    words: ClassVar[str] = "bearing tilt under gravity"
    prior_weight: ClassVar[float] = 0.2
    flexibility: ClassVar[Term] = Term(
        "", "rad/(N·m)", 1e-5, "compliance_rad_per_nm", positive=True
    )

    def displacements(self, state: State) -> list[Displacement]:
        """Return the rotation that is proportional to the moment across the axis."""
        state.joint(self.joint)  # a rigid row has no bearing
        place = state.bearing(self.joint)
        local = state.rotation[place].transpose(0, 2, 1) @ self.moments(state, self.joint)
        local[:, 2] = 0.0
        return [Displacement(place, twist(angular=local))]


@dataclass(frozen=True)
class _OfTube(LoadedEffect):
    """A tube that deflects under its load, so that the end of its body moves and rotates."""

    link: int

    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        """Shift and turn of the end of the tube per unit of the parameter, in the base (n, 3)
        [m/unit, rad/unit].
        """
        raise NotImplementedError

    def displacements(self, state: State) -> list[Displacement]:
        """Return the displacement of the end of the body; the body is rigid after the tube."""
        tube = Tube.of(state, self.link, self.label)
        place = end(self.link)
        if self.load_at is not None:
            moment = self.unit_load(state, self.link, state.origin[place] - tube.rest)
            weight = np.broadcast_to(state.down, moment.shape)
            tube = replace(tube, weight=weight, moment=moment, own=0.0 * moment)
        shift, rotation = self._deflection(tube)
        shift = shift + np.cross(rotation, tube.rest)
        linear = state.in_axes_of(place, shift)[:, :, None]
        angular = state.in_axes_of(place, rotation)[:, :, None]
        return [Displacement(place, twist(linear, angular))]


@dataclass(frozen=True)
class TorsionalWindup(_OfTube):
    """A tube twists about its own axis u: ``δφ = c (u · m) u``.

    m is the moment of all bodies after the tube about its end. The unit is rad/(N·m); the typical
    magnitude is 2e-6 to 2e-5 (length over torsional rigidity G J). Source: Saint-Venant torsion.
    This cause needs masses in the arm file. Aliases: ``joint_compliance`` of a joint whose axis is
    along the tube, such as joints 3 and 5 of SINO6.
    """

    cause: ClassVar[str] = "torsional_windup"
    function_of: ClassVar[str] = "load"
    words: ClassVar[str] = "torsional wind-up"
    prior_weight: ClassVar[float] = 0.2
    flexibility: ClassVar[Term] = Term(
        "", "rad/(N·m)", 1e-5, "compliance_rad_per_nm", positive=True
    )

    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        turn = np.einsum("ni,ni->n", tube.along, tube.moment)[:, None] * tube.along
        return np.zeros_like(turn), turn


@dataclass(frozen=True)
class LinkBending(_OfTube):
    """A tube bends under its own weight and the weight of all later bodies: slope and sag of the
    end.

    The tube is an Euler–Bernoulli cantilever of length L along u. W and M are the weight and the
    moment of all later bodies at the end of the tube. The vector w is the evenly distributed weight
    of the tube, and κ = 1/EI. The slope is ``κ (L²/2 u×W + L²/6 u×w + L M)``. The sag is ``κ (L³/3
    W + L³/8 w + L²/2 M×u)``. Both omit the part along u. The unit is rad/(N·m²) = (rad/m)/(N·m);
    the typical magnitude is 3e-5 to 8e-5 (aluminium or carbon tube of 50 to 60 mm). Source: beam
    theory (Timoshenko). This cause needs masses in the arm file. Aliases: ``bearing_tilt`` and
    ``joint_compliance`` of the joint before the tube.
    """

    cause: ClassVar[str] = "link_bending"
    function_of: ClassVar[str] = "load"
    words: ClassVar[str] = "bending"
    flexibility: ClassVar[Term] = Term(
        "", "rad/(N·m²)", 5e-5, "flexibility_rad_per_nm2", positive=True
    )
    of_load: ClassVar[Term] = Term("", "rad/m²", 2e-4, "load_rad_per_m2")

    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        u = tube.along
        length = tube.length
        by_weight = np.cross(u, tube.weight / 2 + tube.own / 6)
        slope = length**2 * by_weight + length * tube.moment
        by_moment = np.cross(tube.moment, u)
        sag = length**3 * (tube.weight / 3 + tube.own / 8) + length**2 / 2 * by_moment
        return tube.across(sag), tube.across(slope)


@dataclass(frozen=True)
class Counterbalance(Effect):
    """The spring of a joint balances the weight incompletely: ``δθ = κ z · (u × down)``.

    The vector u is the direction of the body. If the next joint axis is across the axis z of the
    joint, u is the direction of the next axis (upper tube of SINO6 after joint 2). The lever arm of
    a weight on the body is proportional to the horizontal part of u in all postures. A positive κ
    lowers u. The spring then carries too little if u points outwards. If u points back to the
    shoulder, as on SINO6 (d3 < 0), the spring carries too much. The unit is rad (rotation of the
    level body); the typical magnitude is 2e-5 to 2e-4. Source: moment of a constant-force
    counterbalance. Aliases: ``encoder_eccentricity`` of the same joint, if the eccentricity has the
    phase of gravity; ``joint_compliance`` of the same joint, if the load hardly changes.
    """

    joint: int
    cause: ClassVar[str] = "counterbalance"
    function_of: ClassVar[str] = "load"
    words: ClassVar[str] = "counterbalance error"
    prior_weight: ClassVar[float] = 0.2
    elastic: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = (Term("", "rad", 1e-4, "level_turn_rad"),)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Return a candidate for the second joint, which lifts the arm."""
        for row in arm.chain.moving_rows()[1:2]:
            effect = cls(row)
            if is_possible(effect, arm, records):
                yield (effect,)

    def displacements(self, state: State) -> list[Displacement]:
        """Return the rotation that is proportional to the horizontal part of the body across the
        axis.
        """
        row = state.known_row(self.joint)
        horizontal = np.cross(self._carried(state), state.down)
        lever = state.along_axis(row, horizontal)
        return [about_axis(state, self.joint, lever[:, None])]

    def _carried(self, state: State) -> Array:
        if self.joint < state.arm.chain.rows:
            # The next axis as body ``joint`` carries it: before the next joint turns.
            constant = state.arm.chain.constant
            following = constant[axis(self.joint + 1)][:3, 2]
            if abs(constant[end(self.joint)][2, :3] @ following) < 0.5:
                return np.asarray(state.rotation[end(self.joint)] @ following)
        span = state.span(self.joint)
        return np.asarray(span / length_of(span, state, self.joint, self.label))
