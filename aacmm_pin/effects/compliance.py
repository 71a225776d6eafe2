"""Elastic causes: joints, bearings, tubes, the stand, and the counterbalance under weight."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, Arm, axis, end
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.effect import (
    Displacement,
    Effect,
    Term,
    about_axis,
    tubes,
    twist,
)
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, UnsupportedArmError

VERTICAL = 0.01
"""Weights have no moment about an axis within this angle of the vertical [rad]."""
SHORTEST_TUBE = 1e-3
"""A shorter body is no tube [m]."""
TYPICAL_SAG = 5e-4
"""Typical rotation under an unknown moment [rad]: measuring arms 1e-4, robots up to 5e-3."""
TYPICAL_LOAD = 1e-4
"""Typical rotation under a load with a lever of one metre [rad/m]."""


@dataclass(frozen=True, kw_only=True)
class LoadedEffect(Effect):
    """An elastic cause with one compliance.

    A load that the arm file does not state may act at the end of a body, beside the known masses.
    The parameter is then compliance times weight.

    Attributes:
        load_at: row of the body at whose end the load acts; None for the masses of the arm.
    """

    load_at: int | None = None
    flexibility: ClassVar[Term]
    """The parameter if the masses are known."""
    of_load = Term("", "rad/m", TYPICAL_LOAD, "load_rad_per_m")
    """The parameter for an unknown load."""
    elastic = True
    function_of = "load"

    @property
    def terms(self) -> tuple[Term, ...]:
        """The compliance, or the compliance times a load."""
        return (self.flexibility if self.load_at is None else self.of_load,)

    @property
    def key(self) -> str:
        """The label with the place of the load."""
        if self.load_at is None:
            return super().key
        return f"{self.label},load_at={self.load_at}"

    @property
    def details(self) -> list[str]:
        """The place of the load as text."""
        return [] if self.load_at is None else [f"load at end of body {self.load_at}"]

    def moment_of_unit_load(self, state: State, row: int, points: Array) -> Array:
        """The moment of a unit load beyond body ``row`` about ``points`` ``(n, 3)`` [m], in the
        base ``(n, 3)``.

        Raises:
            AacmmError: the load is at a body before ``row``.
        """
        loaded_row = state.known_row(self.load_at or 0)
        if loaded_row < row:
            raise AacmmError(
                f"{self.label}: load_at is {loaded_row}; expected {row} or a later row"
            )
        return np.cross(state.origin[end(loaded_row)] - points, state.down)


@dataclass(frozen=True, kw_only=True)
class GravityEffect(LoadedEffect):
    """A cause that is proportional to a static moment.

    If the arm has masses, the only parameter is a compliance. If not, ``bodies`` names the rows
    whose weight acts. The parameters are then ``compliance × first moment × |g|``: three numbers
    for each body, in its own axes. Weights farther out act at the ends of the bodies, so that
    records determine some parameters only in combination.

    Attributes:
        bodies: rows of the bodies with unknown masses, from the row of the axis on; () for the
            masses of the arm. The last body includes all that it carries.
    """

    bodies: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        super().__post_init__()
        stated = [bool(self.bodies), self.load_at is not None, "torque" in self.needs]
        if sum(stated) > 1:
            raise AacmmError(
                f"{self.label}: expected only one of bodies, load_at and torque=measured"
            )

    @property
    def terms(self) -> tuple[Term, ...]:
        """The compliance, one for a load, or three numbers for each body of unknown mass."""
        if not self.bodies:
            return super().terms
        names = [f"{body}{component}" for body in self.bodies for component in "xyz"]
        return tuple(Term(name, "rad", TYPICAL_SAG, f"sag{name}_rad") for name in names)

    def basis(self, arm: Arm, records: Records) -> Effect | None:
        """The effect with all bodies of unknown mass; None with the masses of the arm."""
        if not self.bodies:
            return None
        return replace(self, bodies=bodies_beyond(arm, self.bodies[0]), values=(), u=())

    def moments(self, state: State, row: int) -> Array:
        """The moment about the bearing of ``row`` per unit of each parameter, in the base ``(n, 3,
        p)``.

        Raises:
            UnsupportedArmError: the arm has no masses and ``bodies`` is empty.
            AacmmError: ``bodies`` are not the first from this axis on, or the load is before the
                axis.
        """
        if self.load_at is not None:
            bearing = state.origin[state.bearing(row)]
            return self.moment_of_unit_load(state, row, bearing)[:, :, None]
        if not self.bodies:
            return state.moment_at_axis(row)[:, :, None]
        possible = bodies_beyond(state.arm, row)
        count = len(self.bodies)
        if self.bodies != possible[:count]:
            raise AacmmError(
                f"{self.label}: bodies is {self.bodies}; expected {possible}, which are the bodies "
                f"at and beyond row {row}, or the first of them"
            )
        return state.unit_moments(row)[:, :, : 3 * count]


def compliance(typical: float) -> Term:
    """A parameter: rotation per moment of a weight."""
    return Term("", "rad/(N·m)", typical, "compliance_rad_per_nm", positive=True)


def bodies_beyond(arm: Arm, row: int) -> tuple[int, ...]:
    """The rows of the bodies at and beyond an axis."""
    return tuple(k for k in arm.chain.joint_rows() if k >= row)


def load_variants(effect: Effect, arm: Arm) -> tuple[Effect, ...]:
    """The variants of an effect with an unknown load at the tip, or at the end of a tube that the
    cause carries; none for a cause without weights, or with weights of its own.
    """
    has_weights = getattr(effect, "bodies", ()) or "torque" in effect.needs
    if not isinstance(effect, LoadedEffect) or has_weights:
        return ()
    ends = dict.fromkeys((*tubes(arm), arm.chain.rows))
    carried = [row for row in ends if row >= (effect.row or 0)]
    return tuple(replace(effect, load_at=row, values=(), u=()) for row in carried)


@dataclass(frozen=True, eq=False)
class Tube:
    """A tube along the longer side of a body: along the axis of its row or across it. The rest is
    rigid.

    Attributes:
        along: unit vector from its clamp to its end (n, 3).
        length: (n, 1) [m].
        stub: from its end to the end of the body (n, 3) [m].
        weight: at its end, with a lump of the body itself (n, 3) [N].
        moment: of this weight about its end (n, 3) [N·m].
        spread: weight spread evenly over its length (n, 3) [N].
    """

    along: Array
    length: Array
    stub: Array
    weight: Array
    moment: Array
    spread: Array

    @staticmethod
    def of(state: State, row: int, label: str) -> Tube:
        """The tube of body ``row``.

        As much weight is spread over the tube as the centre of mass allows. The rest is at its end,
        or at its clamp if the centre of mass is in the nearer half.

        Raises:
            AacmmError: the body is too short.
            UnsupportedArmError: the arm states no masses.
        """
        place = axis(row)
        body = row - 1
        span = state.span(row)
        z = state.rotation[place][:, :, 2]
        along_axis = np.einsum("ni,ni->n", span, z)[:, None] * z
        across_axis = span - along_axis
        # The clamp is seen from the bearing, the centre of mass from the clamp.
        if np.linalg.norm(along_axis) >= np.linalg.norm(across_axis):
            clamp = np.zeros_like(along_axis)
            tube = along_axis
        else:
            clamp = along_axis
            tube = across_axis
        length = length_of(tube, state, row, label)
        stub = span - clamp - tube
        from_bearing = state.origin[place] - state.origin[state.bearing(row)]
        from_axis = state.rotation[place] @ state.arm.centres_of_mass[body]
        centre = from_bearing + from_axis - clamp
        fraction = np.einsum("ni,ni->n", centre, tube)[:, None] / length**2
        share = np.clip(2 * np.minimum(fraction, 1 - fraction), 0.0, 1.0)
        body_weight = state.masses[body] * state.gravity
        weight_beyond = state.weight_beyond(row)
        # The first moment of the lump about the end is the body's less that of the tube, whose
        # middle is half a length back.
        lump = np.where(fraction > 0.5, 1.0, 0.0)
        lever = lump * (centre - (1 - share / 2) * tube)
        moment = state.moment(row + 1, state.origin[end(row)])
        moment = moment + np.cross(stub, weight_beyond) + np.cross(lever, body_weight)
        weight = weight_beyond + lump * (1 - share) * body_weight
        return Tube(tube / length, length, stub, weight, moment, share * body_weight)

    def across(self, vectors: Array) -> Array:
        """Components of vectors (n, 3) across the tube."""
        along = np.einsum("ni,ni->n", vectors, self.along)
        return np.asarray(vectors - along[:, None] * self.along)


def length_of(vectors: Array, state: State, row: int, label: str) -> Array:
    """Lengths (n, 1) [m] of vectors along body ``row``.

    Raises:
        AacmmError: the body is too short for a tube.
    """
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (length < SHORTEST_TUBE).any():
        raise AacmmError(
            f"{label}: body {row} of {state.arm.name} is {length.min() / MM:.3g} mm long; expected "
            f"a tube of at least {SHORTEST_TUBE / MM:g} mm"
        )
    return np.asarray(length)


@dataclass(frozen=True)
class JointCompliance(GravityEffect):
    """The joint deflects about its own axis: ``δθ = c τ``, with the moment τ of the weight.

    This applies to a joint that a spring, brake or drive holds: joint 2 of a measuring arm, every
    joint of a robot. A free joint carries no moment about its axis; see ``bearing_tilt``. With
    ``torque=measured``, τ is minus the measured torque of the drive, and ``torqueN_nm`` is needed.
    Typical magnitude: 1e-5 to 3e-5 rad/(N·m). Source: robot calibration with joint stiffness
    (Whitney, Lozinski, Rourke 1986). Aliases: ``encoder_eccentricity`` and ``counterbalance`` of
    the same joint, if the load rotates with the joint; ``base_compliance``; ``torsional_windup``.
    """

    joint: int
    torque: Literal["gravity", "measured"] = "gravity"
    cause = "joint_compliance"
    words = "compliance under gravity"
    flexibility = compliance(2e-5)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.torque not in ("gravity", "measured"):
            raise AacmmError(
                f"{self.label}: torque is {self.torque!r}; expected 'gravity' or 'measured'"
            )

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for every revolute joint: with measured torques, with known or unknown
        weights.

        A first joint with a vertical axis has no variant with weights. Measured torques alone have
        noise, and would fit worse than causes that use the weights.
        """
        chain = arm.chain
        rows = chain.joint_rows()
        has_torques = records is not None and records.conditions.torque is not None
        for number, row in enumerate(rows):
            slides = chain.slides[number:]
            rotates_alone = row in chain.moving_rows() and not slides[0]
            # Unknown masses beyond a slide have no constant lever.
            has_lever = arm.masses is not None or not slides.any()
            if not (rotates_alone and has_lever):
                continue
            variants = [cls(row, torque="measured")] if has_torques else []
            has_moment = number > 0 or not _first_axis_is_vertical(arm, records)
            if has_moment and arm.masses is not None:
                variants.append(cls(row))
            elif has_moment and records is not None:
                bodies = bodies_beyond(arm, row)
                counts = range(1, len(bodies) + 1)
                variants += [cls(row, bodies=bodies[:count]) for count in counts]
            if variants:
                yield tuple(variants)

    @classmethod
    def default_fields(
        cls, stated: Mapping[str, Any], arm: Arm, present: tuple[str, ...]
    ) -> dict[str, Any]:
        """``torque="measured"`` if the records have torques."""
        return {"torque": "measured"} if "torque" in present else {}

    @property
    def needs(self) -> tuple[str, ...]:
        """The condition ``torque`` if the cause uses measured torques."""
        return ("torque",) if self.torque == "measured" else ()

    def displacements(self, state: State) -> list[Displacement]:
        """The rotation about the axis, proportional to the moment.

        Raises:
            UnsupportedArmError: the joint is prismatic; see also :meth:`GravityEffect.moments`.
        """
        number = state.joint(self.joint)
        if state.slides(self.joint):
            raise UnsupportedArmError(
                f"{self.label}: joint {self.joint} of {state.arm.name} is prismatic; expected a "
                "revolute joint"
            )
        if self.torque == "measured":
            torques = state.conditions.require("torque", self.label)
            return [about_axis(state, self.joint, -torques[:, number, None])]
        moments = state.along_axis(self.joint, self.moments(state, self.joint))
        return [about_axis(state, self.joint, moments)]


def _first_axis_is_vertical(arm: Arm, records: Records | None) -> bool:
    rotation, _ = arm.chain.at_zero
    z = rotation[arm.chain.moving_axes()[0], :, 2]
    conditions = Conditions(1) if records is None else records.conditions
    across = np.cross(z, conditions.in_tilted_base(arm.up))
    return bool((np.linalg.norm(across, axis=1) < VERTICAL).all())


@dataclass(frozen=True)
class BearingTilt(GravityEffect):
    """The bearing deflects across its axis z: ``δφ = C (I - z zᵀ) m``, with the moment m of the
    weight.

    The bearing of a free joint carries all moments except that about z. Typical magnitude: 2e-6 to
    2e-5 rad/(N·m). Source: angular stiffness of a bearing pair. Aliases: ``link_bending`` of the
    tube after the joint; ``base_compliance`` for joint 1.
    """

    joint: int
    cause = "bearing_tilt"
    words = "bearing tilt under gravity"
    prior_weight = 0.2
    flexibility = compliance(1e-5)

    def displacements(self, state: State) -> list[Displacement]:
        """The rotation that is proportional to the moment across the axis."""
        state.joint(self.joint)  # a rigid row has no bearing
        place = state.bearing(self.joint)
        local = state.rotation[place].transpose(0, 2, 1) @ self.moments(state, self.joint)
        local[:, 2] = 0.0
        return [Displacement(place, twist(angular=local))]


@dataclass(frozen=True)
class _OfTube(LoadedEffect):
    """A tube that deflects under its load: the end of its body moves and rotates."""

    link: int

    @abstractmethod
    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        """Translation and rotation of the end of the tube (n, 3) per unit of the parameter, in the
        base.
        """

    def displacements(self, state: State) -> list[Displacement]:
        tube = Tube.of(state, self.link, self.label)
        place = end(self.link)
        if self.load_at is not None:
            moment = self.moment_of_unit_load(state, self.link, state.origin[place] - tube.stub)
            tube = replace(tube, weight=state.down, moment=moment, spread=0.0 * moment)
        shift, rotation = self._deflection(tube)
        shift = shift + np.cross(rotation, tube.stub)
        linear = state.in_axes_of(place, shift)[:, :, None]
        angular = state.in_axes_of(place, rotation)[:, :, None]
        return [Displacement(place, twist(linear, angular))]


@dataclass(frozen=True)
class TorsionalWindup(_OfTube):
    """A tube twists about its own axis u: ``δφ = c (u · m) u``.

    m is the moment of all bodies after the tube about its end. Typical magnitude: 2e-6 to 2e-5
    rad/(N·m) (length over torsional rigidity G J). Source: Saint-Venant torsion. Needs masses in
    the arm file. Aliases: ``joint_compliance`` of a joint whose axis is along the tube, such as
    joints 3 and 5 of SINO6.
    """

    cause = "torsional_windup"
    words = "torsional wind-up"
    prior_weight = 0.7
    flexibility = compliance(1e-5)

    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        rotation = np.einsum("ni,ni->n", tube.along, tube.moment)[:, None] * tube.along
        return np.zeros_like(rotation), rotation


@dataclass(frozen=True)
class LinkBending(_OfTube):
    """A tube bends under its own weight and that of all later bodies: slope and sag of its end.

    The tube is an Euler–Bernoulli cantilever of length L along u. W and M are the weight and the
    moment of all later bodies at its end, w is its own evenly distributed weight, and κ = 1/EI. The
    slope is ``κ (L²/2 u×W + L²/6 u×w + L M)``, the sag ``κ (L³/3 W + L³/8 w + L²/2 M×u)``; both
    omit the part along u. Typical magnitude: 3e-5 to 8e-5 rad/(N·m²) (aluminium or carbon tube of
    50 to 60 mm). Source: beam theory (Timoshenko). Needs masses in the arm file. Aliases:
    ``bearing_tilt`` and ``joint_compliance`` of the joint before the tube.
    """

    cause = "link_bending"
    words = "bending"
    flexibility = Term("", "rad/(N·m²)", 5e-5, "flexibility_rad_per_nm2", positive=True)
    of_load = Term("", "rad/m²", 2e-4, "load_rad_per_m2")

    def _deflection(self, tube: Tube) -> tuple[Array, Array]:
        u = tube.along
        length = tube.length
        by_weight = np.cross(u, tube.weight / 2 + tube.spread / 6)
        slope = length**2 * by_weight + length * tube.moment
        by_moment = np.cross(tube.moment, u)
        sag = length**3 * (tube.weight / 3 + tube.spread / 8) + length**2 / 2 * by_moment
        return tube.across(sag), tube.across(slope)


@dataclass(frozen=True)
class Counterbalance(Effect):
    """The spring of a joint balances the weight incompletely: ``δθ = κ z · (u × down)``.

    The vector u is the direction of the body, or of the next joint axis if that is across the axis
    z (upper tube of SINO6 after joint 2). The lever arm of a weight on the body is proportional to
    the horizontal part of u. A positive κ lowers u: the spring carries too little if u points
    outwards, and too much if u points back to the shoulder, as on SINO6 (d3 < 0). Typical
    magnitude: 2e-5 to 2e-4 rad (rotation of the level body). Source: moment of a constant-force
    counterbalance. Aliases: ``encoder_eccentricity`` of the same joint, if the eccentricity has the
    phase of gravity; ``joint_compliance`` of the same joint, if the load hardly changes.
    """

    joint: int
    cause = "counterbalance"
    function_of = "load"
    words = "counterbalance error"
    prior_weight = 0.2
    elastic = True
    terms = (Term("", "rad", 1e-4, "level_turn_rad"),)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for the second joint, which lifts the arm."""
        for variants in super().candidates(arm, records):
            if variants[0].joint in arm.chain.moving_rows()[1:2]:
                yield variants

    def displacements(self, state: State) -> list[Displacement]:
        """The rotation, proportional to the horizontal part of the body across the axis."""
        row = state.known_row(self.joint)
        chain = state.arm.chain
        # The next axis is constant in the body: the next joint rotates about it.
        next_axis = chain.constant[axis(row + 1)][:3, 2] if row < chain.rows else None
        if next_axis is not None and abs(chain.constant[end(row)][2, :3] @ next_axis) < 0.5:
            direction = state.rotation[end(row)] @ next_axis
        else:
            span = state.span(row)
            direction = span / length_of(span, state, row, self.label)
        lever = state.along_axis(row, np.cross(direction, state.down))
        return [about_axis(state, row, lever[:, None])]


@dataclass(frozen=True)
class BaseCompliance(GravityEffect):
    """The stand tilts under the moment m of the whole arm about the base origin: ``δφ = c m``.

    Typical magnitude: 5e-6 to 2e-5 rad/(N·m) (magnetic base, tripod). Source: rotational stiffness
    of the mount. Aliases: ``bearing_tilt:1``, ``joint_compliance:2``, ``encoder_eccentricity:2``.
    """

    cause = "base_compliance"
    function_of = ""
    words = "tilting stand (base compliance)"
    flexibility = compliance(1e-5)

    def displacements(self, state: State) -> list[Displacement]:
        """The rotation of the base, proportional to the moment about its origin."""
        if self.bodies or self.load_at is not None:
            moments = self.moments(state, 1)
        else:
            moments = state.moment(1, np.zeros((state.n, 3)))[:, :, None]
        return [Displacement(BASE, twist(angular=moments))]
