"""Weighted least squares with prior information: Levenberg–Marquardt on the analytic sensitivities, deaf to wild records."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aacmm_pin.calibration.problem import Frame, Prediction, Problem, registered
from aacmm_pin.calibration.system import System, assemble
from aacmm_pin.checks import Array
from aacmm_pin.distributions import chi2_isf
from aacmm_pin.errors import AacmmError
from aacmm_pin.observations import KnownLength, Observation

MOST_STEPS = 60
SETTLED = 1e-6
"""The search ends when a step promises to lower χ² by less than this: parameters then stand still to 0.001 u."""
LOOSELY_SETTLED = 1e-2
"""The same of a search whose result is only a start."""
AT_BEST = 1e-7
"""Ends of bars that move by less than this are where they fit best [m]."""
FLAT = 1e-2
"""A promise below this that nothing comes of ends the search too: what bends under weight has no exact derivative here."""
CREEPING = 6
"""A step after so many that gains much less than it promises has a poor derivative: how what bends answers to the others is
then worked out, once. Without it a search may creep along a valley in which that is all that the records tell."""
FLOOR = 0.01
"""Smallest damping, beside the square of the smallest singular value that matters."""
MOST_DAMPING = 1e10
"""Largest damping, beside the square of the largest; with more no step moves anything."""
LEAST_KNOWN = 0.1
"""A direction about which data and stated uncertainties together say less than this, one over its width, is not known."""
WILD = 2.0
"""Records this many standard deviations off have half weight in the robust search (Cauchy's weight function)."""
MEDIAN = float(chi2_isf(0.5, 3))


@dataclass(frozen=True, eq=False)
class Point:
    """Where the search stands: parameters, frame, the observations' unknown points, and what follows from them."""

    x: Array
    frame: Frame
    nuisances: list[Array]
    prediction: Prediction


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values of the scaled system with its prior rows.

    Attributes:
        values: (p,), largest first.
        directions: (p, p), columns in units of the scales.
        along: residual along each direction, so that ``-along / values`` is the Gauss–Newton step.
        assumed: part of each squared value that comes from widths which nobody stated (p,).
    """

    values: Array
    directions: Array
    along: Array
    assumed: Array

    @property
    def known(self) -> NDArray[np.bool_]:
        """(p,) True for directions of which the data or stated uncertainties say something."""
        return np.asarray(self.values**2 - self.assumed >= LEAST_KNOWN**2)

    @property
    def movable(self) -> NDArray[np.bool_]:
        """(p,) True for directions along which a step can be taken at all."""
        return np.asarray(self.values > 1e-9)

    def step(self, damping: float) -> Array:
        """Damped step in units of the scales."""
        values = self.values[self.movable]
        return np.asarray(-self.directions[:, self.movable] @ (values / (values**2 + damping) * self.along[self.movable]))

    def promise(self, damping: float = 0.0) -> float:
        """How much the step lowers χ² if the problem is linear."""
        squared = self.values[self.movable] ** 2
        left = damping / (squared + damping)
        return float(np.sum(self.along[self.movable] ** 2 * (1.0 - left**2)))


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the search ended.

    Attributes:
        point: parameters and predictions.
        system: the linear system there.
        problem: what was unknown.
        weights: of the records in the last step (n,).
        steps: number of steps taken.
    """

    point: Point
    system: System
    problem: Problem
    weights: Array
    steps: int

    @property
    def creeps(self) -> bool:
        """Whether the search was ended before it settled, which it may within 0.1 u of the end."""
        return self.steps == MOST_STEPS and self.spectrum.promise() > SETTLED

    @cached_property
    def spectrum(self) -> Spectrum:
        """Singular values of the system; not asked for where the search is only a start."""
        return spectrum_of(self.problem, self.system, self.point.x)


def begin(problem: Problem, observations: list[Observation]) -> Point:
    """The start: the frame by a robust registration, the unknown points by medians."""
    prediction = problem.predict(problem.start, Frame.identity())
    frame = Frame.identity()
    if problem.external:
        known = problem.measurements.known
        if known.sum() < 3:
            raise AacmmError(f"{known.sum()} records have reference coordinates, expected 3 or more to find their frame")
        frame = registered(prediction.tips[known], problem.measurements.reference[known])
        prediction = problem.predict(problem.start, frame)
    return Point(problem.start, frame, [o.start(prediction.tips[o.records]) for o in observations], prediction)


def solve(
    problem: Problem,
    observations: list[Observation],
    noise: Array,
    start: Point,
    weights: Array,
    *,
    robust: bool = False,
    roughly: bool = False,
) -> Solution:
    """Search from ``start``.

    Args:
        problem: what is unknown.
        observations: what the records say.
        noise: covariance of each tip, in the base (n, 3, 3) [m²].
        start: see :func:`begin`.
        weights: of the records (n,), 0 leaves one out.
        robust: weigh records by how well they fit, anew in every step.
        roughly: the result is only a start for another search.

    Raises:
        AacmmError: the search does not settle.
    """
    point, damping, answer = start, 0.0, None
    system = _system(problem, point, observations, noise, weights)
    for count in range(1, MOST_STEPS + 1):
        if robust:
            weights = _by_fit(system.distance)
            system = _system(problem, point, observations, noise, weights)
        point, system = _at_best(problem, point, system, observations, noise, weights)
        spectrum = spectrum_of(problem, system, point.x)
        top = float(spectrum.values.max(initial=0.0)) or 1.0  # a set-up may have no unknown parameter at all
        # Any damping that matters holds back the direction that is known least; the others hardly notice.
        cost, floor = _cost(problem, system, point.x), FLOOR * float(spectrum.values[spectrum.movable].min(initial=top)) ** 2
        while True:
            trial = _answered(_advanced(problem, point, system, spectrum.step(damping) * problem.scales), answer)
            tried = _system(problem, trial, observations, noise, weights)
            gained = cost - _cost(problem, tried, trial.x)
            if gained >= -1e-12 * cost - SETTLED:
                break
            damping = max(10 * damping, floor)
            if damping > MOST_DAMPING * top**2:
                raise AacmmError("the calibration does not settle: no step lowers the residuals; are the angles right?")
        point, system = trial, tried
        ends = LOOSELY_SETTLED if robust or roughly else SETTLED
        if spectrum.promise() < ends or (spectrum.promise() < FLAT and gained < SETTLED):
            return Solution(point, system, problem, weights, count)
        promised = spectrum.promise(damping)
        share = gained / promised if promised > 0 else 0.0
        damping = max(10 * damping, floor) if share < 0.25 else damping / 10 if damping > floor and share > 0.75 else damping
        damping = 0.0 if share > 0.75 and damping <= floor else damping
        if count >= CREEPING and share < 0.75 and answer is None and not (robust or roughly) and problem.bends(point.x):
            answer, damping = problem.answer_of_bending(point.x, point.frame, point.prediction), 0.0
            point = _answered(point, answer)
            system = _system(problem, point, observations, noise, weights)
    # Only a start: what follows from there has to settle. Or a valley whose end is less than 0.1 u away.
    if robust or roughly or spectrum.promise() < FLAT:
        return Solution(point, system, problem, weights, MOST_STEPS)
    raise AacmmError(f"the calibration does not settle in {MOST_STEPS} steps; are the start values and the angles right?")


def standing(problem: Problem, observations: list[Observation], noise: Array, point: Point, weights: Array) -> Solution:
    """The system at a point, as if the search ended there."""
    system = _system(problem, point, observations, noise, weights)
    return Solution(point, system, problem, weights, 0)


def deviations(observations: list[Observation], point: Point) -> Array:
    """Tip minus target (n, 3) [m]; nan where a record has none."""
    found = np.full(point.prediction.tips.shape, np.nan)
    for observation, values in zip(observations, point.nuisances, strict=True):
        found[observation.records] = point.prediction.tips[observation.records] - observation.targets(values)[0]
    return found


def spectrum_of(problem: Problem, system: System, x: Array) -> Spectrum:
    """Singular values of the scaled system, prior rows included."""
    rows, prior = _prior(problem, x)
    measured = np.column_stack([system.jacobian * problem.scales, system.residual])
    triangle: Array = np.linalg.qr(np.vstack([measured, np.column_stack([rows, prior])]), mode="r")  # type: ignore[assignment]
    p = problem.scales.size
    u, values, vt = np.linalg.svd(triangle[:, :p], full_matrices=False)
    missing = p - values.size
    if missing > 0:  # fewer rows than parameters: the rest of the directions is unknown
        _, _, vt = np.linalg.svd(triangle[:, :p], full_matrices=True)
        values, u = np.pad(values, (0, missing)), np.pad(u, ((0, 0), (0, missing)))
    assumed = np.zeros(p)
    assumed[: problem.stated.size] = ~problem.stated
    return Spectrum(values, vt.T, u.T @ triangle[:, p], vt**2 @ assumed)


def noise_of_tips(problem: Problem, frame: Frame, encoder: Array | None, unmodelled: float) -> Array:
    """Covariance of each tip in the frame of the references: readings, and what no stated noise explains (n, 3, 3) [m²]."""
    n = problem.measurements.n
    covariance = np.broadcast_to(max(unmodelled, 1e-12) ** 2 * np.eye(3), (n, 3, 3))
    if encoder is None or not encoder.any():
        return covariance
    tips = np.einsum("j,njik->nik", encoder**2, problem.reading_covariance)
    return np.asarray(covariance + frame.rotation @ tips @ frame.rotation.T)


def _system(problem: Problem, point: Point, observations: list[Observation], noise: Array, weights: Array) -> System:
    return assemble(point.prediction, observations, point.nuisances, noise, weights)


def _advanced(problem: Problem, point: Point, system: System, step: Array) -> Point:
    p = point.x.size
    frame = point.frame.moved(step[p:]) if problem.external else point.frame
    moved = zip(point.nuisances, system.nuisances(step), strict=True)
    x = point.x + step[:p]
    return Point(x, frame, [values + change for values, change in moved], problem.predict(x, frame))


def _answered(point: Point, answer: Array | None) -> Point:
    """The point with what its derivative leaves out."""
    if answer is None:
        return point
    return replace(point, prediction=replace(point.prediction, jacobian=point.prediction.jacobian + answer))


def _at_best(
    problem: Problem, point: Point, system: System, observations: list[Observation], noise: Array, weights: Array
) -> tuple[Point, System]:
    """The ends of bars where they fit best, parameters as they are.

    A system's residual is as if its nuisances were there, which linear ones are; where they are not, no step may seem to
    lower it.
    """
    for _ in range(MOST_STEPS if any(isinstance(o, KnownLength) for o in observations) else 0):
        steps = system.nuisances(np.zeros(problem.scales.size))
        if max(np.abs(step).max(initial=0.0) for step in steps) < AT_BEST:
            break
        point = replace(point, nuisances=[value + step for value, step in zip(point.nuisances, steps, strict=True)])
        system = _system(problem, point, observations, noise, weights)
    return point, system


def _prior(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Rows that say how far each parameter may be off, in units of the widths, and their residuals; none for the frame."""
    return np.eye(x.size, problem.scales.size), (x - problem.start) / problem.widths


def _cost(problem: Problem, system: System, x: Array) -> float:
    prior = _prior(problem, x)[1]
    return float(system.residual @ system.residual + prior @ prior)


def _by_fit(distance: Array) -> Array:
    """Cauchy's weights of squared distances, scaled by their median over the records that count at all."""
    counts = np.isfinite(distance)
    scale = np.median(distance[counts]) / MEDIAN if counts.any() else 1.0
    relative = np.where(counts, distance, 0.0) / max(float(scale), 1e-300)
    return np.asarray(1.0 / (1.0 + relative / (3 * WILD**2)))
