"""Causes besides links and encoders: stand, stylus, target, temperature, references."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note
from aacmm_pin._support.units import MM
from aacmm_pin.arm import BASE, Arm, axis, end
from aacmm_pin.effects.conditions import Conditions, Records
from aacmm_pin.effects.effect import Displacement, Effect, Term, rotations, shifts, twist
from aacmm_pin.effects.state import State
from aacmm_pin.effects.time_dependent import AT_ENDS, StepInTime, TimeOfStep, midpoints
from aacmm_pin.errors import UnsupportedArmError

LEAST_SEATS = 3
"""Fewer seats do not show which of them has an error."""
STEPS_OF_SETUP = 20
"""Fewer, for each has several parameters."""
STEPS_OF_SEAT = 8
FARTHEST_TARGET = 10.0
"""Largest distance of a target on the last body from the tip [m]."""
ANOTHER_POINT = 5e-4
"""A ball farther from its qualified place is another point [m]."""


class _Moved(Effect):
    """The base, the tip or a seat is elsewhere, in the records with one label; without a label in
    all.
    """

    moves: ClassVar[Literal["base", "tip", "seat"]]

    @property
    def needs(self) -> tuple[str, ...]:
        return () if self.place is None else (str(self.location_field()),)

    def acting(self, conditions: Conditions) -> Array:
        """The part of the values that acts in each record, (n,) or (1,)."""
        if self.place is None:
            return np.ones(1)
        labels = conditions.require(str(self.location_field()), self.label)
        return np.asarray(labels == self.place, np.float64)

    def displacements(self, state: State) -> list[Displacement]:
        """The unit translations, of the base also rotations; the stated coordinates of a seat move
        by -e.
        """
        sign = -1.0 if self.moves == "seat" else 1.0
        columns = sign * np.eye(6)[:, : len(self.terms)]
        place = state.arm.chain.tip if self.moves == "tip" else BASE
        return [Displacement(place, columns * self.acting(state.conditions)[:, None, None])]


class _MovedOnce(StepInTime, _Moved):
    """The same from a time on."""

    def acting(self, conditions: Conditions) -> Array:
        return super().acting(conditions) * self.part(conditions)


@dataclass(frozen=True)
class SeatError(_Moved):
    """One seat is not at its stated position: true position = stated position + e. The arm has no
    error.

    Typical magnitude: 1e-5 m (worn, dirty or moved seat). Source: seats of single-point tests, ASME
    B89.4.22-2004. Needs ``seat``. Aliases: every smooth error of the arm, if you touch the seat in
    only one posture.
    """

    seat: str
    cause = "seat_error"
    moves = "seat"
    words = "error of the stated coordinates"
    needs = ("seat",)  # of the class, for the list of causes that records cannot show
    of_reference = True
    terms = shifts(2e-5)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for every seat, if enough other seats have coordinates."""
        seats = list(super().candidates(arm, records))
        if records is not None and len(seats) >= LEAST_SEATS and records.known.any():
            yield from seats


@dataclass(frozen=True)
class ReferenceFrame(_Moved):
    """The frame of the references is displaced relative to the base: ``p_reference = exp(v, ω)
    p_base``.

    The error is a small twist (v, ω) at the base. With ``session``, only the records of this
    session have it. Units: m and rad; the magnitude is any that remains after the fit of the two
    frames. Source: rigid registration. With a session, needs ``session``. Aliases:
    ``joint_zero_offset:1`` and ``joint_distance:1``, which also displace the whole arm.
    """

    session: str | None = None
    cause = "reference_frame"
    moves = "base"
    words = "error of the reference frame"
    of_reference = True
    refitted = True
    prior_weight = 0.2
    terms = (*shifts(1e-3), *rotations(1e-3))


@dataclass(frozen=True)
class StylusOffset(_Moved):
    """The ball or target is not at the tip: a constant translation in the axes of the last frame.

    With ``marker``, only this target has it. Typical magnitude: 2e-5 m for a qualified stylus, 0.1
    m for a mounted target. Source: probe qualification, ISO 10360-12:2016. With a marker, needs
    ``marker``. Aliases: ``link_length``, ``joint_distance`` and ``joint_zero_offset`` of the last
    row.
    """

    marker: str | None = None
    cause = "stylus_offset"
    moves = "tip"
    refitted = True
    prior_weight = 0.2
    terms = shifts(5e-5, FARTHEST_TARGET)

    def validity_notes(self, conditions: Conditions) -> list[Note]:
        """A note if the coordinates are of a target far from the tip."""
        distance = float(np.linalg.norm(self.values))
        if self.marker is not None or distance < ANOTHER_POINT:
            return []
        return [Note("tip_is_target", {"cause": self.label, "distance": distance})]


@dataclass(frozen=True)
class FrameShift(_MovedOnce):
    """The stand or the references moved once: ``p_reference = exp(v, ω) p_base`` from ``time_s``
    on.

    The arm has no error. The movement is between the two times ``between_s``. Typical magnitude:
    2e-4 m and rad (a stand that was bumped, a tripod that settled). Source: rigid registration.
    Needs ``time_s``. Aliases: ``encoder_slip:1``, if the stand only rotated about joint 1.
    """

    time_s: float
    cause = "frame_shift"
    moves = "base"
    words = "movement of the stand or of the references"
    remedy = (
        "label the records before and after the movement in the column session, and use "
        "--reference-frame session"
    )
    of_reference = True
    prior_weight = 0.2
    nonlinear = TimeOfStep("time_s", tried=STEPS_OF_SETUP)
    terms = (*shifts(2e-4), *rotations(2e-4))


@dataclass(frozen=True)
class StylusShift(_MovedOnce):
    """The stylus or target moved once on the last body, such as a probe that was mounted again: a
    translation in the axes of the last frame from ``time_s`` on.

    The movement is between the two times ``between_s``. Typical magnitude: 5e-5 m. Source: probe
    qualification, ISO 10360-12:2016. Needs ``time_s``. Aliases: ``encoder_slip`` of the last
    joints.
    """

    time_s: float
    cause = "stylus_shift"
    moves = "tip"
    words = "movement of the stylus or target on the last body"
    remedy = (
        "qualify the stylus again, and label the records before and after the movement in the "
        "column marker"
    )
    nonlinear = TimeOfStep("time_s", tried=STEPS_OF_SETUP)
    terms = shifts(5e-5, FARTHEST_TARGET)


@dataclass(frozen=True)
class SeatShift(_MovedOnce):
    """One seat moved once: true position = stated position + e from ``time_s`` on. The arm has no
    error.

    The movement is between the two times ``between_s``. Typical magnitude: 5e-5 m (a seat that was
    knocked or fixed again). Needs ``seat`` and ``time_s``. Aliases: every smooth error of the arm,
    if you touch the seat in few postures before or after.
    """

    seat: str
    time_s: float
    cause = "seat_shift"
    moves = "seat"
    words = "later displacement"
    remedy = "give the seat another label in the records after the movement"
    needs = ("seat", "time")
    of_reference = True
    terms = shifts(5e-5)

    @classmethod
    def candidates(cls, arm: Arm, records: Records | None = None) -> Iterator[tuple[Self, ...]]:
        """A candidate for every seat that is touched often enough, with its own times."""
        labels = None if records is None else records.conditions.seat
        times = None if records is None else records.conditions.time
        if labels is None or times is None or len(np.unique(labels)) < LEAST_SEATS:
            return
        for seat in filter(None, dict.fromkeys(labels.tolist())):
            times_at_seat = np.unique(times[labels == seat])
            middles = midpoints(times_at_seat[AT_ENDS - 1 : 1 - AT_ENDS])
            chosen = np.linspace(0, middles.size - 1, min(middles.size, STEPS_OF_SEAT)).astype(int)
            if middles.size:
                yield tuple(cls(str(seat), time) for time in middles[chosen].tolist())


@dataclass(frozen=True)
class StylusBending(Effect):
    """The stylus sags under gravity: ``δp = s (I - e eᵀ) down``, with the stylus axis e.

    s is the sag of the level stylus; a constant probing force increases it. Typical magnitude: 1e-6
    to 2e-5 m. Source: beam theory. Needs the stylus axis in the arm file. Aliases: ``bearing_tilt``
    and ``joint_compliance`` of the last joint.
    """

    cause = "stylus_bending"
    prior_weight = 0.2
    elastic = True
    terms = (Term("", "m", 1e-5, "level_sag_mm", MM, positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """The translation of the tip along gravity across the stylus."""
        stylus = _stylus_axis(self, state.arm)
        return [_across(stylus, state, state.down)]


@dataclass(frozen=True)
class ProbeBending(Effect):
    """The stylus bends under the probing force: ``δp = -b (I - e eᵀ) d``.

    e is the stylus axis, d the direction of the motion of the probe at the contact, and b the
    deflection, above zero because the ball lags behind the probe. The force is the same in all
    records. Typical magnitude: 5e-6 to 5e-5 m; 1 N on a steel stylus of 50 mm length and 4 mm
    diameter gives 1.6e-5. Source: cantilever, ``b = F L³ / (3 E I)``. Needs ``probe_direction_x
    …``, and the stylus axis in the arm file. Aliases: ``stylus_offset``, and ``joint_hysteresis``
    of the last joints, if you always touch with the same side of the stylus.
    """

    cause = "probe_bending"
    words = "bending under the probing force"
    needs = ("probe_direction",)
    terms = (Term("", "m", 2e-5, "deflection_mm", MM, positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """The translation of the tip against the motion of the probe, across the stylus."""
        stylus = _stylus_axis(self, state.arm)
        direction = state.conditions.require("probe_direction", self.label)
        return [_across(stylus, state, -direction)]


@dataclass(frozen=True)
class ThermalExpansion(Effect):
    """The lengths of the whole arm or of one body expand with temperature: ``δl = α (T - T0) l``.

    T0 is the reference temperature in the arm file. The temperature of a row applies to the body
    that moves with it: d and a of the row in standard DH, d of the row and a of the next in
    modified DH. Bodies before row 1 have the mean temperature of the rows. If the whole arm also
    expands, α of one body is the difference. Typical magnitude [1/K]: 12e-6 (steel) to 24e-6
    (aluminium), 1e-6 for carbon. Source: ISO 1:2022. Needs ``temperature_c``, or ``temperature1_c
    …`` of each row. Aliases: an error of scale of the reference coordinates; ``link_length`` and
    ``joint_distance``, if the temperature hardly changes; for one body, ``thermal_expansion`` of
    the whole arm.
    """

    link: int | None = None
    cause = "thermal_expansion"
    function_of = "temperature"
    needs = ("temperature",)
    terms = (Term("", "1/K", 2e-5, "expansion_per_k", read_in=("µm/(m·K)", 1e-6), positive=True),)

    def displacements(self, state: State) -> list[Displacement]:
        """The growth of each length per unit of α."""
        all_rows = range(state.arm.chain.rows + 1)
        rows = all_rows if self.link is None else [state.known_row(self.link)]
        conditions = state.conditions
        of_rows = conditions.link_temperature
        displacements: list[Displacement] = []
        for row in rows:
            if of_rows is not None and 1 <= row <= of_rows.shape[1]:
                temperature = of_rows[:, row - 1]
            elif (
                of_rows is not None and conditions.temperature is None
            ):  # nobody measured the stand
                temperature = of_rows.mean(axis=1)
            else:
                temperature = conditions.require("temperature", self.label)
            rise = temperature - state.arm.reference_temperature
            displacements += growth_of_body(state, row, rise[:, None])
        return displacements


def _stylus_axis(effect: Effect, arm: Arm) -> Array:
    """Unit vector along the stylus, in the axes of the tip (3,).

    Raises:
        UnsupportedArmError: the arm states no stylus axis.
    """
    if arm.stylus_axis is None:
        raise UnsupportedArmError(
            f"{effect.label}: the arm states no axis of the stylus; state [stylus] in the arm file"
        )
    return arm.stylus_axis


def _across(stylus: Array, state: State, vectors: Array) -> Displacement:
    """Translation of the tip by the part of base vectors (n, 3) or (3,) across the stylus."""
    in_tip_axes = state.in_axes_of(state.arm.chain.tip, vectors)
    across = in_tip_axes - (in_tip_axes @ stylus)[:, None] * stylus
    return Displacement(state.arm.chain.tip, twist(across[:, :, None]))


def growth_of_body(state: State, row: int, growth: Array) -> list[Displacement]:
    """Growth of the lengths of body ``row`` (0: before row 1) by ``growth`` (n, p) [1/unit]."""
    displacements = []
    for place in (axis(row), end(row)) if row else (end(0),):
        # The shift from the place before; a joint rotates it only where it is along z.
        constant = state.arm.chain.constant[place]
        shift = constant[:3, :3].T @ constant[:3, 3]
        if shift.any():
            growths = shift[:, None] * growth[:, None]
            displacements.append(Displacement(place, twist(growths)))
    return displacements
