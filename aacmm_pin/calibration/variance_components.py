"""Scatter beyond the stated noise: variance components that bring χ² to its degrees of freedom;
and squared distances of records from their targets, in standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import f_isf
from aacmm_pin.calibration.fit import LEAST_DOF, MEDIAN, Fit
from aacmm_pin.calibration.noise_model import Scatters
from aacmm_pin.measurements import NOTHING_KNOWN

FALSE_EXCLUSION = 0.01
"""Probability that any good record of the file is excluded."""
EFFICIENCY = 0.53
"""Of the median of χ² with three degrees of freedom as an estimate of a variance."""
LEAST_DOF_OF_SEAT = 1e-3
"""Fewer degrees of freedom show nothing of the scatter of a seat's coordinates."""
ROUNDING_OF_INFORMATION = 1e-13
"""Relative, of the information on a seat."""
LEAST_SCATTER = 1e-10
"""Least scatter, for computed data may fit exactly [m]."""


def variance_components(fit: Fit, unstated: Mask) -> Scatters:
    """Scatters with which χ² of tips, rotations and ``unstated`` coordinates of seats (s, 3) equal
    their degrees of freedom; those of ``fit`` without any.
    """
    noise = fit.noise
    observations = noise.observations
    tip, rotation, _ = noise.scatters
    seat, dof_of_seats = _seat_scatter(fit, unstated) if unstated.any() else (0.0, 0.0)
    turn_dof = fit.turn_dof
    dof = fit.chi2.dof - turn_dof - dof_of_seats
    deviations = np.where(fit.used[:, None], fit.system.deviations, 0.0)
    covariance = noise.without_scatter
    of_seats = np.where(unstated, 0.0, observations.seat_residuals(fit.point.seats))
    of_relations, _ = observations.relation_residuals(fit.point.seats)
    dof_of_tips = dof - float(np.square(of_seats).sum() + np.square(of_relations).sum())
    # If seats or relations contradict each other, no scatter explains it.
    if dof >= LEAST_DOF and dof_of_tips > 0.0:
        tip = _scatter(fit, deviations[:, :3], covariance[:, :3, :3], dof_of_tips)
    if turn_dof >= LEAST_DOF:  # given the deviations of the tips
        covariance[:, :3, :3] += noise.scatters.tip**2 * np.eye(3)
        chi2_of_tips = _chi2(fit, deviations[:, :3], covariance[:, :3, :3])
        rotation = _scatter(fit, deviations, covariance, chi2_of_tips + turn_dof)
    return Scatters(tip, rotation, seat)


def _scatter(fit: Fit, deviations: Array, stated: Array, chi2: float) -> float:
    """Scatter of the last three numbers of deviations (n, 3 or 6) with which they have this χ²."""
    width = deviations.shape[1]
    scattered = np.diag(np.where(np.arange(width) < width - 3, 0.0, 1.0))

    def excess(variance: float) -> float:
        return _chi2(fit, deviations, stated + variance * scattered) - chi2

    return float(np.sqrt(root(excess, deviations[:, -3:])))


def _chi2(fit: Fit, deviation: Array, covariance: Array) -> float:
    """Of deviations (n, k) with a covariance (n, k, k), and what records of one reading share."""
    # Stated noise may be zero, of an exact contact with exact readings.
    least = LEAST_SCATTER**2 * np.eye(deviation.shape[1])
    whitening = np.linalg.inv(np.linalg.cholesky(covariance + least))
    correlation = fit.noise.correlation(whitening * fit.used[:, None, None])
    rows = correlation.whitened(whitening @ deviation[:, :, None])
    return float(np.square(rows).sum())


def _seat_scatter(fit: Fit, unstated: Mask) -> tuple[float, float]:
    """Scatter of the ``unstated`` coordinates of seats (s, 3) [m], and their degrees of freedom.

    The almost unbiased estimate of a variance component (Horn, Horn and Duncan 1975, J. Am. Stat.
    Assoc. 70). The scatter of the tips counts as one more degree of freedom. Outliers against the
    better half do not count.
    """
    noise = fit.noise
    system = fit.system
    placed = noise.observations.is_stated
    seat_rows = 3 * int(placed.sum())
    relations = len(noise.observations.ends)
    first = len(system.residual) - seat_rows - relations
    steps = system.jacobian[first : first + seat_rows] @ system.independent_steps
    by_parameters = np.square(steps).sum(axis=1).reshape(-1, 3)
    information = information_of_seats(fit)
    variances = np.diagonal(np.linalg.inv(information.total[placed]), axis1=1, axis2=2)
    dof_of_coordinate = 1.0 - information.stated[placed] * variances - by_parameters
    dof_of_seat = np.where(unstated[placed], dof_of_coordinate, 0.0).sum(axis=1)
    residuals = np.where(unstated, fit.point.seats - noise.observations.stated, 0.0)
    squares = np.square(residuals[placed]).sum(axis=1)
    dof = float(dof_of_seat.sum())
    is_shown = dof_of_seat > LEAST_DOF_OF_SEAT
    squares = squares[is_shown]
    dof_of_seat = dof_of_seat[is_shown]
    ratios = squares / dof_of_seat
    tip_variance = noise.scatters.tip**2
    limit = f_isf(FALSE_EXCLUSION / max(ratios.size, 1), 3, max(EFFICIENCY * dof, 1.0))
    median_ratio = float(np.median(ratios)) if ratios.size else 0.0
    inlier = ratios <= limit * (3.0 / MEDIAN) * max(median_ratio, tip_variance)
    variance = (squares[inlier].sum() + tip_variance) / (dof_of_seat[inlier].sum() + 1.0)
    return float(np.sqrt(variance)), dof


class SeatInformation(NamedTuple):
    """Information on each seat [1/m²], without relations.

    Attributes:
        total: (s, 3, 3).
        stated: diagonal by stated coordinates (s, 3).
        by_record: part of each record at a seat (records, 3, 3).
        pulls: by its deviation (records, 3, 3).
    """

    total: Array
    stated: Array
    by_record: Array
    pulls: Array


def information_of_seats(fit: Fit) -> SeatInformation:
    """Of the seats of a fit, by the weights of its records."""
    observations = fit.observations
    touched = np.flatnonzero(observations.seat >= 0)
    whitening = fit.noise.whitening
    by_seats = observations.seat_derivatives(whitening)[touched, :3]
    weighted = fit.weights[touched, None, None] * by_seats.transpose(0, 2, 1)
    by_record = weighted @ by_seats
    stated = np.where(observations.is_stated[:, None], observations.stated_u, np.inf) ** -2.0
    total = stated[:, :, None] * np.eye(3)
    np.add.at(total, observations.seat[touched], by_record)
    return SeatInformation(total, stated, by_record, -weighted @ whitening[touched, :3, :3])


def deleted_distances(fit: Fit) -> Array:
    """Squared distance of each record from where the *others* put its target, over the variance of
    both (n,); infinite without a target.

    Without the record, the others of its seat determine an unknown point; bars do not count.
    """
    observations = fit.observations
    covariance = fit.noise.of_residuals[:, :3, :3].copy()
    deviations = fit.system.deviation.copy()
    touched = np.flatnonzero(observations.seat >= 0)
    if touched.size:
        seat = observations.seat[touched]
        information = information_of_seats(fit)
        # Rounding may leave less than no information of a direction that one contact determines.
        rounding = ROUNDING_OF_INFORMATION * np.trace(information.total, axis1=1, axis2=2)[seat]
        least = np.maximum(NOTHING_KNOWN, rounding)[:, None, None] * np.eye(3)
        by_others = np.linalg.inv(information.total[seat] - information.by_record + least)
        # By one unit of a seat a deviation changes by minus these.
        identity = np.tile(np.eye(3), (len(deviations), 1, 1))
        changes = -observations.seat_derivatives(identity)[touched]
        corrections = changes @ by_others @ information.pulls @ deviations[touched][:, :, None]
        deviations[touched] += corrections[:, :, 0]
        covariance[touched] += changes @ by_others @ changes.transpose(0, 2, 1)
    covariance = observations.counting_covariance(covariance)
    deviations = observations.along_normals(deviations[:, None, :])[:, 0]
    has_target = observations.has_target
    turns = np.nan_to_num(fit.system.turn_distance[has_target])
    distances = np.full(len(deviations), np.inf)
    distances[has_target] = (
        squared_distances(deviations[has_target], covariance[has_target]) + turns
    )
    return distances


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
