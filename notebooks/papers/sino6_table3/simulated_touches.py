"""The six seats of Table 3, each touched in fifty postures, for three interpretations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from aacmm_pin._support.arrays import Array, wrapped
from aacmm_pin._support.units import MM
from aacmm_pin.effects import Effect, ErrorModel, sensitivity
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.postures.configurations import WRIST, ConfigurationCircle, configuration_circle
from papers.sino6.tables import printed_points, printed_table3

Reading = Literal["stylus down", "stylus up", "wrist"]
"""Interpretation of the printed coordinates: position of the tip, with the stylus along -z or +z of
the DH base, or position of the wrist.
"""
AXES = {
    "stylus down": np.array([0.0, 0.0, -1.0]),
    "stylus up": np.array([0.0, 0.0, 1.0]),
    "wrist": None,
}
DENSE = 2000
"""Postures on a circle, from which the postures nearest to evenly spaced θ3 are selected."""
RECORDS = 50
"""Records at each seat (section 2.4 of the paper)."""
SIXTH = 5
"""Index of seat 6, from 0."""
MEASURED = np.array(printed_table3()["single_point_std_mm"], dtype=np.float64) * MM
"""The printed spreads (6,) [m]."""


@dataclass(frozen=True, eq=False)
class TouchedSeats:
    """Seats with unknown positions, each touched in the same number of postures.

    Attributes:
        model: the arm with its known effects.
        q: postures (seats, records, nq) [rad].
        at: frame whose origin is in the seat; None for the tip.
        reading: interpretation of the printed coordinates.
    """

    model: ErrorModel
    q: Array
    at: str | None = None
    reading: Reading = "stylus down"

    @property
    def all_q(self) -> Array:
        """All postures, seat by seat (n, nq) [rad]."""
        return self.q.reshape(-1, self.q.shape[2])

    def sensitivity(self, effects: Sequence[Effect] | None = None) -> Array:
        """∂(position)/∂(parameters): (seats, records, 3, p) [m/unit].

        The parameters are those of ``effects``, by default those of the model.
        """
        if effects is None:
            return self._by_seat(self.model.sensitivity(self.all_q, at=self.at))
        state = self.model.state(self.all_q, at=self.at)
        return self._by_seat(
            np.concatenate([sensitivity(effect, state) for effect in effects], axis=2)
        )

    def levers(self) -> Array:
        """∂(position)/∂(angle of each joint): (seats, records, 3, nq) [m/rad]."""
        return self._by_seat(self.model.arm.jacobian(self.all_q, self.at))

    def _by_seat(self, values: Array) -> Array:
        return values.reshape(*self.q.shape[:2], *values.shape[1:])


def touched_seats(
    reading: Reading = "stylus down", *, arc: float = 1.0, start: float = 0.0
) -> TouchedSeats:
    """The six seats, touched by the bundled SINO6.

    If the tip is in the seat, the elbow moves evenly round its circle. If the wrist is at the
    printed coordinates, θ3 moves evenly round. The postures lie on the closed curve with the most
    postures within the limits. The paper does not state whether the postures cover the full circle;
    ``arc`` selects a part of it.

    Args:
        reading: interpretation of the printed coordinates.
        arc: part of the circle that the fifty postures cover, above 0 and at most 1.
        start: start of this part, as a part of the circle; for the wrist, 0 is θ3 = 0.

    Raises:
        UnknownNameError: unknown reading.
        AacmmError: arc out of range.
    """
    if reading not in AXES:
        raise UnknownNameError("reading", reading, list(get_args(Reading)))
    if not 0.0 < arc <= 1.0:
        raise AacmmError(f"arc is {arc:g}; expected a part of the circle, above 0 and at most 1")
    model, count, axis = ErrorModel.load("sino6"), round(RECORDS / arc), AXES[reading]
    wrist = axis is None
    count_on_curve = DENSE if wrist else count
    circles = [
        configuration_circle(model.arm, point, axis=axis, count=count_on_curve)
        for point in printed_points()
    ]
    q = np.stack([_most_usable(circle) for circle in circles])
    if wrist:
        apart = np.abs(wrapped(q[:, :, None, 2] - np.arange(count) * 2.0 * np.pi / count))
        q = np.take_along_axis(q, apart.argmin(axis=1)[:, :, None], axis=1)
    q = np.roll(q, -round(start * count), axis=1)[:, :RECORDS]
    return TouchedSeats(model, q, WRIST if wrist else None, reading)


def _most_usable(circle: ConfigurationCircle) -> Array:
    usable = np.bincount(circle.component, weights=circle.within_limits)
    return np.asarray(circle.q[circle.component == np.argmax(usable)])
