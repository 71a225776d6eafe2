"""Equations (2) to (13) of the paper, corrected: postures of the nominal arm by geometry.

**Height.** The vertical axis of the paper is opposite to the z axis of its DH table, ``Z = -z_DH``.
With the signs of Table 1, θ3 = 0 moves the elbow to the *smallest* z_DH, which the paper calls
highest. Points and joint angles are in the DH base frame. "Highest" and "lowest" refer to Z.

**Names.** Attributes have the names of the paper.

- O: the shoulder, origin of frame 1; P: the working point, origin of frame 5.
- E: the elbow, origin of frame 3, on the axis of joint 4.
- C: the end of the upper tube (E without the offset l3).
- K: the intersection of the axis of joint 3 and the base axis.

``-θ2`` and ``-θ4`` are the angles |θ2| and |θ4| of the paper, with the limits θ2, θ4 in [-π, 0].
All lengths are the magnitudes of :class:`NominalArm`. Points are (n, 3) [m] and angles (n,) [rad].
If a triangle does not close, the result is NaN.
"""

from __future__ import annotations

import numpy as np

from aacmm_pin._support.arrays import Array, wrapped
from papers.sino6.tables import NominalArm


def arccos_or_nan(cosine: Array) -> Array:
    """Inverse cosine [rad]; NaN if |cosine| > 1, because the triangle does not close."""
    return np.arccos(cosine, out=np.full(np.shape(cosine), np.nan), where=np.abs(cosine) <= 1.0)


def cosine_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Cosine of the angle between the sides ``near`` and ``far`` [m]; beyond ±1 if the triangle
    does not close.
    """
    return np.asarray((near**2 + far**2 - opposite**2) / (2.0 * near * far), dtype=np.float64)


def angle_in_triangle(near: Array | float, far: Array | float, opposite: Array | float) -> Array:
    """Angle between the sides ``near`` and ``far`` [rad]; NaN if the triangle does not close."""
    return arccos_or_nan(cosine_in_triangle(near, far, opposite))


def tube_end_to_point(arm: NominalArm, theta4: Array) -> Array:
    """|CP|, ``ken`` of (7), for a given θ4: (n,) [m]. Corrected: the sign of the sine of θ4."""
    return np.asarray(
        np.sqrt(arm.l3**2 + arm.d5**2 - 2.0 * arm.l3 * arm.d5 * np.cos(np.pi / 2 - theta4))
    )


class WorkingPoints:
    """Positions of the points P relative to the shoulder.

    Attributes:
        azimuth: θ1 of the planar postures, (2) and (6); the printed cases are atan2 modulo
            2π [rad].
        z: height Z in the figures of the paper [m].
        qk: distance from the base axis, ``Qk`` of (12) [m].
        den: |OP| of (3) [m].
    """

    def __init__(self, arm: NominalArm, point: Array) -> None:
        self.arm, self.z = arm, -point[:, 2]
        self.azimuth: Array = np.arctan2(point[:, 1], point[:, 0])
        self.qk: Array = np.hypot(point[:, 0], point[:, 1])
        self.den: Array = np.asarray(np.linalg.norm(point, axis=1))


class PlanarConfigurations(WorkingPoints):
    """The highest and the lowest posture, (2) to (9), θ1 to θ4: ``highest``, ``lowest`` (n, 4)
    [rad].

    The equations require that the arm faces P. If |θ4| exceeds 3π/2 - ∠k (179.4° for SINO6), the
    folded arm is the mirror image about OP of the highest posture, which (3) and (5) leave out. The
    lowest posture depends on the highest. If the highest is out of reach (|OP| > QD + d5), θ2 of
    the lowest is NaN.

    Attributes:
        len, qd, gen: |OC| of (3), |OE| at θ3 = 0 of (3) and at θ3 = π of (7) [m]. With the signs of
            the table, QD would be gen.
        k, q, theta4_max: angles at E from O to C and to P, and θ4 of the highest posture, (5).
            Corrected: 3π/2 (printed: 2π).
        theta2_max: θ2 of the highest posture, (3). Corrected: the1 is an angle of the triangle with
            the sides l2, QD and √(l3² + d3²); θ2 is the sum of the three angles minus π.
        thek: rotation of θ2 from the highest posture to the lowest, (7). The paper does not print
            θ2 of the lowest posture, θ2max - thek.
        theta4_min: θ4 of the lowest posture, (9), and of its mirror image about OP (n, 2), which
            the paper leaves out. Near the limit of the reach the mirror image is also within the
            limits: |θ4| below the angle with tangent (l2 + l3)/d3, 9.2° for SINO6.
        lowest_exists: whether the triangle of the lowest posture closes; the paper prints only one
            of the two conditions.
    """

    def __init__(self, arm: NominalArm, point: Array) -> None:
        super().__init__(arm, point)
        self.len, self.qd, self.gen = (
            float(np.hypot(x, arm.d3)) for x in (arm.l2, arm.l3 - arm.l2, arm.l3 + arm.l2)
        )
        the1 = angle_in_triangle(arm.l2, self.qd, np.hypot(arm.l3, arm.d3))
        the2 = angle_in_triangle(self.qd, self.den, arm.d5)
        self.theta2_max = the1 + the2 + np.arctan2(self.z, self.qk) - np.pi
        self.k, self.q = (
            angle_in_triangle(self.qd, arm.l3, self.len),
            angle_in_triangle(self.qd, arm.d5, self.den),
        )
        self.theta4_max = -(1.5 * np.pi - self.k - self.q)
        self.thek: Array = self.sweep_parts(tube_end_to_point(arm, self.theta4_max)).sum(axis=1)
        k = angle_in_triangle(self.gen, arm.l3, self.len)
        q = angle_in_triangle(self.gen, arm.d5, self.den)
        self.theta4_min = np.column_stack([-(1.5 * np.pi - k - q), np.pi / 2 + k - q])
        self.lowest_exists = (np.abs(self.gen - arm.d5) <= self.den) & (
            self.den <= self.gen + arm.d5
        )
        zero, theta2_min = np.zeros_like(self.den), self.theta2_max - self.thek
        self.highest = np.column_stack([self.azimuth, self.theta2_max, zero, self.theta4_max])
        self.lowest = np.column_stack(
            [self.azimuth, theta2_min, zero + np.pi, self.theta4_min[:, 0]]
        )

    def sweep_parts(self, ken: Array) -> Array:
        """``thek1``, ``thek2``, ``thek3`` of (7) for |CP| of the highest posture: (n, 3) [rad].

        Their sum is thek. They are angles at O: from C (highest) to P, from P to E (lowest), and
        from E to C.
        """
        thek1 = angle_in_triangle(self.len, self.den, ken)
        thek2 = angle_in_triangle(self.gen, self.den, self.arm.d5)
        return np.column_stack(
            [thek1, thek2, np.full_like(thek1, angle_in_triangle(self.gen, self.len, self.arm.l3))]
        )


class ConfigurationsAtTheta2(WorkingPoints):
    """The postures between highest and lowest, for a given θ2, (10) to (13).

    Attributes:
        zk: Z of K, (10) [m]; NaN for θ2 = 0 and -π, because K is at infinity. K depends only on θ2,
            so |KP| is constant for all θ1 and θ3, and the construction is exact.
        dk: distance from K to C along the axis of joint 3, (10) [m]; negative if C is before K. The
            printed quotient of sines equals ``d3 - l2 cot|θ2|``.
        theta4: both solutions θ4 of (11) (n, 2) in [-π, π). The second column is the mirror image
            of the triangle K, E, P about KE, which the paper leaves out.
        uk, vk: radius of C in the vertical plane of the arm, with its sign, and Z of C, (12) [m].
            Corrected: Vk is positive like Z of K.
    """

    def __init__(self, arm: NominalArm, point: Array, theta2: Array) -> None:
        super().__init__(arm, point)
        self.theta2, sine = theta2, np.abs(np.sin(theta2))
        self.zk = np.divide(arm.l2, sine, out=np.full_like(sine, np.nan), where=sine > 0.0)
        uck = np.abs(theta2) + np.arctan(arm.d3 / arm.l2)
        self.dk = np.sin(uck - np.pi / 2) * self.zk / np.sin(np.arctan(arm.l2 / arm.d3))
        theta42 = arccos_or_nan(self.cosine_theta42(arm.l3))
        turned = np.arctan2(self.dk, arm.l3)[:, None] + np.column_stack([theta42, -theta42])
        self.theta4 = wrapped(turned - 1.5 * np.pi)
        span = np.hypot(arm.l2, arm.d3)
        self.uk, self.vk = span * np.cos(np.pi - uck), span * np.sin(np.pi - uck)

    def cosine_theta42(self, l3: float) -> Array:
        """Cosine of the angle at E between K and P, θ42 of (11): (n,).

        If it is beyond ±1, no posture has this θ2. Corrected: the hypotenuse ``qdk`` contains
        ``l3`` (printed: l2).
        """
        return cosine_in_triangle(
            self.arm.d5, np.hypot(self.dk, l3), np.hypot(self.qk, self.z - self.zk)
        )

    def rq(self, theta4: Array, vk: Array) -> Array:
        """Horizontal distance of C and P, ``Rq`` of (12), for the height ``vk`` of C: (n,) [m].

        If no such distance exists, the value is NaN.
        """
        squared = tube_end_to_point(self.arm, theta4) ** 2 - (vk - self.z) ** 2
        return np.sqrt(squared, out=np.full_like(squared, np.nan), where=squared >= 0.0)

    def cosine_theta1(self, theta4: Array) -> Array:
        """Cosine of θ1 relative to the azimuth of P, (12) and (13): (n,).

        If no posture exists, the value is NaN or beyond ±1. The condition printed with (13) does
        not determine the existence. Corrected: ``Uk`` keeps its sign.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return cosine_in_triangle(self.qk, self.uk, self.rq(theta4, self.vk))

    def theta3(self, theta1: Array) -> Array:
        """θ3 for given θ1: (n,) [rad] in [-π, π].

        The paper finds θ3 "by comparison". In frame 2, P has the distance l3 + d5 sin|θ4| from the
        axis of joint 3, in the direction of θ3. The distance is positive within the limits.
        """
        ahead = self.qk * np.cos(self.azimuth - theta1)
        aside = self.qk * np.sin(self.azimuth - theta1)
        return np.asarray(
            np.arctan2(
                aside, ahead * np.cos(self.theta2) + self.z * np.sin(self.theta2) + self.arm.l2
            )
        )

    def all(self) -> Array:
        """θ1 to θ4 of all postures: (n, 2, 2, 4) [rad]; NaN if no posture exists.

        θ4 may be outside its limits. The second axis is the root of (11), and the third axis the
        sign in (13), of θ1 relative to the azimuth of P.
        """
        found = np.empty((len(self.theta2), 2, 2, 4))
        for root, theta4 in enumerate(self.theta4.T):
            turn = arccos_or_nan(self.cosine_theta1(theta4))
            for mirror, sign in enumerate((1.0, -1.0)):
                theta1 = wrapped(self.azimuth + sign * turn)
                found[:, root, mirror] = np.column_stack(
                    [theta1, self.theta2, self.theta3(theta1), theta4]
                )
        found[~np.isfinite(found).all(axis=-1)] = np.nan
        return found
