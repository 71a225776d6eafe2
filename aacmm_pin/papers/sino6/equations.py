"""The paper's equations (2) to (13), corrected where the print is wrong: configurations of the nominal arm by geometry.

**Height.** The paper draws its vertical axis against the z axis of its own DH table, ``Z = -z_DH``: with the signs of its
Table 1, θ3 = 0 puts the elbow at the *least* z_DH, where the paper calls it highest. Points enter and joint angles leave in
the DH base frame; "highest" and "lowest" speak of Z.

**Names.** O is the shoulder (origin of frame 1), P the working point (origin of frame 5), E the elbow (origin of frame 3,
on the axis of joint 4), C the end of the upper tube (E without the offset l3). ``t = -θ2`` and ``-θ4`` are the angles that
the paper writes as |θ2| and |θ4|; joint limits are θ2, θ4 in [-π, 0]. All lengths are the magnitudes of
:class:`NominalArm`. Everything works on batches: points (n, 3) [m], angles (n,) [rad]; where a triangle does not close, the
answer is NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array, batch
from aacmm_pin.papers.sino6.nominal import NominalArm

QUARTER = np.pi / 2


def arccos_or_nan(cosine: Array) -> Array:
    """Inverse cosine [rad]; NaN where |cosine| > 1, which is a triangle that does not close."""
    angle = np.full(np.shape(cosine), np.nan)
    np.arccos(cosine, out=angle, where=np.abs(cosine) <= 1.0)
    return angle


def cosine_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Cosine of the angle between the sides ``near`` and ``far`` [m]; beyond ±1 where the sides do not close."""
    return np.asarray((near**2 + far**2 - opposite**2) / (2.0 * near * far), dtype=np.float64)


def angle_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Angle between the sides ``near`` and ``far`` [rad], NaN where the sides do not close."""
    return arccos_or_nan(cosine_in_triangle(near, far, opposite))


def wrapped(angle: Array) -> Array:
    """The same angle in (-π, π] [rad]."""
    return np.asarray(np.pi - np.mod(np.pi - angle, 2.0 * np.pi), dtype=np.float64)


# Lengths that the equations share ---------------------------------------------------------------------------------------


def upper_tube_span(arm: NominalArm) -> float:
    """|OC|, ``len`` of (3) [m]."""
    return float(np.hypot(arm.l2, arm.d3))


def highest_elbow_span(arm: NominalArm) -> float:
    """|OE| at θ3 = 0, ``QD`` of (3) [m]. Right with magnitudes; with the signs of Table 1 it would be the span at θ3 = π."""
    return float(np.hypot(arm.l3 - arm.l2, arm.d3))


def lowest_elbow_span(arm: NominalArm) -> float:
    """|OE| at θ3 = π, ``gen`` of (7) [m]: ``len² + l3² - 2 len l3 cos(arctan(l2/d3) + π/2)``, which is (l2 + l3)² + d3²."""
    opening = np.arctan(arm.l2 / arm.d3) + QUARTER
    span = upper_tube_span(arm)
    return float(np.sqrt(span**2 + arm.l3**2 - 2.0 * span * arm.l3 * np.cos(opening)))


def height(point: Array) -> Array:
    """Z of the paper's figures, -z_DH: (n,) [m]."""
    return -batch(point, 3, "point", "m")[:, 2]


def radius(point: Array) -> Array:
    """Distance of P from the base axis, ``Qk`` of (12): (n,) [m]."""
    point = batch(point, 3, "point", "m")
    return np.hypot(point[:, 0], point[:, 1])


def distance(point: Array) -> Array:
    """|OP|, ``den`` of (3), with the shoulder at the origin of the base frame: (n,) [m]."""
    return np.asarray(np.linalg.norm(batch(point, 3, "point", "m"), axis=1))


# The highest configuration: (2) to (5) ----------------------------------------------------------------------------------


def azimuth(point: Array) -> Array:
    """θ1 of the two planar configurations, (2) and (6): (n,) [rad]. The printed case distinction is atan2 modulo 2π."""
    point = batch(point, 3, "point", "m")
    return np.arctan2(point[:, 1], point[:, 0])


def elevation(point: Array) -> Array:
    """Angle of OP above the horizontal, with Z: ``the3`` of (3), (n,) [rad]."""
    return np.arctan2(height(point), radius(point))


def highest_theta2(arm: NominalArm, point: Array) -> Array:
    """θ2 of the highest configuration, (3): (n,) [rad].

    Corrected: the1 is an angle of the triangle with the sides l2, QD and √(l3² + d3²), so its cosine has
    ``l2² + QD² - (l3² + d3²)``; the print has ``√(l3² + d5²)`` for the bracket, which gives no angle at all. The sum of
    the three angles counts from the far end of the range, so π is taken off.
    """
    span = highest_elbow_span(arm)
    the1 = angle_in_triangle(arm.l2, span, np.hypot(arm.l3, arm.d3))
    the2 = angle_in_triangle(span, distance(point), arm.d5)
    return the1 + the2 + elevation(point) - np.pi


def highest_theta4(arm: NominalArm, point: Array) -> Array:
    """θ4 of the highest configuration, (5): (n,) [rad]. Corrected: 3π/2, where the print has 2π; d5 as a magnitude."""
    span = highest_elbow_span(arm)
    k = angle_in_triangle(span, arm.l3, upper_tube_span(arm))
    q = angle_in_triangle(span, arm.d5, distance(point))
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


def theta2_sweep_parts(arm: NominalArm, point: Array, theta4_highest: Array) -> Array:
    """``thek1``, ``thek2``, ``thek3`` of (7): at O from C (highest) to P, on to E (lowest), on to C: (n, 3) [rad].

    Args:
        arm: the nominal arm.
        point: working points (n, 3) [m].
        theta4_highest: θ4 of the *highest* configuration (n,) [rad]; ``ken`` belongs to it.
    """
    reach, upper, lowest = distance(point), upper_tube_span(arm), lowest_elbow_span(arm)
    thek1 = angle_in_triangle(upper, reach, tube_end_to_point(arm, theta4_highest))
    thek2 = angle_in_triangle(lowest, reach, arm.d5)
    thek3 = angle_in_triangle(lowest, upper, arm.l3)
    return np.column_stack([thek1, thek2, np.broadcast_to(thek3, reach.shape)])


def theta2_sweep(arm: NominalArm, point: Array, theta4_highest: Array) -> Array:
    """How far θ2 turns from the highest to the lowest configuration, ``thek`` of (7): (n,) [rad]."""
    return np.asarray(theta2_sweep_parts(arm, point, theta4_highest).sum(axis=1))


def lowest_exists(arm: NominalArm, point: Array) -> NDArray[np.bool_]:
    """Whether the triangle of the lowest configuration closes: (n,) bool. The print has only one of the two conditions."""
    span, reach = lowest_elbow_span(arm), distance(point)
    return np.asarray((np.abs(span - arm.d5) <= reach) & (reach <= span + arm.d5))


def lowest_theta2(arm: NominalArm, point: Array) -> Array:
    """θ2 of the lowest configuration: (n,) [rad]. This line, θ2max - thek, is missing after (7).

    It leans on the highest configuration; where that one is out of reach (|OP| > QD + d5) it is NaN.
    """
    return highest_theta2(arm, point) - theta2_sweep(arm, point, highest_theta4(arm, point))


def lowest_theta4(arm: NominalArm, point: Array) -> Array:
    """θ4 of the lowest configuration, (9), and of its mirror image about OP: (n, 2) [rad].

    The print has the first. Near the rim of the reach the second is inside the limits as well: |θ4| below the angle whose
    tangent is (l2 + l3)/d3, 9.2° on SINO6.
    """
    span = lowest_elbow_span(arm)
    k = angle_in_triangle(span, arm.l3, upper_tube_span(arm))
    q = angle_in_triangle(span, arm.d5, distance(point))
    return np.column_stack([-(3.0 * QUARTER - k - q), QUARTER + k - q])


def lowest_configuration(arm: NominalArm, point: Array) -> Array:
    """θ1 to θ4 with the elbow at the least Z below OP, (6) to (9), with θ3 = π for (8): (n, 4) [rad]."""
    theta1 = azimuth(point)
    theta4 = lowest_theta4(arm, point)[:, 0]
    return np.column_stack([theta1, lowest_theta2(arm, point), np.full_like(theta1, np.pi), theta4])


# The configurations between, for a given θ2: (10) to (13) ---------------------------------------------------------------


def crossing_height(arm: NominalArm, theta2: Array) -> Array:
    """Z of K, where the axis of joint 3 meets the base axis, (10): (n,) [m].

    K depends on θ2 only, so |KP| does not change with θ1 and θ3; this makes the construction exact. θ2 = 0 and -π put K at
    infinity and give NaN.
    """
    sine = np.abs(np.sin(np.asarray(theta2, dtype=np.float64)))
    return np.divide(arm.l2, sine, out=np.full_like(sine, np.nan), where=sine > 0.0)


def crossing_to_tube_end(arm: NominalArm, theta2: Array) -> Array:
    """Distance from K to C along the axis of joint 3, ``dk`` of (10): (n,) [m], negative where C has not reached K.

    The printed quotient of sines equals ``d3 - l2 cot|θ2|`` and changes its sign at |θ2| = arctan(l2/d3).
    """
    turned = np.abs(theta2) + np.arctan(arm.d3 / arm.l2) - QUARTER
    return np.asarray(np.sin(turned) * crossing_height(arm, theta2) / np.sin(np.arctan(arm.l2 / arm.d3)))


def cosine_theta42(arm: NominalArm, point: Array, theta2: Array) -> Array:
    """Cosine of the angle at E between K and P, θ42 of (11): (n,). Beyond ±1 no configuration has this θ2."""
    point = batch(point, 3, "point", "m")
    to_elbow = np.hypot(crossing_to_tube_end(arm, theta2), arm.l3)
    to_point = np.hypot(radius(point), height(point) - crossing_height(arm, theta2))
    return cosine_in_triangle(arm.d5, to_elbow, to_point)


def theta4_roots(arm: NominalArm, point: Array, theta2: Array) -> Array:
    """Both θ4 that (11) allows for a given θ2: (n, 2) [rad] in (-π, π].

    Corrected: the hypotenuse ``qdk`` has l3, not l2; and the triangle K, E, P has a mirror image about KE, the second
    column, which the print leaves out.
    """
    theta41 = np.arctan2(crossing_to_tube_end(arm, theta2), arm.l3)
    theta42 = arccos_or_nan(cosine_theta42(arm, point, theta2))
    return wrapped(-3.0 * QUARTER + theta41[:, None] + np.column_stack([theta42, -theta42]))


def cosine_theta1(arm: NominalArm, point: Array, theta2: Array, theta4: Array) -> Array:
    """Cosine of θ1 counted from the azimuth of P, (12) and (13): (n,). NaN or beyond ±1 where no configuration exists.

    Corrected: ``Vk``, the Z of C, is positive like the Z of K in (10), and ``Uk``, the radius of C along the arm's own
    vertical plane, keeps its sign. The guard printed with (13) is not a condition of existence; this cosine is.
    """
    opening = np.abs(theta2) + np.arctan(arm.d3 / arm.l2)  # uck of (10)
    uk = upper_tube_span(arm) * np.cos(np.pi - opening)
    vk = upper_tube_span(arm) * np.sin(np.pi - opening)
    squared = tube_end_to_point(arm, theta4) ** 2 - (vk - height(point)) ** 2  # Rq² of (12)
    rq = np.sqrt(squared, out=np.full_like(squared, np.nan), where=squared >= 0.0)
    both = 2.0 * radius(point) * uk
    cosine: Array = np.full_like(both, np.nan)
    np.divide(radius(point) ** 2 + uk**2 - rq**2, both, out=cosine, where=both != 0.0)
    return cosine


def theta1_pair(arm: NominalArm, point: Array, theta2: Array, theta4: Array) -> Array:
    """The two mirror-image θ1 of (13): (n, 2) [rad] in (-π, π]. Corrected: they are counted from the azimuth of P."""
    turn = arccos_or_nan(cosine_theta1(arm, point, theta2, theta4))
    return wrapped(azimuth(point)[:, None] + np.column_stack([turn, -turn]))


def theta3(arm: NominalArm, point: Array, theta1: Array, theta2: Array) -> Array:
    """θ3 for given θ1 and θ2: (n,) [rad] in (-π, π].

    The paper finds it "by comparison". Seen from frame 2, P lies off the axis of joint 3 by l3 + d5 sin|θ4|, which is
    positive inside the limits, in the direction of θ3.
    """
    point = batch(point, 3, "point", "m")
    turn = azimuth(point) - theta1
    ahead, aside = radius(point) * np.cos(turn), radius(point) * np.sin(turn)
    return np.asarray(np.arctan2(aside, ahead * np.cos(theta2) - point[:, 2] * np.sin(theta2) + arm.l2))


def configurations_at_theta2(arm: NominalArm, point: Array, theta2: Array) -> Array:
    """θ1 to θ4 of all configurations with a given θ2, (10) to (13): (n, 2, 2, 4) [rad], NaN where there is none.

    The second axis is the root of (11), the third the sign of (13). θ4 may be outside its limits.
    """
    found = np.empty((len(point), 2, 2, 4))
    found[..., 1] = np.asarray(theta2)[:, None, None]
    roots = theta4_roots(arm, point, theta2)
    for root in range(2):
        theta1 = theta1_pair(arm, point, theta2, roots[:, root])
        for mirror in range(2):
            found[:, root, mirror, 0] = theta1[:, mirror]
            found[:, root, mirror, 2] = theta3(arm, point, theta1[:, mirror], theta2)
            found[:, root, mirror, 3] = roots[:, root]
    found[np.isnan(found).any(axis=3)] = np.nan
    return found
