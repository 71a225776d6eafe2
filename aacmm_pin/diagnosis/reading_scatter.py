"""Scatter beside the stated noise and all that was found: of tips, rotations, readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin.calibration import Fit, rms
from aacmm_pin.calibration.variance_components import LEAST_SCATTER
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
        components = _Components(stated[used], squares[:, used], enlarged_deviations[used])
        start_of_tips = np.square(fit.noise.scatters)[:first_reading]
        start_of_tips = np.maximum(start_of_tips, LEAST_VARIANCE)
        squared_lever = np.square(by_reading[used, :3]).sum(axis=1).mean(axis=0)
        lever_at_least = np.maximum(squared_lever, LEAST_TIP_LEVER**2)
        start_of_readings = FIRST_SHARE * start_of_tips[0] / lever_at_least
        unshared = replace(components, residuals=noise.independent(enlarged_deviations)[used])
        start = np.concatenate([start_of_tips, start_of_readings])
        log_ratios = unshared.sure_ratios(start, first_reading)
        start_of_sure_readings = np.where(log_ratios > 0.0, start_of_readings, 0.0)
        start_of_sure = np.concatenate([start_of_tips, start_of_sure_readings])
        variances = components.best(start_of_sure)
        readings = np.sqrt(variances[first_reading:])
        larger = log_ratios > 0.0
        if fit.problem.setup.encoder_noise is None and larger.any():
            units = reading_units(fit)
            squares_of_all = np.tensordot(np.square(units), squares[first_reading:, used], 1)
            squares_of_tips = components.squares[:first_reading]
            squares_alike = np.append(squares_of_tips, squares_of_all[None], axis=0)
            joints_alike = replace(unshared, squares=squares_alike)
            relative_scatter = readings / units
            start_alike = np.append(start_of_tips, np.square(relative_scatter).mean())
            gain = unshared.largest(start_of_sure) - joints_alike.largest(start_alike)
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


@dataclass(frozen=True, eq=False)
class _Components:
    """``C = N + Σ v_c F_c F_cᵀ`` for the ``residuals`` (n, k): N (n, k, k) is ``stated``, the
    ``squares`` are F_c F_cᵀ (c, n, k, k).
    """

    stated: Array
    squares: Array
    residuals: Array

    def covariances(self, variances: Array) -> Array:
        """``C`` of each residual (n, k, k), by the variance of each component (c,)."""
        scatter = np.tensordot(variances, self.squares, 1)
        return self.stated + scatter

    def best(self, variances: Array) -> Array:
        """The likeliest variances; those that are zero stay zero."""
        acting = np.flatnonzero(variances)
        squares_of_each = self.squares[acting].reshape(len(acting), -1)
        likeliest = variances.copy()
        for _ in range(STEPS):
            inverse = np.linalg.inv(self.covariances(likeliest))
            weighed = inverse @ self.residuals[:, :, None]
            weighed_products = weighed @ weighed.transpose(0, 2, 1)
            # Both are sums of squares; below zero they are rounded zeros.
            observed = np.maximum(squares_of_each @ weighed_products.ravel(), 0.0)
            expected = squares_of_each @ inverse.ravel()
            likeliest[acting] *= np.sqrt(observed / np.maximum(expected, LEAST_VARIANCE))
        return likeliest

    def largest(self, start: Array) -> float:
        """Log likelihood of the best variances."""
        return self.log_likelihood(self.best(start))

    def sure_ratios(self, start: Array, first: int) -> Array:
        """Log likelihood with each variance from number ``first`` on over that without; 0 below the
        threshold. The least sure is taken out until all are sure.
        """
        ratios = np.zeros(start.size)
        acting = [*range(first, start.size)]
        with_all = self.largest(start)
        if with_all - self.largest(_without(start, acting)) < THRESHOLDS.readings:
            return ratios[first:]
        while acting:
            ratios_of_acting = [with_all - self.largest(_without(start, [k])) for k in acting]
            least_sure = int(np.argmin(ratios_of_acting))
            if ratios_of_acting[least_sure] >= THRESHOLDS.readings:
                ratios[acting] = ratios_of_acting
                break
            start = _without(start, [acting.pop(least_sure)])
            with_all = self.largest(start)
        return ratios[first:]

    def log_likelihood(self, variances: Array) -> float:
        """Of the residuals, but for a constant."""
        covariances = self.covariances(variances)
        residuals = self.residuals[:, :, None]
        squares = np.sum(residuals * np.linalg.solve(covariances, residuals))
        return float(-0.5 * (np.linalg.slogdet(covariances)[1].sum() + squares))


def _without(variances: Array, numbers: list[int]) -> Array:
    """The variances, zero at these numbers."""
    variances = variances.copy()
    variances[numbers] = 0.0
    return variances
