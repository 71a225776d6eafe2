"""Where a search for the parameters ended, and what follows from there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import orth

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin._support.distributions import chi2_isf, chi2_sf
from aacmm_pin._support.units import MM, UM
from aacmm_pin.calibration.identifiability import Undetermined
from aacmm_pin.calibration.least_squares import Prior
from aacmm_pin.calibration.linearisation import Linearisation, Point, linearise
from aacmm_pin.calibration.noise_model import NoiseModel
from aacmm_pin.calibration.problem import Problem
from aacmm_pin.effects import Effect, of_geometry, sensitivity
from aacmm_pin.measurements import Observations

MEDIAN = float(chi2_isf(0.5, 3))
LEAST_DOF = 0.5
"""With fewer, records do not determine their scatter; unstated widths leave a little above zero."""
MISFIT = 1e-3
"""Least chance of χ² that the stated noise explains."""
MOST_EXCLUDED_PART = 0.15
"""More are no gross errors of single records."""
FEWEST_TOGETHER = 3
"""Fewer may be one mishap."""
NO_SCATTER = 5e-8
"""Scatter below this is none [m]: the search for it ends just above zero."""
DIFFERENCE_STEP = 1e-3
"""Step of a difference, as a part of the parameter's width."""
ONE_DIRECTION = 1e-2
"""Sine of the angle of two undetermined directions that are one."""


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
class Fit:
    """A problem at the point where a search ended.

    Attributes:
        weights: of the records (n,); 0 leaves one out.
        message: why the search ended before it converged; "" if it converged.
        chi2_stated: χ² against the stated noise alone; None if it is not complete.
        estimated_nonlinear: effects, by keys, whose nonlinear parameters come from these records
            too; with the least u of each, if the derivative gives too little.
        added_covariance: of all columns, for an error that several records share (p, p) [units].
    """

    problem: Problem
    noise: NoiseModel
    point: Point
    weights: Array
    system: Linearisation
    steps: int = 0
    message: str = ""
    chi2_stated: Chi2 | None = None
    estimated_nonlinear: Mapping[str, float] = field(default_factory=dict)
    added_covariance: Array | float = 0.0

    @staticmethod
    def at(problem: Problem, noise: NoiseModel, point: Point, weights: Array) -> Fit:
        """As if a search ended at this point."""
        system = linearise(point, problem.prior(point.x), noise, weights)
        return Fit(problem, noise, point, weights, system)

    @property
    def observations(self) -> Observations:
        """What the records say."""
        return self.noise.observations

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The estimated effects with the values found."""
        return self.problem.vector.at(self.point.x)

    @property
    def converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return not self.message

    @property
    def used(self) -> Mask:
        """Records that the fit uses (n,)."""
        return self.weights > 0.0

    @property
    def excluded(self) -> Mask:
        """Outliers (n,)."""
        return self.observations.has_target & ~self.used

    @cached_property
    def noise_is_stated(self) -> bool:
        """Whether the noise is stated in full, so that :attr:`chi2_stated` judges the model."""
        return not self.problem.setup.unstated(self.problem.measurements)

    @property
    def free(self) -> int:
        """Rows of used records and relations, less the coordinates of seats that they determine."""
        observations = self.observations
        rows = int(observations.counts[self.used].sum()) + len(observations.ends)
        return rows - 3 * int((~observations.is_stated).sum())

    @cached_property
    def chi2(self) -> Chi2:
        """χ², and rows that count less the parameters that they determine."""
        residual = self.system.residual
        return Chi2(float(residual @ residual), self.free - self.system.determined)

    @cached_property
    def turn_dof(self) -> float:
        """The degrees of freedom of turns."""
        if not self.problem.turns:
            return 0.0
        shares = self._rows_by_record(self.system.jacobian @ self.system.independent_steps)
        with_turn = self.used & (self.observations.counts == 6)
        return 3.0 * int(with_turn.sum()) - float(np.square(shares[:, 3:]).sum())

    def _rows_by_record(self, rows: Array) -> Array:
        """Rows (m, c) by record (n, 3 or 6, c); zero without target."""
        has_target = self.observations.has_target
        width = self.noise.whitening.shape[1]
        count = width * int(has_target.sum())
        by_record = np.zeros((has_target.size, width, rows.shape[1]))
        by_record[has_target] = rows[:count].reshape(-1, *by_record.shape[1:])
        return by_record

    def of_each_record(self, rows: Array) -> Array:
        """Rows of the linear model (m, c) by record (n, 3 or 6, c), each whitened by itself, not
        with others of its reading.
        """
        root_weights = np.sqrt(self.weights)[:, None, None]
        correlation = self.noise.correlation(self.noise.whitening * root_weights)
        by_record = self._rows_by_record(rows)
        if relations := len(self.observations.ends):
            by_record += self.system.elimination.by_relations(rows[-relations:])
        return correlation.whitened_back(by_record)

    def chi2_of(self, records: Mask) -> Chi2:
        """χ² of some records (n,) and the prior, after a fit to them alone, to first order."""
        seat = np.where(records, self.observations.seat, -1)
        one_part = np.zeros(records.size, dtype=np.intp)
        observations, seats, _ = replace(self.observations, seat=seat).divided(one_part)
        noise = replace(self.noise, observations=observations)
        point = replace(self.point, seats=self.point.seats[seats])
        alone = Fit.at(self.problem, noise, point, records.astype(np.float64))
        return Chi2(alone.system.cost - alone.system.solution.reduction, alone.chi2.dof)

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
        covariances = self.residual_noise[self.used & self.observations.oriented]
        if not len(covariances):
            return 0.0
        variances = np.diagonal(covariances, axis1=1, axis2=2)
        shifts, turns = np.split(variances.sum(axis=0), 2)
        return float(np.sqrt(shifts.sum() / turns.sum()))

    @property
    def determines_noise(self) -> bool:
        """Whether the noise is stated, or the records suffice to estimate it."""
        return self.noise_is_stated or self.chi2.dof >= LEAST_DOF

    @property
    def redundant(self) -> bool:
        """Whether the records suffice to judge which are wrong: no half of them can be fitted
        whatever they state. A sphere or plane takes three numbers, twice if the noise is not
        stated.
        """
        open_surfaces = self.observations.surfaces & ~self.observations.is_stated
        open_numbers = (3 if self.noise_is_stated else 6) * int(open_surfaces.sum())
        return self.chi2.dof >= 0.5 * (self.free + open_numbers)

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
        turns = f" and {self.noise.scatters.rotation / UM:.3g} µrad" if self.problem.turns else ""
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
        """Displacement of each target, in the references' frame, by independent geometric errors
        of unit variance (n, 3 or 6, p) [m, rad].
        """
        model, records = self.problem.model, self.problem.measurements
        values, vectors = np.linalg.eigh(model.covariance())
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        state = replace(
            model.state(records.q, records.conditions), with_rotation=self.problem.turns
        )
        effects = (*of_geometry(model.arm), *model.effects)
        columns = [np.empty((records.n, state.coordinates, 0))]
        columns += [sensitivity(effect, state) for effect in effects]
        in_base = np.concatenate(columns, axis=2) @ root
        vectors_in_base = in_base.reshape(records.n, -1, 3, root.shape[1])
        displacements = (self.point.frame.rotation @ vectors_in_base).reshape(in_base.shape)
        counting = self.observations.along_normals(displacements.transpose(0, 2, 1))
        return counting.transpose(0, 2, 1)

    @property
    def stated_variance(self) -> Array:
        """Variance of each record's distance by the arm's stated uncertainties and, if nothing is
        fitted, the seats' (n,) [m²].
        """
        records = self.problem.measurements
        variance = np.square(self.by_geometry[:, :3]).sum(axis=(1, 2))
        if self.problem.scales.size == 0:
            u = np.zeros((records.n, 3))
            seat = self.observations.seat
            u[seat >= 0] = np.nan_to_num(self.observations.stated_u[seat[seat >= 0]])
            along = self.observations.along_normals(u[:, :, None] * np.eye(3))
            variance += np.square(along).sum(axis=(1, 2))
        return np.asarray(variance)

    @property
    def predicted_rms(self) -> float:
        """RMS distance of used tips and targets to expect after the fit from the stated
        uncertainties [m]; nan without uncertainties of the arm, or targets.

        Errors of the stated coordinates of seats count only if nothing is fitted.
        """
        if not (self.used.any() and self.problem.model.covariance().any()):
            return float("nan")
        by_geometry = self.by_geometry
        by_estimates, by_errors = self._whitened_rows(by_geometry)
        whitened = self.of_each_record(by_errors + by_estimates @ self.response(by_geometry))
        after_fit = np.linalg.cholesky(self.residual_noise) @ whitened
        variance = np.square(after_fit[:, :3]).sum(axis=(1, 2))
        if self.problem.scales.size == 0:  # stated seats stay where they are
            variance = np.where(self._has_stated_target, self.stated_variance, variance)
        of_noise = self.expected_rms(self.noise.without_scatter) ** 2
        return float(np.sqrt(variance[self.used].mean() + of_noise))

    @property
    def _has_stated_target(self) -> Mask:
        """Records with coordinates of their own or of their seat (n,)."""
        # The last is for records without a seat.
        return np.append(self.observations.is_stated, True)[self.observations.seat]

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
        touches = np.bincount(seat + 1)[seat + 1]
        fitted = np.where(self.observations.on_surface[self.used], 3.0, 1.0)
        has_stated_target = self._has_stated_target[self.used]
        remaining = np.where(has_stated_target, 1.0, np.maximum(1.0 - fitted / touches, 0.0))
        mean = (variance * remaining).mean()
        return float(np.sqrt(mean))

    @cached_property
    def unknown(self) -> Array:
        """Directions that these records do not determine (p, k), orthonormal [scales], at tips or
        targets.

        A rotation of the arm about its base moves no target, but a tip that scatters about it; one
        of the target about the last joint moves no tip.
        """
        point = self.point
        targets = point.prediction.tips - np.nan_to_num(self.system.deviation)
        at_targets = self.problem.predict(point.x, point.frame, targets)
        by_targets = self._with_jacobian(at_targets.jacobian, self.system.prior)
        directions = np.hstack([self.system.unknown, by_targets.unknown])
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

    def _with_jacobian(self, jacobian: Array, prior: Prior) -> Linearisation:
        prediction = replace(self.point.prediction, jacobian=jacobian)
        point = replace(self.point, prediction=prediction)
        return linearise(point, prior, self.noise, self.weights)

    def _whitened_rows(self, columns: Array) -> tuple[Array, Array]:
        """Whitened rows by the estimates (m, p), and by q values whose units displace the records
        by ``columns`` (n, 3 or 6, q).
        """
        jacobian = np.concatenate([self.point.prediction.jacobian, columns], axis=2)
        rows = self._with_jacobian(jacobian, self.system.prior).jacobian
        by_estimates, by_others = np.split(rows, [self.problem.scales.size], axis=1)
        return by_estimates, by_others

    def response(self, columns: Array) -> Array:
        """Derivative of all estimates by what the fit held (p, q) [units]: ``-(JᵀJ)⁻¹ Jᵀ C``;
        ``columns`` displace the records by one unit (n, 3 or 6, q) [m, rad].
        """
        by_estimates, by_others = self._whitened_rows(columns)
        steps = self.system.independent_steps
        return -steps @ (steps.T @ (by_estimates.T @ by_others))

    @property
    def nonlinear_u(self) -> dict[str, float]:
        """Standard uncertainty of each uncertain nonlinear parameter, by key of its effect."""
        variances = np.diag(self.full_covariance)[self.problem.scales.size :]
        keys = [effect.key for effect in self.nonlinear_widths]
        return dict(zip(keys, np.sqrt(variances).tolist(), strict=True))

    @cached_property
    def nonlinear_widths(self) -> dict[Effect, float]:
        """Effects with an uncertain nonlinear parameter, and its prior standard deviation."""
        widths = {}
        for effect in self.effects:
            is_estimated = effect.key in self.estimated_nonlinear
            width = effect.nonlinear.prior_sd(effect) if is_estimated else effect.nonlinear_u
            if width:
                widths[effect] = width
        return widths

    @cached_property
    def full_covariance(self) -> Array:
        """Of all columns and, last, of the nonlinear parameters."""
        point = self.point
        p = self.problem.scales.size
        widths = np.array([*self.nonlinear_widths.values()])
        system = self.system
        if widths.size:
            by_nonlinear = [self._by_nonlinear(*item) for item in self.nonlinear_widths.items()]
            columns = [point.prediction.jacobian, np.stack(by_nonlinear, axis=2)]
            prior = self.problem.prior(point.x, widths)
            system = self._with_jacobian(np.concatenate(columns, axis=2), prior)
        covariance = system.covariance(np.pad(self.unknown, ((0, widths.size), (0, 0))))
        for column, effect in enumerate(self.nonlinear_widths, p):
            variance = covariance[column, column]
            least = self.estimated_nonlinear.get(effect.key, 0.0) ** 2
            if 0.0 < variance < least:  # what is correlated with it grows too
                regression = covariance[column] / variance
                covariance = covariance + (least - variance) * np.outer(regression, regression)
        covariance[:p, :p] += self.added_covariance
        return covariance

    def _by_nonlinear(self, effect: Effect, width: float) -> Array:
        """∂(pose)/∂(nonlinear parameter) (n, 3 or 6) [m/unit]."""
        name = effect.nonlinear.field
        poses = []
        for step in (DIFFERENCE_STEP * width, -DIFFERENCE_STEP * width):
            changed = replace(effect, **{name: getattr(effect, name) + step})
            effects = [changed if other == effect else other for other in self.effects]
            vector = replace(self.problem.vector, effects=tuple(effects))
            displaced = replace(self.problem, vector=vector)
            poses.append(displaced.poses(self.point.x, self.point.frame))
        return (poses[0] - poses[1]) / (2 * DIFFERENCE_STEP * width)
