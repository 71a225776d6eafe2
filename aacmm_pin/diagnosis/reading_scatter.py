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
        counts = fit.used
        width = deviations.shape[1]
        observations = fit.observations
        by_reading = fit.by_reading
        eye = np.broadcast_to(np.eye(width), (len(deviations), width, width))
        columns = [eye[:, :, :3]]
        if width > 3:
            columns.append(np.where(observations.oriented[:, None, None], eye[:, :, 3:], 0.0))
        alone = len(columns)
        columns += np.split(by_reading, by_reading.shape[2], axis=2)
        rows = [observations.along_normals(eye) @ column for column in columns]
        squares = np.stack([row @ row.transpose(0, 2, 1) for row in rows])
        enlarged = np.where(np.isfinite(deviations), deviations, 0.0) / np.sqrt(share_left)
        # Stated noise may be nothing at all, and nothing is stated of some records' rotations.
        stated = fit.noise.without_scatter + LEAST_SCATTER**2 * np.eye(width)
        search = _Components(stated[counts], squares[:, counts], enlarged[counts])
        start = np.square(fit.noise.scatters)[:alone]
        start = np.maximum(start, LEAST_VARIANCE)
        lever = np.square(by_reading[counts, :3]).sum(axis=1).mean(axis=0)
        first = FIRST_SHARE * start[0] / np.maximum(lever, LEAST_TIP_LEVER**2)
        apart = replace(search, residuals=noise.independent(enlarged)[counts])
        log_ratios = apart.sure_ratios(np.concatenate([start, first]), alone)
        chosen = np.concatenate([start, np.where(log_ratios > 0.0, first, 0.0)])
        variances = search.best(chosen)
        readings = np.sqrt(variances[alone:])
        larger = log_ratios > 0.0
        if fit.problem.setup.encoder_noise is None and larger.any():
            units = reading_units(fit)
            of_all = np.tensordot(np.square(units), squares[alone:, counts], 1)
            alike = replace(apart, squares=np.append(search.squares[:alone], of_all[None], axis=0))
            together = np.append(start, np.square(readings / units).mean())
            gain = apart.largest(chosen) - alike.largest(together)
            relative = readings / units
            larger = (relative > rms(relative)) & (gain > THRESHOLDS.readings)
        covariances = stated + np.tensordot(variances, squares, 1)
        size = fit.expected_rms(covariances)
        as_stated = size < THRESHOLDS.as_stated * fit.expected_rms(stated)
        return ReadingScatter(
            covariances=covariances,
            readings=readings,
            at_tips=readings * np.sqrt(lever),
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
        scatter = np.tensordot(variances, self.squares, 1)
        return self.stated + scatter

    def best(self, variances: Array) -> Array:
        """The likeliest variances; those that are zero stay zero."""
        acting = np.flatnonzero(variances)
        of_each = self.squares[acting].reshape(len(acting), -1)
        likeliest = variances.copy()
        for _ in range(STEPS):
            inverse = np.linalg.inv(self.covariances(likeliest))
            pulled = inverse @ self.residuals[:, :, None]
            pulls = pulled @ pulled.transpose(0, 2, 1)
            # Both are sums of squares; below zero they are rounded zeros.
            squares = np.maximum(of_each @ pulls.ravel(), 0.0)
            expected = of_each @ inverse.ravel()
            likeliest[acting] *= np.sqrt(squares / np.maximum(expected, LEAST_VARIANCE))
        return likeliest

    def largest(self, start: Array) -> float:
        return self.log_likelihood(self.best(start))

    def sure_ratios(self, start: Array, alone: int) -> Array:
        """Log likelihood with each variance from number ``alone`` on over that without; 0 below the
        threshold. The least sure is taken out until all are sure.
        """
        ratios = np.zeros(start.size)
        chosen = [*range(alone, start.size)]
        with_all = self.largest(start)
        if with_all - self.largest(_without(start, chosen)) < THRESHOLDS.readings:
            return ratios[alone:]
        while chosen:
            losses = [with_all - self.largest(_without(start, [k])) for k in chosen]
            least = int(np.argmin(losses))
            if losses[least] >= THRESHOLDS.readings:
                ratios[chosen] = losses
                break
            start = _without(start, [chosen.pop(least)])
            with_all = self.largest(start)
        return ratios[alone:]

    def log_likelihood(self, variances: Array) -> float:
        covariances = self.covariances(variances)
        residuals = self.residuals[:, :, None]
        squares = np.sum(residuals * np.linalg.solve(covariances, residuals))
        return float(-0.5 * (np.linalg.slogdet(covariances)[1].sum() + squares))


def _without(variances: Array, numbers: list[int]) -> Array:
    variances = variances.copy()
    variances[numbers] = 0.0
    return variances
