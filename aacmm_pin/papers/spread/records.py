"""How well records themselves, angles and touched seat, would tell causes apart of which spreads say little.

All records together are normal: ``r ~ N(0, B + s² K)``. B holds what is there anyway, the stated uncertainty of the
arm and a floor of noise; K is the covariance by the cause at size 1. The place of each seat is unknown, so only
contrasts within seats count (Helmert contrasts; restricted likelihood). If cause t of size s_t is true, cause a loses
against it on average

    ``½ [tr(C_a⁻¹ C_t) - N + ln|C_a| - ln|C_t|]``

in log-likelihood, the Kullback–Leibler divergence, smallest over the size of a and over a factor κ ≥ 1 of all of C_a, the
scatter that a diagnosis refits: the expected logarithm of a Bayes factor but for the price of what is free. Against B
itself, κ = 1, it is ``½ Σ [λ_i - ln(1 + λ_i)]``, the λ_i adding up to the mean λ of the χ² test of the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.linalg import helmert, solve_triangular
from scipy.optimize import minimize_scalar

from aacmm_pin._support.checks import Array
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.noise import ENCODER
from aacmm_pin.papers.spread.seats import TouchedSeats

SCATTER = "scatter alone"
"""No cause but more noise than stated."""


@dataclass(frozen=True, eq=False)
class Kernel:
    """Covariance of the contrasts of all records by one cause of size 1, ``K = F Fᵀ``.

    Attributes:
        name: of the cause.
        factor: F (N, r) [m].
        size: the size that it is supposed to have.
    """

    name: str
    factor: Array
    size: float = 1.0


def kernel_of_effects(
    seats: TouchedSeats, name: str, effects: Sequence[Effect], size: float = 1.0, conditions: Conditions | None = None
) -> Kernel:
    """Effects with independent parameters, each normal with ``size`` times its typical magnitude."""
    typical = np.array([term.typical for effect in effects for term in effect.terms])
    return Kernel(name, _contrasts(seats, seats.sensitivity(effects, conditions) * typical), size)


def kernel_of_noise(seats: TouchedSeats, name: str, factors: Array, size: float = 1.0) -> Kernel:
    """Noise that is new in every record, with covariance ``f_i f_iᵀ`` of record i at size 1.

    Args:
        seats: the seats.
        name: of the cause.
        factors: f_i of every record (n, 3, m) [m]; the levers of the joints for encoder noise of one radian.
        size: that it is supposed to have.
    """
    n, _, m = factors.shape
    spread = np.zeros((n, 3, n, m))
    spread[np.arange(n), :, np.arange(n)] = factors
    return Kernel(name, _contrasts(seats, spread.reshape(n, 3, n * m)), size)


def expected_log_bayes_factors(seats: TouchedSeats, kernels: Sequence[Kernel], floor: float = ENCODER) -> pd.DataFrame:
    """Expected loss of log-likelihood, truth in the rows, alternatives in the columns, scatter alone the last.

    Args:
        seats: seats and postures of the records; the model's own stated uncertainty is there in every case.
        kernels: the causes, each at its size.
        floor: encoder noise that is there in every case [rad].

    Raises:
        AacmmError: ``floor`` is not above zero.
    """
    if not floor > 0:
        raise AacmmError(f"floor is {floor:g} rad, expected encoder noise above zero")
    whitened = _whitened(seats, kernels, floor)
    names = [kernel.name for kernel in kernels]
    axes = [_principal(factor) for factor in whitened]
    table = pd.DataFrame(index=pd.Index(names, name="true cause"), columns=[*names, SCATTER], dtype=float)
    for truth, factor, (own, _) in zip(kernels, whitened, axes, strict=True):
        variances = truth.size**2 * own
        true = _Truth(len(factor), float(variances.sum()), float(np.log1p(variances).sum()))
        table.loc[truth.name, SCATTER] = true.loss(0.0, 0.0)
        for name, (values, vectors) in zip(names, axes, strict=True):
            along = truth.size**2 * np.square(vectors.T @ factor).sum(axis=1)
            table.loc[truth.name, name] = max(0.0, true.least_loss(values, along))
    return table


@dataclass(frozen=True)
class _Truth:
    """The true covariance where B is the identity: number of contrasts, trace and log-determinant of what it adds."""

    count: int
    trace: float
    log_determinant: float

    def loss(self, taken: float, log_determinant: float) -> float:
        """By an alternative that takes ``taken`` from the trace of ``C_a⁻¹ C_t``, its scatter refitted."""
        trace = self.count + self.trace - taken
        factor = max(1.0, trace / self.count)
        alike = trace / factor - self.count + self.count * np.log(factor)
        return float(0.5 * (alike + log_determinant - self.log_determinant))

    def least_loss(self, values: Array, along: Array) -> float:
        """Over the size of the alternative with eigenvalues ``values``, along which the truth has variances ``along``."""

        def loss(log_size: float) -> float:
            scaled = np.exp(2 * log_size) * values
            share = scaled / (1.0 + scaled)  # of the variance beside B, along each axis
            return self.loss(float(((1.0 + along) * share).sum()), float(np.log1p(scaled).sum()))

        # A first look all over, for the loss may have two valleys: small, or so large that scatter is not needed.
        tried = np.arange(-5.0, 12.0, 0.5) - 0.5 * np.log(values.max())
        best = tried[np.argmin([loss(t) for t in tried])]
        found = minimize_scalar(loss, bounds=(best - 0.5, best + 0.5), method="bounded", options={"xatol": 1e-5})
        return float(found.fun)


def _whitened(seats: TouchedSeats, kernels: Sequence[Kernel], floor: float) -> list[Array]:
    """Factors of the kernels where B is the identity."""
    model = seats.model
    known = _contrasts(seats, model.sensitivity(seats.all_q, at=seats.at))
    noise = kernel_of_noise(seats, "floor", seats.levers()).factor
    base = known @ model.covariance() @ known.T + floor**2 * noise @ noise.T
    lower = np.linalg.cholesky(base + 1e-12 * np.trace(base) / len(base) * np.eye(len(base)))
    return [solve_triangular(lower, kernel.factor, lower=True) for kernel in kernels]


def _principal(factor: Array) -> tuple[Array, Array]:
    """Eigenvalues and eigenvectors of ``F Fᵀ``, those that are not zero."""
    rows, columns = factor.shape
    if columns >= rows:
        values, vectors = np.linalg.eigh(factor @ factor.T)
    else:
        values, right = np.linalg.eigh(factor.T @ factor)
        vectors = factor @ right / np.sqrt(np.maximum(values, 1e-300))
    there = values > 1e-12 * values.max()
    return values[there], vectors[:, there]


def _contrasts(seats: TouchedSeats, columns: Array) -> Array:
    """Helmert contrasts within seats of ``columns`` (n, 3, p): (N, p), N = 3 Σ (n_k - 1)."""
    parts = [np.einsum("an,nip->aip", helmert(len(part)), part, optimize=True) for part in seats.by_seat(columns)]
    return np.concatenate([part.reshape(-1, columns.shape[2]) for part in parts])
