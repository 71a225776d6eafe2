"""The least-squares kernel that calibration, diagnosis and planning share.

**Rows.** ``r + A δ``, in units of their noise. With the widths w of the parameters, ``δ = w x``,
and the prior rows ``P x + q``, the sum to minimise is ``χ²(x) = |A w x + r|² + |P x + q|²``.

**Triangle.** By reflections, ``[P q; A w r] = Q [R z; 0 e]``, so that ``χ² = |R x + z|² + e²``.

**Normal equations.** ``RᵀR = w AᵀA w + PᵀP`` by Cholesky, columns of length one: a seventh of the
time. They square the condition number, and serve where enough digits are left.

**Solution.** ``x = -R⁻¹ z`` lowers χ² by ``|z|²``. The columns of ``R⁻¹`` are steps of unit
variance: the covariance of x is ``R⁻¹ R⁻ᵀ``. With ``R = U S Vᵀ``, a step in a trust region is ``-V
S (S² + λ)⁻¹ Uᵀ z``, as long as the radius.

**Leverage.** With ``S = A w R⁻¹``, the hat matrix is ``S Sᵀ``; the rows determine ``tr(I - P R⁻¹
R⁻ᵀ Pᵀ)`` parameters; a residual over the root of its remaining variance is studentised.

**Elimination.** With nuisances first, ``R = [R₁ R₁₂; 0 R₂]``: ``R₂ᵀR₂`` is their Schur complement.
Unknown points of seats are eliminated from the rows themselves (``SeatElimination``).

**Identifiability.** ``R = U S Vᵀ``: a direction v with ``s < 1`` is known by less than one over its
width; with the stated part of P alone, those with hardly any s are unknown.

**Evidence.** With ``β ~ N(0, τ²)`` and ``G + τ⁻² = L Lᵀ``, products γ with the residual explain
``|L⁻¹ γ|²``, and the volume is ``Σ log(τ Lᵢᵢ)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from scipy.linalg import null_space
from scipy.linalg.blas import dtrsm

from aacmm_pin._support.arrays import Array

LEAST_INFORMATION = 0.1
"""A direction with less information, in one over its width, is unknown."""
MOVABLE = 1e-9
"""Least singular value, of columns times widths, for a step."""
UNEVEN = 1e-6
"""Normal equations do if all singular values, of columns of length one, are certainly larger: the
smallest then has an error of 1e-4, the gradient none.
"""
SINGULAR_RATIO = 1e-13
ROWS_AT_ONCE = 4000
"""A copy of all rows would take more memory than all the rest."""
ROUNDINGS = (1e-14, 1e-12, 1e-10, 1e-8)
"""The first with which inner products are positive definite counts."""


class UnitSteps(NamedTuple):
    """Steps of unit variance along all that is known (p, k), and the residual along each (k,)."""

    steps: Array
    along: Array

    @property
    def best(self) -> Array:
        """The Gauss–Newton step (p,)."""
        return -(self.steps @ self.along)

    @property
    def reduction(self) -> float:
        """How much that step lowers χ² of a linear problem."""
        return float(self.along @ self.along)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known beforehand.

    Attributes:
        rows: whitened, the residual last (k, p + 1) [scales].
        scales: how far off each parameter may be (p,) [units].
        stated: the rows of stated uncertainties alone (k, p + 1).
    """

    rows: Array
    scales: Array
    stated: Array


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``r + A δ`` in whitened rows, with a prior.

    Attributes:
        rows: columns and, last, the residual (m, p + 1) [1/unit].
    """

    rows: Array
    prior: Prior

    @property
    def jacobian(self) -> Array:
        """A (m, p)."""
        return self.rows[:, :-1]

    @property
    def residual(self) -> Array:
        """r (m,)."""
        return self.rows[:, -1]

    @property
    def cost(self) -> float:
        """χ², prior included."""
        of_prior = self.prior.rows[:, -1]
        return float(self.residual @ self.residual + of_prior @ of_prior)

    @cached_property
    def _information(self) -> Array:
        scales = self.prior.scales
        prior = self.prior.rows[:, :-1]
        information = self.jacobian.T @ self.jacobian
        information *= scales
        information *= scales[:, None]
        information += prior.T @ prior
        return information

    @property
    def lengths(self) -> Array:
        """Of the columns, times their scales (p,)."""
        return np.sqrt(np.diagonal(self._information))

    @cached_property
    def normal(self) -> UnitSteps | None:
        """Of the normal equations [scales]; None if some directions are hardly known."""
        prior = self.prior.rows
        of_rows = self.prior.scales * (self.residual @ self.jacobian)
        return normal_solution(self._information, of_rows + prior[:, -1] @ prior[:, :-1])

    @cached_property
    def solution(self) -> UnitSteps:
        """In units of the scales, along the directions that can be moved along."""
        return self.normal or Spectrum.of(self.triangle).above(MOVABLE).solution

    @cached_property
    def measured_triangle(self) -> Array:
        """R of the scaled rows with the residual last (p + 1, p + 1), or fewer rows."""
        scales = np.append(self.prior.scales, 1.0)
        triangle = np.empty((0, scales.size))
        for first in range(0, max(len(self.rows), 1), ROWS_AT_ONCE):
            some = self.rows[first : first + ROWS_AT_ONCE]
            above = len(triangle)
            rows = np.concatenate([triangle, np.empty_like(some)])
            np.multiply(some, scales, out=rows[above:])
            triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        return triangle

    @cached_property
    def triangle(self) -> Array:
        """The same with the prior."""
        rows = np.concatenate([self.prior.rows, self.measured_triangle])
        return np.asarray(np.linalg.qr(rows, mode="r"))

    @cached_property
    def unknown(self) -> Array:
        """Directions without information from data or stated uncertainties (p, k), orthonormal
        [scales].
        """
        informed = Spectrum.of(np.concatenate([self.prior.stated, self.measured_triangle]))
        return informed.directions[:, informed.values < LEAST_INFORMATION]

    @cached_property
    def independent_steps(self) -> Array:
        """Steps of the solution (p, k) [units]: their square is the covariance."""
        return self.prior.scales[:, None] * self.solution.steps

    @property
    def determined(self) -> float:
        """How many parameters the rows determine beyond the prior."""
        steps = self.solution.steps
        by_prior = np.square(self.prior.rows[:, :-1] @ steps).sum()
        return float(steps.shape[1] - by_prior)

    def covariance(self, unknown: Array) -> Array:
        """Of the parameters (p, p) [units], zero along ``unknown`` directions (p, k) [scales]."""
        steps = self.steps(unknown)
        return steps @ steps.T

    def steps(self, unknown: Array) -> Array:
        """Steps of unit variance that span all but ``unknown`` directions (p, p - k) [units]."""
        directions = null_space(unknown.T) if unknown.size else np.eye(self.prior.scales.size)
        triangle = np.linalg.qr(self.triangle[:, :-1] @ directions, mode="r")
        return (directions @ np.linalg.inv(triangle)) * self.prior.scales[:, None]


def normal_solution(information: Array, gradient: Array) -> UnitSteps | None:
    """From products of the columns with one another (p, p) and the residual (p,); None for hardly
    known directions.
    """
    lengths = np.sqrt(np.diagonal(information))
    if not (lengths.size and (lengths > MOVABLE).all()):
        return None
    scaled = information / lengths
    scaled /= lengths[:, None]
    factor, failed = scipy.linalg.lapack.dpotrf(scaled.T, lower=0, clean=1, overwrite_a=1)
    if failed:
        return None
    inverse = scipy.linalg.lapack.dtrtri(factor)[0]
    # No singular value is smaller than one over this norm.
    if not np.linalg.norm(inverse) * UNEVEN < 1.0:
        return None
    return UnitSteps(inverse / lengths[:, None], inverse.T @ (gradient / lengths))


class Spectrum(NamedTuple):
    """Singular values of rows (k,), largest first, directions (p, k), and residual along each
    (k,).
    """

    values: Array
    directions: Array
    along: Array

    @staticmethod
    def of(rows: Array) -> Spectrum:
        """Of rows with the residual last (m, p + 1)."""
        missing = max(rows.shape[1] - 1 - len(rows), 0)  # what fewer rows leave is unknown
        rows = np.pad(rows, ((0, missing), (0, 0)))
        left, values, right = np.linalg.svd(rows[:, :-1], full_matrices=False)
        return Spectrum(values, right.T, left.T @ rows[:, -1])

    def above(self, least: float) -> Spectrum:
        """Those with larger values."""
        chosen = self.values > least
        return Spectrum(self.values[chosen], self.directions[:, chosen], self.along[chosen])

    @property
    def solution(self) -> UnitSteps:
        """Along all directions."""
        return UnitSteps(self.directions / self.values, self.along)


class BoundedStep(NamedTuple):
    """A step in a trust region.

    Attributes:
        parameters: (p,) [units].
        length: in lengths of the columns.
        reduction: how much it lowers χ² of a linear problem.
        full_reduction: how much the Gauss–Newton step does.
    """

    parameters: Array
    length: float
    reduction: float
    full_reduction: float


def bounded_step(model: LinearModel, units: Array, radius: float) -> BoundedStep:
    """The best step no longer than ``radius`` in ``units`` (p,) of the parameters."""
    normal = model.normal
    scales = model.prior.scales
    if normal is not None:
        step = normal.best
        length = float(np.linalg.norm(step * units))
        if length <= radius:
            return BoundedStep(step * scales, length, normal.reduction, normal.reduction)
    # Steps that are too long, or where some directions are unknown.
    divisors = np.where(units > 0.0, units, 1.0)
    spectrum = Spectrum.of(model.triangle / np.append(divisors, 1.0))
    spectrum = spectrum.above(SINGULAR_RATIO * spectrum.values.max(initial=0.0))
    values, directions, along = spectrum
    part = values**2 / (values**2 + _damping(spectrum, radius))
    step = directions @ (-part * along / values)
    reduction = float(np.sum(along**2 * (1.0 - (1.0 - part) ** 2)))
    full_reduction = (normal or spectrum.solution).reduction
    length = float(np.linalg.norm(step))
    return BoundedStep(step / divisors * scales, length, reduction, full_reduction)


def _damping(spectrum: Spectrum, radius: float) -> float:
    """Addend of squared singular values for a step as long as ``radius``; 0 if none is needed."""
    values, _, along = spectrum

    def excess(log_damping: float) -> float:
        step = values * along / (values**2 + np.exp(log_damping))
        return float(np.linalg.norm(step) - radius)

    if np.linalg.norm(along / values) <= radius:
        return 0.0
    high = max(float(np.linalg.norm(values * along) / radius), 1e-290)
    return float(np.exp(scipy.optimize.brentq(excess, np.log(1e-300), np.log(high), rtol=1e-3)))


def remaining_triangle(rows: Array, nuisances: int) -> Array:
    """R (q, q): ``RᵀR`` is the Schur complement of the first columns of ``rows`` (m, nuisances +
    q).
    """
    missing = max(rows.shape[1] - len(rows), 0)
    triangle = np.asarray(np.linalg.qr(np.pad(rows, ((0, missing), (0, 0))), mode="r"))
    return triangle[nuisances:, nuisances:]


def lower_factor(matrix: Array, sizes: Array) -> Array:
    """Lower Cholesky factor with the least rounding, in parts of ``sizes`` (m,), that works."""
    for rounding in ROUNDINGS:
        factor, failed = scipy.linalg.lapack.dpotrf(
            matrix + np.diag(rounding * sizes), lower=1, clean=1
        )
        if not failed:
            break
    return np.asarray(factor)


def inverse_of_factor(factor: Array) -> Array:
    """``(L Lᵀ)⁻¹`` of a lower Cholesky factor (m, m)."""
    if not factor.size:
        return np.zeros((0, 0))
    lower = scipy.linalg.lapack.dpotri(factor, lower=1)[0]
    inverse = lower + lower.T
    inverse.flat[:: len(inverse) + 1] *= 0.5
    return np.asarray(inverse)


def solve_lower(factor: Array, right: Array) -> Array:
    """``L⁻¹ R``, row by row in memory: as ``Rᵀ L⁻ᵀ``, in half the time of LAPACK's solver."""
    rows = np.ascontiguousarray(right).T
    solved = dtrsm(1.0, factor.T, rows, side=1, lower=0, overwrite_b=False)
    return np.asarray(solved.T)
