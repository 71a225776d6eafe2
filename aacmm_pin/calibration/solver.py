"""Weighted least squares with prior information: a trust-region search on the analytic
sensitivities, robust where asked.

Levenberg–Marquardt as in MINPACK (Moré 1978): steps are bounded in units of what each parameter
moves the tips by, and a trial that cannot be evaluated is a rejected step. The search always ends,
and says whether it converged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.distributions import chi2_isf, chi2_sf
from aacmm_pin.calibration.first_placement import placed
from aacmm_pin.calibration.linear_model import Spectrum
from aacmm_pin.calibration.linearisation import Linearisation, linearise
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Frame, Prediction, Problem, registered
from aacmm_pin.effects import Effect, StylusOffset
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Observations, centre_of_sphere

MOST_STEPS = 100
SETTLED = 1e-6
"""The search ends when a step promises to lower χ² by less than this: parameters then stand still
to 0.001 u."""
LOOSELY_SETTLED = 1e-2
"""The same of a search whose result is only a start."""
NO_STEP = 1e-12
"""A step that promises less than this is not taken: where it ends is where it begins, to a
millionth of u."""
SHRINKS = 0.9
"""A step of the ends of bars is to be smaller than this part of the one before."""
AT_BEST = 1e-7
"""Ends of bars that move by less than this are where they fit best [m]."""
FLAT_REDUCTION = 1e-2
"""A promise below this that nothing comes of ends the search too: it is within 0.1 u of its end."""
CREEPING = 6
"""A step after so many that gains much less than it promises has a poor derivative: how what bends
answers to the others is then worked out, once. Without it a search may creep along a valley in
which that is all that the records tell."""
SMALLEST_STEP = 1e-12
"""A trust region smaller than this part of the first step has no better point in it."""
ROUNDING = 1e-12
"""χ² is no more certain than this part of it."""
SINGULAR_RATIO = 1e-13
"""Directions with smaller singular values, beside the largest, are rounding."""
WILD = 2.0
"""Records this many standard deviations off have half weight in the robust search (Cauchy's weight
function)."""
FEWEST_PLACED = 3
"""Records with coordinates that find a frame or a target."""
MEDIAN = float(chi2_isf(0.5, 3))
LEAST_DOF = 0.5
"""With fewer degrees of freedom records do not tell their scatter; widths that nobody stated leave
a little above zero."""
MISFIT = 1e-3
"""χ² with less chance than this is larger than the stated noise explains; with more than one minus
this, smaller."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where the search stands: parameters, frame, the seats' points (s, 3) [m], and what follows
    from them.
    """

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
        """Whether it is no larger than its degrees of freedom allow, or there are none to judge it
        by.
        """
        if self.dof < LEAST_DOF:
            return True
        return float(chi2_sf(*self)) >= MISFIT


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the search ended.

    Attributes:
        point: parameters and predictions.
        system: the linear model there.
        problem: what was unknown.
        noise: of the records.
        weights: of the records in the last step (n,).
        steps: number of steps tried.
        message: why the search ended before it converged; "" where it converged.
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
        """χ² and its degrees of freedom: rows that count, less what the data determine of the
        parameters.
        """
        residual = self.system.residual
        excluded = int(self.observations.counts[self.weights == 0.0].sum())
        return Chi2(
            float(residual @ residual), self.system.free - excluded - self.system.determined
        )

    @cached_property
    def turn_dof(self) -> float:
        """How many of the degrees of freedom are those of turns."""
        counts = self.observations.counts
        if not self.problem.turns:
            return 0.0
        known = int((counts > 0).sum())
        rows = self.system.jacobian[: 6 * known] @ self.system.independent_steps
        turns = rows.reshape(known, 6, rows.shape[1])[:, 3:]
        stated = (counts == 6) & (self.weights > 0.0)
        return 3.0 * int(stated.sum()) - float(np.square(turns).sum())

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The estimated effects with the values found."""
        return self.problem.vector.at(self.point.x)


def initial_point(problem: Problem, observations: Observations) -> Point:
    """The start: frame and unknown targets by a robust registration, the unknown points by medians.

    Raises:
        AacmmError: an unknown frame, and fewer than three records with coordinates.
    """
    frame = Frame.identity(len(problem.targets))
    x = problem.start
    known = problem.measurements.known
    prediction = problem.predict(x, frame)
    offsets = _offsets(problem)
    tips = prediction.tips
    enough = known.sum() >= FEWEST_PLACED
    at, stated = tips[known], problem.measurements.reference[known]
    if problem.external and not enough:
        at, stated = _with_centres(observations, tips, at, stated)
    if problem.external and len(at) < FEWEST_PLACED:
        raise AacmmError(
            f"{problem.measurements.source}: {len(at)} records or spheres have reference "
            "coordinates; expected 3 or more to estimate their frame"
        )
    if offsets.size and enough:
        found, moved = placed(problem, tips, prediction.jacobian[:, :3, offsets])
        frame = replace(found, targets=frame.targets)
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


def _with_centres(
    observations: Observations, tips: Array, at: Array, stated: Array
) -> tuple[Array, Array]:
    """Points in the base and in the frame of the references (n, 3) [m], with the centres of spheres
    that the records state.
    """
    places = [at]
    for k in np.flatnonzero(observations.spheres & observations.known):
        own = observations.seat == k
        radius = float(observations.radius[own][0])
        places.append(centre_of_sphere(tips[own], radius)[None])
        stated = np.concatenate([stated, observations.stated[k : k + 1]])
    return np.concatenate(places), stated


def _offsets(problem: Problem) -> Index:
    """Places of the unknown offsets of targets among the parameters (m,); nobody states these."""
    own = [np.r_[own] for effect, own in problem.vector if isinstance(effect, StylusOffset)]
    places: Index = np.concatenate([np.arange(0), *own])
    return places[~problem.stated[places]]


def solve(
    problem: Problem,
    noise: NoiseModel,
    start: Point,
    weights: Array,
    *,
    robust: bool = False,
    roughly: bool = False,
) -> Solution:
    """Search from ``start``; the best point found, whether or not the search converged.

    Args:
        problem: what is unknown.
        noise: what the records say, and how uncertain it is.
        start: see :func:`initial_point`.
        weights: of the records (n,), 0 leaves one out.
        robust: weigh records by how well they fit, anew in every step.
        roughly: the result is only a start for another search.
    """
    tolerance = LOOSELY_SETTLED if robust or roughly else SETTLED
    return _Search(problem, noise, weights, robust, tolerance).run(start)


class _Search:
    """One search from one start."""

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
        """Step after step until one of the ends is reached."""
        system = self.system(point)
        message = f"{MOST_STEPS} steps were not enough"
        for count in range(1, MOST_STEPS + 1):
            if self.robust:
                self.weights = _robust_weights(np.fmax(system.distance, system.turn_distance))
                del system
                system = self.system(point)
            point, system = self.seats_at_best(point, system)
            step = _Step.of(system, self.units)
            self.units, predicted = step.units, step.predicted_reduction
            # Of a mere start it need not be taken.
            if predicted < (NO_STEP if self.final else self.tolerance):
                message = ""
                break
            cost = system.cost
            delta = step.within(self.radius)
            seats = point.seats + system.seat_step(delta.parameters)
            del step, system  # the rows of one system are most of what a search holds
            trial, reduction = self.trial(point, seats, delta.parameters, cost)
            ratio = reduction / delta.predicted if delta.predicted > 0 else 0.0
            self.adapt_radius(delta.length, ratio)
            if trial is not None and reduction >= -ROUNDING * cost:
                point, system = trial
            else:
                system = self.system(point)
            del trial
            if predicted < self.tolerance or (predicted < FLAT_REDUCTION and reduction < SETTLED):
                message = ""
                break
            if self.radius < SMALLEST_STEP * self.first_length:
                message = "no step lowers the residuals"
                break
            if count >= CREEPING and ratio < 0.75 and self.needs_elastic_correction(point):
                point, system = self.with_correction(point)
        return Solution(point, system, self.problem, self.noise, self.weights, count, message)

    def adapt_radius(self, length: float, ratio: float) -> None:
        """A smaller trust region after a step that gained little of what was predicted, a larger
        one after a good step.
        """
        self.first_length = self.first_length or length
        if not ratio > 0.25:
            self.radius = length / 4
        elif ratio > 0.75:
            self.radius = max(self.radius, 2 * length)

    def system(self, point: Point) -> Linearisation:
        """The linear model at a point."""
        prior = self.problem.prior(point.x)
        return linearise(point.prediction, prior, self.noise, point.seats, self.weights)

    def trial(
        self, point: Point, seats: Array, step: Array, cost: float
    ) -> tuple[tuple[Point, Linearisation] | None, float]:
        """Where a step leads, and by how much χ² is lower than ``cost`` there.

        None and -∞ where the arm cannot be evaluated there, such as one too soft to carry its
        weight.
        """
        x, of_frame = np.split(step, [point.x.size])
        x = point.x + x
        frame = point.frame.moved(of_frame)
        try:
            prediction = self.problem.predict(x, frame)
        except AacmmError:  # it could be evaluated where the search began
            return None, -np.inf
        there = self.corrected(Point(x, frame, seats, prediction))
        system = self.system(there)
        reduction = cost - system.cost
        return (there, system), reduction if np.isfinite(reduction) else -np.inf

    def corrected(self, point: Point) -> Point:
        """The point with what its derivative leaves out, once that is worked out."""
        if self.correction is None:
            return point
        jacobian = point.prediction.jacobian + self.correction
        return replace(point, prediction=replace(point.prediction, jacobian=jacobian))

    def needs_elastic_correction(self, point: Point) -> bool:
        """Whether the derivative may be poor: the final search in an arm that bends."""
        exact = not self.robust and self.final
        return self.correction is None and exact and self.problem.bends(point.x)

    def with_correction(self, point: Point) -> tuple[Point, Linearisation]:
        """Work out what the derivative leaves out, and go on from the same point with it."""
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
        """The ends of bars where they fit best, parameters as they are.

        A system's residual is as if the seats were there, which they are where nothing but
        coordinates is known of them; where a bar's length is, no step may seem to lower it.
        """
        if not len(self.noise.observations.ends):
            return point, system
        before = np.inf
        still = np.zeros(self.problem.scales.size)
        for _ in range(MOST_STEPS):
            step = system.seat_step(still)
            size = np.abs(step).max(initial=0.0)
            # Bars that cannot be met at all make it go to and fro.
            if size < AT_BEST or size > SHRINKS * before:
                break
            before = size
            point = replace(point, seats=point.seats + step)
            system = self.system(point)
        return point, system


class Delta(NamedTuple):
    """A step of the parameters (p,) [units], its length, and by how much it lowers χ² if the
    problem is linear.
    """

    parameters: Array
    length: float
    predicted: float


@dataclass(frozen=True, eq=False)
class _Step:
    """Steps in a trust region, each column divided by its length: what its parameter moves the tips
    by.

    Attributes:
        system: the linear model.
        units: lengths of its columns, never less than in the steps before (p,).
    """

    system: Linearisation
    units: Array

    @staticmethod
    def of(system: Linearisation, before: Array) -> _Step:
        """Of a system, after steps in units ``before`` (p,)."""
        normal = system.normal
        lengths = (
            np.linalg.norm(system.triangle[:, :-1], axis=0) if normal is None else normal.lengths
        )
        return _Step(system, np.maximum(before, lengths))

    @cached_property
    def _divisors(self) -> Array:
        return np.where(self.units > 0.0, self.units, 1.0)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array, Array]:
        """Singular values, directions, the residual along them; for steps that are too long, or
        where some are unknown.
        """
        spectrum = Spectrum.of(self.system.triangle, self._divisors)
        return spectrum.above(SINGULAR_RATIO * spectrum.values.max(initial=0.0))

    @property
    def predicted_reduction(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        if self.system.normal is None:
            return float(np.square(self._spectrum[2]).sum())
        return self.system.normal.predicted_reduction

    def within(self, radius: float) -> Delta:
        """The best step no longer than ``radius`` in these units."""
        normal = self.system.normal
        if normal is not None:
            step = normal.step * (self.units / normal.lengths)
            length = float(np.linalg.norm(step))
            if length <= radius:
                return Delta(self._in_parameters(step), length, normal.predicted_reduction)
        values, directions, along = self._spectrum
        damping = self._damping(radius)
        part = -values * along / (values**2 + damping)
        remaining = damping / (values**2 + damping)
        predicted = float(np.sum(along**2 * (1.0 - remaining**2)))
        return Delta(self._in_parameters(directions @ part), float(np.linalg.norm(part)), predicted)

    def _in_parameters(self, step: Array) -> Array:
        relative = step / self._divisors
        return relative * self.system.prior.scales

    def _damping(self, radius: float) -> float:
        """What is added to the squared singular values so that the step is as long as ``radius``; 0
        if it is shorter.
        """
        values, _, along = self._spectrum

        def excess(log_damping: float) -> float:
            step = values * along / (values**2 + np.exp(log_damping))
            return float(np.linalg.norm(step) - radius)

        if np.linalg.norm(along / values) <= radius:
            return 0.0
        high = max(float(np.linalg.norm(values * along) / radius), 1e-290)
        return float(np.exp(scipy.optimize.brentq(excess, np.log(1e-300), np.log(high), rtol=1e-3)))


def solution_at(problem: Problem, noise: NoiseModel, point: Point, weights: Array) -> Solution:
    """The linear model at a point, as if the search ended there."""
    system = linearise(point.prediction, problem.prior(point.x), noise, point.seats, weights)
    return Solution(point, system, problem, noise, weights, 0, "")


def deviations(observations: Observations, point: Point) -> Array:
    """Tip minus target (n, 3) [m], the turn behind it where orientations are stated (n, 6) [rad];
    NaN where it has none.
    """
    return observations.deviations(point.prediction.poses, point.seats)


def _robust_weights(distance: Array) -> Array:
    """Cauchy's weights of squared distances, scaled by their median over the records that count at
    all.
    """
    counts = np.isfinite(distance)
    scale = np.median(distance[counts]) / MEDIAN if counts.any() else 1.0
    relative = np.where(counts, distance, 0.0) / max(float(scale), 1e-300)
    return 1.0 / (1.0 + relative / (3 * WILD**2))
