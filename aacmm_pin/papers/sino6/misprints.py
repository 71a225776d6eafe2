"""Where the printed equations (3) to (13) are wrong, each with the size of the error that it makes alone.

Every size is measured: the printed form and the corrected one run on the same random configurations inside the joint limits,
all else correct. With the printed sign of ken in (7) or of Vk in (12) the paper's own Table 2 does not come out, so these
at least are slips of the print and not of the authors' program; l2 in (11), |Uk| and the guard of (13) hardly touch it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.angles import wrapped
from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.papers.sino6.equations import (
    ConfigurationsAtTheta2,
    PlanarConfigurations,
    angle_in_triangle,
    arccos_or_nan,
    cosine_in_triangle,
    tube_end_to_point,
)
from aacmm_pin.papers.sino6.tables import NominalArm, sino6_nominal

WRONG = 1e-9
"""A difference above this counts as wrong [m or rad]; rounding stays far below it for nearly all configurations."""
COLUMNS = ["equation", "printed", "corrected", "cosine", "median_angle_error_deg", "median_length_error_mm"]
SHARES = ["affected_share", "no_answer_share", "false_share"]
Row = tuple[str, str, str, dict[str, float]]
"""Number of the equation, what is printed, what is right, and the sizes that have a meaning."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Random configurations inside the limits, and the points P that the nominal arm reaches with them.

    Attributes:
        q: any θ3, (n, 4) [rad]; p: its points (n, 3) [m].
        highest, highest_p: the same with θ3 = 0, where the base looks towards P and (3), (5) apply.
        lowest, lowest_p: the same with θ3 = π, where the base looks towards P.
        other_theta2: a random θ2 for each of ``p``, which most often no configuration has, (n,) [rad].
    """

    arm: NominalArm
    q: Array
    p: Array
    highest: Array
    highest_p: Array
    lowest: Array
    lowest_p: Array
    other_theta2: Array


def misprints(rng: np.random.Generator, samples: int = 20_000) -> pd.DataFrame:
    """All misprints in the order of the equations, one row each.

    Columns: equation, printed, corrected; cosine, where the print gives the same value beyond ±1 for every point;
    median_angle_error_deg and median_length_error_mm, over the configurations that are affected and still have an
    answer; affected_share of the true configurations, for which the printed answer is wrong or missing; no_answer_share,
    for which it is not real; false_share, of wrongly accepted cases among those without a configuration, for printed
    conditions. NaN where a size has no meaning.
    """
    s = draw_sample(rng, samples)
    rows = [*_of_highest(s), *_of_lowest(s), *_of_theta4(s), *_of_theta1(s)]
    return pd.DataFrame(
        [dict(zip(COLUMNS[:3], texts, strict=True)) | sizes for *texts, sizes in rows], columns=COLUMNS + SHARES
    )


def draw_sample(rng: np.random.Generator, samples: int) -> Sample:
    """Configurations uniform within the limits of θ1 to θ4, their points, and a second, unrelated θ2 for each."""
    arm = sino6_nominal()
    upper = np.array([2.0 * np.pi, 0.0, 2.0 * np.pi, 0.0])
    q = rng.uniform(upper - np.array([2.0, 1.0, 2.0, 1.0]) * np.pi, upper, (samples, 4))
    highest, highest_p = _planar(arm, q, 0.0)
    unfolded = -highest[:, 3] < 1.5 * np.pi - PlanarConfigurations(arm, highest_p).k
    other = rng.uniform(-np.pi, 0.0, samples)
    return Sample(arm, q, _points(arm, q), highest[unfolded], highest_p[unfolded], *_planar(arm, q, np.pi), other)


def _planar(arm: NominalArm, q: Array, theta3: float) -> tuple[Array, Array]:
    """The configurations with this θ3 whose base looks towards P, and their points."""
    q = np.column_stack([q[:, :2], np.full(len(q), theta3), q[:, 3]])
    p = _points(arm, q)
    towards = np.cos(q[:, 0]) * p[:, 0] + np.sin(q[:, 0]) * p[:, 1] > 0.0
    return q[towards], p[towards]


def _points(arm: NominalArm, q: Array) -> Array:
    return arm.dh.positions(np.column_stack([q, np.zeros(len(q))]))


def _cosine(value: float) -> dict[str, float]:
    """Sizes of a cosine that none is [1]."""
    return {"cosine": value, "affected_share": 1.0, "no_answer_share": 1.0}


def _angle(printed: Array, true: Array) -> dict[str, float]:
    """Sizes of a wrong angle [rad]."""
    error, answered = np.abs(wrapped(printed - true)), np.isfinite(printed)
    wrong = answered & (error > WRONG)
    return {
        "median_angle_error_deg": float(np.median(error[wrong])) / DEG if wrong.any() else np.nan,
        "affected_share": float((wrong | ~answered).mean()),
        "no_answer_share": float((~answered).mean()),
    }


def _length(printed: Array | float, true: Array | float) -> dict[str, float]:
    """Sizes of a wrong length [m]."""
    error = np.abs(np.atleast_1d(printed) - true)
    return {"median_length_error_mm": float(np.median(error)) / MM, "affected_share": float((error > WRONG).mean())}


def _of_highest(s: Sample) -> Iterator[Row]:
    """Of (3) and (5)."""
    arm, right, theta2, theta4 = s.arm, PlanarConfigurations(s.arm, s.highest_p), s.highest[:, 1], s.highest[:, 3]
    l2, qd, bracket = arm.l2 / MM, right.qd / MM, np.hypot(arm.l3, arm.d5) / MM
    corrected = "the1 with (l3² + d3²)"
    yield "3", "the1 with √(l3² + d5²)", corrected, _cosine((l2**2 + qd**2 - bracket) / (2.0 * l2 * qd))
    restored = _cosine(float(cosine_in_triangle(l2, qd, bracket)))
    yield "3", "the1 with (l3² + d5²), the square alone restored", corrected, restored
    yield "3", "QD with the signs of Table 1", "QD with magnitudes", _length(right.gen, right.qd)
    turned = _angle(right.theta2_max + np.pi, theta2)
    yield "3", "θ2max = the1 + the2 + the3", "θ2max = the1 + the2 + the3 - π", turned
    printed = -(2.0 * np.pi - right.k - right.q)
    yield "5", "θ4max = -(2π - ∠k - ∠q)", "θ4max = -(3π/2 - ∠k - ∠q)", _angle(printed, theta4)
    signed = -(1.5 * np.pi - right.k - (np.pi - right.q))
    yield "5", "d5 with the sign of Table 1", "|d5|", _angle(signed, theta4)


def _of_lowest(s: Sample) -> Iterator[Row]:
    """Of (7) and (9)."""
    arm, right, theta4 = s.arm, PlanarConfigurations(s.arm, s.highest_p), s.highest[:, 3]
    ken, printed = tube_end_to_point(arm, theta4), tube_end_to_point(arm, -theta4)
    yield "7", "ken with cos(π/2 + θ4max)", "ken with cos(π/2 - θ4max)", _length(printed, ken)
    both = tube_end_to_point(arm, np.pi / 2 - right.theta4_max)
    yield "7", "ken and θ4max both as printed", "both corrected", _length(both, ken)
    sweeps = [right.sweep_parts(each).sum(axis=1)[right.lowest_exists] for each in (printed, ken)]
    yield "7", "thek by the printed ken", "thek by the corrected ken", _angle(*sweeps)
    lowest = PlanarConfigurations(arm, s.lowest_p)
    reached = np.isfinite(lowest.theta2_max)
    as_last_line = _angle(lowest.thek[reached], lowest.lowest[reached, 1])
    yield "7", "thek as the last line", "θ2min = θ2max - thek", as_last_line
    every = PlanarConfigurations(arm, s.p)
    exists, accepted = every.lowest_exists, every.den + arm.d5 >= every.gen
    shares = {"affected_share": float((accepted != exists).mean()), "false_share": float(accepted[~exists].mean())}
    yield "7", "exists if den + |d5| >= gen", "exists if |gen - |d5|| <= den <= gen + |d5|", shares
    one_root = _angle(lowest.theta4_min[:, 0], s.lowest[:, 3])
    yield "9", "one root", "its mirror image θ4 = π/2 + ∠k - ∠q as well", one_root


def _of_theta4(s: Sample) -> Iterator[Row]:
    """Of (10) and (11)."""
    theta2, theta4, planar = s.q[:, 1], s.q[:, 3], PlanarConfigurations(s.arm, s.p)
    ends = np.isfinite(planar.theta2_max) & planar.lowest_exists
    inside = (theta2 <= planar.theta2_max + WRONG) & (theta2 >= planar.lowest[:, 1] - WRONG)
    outside = {"affected_share": float((~inside[ends]).mean())}
    yield "10", "every θ2 lies in (θ2min, θ2max)", "also θ2 of the base turned round", outside
    at = ConfigurationsAtTheta2(s.arm, s.p, theta2)
    theta41 = angle_in_triangle(s.arm.l3, np.hypot(at.dk, s.arm.l2), at.dk)
    printed = -1.5 * np.pi + theta41 + arccos_or_nan(at.cosine_theta42(s.arm.l2))
    first = np.abs(wrapped(at.theta4 - theta4[:, None])).argmin(axis=1) == 0
    yield "11", "qdk = √(dk² + l2²)", "qdk = √(dk² + l3²)", _angle(printed[first], theta4[first])
    yield "11", "one root, θ41 + θ42", "θ41 - θ42 as well", _angle(at.theta4[:, 0], theta4)


def _of_theta1(s: Sample) -> Iterator[Row]:
    """Of (12) and (13)."""
    at, theta4 = ConfigurationsAtTheta2(s.arm, s.p, s.q[:, 1]), s.q[:, 3]
    true = np.abs(wrapped(s.q[:, 0] - at.azimuth))

    def guard(at: ConfigurationsAtTheta2, theta4: Array) -> NDArray[np.bool_]:
        """Qk + Dq - Rq > 1 mm, false where Rq is not real: (n,)."""
        return np.asarray(at.qk + np.abs(at.uk) - at.rq(theta4, at.vk) > 1.0 * MM)

    downwards = angle_in_triangle(at.qk, at.uk, at.rq(theta4, -at.vk))
    yield "12", "Vk = -len sin(π - uck) with Z upwards", "Vk = len sin(π - uck)", _angle(downwards, true)
    unsigned = angle_in_triangle(at.qk, np.abs(at.uk), at.rq(theta4, at.vk))
    yield "12", "Dq = |Uk|", "Dq = Uk with its sign", _angle(unsigned, true)
    other = ConfigurationsAtTheta2(s.arm, s.p, s.other_theta2)
    missing = ~(np.abs(other.cosine_theta1(other.theta4[:, 0])) <= 1.0)
    shares = {
        "affected_share": float((~guard(at, theta4)).mean()),
        "false_share": float(guard(other, other.theta4[:, 0])[missing].mean()),
    }
    yield "13", "exists if Qk + Dq - Rq > 1 mm", "exists if |cos θ1| <= 1 and Rq is real", shares
