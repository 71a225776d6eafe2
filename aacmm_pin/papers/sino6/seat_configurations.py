"""Configurations that hold the working point at a seat while θ3, or with the tip in the seat the elbow, goes round.

With the wrist there the nominal arm has two closed steps: ``A cos t4 + B sin t4 = C`` from |OP|, then θ2 from the height
and θ1 from the azimuth of P. A few Newton steps on the calibrated table, shortest in θ1 to θ4, bring its working point to
the seat as well. With the tip there the postures are those of the configuration circle.
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.checks import Array, batch
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.errors import UnsupportedArmError
from aacmm_pin.papers.sino6.nominal import NominalArm
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circles

WORKING_ROW = 5
"""The working point is the origin of this frame."""
CLOSED = 1e-12
"""Distance to the seat at which a configuration is taken [m]."""
NEWTON_STEPS = 12


def nominal_configurations(arm: NominalArm, points: Array, theta3: Array) -> Array:
    """θ1 to θ4 of the nominal arm, elbow ahead of the base axis, for every seat and every θ3: (n, m, 4) [rad].

    Args:
        arm: the nominal arm.
        points: seats (n, 3) [m].
        theta3: (m,) [rad].

    NaN where the seat is out of reach with that θ3. Each closed step has two roots; taken are the fore tube bent inwards,
    as its limits want it, and the upper tube on the side to which the base looks.
    """
    points = batch(points, 3, "points", "m")
    x, y, z = (points[:, None, k] for k in range(3))
    cosine, sine = np.cos(theta3), np.sin(theta3)
    across = 2.0 * arm.d5 * (arm.l3 - arm.l2 * cosine)
    along = 2.0 * arm.d5 * arm.d3
    fixed = arm.l2**2 + arm.l3**2 + arm.d3**2 + arm.d5**2 - 2.0 * arm.l2 * arm.l3 * cosine
    t4 = np.arctan2(across, along) + _arccos((x**2 + y**2 + z**2 - fixed) / np.hypot(across, along))
    offset, tube = arm.l3 + arm.d5 * np.sin(t4), arm.d3 + arm.d5 * np.cos(t4)
    reach, aside = offset * cosine - arm.l2, offset * sine
    ahead_squared = reach**2 + tube**2 - z**2
    ahead = np.sqrt(ahead_squared, out=np.full_like(ahead_squared, np.nan), where=ahead_squared >= 0.0)
    t2 = np.arctan2(z, ahead) + np.arctan2(tube, reach)
    theta1 = np.arctan2(y, x) - np.arctan2(aside, ahead)
    return np.stack([theta1, -t2, np.broadcast_to(theta3, t2.shape), -t4], axis=-1)


def seat_configurations(arm: NominalArm, dh: DHTable, points: Array, count: int) -> Array:
    """``count`` configurations of the calibrated arm at every seat, θ3 evenly round the full circle: (n, count, nq) [rad].

    Args:
        arm: nominal lengths, for the start.
        dh: calibrated table of at least five joints; joints beyond the fourth stay at zero.
        points: seats (n, 3) [m] for the origin of frame 5.
        count: configurations at each seat.

    Raises:
        UnsupportedArmError: a seat is out of reach for some θ3, or Newton's method does not close to 1e-12 m.
    """
    theta3 = np.arange(count) * 2.0 * np.pi / count
    start = nominal_configurations(arm, points, theta3)
    if not np.isfinite(start).all():
        number = int(np.argwhere(~np.isfinite(start))[0, 0])
        raise UnsupportedArmError(f"points[{number}] is out of reach for some θ3; expected seats with the full circle")
    q = np.zeros((*start.shape[:2], dh.nq))
    q[..., :4] = start
    flat, goal = q.reshape(-1, dh.nq), np.repeat(batch(points, 3, "points", "m"), count, axis=0)
    return polished(dh, flat, goal).reshape(q.shape)


def tip_configurations(arm: Arm, points: Array, axis: Array, count: int) -> Array:
    """``count`` configurations with the tip in every seat, the elbow evenly round its circle: (n, count, nq) [rad].

    Of the closed components of a circle the one with the most configurations within limits is taken.

    Args:
        arm: an arm with a DH table and a stylus.
        points: seats (n, 3) [m].
        axis: direction of the stylus in the base (3,).
        count: configurations at each seat.

    Raises:
        UnsupportedArmError: a seat cannot be reached with that axis.
    """
    circles = configuration_circles(arm, points, tip=True, axis=axis, count=count)
    for number, circle in enumerate(circles):
        if not len(circle):
            raise UnsupportedArmError(f"points[{number}]: {circle.reason}; expected seats that the tip reaches")
    return np.stack([_most_usable(circle) for circle in circles])


def _most_usable(circle: ConfigurationCircle) -> Array:
    usable = np.bincount(circle.component, weights=circle.within_limits)
    return np.asarray(circle.q[circle.component == np.argmax(usable)])


def polished(dh: DHTable, q: Array, goal: Array) -> Array:
    """``q`` (n, nq) [rad] moved by the shortest steps in θ1 to θ4 until the working point is at ``goal`` (n, 3) [m].

    Raises:
        UnsupportedArmError: it does not get within 1e-12 m.
    """
    q = q.copy()
    for _ in range(NEWTON_STEPS):
        gap = goal - dh.positions(q, WORKING_ROW)
        if np.linalg.norm(gap, axis=1).max() <= CLOSED:
            return q
        jacobian = dh.jacobian(q, WORKING_ROW)[:, :, :4]
        q[:, :4] += (np.linalg.pinv(jacobian) @ gap[:, :, None])[:, :, 0]
    worst = float(np.linalg.norm(goal - dh.positions(q, WORKING_ROW), axis=1).max())
    raise UnsupportedArmError(f"a seat is missed by {worst:.3g} m after {NEWTON_STEPS} Newton steps, expected {CLOSED:g} m")


def _arccos(cosine: Array) -> Array:
    """Inverse cosine, NaN beyond ±1."""
    return np.arccos(cosine, out=np.full_like(cosine, np.nan), where=np.abs(cosine) <= 1.0)
