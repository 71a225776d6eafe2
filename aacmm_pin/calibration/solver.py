"""Weighted least squares with a prior: a trust-region search on the analytic sensitivities.

Levenberg–Marquardt as in MINPACK (Moré 1978): steps are bounded in units of what each parameter
moves the tips by; a trial that cannot be evaluated is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.first_placement import first_placement
from aacmm_pin.calibration.fit import MEDIAN, Fit
from aacmm_pin.calibration.least_squares import bounded_step
from aacmm_pin.calibration.linearisation import Linearisation, Point, linearise
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Frame, Prediction, Problem, registered
from aacmm_pin.effects import StylusOffset
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Observations, centre_of_sphere

MOST_STEPS = 100
SETTLED = 1e-6
"""The search ends when a step promises to lower χ² by less: parameters stand still to 0.001 u."""
LOOSELY_SETTLED = 1e-2
"""The same of a mere start."""
NO_STEP = 1e-12
"""A step that promises less is not taken: it is a millionth of u."""
MOST_SEAT_STEPS = 20
"""Bars and planes settle within 14 steps, but not bars of wrong lengths within hundreds."""
LEAST_SEAT_STEP = 1e-7
"""Least motion of the ends of relations [m]."""
FLAT_REDUCTION = 1e-2
"""If a step that promises less lowers χ² hardly, the search ends too, within 0.1 u."""
SMALLEST_STEP = 1e-12
"""Least radius of the trust region, as a part of the first step."""
ROUNDING = 1e-12
HALF_WEIGHT = 2.0
"""Standard deviations with half weight in Cauchy's function."""
FEWEST_PLACED = 3


def initial_point(problem: Problem, observations: Observations) -> Point:
    """The start: frame and targets by a robust registration, unknown points by medians.

    Raises:
        AacmmError: an unknown frame, and fewer than three records with coordinates.
    """
    frame = Frame.identity(len(problem.targets))
    x = problem.start
    placed = problem.measurements.known
    prediction = problem.predict(x, frame)
    is_offset = np.zeros(x.size, dtype=bool)
    for effect, entries in problem.vector:
        is_offset[entries] = isinstance(effect, StylusOffset)
    offsets = np.flatnonzero(is_offset & ~problem.stated)
    tips = prediction.tips
    if problem.external:
        points, references = _points_for_frame(problem, tips, observations)
    if offsets.size and placed.sum() >= FEWEST_PLACED:
        placement, offset_values = first_placement(
            problem, tips, prediction.jacobian[:, :3, offsets]
        )
        frame = replace(placement, targets=frame.targets)
        x = x.copy()
        x[offsets] += offset_values
    elif problem.external:
        frame = replace(registered(points, references), targets=frame.targets)
    if problem.turns:
        frame = problem.with_targets(x, frame)
    if problem.turns or offsets.size:
        prediction = problem.predict(x, frame)
    elif problem.external:
        prediction = Prediction(frame.apply(tips), frame.rotation @ prediction.jacobian)
    return Point(x, frame, observations.first_seats(prediction.tips), prediction)


def _points_for_frame(
    problem: Problem, tips: Array, observations: Observations
) -> tuple[Array, Array]:
    """Tips with references and, if these are few, centres of spheres; and their references."""
    placed = problem.measurements.known
    points, references = tips[placed], problem.measurements.reference[placed]
    if len(points) < FEWEST_PLACED:
        for k in np.flatnonzero(observations.spheres & observations.is_stated):
            contacts = observations.seat == k
            centre = centre_of_sphere(tips[contacts], float(observations.radius[contacts][0]))
            points = np.concatenate([points, centre[None]])
            references = np.concatenate([references, observations.stated[k : k + 1]])
    if len(points) < FEWEST_PLACED:
        raise AacmmError(
            f"{problem.measurements.source}: {len(points)} records or spheres have reference "
            "coordinates; expected 3 or more to estimate their frame"
        )
    return points, references


def solve(
    problem: Problem,
    noise: NoiseModel,
    start: Point,
    weights: Array,
    *,
    robust: bool = False,
    roughly: bool = False,
) -> Fit:
    """Search from ``start``; the best point, whether or not the search converged.

    Args:
        weights: of the records (n,), 0 leaves one out.
        robust: weigh records anew in every step.
        roughly: for a mere start.
    """
    return _Search(problem, noise, weights, robust, roughly).run(start)


@dataclass
class _Search:
    problem: Problem
    noise: NoiseModel
    weights: Array
    robust: bool
    is_start: bool
    radius: float = np.inf
    first_length: float = 0.0

    def run(self, point: Point) -> Fit:
        tolerance = LOOSELY_SETTLED if self.is_start else SETTLED
        units = np.zeros(self.problem.scales.size)
        system = self.system(point)
        message = f"{MOST_STEPS} steps were not enough"
        for steps in range(1, MOST_STEPS + 1):
            if self.robust:
                self.weights = _robust_weights(np.fmax(system.distance, system.turn_distance))
                del system
                system = self.system(point)
            if self.robust or steps == 1:
                point, system = self.seats_at_best(point, system)
            units = np.maximum(units, system.lengths)
            step = bounded_step(system, units, self.radius)
            # The step to a mere start need not be taken.
            if step.reduction < (tolerance if self.is_start else NO_STEP):
                message = ""
                break
            cost = system.cost
            seats = point.seats + system.seat_step(step.parameters)
            del system  # the rows of one system are most of what a search holds
            trial = self.trial(point, seats, step.parameters)
            reduction = -np.inf if trial is None else cost - trial[1].cost
            gain_ratio = reduction / step.predicted if step.predicted > 0 else 0.0
            self.adapt_radius(step.length, gain_ratio)
            if trial is not None and reduction >= -ROUNDING * cost:
                point, system = trial
            else:  # back to the point before
                system = self.system(point)
            del trial
            is_flat = step.reduction < FLAT_REDUCTION and not reduction >= SETTLED
            if step.reduction < tolerance or is_flat:
                message = ""
                break
            if self.radius < SMALLEST_STEP * self.first_length:
                message = "no step lowers the residuals"
                break
        return Fit(self.problem, self.noise, point, self.weights, system, steps, message)

    def adapt_radius(self, length: float, gain_ratio: float) -> None:
        self.first_length = self.first_length or length
        if not gain_ratio > 0.25:
            self.radius = length / 4
        elif gain_ratio > 0.75:
            self.radius = max(self.radius, 2 * length)

    def system(self, point: Point) -> Linearisation:
        return linearise(point, self.problem.prior(point.x), self.noise, self.weights)

    def trial(self, point: Point, seats: Array, step: Array) -> tuple[Point, Linearisation] | None:
        """The point after a step; None for an arm that cannot be evaluated, such as one too soft
        for its weight.
        """
        step_of_x, step_of_frame = np.split(step, [point.x.size])
        x = point.x + step_of_x
        frame = point.frame.moved(step_of_frame)
        try:
            prediction = self.problem.predict(x, frame)
        except AacmmError:  # it could be evaluated where the search began
            return None
        trial = Point(x, frame, seats, prediction)
        return self.seats_at_best(trial, self.system(trial))

    def seats_at_best(self, point: Point, system: Linearisation) -> tuple[Point, Linearisation]:
        """Steps of related seats alone: a step of the parameters would seem to lower what relations
        add to χ².
        """
        if not len(self.noise.observations.ends):
            return point, system
        no_step = np.zeros(self.problem.scales.size)
        for _ in range(MOST_SEAT_STEPS):
            seat_step = system.seat_step(no_step)
            # Relations rotate planes, which is not linear: the whole step may lead far away.
            while np.abs(seat_step).max(initial=0.0) >= LEAST_SEAT_STEP:
                trial = replace(point, seats=point.seats + seat_step)
                trial_system = self.system(trial)
                if trial_system.seats_cost < system.seats_cost:
                    break
                seat_step = seat_step / 4
            else:  # no shorter step lowers χ²
                break
            gain = system.seats_cost - trial_system.seats_cost
            point, system = trial, trial_system
            if gain < SETTLED:
                break
        return point, system


def _robust_weights(distance: Array) -> Array:
    """Cauchy's weights (n,), by squared distances over their median."""
    has_target = np.isfinite(distance)
    scale = np.median(distance[has_target]) / MEDIAN if has_target.any() else 1.0
    relative = np.where(has_target, distance, 0.0) / max(float(scale), 1e-300)
    return 1.0 / (1.0 + relative / (3 * HALF_WEIGHT**2))
