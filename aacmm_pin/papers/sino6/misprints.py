"""Where the printed equations (3) to (13) are wrong, each with the size of the error that it makes alone.

Every size is measured: the printed form and the corrected one run on the same random configurations inside the joint limits,
all else correct. With the printed sign of ken in (7) or of Vk in (12) the paper's own Table 2 does not come out, so these
at least are slips of the print and not of the authors' program; l2 in (11), |Uk| and the guard of (13) hardly touch it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.papers.sino6 import equations as eq
from aacmm_pin.papers.sino6.nominal import NominalArm, sino6_nominal

Flags = NDArray[np.bool_]

WRONG = 1e-9
"""A difference above this counts as wrong [m or rad]; rounding stays far below it for nearly all configurations."""


@dataclass(frozen=True)
class Size:
    """How wrong a misprint is; NaN where a figure has no meaning.

    Attributes:
        cosine: the value that the print gives for a cosine, where it is the same for every point and beyond ±1.
        median_angle_error_deg: median over the configurations that are affected and still have an answer.
        median_length_error_mm: the same for a length.
        affected_share: share of true configurations for which the printed answer is wrong or missing.
        no_answer_share: share of true configurations for which the printed form has no real answer.
        false_share: share of wrongly accepted cases among those without a configuration, for printed conditions.
    """

    cosine: float = np.nan
    median_angle_error_deg: float = np.nan
    median_length_error_mm: float = np.nan
    affected_share: float = np.nan
    no_answer_share: float = np.nan
    false_share: float = np.nan


@dataclass(frozen=True, eq=False)
class Sample:
    """Random configurations inside the limits, and the points P that the nominal arm reaches with them.

    Attributes:
        arm: the nominal arm.
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


@dataclass(frozen=True)
class Misprint:
    """One misprint: the equation's number, what is printed, what is right, and how to measure the difference."""

    equation: str
    printed: str
    corrected: str
    measure: Callable[[Sample], Size]


def misprints(rng: np.random.Generator, samples: int = 20_000) -> pd.DataFrame:
    """All misprints with the measured size of each, one row a misprint; columns as in :class:`Misprint` and :class:`Size`.

    Args:
        rng: source of the configurations.
        samples: number of configurations.
    """
    sample = draw_sample(rng, samples)
    return pd.DataFrame(
        [
            {"equation": m.equation, "printed": m.printed, "corrected": m.corrected, **asdict(m.measure(sample))}
            for m in MISPRINTS
        ]
    )


def draw_sample(rng: np.random.Generator, samples: int, arm: NominalArm | None = None) -> Sample:
    """Configurations uniform within the limits of θ1 to θ4, their points, and a second, unrelated θ2 for each."""
    arm = arm or sino6_nominal()
    upper = np.array([2.0 * np.pi, 0.0, 2.0 * np.pi, 0.0])
    q = rng.uniform(upper - np.array([2.0, 1.0, 2.0, 1.0]) * np.pi, upper, (samples, 4))
    highest, highest_p = _planar(arm, q, 0.0)
    k = eq.angle_in_triangle(eq.highest_elbow_span(arm), arm.l3, eq.upper_tube_span(arm))
    unfolded = -highest[:, 3] < 1.5 * np.pi - k
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


def _angle(printed: Array, true: Array) -> Size:
    """Size of a wrong angle [rad]."""
    error = np.abs(eq.wrapped(printed - true))
    answered = np.isfinite(printed)
    wrong = answered & (error > WRONG)
    return Size(
        median_angle_error_deg=float(np.median(error[wrong])) / DEG if wrong.any() else np.nan,
        affected_share=float((wrong | ~answered).mean()),
        no_answer_share=float((~answered).mean()),
    )


def _length(printed: Array | float, true: Array | float) -> Size:
    """Size of a wrong length [m]."""
    error = np.abs(np.atleast_1d(printed) - true)
    return Size(median_length_error_mm=float(np.median(error)) / MM, affected_share=float((error > WRONG).mean()))


# (3) and (5) ------------------------------------------------------------------------------------------------------------


def _square_root_in_the1(s: Sample) -> Size:
    l2, qd, l3, d5 = (length / MM for length in (s.arm.l2, eq.highest_elbow_span(s.arm), s.arm.l3, s.arm.d5))
    return Size(cosine=(l2**2 + qd**2 - np.hypot(l3, d5)) / (2.0 * l2 * qd), affected_share=1.0, no_answer_share=1.0)


def _d5_in_the1(s: Sample) -> Size:
    cosine = eq.cosine_in_triangle(s.arm.l2, eq.highest_elbow_span(s.arm), np.hypot(s.arm.l3, s.arm.d5))
    return Size(cosine=float(cosine), affected_share=1.0, no_answer_share=1.0)


def _signed_lengths_in_span(s: Sample) -> Size:
    return _length(np.hypot(s.arm.l3 - (-s.arm.l2), s.arm.d3), eq.highest_elbow_span(s.arm))


def _theta2_without_half_turn(s: Sample) -> Size:
    return _angle(eq.highest_theta2(s.arm, s.highest_p) + np.pi, s.highest[:, 1])


def _full_turn_in_theta4(s: Sample) -> Size:
    return _angle(_printed_theta4(s), s.highest[:, 3])


def _printed_theta4(s: Sample) -> Array:
    span = eq.highest_elbow_span(s.arm)
    k = eq.angle_in_triangle(span, s.arm.l3, eq.upper_tube_span(s.arm))
    q = eq.angle_in_triangle(span, s.arm.d5, eq.distance(s.highest_p))
    return -(2.0 * np.pi - k - q)


def _signed_d5_in_theta4(s: Sample) -> Size:
    span = eq.highest_elbow_span(s.arm)
    k = eq.angle_in_triangle(span, s.arm.l3, eq.upper_tube_span(s.arm))
    q = eq.angle_in_triangle(span, -s.arm.d5, eq.distance(s.highest_p))
    return _angle(-(1.5 * np.pi - k - q), s.highest[:, 3])


# (7) and (9) ------------------------------------------------------------------------------------------------------------


def _printed_ken(arm: NominalArm, theta4: Array) -> Array:
    return np.sqrt(arm.l3**2 + arm.d5**2 - 2.0 * arm.l3 * arm.d5 * np.cos(np.pi / 2 + theta4))


def _sign_in_ken(s: Sample) -> Size:
    theta4 = s.highest[:, 3]
    return _length(_printed_ken(s.arm, theta4), eq.tube_end_to_point(s.arm, theta4))


def _ken_and_theta4_as_printed(s: Sample) -> Size:
    return _length(_printed_ken(s.arm, _printed_theta4(s)), eq.tube_end_to_point(s.arm, s.highest[:, 3]))


def _sweep_by_printed_ken(s: Sample) -> Size:
    closes = eq.lowest_exists(s.arm, s.highest_p)
    p, theta4 = s.highest_p[closes], s.highest[closes, 3]
    upper, reach = eq.upper_tube_span(s.arm), eq.distance(p)
    parts = eq.theta2_sweep_parts(s.arm, p, theta4)
    thek1 = eq.angle_in_triangle(upper, reach, _printed_ken(s.arm, theta4))
    return _angle(thek1 + parts[:, 1] + parts[:, 2], parts.sum(axis=1))


def _sweep_for_theta2(s: Sample) -> Size:
    reachable = np.isfinite(eq.highest_theta2(s.arm, s.lowest_p))
    p = s.lowest_p[reachable]
    return _angle(eq.theta2_sweep(s.arm, p, eq.highest_theta4(s.arm, p)), eq.lowest_theta2(s.arm, p))


def _condition_of_lowest(s: Sample) -> Size:
    exists = eq.lowest_exists(s.arm, s.p)
    printed = eq.distance(s.p) + s.arm.d5 >= eq.lowest_elbow_span(s.arm)
    return Size(affected_share=float((printed != exists).mean()), false_share=float(printed[~exists].mean()))


def _one_root_of_lowest(s: Sample) -> Size:
    return _angle(eq.lowest_theta4(s.arm, s.lowest_p)[:, 0], s.lowest[:, 3])


def _theta2_range(s: Sample) -> Size:
    reachable = np.isfinite(eq.highest_theta2(s.arm, s.p)) & eq.lowest_exists(s.arm, s.p)
    p, theta2 = s.p[reachable], s.q[reachable, 1]
    inside = (theta2 <= eq.highest_theta2(s.arm, p) + WRONG) & (theta2 >= eq.lowest_theta2(s.arm, p) - WRONG)
    return Size(affected_share=float((~inside).mean()))


# (10) to (13) -----------------------------------------------------------------------------------------------------------


def _l2_in_qdk(s: Sample) -> Size:
    theta2 = s.q[:, 1]
    along = eq.crossing_to_tube_end(s.arm, theta2)
    to_point = np.hypot(eq.radius(s.p), eq.height(s.p) - eq.crossing_height(s.arm, theta2))
    wrong = np.hypot(along, s.arm.l2)
    theta41 = eq.angle_in_triangle(s.arm.l3, wrong, along)
    theta42 = eq.angle_in_triangle(s.arm.d5, wrong, to_point)
    first = _first_root_is_true(s)
    return _angle((-1.5 * np.pi + theta41 + theta42)[first], s.q[first, 3])


def _first_root_is_true(s: Sample) -> Flags:
    roots = eq.theta4_roots(s.arm, s.p, s.q[:, 1])
    return np.asarray(np.abs(eq.wrapped(roots[:, 0] - s.q[:, 3])) <= np.abs(eq.wrapped(roots[:, 1] - s.q[:, 3])))


def _one_root_of_theta4(s: Sample) -> Size:
    return _angle(eq.theta4_roots(s.arm, s.p, s.q[:, 1])[:, 0], s.q[:, 3])


def _printed_turn(s: Sample, vk_sign: float, absolute: bool) -> Array:
    """θ1 counted from the azimuth by (12) and (13), at the true θ4, with the sign of Vk and |Uk| as chosen: (n,) [rad]."""
    opening = np.abs(s.q[:, 1]) + np.arctan(s.arm.d3 / s.arm.l2)
    length = eq.upper_tube_span(s.arm)
    uk, vk = length * np.cos(np.pi - opening), vk_sign * length * np.sin(np.pi - opening)
    uk = np.abs(uk) if absolute else uk
    squared = eq.tube_end_to_point(s.arm, s.q[:, 3]) ** 2 - (vk - eq.height(s.p)) ** 2
    cosine = (eq.radius(s.p) ** 2 + uk**2 - squared) / (2.0 * eq.radius(s.p) * uk)
    return eq.arccos_or_nan(np.where(squared >= 0.0, cosine, np.inf))


def _true_turn(s: Sample) -> Array:
    return np.abs(eq.wrapped(s.q[:, 0] - eq.azimuth(s.p)))


def _sign_of_vk(s: Sample) -> Size:
    return _angle(_printed_turn(s, -1.0, absolute=False), _true_turn(s))


def _absolute_uk(s: Sample) -> Size:
    return _angle(_printed_turn(s, 1.0, absolute=True), _true_turn(s))


def _guard_of_theta1(s: Sample) -> Size:
    true = _guard(s.arm, s.p, s.q[:, 1], s.q[:, 3])
    theta4 = eq.theta4_roots(s.arm, s.p, s.other_theta2)[:, 0]
    missing = ~(np.abs(eq.cosine_theta1(s.arm, s.p, s.other_theta2, theta4)) <= 1.0)
    accepted = _guard(s.arm, s.p, s.other_theta2, theta4)
    return Size(affected_share=float((~true).mean()), false_share=float(accepted[missing].mean()))


def _guard(arm: NominalArm, p: Array, theta2: Array, theta4: Array) -> Flags:
    """Qk + Dq - Rq > 1 mm, false where Rq is not real: (n,) bool."""
    opening = np.abs(theta2) + np.arctan(arm.d3 / arm.l2)
    c = eq.upper_tube_span(arm) * np.stack([np.cos(np.pi - opening), np.sin(np.pi - opening)])
    squared = eq.tube_end_to_point(arm, theta4) ** 2 - (c[1] - eq.height(p)) ** 2
    rq = np.sqrt(squared, out=np.full_like(squared, np.nan), where=squared >= 0.0)
    return np.asarray(eq.radius(p) + np.abs(c[0]) - rq > 1.0 * MM)


MISPRINTS: tuple[Misprint, ...] = (
    Misprint("3", "the1 with √(l3² + d5²)", "the1 with (l3² + d3²)", _square_root_in_the1),
    Misprint("3", "the1 with (l3² + d5²), the square alone restored", "the1 with (l3² + d3²)", _d5_in_the1),
    Misprint("3", "QD with the signs of Table 1", "QD with magnitudes", _signed_lengths_in_span),
    Misprint("3", "θ2max = the1 + the2 + the3", "θ2max = the1 + the2 + the3 - π", _theta2_without_half_turn),
    Misprint("5", "θ4max = -(2π - ∠k - ∠q)", "θ4max = -(3π/2 - ∠k - ∠q)", _full_turn_in_theta4),
    Misprint("5", "d5 with the sign of Table 1", "|d5|", _signed_d5_in_theta4),
    Misprint("7", "ken with cos(π/2 + θ4max)", "ken with cos(π/2 - θ4max)", _sign_in_ken),
    Misprint("7", "ken and θ4max both as printed", "both corrected", _ken_and_theta4_as_printed),
    Misprint("7", "thek by the printed ken", "thek by the corrected ken", _sweep_by_printed_ken),
    Misprint("7", "thek as the last line", "θ2min = θ2max - thek", _sweep_for_theta2),
    Misprint("7", "exists if den + |d5| >= gen", "exists if |gen - |d5|| <= den <= gen + |d5|", _condition_of_lowest),
    Misprint("9", "one root", "its mirror image θ4 = π/2 + ∠k - ∠q as well", _one_root_of_lowest),
    Misprint("10", "every θ2 lies in (θ2min, θ2max)", "also θ2 of the base turned round", _theta2_range),
    Misprint("11", "qdk = √(dk² + l2²)", "qdk = √(dk² + l3²)", _l2_in_qdk),
    Misprint("11", "one root, θ41 + θ42", "θ41 - θ42 as well", _one_root_of_theta4),
    Misprint("12", "Vk = -len sin(π - uck) with Z upwards", "Vk = len sin(π - uck)", _sign_of_vk),
    Misprint("12", "Dq = |Uk|", "Dq = Uk with its sign", _absolute_uk),
    Misprint("13", "exists if Qk + Dq - Rq > 1 mm", "exists if |cos θ1| <= 1 and Rq is real", _guard_of_theta1),
)
"""All misprints, in the order of the equations."""
