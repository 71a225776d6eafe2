"""Misprints in equations (3) to (13), each with the size of the error that it causes alone.

Each size comes from random postures within the joint limits, with one printed equation and
everything else correct. With the printed sign of ken in (7) or of Vk in (12), Table 2 of the paper
does not result. These two are therefore misprints, and no errors of the authors' program. l2 in
(11), ``|Uk|`` and the condition of (13) hardly change Table 2.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array, wrapped
from aacmm_pin._support.units import DEG, MM
from papers.sino6.equations import (
    ConfigurationsAtTheta2,
    PlanarConfigurations,
    angle_in_triangle,
    arccos_or_nan,
    tube_end_to_point,
)
from papers.sino6.tables import NominalArm, sino6_nominal

WRONG = 1e-9
"""A difference above this value counts as wrong [m or rad]; rounding is far smaller for nearly all
postures.
"""
COLUMNS = [
    "equation",
    "printed",
    "corrected",
    "cosine",
    "median_angle_error_deg",
    "median_length_error_mm",
]
SHARES = ["affected_share", "no_answer_share", "false_share"]
Row = tuple[str, str, str, dict[str, float]]
"""Number of the equation, printed form, correct form, and sizes by column."""


def misprints(rng: np.random.Generator, samples: int = 20_000) -> pd.DataFrame:
    """One row for each misprint, in the order of the equations.

    Columns: equation, printed, corrected; cosine, if the printed form gives one value beyond ±1
    for every point; median_angle_error_deg and median_length_error_mm, over the postures with a
    wrong answer; affected_share, the share of postures with a wrong or missing answer;
    no_answer_share, the share without a real answer; false_share, the share of impossible cases
    that a printed condition accepts. A size without a meaning is NaN.
    """
    arm, upper = sino6_nominal(), np.array([2.0 * np.pi, 0.0, 2.0 * np.pi, 0.0])
    q = rng.uniform(upper - np.array([2.0, 1.0, 2.0, 1.0]) * np.pi, upper, (samples, 4))
    other_theta2 = rng.uniform(-np.pi, 0.0, samples)  # most of them belong to no posture
    rows = [
        *_of_highest(arm, q),
        *_of_lowest(arm, q),
        *_of_theta4(arm, q),
        *_of_theta1(arm, q, other_theta2),
    ]
    return pd.DataFrame(
        [dict(zip(COLUMNS[:3], texts, strict=True)) | sizes for *texts, sizes in rows],
        columns=COLUMNS + SHARES,
    )


def _points(arm: NominalArm, q: Array) -> Array:
    return arm.dh.chain.positions(np.column_stack([q, np.zeros(len(q))]))


def _planar(arm: NominalArm, q: Array, theta3: float) -> tuple[Array, Array, PlanarConfigurations]:
    """θ2 and θ4 (n,) [rad] of the postures with this θ3 whose base faces P, and the results of (2)
    to (9).
    """
    q = np.column_stack([q[:, :2], np.full(len(q), theta3), q[:, 3]])
    p = _points(arm, q)
    towards = np.cos(q[:, 0]) * p[:, 0] + np.sin(q[:, 0]) * p[:, 1] > 0.0
    if theta3 == 0.0:
        # without the mirror image of the highest posture
        towards &= -q[:, 3] < 1.5 * np.pi - PlanarConfigurations(arm, p).k
    return q[towards, 1], q[towards, 3], PlanarConfigurations(arm, p[towards])


def _angle(printed: Array, true: Array) -> dict[str, float]:
    """Sizes for an angle [rad]."""
    error, answered = np.abs(wrapped(printed - true)), np.isfinite(printed)
    wrong = answered & (error > WRONG)
    return {
        "median_angle_error_deg": float(np.median(error[wrong])) / DEG if wrong.any() else np.nan,
        "affected_share": float((wrong | ~answered).mean()),
        "no_answer_share": float((~answered).mean()),
    }


def _length(printed: Array | float, true: Array | float) -> dict[str, float]:
    """Sizes for a length [m]."""
    error = np.abs(np.atleast_1d(printed) - true)
    return {
        "median_length_error_mm": float(np.median(error)) / MM,
        "affected_share": float((error > WRONG).mean()),
    }


def _of_highest(arm: NominalArm, q: Array) -> list[Row]:
    """Misprints of (3) and (5), and of ken in (7)."""
    theta2, theta4, right = _planar(arm, q, 0.0)
    l2, qd, bracket = arm.l2 / MM, right.qd / MM, np.hypot(arm.l3, arm.d5) / MM
    the1 = {
        "cosine": (l2**2 + qd**2 - bracket) / (2.0 * l2 * qd),
        "affected_share": 1.0,
        "no_answer_share": 1.0,
    }
    theta2_max = _angle(right.theta2_max + np.pi, theta2)
    theta4_max = _angle(-(2.0 * np.pi - right.k - right.q), theta4)
    signed = _angle(-(1.5 * np.pi - right.k - (np.pi - right.q)), theta4)
    ken = _length(tube_end_to_point(arm, -theta4), tube_end_to_point(arm, theta4))
    return [
        ("3", "the1 with √(l3² + d5²)", "the1 with (l3² + d3²)", the1),
        ("3", "QD with the signs of Table 1", "QD with magnitudes", _length(right.gen, right.qd)),
        ("3", "θ2max = the1 + the2 + the3", "θ2max = the1 + the2 + the3 - π", theta2_max),
        ("5", "θ4max = -(2π - ∠k - ∠q)", "θ4max = -(3π/2 - ∠k - ∠q)", theta4_max),
        ("5", "d5 with the sign of Table 1", "|d5|", signed),
        ("7", "ken with cos(π/2 + θ4max)", "ken with cos(π/2 - θ4max)", ken),
    ]


def _of_lowest(arm: NominalArm, q: Array) -> list[Row]:
    """Misprints of (7) and (9)."""
    theta4, lowest = _planar(arm, q, np.pi)[1:]
    reached = np.isfinite(lowest.theta2_max)
    as_last_line = _angle(lowest.thek[reached], lowest.lowest[reached, 1])
    every = PlanarConfigurations(arm, _points(arm, q))
    exists, accepted = every.lowest_exists, every.den + arm.d5 >= every.gen
    shares = {
        "affected_share": float((accepted != exists).mean()),
        "false_share": float(accepted[~exists].mean()),
    }
    mirror = _angle(lowest.theta4_min[:, 0], theta4)
    return [
        ("7", "the last line is thek", "θ2min = θ2max - thek", as_last_line),
        ("7", "exists if den + |d5| >= gen", "exists if |gen - |d5|| <= den <= gen + |d5|", shares),
        ("9", "one root", "also its mirror image, θ4 = π/2 + ∠k - ∠q", mirror),
    ]


def _of_theta4(arm: NominalArm, q: Array) -> list[Row]:
    """Misprints of (10) and (11)."""
    p, theta2, theta4 = _points(arm, q), q[:, 1], q[:, 3]
    planar, at = PlanarConfigurations(arm, p), ConfigurationsAtTheta2(arm, p, theta2)
    ends = np.isfinite(planar.theta2_max) & planar.lowest_exists
    inside = (theta2 <= planar.theta2_max + WRONG) & (theta2 >= planar.lowest[:, 1] - WRONG)
    theta41 = angle_in_triangle(arm.l3, np.hypot(at.dk, arm.l2), at.dk)
    with_l2 = -1.5 * np.pi + theta41 + arccos_or_nan(at.cosine_theta42(arm.l2))
    first = np.abs(wrapped(at.theta4 - theta4[:, None])).argmin(axis=1) == 0
    range_shares = {"affected_share": float((~inside[ends]).mean())}
    return [
        (
            "10",
            "every θ2 lies in (θ2min, θ2max)",
            "also θ2 of the base that faces away",
            range_shares,
        ),
        ("11", "qdk = √(dk² + l2²)", "qdk = √(dk² + l3²)", _angle(with_l2[first], theta4[first])),
        ("11", "one root, θ41 + θ42", "also θ41 - θ42", _angle(at.theta4[:, 0], theta4)),
    ]


def _of_theta1(arm: NominalArm, q: Array, other_theta2: Array) -> list[Row]:
    """Misprints of (12) and (13)."""
    p, theta4 = _points(arm, q), q[:, 3]
    at = ConfigurationsAtTheta2(arm, p, q[:, 1])
    other = ConfigurationsAtTheta2(arm, p, other_theta2)
    true = np.abs(wrapped(q[:, 0] - at.azimuth))

    def accepted(at: ConfigurationsAtTheta2, theta4: Array) -> Array:
        """Qk + Dq - Rq > 1 mm (n,); false if Rq is not real."""
        return np.asarray(at.qk + np.abs(at.uk) - at.rq(theta4, at.vk) > 1.0 * MM)

    downwards = angle_in_triangle(at.qk, at.uk, at.rq(theta4, -at.vk))
    unsigned = angle_in_triangle(at.qk, np.abs(at.uk), at.rq(theta4, at.vk))
    missing = ~(np.abs(other.cosine_theta1(other.theta4[:, 0])) <= 1.0)
    shares = {
        "affected_share": float(1.0 - accepted(at, theta4).mean()),
        "false_share": float(accepted(other, other.theta4[:, 0])[missing].mean()),
    }
    return [
        (
            "12",
            "Vk = -len sin(π - uck) with Z upwards",
            "Vk = len sin(π - uck)",
            _angle(downwards, true),
        ),
        ("12", "Dq = |Uk|", "Dq = Uk with its sign", _angle(unsigned, true)),
        ("13", "exists if Qk + Dq - Rq > 1 mm", "exists if |cos θ1| <= 1 and Rq is real", shares),
    ]
