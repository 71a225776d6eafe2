"""Weighted least squares with prior information: a trust-region search on the analytic sensitivities, robust where asked.

Levenberg–Marquardt as in MINPACK (Moré 1978): steps are bounded in units of what each parameter moves the tips by, and a
trial that cannot be evaluated is a rejected step. The search always ends, and says whether it converged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.sparse import csr_array

from aacmm_pin._support.checks import Array, Index
from aacmm_pin._support.distributions import chi2_isf, chi2_sf
from aacmm_pin.calibration.first_placement import placed
from aacmm_pin.calibration.linear_system import System, assemble
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Frame, Prediction, Problem, registered
from aacmm_pin.effects import Effect, StylusOffset
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.observations import Observations

MOST_STEPS = 100
SETTLED = 1e-6
"""The search ends when a step promises to lower χ² by less than this: parameters then stand still to 0.001 u."""
LOOSELY_SETTLED = 1e-2
"""The same of a search whose result is only a start."""
NO_STEP = 1e-12
"""A step that promises less than this is not taken: where it ends is where it begins, to a millionth of u."""
SHRINKS = 0.9
"""A step of the ends of bars is to be smaller than this part of the one before."""
AT_BEST = 1e-7
"""Ends of bars that move by less than this are where they fit best [m]."""
FLAT = 1e-2
"""A promise below this that nothing comes of ends the search too: it is within 0.1 u of its end."""
CREEPING = 6
"""A step after so many that gains much less than it promises has a poor derivative: how what bends answers to the others is
then worked out, once. Without it a search may creep along a valley in which that is all that the records tell."""
SMALLEST_STEP = 1e-12
"""A trust region smaller than this part of the first step has no better point in it."""
LEAST_KNOWN = 0.1
"""A direction about which data and stated uncertainties together say less than this, one over its width, is not known."""
ROUNDING = 1e-12
"""χ² is no more certain than this part of it."""
MOVABLE = 1e-9
"""A direction with a singular value below this, of columns times their widths, is one along which no step can be taken."""
UNEVEN = 1e-6
"""Normal equations do where every singular value, of columns of length one, is certain to be above this: errors of the
smallest are then a ten-thousandth of it, and the gradient has none."""
SINGULAR = 1e-13
"""Directions with smaller singular values, beside the largest, are rounding."""
AT_ONCE = 4000
"""Rows that are brought to a triangle at once: copies of all of them would take more memory than all the rest."""
WILD = 2.0
"""Records this many standard deviations off have half weight in the robust search (Cauchy's weight function)."""
FEWEST = 3
"""Records with coordinates that find a frame or a target."""
MEDIAN = float(chi2_isf(0.5, 3))
LEAST_DOF = 0.5
"""With fewer degrees of freedom records do not tell their scatter; widths that nobody stated leave a little above zero."""
MISFIT = 1e-3
"""χ² with less chance than this is larger than the stated noise explains; with more than one minus this, smaller."""


@dataclass(frozen=True, eq=False)
class Point:
    """Where the search stands: parameters, frame, the seats' points (s, 3) [m], and what follows from them."""

    x: Array
    frame: Frame
    seats: Array
    prediction: Prediction


@dataclass(frozen=True, eq=False)
class Normal:
    """The normal equations of a system with its prior rows, in columns of length one.

    A seventh of the time of a triangle by reflections. They square how unevenly directions are known, and serve where that
    leaves digits enough.

    Attributes:
        lengths: of the columns, times their scales (p,).
        inverse: ``R⁻¹`` with the upper Cholesky factor R of the information (p, p).
        along: residual along the columns of ``Q`` (p,), so that ``-R⁻¹ along`` is the Gauss–Newton step.
    """

    lengths: Array
    inverse: Array
    along: Array

    @staticmethod
    def of(problem: Problem, system: System, x: Array) -> Normal | None:
        """Of a system at ``x``; None where some directions are hardly known."""
        information = system.jacobian.T @ system.jacobian
        information *= problem.scales
        information *= problem.scales[:, None]
        information[: x.size, : x.size] += problem.prior_information
        gradient = problem.scales * (system.residual @ system.jacobian)
        gradient[: x.size] += problem.beside_prior(x) @ problem.prior
        lengths = np.sqrt(np.diagonal(information))
        if not (lengths.size and (lengths > MOVABLE).all()):
            return None
        information /= lengths
        information /= lengths[:, None]
        factor, failed = scipy.linalg.lapack.dpotrf(information.T, lower=0, clean=1, overwrite_a=1)
        if failed:
            return None
        inverse = scipy.linalg.lapack.dtrtri(factor)[0]
        if not np.linalg.norm(inverse) * UNEVEN < 1.0:  # no singular value is smaller than one over this norm
            return None
        return Normal(lengths, inverse, inverse.T @ (gradient / lengths))

    @property
    def promise(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        return float(self.along @ self.along)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Singular values of the scaled system with its prior rows.

    Attributes:
        values: (p,), largest first.
        directions: (p, p), columns in units of the scales.
        along: residual along each direction, so that ``-along / values`` is the Gauss–Newton step.
        assumed: part of each squared value that comes from widths that are not stated (p,).
    """

    values: Array
    directions: Array
    along: Array
    assumed: Array

    @staticmethod
    def of(problem: Problem, system: System, x: Array) -> Spectrum:
        """Of a system at ``x``, prior rows included."""
        triangle = _triangle(problem, system, x)
        p = problem.scales.size
        u, values, vt = np.linalg.svd(triangle[:, :p], full_matrices=len(triangle) < p)
        missing = p - values.size
        if missing > 0:  # fewer rows than parameters: the rest of the directions is unknown
            values, u = np.pad(values, (0, missing)), np.pad(u, ((0, 0), (0, missing)))
        assumed = np.zeros(p)
        assumed[: problem.stated.size] = ~problem.stated
        return Spectrum(values, vt.T, u.T @ triangle[:, p], vt**2 @ assumed)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(p,) True for directions of which the data or stated uncertainties say something."""
        return np.asarray(self.values**2 - self.assumed >= LEAST_KNOWN**2)

    @property
    def movable(self) -> NDArray[np.bool_]:
        """(p,) True for directions along which a step can be taken at all."""
        return np.asarray(self.values > MOVABLE)

    def promise(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        return float(np.sum(self.along[self.movable] ** 2))


class Chi2(NamedTuple):
    """χ² of residuals, and its degrees of freedom."""

    value: float
    dof: float

    @property
    def acceptable(self) -> bool:
        """Whether it is no larger than its degrees of freedom allow, or there are none to judge it by."""
        return self.dof < LEAST_DOF or float(chi2_sf(*self)) >= MISFIT


@dataclass(frozen=True, eq=False)
class Solution:
    """Where the search ended.

    Attributes:
        point: parameters and predictions.
        system: the linear system there.
        problem: what was unknown.
        noise: of the records.
        weights: of the records in the last step (n,).
        steps: number of steps tried.
        held_up: why the search ended before it converged; "" where it converged.
    """

    point: Point
    system: System
    problem: Problem
    noise: NoiseModel
    weights: Array
    steps: int
    held_up: str = ""

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return not self.held_up

    @property
    def cost(self) -> float:
        """χ², prior included."""
        return _cost(self.problem, self.system, self.point.x)

    @cached_property
    def spectrum(self) -> Spectrum:
        """Singular values of the system; not asked for where the search is only a start."""
        return Spectrum.of(self.problem, self.system, self.point.x)

    @cached_property
    def normal(self) -> Normal | None:
        """Normal equations of the system, where these do."""
        return Normal.of(self.problem, self.system, self.point.x)

    @property
    def promise(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        return self.spectrum.promise() if self.normal is None else self.normal.promise

    @cached_property
    def chi2(self) -> Chi2:
        """χ² and its degrees of freedom: rows that count, less what the data determine of the parameters."""
        system = self.system
        # A parameter that its prior determines costs nothing: trace of (data's information) (whole information)⁻¹.
        prior = csr_array(self.problem.prior) @ self._steps[: self.problem.widths.size]
        determined = self._steps.shape[1] - float(np.linalg.norm(prior)) ** 2
        left_out = int(self.noise.observations.counts[self.weights == 0.0].sum())
        return Chi2(float(system.residual @ system.residual), system.free - left_out - determined)

    @cached_property
    def turn_dof(self) -> float:
        """How many of the degrees of freedom are those of turns."""
        counts = self.noise.observations.counts
        if not self.problem.turns:
            return 0.0
        known = int((counts > 0).sum())
        rows = (self.system.jacobian[: 6 * known] @ self.scaled).reshape(known, 6, self.scaled.shape[1])
        return 3.0 * int(((counts == 6) & (self.weights > 0.0)).sum()) - float(np.square(rows[:, 3:]).sum())

    @property
    def scaled(self) -> Array:
        """Steps of the parameters (p, k), independent, each of unit variance, that span all of which something is known."""
        return self._steps * self.problem.scales[:, None]

    @cached_property
    def _steps(self) -> Array:
        """The same in units of the scales: R⁻¹, or by the directions that can be moved along where some cannot."""
        if self.normal is not None:
            return self.normal.inverse / self.normal.lengths[:, None]
        spectrum, movable = self.spectrum, self.spectrum.movable
        return np.asarray(spectrum.directions[:, movable] / spectrum.values[movable])

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The estimated effects with the values found."""
        return self.problem.vector.at(self.point.x)


def begin(problem: Problem, observations: Observations) -> Point:
    """The start: frame and unknown targets by a robust registration, the unknown points by medians."""
    frame, x, known = Frame.identity(len(problem.targets)), problem.start, problem.measurements.known
    prediction, offsets = problem.predict(x, frame), _offsets(problem)
    tips, told = prediction.tips, known.sum() >= FEWEST
    if problem.external and not told:
        raise AacmmError(f"{known.sum()} records have reference coordinates, expected 3 or more to find their frame")
    if offsets.size and told:
        found, moved = placed(problem, tips, prediction.jacobian[:, :3, offsets])
        frame, x = replace(found, targets=frame.targets), x.copy()
        x[offsets] += moved
    elif problem.external:
        frame = replace(registered(tips[known], problem.measurements.reference[known]), targets=frame.targets)
    if problem.turns:
        frame = problem.with_targets(x, frame)
    if problem.turns or offsets.size:
        prediction = problem.predict(x, frame)
    elif problem.external:
        prediction = Prediction(frame.apply(tips), frame.rotation @ prediction.jacobian)
    return Point(x, frame, observations.start(prediction.tips), prediction)


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
        start: see :func:`begin`.
        weights: of the records (n,), 0 leaves one out.
        robust: weigh records by how well they fit, anew in every step.
        roughly: the result is only a start for another search.
    """
    return _Search(problem, noise, weights, robust, LOOSELY_SETTLED if robust or roughly else SETTLED).run(start)


class _Search:
    """One search from one start."""

    def __init__(self, problem: Problem, noise: NoiseModel, weights: Array, robust: bool, ends: float) -> None:
        self.problem, self.noise, self.weights = problem, noise, weights
        self.robust, self.ends = robust, ends
        self.radius = np.inf
        self.answer: Array | None = None
        self.units = np.zeros(problem.scales.size)

    def run(self, point: Point) -> Solution:
        system, first, held_up = self.system(point), 0.0, f"{MOST_STEPS} steps were not enough"
        for count in range(1, MOST_STEPS + 1):
            if self.robust:
                self.weights = _by_fit(np.fmax(system.distance, system.turn_distance))
                del system
                system = self.system(point)
            point, system = self.seats_at_best(point, system)
            step = _Step.of(self.problem, system, point.x, self.units)
            self.units, promise = step.units, step.promise
            if promise < (NO_STEP if self.ends == SETTLED else self.ends):  # of a mere start it need not be taken
                held_up = ""
                break
            delta, length, promised = step.within(self.radius)
            first = first or length
            before, seats = _cost(self.problem, system, point.x), point.seats + system.seats(delta)
            del step, system  # the rows of one system are most of what a search holds
            trial, gained = self.advanced(point, seats, delta), -np.inf
            if trial is not None:
                lower = before - _cost(self.problem, trial[1], trial[0].x)
                gained = lower if np.isfinite(lower) else -np.inf
            share = gained / promised if promised > 0 else 0.0
            self.radius = length / 4 if not share > 0.25 else max(self.radius, 2 * length) if share > 0.75 else self.radius
            accepted = trial is not None and gained >= -ROUNDING * before
            point, system = trial if accepted and trial is not None else (point, self.system(point))
            del trial
            if promise < self.ends or (promise < FLAT and gained < SETTLED):
                held_up = ""
                break
            if self.radius < SMALLEST_STEP * first:
                held_up = "no step lowers the residuals"
                break
            if count >= CREEPING and share < 0.75 and self.may_creep(point):
                point, system = self.with_answer(point)
        return Solution(point, system, self.problem, self.noise, self.weights, count, held_up)

    def system(self, point: Point) -> System:
        return assemble(point.prediction, self.noise, point.seats, self.weights)

    def advanced(self, point: Point, seats: Array, step: Array) -> tuple[Point, System] | None:
        """The trial; None where the arm cannot be evaluated there, such as one too soft to carry its weight."""
        p = point.x.size
        frame = point.frame.moved(step[p:])
        x = point.x + step[:p]
        try:
            prediction = self.problem.predict(x, frame)
        except AacmmError:  # it could be evaluated where the search began
            return None
        trial = self.answered(Point(x, frame, seats, prediction))
        return trial, self.system(trial)

    def answered(self, point: Point) -> Point:
        """The point with what its derivative leaves out, once that is worked out."""
        if self.answer is None:
            return point
        return replace(point, prediction=replace(point.prediction, jacobian=point.prediction.jacobian + self.answer))

    def may_creep(self, point: Point) -> bool:
        """Whether the derivative may be poor: the final search in an arm that bends."""
        final = not self.robust and self.ends == SETTLED
        return self.answer is None and final and self.problem.bends(point.x)

    def with_answer(self, point: Point) -> tuple[Point, System]:
        """Work out what the derivative leaves out, and go on from the same point with it."""
        try:
            self.answer = self.problem.answer_of_bending(point.x, point.frame, point.prediction)
        except AacmmError:  # a neighbour of this point is too soft
            self.answer = np.zeros_like(point.prediction.jacobian)
        self.radius = np.inf
        point = self.answered(point)
        return point, self.system(point)

    def seats_at_best(self, point: Point, system: System) -> tuple[Point, System]:
        """The ends of bars where they fit best, parameters as they are.

        A system's residual is as if the seats were there, which they are where nothing but coordinates is known of them;
        where a bar's length is, no step may seem to lower it.
        """
        before = np.inf
        for _ in range(MOST_STEPS if len(self.noise.observations.ends) else 0):
            step = system.seats(np.zeros(self.problem.scales.size))
            size = np.abs(step).max(initial=0.0)
            if size < AT_BEST or size > SHRINKS * before:  # bars that cannot be met at all make it go to and fro
                break
            before = size
            point = replace(point, seats=point.seats + step)
            system = self.system(point)
        return point, system


@dataclass(frozen=True, eq=False)
class _Step:
    """The linear system of one step, each column divided by its length: what its parameter moves the tips by.

    Attributes:
        problem, system, x: what is to be moved, and from where.
        normal: normal equations, where these do.
        before: lengths of the columns in the steps before (p,).
    """

    problem: Problem
    system: System
    x: Array
    normal: Normal | None
    before: Array

    @staticmethod
    def of(problem: Problem, system: System, x: Array, before: Array) -> _Step:
        return _Step(problem, system, x, Normal.of(problem, system, x), before)

    @cached_property
    def units(self) -> Array:
        """Lengths of the columns, never less than in the steps before (p,)."""
        lengths = np.linalg.norm(self._triangle[:, :-1], axis=0) if self.normal is None else self.normal.lengths
        return np.maximum(self.before, lengths)

    @cached_property
    def _triangle(self) -> Array:
        return _triangle(self.problem, self.system, self.x)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array, Array]:
        """Singular values, directions, the residual along them; for steps that are too long, or where some are unknown."""
        u, values, vt = np.linalg.svd(self._triangle[:, :-1] / self._divisors, full_matrices=False)
        movable = values > SINGULAR * values.max(initial=0.0)
        return values[movable], vt[movable].T, (u.T @ self._triangle[:, -1])[movable]

    @cached_property
    def _whole(self) -> Array | None:
        """The Gauss–Newton step in these units (p,); None where the normal equations do not do."""
        normal = self.normal
        return None if normal is None else -(normal.inverse @ normal.along) * (self.units / normal.lengths)

    @cached_property
    def promise(self) -> float:
        """How much the Gauss–Newton step lowers χ² if the problem is linear."""
        return float(np.sum(self._spectrum[2] ** 2)) if self.normal is None else self.normal.promise

    @property
    def _divisors(self) -> Array:
        return np.where(self.units > 0.0, self.units, 1.0)

    def within(self, radius: float) -> tuple[Array, float, float]:
        """The best step no longer than ``radius``: in units of the parameters, its length, and what it promises."""
        if self._whole is not None and (length := float(np.linalg.norm(self._whole))) <= radius:
            return self._in_parameters(self._whole), length, self.promise
        values, directions, along = self._spectrum
        damping = 0.0
        if np.linalg.norm(along / values) > radius:
            top = float(np.linalg.norm(values * along) / radius)
            low, high = 1e-300, max(top, 1e-290)
            damping = float(np.exp(scipy.optimize.brentq(self._too_long, np.log(low), np.log(high), (radius,), rtol=1e-3)))
        part = -values * along / (values**2 + damping)
        left = damping / (values**2 + damping)
        promised = float(np.sum(along**2 * (1.0 - left**2)))
        return self._in_parameters(directions @ part), float(np.linalg.norm(part)), promised

    def _in_parameters(self, step: Array) -> Array:
        return np.asarray(step / self._divisors * self.problem.scales)

    def _too_long(self, log_damping: float, radius: float) -> float:
        values, _, along = self._spectrum
        return float(np.linalg.norm(values * along / (values**2 + np.exp(log_damping))) - radius)


def standing(problem: Problem, noise: NoiseModel, point: Point, weights: Array) -> Solution:
    """The system at a point, as if the search ended there."""
    return Solution(point, assemble(point.prediction, noise, point.seats, weights), problem, noise, weights, 0)


def deviations(observations: Observations, point: Point) -> Array:
    """Tip minus target (n, 3) [m], the turn behind it where orientations are stated (n, 6) [rad]; NaN where it has none."""
    return observations.deviations(point.prediction.poses, point.seats)


def _triangle(problem: Problem, system: System, x: Array) -> Array:
    """R of the scaled system with its prior rows and, last, its residual (p + 1 columns)."""
    triangle = np.zeros((len(problem.prior), problem.scales.size + 1))
    triangle[:, : x.size], triangle[:, -1] = problem.prior, problem.beside_prior(x)
    for first in range(0, max(len(system.residual), 1), AT_ONCE):
        some, above = slice(first, first + AT_ONCE), len(triangle)
        rows = np.concatenate([triangle, np.empty((len(system.residual[some]), problem.scales.size + 1))])
        np.multiply(system.jacobian[some], problem.scales, out=rows[above:, :-1])
        rows[above:, -1] = system.residual[some]
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
    return triangle


def _cost(problem: Problem, system: System, x: Array) -> float:
    prior = problem.beside_prior(x)
    return float(system.residual @ system.residual + prior @ prior)


def _by_fit(distance: Array) -> Array:
    """Cauchy's weights of squared distances, scaled by their median over the records that count at all."""
    counts = np.isfinite(distance)
    scale = np.median(distance[counts]) / MEDIAN if counts.any() else 1.0
    relative = np.where(counts, distance, 0.0) / max(float(scale), 1e-300)
    return np.asarray(1.0 / (1.0 + relative / (3 * WILD**2)))
