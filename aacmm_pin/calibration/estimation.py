"""One calibration: robust start, scatter, exclusion, final least squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.distributions import chi2_isf, f_isf
from aacmm_pin.calibration.fit import LEAST_DOF, MEDIAN, Chi2, Fit
from aacmm_pin.calibration.linearisation import Point
from aacmm_pin.calibration.noise_model import NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.calibration.solver import initial_point, solve
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import NOTHING_KNOWN

UNEQUAL = 1.5
"""Factor of the limit if noise is not stated: far records scatter more, by their readings."""
MOST_NOISE_ROUNDS = 12
MOST_SCATTER_ROUNDS = 100
"""Rounds of the scatter, at most; from offsets of 100° it takes 17, as the widths loosen."""
WORTHWHILE_FALL = 0.99
"""Outliers are judged again while a round lowers the better half's scatter below this part: from
100° most rounds lower it by a tenth, some by 2 %.
"""
NO_MOTION = 1e-6
"""Motion along an undetermined direction that is none [widths]."""
SCATTER_TOLERANCE = 1e-3
FIRST_SCATTER = 1e-4
"""First value of a noise that is not stated [m]."""
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


def fit(problem: Problem, *, robust: bool = True, used: Mask | None = None) -> Fit:
    """Estimate what is unknown in ``problem``.

    First robustly, then without outliers (χ² of their residual, Bonferroni's bound over all
    records). The scatter beyond the stated noise is the variance component with which χ² meets its
    degrees of freedom; zero if the stated noise suffices.

    Args:
        used: the records without outliers (n,), if known.

    Raises:
        AacmmError: no record determines the tip.
    """
    estimation = _Estimation(problem)
    has_target = estimation.observations.has_target
    if not has_target.any():
        raise AacmmError(
            f"{problem.measurements.source}: no record determines the tip; expected reference "
            "coordinates, bars, or seats with two or more records"
        )
    point = initial_point(problem, estimation.observations)
    estimation.observations = estimation.observations.with_normals(
        point.prediction.tips, point.seats
    )
    if used is None and robust:
        first = estimation.initial_fit(point, has_target, robust=True)
        if first.redundant:
            noise, point, used = estimation.without_outliers(first)
            del first  # its rows are as large as those that come
            of_all = None if (used == has_target).all() else estimation.fit_of_all(point)
            return of_all or estimation.final_fit(noise, point, used)
    used = has_target if used is None else used & has_target
    first = estimation.initial_fit(point, used, robust=False)
    noise = first.noise
    point = first.point
    del first
    return estimation.final_fit(noise, point, used)


class _Estimation:
    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.noise_is_stated = not problem.setup.unstated(problem.measurements)
        self.observations = observations_of(problem.measurements, problem.setup)

    def noise(self, point: Point, scatters: Scatters) -> NoiseModel:
        x, frame, seats = point.x, point.frame, point.seats
        return NoiseModel.of(self.problem, x, frame, scatters, self.observations, seats)

    def initial_fit(self, point: Point, used: Mask, *, robust: bool) -> Fit:
        """With the records' present scatter as noise; if robust, until it falls no more.

        From afar, with the stated noise, the search would follow every valley of poorly determined
        parameters.
        """
        squares = np.square(self.observations.deviations(point.prediction.poses, point.seats))
        tip = _median_scatter(squares[used, :3])
        scatters = Scatters(
            tip, _median_scatter(squares[used & self.observations.oriented, 3:]), tip
        )
        for _ in range(MOST_NOISE_ROUNDS):
            noise = self.noise(point, scatters)
            solution = solve(
                self.problem, noise, point, used.astype(np.float64), robust=robust, roughly=True
            )
            if not robust:
                break
            point = solution.point
            before = scatters.tip
            scatters = self.scatters_of_median(noise, point, used)
            if scatters.tip == 0.0 or scatters.tip > 0.8 * before:
                break
        return solution

    def without_outliers(self, first: Fit) -> tuple[NoiseModel, Point, Mask]:
        """Noise, end and records of a search without outliers, by the scatter of the better half.

        Far from the minimum this scatter is large, and nothing is an outlier.
        """
        dof = max(first.chi2.dof, 1.0)
        share = min(1.0, dof / int(self.observations.counts.sum()))
        has_target = self.observations.has_target
        solution = first
        scatters = self.scatters_of_median(first.noise, first.point, has_target, share)
        for _ in range(MOST_SCATTER_ROUNDS):
            noise = self.noise(solution.point, scatters)
            solution = Fit.at(self.problem, noise, solution.point, solution.weights)
            solution, used = self.fit_without_outliers(solution, dof)
            scatters = self.scatters_of_median(noise, solution.point, has_target, share)
            if scatters.tip >= WORTHWHILE_FALL * noise.scatters.tip:
                break
        return solution.noise, solution.point, used

    def fit_without_outliers(self, solution: Fit, dof: float) -> tuple[Fit, Mask]:
        """For the noise of ``solution``, whose scatter has ``dof`` degrees of freedom; and the
        records that remain (n,).
        """
        has_target = self.observations.has_target
        count = int(has_target.sum())
        # A scatter that the records determine is uncertain: more records may seem far off.
        chance = FALSE_EXCLUSION / count
        rows = np.maximum(self.observations.counts, 1)
        is_estimated = solution.noise.scatters.tip > 0
        limit = (
            rows * f_isf(chance, rows, EFFICIENCY * dof) if is_estimated else chi2_isf(chance, rows)
        )
        if not self.noise_is_stated:
            limit = limit * UNEQUAL**2
        used = has_target.copy()
        for refits in range(MOST_NOISE_ROUNDS):
            inliers = has_target & (deleted_distances(solution) <= limit)
            if inliers.sum() < 0.5 * count or (refits and (inliers == used).all()):
                break
            used = inliers
            weights = used.astype(np.float64)
            solution = solve(self.problem, solution.noise, solution.point, weights)
        return solution, used

    def fit_of_all(self, point: Point) -> Fit | None:
        """The fit to all records; None unless the stated noise and prior explain it and each
        record. A robust search fits some of few records at the expense of others.
        """
        if not self.noise_is_stated:
            return None
        has_target = self.observations.has_target
        fitted, _ = self.fit_with_stated_noise(point, has_target)
        if fitted is None:
            return None
        limit = chi2_isf(
            FALSE_EXCLUSION / int(has_target.sum()), np.maximum(self.observations.counts, 1)
        )
        return fitted if (deleted_distances(fitted) <= limit)[has_target].all() else None

    def scatters_of_median(
        self, noise: NoiseModel, point: Point, used: Mask, share: float = 1.0
    ) -> Scatters:
        """Scatters with which median squared distances are the ``share`` that a fit leaves of the
        median of χ². Seats have that of tips.
        """
        deviations = noise.observations.deviations(point.prediction.poses, point.seats)
        stated = noise.without_scatter
        with_turn = used & noise.observations.oriented
        medians = chi2_isf(0.5, np.where(noise.observations.on_surface, 1, 3))
        tip = self._scatter_of_median(
            deviations[used, :3], stated[used, :3, :3], medians[used], share
        )
        turn = 0.0
        if with_turn.any():
            of_turns = stated[with_turn, 3:, 3:]
            turn = self._scatter_of_median(deviations[with_turn, 3:], of_turns, MEDIAN, share)
        return Scatters(tip, turn, tip)

    def _scatter_of_median(
        self, deviation: Array, stated: Array, medians: Array | float, share: float
    ) -> float:
        def excess(variance: float) -> float:
            covariance = stated + variance * np.eye(3)
            relative = squared_distances(deviation, covariance) / medians
            return float(np.median(relative)) - share

        # The median over few records varies by chance.
        slack = 6.0 / np.sqrt(len(stated))
        if self.noise_is_stated and excess(0.0) < slack:
            return 0.0
        return float(np.sqrt(root(excess, deviation)))

    def final_fit(self, noise: NoiseModel, point: Point, used: Mask) -> Fit:
        if not self.noise_is_stated:
            return self.as_far_as_determined(self.with_variance_components(noise, point, used))
        fitted, _ = self.fit_with_stated_noise(point, used)
        if fitted:
            return fitted
        first = self.scatters_of_median(self.noise(point, Scatters()), point, used)
        noise = self.noise(point, first._replace(tip=first.tip or FIRST_SCATTER))
        solution = self.with_variance_components(noise, point, used)
        # From afar one step promises too little: judged again where the search came to rest.
        fitted, chi2 = self.fit_with_stated_noise(solution.point, used)
        if fitted:
            return fitted
        noise = self.noise(solution.point, solution.noise.scatters)
        return self.as_far_as_determined(replace(solution, noise=noise, chi2_stated=chi2))

    def with_variance_components(self, noise: NoiseModel, point: Point, used: Mask) -> Fit:
        weights = used.astype(np.float64)
        solution = solve(self.problem, noise, point, weights)
        for _ in range(MOST_SCATTER_ROUNDS):
            before = np.array(noise.scatters)
            scatters = variance_components(solution, self.observations.without_u)
            noise = self.noise(solution.point, scatters)
            solution = solve(self.problem, noise, solution.point, weights)
            after = np.array(noise.scatters)
            if (np.abs(after - before) <= SCATTER_TOLERANCE * after).all():
                return solution
        return replace(solution, message=solution.message or "the scatter did not settle")

    def fit_with_stated_noise(self, point: Point, used: Mask) -> tuple[Fit | None, Chi2]:
        """The fit without scatter beyond the stated noise, and its χ²; None, without a search, if
        the χ² that one step promises is too large.
        """
        noise = self.noise(point, Scatters())
        weights = used.astype(np.float64)
        at_point = Fit.at(self.problem, noise, point, weights)
        chi2 = Chi2(at_point.chi2.value - at_point.system.solution.reduction, at_point.chi2.dof)
        if not chi2.acceptable:
            return None, chi2
        solution = solve(self.problem, noise, point, weights)
        return self.as_far_as_determined(replace(solution, chi2_stated=solution.chi2)), chi2

    def as_far_as_determined(self, fitted: Fit) -> Fit:
        """The fit with undetermined directions at their start: anisotropic noise would otherwise
        rotate an arm that nothing else holds.
        """
        unknown = fitted.unknown[: self.problem.widths.size].T
        motion = unknown @ ((fitted.point.x - self.problem.start) / self.problem.widths)
        if np.abs(motion).max(initial=0.0) < NO_MOTION:
            return fitted
        problem = replace(self.problem, fixed=unknown)
        refit = solve(problem, fitted.noise, fitted.point, fitted.weights)
        # Judged without the rows that fixed these directions.
        at_start = Fit.at(self.problem, fitted.noise, refit.point, fitted.weights)
        return replace(
            at_start,
            steps=fitted.steps + refit.steps,
            message=fitted.message or refit.message,
            chi2_stated=fitted.chi2_stated,
        )


def _median_scatter(squares: Array) -> float:
    """From squares of normal numbers (n, 3); 0 without any."""
    if not len(squares):
        return 0.0
    median = np.median(squares.sum(axis=1))
    return float(np.sqrt(median / MEDIAN))


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
