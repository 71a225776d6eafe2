"""The least-squares kernel that calibration, diagnosis and planning share.

**Rows.** ``r + A δ``, in units of their noise. With the widths w of the parameters, ``δ = w x``,
and what is known of them beforehand, the rows ``P x + q``, the sum to be least is
``χ²(x) = |A w x + r|² + |P x + q|²``.

**Triangle.** By reflections, ``[P q; A w r] = Q [R z; 0 e]``, so that ``χ² = |R x + z|² + e²``. Of
rows that come one after the other, the triangle of the first stands in for them.

**Normal equations.** ``RᵀR = w AᵀA w + PᵀP`` by Cholesky, columns of length one: a seventh of the
time. They square how unevenly directions are known, and serve where that leaves digits enough.

**Solution.** ``x = -R⁻¹ z``; it lowers χ² by ``|z|²``. The columns of ``R⁻¹`` are steps of unit
variance: the covariance of x is ``R⁻¹ R⁻ᵀ``. With ``R = U S Vᵀ``, a step in a trust region is
``-V S (S² + λ)⁻¹ Uᵀ z``, as long as the radius.

**Leverage.** With ``S = A w R⁻¹``, the fit takes up the part ``S Sᵀ`` of the rows (the hat matrix);
they determine ``tr(I - P R⁻¹ R⁻ᵀ Pᵀ)`` parameters; a residual over the root of what remains of its
variance is studentised.

**Elimination.** With nuisances first, ``R = [R₁ R₁₂; 0 R₂]``: ``R₂ᵀR₂`` is the Schur complement of
the nuisances, what the rows say of the others when the nuisances are at their best. The unknown
points of seats are eliminated from the rows themselves (``SeatElimination``).

**Identifiability.** ``R = U S Vᵀ``: a direction v with ``s < 1`` is known by less than one over its
width; with the stated part of P alone, those with hardly any s are known to nobody.

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

from aacmm_pin._support.checks import Array

LEAST_INFORMATION = 0.1
"""A direction about which data and stated uncertainties together say less than this, one over its
width, is not known."""
MOVABLE = 1e-9
"""A direction with a singular value below this, of columns times their widths, is one along which
no step can be taken."""
UNEVEN = 1e-6
"""Normal equations do where every singular value, of columns of length one, is certain to be above
this: errors of the smallest are then a ten-thousandth of it, and the gradient has none."""
SINGULAR_RATIO = 1e-13
"""Directions with smaller singular values, beside the largest, are rounding."""
ROWS_AT_ONCE = 4000
"""Rows that are brought to a triangle at once: copies of all of them would take more memory than
all the rest."""
ROUNDINGS = (1e-14, 1e-12, 1e-10, 1e-8)
"""Inner products are no more certain than this part of them, the first with which they are positive
definite."""


class Solution(NamedTuple):
    """Steps of unit variance that span all of which something is known (p, k), and the residual
    along each of them (k,).
    """

    steps: Array
    along: Array

    @property
    def best(self) -> Array:
        """The Gauss–Newton step (p,)."""
        return np.asarray(-(self.steps @ self.along))

    @property
    def reduction(self) -> float:
        """How much that step lowers χ² if the problem is linear."""
        return float(self.along @ self.along)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the parameters beforehand.

    Attributes:
        rows: whitened, in units of the scales, the residual last (k, p + 1).
        scales: how far off each parameter may be (p,) [units].
        stated: the rows without what nobody stated (k, p + 1).
    """

    rows: Array
    scales: Array
    stated: Array


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``r + A δ`` in whitened rows, with what is known of the parameters beforehand.

    Attributes:
        rows: columns and, last, the residual (m, p + 1) [1/unit].
        prior: of the parameters.
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
        """Products of the columns with one another, in units of the scales, prior included
        (p, p).
        """
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
    def normal(self) -> Solution | None:
        """Solution of the normal equations, in units of the scales; None where some directions are
        hardly known.
        """
        prior = self.prior.rows
        of_rows = self.prior.scales * (self.residual @ self.jacobian)
        return normal_solution(self._information, of_rows + prior[:, -1] @ prior[:, :-1])

    @cached_property
    def solution(self) -> Solution:
        """In units of the scales; by the directions that can be moved along where some cannot."""
        return self.normal or Spectrum.of(self.triangle).above(MOVABLE).solution

    @cached_property
    def measured_triangle(self) -> Array:
        """R of the scaled rows with the residual last (p + 1, p + 1), or with fewer rows."""
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
        """Directions of which neither the data nor stated uncertainties say anything (p, k),
        orthonormal [scales].
        """
        informed = Spectrum.of(np.concatenate([self.prior.stated, self.measured_triangle]))
        return informed.directions[:, informed.values < LEAST_INFORMATION]

    @cached_property
    def independent_steps(self) -> Array:
        """Steps of unit variance that span all of which something is known (p, k) [units]: the
        covariance is their square.
        """
        return self.prior.scales[:, None] * self.solution.steps

    @property
    def determined(self) -> float:
        """How many parameters the rows determine: one that its prior determines costs them
        nothing.
        """
        steps = self.solution.steps
        by_prior = np.square(self.prior.rows[:, :-1] @ steps).sum()
        return float(steps.shape[1] - by_prior)

    def covariance(self, unknown: Array) -> Array:
        """Covariance of the parameters (p, p) [units], zero along the ``unknown`` directions (p, k)
        [scales].
        """
        steps = self.steps(unknown)
        return steps @ steps.T

    def steps(self, unknown: Array) -> Array:
        """Steps of unit variance that span all but the ``unknown`` directions (p, p - k)
        [units].
        """
        directions = null_space(unknown.T) if unknown.size else np.eye(self.prior.scales.size)
        triangle = np.linalg.qr(self.triangle[:, :-1] @ directions, mode="r")
        return (directions @ np.linalg.inv(triangle)) * self.prior.scales[:, None]


def normal_solution(information: Array, gradient: Array) -> Solution | None:
    """Of the columns' products with one another (p, p) and with the residual (p,); None where some
    directions are hardly known.
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
    return Solution(inverse / lengths[:, None], inverse.T @ (gradient / lengths))


class Spectrum(NamedTuple):
    """Singular values of rows (k,), largest first; their directions, columns in the units of the
    rows' columns (p, k); and the residual along each (k,).
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
        """With the values above ``least``."""
        chosen = self.values > least
        return Spectrum(self.values[chosen], self.directions[:, chosen], self.along[chosen])

    @property
    def solution(self) -> Solution:
        """Along these directions."""
        return Solution(self.directions / self.values, self.along)


class BoundedStep(NamedTuple):
    """A step of the parameters in a trust region.

    Attributes:
        parameters: the step (p,) [units].
        length: with each parameter in units of the length of its column.
        predicted: how much it lowers χ² if the problem is linear.
        reduction: how much the Gauss–Newton step does.
    """

    parameters: Array
    length: float
    predicted: float
    reduction: float


def bounded_step(model: LinearModel, units: Array, radius: float) -> BoundedStep:
    """The best step no longer than ``radius``, with lengths of the columns as ``units`` (p,)."""
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
    predicted = float(np.sum(along**2 * (1.0 - (1.0 - part) ** 2)))
    reduction = (normal or spectrum.solution).reduction
    length = float(np.linalg.norm(step))
    return BoundedStep(step / divisors * scales, length, predicted, reduction)


def _damping(spectrum: Spectrum, radius: float) -> float:
    """What is added to the squared singular values so that the step is as long as ``radius``; 0 if
    it is shorter.
    """
    values, _, along = spectrum

    def excess(log_damping: float) -> float:
        step = values * along / (values**2 + np.exp(log_damping))
        return float(np.linalg.norm(step) - radius)

    if np.linalg.norm(along / values) <= radius:
        return 0.0
    high = max(float(np.linalg.norm(values * along) / radius), 1e-290)
    return float(np.exp(scipy.optimize.brentq(excess, np.log(1e-300), np.log(high), rtol=1e-3)))


def remaining_triangle(rows: Array, nuisances: int) -> Array:
    """R (q, q) with ``RᵀR`` the Schur complement of the first columns in the normal matrix of
    ``rows`` (m, nuisances + q).
    """
    missing = max(rows.shape[1] - len(rows), 0)
    triangle = np.asarray(np.linalg.qr(np.pad(rows, ((0, missing), (0, 0))), mode="r"))
    return triangle[nuisances:, nuisances:]


def lower_factor(matrix: Array, sizes: Array) -> Array:
    """Lower Cholesky factor, with the least rounding, in parts of ``sizes`` (m,), at which there
    is one.
    """
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
    """``L⁻¹ R``, row by row in memory.

    As ``Rᵀ L⁻ᵀ``, whose arrays lie in memory as BLAS wants them: half the time of LAPACK's solver
    with its copies.
    """
    rows = np.ascontiguousarray(right).T
    solved = dtrsm(1.0, factor.T, rows, side=1, lower=0, overwrite_b=False)
    return np.asarray(solved.T)
