"""Scatter beyond the stated noise: variance components that bring χ² to its degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import f_isf
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters
from aacmm_pin.calibration.solver import LEAST_DOF, MEDIAN, Solution

FALSE_EXCLUSION = 0.01
"""Probability that any good record of the file is excluded."""
EFFICIENCY = 0.53
"""Of the median of χ² with three degrees of freedom as an estimate of a variance."""
LEAST_DOF_OF_SEAT = 1e-3
"""Fewer degrees of freedom show nothing of the scatter of a seat's coordinates."""
LEAST_SCATTER = 1e-10
"""Least scatter, for computed data may fit exactly [m]."""


def variance_components(solution: Solution, used: Mask, open_: Mask) -> Scatters:
    """Scatters with which χ² of tips, rotations and ``open_`` coordinates of seats (s, 3), without
    stated uncertainty, equal their degrees of freedom.
    """
    seat, dof = _of_seats(solution, open_) if open_.any() else (0.0, 0.0)
    tip, turn = (_variance_component(solution, used, turns, open_, dof) for turns in (False, True))
    return Scatters(tip, turn, seat)


def _variance_component(
    solution: Solution, used: Mask, turns: bool, open_: Mask, dof_of_seats: float
) -> float:
    """Of tips [m], or of rotations [rad] given their tips' deviations; that of ``solution`` without
    degrees of freedom. ``open_`` coordinates of seats have ``dof_of_seats``.
    """
    noise = solution.noise
    stated_noise = noise.without_scatter
    turn_dof = solution.turn_dof
    scatters = noise.scatters
    dof = turn_dof if turns else solution.chi2.dof - turn_dof - dof_of_seats
    if dof < LEAST_DOF:
        return scatters.turn if turns else scatters.tip
    deviation = np.where(used[:, None], solution.system.deviations, 0.0)
    seats = solution.point.seats
    ties = (
        np.where(open_, 0.0, noise.observations.of_seats(seats)),
        noise.observations.of_relations(seats)[0],
    )
    other_chi2 = sum(float(np.square(tie).sum()) for tie in ties)
    scatter_shape = np.eye(3)
    if turns:
        stated_noise[:, :3, :3] += scatters.tip**2 * np.eye(3)
        other_chi2 = -_chi2(noise, deviation[:, :3], stated_noise[:, :3, :3], used)
        scatter_shape = np.diag([0.0, 0, 0, 1, 1, 1])
    else:
        deviation = deviation[:, :3]
        stated_noise = stated_noise[:, :3, :3]

    def excess(variance: float) -> float:
        chi2 = _chi2(noise, deviation, stated_noise + variance * scatter_shape, used)
        return chi2 + other_chi2 - dof

    return float(np.sqrt(root(excess, deviation[:, -3:])))


def _chi2(noise: NoiseModel, deviation: Array, covariance: Array, used: Mask) -> float:
    """By the covariance (n, k, k) of deviations (n, k), and what records of one reading share."""
    # Stated noise may be zero, of an exact contact with exact readings.
    least = LEAST_SCATTER**2 * np.eye(deviation.shape[1])
    whitening = np.linalg.inv(np.linalg.cholesky(covariance + least))
    correlation = noise.correlation(whitening * used[:, None, None])
    rows = correlation.whitened(whitening @ deviation[:, :, None])
    return float(np.square(rows).sum())


def _of_seats(solution: Solution, open_: Mask) -> tuple[float, float]:
    """Scatter of the ``open_`` coordinates of seats (s, 3) [m], and their degrees of freedom.

    The almost unbiased estimate of a variance component (Horn, Horn and Duncan 1975, J. Am. Stat.
    Assoc. 70). The scatter of the tips counts as one more degree of freedom, for few seats.
    Outliers against the better half, such as a moved seat, do not count.
    """
    noise = solution.noise
    system = solution.system
    placed = solution.noise.observations.known
    ties = 3 * int(placed.sum())
    relations = len(noise.observations.ends)
    first = len(system.residual) - ties - relations
    steps = system.jacobian[first : first + ties] @ system.independent_steps
    by_parameters = np.square(steps).sum(axis=1).reshape(-1, 3)
    information, tie, *_ = information_of_seats(solution)
    variances = np.diagonal(np.linalg.inv(information[placed]), axis1=1, axis2=2)
    parts = 1.0 - tie[placed] * variances - by_parameters
    dof_of_seat = np.where(open_[placed], parts, 0.0).sum(axis=1)
    residuals = np.where(open_, solution.point.seats - noise.observations.stated, 0.0)
    squares = np.square(residuals[placed]).sum(axis=1)
    dof = float(dof_of_seat.sum())
    is_shown = dof_of_seat > LEAST_DOF_OF_SEAT
    squares = squares[is_shown]
    dof_of_seat = dof_of_seat[is_shown]
    ratios = squares / dof_of_seat
    tip_variance = noise.scatters.tip**2
    limit = f_isf(FALSE_EXCLUSION / max(ratios.size, 1), 3, max(EFFICIENCY * dof, 1.0))
    median_ratio = float(np.median(ratios)) if ratios.size else 0.0
    belongs = ratios <= limit * (3.0 / MEDIAN) * max(median_ratio, tip_variance)
    variance = (squares[belongs].sum() + tip_variance) / (dof_of_seat[belongs].sum() + 1.0)
    return float(np.sqrt(variance)), dof


def information_of_seats(solution: Solution) -> tuple[Array, Array, Array, Array]:
    """Information on each seat (s, 3, 3) [1/m²], without relations; the diagonal by stated
    coordinates (s, 3); the part of each record at a seat, and the pull by its deviation (records,
    3, 3).
    """
    observations = solution.observations
    touched = np.flatnonzero(observations.seat >= 0)
    whitening = solution.noise.whitening
    by_seats = observations.by_seats(whitening)[touched, :3]
    weighted = solution.weights[touched, None, None] * by_seats.transpose(0, 2, 1)
    of_records = weighted @ by_seats
    tie = np.where(observations.known[:, None], observations.stated_u, np.inf) ** -2.0
    information = tie[:, :, None] * np.eye(3)
    np.add.at(information, observations.seat[touched], of_records)
    return information, tie, of_records, -weighted @ whitening[touched, :3, :3]


def squared_distances(deviation: Array, covariance: Array) -> Array:
    """``dᵀ Σ⁻¹ d`` of each deviation (n, k) by its covariance (n, k, k)."""
    # Stated noise may be zero, of an exact contact with exact readings.
    width = deviation.shape[1]
    covariance = covariance + LEAST_SCATTER**2 * np.eye(width)
    weighted = np.linalg.solve(covariance, deviation[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ni,ni->n", deviation, weighted))


def root(excess: Callable[[float], float], deviation: Array) -> float:
    """Variance at which the falling ``excess`` is zero; else the largest possible variance."""
    low = LEAST_SCATTER**2
    high = 10 * (float(np.square(deviation).sum()) + LEAST_SCATTER**2)
    if excess(low) <= 0:
        return low
    if excess(high) > 0:
        return high
    return float(scipy.optimize.brentq(excess, low, high, xtol=1e-24, rtol=1e-10))
