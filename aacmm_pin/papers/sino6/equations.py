"""The paper's equations (2) to (13), corrected where the print is wrong: configurations of the nominal arm by geometry.

**Height.** The paper draws its vertical axis against the z axis of its own DH table, ``Z = -z_DH``: with the signs of its
Table 1, θ3 = 0 puts the elbow at the *least* z_DH, where the paper calls it highest. Points enter and joint angles leave in
the DH base frame; "highest" and "lowest" speak of Z.

**Names.** O is the shoulder (origin of frame 1), P the working point (origin of frame 5), E the elbow (origin of frame 3,
on the axis of joint 4), C the end of the upper tube (E without the offset l3). ``-θ2`` and ``-θ4`` are the angles that the
paper writes as |θ2| and |θ4|; joint limits are θ2, θ4 in [-π, 0]. All lengths are the magnitudes of :class:`NominalArm`.
Everything works on batches: points (n, 3) [m], angles (n,) [rad]; where a triangle does not close, the answer is NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array, batch
from aacmm_pin.papers.sino6.tables import NominalArm

QUARTER = np.pi / 2


def arccos_or_nan(cosine: Array) -> Array:
    """Inverse cosine [rad]; NaN where |cosine| > 1, which is a triangle that does not close."""
    return np.arccos(cosine, out=np.full(np.shape(cosine), np.nan), where=np.abs(cosine) <= 1.0)


def root_or_nan(squared: Array) -> Array:
    """Square root; NaN where there is no real one."""
    return np.sqrt(squared, out=np.full_like(squared, np.nan), where=squared >= 0.0)


def cosine_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Cosine of the angle between the sides ``near`` and ``far`` [m]; beyond ±1 where the sides do not close."""
    return np.asarray((near**2 + far**2 - opposite**2) / (2.0 * near * far), dtype=np.float64)


def angle_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Angle between the sides ``near`` and ``far`` [rad], NaN where the sides do not close."""
    return arccos_or_nan(cosine_in_triangle(near, far, opposite))


# Lengths that the equations share ---------------------------------------------------------------------------------------


def upper_tube_span(arm: NominalArm) -> float:
    """|OC|, ``len`` of (3) [m]."""
    return float(np.hypot(arm.l2, arm.d3))


def highest_elbow_span(arm: NominalArm) -> float:
    """|OE| at θ3 = 0, ``QD`` of (3) [m]. Right with magnitudes; with the signs of Table 1 it would be the span at θ3 = π."""
    return float(np.hypot(arm.l3 - arm.l2, arm.d3))


def lowest_elbow_span(arm: NominalArm) -> float:
    """|OE| at θ3 = π, ``gen`` of (7) [m]."""
    return float(np.hypot(arm.l2 + arm.l3, arm.d3))


def height(point: Array) -> Array:
    """Z of the paper's figures, -z_DH: (n,) [m]."""
    return -batch(point, 3, "point", "m")[:, 2]


def radius(point: Array) -> Array:
    """Distance of P from the base axis, ``Qk`` of (12): (n,) [m]."""
    x, y, _ = batch(point, 3, "point", "m").T
    return np.asarray(np.hypot(x, y))


def distance(point: Array) -> Array:
    """|OP|, ``den`` of (3), with the shoulder at the origin of the base frame: (n,) [m]."""
    return np.asarray(np.linalg.norm(batch(point, 3, "point", "m"), axis=1))


# The highest configuration: (2) to (5) ----------------------------------------------------------------------------------


def azimuth(point: Array) -> Array:
    """θ1 of the two planar configurations, (2) and (6): (n,) [rad]. The printed case distinction is atan2 modulo 2π."""
    x, y, _ = batch(point, 3, "point", "m").T
    return np.asarray(np.arctan2(y, x))


def highest_theta2(arm: NominalArm, point: Array) -> Array:
    """θ2 of the highest configuration, (3): (n,) [rad].

    Corrected: the1 is an angle of the triangle with the sides l2, QD and √(l3² + d3²), so its cosine has
    ``l2² + QD² - (l3² + d3²)``; the print has ``√(l3² + d5²)`` for the bracket, which gives no angle at all. The sum of
    the three angles counts from the far end of the range, so π is taken off.
    """
    span = highest_elbow_span(arm)
    the1 = angle_in_triangle(arm.l2, span, np.hypot(arm.l3, arm.d3))
    the2 = angle_in_triangle(span, distance(point), arm.d5)
    the3 = np.arctan2(height(point), radius(point))
    return the1 + the2 + the3 - np.pi


def angles_at_elbow(arm: NominalArm, point: Array, span: float) -> tuple[Array, Array]:
    """∠k and ∠q of (5) and (9), at E from O to C and to P, for the elbow's distance ``span`` from O: (), (n,) [rad]."""
    k = angle_in_triangle(span, arm.l3, upper_tube_span(arm))
    return k, angle_in_triangle(span, arm.d5, distance(point))


def highest_theta4(arm: NominalArm, point: Array) -> Array:
    """θ4 of the highest configuration, (5): (n,) [rad]. Corrected: 3π/2, where the print has 2π; d5 as a magnitude."""
    k, q = angles_at_elbow(arm, point, highest_elbow_span(arm))
    return -(3.0 * QUARTER - k - q)


def highest_configuration(arm: NominalArm, point: Array) -> Array:
    """θ1 to θ4 with the elbow at the greatest Z above OP, (2) to (5), with θ3 = 0 for the missing (4): (n, 4) [rad].

    For P in front of the base axis as the arm looks. Folded so far that |θ4| exceeds 3π/2 - ∠k, 179.4° on SINO6, the arm
    is the mirror image of this triangle about OP, which (3) and (5) leave out.
    """
    theta1 = azimuth(point)
    return np.column_stack([theta1, highest_theta2(arm, point), np.zeros_like(theta1), highest_theta4(arm, point)])


# The lowest configuration: (6) to (9) -----------------------------------------------------------------------------------


def tube_end_to_point(arm: NominalArm, theta4: Array) -> Array:
    """|CP|, ``ken`` of (7), for a given θ4: (n,) [m]. Corrected: the sine of θ4 enters with the other sign."""
    return np.sqrt(arm.l3**2 + arm.d5**2 - 2.0 * arm.l3 * arm.d5 * np.cos(QUARTER - np.asarray(theta4)))


def theta2_sweep_parts(arm: NominalArm, point: Array, ken: Array) -> Array:
    """``thek1``, ``thek2``, ``thek3`` of (7), whose sum is how far θ2 turns from the highest to the lowest configuration.

    They are angles at O: from C (highest) to P, on to E (lowest), on to C: (n, 3) [rad]. ``ken`` (n,) [m] belongs to the
    *highest* configuration.
    """
    reach, upper, lowest = distance(point), upper_tube_span(arm), lowest_elbow_span(arm)
    thek3 = angle_in_triangle(lowest, upper, arm.l3)
    parts = angle_in_triangle(upper, reach, ken), angle_in_triangle(lowest, reach, arm.d5), np.full_like(reach, thek3)
    return np.column_stack(parts)


def theta2_sweep(arm: NominalArm, point: Array) -> Array:
    """``thek`` of (7): (n,) [rad]."""
    ken = tube_end_to_point(arm, highest_theta4(arm, point))
    return np.asarray(theta2_sweep_parts(arm, point, ken).sum(axis=1))


def lowest_exists(arm: NominalArm, point: Array) -> NDArray[np.bool_]:
    """Whether the triangle of the lowest configuration closes: (n,) bool. The print has only one of the two conditions."""
    span, reach = lowest_elbow_span(arm), distance(point)
    return np.asarray((np.abs(span - arm.d5) <= reach) & (reach <= span + arm.d5))


def lowest_theta2(arm: NominalArm, point: Array) -> Array:
    """θ2 of the lowest configuration: (n,) [rad]. This line, θ2max - thek, is missing after (7).

    It leans on the highest configuration; where that one is out of reach (|OP| > QD + d5) it is NaN.
    """
    return highest_theta2(arm, point) - theta2_sweep(arm, point)


def lowest_theta4(arm: NominalArm, point: Array) -> Array:
    """θ4 of the lowest configuration, (9), and of its mirror image about OP: (n, 2) [rad].

    The print has the first. Near the rim of the reach the second is inside the limits as well: |θ4| below the angle whose
    tangent is (l2 + l3)/d3, 9.2° on SINO6.
    """
    k, q = angles_at_elbow(arm, point, lowest_elbow_span(arm))
    return np.column_stack([-(3.0 * QUARTER - k - q), QUARTER + k - q])


def lowest_configuration(arm: NominalArm, point: Array) -> Array:
    """θ1 to θ4 with the elbow at the least Z below OP, (6) to (9), with θ3 = π for (8): (n, 4) [rad]."""
    theta1, theta4 = azimuth(point), lowest_theta4(arm, point)[:, 0]
    return np.column_stack([theta1, lowest_theta2(arm, point), np.full_like(theta1, np.pi), theta4])


# The configurations between, for a given θ2: (10) to (13) ---------------------------------------------------------------


def crossing_height(arm: NominalArm, theta2: Array) -> Array:
    """Z of K, where the axis of joint 3 meets the base axis, (10): (n,) [m]; NaN for θ2 = 0 and -π, where K is at infinity.

    K depends on θ2 only, so |KP| does not change with θ1 and θ3; this makes the construction exact.
    """
    sine = np.abs(np.sin(np.asarray(theta2, dtype=np.float64)))
    return np.divide(arm.l2, sine, out=np.full_like(sine, np.nan), where=sine > 0.0)


def crossing_to_tube_end(arm: NominalArm, theta2: Array) -> Array:
    """Distance from K to C along the axis of joint 3, ``dk`` of (10): (n,) [m], negative where C has not reached K.

    The printed quotient of sines equals ``d3 - l2 cot|θ2|`` and changes its sign at |θ2| = arctan(l2/d3).
    """
    turned = np.abs(theta2) + np.arctan(arm.d3 / arm.l2) - QUARTER
    return np.asarray(np.sin(turned) * crossing_height(arm, theta2) / np.sin(np.arctan(arm.l2 / arm.d3)))


def cosine_theta42(arm: NominalArm, point: Array, theta2: Array, l3: float | None = None) -> Array:
    """Cosine of the angle at E between K and P, θ42 of (11): (n,). Beyond ±1 no configuration has this θ2.

    Corrected: the hypotenuse ``qdk`` has ``l3``; the print has l2.
    """
    to_elbow = np.hypot(crossing_to_tube_end(arm, theta2), arm.l3 if l3 is None else l3)
    return cosine_in_triangle(arm.d5, to_elbow, np.hypot(radius(point), height(point) - crossing_height(arm, theta2)))


def theta4_roots(arm: NominalArm, point: Array, theta2: Array) -> Array:
    """Both θ4 that (11) allows for a given θ2: (n, 2) [rad] in [-π, π).

    The triangle K, E, P has a mirror image about KE, the second column, which the print leaves out.
    """
    theta41 = np.arctan2(crossing_to_tube_end(arm, theta2), arm.l3)
    theta42 = arccos_or_nan(cosine_theta42(arm, point, theta2))
    return wrapped(-3.0 * QUARTER + theta41[:, None] + np.column_stack([theta42, -theta42]))


def tube_end(arm: NominalArm, theta2: Array) -> tuple[Array, Array]:
    """``Uk`` and ``Vk`` of (12): radius of C along the arm's own vertical plane, with its sign, and Z of C: (n,), (n,) [m].

    Corrected: ``Vk`` is positive like the Z of K in (10).
    """
    opening = np.abs(theta2) + np.arctan(arm.d3 / arm.l2)  # uck of (10)
    return upper_tube_span(arm) * np.cos(np.pi - opening), upper_tube_span(arm) * np.sin(np.pi - opening)


def cosine_theta1(arm: NominalArm, point: Array, theta2: Array, theta4: Array) -> Array:
    """Cosine of θ1 counted from the azimuth of P, (12) and (13): (n,). NaN or beyond ±1 where no configuration exists.

    Corrected: ``Uk`` keeps its sign. The guard printed with (13) is not a condition of existence; this cosine is.
    """
    uk, vk = tube_end(arm, theta2)
    rq = root_or_nan(tube_end_to_point(arm, theta4) ** 2 - (vk - height(point)) ** 2)  # Rq of (12)
    with np.errstate(divide="ignore", invalid="ignore"):
        return cosine_in_triangle(radius(point), uk, rq)


def theta3(arm: NominalArm, point: Array, theta1: Array, theta2: Array) -> Array:
    """θ3 for given θ1 and θ2: (n,) [rad] in [-π, π].

    The paper finds it "by comparison". Seen from frame 2, P lies off the axis of joint 3 by l3 + d5 sin|θ4|, which is
    positive inside the limits, in the direction of θ3.
    """
    turn = azimuth(point) - theta1
    ahead, aside = radius(point) * np.cos(turn), radius(point) * np.sin(turn)
    return np.asarray(np.arctan2(aside, ahead * np.cos(theta2) + height(point) * np.sin(theta2) + arm.l2))


def configurations_at_theta2(arm: NominalArm, point: Array, theta2: Array) -> Array:
    """θ1 to θ4 of all configurations with a given θ2, (10) to (13): (n, 2, 2, 4) [rad], NaN where there is none.

    The second axis is the root of (11), the third the sign of (13): θ1 is counted from the azimuth of P, which the print
    leaves out. θ4 may be outside its limits.
    """
    found = np.empty((len(point), 2, 2, 4))
    found[..., 1] = np.asarray(theta2)[:, None, None]
    for root, theta4 in enumerate(theta4_roots(arm, point, theta2).T):
        turn = arccos_or_nan(cosine_theta1(arm, point, theta2, theta4))
        for mirror, sign in enumerate((1.0, -1.0)):
            theta1 = wrapped(azimuth(point) + sign * turn)
            found[:, root, mirror, 0] = theta1
            found[:, root, mirror, 2] = theta3(arm, point, theta1, theta2)
            found[:, root, mirror, 3] = theta4
    found[~np.isfinite(found).all(axis=-1)] = np.nan
    return found
