"""Scatter beside the stated noise and all that was found: of tips, rotations, readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array, Mask
from aacmm_pin.calibration import Fit, rms
from aacmm_pin.calibration.estimation import LEAST_SCATTER
from aacmm_pin.diagnosis.record_noise import RecordNoise, reading_units
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import Observations

STEPS = 30
"""Steps of the maximisation, each of which increases the likelihood."""
FIRST_SHARE = 0.1
"""Part of the scatter of tips that the readings of each joint have at first."""
LEAST_TIP_LEVER = 1e-3
"""A joint counts as moving tips by at least this for its first scatter [m/rad]."""
LEAST_VARIANCE = 1e-30
"""A variance is at least this, so that it can be divided by."""


@dataclass(frozen=True, eq=False)
class ReadingScatter:
    """Variance components of the residuals beside the stated noise (Patterson, Thompson 1971,
    Biometrika 58).

    Attributes:
        covariances: of each residual, stated noise and all components (n, 3, 3) [m²]; with
            orientations (n, 6, 6).
        readings: standard deviation of each joint's readings beyond the stated noise (nq,) [rad; m
            where it slides].
        at_tips: what that moves tips by, root mean square (nq,) [m].
        log_ratios: log likelihood with the scatter of each joint over that without (nq,). All three
            are zero below the threshold.
        size: root mean square of a tip's residual by all of these [m].
        larger: whether the readings of each joint scatter more than stated, or if nothing is
            stated, more than those of the other joints (nq,).
        as_stated: whether the stated noise is all there is.
    """

    covariances: Array
    readings: Array
    at_tips: Array
    log_ratios: Array
    size: float
    larger: Mask
    as_stated: bool
    observations: Observations

    @staticmethod
    def of(fit: Fit, deviations: Array, share_left: float, noise: RecordNoise) -> ReadingScatter:
        """By the ``deviations`` of records from all that was found, (n, 3) [m], with orientations
        (n, 6), with the part ``share_left`` of their degrees of freedom.

        The likelihood is maximised by steps that multiply each variance (minorise, maximise: Zhou,
        Hu, Qiao, Cho 2019, J. Comput. Graph. Stat. 28); residuals are enlarged by what the fit
        took. What records share by their ``noise`` is no scatter of readings.
        """
        used = fit.used
        width = deviations.shape[1]
        observations = fit.observations
        by_reading = fit.by_reading
        eye = np.broadcast_to(np.eye(width), (len(deviations), width, width))
        unit_errors = [eye[:, :, :3]]
        if width > 3:
            unit_errors.append(np.where(observations.oriented[:, None, None], eye[:, :, 3:], 0.0))
        first_reading = len(unit_errors)
        unit_errors += np.split(by_reading, by_reading.shape[2], axis=2)
        displacements = [observations.along_normals(eye) @ unit_error for unit_error in unit_errors]
        squares = np.stack([moved @ moved.transpose(0, 2, 1) for moved in displacements])
        finite_deviations = np.where(np.isfinite(deviations), deviations, 0.0)
        enlarged_deviations = finite_deviations / np.sqrt(share_left)
        # Stated noise may be nothing at all, and nothing is stated of some records' rotations.
        stated = fit.noise.without_scatter + LEAST_SCATTER**2 * np.eye(width)
        unshared_residuals = noise.independent(enlarged_deviations)[used]
        start_of_tips = np.square(fit.noise.scatters)[:first_reading]
        start_of_tips = np.maximum(start_of_tips, LEAST_VARIANCE)
        squared_lever = np.square(by_reading[used, :3]).sum(axis=1).mean(axis=0)
        lever_at_least = np.maximum(squared_lever, LEAST_TIP_LEVER**2)
        start_of_readings = FIRST_SHARE * start_of_tips[0] / lever_at_least

        def log_likelihood(start: Array, components: Array) -> float:
            return _likeliest(stated[used], components, unshared_residuals, start)[1]

        def log_with(start_of_readings: Array) -> float:
            start = np.concatenate([start_of_tips, start_of_readings])
            return log_likelihood(start, squares[:, used])

        log_ratios = _sure_ratios(log_with, start_of_readings)
        larger = log_ratios > 0.0
        start_of_sure = np.concatenate([start_of_tips, np.where(larger, start_of_readings, 0.0)])
        variances, _ = _likeliest(
            stated[used], squares[:, used], enlarged_deviations[used], start_of_sure
        )
        readings = np.sqrt(variances[first_reading:])
        if fit.problem.setup.encoder_noise is None and larger.any():
            units = reading_units(fit)
            squares_of_all = np.tensordot(np.square(units), squares[first_reading:, used], 1)
            squares_alike = np.append(squares[:first_reading, used], squares_of_all[None], axis=0)
            relative_scatter = readings / units
            start_alike = np.append(start_of_tips, np.square(relative_scatter).mean())
            gain = log_likelihood(start_of_sure, squares[:, used])
            gain -= log_likelihood(start_alike, squares_alike)
            larger = (relative_scatter > rms(relative_scatter)) & (gain > THRESHOLDS.readings)
        covariances = stated + np.tensordot(variances, squares, 1)
        size = fit.expected_rms(covariances)
        as_stated = size < THRESHOLDS.as_stated * fit.expected_rms(stated)
        return ReadingScatter(
            covariances=covariances,
            readings=readings,
            at_tips=readings * np.sqrt(squared_lever),
            log_ratios=log_ratios,
            size=size,
            larger=larger,
            as_stated=fit.noise_is_stated and as_stated,
            observations=observations,
        )

    @property
    def whitening(self) -> Array:
        """What gives each residual unit variance (n, 3, 3) [1/m], or (n, 6, 6)."""
        whitening = np.linalg.inv(np.linalg.cholesky(self.covariances))
        return self.observations.along_normals(whitening)


def _likeliest(
    stated: Array, squares: Array, residuals: Array, start: Array
) -> tuple[Array, float]:
    """The likeliest variances v of components of residuals (n, k), and the log likelihood but for a
    constant; variances that start at zero stay zero.

    Args:
        stated, squares: N (n, k, k) and F_c F_cᵀ (c, n, k, k) of the covariances ``N + Σ v_c F_c
            F_cᵀ``.
        start: first variance of each component (c,).
    """
    acting = np.flatnonzero(start)
    squares = squares[acting]
    squares_of_each = squares.reshape(len(acting), -1)
    variances = start.copy()
    residuals = residuals[:, :, None]
    for _ in range(STEPS):
        inverse = np.linalg.inv(stated + np.tensordot(variances[acting], squares, 1))
        weighed = inverse @ residuals
        weighed_products = weighed @ weighed.transpose(0, 2, 1)
        # Both are sums of squares; below zero they are rounded zeros.
        observed = np.maximum(squares_of_each @ weighed_products.ravel(), 0.0)
        expected = squares_of_each @ inverse.ravel()
        variances[acting] *= np.sqrt(observed / np.maximum(expected, LEAST_VARIANCE))
    covariances = stated + np.tensordot(variances[acting], squares, 1)
    chi2 = np.sum(residuals * np.linalg.solve(covariances, residuals))
    return variances, float(-0.5 * (np.linalg.slogdet(covariances)[1].sum() + chi2))


def _sure_ratios(log_with: Callable[[Array], float], start: Array) -> Array:
    """Log likelihood with each variance over that without, by that with some first variances (c,);
    0 below the threshold. The least sure is taken out until all are sure.
    """
    ratios = np.zeros(start.size)
    with_all = log_with(start)
    if with_all - log_with(np.zeros(start.size)) < THRESHOLDS.readings:
        return ratios
    acting = [*range(start.size)]
    while acting:
        without_each = [np.where(np.arange(start.size) == k, 0.0, start) for k in acting]
        ratios_of_acting = [with_all - log_with(without) for without in without_each]
        least_sure = int(np.argmin(ratios_of_acting))
        if ratios_of_acting[least_sure] >= THRESHOLDS.readings:
            ratios[acting] = ratios_of_acting
            break
        del acting[least_sure]
        start = without_each[least_sure]
        with_all = log_with(start)
    return ratios
