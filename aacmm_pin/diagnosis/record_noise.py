"""The noise of records: records of one posture at one target share an error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from scipy.sparse import csr_array

from aacmm_pin._support.arrays import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.calibration import Correlation, Fit
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import posture_numbers

RATIOS = (1e-3, 1e3)
"""Standard deviation of the error of a posture over a record's, at least and at most."""
NEAR = 0.02
"""Postures whose readings differ by no more in any joint may share an error: a hand holds an arm no
better [rad; m where a joint slides]. If nothing is shared, this costs nothing.
"""
LEFT_OUT = 1e-10
"""Parts of a whitening below this part of the largest are rounding."""
NO_RESIDUAL = 1e-300
"""χ² is at least this, of data that fit without any residual."""
SAME_LOG_VARIANCE = 0.1
"""Log variances of the means that differ by less are about the same."""


@dataclass(frozen=True, eq=False)
class RecordNoise:
    """What gives each residual unit variance, and the error that records of one posture and one
    seat, a group, share.

    The whitened residuals of a group have the covariance ``R + ratio² U Uᵀ``: R is the correlation
    of records of one reading, U the displacement by what is shared.

    Attributes:
        whitening: of each record (n, 3, 3) [1/m], with orientations (n, 6, 6).
        group: number of the group of each record, -1 if it does not count (n,).
        coordinates: how many coordinates a record of each group states (groups,).
        ratio: standard deviation of the shared error over a record's; root mean square, if the
            readings cause it.
        of_readings: whether the readings cause the shared error; else it displaces all records of a
            posture alike, in units of their noise.
        log_ratio: log likelihood with the shared error over that without.
        correlation: of records of one reading, whose stated noise they share.
        by_reading: whitened displacement by the readings (n, k, nq), one on the average.
        readings: standard deviation of each reading that displaces so (nq,) [rad; m where it
            slides].
        record: standard deviation of a record beside what it shares, in units of its noise.
    """

    whitening: Array
    group: Index
    coordinates: Array
    ratio: float = 0.0
    of_readings: bool = False
    log_ratio: float = 0.0
    correlation: Correlation = field(default_factory=Correlation)
    by_reading: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    readings: Array = field(default_factory=lambda: np.zeros(0))
    record: float = 1.0

    @cached_property
    def count(self) -> Array:
        """Records of each group (groups,)."""
        return np.bincount(self.group[self.group >= 0]).astype(np.float64)

    @property
    def width(self) -> int:
        """Numbers of a residual, 3 or 6."""
        return int(self.whitening.shape[1])

    @property
    def p_value(self) -> float:
        """Chance of such a likelihood ratio if postures share nothing (Self, Liang 1987, JASA
        82).
        """
        if not self.ratio:
            return 1.0
        return 0.5 * float(chi2_sf(2.0 * self.log_ratio, 1))

    @staticmethod
    def of_postures(fit: Fit, whitening: Array) -> RecordNoise:
        """The noise of a fit by its postures, whose records share only what is stated of their
        readings.
        """
        used = fit.used
        group = np.full(used.size, -1, dtype=np.intp)
        postures = posture_numbers(fit.problem.measurements.q, NEAR)
        posture_and_seat = np.stack([postures, fit.observations.seat], axis=1)[used]
        _, first_of_group, group_of_used = np.unique(
            posture_and_seat, axis=0, return_index=True, return_inverse=True
        )
        group[used] = group_of_used.ravel()
        coordinates = fit.observations.counts[used][first_of_group]
        noise = RecordNoise(whitening, group, coordinates.astype(np.float64))
        if not noise.repeat:
            return noise
        whitening_of_used = whitening * used[:, None, None]
        correlation = fit.noise.correlation(whitening_of_used)
        noise = replace(noise, correlation=correlation)
        readings = reading_units(fit)
        by_reading = correlation.whitened(whitening_of_used @ (fit.by_reading * readings))
        coordinates_in_all = max(noise.coordinates @ noise.count, 1.0)
        average_displacement = np.sqrt(np.square(by_reading).sum() / coordinates_in_all)
        if not average_displacement > 0.0:
            return noise
        return replace(
            noise,
            by_reading=by_reading / average_displacement,
            readings=readings / average_displacement,
        )

    @property
    def repeat(self) -> bool:
        """Whether any posture has several records."""
        return bool(self.count.sum() > self.count.size)

    def likeliest(self, deviations: Array, dof: float) -> RecordNoise:
        """The same groups, which share nothing here, with the likeliest shared error, by deviations
        (n, 3 or 6) [m, rad] with so many degrees of freedom left.

        Its size is a restricted maximum likelihood estimate (Patterson, Thompson 1971, Biometrika
        58) with all fitted parameters among what the groups share. An error of the readings has to
        be clearly more probable than one of the noise's shape, and than scatter from record to
        record.
        """
        residual = np.einsum("nij,nj->ni", self.whitening, deviations)
        likeliest, log_shared, log_nothing_shared = _fitted(self, residual, dof)
        if self.by_reading.size:
            of_readings = replace(self, of_readings=True)
            in_group = self.group >= 0
            record_by_record = replace(
                of_readings,
                group=np.where(in_group, np.cumsum(in_group) - 1, -1),
                coordinates=self.coordinates[self.group[in_group]],
            )
            likeliest_of_readings, log_of_readings, _ = _fitted(of_readings, residual, dof)
            _, log_record_by_record, _ = _fitted(record_by_record, residual, dof)
            log_of_others = max(log_nothing_shared, log_shared, log_record_by_record)
            if log_of_readings > log_of_others + THRESHOLDS.readings:
                likeliest, log_shared = likeliest_of_readings, log_of_readings
                log_nothing_shared = max(log_nothing_shared, log_record_by_record)
        if log_shared <= log_nothing_shared:
            return self
        return replace(likeliest, log_ratio=log_shared - log_nothing_shared)

    def log_density(self, dof: float) -> float:
        """What the shared error adds to the log likelihood beside χ²."""
        return self.restricted_log_density(self.ratio, dof) - dof * float(np.log(self.record))

    def restricted_log_density(self, ratio: float, dof: float) -> float:
        """What a shared error of size ``ratio`` adds to the log likelihood for a record's variance
        of one, the fitted parameters being among what groups share.
        """
        fitted_parameters = float(self.coordinates @ self.count) - dof
        part_unfitted = max(self.directions - fitted_parameters, 1.0) / self.directions
        return -0.5 * part_unfitted * float(self.log_volume(ratio).sum())

    @property
    def directions(self) -> float:
        """Number of directions of the residuals in which an error is shared."""
        directions_of_group = (
            float(self.by_reading.shape[2]) if self.of_readings else self.coordinates
        )
        return float(np.minimum(directions_of_group, self.coordinates * self.count).sum())

    @cached_property
    def columns(self) -> Array:
        """Whitened displacement by one unit of what is shared (n, k, columns)."""
        if self.of_readings:
            return self.by_reading
        return self.correlation.whitened(np.tile(np.eye(self.width), (len(self.group), 1, 1)))

    def along(self, rows: Array) -> Array:
        """Products of the columns with rows (n, k, c), of each group (groups, columns, c)."""
        products = self.columns.transpose(0, 2, 1) @ rows
        inside = np.flatnonzero(self.group >= 0)
        ones = (np.ones(inside.size), (self.group[inside], inside))
        sum_of_groups = csr_array(ones, shape=(len(self.count), len(self.group)))
        sums = np.asarray(sum_of_groups @ products.reshape(len(rows), -1))
        return sums.reshape(len(self.count), *products.shape[1:])

    @cached_property
    def spectra(self) -> tuple[Array, Array]:
        """Squares of the columns of each group, along these directions (groups, columns)."""
        values, vectors = np.linalg.eigh(self.along(self.columns))
        return np.maximum(values, 0.0), vectors

    def log_volume(self, ratio: float) -> Array:
        """Log determinant of each group's covariance over that of independent records (groups,); of
        the noise's shape by the coordinates that a record states.
        """
        if not ratio:
            return np.zeros_like(self.coordinates)
        variance = ratio**2
        log_volumes = np.log1p(variance * self.spectra[0]).sum(axis=1)
        if self.of_readings:
            return np.asarray(log_volumes)
        unstated = self.width - self.coordinates
        return np.asarray(log_volumes - unstated * np.log1p(variance * self.count))

    def is_about(self, other: RecordNoise) -> bool:
        """Whether the same postures have about the other error, or a small one beside a record's in
        both.
        """
        log_variance_change = self.log_volume(self.ratio) - other.log_volume(other.ratio)
        return bool(abs((log_variance_change / self.coordinates).mean()) < SAME_LOG_VARIANCE)

    def with_whole_groups(self, chosen: Mask, used: Mask) -> Mask:
        """Some records (n,) and all used ones that share an error with any."""
        if not self.ratio:
            return chosen
        groups = np.unique(self.group[chosen & (self.group >= 0)])
        return np.asarray(chosen | (used & np.isin(self.group, groups)))

    def divided(self, records: Index, most: int) -> Iterator[Index]:
        """The records in turn, about ``most`` at once; those of one group together."""
        order = records[np.argsort(self.group[records], kind="stable")]
        group = self.group[order]
        group_starts = np.flatnonzero((np.diff(group, prepend=-2) != 0) | (group < 0))
        first = 0
        while first < order.size:
            possible_ends = group_starts[group_starts >= first + most]
            end = int(possible_ends[0]) if possible_ends.size else order.size
            yield order[first:end]
            first = end

    def take(self, records: Index) -> RecordNoise:
        """The noise of some of the records, whole groups of them."""
        group = self.group[records]
        inside = group >= 0
        groups_taken, new_number = np.unique(group[inside], return_inverse=True)
        group = np.full(group.size, -1, dtype=np.intp)
        group[inside] = new_number
        return replace(
            self,
            whitening=self.whitening[records],
            group=group,
            coordinates=self.coordinates[groups_taken],
            correlation=self.correlation.take(records),
            by_reading=self.by_reading[records] if self.by_reading.size else self.by_reading,
        )

    def whitened(self, deviations: Array) -> Array:
        """Deviations (n, 3 or 6, …) [m, rad] in units of the noise, with what records share."""
        flat = deviations.reshape(*deviations.shape[:2], -1)
        return self.decorrelated(self.whitening @ flat).reshape(deviations.shape)

    def decorrelated(self, rows: Array) -> Array:
        """Rows (n, …), whitened record by record, with what records share whitened too: ``(I +
        ratio² U Uᵀ)^-½``.

        The mean of a group of m, for example, has ``1 + m ratio²`` times the variance.
        """
        if not (self.ratio or self.correlation.records.size):
            return rows
        whitened = self.correlation.whitened(rows.copy())
        if not self.ratio:
            return whitened
        flat = whitened.reshape(*rows.shape[:2], -1)
        values, vectors = self.spectra
        variance = self.ratio**2
        standard_deviations = np.sqrt(1.0 + variance * values)
        factors = variance / (standard_deviations * (1.0 + standard_deviations))
        shared_parts = factors[:, :, None] * (vectors.transpose(0, 2, 1) @ self.along(flat))
        inside = self.group >= 0
        flat[inside] -= self.columns[inside] @ (vectors @ shared_parts)[self.group[inside]]
        return whitened

    def independent(self, deviations: Array) -> Array:
        """Deviations (n, 3 or 6) [m, rad] as those of records that share nothing."""
        whitened = self.whitened(deviations)
        return np.asarray(np.einsum("nij,nj->ni", self._unwhitening, whitened))

    def shared_size(self, fit: Fit) -> float:
        """Root mean square displacement of tips by the shared error, for a variance of one [m]."""
        if not self.of_readings:
            by_unit = self.ratio * self._unwhitening
            return fit.expected_rms(by_unit @ by_unit.transpose(0, 2, 1))
        u_readings = self.record * self.ratio * self.readings
        displacements = fit.by_reading * u_readings
        return fit.expected_rms(displacements @ displacements.transpose(0, 2, 1))

    @property
    def _unwhitening(self) -> Array:
        """Inverse of the whitening, for what it does not leave out (n, k, k) [m]."""
        inverse = np.linalg.pinv(self.whitening, rcond=LEFT_OUT)
        return np.asarray(inverse, np.float64)

    def added_covariance(self, fit: Fit, variance: float) -> Array:
        """What the shared error adds to the covariance of a fit's parameters that took records as
        independent (p, p) [units]; ``variance`` multiplies the variances of this noise.

        ``A⁻¹ Jᵀ W (V - W⁻¹) W J A⁻¹`` with the records' covariance V and the fit's weights W
        (Liang, Zeger 1986, Biometrika 73), as far as that is positive.
        """
        if not self.ratio:
            return np.zeros((fit.problem.scales.size,) * 2)
        has_target = fit.observations.has_target
        width = self.width
        steps = fit.system.steps(fit.unknown)
        jacobian = np.zeros((len(has_target), width, steps.shape[1]))
        jacobian_with_target = fit.system.jacobian[: width * has_target.sum()]
        jacobian[has_target] = (jacobian_with_target @ steps).reshape(-1, width, steps.shape[1])
        weights = np.sqrt(fit.weights)[:, None, None]
        correlation_of_fit = fit.noise.correlation(fit.noise.whitening * weights)
        weighed_jacobian = correlation_of_fit.weighed(jacobian.copy())
        whitened_unit = fit.noise.whitening @ self._unwhitening
        rows_in_units = np.sqrt(variance) * whitened_unit.transpose(0, 2, 1) @ weighed_jacobian
        rows_in_units = self.correlation.weighed_back(rows_in_units)
        shared = self.ratio * self.along(rows_in_units)
        added = _squared(rows_in_units) + _squared(shared) - _squared(jacobian)
        values, vectors = np.linalg.eigh(added)
        directions = steps @ vectors
        return np.asarray(directions * np.maximum(values, 0.0) @ directions.T)

    def scaled(self, stated: bool) -> RecordNoise:
        """With the noise of the whitening beside the shared error if ``stated``, else as
        estimated.
        """
        record = 1.0 if stated else self.record
        return replace(self, whitening=self.whitening / record, record=record)


def reading_units(fit: Fit) -> Array:
    """Standard deviation of each reading beside the others (nq,) [rad; m where it slides]: as
    stated, else the same for all; a sliding joint then moves tips as a turning one on the average.
    """
    stated = fit.problem.setup.encoder_noise
    if stated is not None and stated.any():
        return stated
    slides = fit.problem.model.arm.chain.prismatic
    displacements = fit.by_reading[fit.used, :3]
    levers = np.sqrt(np.square(displacements).sum(axis=1).mean(axis=0))
    average_lever = float(levers[~slides].mean()) if not slides.all() else 1.0
    return np.where(slides, average_lever, 1.0)


def _fitted(noise: RecordNoise, residual: Array, dof: float) -> tuple[RecordNoise, float, float]:
    """The noise with the likeliest shared error of its kind, and the restricted log likelihoods
    with this and with nothing shared, each with the best variance of a record.
    """
    inside = (noise.group >= 0)[:, None]
    whitened = noise.correlation.whitened(np.where(inside, residual, 0.0))
    values, vectors = noise.spectra
    along_directions = vectors.transpose(0, 2, 1) @ noise.along(whitened[:, :, None])
    squares = np.square(along_directions[:, :, 0])
    sum_of_squares = float(np.square(whitened).sum())
    # Degrees of freedom of all residuals, those inside groups at least.
    dof_of_all = max(dof, float(noise.coordinates @ noise.count) - noise.directions + 1.0)

    def chi2(ratio: float) -> float:
        explained = (squares * ratio**2 / (1.0 + ratio**2 * values)).sum()
        return max(sum_of_squares - float(explained), NO_RESIDUAL)

    def log_likelihood(ratio: float) -> float:
        log_chi2 = float(np.log(chi2(ratio)))
        return noise.restricted_log_density(ratio, dof) - 0.5 * dof_of_all * log_chi2

    best = scipy.optimize.minimize_scalar(
        lambda log_ratio: -log_likelihood(float(np.exp(log_ratio))),
        bounds=np.log(RATIOS),
        method="bounded",
    )
    ratio = float(np.exp(best.x))
    record = float(np.sqrt(chi2(ratio) / dof_of_all))
    return replace(noise, ratio=ratio, record=record), -float(best.fun), log_likelihood(0.0)


def _squared(rows: Array) -> Array:
    """Products of the columns, summed over all rows (n, k, columns)."""
    stacked = rows.reshape(-1, rows.shape[-1])
    return stacked.T @ stacked
