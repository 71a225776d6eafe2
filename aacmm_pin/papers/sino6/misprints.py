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
from aacmm_pin.papers.sino6 import equations as eq
from aacmm_pin.papers.sino6.tables import NominalArm, sino6_nominal

WRONG = 1e-9
"""A difference above this counts as wrong [m or rad]; rounding stays far below it for nearly all configurations."""
SIZES = ("cosine", "median_angle_error_deg", "median_length_error_mm", "affected_share", "no_answer_share", "false_share")
Row = tuple[str, str, str, dict[str, float]]
"""Number of the equation, what is printed, what is right, and the sizes that have a meaning."""
NO_ANGLE = {"affected_share": 1.0, "no_answer_share": 1.0}


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
    sample = draw_sample(rng, samples)
    rows = [*_of_highest(sample), *_of_lowest(sample), *_of_theta4(sample), *_of_theta1(sample)]
    table = pd.DataFrame([(equation, printed, right) for equation, printed, right, _ in rows])
    sizes = pd.DataFrame([size for *_, size in rows], columns=SIZES)
    return table.set_axis(["equation", "printed", "corrected"], axis=1).join(sizes)


def draw_sample(rng: np.random.Generator, samples: int) -> Sample:
    """Configurations uniform within the limits of θ1 to θ4, their points, and a second, unrelated θ2 for each."""
    arm = sino6_nominal()
    upper = np.array([2.0 * np.pi, 0.0, 2.0 * np.pi, 0.0])
    q = rng.uniform(upper - np.array([2.0, 1.0, 2.0, 1.0]) * np.pi, upper, (samples, 4))
    highest, highest_p = _planar(arm, q, 0.0)
    unfolded = -highest[:, 3] < 1.5 * np.pi - eq.angles_at_elbow(arm, highest_p, eq.highest_elbow_span(arm))[0]
    lowest, lowest_p = _planar(arm, q, np.pi)
    other = rng.uniform(-np.pi, 0.0, samples)
    return Sample(arm, q, _points(arm, q), highest[unfolded], highest_p[unfolded], lowest, lowest_p, other)


def _planar(arm: NominalArm, q: Array, theta3: float) -> tuple[Array, Array]:
    """The configurations with this θ3 whose base looks towards P, and their points."""
    q = q.copy()
    q[:, 2] = theta3
    p = _points(arm, q)
    towards = np.cos(q[:, 0]) * p[:, 0] + np.sin(q[:, 0]) * p[:, 1] > 0.0
    return q[towards], p[towards]


def _points(arm: NominalArm, q: Array) -> Array:
    return arm.dh.positions(np.column_stack([q, np.zeros(len(q))]))


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


def _printed_theta4(s: Sample) -> Array:
    return eq.highest_theta4(s.arm, s.highest_p) - np.pi / 2


def _of_highest(s: Sample) -> Iterator[Row]:
    """Of (3) and (5)."""
    arm, p, theta2, theta4 = s.arm, s.highest_p, s.highest[:, 1], s.highest[:, 3]
    span = eq.highest_elbow_span(arm)
    l2, qd, bracket = arm.l2 / MM, span / MM, np.hypot(arm.l3, arm.d5) / MM
    right = "the1 with (l3² + d3²)"
    yield "3", "the1 with √(l3² + d5²)", right, {"cosine": (l2**2 + qd**2 - bracket) / (2.0 * l2 * qd)} | NO_ANGLE
    restored = {"cosine": float(eq.cosine_in_triangle(l2, qd, bracket))} | NO_ANGLE
    yield "3", "the1 with (l3² + d5²), the square alone restored", right, restored
    signed = _length(np.hypot(arm.l3 + arm.l2, arm.d3), span)
    yield "3", "QD with the signs of Table 1", "QD with magnitudes", signed
    turned = _angle(eq.highest_theta2(arm, p) + np.pi, theta2)
    yield "3", "θ2max = the1 + the2 + the3", "θ2max = the1 + the2 + the3 - π", turned
    yield "5", "θ4max = -(2π - ∠k - ∠q)", "θ4max = -(3π/2 - ∠k - ∠q)", _angle(_printed_theta4(s), theta4)
    k, q = eq.angles_at_elbow(arm, p, span)
    yield "5", "d5 with the sign of Table 1", "|d5|", _angle(-(1.5 * np.pi - k - (np.pi - q)), theta4)


def _of_lowest(s: Sample) -> Iterator[Row]:
    """Of (7) and (9)."""

    def printed_ken(theta4: Array) -> Array:
        return eq.tube_end_to_point(s.arm, -theta4)

    arm, theta4 = s.arm, s.highest[:, 3]
    ken = eq.tube_end_to_point(arm, theta4)
    yield "7", "ken with cos(π/2 + θ4max)", "ken with cos(π/2 - θ4max)", _length(printed_ken(theta4), ken)
    yield "7", "ken and θ4max both as printed", "both corrected", _length(printed_ken(_printed_theta4(s)), ken)
    closes = eq.lowest_exists(arm, s.highest_p)
    sweeps = [
        eq.theta2_sweep_parts(arm, s.highest_p[closes], each[closes]).sum(axis=1) for each in (printed_ken(theta4), ken)
    ]
    yield "7", "thek by the printed ken", "thek by the corrected ken", _angle(*sweeps)
    p = s.lowest_p[np.isfinite(eq.highest_theta2(arm, s.lowest_p))]
    yield "7", "thek as the last line", "θ2min = θ2max - thek", _angle(eq.theta2_sweep(arm, p), eq.lowest_theta2(arm, p))
    exists, printed = eq.lowest_exists(arm, s.p), eq.distance(s.p) + arm.d5 >= eq.lowest_elbow_span(arm)
    shares = {"affected_share": float((printed != exists).mean()), "false_share": float(printed[~exists].mean())}
    yield "7", "exists if den + |d5| >= gen", "exists if |gen - |d5|| <= den <= gen + |d5|", shares
    one_root = _angle(eq.lowest_theta4(arm, s.lowest_p)[:, 0], s.lowest[:, 3])
    yield "9", "one root", "its mirror image θ4 = π/2 + ∠k - ∠q as well", one_root


def _of_theta4(s: Sample) -> Iterator[Row]:
    """Of (10) and (11)."""
    arm, theta2, theta4 = s.arm, s.q[:, 1], s.q[:, 3]
    reachable = np.isfinite(eq.highest_theta2(arm, s.p)) & eq.lowest_exists(arm, s.p)
    p, own = s.p[reachable], theta2[reachable]
    inside = (own <= eq.highest_theta2(arm, p) + WRONG) & (own >= eq.lowest_theta2(arm, p) - WRONG)
    outside = {"affected_share": float((~inside).mean())}
    yield "10", "every θ2 lies in (θ2min, θ2max)", "also θ2 of the base turned round", outside
    along = eq.crossing_to_tube_end(arm, theta2)
    theta41 = eq.angle_in_triangle(arm.l3, np.hypot(along, arm.l2), along)
    printed = -1.5 * np.pi + theta41 + eq.arccos_or_nan(eq.cosine_theta42(arm, s.p, theta2, arm.l2))
    roots = eq.theta4_roots(arm, s.p, theta2)
    off = np.abs(wrapped(roots - theta4[:, None]))
    first = off[:, 0] <= off[:, 1]
    yield "11", "qdk = √(dk² + l2²)", "qdk = √(dk² + l3²)", _angle(printed[first], theta4[first])
    yield "11", "one root, θ41 + θ42", "θ41 - θ42 as well", _angle(roots[:, 0], theta4)


def _of_theta1(s: Sample) -> Iterator[Row]:
    """Of (12) and (13)."""
    arm, theta2, theta4 = s.arm, s.q[:, 1], s.q[:, 3]
    uk, vk = eq.tube_end(arm, theta2)
    true = np.abs(wrapped(s.q[:, 0] - eq.azimuth(s.p)))

    def turn(uk: Array, vk: Array) -> Array:
        """θ1 counted from the azimuth by (12) and (13), at the true θ4."""
        rq = eq.root_or_nan(eq.tube_end_to_point(arm, theta4) ** 2 - (vk - eq.height(s.p)) ** 2)
        return eq.arccos_or_nan(eq.cosine_in_triangle(eq.radius(s.p), uk, rq))

    def guard(theta2: Array, theta4: Array) -> NDArray[np.bool_]:
        """Qk + Dq - Rq > 1 mm, false where Rq is not real: (n,)."""
        uk, vk = eq.tube_end(arm, theta2)
        rq = eq.root_or_nan(eq.tube_end_to_point(arm, theta4) ** 2 - (vk - eq.height(s.p)) ** 2)
        return np.asarray(eq.radius(s.p) + np.abs(uk) - rq > 1.0 * MM)

    yield "12", "Vk = -len sin(π - uck) with Z upwards", "Vk = len sin(π - uck)", _angle(turn(uk, -vk), true)
    yield "12", "Dq = |Uk|", "Dq = Uk with its sign", _angle(turn(np.abs(uk), vk), true)
    other = eq.theta4_roots(arm, s.p, s.other_theta2)[:, 0]
    missing = ~(np.abs(eq.cosine_theta1(arm, s.p, s.other_theta2, other)) <= 1.0)
    shares = {
        "affected_share": float((~guard(theta2, theta4)).mean()),
        "false_share": float(guard(s.other_theta2, other)[missing].mean()),
    }
    yield "13", "exists if Qk + Dq - Rq > 1 mm", "exists if |cos θ1| <= 1 and Rq is real", shares
