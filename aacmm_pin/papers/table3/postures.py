"""How the six seats of Table 3 were touched: fifty postures each, evenly round the circle, in three readings."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.papers.sino6 import printed_points, printed_table3, sino6_nominal
from aacmm_pin.papers.sino6.seat_configurations import seat_configurations, tip_configurations
from aacmm_pin.papers.spread import TouchedSeats
from aacmm_pin.postures.configurations import WRIST

Reading = Literal["stylus down", "stylus up", "wrist"]
READINGS: tuple[Reading, ...] = get_args(Reading)
"""The tip is in the seat with the stylus along -z or +z of the DH base; or the wrist is at the printed coordinates."""
RECORDS = 50
"""Records at each seat (section 2.4 of the paper)."""
SIXTH = 5
"""Number of seat 6, from 0."""
MEASURED = np.array(printed_table3()["single_point_std_mm"], dtype=np.float64) * MM
"""The printed spreads (6,) [m]."""


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
    if not 0.0 < arc <= 1.0:
        raise AacmmError(f"arc is {arc:g}, expected a part of the circle, above 0 and at most 1")
    whole = round(RECORDS / arc)

    def on_arc(q: Array) -> Array:
        return np.roll(q, -round(start * len(q)), axis=0)[:RECORDS]

    model = ErrorModel.load("sino6")
    labels = tuple(str(point) for point in printed_table3()["point"])
    if reading == "wrist":
        q = seat_configurations(sino6_nominal(), model.arm.require_dh("Table 3"), printed_points(), whole)
        return TouchedSeats(model, tuple(map(on_arc, q)), labels, WRIST)
    if reading not in READINGS:
        raise UnknownNameError("reading", reading, list(READINGS))
    axis = np.array([0.0, 0.0, -1.0 if reading == "stylus down" else 1.0])
    return TouchedSeats(model, tuple(map(on_arc, tip_configurations(model.arm, printed_points(), axis, whole))), labels)
