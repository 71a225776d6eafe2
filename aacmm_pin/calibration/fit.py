"""A solved calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import orth

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin._support.units import MM, UM
from aacmm_pin.calibration.identifiability import Undetermined
from aacmm_pin.calibration.linearisation import linearise
from aacmm_pin.calibration.problem import OF_WIDTH
from aacmm_pin.calibration.solver import LEAST_DOF, Chi2, Solution, solution_at
from aacmm_pin.effects import Effect

MOST_EXCLUDED_PART = 0.15
"""More are no gross errors of single records."""
FEWEST_TOGETHER = 3
"""Fewer may be one mishap."""
NO_SCATTER = 5e-8
"""Scatter below this is none [m]: the search for it ends just above zero."""
ONE_DIRECTION = 1e-2
"""Sine of the angle of two undetermined directions that are one."""


@dataclass(frozen=True, eq=False)
class Fit(Solution):
    """A problem solved.

    Attributes:
        noise_is_stated: in full, so that ``chi2_stated`` judges the model.
        used: records that the fit uses (n,).
        excluded: outliers (n,).
        chi2_stated: χ² against the stated noise alone; None if it is not complete.
        estimated_nonlinear: effects, by keys, whose nonlinear parameters come from these records
            too; with the least u of each, by name, if the derivative gives too little.
        added_covariance: of all columns, for an error that several records share (p, p) [units].
    """

    noise_is_stated: bool
    used: Mask
    excluded: Mask
    chi2_stated: Chi2 | None
    dof: float
    estimated_nonlinear: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    added_covariance: Array | float = 0.0

    @staticmethod
    def of(solution: Solution, **judgement: Any) -> Fit:
        """From a solution and the other attributes."""
        attributes = {
            attribute.name: getattr(solution, attribute.name) for attribute in fields(Solution)
        }
        return Fit(**attributes, **judgement)

    @property
    def scatter(self) -> float:
        """Of each coordinate beyond the stated noise [m]; 0 if that suffices."""
        return self.noise.scatters.tip

    @property
    def turns(self) -> Array:
        """Rotation of each record from the stated orientation (n,) [rad]; NaN without."""
        turns = np.linalg.norm(self.system.deviations[:, 3:], axis=1)
        return np.where(self.observations.oriented, turns, np.nan)

    @property
    def lever(self) -> float:
        """Ratio of the noise of shifts to that of turns [m]; 0 without orientations."""
        both = self.residual_noise[self.used & self.observations.oriented]
        if not len(both):
            return 0.0
        shifts, turns = np.split(np.diagonal(both, axis1=1, axis2=2).sum(axis=0), 2)
        return float(np.sqrt(shifts.sum() / turns.sum()))

    @property
    def determines_noise(self) -> bool:
        """Whether the noise is stated, or the records suffice to estimate it."""
        return self.noise_is_stated or self.dof >= LEAST_DOF

    @property
    def too_many_excluded(self) -> bool:
        """Whether more records are excluded than gross errors explain."""
        excluded = int(self.excluded.sum())
        return excluded >= FEWEST_TOGETHER and excluded > MOST_EXCLUDED_PART * (
            excluded + int(self.used.sum())
        )

    @property
    def has_scatter(self) -> bool:
        """Whether the scatter beyond the stated noise is worth a word."""
        return max(self.noise.scatters) > NO_SCATTER

    @property
    def scatter_in_words(self) -> str:
        """The scatter of tips, and of turns with orientations."""
        turns = f" and {self.noise.scatters.turn / UM:.3g} µrad" if self.problem.turns else ""
        return f"{self.scatter / MM:.4f} mm{turns}"

    @property
    def residual_noise(self) -> Array:
        """Covariance of each residual, with the scatter (n, 3, 3) [m²], or (n, 6, 6)."""
        return self.noise.of_residuals

    @cached_property
    def by_reading(self) -> Array:
        """See :meth:`Problem.reading_jacobian` (n, 3 or 6, nq) [m/rad]."""
        return self.problem.reading_jacobian(self.point.x, self.point.frame)

    @property
    def by_geometry(self) -> Array:
        """Displacement of each tip, in the references' frame, by independent geometric errors of
        unit variance (n, 3, p) [m].
        """
        model, records = self.problem.model, self.problem.measurements
        values, vectors = np.linalg.eigh(model.covariance())
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        moved = model.sensitivity(records.q, records.conditions) @ root
        along = self.point.frame.rotation @ moved
        counting = self.observations.along_normals(along.transpose(0, 2, 1))
        return counting.transpose(0, 2, 1)

    @property
    def stated_variance(self) -> Array:
        """Variance of each record's distance by the arm's stated uncertainties and, if nothing is
        fitted, the seats' (n,) [m²].
        """
        records = self.problem.measurements
        variance = np.square(self.by_geometry).sum(axis=(1, 2))
        if self.problem.scales.size == 0:
            u = np.zeros((records.n, 3))
            seat = self.observations.seat
            u[seat >= 0] = np.nan_to_num(self.observations.stated_u[seat[seat >= 0]])
            along = self.observations.along_normals(u[:, :, None] * np.eye(3))
            variance += np.square(along).sum(axis=(1, 2))
        return np.asarray(variance)

    @property
    def stated_noise(self) -> Array:
        """The residual noise, but without scatter beyond a noise that is stated in full."""
        return self.noise.without_scatter if self.noise_is_stated else self.residual_noise

    @property
    def noise_rms(self) -> float:
        """RMS distance of tips and targets to expect from the stated noise [m]."""
        return self.expected_rms(self.stated_noise)

    def expected_rms(self, covariance: Array) -> float:
        """RMS distance of used tips and targets [m] to expect from covariances of residuals
        (n, 3, 3) or (n, 6, 6) [m²].

        The fit of a seat without known coordinates lowers the variance at its m contacts to the
        part 1 - 1/m, or 1 - 3/m on a sphere or plane.
        """
        variance = np.trace(covariance[self.used, :3, :3], axis1=1, axis2=2)
        seat = self.observations.seat[self.used]
        placed = np.append(self.observations.known, True)
        touches = np.bincount(seat + 1, minlength=placed.size)[seat + 1]
        taken = np.where(self.observations.on_surface[self.used], 3.0, 1.0)
        remaining = np.where(placed[seat], 1.0, np.maximum(1.0 - taken / touches, 0.0))
        mean = (variance * remaining).mean()
        return float(np.sqrt(mean))

    @cached_property
    def unknown(self) -> Array:
        """Directions that these records do not determine (p, k), orthonormal [scales].

        If tips scatter, a turn of the arm about its base, or of its target about the last joint,
        seems to change residuals. The first does not at targets, the second not at tips.
        """
        point = self.point
        targets = point.prediction.tips - np.nan_to_num(self.system.deviation)
        jacobian = self.problem.predict(point.x, point.frame, targets).jacobian
        there = replace(point, prediction=replace(point.prediction, jacobian=jacobian))
        at_targets = solution_at(self.problem, self.noise, there, self.weights).system
        directions = np.hstack([self.system.unknown, at_targets.unknown])
        return np.asarray(orth(directions, rcond=ONE_DIRECTION))

    @cached_property
    def undetermined(self) -> Undetermined:
        """What these records leave open."""
        return Undetermined(self.problem, self.point, self.unknown)

    @property
    def covariance(self) -> Array:
        """Of all columns, the frame's included (p, p) [units]; zero if undetermined."""
        p = self.problem.scales.size
        return self.full_covariance[:p, :p]

    def response(self, columns: Array) -> Array:
        """Derivative of all estimates by what the fit held (p, q) [units]: ``-(JᵀJ)⁻¹ Jᵀ C``;
        ``columns`` displace the records by one unit (n, 3 or 6, q) [m, rad].
        """
        point = self.point
        jacobian = np.concatenate([point.prediction.jacobian, columns], axis=2)
        prediction = replace(point.prediction, jacobian=jacobian)
        with_held = linearise(prediction, self.system.prior, self.noise, point.seats, self.weights)
        by_estimates, by_held = np.split(with_held.jacobian, [self.problem.scales.size], axis=1)
        steps = self.system.independent_steps
        return -steps @ (steps.T @ (by_estimates.T @ by_held))

    @property
    def nonlinear_u(self) -> dict[tuple[str, str], float]:
        """Standard uncertainty of each uncertain nonlinear parameter, by key of the effect and
        field.
        """
        variances = np.diag(self.full_covariance)[self.problem.scales.size :]
        u = np.sqrt(variances).tolist()
        keys = [(effect.key, name) for _, effect, name, _ in self.nonlinear_parameters]
        return dict(zip(keys, u, strict=True))

    @cached_property
    def nonlinear_parameters(self) -> list[tuple[int, Effect, str, float]]:
        """The uncertain ones: number of the effect, effect, field, prior standard deviation."""
        uncertain = []
        for k, effect in enumerate(self.effects):
            nonlinear = effect.nonlinear
            is_estimated = effect.key in self.estimated_nonlinear
            width = nonlinear.prior_sd(effect) if is_estimated else effect.nonlinear_u
            if width:
                uncertain.append((k, effect, nonlinear.field, width))
        return uncertain

    @cached_property
    def full_covariance(self) -> Array:
        """Of all columns and, last, of the nonlinear parameters."""
        covariance = self._of_independent_records()
        p = self.problem.scales.size
        covariance[:p, :p] += self.added_covariance
        return covariance

    def _of_independent_records(self) -> Array:
        parameters = self.nonlinear_parameters
        if not parameters:
            return self.system.covariance(self.unknown)
        point = self.point
        widths = np.array([width for *_, width in parameters])
        by_nonlinear = np.stack(
            [self._by_nonlinear(*parameter) for parameter in parameters], axis=2
        )
        jacobian = np.concatenate([point.prediction.jacobian, by_nonlinear], axis=2)
        prediction = replace(point.prediction, jacobian=jacobian)
        prior = self.problem.prior(point.x, widths)
        system = linearise(prediction, prior, self.noise, point.seats, self.weights)
        covariance = system.covariance(np.pad(self.unknown, ((0, widths.size), (0, 0))))
        for column, (_, effect, name, _) in enumerate(parameters, self.problem.scales.size):
            variance = covariance[column, column]
            least = self.estimated_nonlinear.get(effect.key, {}).get(name, 0.0) ** 2
            if 0.0 < variance < least:  # what is correlated with it grows too
                along = covariance[column] / variance
                covariance = covariance + (least - variance) * np.outer(along, along)
        return covariance

    def _by_nonlinear(self, number: int, effect: Effect, name: str, width: float) -> Array:
        """∂(pose)/∂(nonlinear parameter) (n, 3 or 6) [m/unit]."""
        poses = []
        for step in (OF_WIDTH * width, -OF_WIDTH * width):
            effects = list(self.problem.vector.effects)
            effects[number] = replace(effects[number], **{name: getattr(effect, name) + step})
            vector = replace(self.problem.vector, effects=tuple(effects))
            moved = replace(self.problem, vector=vector)
            poses.append(moved.poses(self.point.x, self.point.frame))
        return (poses[0] - poses[1]) / (2 * OF_WIDTH * width)


def redundant(solution: Solution) -> bool:
    """Whether the records suffice to judge which are wrong: no half of them can be fitted whatever
    they state. A sphere or plane takes three numbers, twice if the noise is not stated.
    """
    stated = not solution.problem.setup.unstated(solution.problem.measurements)
    open_surfaces = solution.observations.surfaces & ~solution.observations.known
    taken = (3 if stated else 6) * int(open_surfaces.sum())
    return solution.chi2.dof >= 0.5 * (solution.system.free + taken)
