"""One calibration: robust start, what scatters more than stated, what is excluded, the final least squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import null_space, orth

from aacmm_pin._support.checks import Array
from aacmm_pin._support.distributions import chi2_isf, chi2_sf, f_isf
from aacmm_pin.calibration.linear_system import assemble
from aacmm_pin.calibration.problem import OF_WIDTH, Problem
from aacmm_pin.calibration.solver import MEDIAN, Point, Solution, begin, deviations, noise_of_tips, solve, standing
from aacmm_pin.calibration.stated_noise import StatedNoise, observations_of
from aacmm_pin.effects import Effect
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.observations import NOTHING_KNOWN, Observations

FALSE_EXCLUSION = 0.01
"""Chance that any good record is excluded, over the whole file."""
EFFICIENCY = 0.53
"""A scatter taken from the median of χ² with three degrees is as certain as from this part of all the records' numbers."""
UNEQUAL = 1.5
"""Records far out scatter more, by their readings; where nobody states the noise, they are believed this much farther."""
LEAST_DOF = 0.5
"""With fewer degrees of freedom records do not tell their scatter; widths that nobody stated leave a little above zero."""
MISFIT = 1e-3
"""χ² beyond its stated noise with less chance than this means that something scatters which nobody stated."""
MOST_ROUNDS = 12
NO_SCATTER = 5e-8
"""Scatter below this is none: the search for it ends just above zero, and nobody measures so well [m]."""
ONE_DIRECTION = 1e-2
"""Directions that records do not tell, found at tips and at targets, are one if the sine of their angle is less."""
FIRST_SCATTER = 1e-4
"""What nobody stated counts as this until the records show what it is [m]."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A problem solved.

    Attributes:
        problem, observations: what was asked, of all usable records.
        solution: the final least squares.
        noise: covariance of each tip (n, 3, 3) [m²].
        unmodelled: scatter of each coordinate beyond the stated noise; 0 where the stated noise suffices [m].
        stated: True where the stated noise was complete, so that ``chi2_stated`` judges the model.
        used: (n,) True for the records that count.
        excluded: (n,) True for records that fit too badly to be believed.
        found: labels of effects whose inner values (order, time constant) come from these records too, so that what is
            uncertain of them makes the other parameters uncertain.
        chi2_stated: χ² against the stated noise alone, and its degrees of freedom; None where it was not complete.
        dof: degrees of freedom of the final fit.
    """

    problem: Problem
    observations: Observations
    solution: Solution
    noise: Array
    unmodelled: float
    stated: bool
    used: NDArray[np.bool_]
    excluded: NDArray[np.bool_]
    chi2_stated: tuple[float, float] | None
    dof: float
    found: tuple[str, ...] = ()

    @property
    def tells_noise(self) -> bool:
        """Whether the noise is stated, or the records are enough to tell it."""
        return self.stated or self.dof >= LEAST_DOF

    @property
    def scatters(self) -> bool:
        """Whether there is scatter beyond the stated noise that is worth a word."""
        return self.unmodelled > NO_SCATTER

    @property
    def residual_noise(self) -> Array:
        """Covariance of each residual by its reading, its target and the scatter that was found (n, 3, 3) [m²]."""
        return np.asarray(self.noise + self.observations.covariance)

    @property
    def stated_noise(self) -> Array:
        """The same without the scatter that was found beside a noise that is stated in full."""
        found = self.unmodelled**2 * np.eye(3) if self.stated else 0.0
        return self.residual_noise - found

    @cached_property
    def unknown(self) -> Array:
        """Directions of which these records tell nothing, in units of the scales (p, k), orthonormal.

        A direction that leaves every residual as it is tells nothing; but where tips scatter about their targets, a turn
        of the whole arm about its base, or of its target about the last joint, seems to move them a little apart, which
        would pass for knowledge. The first does not move targets apart, the second not tips: so both are asked.
        """
        point = self.solution.point
        off = np.nan_to_num(deviations(self.observations, point))
        seen = self.problem.predict(point.x, point.frame, point.prediction.tips - off)
        there = Point(point.x, point.frame, point.seats, replace(point.prediction, jacobian=seen.jacobian))
        at_targets = standing(self.problem, self.observations, self.noise, there, self.solution.weights).spectrum
        spectra = (self.solution.spectrum, at_targets)
        return np.asarray(orth(np.hstack([s.directions[:, ~s.known] for s in spectra]), rcond=ONE_DIRECTION))

    @cached_property
    def covariance(self) -> Array:
        """Covariance of all columns, the frame's included (p, p) [units]; zero along what nothing determines."""
        p = self.problem.scales.size
        return self._with_inner[:p, :p]

    @property
    def inner_u(self) -> dict[tuple[str, str], float]:
        """Standard uncertainty of each inner value, by the effect's label and the name of the field."""
        u = np.sqrt(np.diag(self._with_inner)[self.problem.scales.size :])
        return dict(zip([(effect.label, name) for _, effect, name, _ in self._inner()], u.tolist(), strict=True))

    def _inner(self) -> list[tuple[int, Effect, str, float]]:
        """Inner values: number and effect, field, how far off it may be."""
        effects = enumerate(self.problem.effects(self.solution.point.x))
        chosen = [(k, effect) for k, effect in effects if effect.label in self.found]
        return [(k, effect, name, width) for k, effect in chosen for name, width in effect.inner_widths().items()]

    @cached_property
    def _with_inner(self) -> Array:
        """Covariance of all columns and, last, of the inner values."""
        inner, spectrum = self._inner(), self.solution.spectrum
        if not inner:
            return covariance_of(spectrum.values, spectrum.directions, self.problem.scales, self.unknown)
        problem, point = self.problem, self.solution.point
        columns = [self._by_inner(*one) for one in inner]
        wider = replace(point.prediction, jacobian=np.concatenate([point.prediction.jacobian, np.stack(columns, 2)], axis=2))
        system = assemble(wider, self.observations, point.seats, self.noise, self.solution.weights)
        scales = np.concatenate([problem.scales, [width for *_, width in inner]])
        prior = np.eye(scales.size)
        prior[: len(problem.widths), : len(problem.widths)] = problem.prior
        prior[len(problem.widths) : problem.scales.size] = 0.0  # nothing is known of the frame
        _, values, vt = np.linalg.svd(np.vstack([system.jacobian * scales, prior]), full_matrices=False)
        unknown = np.vstack([self.unknown, np.zeros((len(inner), self.unknown.shape[1]))])
        return covariance_of(values, vt.T, scales, unknown)

    def _by_inner(self, number: int, effect: Effect, name: str, width: float) -> Array:
        """∂(tip)/∂(inner value) (n, 3) [m/unit] by central differences."""
        tips = []
        for step in (OF_WIDTH * width, -OF_WIDTH * width):
            estimated = list(self.problem.estimated)
            estimated[number] = replace(estimated[number], **{name: getattr(effect, name) + step})
            moved = replace(self.problem, estimated=tuple(estimated))
            tips.append(moved.predict(self.solution.point.x, self.solution.point.frame).tips)
        return np.asarray(tips[0] - tips[1]) / (2 * OF_WIDTH * width)


def fit(problem: Problem, stated_noise: StatedNoise, *, robust: bool = True, used: NDArray[np.bool_] | None = None) -> Fit:
    """Estimate what is unknown in ``problem``.

    First robustly, then without the records that cannot belong (χ² of their residual, Bonferroni's bound over all
    records). The scatter beyond the stated noise is found so that χ² meets its degrees of freedom, and only where the
    stated noise alone will not do.

    Args:
        problem: what is unknown.
        stated_noise: standard uncertainties as stated.
        robust: look for records that cannot belong.
        used: the records that belong (n,), if that is known already; nothing is looked for then.

    Raises:
        AacmmError: no record says anything.
    """
    return _Fitting(problem, stated_noise).run(robust, used)


class _Fitting:
    """The rounds of one fit; holds what they share."""

    def __init__(self, problem: Problem, noise: StatedNoise) -> None:
        self.problem, self.noise = problem, noise
        self.stated = noise.suffices(problem.measurements)
        self.n = problem.measurements.n
        self.observations = observations_of(problem.measurements, noise, FIRST_SCATTER)
        self.tips = np.empty((0, 3, 3))
        self.unmodelled = 0.0

    def run(self, robust: bool, used: NDArray[np.bool_] | None) -> Fit:
        spoken = self.observations.says
        if not spoken.any():
            raise AacmmError("no record says where the tip was: no reference coordinates, and no seat touched twice")
        point = begin(self.problem, self.observations)
        self._prepare(0.0 if self.stated else FIRST_SCATTER, point)
        if used is None and robust:
            near = self._nearer(point, spoken, robust=True)
            if redundant(self.problem, near):
                used, point = self._believed(near, spoken)
                return self._final(point, used, spoken)
        used = spoken if used is None else used & spoken
        return self._final(self._nearer(point, used, robust=False).point, used, spoken)

    def _prepare(self, unmodelled: float, point: Point) -> None:
        """Take ``unmodelled`` for the scatter that nobody stated."""
        self.unmodelled = unmodelled
        if not self.stated:
            self.observations = observations_of(self.problem.measurements, self.noise, unmodelled)
        self.tips = noise_of_tips(self.problem, point.frame, self.noise.encoder, unmodelled)

    def _solve(self, point: Point, used: NDArray[np.bool_], robust: bool = False, roughly: bool = False) -> Solution:
        weights = used.astype(np.float64)
        return solve(self.problem, self.observations, self.tips, point, weights, robust=robust, roughly=roughly)

    def _nearer(self, point: Point, spoken: NDArray[np.bool_], robust: bool) -> Solution:
        """A search with the scatter that the records have so far taken for noise; if robust, until it falls no more.

        From afar the noise itself would give the data so much weight that the search follows every valley of parameters
        which they hardly tell; the widths of the parameters hold it in.
        """
        squared = np.square(deviations(self.observations, point)[spoken]).sum(axis=1)
        scatter = float(np.sqrt(np.median(squared) / MEDIAN))
        for _ in range(MOST_ROUNDS):
            self._prepare(scatter, point)
            solution = self._solve(point, spoken, robust, roughly=True)
            if not robust:
                break
            point = solution.point
            before, scatter = scatter, self._scatter_of_median(solution.system.deviation, spoken)
            if scatter == 0.0 or scatter > 0.8 * before:
                break
        return solution

    def _believed(self, solution: Solution, spoken: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Point]:
        """Which records belong, judged by the scatter of the better half of them."""
        point, count = solution.point, int(spoken.sum())
        dof = max(_chi2(self.problem, solution)[1], 1.0)
        self._prepare(self._scatter_of_median(solution.system.deviation, spoken, min(1.0, dof / (3 * count))), point)
        # A scatter that the records themselves tell is uncertain, and more records may seem far off beside it.
        chance = FALSE_EXCLUSION / count
        limit = 3 * f_isf(chance, 3, EFFICIENCY * dof) if self.unmodelled > 0 else chi2_isf(chance, 3)
        limit *= 1.0 if self.stated else UNEQUAL**2
        used = spoken.copy()
        solution = standing(self.problem, self.observations, self.tips, point, solution.weights)
        for tried in range(MOST_ROUNDS):
            belongs = spoken & (deleted_distances(self.observations, solution, self.tips) <= limit)
            if belongs.sum() < 0.5 * count or (tried and (belongs == used).all()):
                break
            used = belongs
            solution = self._solve(point, used)
            point = solution.point
        return used, point

    def _scatter_of_median(self, deviation: Array, spoken: NDArray[np.bool_], share: float = 1.0) -> float:
        """Scatter beyond the stated noise that brings the median squared distance to that of χ² with three degrees.

        What was fitted to the records has taken some of it away: ``share`` is what it left.
        """
        deviation, own = deviation[spoken], self._own_covariance()[spoken]

        def excess(variance: float) -> float:
            return float(np.median(squared_distances(deviation, own + variance * np.eye(3)))) - share * MEDIAN

        slack = MEDIAN * 6.0 / np.sqrt(spoken.sum())  # the median of a few records scatters by itself
        if self.stated and excess(0.0) < slack:
            return 0.0
        return float(np.sqrt(_root(excess, deviation)))

    def _own_covariance(self) -> Array:
        """Covariance of each record by the stated noise alone (n, 3, 3) [m²]."""
        return np.asarray(self.tips - max(self.unmodelled, 1e-12) ** 2 * np.eye(3) + self.observations.covariance)

    def _final(self, point: Point, used: NDArray[np.bool_], spoken: NDArray[np.bool_]) -> Fit:
        judged = None
        if self.stated:
            self._prepare(0.0, point)
            judged = self._best_chi2(point, used)
            if _may_be(judged):
                return self._as_stated(point, used, spoken)
            self._prepare(self._scatter_of_median(deviations(self.observations, point), used) or FIRST_SCATTER, point)
        solution = self._solve(point, used)
        for _ in range(MOST_ROUNDS):
            before = self.unmodelled
            self._prepare(self._scatter(solution, used), solution.point)
            solution = self._solve(solution.point, used)
            if abs(self.unmodelled - before) <= 1e-3 * self.unmodelled:
                break
        if self.stated:
            # From afar one step promises too little: judged again where the search came to rest.
            found = self.unmodelled
            self._prepare(0.0, solution.point)
            judged = self._best_chi2(solution.point, used)
            if _may_be(judged):
                return self._as_stated(solution.point, used, spoken)
            self._prepare(found, solution.point)
        return self._done(solution, used, spoken, judged)

    def _as_stated(self, point: Point, used: NDArray[np.bool_], spoken: NDArray[np.bool_]) -> Fit:
        """The fit with the stated noise alone."""
        solution = self._solve(point, used)
        return self._done(solution, used, spoken, _chi2(self.problem, solution))

    def _best_chi2(self, point: Point, used: NDArray[np.bool_]) -> tuple[float, float]:
        """χ² with the noise as stated if one more step were taken: spares the search where that noise cannot be right."""
        solution = standing(self.problem, self.observations, self.tips, point, used.astype(np.float64))
        total, dof = _chi2(self.problem, solution)
        return total - solution.spectrum.promise(), dof

    def _scatter(self, solution: Solution, used: NDArray[np.bool_]) -> float:
        """Scatter beyond the stated noise with which χ² meets its degrees of freedom; as it was where there are none."""
        _, dof = _chi2(self.problem, solution)
        if dof < LEAST_DOF:
            return self.unmodelled
        deviation, own = solution.system.deviation[used], self._own_covariance()[used]
        seats = solution.point.seats
        ties = (self.observations.of_seats(seats), self.observations.of_bars(seats)[0])
        tied = sum(float(np.square(tie).sum()) for tie in ties)

        def excess(variance: float) -> float:
            return float(squared_distances(deviation, own + variance * np.eye(3)).sum()) + tied - dof

        return float(np.sqrt(_root(excess, deviation)))

    def _done(
        self, solution: Solution, used: NDArray[np.bool_], spoken: NDArray[np.bool_], judged: tuple[float, float] | None
    ) -> Fit:
        _, dof = _chi2(self.problem, solution)
        return Fit(
            self.problem,
            self.observations,
            solution,
            self.tips,
            self.unmodelled,
            self.stated,
            used,
            spoken & ~used,
            judged,
            dof,
        )


def covariance_of(values: Array, directions: Array, scales: Array, unknown: Array) -> Array:
    """Covariance of the columns (p, p): inverse of the information across the unknown directions, zero along them.

    Args:
        values: singular values of the scaled system with its prior rows (p,).
        directions: their directions, in columns (p, p).
        scales: of the columns (p,).
        unknown: directions of which the records tell nothing (p, k).
    """
    known = null_space(unknown.T) if unknown.size else np.eye(scales.size)
    information = (values[:, None] * directions.T) @ known
    triangle = np.linalg.qr(information, mode="r")
    scaled = known @ np.linalg.inv(triangle) * scales[:, None]
    return np.asarray(scaled @ scaled.T)


def _chi2(problem: Problem, solution: Solution) -> tuple[float, float]:
    """χ² of the residuals, and its degrees of freedom: rows that count, less what the data determine of the parameters."""
    system = solution.system
    # A parameter that its prior determines costs nothing: trace of (data's information) (whole information)⁻¹.
    spectrum = solution.spectrum
    movable = spectrum.movable
    scaled = spectrum.directions[:, movable] / spectrum.values[movable] * problem.scales[:, None]
    determined = float(np.linalg.norm(system.jacobian @ scaled)) ** 2
    left_out = 3 * int(np.sum((solution.weights == 0.0) & np.isfinite(system.distance)))
    return float(system.residual @ system.residual), system.free - left_out - determined


def _may_be(judged: tuple[float, float]) -> bool:
    """Whether χ² is no larger than its degrees of freedom allow, or there are none to judge it by."""
    return judged[1] < LEAST_DOF or float(chi2_sf(*judged)) >= MISFIT


def deleted_distances(observations: Observations, solution: Solution, noise: Array) -> Array:
    """Squared distance of each record from where the *others* put its target, over its own and that place's variance (n,).

    A record pulls an unknown point towards itself, the more the fewer the others are; and where it has been left out, its
    target is only as sure as the others of its seat make it; bars count for nothing here. Records without a target are
    infinitely far.
    """
    off = deviations(observations, solution.point)
    covariance = noise + observations.covariance
    touched = np.flatnonzero(observations.seat >= 0)
    if touched.size:
        seat = observations.seat[touched]
        weighted = solution.weights[touched, None, None] * np.linalg.inv(covariance[touched])
        tie = np.where(observations.known[:, None], observations.stated_u, np.inf) ** -2.0
        whole = np.zeros((len(observations.labels), 3, 3))
        np.add.at(whole, seat, weighted)
        whole += tie[:, :, None] * np.eye(3)
        rest = np.linalg.inv(whole[seat] - weighted + NOTHING_KNOWN * np.eye(3))
        off[touched] += np.einsum("nij,njk,nk->ni", rest, weighted, off[touched])
        covariance = covariance.copy()
        covariance[touched] += rest
    found = np.full(len(noise), np.inf)
    says = observations.says
    found[says] = squared_distances(off[says], covariance[says])
    return found


def redundant(problem: Problem, solution: Solution) -> bool:
    """Whether the records are enough to tell which of them are wrong: half of them cannot be fitted whatever they say."""
    return _chi2(problem, solution)[1] >= 0.5 * solution.system.free


def squared_distances(deviation: Array, covariance: Array) -> Array:
    """``dᵀ C⁻¹ d`` of each deviation (n, 3) by its covariance (n, 3, 3)."""
    # Stated noise may be nothing at all, of an exact contact with exact readings.
    covariance = covariance + LEAST_SCATTER**2 * np.eye(3)
    return np.asarray(np.einsum("ni,ni->n", deviation, np.linalg.solve(covariance, deviation[:, :, None])[:, :, 0]))


def _root(excess: Callable[[float], float], deviation: Array) -> float:
    """Variance at which ``excess``, which falls with it, vanishes; the largest that can be where it does not."""
    low, high = LEAST_SCATTER**2, 10 * (float(np.square(deviation).sum()) + LEAST_SCATTER**2)
    if excess(low) <= 0:
        return low
    return high if excess(high) > 0 else float(scipy.optimize.brentq(excess, low, high, xtol=1e-24, rtol=1e-10))


LEAST_SCATTER = 1e-10
"""Data from a computer may fit without any residual; the scatter then counts as this [m]."""
