"""What is beside the links and encoders: stand, stylus, target, warmth, and the references."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, Arm, axis, end
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.effect import Displacement, Effect, Term, shifts, turns, twist
from aacmm_pin.effects.gravity import GravityEffect
from aacmm_pin.effects.nonlinear import Nonlinear
from aacmm_pin.effects.state import State
from aacmm_pin.effects.time_dependent import AT_ENDS, InGap, StepInTime, TimeOfStep
from aacmm_pin.errors import UnsupportedArmError

LEAST_SEATS = 3
"""With fewer seats nothing tells which of them is off."""
STEPS_OF_SETUP = 20
"""Times of a movement of the set-up that are tried; several parameters step there."""
STEPS_OF_SEAT = 8
"""The same of a seat, among the times at which it is touched."""
FARTHEST_TARGET = 10.0
"""A target on the last body is within so much of the tip [m]."""
ANOTHER_POINT = 5e-4
"""No ball is so far from where its qualification has it: it is another point [m]."""


@dataclass(frozen=True)
class BaseCompliance(GravityEffect):
    """The stand tilts under the moment of the whole arm: ``δφ = c m``, with the moment m of the
    weight about the base origin.

    The unit is rad/(N·m); the typical magnitude is 5e-6 to 2e-5 (magnetic base, tripod). Source:
    rotational stiffness of the mount. Aliases: ``bearing_tilt:1``, ``joint_compliance:2``,
    ``encoder_eccentricity:2``.
    """

    cause: ClassVar[str] = "base_compliance"
    words: ClassVar[str] = "tilting stand (base compliance)"
    flexibility: ClassVar[Term] = Term(
        "", "rad/(N·m)", 1e-5, "compliance_rad_per_nm", positive=True
    )

    def displacements(self, state: State) -> list[Displacement]:
        """Return the rotation of the base that is proportional to the moment about its origin."""
        if self.bodies or self.load_at is not None:
            moments = self.moments(state, 1)
        else:
            moments = state.moment(1, np.zeros((state.n, 3)))[:, :, None]
        return [Displacement(BASE, twist(angular=moments))]


@dataclass(frozen=True)
class SeatError(Effect):
    """The stated position of one seat has an error e: true position = stated position + e. The arm
    has no error.

    The unit is m; the typical magnitude is 1e-5 (worn, dirty or moved seat). Source: seats of
    single-point tests, ASME B89.4.22-2004. This cause needs ``seat``. Aliases: every smooth error
    of the arm, if you touch the seat in only one posture.
    """

    seat: str
    cause: ClassVar[str] = "seat_error"
    words: ClassVar[str] = "error of the stated coordinates"
    needs: ClassVar[tuple[str, ...]] = ("seat",)
    of_reference: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = shifts(2e-5)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Return a candidate for every seat, if other seats determine where the seat should be."""
        seats = list(super().candidates(arm, records))
        if records is not None and len(seats) >= LEAST_SEATS and records.known.any():
            yield from seats

    def displacements(self, state: State) -> list[Displacement]:
        """Return -e as a translation of the stated coordinates in the records of the seat."""
        touched = state.conditions.require("seat", self.label) == self.seat
        shift = -np.eye(3) * touched[:, None, None]
        return [Displacement(BASE, twist(shift))]


@dataclass(frozen=True)
class ReferenceFrame(Effect):
    """The frame of the references has a small translation and rotation relative to the base.

    The error is a twist (v, ω) at the base: ``p_reference = exp(v, ω) p_base``. With ``session``,
    only the records of this session have the error. The units are m and rad; the magnitude is any
    that remains after the fit of the two frames. Source: rigid registration. With a session, this
    cause needs ``session``. Aliases: ``joint_zero_offset:1`` and ``joint_distance:1``, which also
    displace the whole arm.
    """

    session: str | None = None
    cause: ClassVar[str] = "reference_frame"
    words: ClassVar[str] = "error of the reference frame"
    of_reference: ClassVar[bool] = True
    refitted: ClassVar[bool] = True
    prior_weight: ClassVar[float] = 0.2
    terms: ClassVar[tuple[Term, ...]] = (*shifts(1e-3), *turns(1e-3))

    @property
    def needs(self) -> tuple[str, ...]:
        """The condition ``session`` if the cause names a session."""
        return () if self.session is None else ("session",)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Return one candidate for all records."""
        yield (cls(),)

    def displacements(self, state: State) -> list[Displacement]:
        """Return the unit twists of the base."""
        columns = np.eye(6)[None]
        if self.session is not None:
            own = state.conditions.require("session", self.label) == self.session
            columns = columns * own[:, None, None]
        return [Displacement(BASE, columns)]


@dataclass(frozen=True)
class StylusOffset(Effect):
    """The ball or target is not at the tip, but has a constant translation in the axes of the last
    frame.

    With ``marker``, only this target has the translation. The unit is m; the typical magnitude is
    2e-5 for a qualified stylus, and 0.1 for a mounted target. Source: probe qualification, ISO
    10360-12:2016. With a marker, this cause needs ``marker``. Aliases: ``link_length``,
    ``joint_distance`` and ``joint_zero_offset`` of the last row.
    """

    marker: str | None = None
    cause: ClassVar[str] = "stylus_offset"
    refitted: ClassVar[bool] = True
    prior_weight: ClassVar[float] = 0.2
    terms: ClassVar[tuple[Term, ...]] = shifts(5e-5, FARTHEST_TARGET)

    @property
    def needs(self) -> tuple[str, ...]:
        """The condition ``marker`` if the cause names a marker."""
        return () if self.marker is None else ("marker",)

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """Return a note if the coordinates are of a target, and not of the tip in the geometry of
        the arm.
        """
        far = float(np.linalg.norm(self.values))
        if self.marker is not None or far < ANOTHER_POINT:
            return []
        return [Note("tip_is_target", {"cause": self.label, "distance": far})]

    def displacements(self, state: State) -> list[Displacement]:
        """Return the unit translations at the tip."""
        columns = twist(np.eye(3)[None])
        if self.marker is not None:
            columns = (
                columns
                * (state.conditions.require("marker", self.label) == self.marker)[:, None, None]
            )
        return [Displacement(state.arm.chain.tip, columns)]


@dataclass(frozen=True)
class FrameShift(StepInTime):
    """The stand of the arm or the references moved once: ``p_reference = exp(v, ω) p_base`` from
    ``time_s`` on. The arm has no error.

    The units are m and rad; the typical magnitude is 2e-4 (a stand that was bumped, a tripod that
    settled). Source: rigid registration. This cause needs ``time_s``. The movement is between the
    two times ``between_s``. Aliases: ``encoder_slip:1``, if the stand only rotated about joint 1.
    """

    time_s: float
    between_s: tuple[float, ...] = ()
    sessions: tuple[str, ...] = ()
    cause: ClassVar[str] = "frame_shift"
    words: ClassVar[str] = "movement of the stand or of the references"
    remedy: ClassVar[str] = (
        "label the records before and after the movement in the column session, and use "
        "--reference-frame session"
    )
    of_reference: ClassVar[bool] = True
    prior_weight: ClassVar[float] = 0.2
    nonlinear: ClassVar[Nonlinear[Any]] = TimeOfStep("time_s", tried=STEPS_OF_SETUP)
    terms: ClassVar[tuple[Term, ...]] = (*shifts(2e-4), *turns(2e-4))

    def displacements(self, state: State) -> list[Displacement]:
        """Return the unit twists of the base in the later records."""
        part = self.part(state.conditions)
        return [Displacement(BASE, np.eye(6) * part[:, None, None])]


@dataclass(frozen=True)
class StylusShift(StepInTime):
    """The stylus or target moved once on the last body, such as a probe that was mounted again: a
    translation in the axes of the last frame from ``time_s`` on.

    The unit is m; the typical magnitude is 5e-5. Source: probe qualification, ISO 10360-12:2016.
    This cause needs ``time_s``. The movement is between the two times ``between_s``. Aliases:
    ``encoder_slip`` of the last joints.
    """

    time_s: float
    between_s: tuple[float, ...] = ()
    sessions: tuple[str, ...] = ()
    cause: ClassVar[str] = "stylus_shift"
    words: ClassVar[str] = "movement of the stylus or target on the last body"
    remedy: ClassVar[str] = (
        "qualify the stylus again, and label the records before and after the movement in the "
        "column marker"
    )
    nonlinear: ClassVar[Nonlinear[Any]] = TimeOfStep("time_s", tried=STEPS_OF_SETUP)
    terms: ClassVar[tuple[Term, ...]] = shifts(5e-5, FARTHEST_TARGET)

    def displacements(self, state: State) -> list[Displacement]:
        """Return the unit translations at the tip in the later records."""
        part = self.part(state.conditions)
        return [Displacement(state.arm.chain.tip, twist(np.eye(3) * part[:, None, None]))]


@dataclass(frozen=True)
class _StylusShiftInGap(InGap, StylusShift):
    terms: ClassVar[tuple[Term, ...]] = tuple(
        replace(term, name=f"in_gap_{term.name}", key=f"in_gap_{term.key}")
        for term in StylusShift.terms
    )


@dataclass(frozen=True)
class SeatShift(StepInTime):
    """One seat moved once: true position = stated position + e from ``time_s`` on. The arm has no
    error.

    The unit is m; the typical magnitude is 5e-5 (a seat that was knocked or fixed again). This
    cause needs ``seat`` and ``time_s``. The movement is between the two times ``between_s``.
    Aliases: every smooth error of the arm, if you touch the seat in few postures before or after.
    """

    seat: str
    time_s: float
    between_s: tuple[float, ...] = ()
    sessions: tuple[str, ...] = ()
    cause: ClassVar[str] = "seat_shift"
    words: ClassVar[str] = "later displacement"
    remedy: ClassVar[str] = "give the seat another label in the records after the movement"
    needs: ClassVar[tuple[str, ...]] = ("seat", "time")
    of_reference: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = shifts(5e-5)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """Return a candidate for every seat that is touched often enough, with times of its own."""
        if records is None:
            return
        labels, times = records.conditions.seat, records.conditions.time
        if labels is None or times is None or len(np.unique(labels)) < LEAST_SEATS:
            return
        for seat in dict.fromkeys(labels.tolist()):
            touched = np.unique(times[labels == seat])
            inside = touched[AT_ENDS - 1 : 1 - AT_ENDS] if seat else touched[:0]
            between = (inside[1:] + inside[:-1]) / 2
            some = np.linspace(0, between.size - 1, min(between.size, STEPS_OF_SEAT)).astype(int)
            if between.size:
                yield tuple(cls(str(seat), time) for time in between[some].tolist())

    def displacements(self, state: State) -> list[Displacement]:
        """Return -e as a translation of the stated coordinates in the later records of the seat."""
        touched = state.conditions.require("seat", self.label) == self.seat
        part = self.part(state.conditions) * touched
        return [Displacement(BASE, twist(-np.eye(3) * part[:, None, None]))]


StylusShift.in_gap = _StylusShiftInGap


@dataclass(frozen=True)
class StylusBending(Effect):
    """The stylus sags under gravity: ``δp = s (I - e eᵀ) down``, with the stylus axis e.

    The parameter s is the sag of the level stylus. A constant probing force increases the sag. The
    unit is m; the typical magnitude is 1e-6 to 2e-5. Source: beam theory. This cause needs the
    stylus axis in the arm file. Aliases: ``bearing_tilt`` and ``joint_compliance`` of the last
    joint.
    """

    cause: ClassVar[str] = "stylus_bending"
    prior_weight: ClassVar[float] = 0.2
    elastic: ClassVar[bool] = True
    terms: ClassVar[tuple[Term, ...]] = (Term("", "m", 1e-5, "level_sag_mm", MM, positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """Return the translation of the tip along gravity across the stylus."""
        stylus = _stylus_axis(self, state.arm)
        return [_across(stylus, state, state.down)]


@dataclass(frozen=True)
class ProbeBending(Effect):
    """The stylus bends under the probing force: ``δp = -b (I - e eᵀ) d``.

    The vector e is the stylus axis, d is the direction of the motion of the probe at the contact,
    and b is the deflection. The ball lags behind the probe, so that b is above zero. The force is
    the same in all records. The unit is m; the typical magnitude is 5e-6 to 5e-5. For example, 1 N
    on a steel stylus of 50 mm length and 4 mm diameter gives 1.6e-5. Source: cantilever, ``b = F L³
    / (3 E I)``. This cause needs ``probe_direction_x …``, and the stylus axis in the arm file.
    Aliases: ``stylus_offset``, and ``joint_hysteresis`` of the last joints, if you always touch
    with the same side of the stylus.
    """

    cause: ClassVar[str] = "probe_bending"
    words: ClassVar[str] = "bending under the probing force"
    needs: ClassVar[tuple[str, ...]] = ("probe_direction",)
    terms: ClassVar[tuple[Term, ...]] = (Term("", "m", 2e-5, "deflection_mm", MM, positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """Return the translation of the tip against the motion of the probe, across the stylus."""
        stylus = _stylus_axis(self, state.arm)
        direction = state.conditions.require("probe_direction", self.label)
        return [_across(stylus, state, -direction)]


@dataclass(frozen=True)
class ThermalExpansion(Effect):
    """The lengths of the whole arm or of one body expand with temperature: ``δl = α (T - T0) l``.

    T0 is the reference temperature in the arm file. The temperature of a row applies to the body
    that moves with the row. In standard DH this body has d and a of the row; in modified DH, d of
    the row and a of the next row. Bodies before row 1 have the mean temperature of the rows. If the
    whole arm also expands, α of one body is the difference. The unit is 1/K; the typical magnitude
    is 12e-6 (steel) to 24e-6 (aluminium), and 1e-6 for carbon. Source: ISO 1:2022. This cause needs
    ``temperature_c``, or ``temperature1_c …`` of each row. Aliases: an error of scale of the
    reference coordinates; ``link_length`` and ``joint_distance``, if the temperature hardly
    changes; for one body, ``thermal_expansion`` of the whole arm.
    """

    link: int | None = None
    cause: ClassVar[str] = "thermal_expansion"
    needs: ClassVar[tuple[str, ...]] = ("temperature",)
    terms: ClassVar[tuple[Term, ...]] = (
        Term("", "1/K", 2e-5, "expansion_per_k", read_in=("µm/(m·K)", 1e-6), positive=True),
    )

    def displacements(self, state: State) -> list[Displacement]:
        """Return the growth of each length per unit of α, proportional to the difference
        from T0.
        """
        rows = (
            range(state.arm.chain.rows + 1) if self.link is None else [state.known_row(self.link)]
        )
        found = []
        for row in rows:
            warmer = self._warmer(state, row)
            found += growth_of_body(state, row, warmer[:, None])
        return found

    def _warmer(self, state: State, row: int) -> Array:
        conditions = state.conditions
        reference = state.arm.reference_temperature
        if (
            conditions.link_temperature is not None
            and 1 <= row <= conditions.link_temperature.shape[1]
        ):
            return np.asarray(conditions.link_temperature[:, row - 1] - reference)
        if conditions.link_temperature is not None and conditions.temperature is None:
            # The stand: nobody measured it.
            return np.asarray(conditions.link_temperature.mean(axis=1) - reference)
        return np.asarray(conditions.require("temperature", self.label) - reference)


def _stylus_axis(effect: Effect, arm: Arm) -> Array:
    """Along the stylus, in the axes of the tip (3,).

    Raises:
        UnsupportedArmError: the arm states none.
    """
    if arm.stylus_axis is None:
        raise UnsupportedArmError(
            f"{effect.label}: the arm states no axis of the stylus; state [stylus] in the arm file"
        )
    return arm.stylus_axis


def _across(stylus: Array, state: State, vectors: Array) -> Displacement:
    """The tip, by the part across the stylus of vectors of the base (n, 3), or of one (3,)."""
    of_tip = state.in_axes_of(state.arm.chain.tip, vectors)
    across = of_tip - (of_tip @ stylus)[:, None] * stylus
    return Displacement(state.arm.chain.tip, twist(across[:, :, None]))


def growth_of_body(state: State, row: int, growth: Array) -> list[Displacement]:
    """The lengths of body ``row`` (0: what stands before row 1).

    Args:
        growth: relative, per unit of each parameter (n, p) [1/unit].
    """
    found = []
    for place in (axis(row), end(row)) if row else (end(0),):
        length = _length_before(state, place)
        if length.any():
            shifts = length[:, None] * growth[:, None]
            found.append(Displacement(place, twist(shifts)))
    return found


def _length_before(state: State, place: int) -> Array:
    """The constant shift from the place before to ``place``, in its own axes; a joint turns it only
    where it is along z.
    """
    constant = state.arm.chain.constant[place]
    return np.asarray(constant[:3, :3].T @ constant[:3, 3])
