"""The six seats of Table 3 and how they were touched: fifty postures each, evenly round the circle, in three readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.papers.sino6 import NominalArm, printed_points, printed_table3, sino6_nominal
from aacmm_pin.papers.sino6.equations import arccos_or_nan, root_or_nan
from aacmm_pin.postures.configurations import WRIST, ConfigurationCircle, configuration_circles

Reading = Literal["stylus down", "stylus up", "wrist"]
READINGS: tuple[Reading, ...] = get_args(Reading)
"""The tip is in the seat with the stylus along -z or +z of the DH base; or the wrist is at the printed coordinates."""
RECORDS = 50
"""Records at each seat (section 2.4 of the paper)."""
SIXTH = 5
"""Number of seat 6, from 0."""
MEASURED = np.array(printed_table3()["single_point_std_mm"], dtype=np.float64) * MM
"""The printed spreads (6,) [m]."""
CLOSED, NEWTON_STEPS = 1e-12, 12
"""Distance to the seat at which a configuration is taken [m], and steps after which it must be there."""


@dataclass(frozen=True, eq=False)
class TouchedSeats:
    """Seats of unknown place that an arm touches in as many postures each.

    Attributes:
        model: the arm with the effects that are known of it.
        q: postures (seats, records, nq) [rad].
        at: frame whose origin is in the seat; None for the tip.
    """

    model: ErrorModel
    q: Array
    at: str | None = None

    @property
    def all_q(self) -> Array:
        """All postures, seat by seat (n, nq) [rad]."""
        return self.q.reshape(-1, self.q.shape[2])

    def sensitivity(self, effects: Sequence[Effect] | None = None, conditions: Conditions | None = None) -> Array:
        """∂(position)/∂(parameters of ``effects``, by default those of the model): (seats, records, 3, p) [m/unit]."""
        if effects is None:
            return self._by_seat(self.model.sensitivity(self.all_q, at=self.at))
        state = self.model.state(self.all_q, conditions, self.at)
        return self._by_seat(np.concatenate([effect.sensitivity(state) for effect in effects], axis=2))

    def levers(self) -> Array:
        """∂(position)/∂(angle of each joint): (seats, records, 3, nq) [m/rad]."""
        return self._by_seat(self.model.arm.jacobian(self.all_q, self.at))

    def _by_seat(self, values: Array) -> Array:
        return values.reshape(*self.q.shape[:2], *values.shape[1:])


def touched_seats(reading: Reading = "stylus down", *, arc: float = 1.0, start: float = 0.0) -> TouchedSeats:
    """The seats with the bundled SINO6.

    With the tip in the seat the elbow goes evenly round its circle, on the closed component that has most postures within
    limits; with the wrist at the printed coordinates θ3 goes evenly round the full circle. The print does not say that the
    postures went all round; ``arc`` tries it otherwise.

    Args:
        reading: what is at the printed coordinates.
        arc: part of the circle that the fifty postures cover, above 0 and at most 1.
        start: where it starts, as a part of the circle; with the wrist at the coordinates 0 is θ3 = 0.

    Raises:
        UnknownNameError: no such reading.
        AacmmError: an arc that is none.
    """
    if reading not in READINGS:
        raise UnknownNameError("reading", reading, list(READINGS))
    if not 0.0 < arc <= 1.0:
        raise AacmmError(f"arc is {arc:g}, expected a part of the circle, above 0 and at most 1")
    model, count = ErrorModel.load("sino6"), round(RECORDS / arc)
    if reading == "wrist":
        q, at = wrist_configurations(model.arm.require_dh("Table 3"), count), WRIST
    else:
        axis = np.array([0.0, 0.0, -1.0 if reading == "stylus down" else 1.0])
        circles = configuration_circles(model.arm, printed_points(), tip=True, axis=axis, count=count)
        q, at = np.stack([_most_usable(circle) for circle in circles]), None
    return TouchedSeats(model, np.roll(q, -round(start * count), axis=1)[:, :RECORDS], at)


def _most_usable(circle: ConfigurationCircle) -> Array:
    usable = np.bincount(circle.component, weights=circle.within_limits)
    return np.asarray(circle.q[circle.component == np.argmax(usable)])


def wrist_configurations(dh: DHTable, count: int) -> Array:
    """``count`` configurations of the calibrated arm at every seat, θ3 evenly round the full circle: (6, count, nq) [rad].

    Newton steps, shortest in θ1 to θ4, bring the working point from where the nominal arm has it to the seat.
    """
    start = nominal_configurations(sino6_nominal(), printed_points(), np.arange(count) * 2.0 * np.pi / count)
    q = np.zeros((len(MEASURED) * count, dh.nq))
    q[:, :4] = start.reshape(-1, 4)
    goal = np.repeat(printed_points(), count, axis=0)
    for _ in range(NEWTON_STEPS):
        gap = goal - dh.positions(q, 5)
        if np.linalg.norm(gap, axis=1).max() <= CLOSED:
            return q.reshape(-1, count, dh.nq)
        q[:, :4] += (np.linalg.pinv(dh.sensitivity(q, 5)[:, :, 3:16:4]) @ gap[:, :, None])[:, :, 0]
    raise AacmmError(f"a seat of Table 3 is not reached within {CLOSED:g} m after {NEWTON_STEPS} Newton steps")


def nominal_configurations(arm: NominalArm, points: Array, theta3: Array) -> Array:
    """θ1 to θ4 of the nominal arm, elbow ahead of the base axis, for every seat and θ3 (m,) [rad]: (n, m, 4) [rad].

    ``A cos t4 + B sin t4 = C`` from |OP|, then θ2 from the height and θ1 from the azimuth of P. Each closed step has two
    roots; taken are the fore tube bent inwards and the upper tube on the side to which the base looks. NaN: out of reach.
    """
    x, y, z = points.T[:, :, None]
    cosine, sine = np.cos(theta3), np.sin(theta3)
    across, along = 2.0 * arm.d5 * (arm.l3 - arm.l2 * cosine), 2.0 * arm.d5 * arm.d3
    fixed = arm.l2**2 + arm.l3**2 + arm.d3**2 + arm.d5**2 - 2.0 * arm.l2 * arm.l3 * cosine
    t4 = np.arctan2(across, along) + arccos_or_nan((x**2 + y**2 + z**2 - fixed) / np.hypot(across, along))
    offset, tube = arm.l3 + arm.d5 * np.sin(t4), arm.d3 + arm.d5 * np.cos(t4)
    reach, aside = offset * cosine - arm.l2, offset * sine
    ahead = root_or_nan(reach**2 + tube**2 - z**2)
    t2 = np.arctan2(z, ahead) + np.arctan2(tube, reach)
    theta1 = np.arctan2(y, x) - np.arctan2(aside, ahead)
    return np.stack([theta1, -t2, np.broadcast_to(theta3, t2.shape), -t4], axis=-1)
