"""Weighted least squares with a prior: a trust-region search on the analytic sensitivities.

Levenberg–Marquardt as in MINPACK (Moré 1978): steps are bounded in units of what each parameter
moves the tips by; a trial that cannot be evaluated is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import exp, skew
from aacmm_pin.calibration.fit import MEDIAN, Fit
from aacmm_pin.calibration.least_squares import bounded_step
from aacmm_pin.calibration.linearisation import Linearisation, Point, linearise
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import (
    MOST_REWEIGHTINGS,
    SETTLED_PART,
    Frame,
    Prediction,
    Problem,
    inverse_distances,
    registered,
)
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
BASINS = 3
"""So many of the lowest minima are compared by sums of distances, which gross errors hardly
change.
"""
ROTATION_TOLERANCE = 0.05
MOST_NEWTON_STEPS = 40
"""Five to twenty do."""
LEAST_ROTATION_STEP = 1e-6
"""Newton's method ends at smaller steps [rad]."""
PLACEMENT_RANK_RATIO = 1e-5
"""Combinations of offsets and shift with a smaller part of the effect stay zero."""
TINY = 1e-300


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
        """The fit at the best point; its message is empty if the search converged."""
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
            if step.full_reduction < (tolerance if self.is_start else NO_STEP):
                message = ""
                break
            cost = system.cost
            seats = point.seats + system.seat_step(step.parameters)
            del system  # the rows of one system are most of what a search holds
            trial = self.trial(point, seats, step.parameters)
            lowered = -np.inf if trial is None else cost - trial[1].cost
            gain_ratio = lowered / step.reduction if step.reduction > 0 else 0.0
            self.adapt_radius(step.length, gain_ratio)
            if trial is not None and lowered >= -ROUNDING * cost:
                point, system = trial
            else:  # back to the point before
                system = self.system(point)
            del trial
            is_flat = step.full_reduction < FLAT_REDUCTION and not lowered >= SETTLED
            if step.full_reduction < tolerance or is_flat:
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


class _Placement(NamedTuple):
    """Sum of all distances [m]; rotation W; solution z, t and c (m + 3,) [m]."""

    total: float
    rotation: Array
    z: Array


def first_placement(problem: Problem, tips: Array, by_offset: Array) -> tuple[Frame, Array]:
    """Frame, and offsets of the targets (m,) [m], with the least sum of distances.

    Base Y, b and offset t of a target are in ``r = Y (p + A t) + b``, for references r, tips p and
    axes A of the last body. With W = Yᵀ this is ``W r = p + A t + c``, linear but for W; without t
    and c, a quadratic form of W is left. Its minima over the rotations are searched from those of a
    cube.

    Args:
        problem: with three or more records with coordinates.
        tips: by the arm as described, in its base (n, 3) [m].
        by_offset: derivative of the tips by the offsets (n, 3, m).
    """
    records = problem.measurements
    stating = records.known
    tips, references, linear = tips[stating], records.reference[stating], by_offset[stating]
    middle = np.zeros(3)
    if problem.external:
        middle = references.mean(axis=0)
        by_shift = np.broadcast_to(np.eye(3), (len(tips), 3, 3))
        linear = np.concatenate([linear, by_shift], axis=2)
    by_rotation = np.einsum("ij,nk->nijk", np.eye(3), references - middle).reshape(-1, 3, 9)
    equations = _Equations(np.concatenate([by_rotation, tips[:, :, None]], axis=2), linear)
    if not problem.external:
        return Frame.identity(), _nearest_placement(equations, np.eye(3), may_turn=False).z
    placements = [
        _nearest_placement(equations, start, may_turn=True) for start in _minima(equations)[:BASINS]
    ]
    nearest = min(placements, key=lambda placement: placement.total)
    offsets, shift = np.split(nearest.z, [-3])
    rotation = nearest.rotation.T
    return Frame(rotation, middle + rotation @ shift), offsets


class _Equations(NamedTuple):
    """``columns w = linear z``: w are the nine numbers of W and -1, and z is what is linear.

    Attributes:
        columns: (n, 3, 10).
        linear: (n, 3, m).
    """

    columns: Array
    linear: Array

    def eliminated(self, weights: Array) -> tuple[Array, Array]:
        """z for each column (m, 10), and the columns less ``linear z`` (n, 3, 10)."""
        count = 3 * weights.size
        root = np.sqrt(weights)[:, None, None]
        rows = (root * self.linear).reshape(count, -1)
        columns = (root * self.columns).reshape(count, -1)
        solution = np.asarray(np.linalg.lstsq(rows, columns, PLACEMENT_RANK_RATIO)[0], np.float64)
        return solution, self.columns - self.linear @ solution


def _nearest_placement(equations: _Equations, rotation: Array, *, may_turn: bool) -> _Placement:
    """The least sum of distances near ``rotation`` W, by inverse distances as weights
    (Weiszfeld).
    """
    weights = np.ones(len(equations.columns))
    before = np.inf
    for _ in range(MOST_REWEIGHTINGS):
        z_of_columns, residual_columns = equations.eliminated(weights)
        if may_turn:
            rotation = _descend(_gram(residual_columns, weights), rotation[None])[0][0]
        w = np.append(rotation, -1.0)
        distances = np.linalg.norm(residual_columns @ w, axis=1)
        total = float(distances.sum())
        if abs(before - total) < SETTLED_PART * total:
            break
        before = total
        weights = inverse_distances(distances)
    return _Placement(total, rotation, z_of_columns @ w)


def _minima(equations: _Equations) -> list[Array]:
    """Rotations with the least sums of squares nearby, lowest first."""
    weights = np.ones(len(equations.columns))
    _, residual_columns = equations.eliminated(weights)
    cube = scipy.spatial.transform.Rotation.create_group("O").as_matrix()
    rotations, values = _descend(_gram(residual_columns, weights), cube)
    distinct: list[Array] = []
    for rotation in rotations[np.argsort(values)]:
        if all(np.linalg.norm(rotation - other) > ROTATION_TOLERANCE for other in distinct):
            distinct.append(rotation)
    return distinct


def _gram(columns: Array, weights: Array) -> Array:
    weighted = weights[:, None, None] * columns
    return np.asarray(weighted.reshape(-1, 10).T @ columns.reshape(-1, 10))


def _descend(gram: Array, rotations: Array) -> tuple[Array, Array]:
    """The minima of ``(w, -1)ᵀ gram (w, -1)`` near each rotation (k, 3, 3), and its values there
    (k,).

    Newton's method over rotations ω, which add ``[ω] W + [ω]² W / 2``: damped, with absolute
    curvatures, so that no step goes up (Dauphin et al. 2014).
    """
    quadratic, linear = gram[:9, :9], gram[:9, 9]

    def value(w: Array) -> Array:
        form = (w @ quadratic - 2.0 * linear) * w
        return np.asarray(form.sum(axis=1))

    values = value(rotations.reshape(-1, 9))
    damping = np.full(len(rotations), 1e-6)
    for _ in range(MOST_NEWTON_STEPS):
        by_rotation = (skew(np.eye(3)) @ rotations[:, None]).reshape(-1, 3, 9)
        gradient = rotations.reshape(-1, 9) @ quadratic - linear
        slope = by_rotation @ gradient[:, :, None]
        second_order = rotations @ gradient.reshape(-1, 3, 3).transpose(0, 2, 1)
        trace = np.trace(second_order, axis1=1, axis2=2)[:, None, None]
        curvature = by_rotation @ quadratic @ by_rotation.transpose(0, 2, 1) - trace * np.eye(3)
        curvature += 0.5 * (second_order + second_order.transpose(0, 2, 1))
        curvatures, directions = np.linalg.eigh(curvature)
        sizes = np.abs(curvatures) + damping[:, None] * np.trace(quadratic) + TINY
        step = -(directions @ (directions.transpose(0, 2, 1) @ slope / sizes[:, :, None]))[:, :, 0]
        step /= np.maximum(1.0, np.linalg.norm(step, axis=1))[:, None]
        trial = exp(np.hstack([np.zeros_like(step), step]))[:, :3, :3] @ rotations
        trial_values = value(trial.reshape(-1, 9))
        lower = trial_values < values
        rotations = np.where(lower[:, None, None], trial, rotations)
        values = np.where(lower, trial_values, values)
        damping = np.where(lower, damping / 10.0, damping * 10.0)
        if np.abs(step).max() < LEAST_ROTATION_STEP:
            break
    return rotations, values
