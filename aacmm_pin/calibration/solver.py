"""Weighted least squares with a prior: a trust-region search on the analytic sensitivities.

Levenberg–Marquardt as in MINPACK (Moré 1978): steps are bounded in units of what each parameter
moves the tips by; a trial that cannot be evaluated is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.distributions import chi2_isf, chi2_sf
from aacmm_pin.calibration.first_placement import placed
from aacmm_pin.calibration.least_squares import bounded_step
from aacmm_pin.calibration.linearisation import Linearisation, linearise
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Frame, Prediction, Problem, registered
from aacmm_pin.effects import Effect, StylusOffset
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Observations, centre_of_sphere

MOST_STEPS = 100
SETTLED = 1e-6
"""The search ends when a step promises to lower χ² by less: parameters stand still to 0.001 u."""
LOOSELY_SETTLED = 1e-2
"""The same of a mere start."""
NO_STEP = 1e-12
"""A step that promises less is not taken: it is a millionth of u."""
AT_BEST = 1e-7
"""Least motion of the ends of relations [m]."""
FLAT_REDUCTION = 1e-2
"""A promise below this that nothing comes of ends the search too, within 0.1 u."""
CREEPING = 6
"""A later step that gains much less than it promises has a poor derivative: the response of elastic
effects is then computed, once. Otherwise a search may creep along a valley that this determines.
"""
SMALLEST_STEP = 1e-12
"""Least radius of the trust region, as a part of the first step."""
ROUNDING = 1e-12
WILD = 2.0
"""Standard deviations with half weight in Cauchy's function."""
FEWEST_PLACED = 3
MEDIAN = float(chi2_isf(0.5, 3))
LEAST_DOF = 0.5
"""With fewer, records do not determine their scatter; unstated widths leave a little above zero."""
MISFIT = 1e-3
"""Least chance of χ² that the stated noise explains."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where the search stands; ``seats`` are points (s, 3) [m]."""

    x: Array
    frame: Frame
    seats: Array
    prediction: Prediction


class Chi2(NamedTuple):
    """χ² of residuals, and its degrees of freedom."""

    value: float
    dof: float

    @property
    def acceptable(self) -> bool:
        """Whether its degrees of freedom, if any, allow it."""
        if self.dof < LEAST_DOF:
            return True
        return float(chi2_sf(*self)) >= MISFIT


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the search ended.

    Attributes:
        weights: of the records (n,).
        message: why the search ended before it converged; "" if it converged.
    """

    point: Point
    system: Linearisation
    problem: Problem
    noise: NoiseModel
    weights: Array
    steps: int
    message: str

    @property
    def observations(self) -> Observations:
        """What the records say."""
        return self.noise.observations

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return not self.message

    @cached_property
    def chi2(self) -> Chi2:
        """χ², and rows that count less the parameters that they determine."""
        residual = self.system.residual
        excluded = int(self.observations.counts[self.weights == 0.0].sum())
        return Chi2(
            float(residual @ residual), self.system.free - excluded - self.system.determined
        )

    @cached_property
    def turn_dof(self) -> float:
        """The degrees of freedom of turns."""
        counts = self.observations.counts
        if not self.problem.turns:
            return 0.0
        counting = int((counts > 0).sum())
        rows = self.system.jacobian[: 6 * counting] @ self.system.independent_steps
        turns = rows.reshape(counting, 6, rows.shape[1])[:, 3:]
        stated = (counts == 6) & (self.weights > 0.0)
        return 3.0 * int(stated.sum()) - float(np.square(turns).sum())

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The estimated effects with the values found."""
        return self.problem.vector.at(self.point.x)


def initial_point(problem: Problem, observations: Observations) -> Point:
    """The start: frame and targets by a robust registration, unknown points by medians.

    Raises:
        AacmmError: an unknown frame, and fewer than three records with coordinates.
    """
    frame = Frame.identity(len(problem.targets))
    x = problem.start
    stating = problem.measurements.known
    prediction = problem.predict(x, frame)
    is_offset = np.zeros(x.size, dtype=bool)
    for effect, entries in problem.vector:
        is_offset[entries] = isinstance(effect, StylusOffset)
    offsets = np.flatnonzero(is_offset & ~problem.stated)
    tips = prediction.tips
    enough = stating.sum() >= FEWEST_PLACED
    at, stated = tips[stating], problem.measurements.reference[stating]
    if problem.external and not enough:
        for k in np.flatnonzero(observations.spheres & observations.known):
            contacts = observations.seat == k
            centre = centre_of_sphere(tips[contacts], float(observations.radius[contacts][0]))
            at = np.concatenate([at, centre[None]])
            stated = np.concatenate([stated, observations.stated[k : k + 1]])
    if problem.external and len(at) < FEWEST_PLACED:
        raise AacmmError(
            f"{problem.measurements.source}: {len(at)} records or spheres have reference "
            "coordinates; expected 3 or more to estimate their frame"
        )
    if offsets.size and enough:
        placement, moved = placed(problem, tips, prediction.jacobian[:, :3, offsets])
        frame = replace(placement, targets=frame.targets)
        x = x.copy()
        x[offsets] += moved
    elif problem.external:
        frame = replace(registered(at, stated), targets=frame.targets)
    if problem.turns:
        frame = problem.with_targets(x, frame)
    if problem.turns or offsets.size:
        prediction = problem.predict(x, frame)
    elif problem.external:
        prediction = Prediction(frame.apply(tips), frame.rotation @ prediction.jacobian)
    return Point(x, frame, observations.start(prediction.tips), prediction)


def solve(
    problem: Problem,
    noise: NoiseModel,
    start: Point,
    weights: Array,
    *,
    robust: bool = False,
    roughly: bool = False,
) -> Solution:
    """Search from ``start``; the best point, whether or not the search converged.

    Args:
        weights: of the records (n,), 0 leaves one out.
        robust: weigh records anew in every step.
    """
    tolerance = LOOSELY_SETTLED if robust or roughly else SETTLED
    return _Search(problem, noise, weights, robust, tolerance).run(start)


class _Search:
    def __init__(
        self, problem: Problem, noise: NoiseModel, weights: Array, robust: bool, tolerance: float
    ) -> None:
        self.problem, self.noise, self.weights = problem, noise, weights
        self.robust, self.tolerance = robust, tolerance
        self.final = tolerance == SETTLED
        self.radius, self.first_length = np.inf, 0.0
        self.correction: Array | None = None
        self.units = np.zeros(problem.scales.size)

    def run(self, point: Point) -> Solution:
        system = self.system(point)
        message = f"{MOST_STEPS} steps were not enough"
        for count in range(1, MOST_STEPS + 1):
            if self.robust:
                self.weights = _robust_weights(np.fmax(system.distance, system.turn_distance))
                del system
                system = self.system(point)
            if self.robust or count == 1:
                point, system = self.seats_at_best(point, system)
            self.units = np.maximum(self.units, system.lengths)
            step = bounded_step(system, self.units, self.radius)
            # Of a mere start it need not be taken.
            if step.reduction < (NO_STEP if self.final else self.tolerance):
                message = ""
                break
            cost = system.cost
            seats = point.seats + system.seat_step(step.parameters)
            del system  # the rows of one system are most of what a search holds
            trial, reduction = self.trial(point, seats, step.parameters, cost)
            ratio = reduction / step.predicted if step.predicted > 0 else 0.0
            self.adapt_radius(step.length, ratio)
            if trial is not None and reduction >= -ROUNDING * cost:
                point, system = trial
            else:
                system = self.system(point)
            del trial
            flat = step.reduction < FLAT_REDUCTION and reduction < SETTLED
            if step.reduction < self.tolerance or flat:
                message = ""
                break
            if self.radius < SMALLEST_STEP * self.first_length:
                message = "no step lowers the residuals"
                break
            if count >= CREEPING and ratio < 0.75 and self.needs_elastic_correction(point):
                point, system = self.with_correction(point)
        return Solution(point, system, self.problem, self.noise, self.weights, count, message)

    def adapt_radius(self, length: float, ratio: float) -> None:
        self.first_length = self.first_length or length
        if not ratio > 0.25:
            self.radius = length / 4
        elif ratio > 0.75:
            self.radius = max(self.radius, 2 * length)

    def system(self, point: Point) -> Linearisation:
        return solution_at(self.problem, self.noise, point, self.weights).system

    def trial(
        self, point: Point, seats: Array, step: Array, cost: float
    ) -> tuple[tuple[Point, Linearisation] | None, float]:
        """The point after a step, and by how much χ² is lower than ``cost``; None and -∞ for an arm
        that cannot be evaluated, such as one too soft for its weight.
        """
        x, of_frame = np.split(step, [point.x.size])
        x = point.x + x
        frame = point.frame.moved(of_frame)
        try:
            prediction = self.problem.predict(x, frame)
        except AacmmError:  # it could be evaluated where the search began
            return None, -np.inf
        there = self.corrected(Point(x, frame, seats, prediction))
        there, system = self.seats_at_best(there, self.system(there))
        reduction = cost - system.cost
        return (there, system), reduction if np.isfinite(reduction) else -np.inf

    def corrected(self, point: Point) -> Point:
        if self.correction is None:
            return point
        jacobian = point.prediction.jacobian + self.correction
        return replace(point, prediction=replace(point.prediction, jacobian=jacobian))

    def needs_elastic_correction(self, point: Point) -> bool:
        exact = not self.robust and self.final
        return self.correction is None and exact and self.problem.bends(point.x)

    def with_correction(self, point: Point) -> tuple[Point, Linearisation]:
        try:
            self.correction = self.problem.elastic_jacobian_correction(
                point.x, point.frame, point.prediction
            )
        except AacmmError:  # a neighbour of this point is too soft
            self.correction = np.zeros_like(point.prediction.jacobian)
        self.radius = np.inf
        point = self.corrected(point)
        return point, self.system(point)

    def seats_at_best(self, point: Point, system: Linearisation) -> tuple[Point, Linearisation]:
        """So that no step of the parameters seems to lower what the relations add to χ²."""
        if not len(self.noise.observations.ends):
            return point, system
        still = np.zeros(self.problem.scales.size)
        for _ in range(MOST_STEPS):
            step = system.seat_step(still)
            # Relations turn planes, which is not linear: the whole step may lead far away.
            while np.abs(step).max(initial=0.0) >= AT_BEST:
                nearer = replace(point, seats=point.seats + step)
                there = self.system(nearer)
                if there.seats_cost < system.seats_cost:
                    break
                step = step / 4
            else:
                break
            gain = system.seats_cost - there.seats_cost
            point, system = nearer, there
            if gain < SETTLED:
                break
        return point, system


def solution_at(problem: Problem, noise: NoiseModel, point: Point, weights: Array) -> Solution:
    """The linear model at a point, as if the search ended there."""
    system = linearise(point.prediction, problem.prior(point.x), noise, point.seats, weights)
    return Solution(point, system, problem, noise, weights, 0, "")


def chi2_of(solution: Solution, records: Mask) -> Chi2:
    """χ² of some records (n,) and the prior, after a fit to them alone, to first order."""
    observations = solution.observations
    seat = np.where(records, observations.seat, -1)
    one_part = np.zeros(records.size, dtype=np.intp)
    observations, old, _ = replace(observations, seat=seat).divided(one_part)
    noise = replace(solution.noise, observations=observations)
    point = replace(solution.point, seats=solution.point.seats[old])
    there = solution_at(solution.problem, noise, point, records.astype(np.float64))
    return Chi2(there.system.cost - there.system.solution.reduction, there.chi2.dof)


def _robust_weights(distance: Array) -> Array:
    """Cauchy's weights, of squared distances over their median."""
    counts = np.isfinite(distance)
    scale = np.median(distance[counts]) / MEDIAN if counts.any() else 1.0
    relative = np.where(counts, distance, 0.0) / max(float(scale), 1e-300)
    return 1.0 / (1.0 + relative / (3 * WILD**2))
