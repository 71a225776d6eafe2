"""Held postures: records of one posture at one target share an error, which has variance components
of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from scipy.sparse import csr_array

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.calibration import Correlation, Fit
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.measurements import posture_numbers

RATIOS = (1e-3, 1e3)
"""Standard deviation of the error of a posture over that of a record, at least and at most."""
NEAR = 0.02
"""Postures whose readings differ by no more than this in any joint may share an error: a hand holds
an arm no better [rad; m where a joint slides]. Where nothing is shared, this costs nothing.
"""
LEFT_OUT = 1e-10
"""Parts of a whitening that are smaller than this, beside the largest, are rounding."""
NO_RESIDUAL = 1e-300
"""χ² is at least this, of data that fit without any residual."""
SAME_LOG_VARIANCE = 0.1
"""Log variances of the means that differ by less are about the same."""


@dataclass(frozen=True, order=True)
class SharedSizes:
    """Standard deviations of what records of one posture share, over that of a record.

    Attributes:
        ratio: of an error that displaces all records of a posture alike, in units of their noise.
        reading: of the displacement by errors of the readings, root mean square.
    """

    ratio: float = 0.0
    reading: float = 0.0

    @property
    def relative(self) -> float:
        """Of both together."""
        return float(np.hypot(self.ratio, self.reading))


class Estimate(NamedTuple):
    """The likeliest sizes of some kind."""

    log_likelihood: float
    sizes: SharedSizes


@dataclass(frozen=True, eq=False)
class HeldPostures:
    """Groups of records of one posture and one seat, and the error that each group shares.

    The residuals of a group have the covariance ``R + ratio² 1 1ᵀ ⊗ I + reading² B Bᵀ``: R is the
    correlation of records of one reading, B the displacement by the readings.

    Attributes:
        group: number of the group of each record, -1 of those that do not count (n,).
        count: records of each group (groups,).
        numbers: how many numbers a record of each group states (groups,).
        ratio, reading: see :class:`SharedSizes`.
        log_ratio: log likelihood with the shared error over that without.
        correlation: of records of one reading, whose stated noise they share.
        by_reading: whitened displacement by the readings (n, k, nq), of one on the average.
        readings: standard deviation of each reading that displaces so (nq,) [rad; m where it
            slides].
        record: standard deviation of a record beside what it shares, in units of its noise; 1 where
            nothing is shared.
    """

    group: Index
    count: Array
    numbers: Array
    ratio: float = 0.0
    log_ratio: float = 0.0
    reading: float = 0.0
    correlation: Correlation = field(default_factory=Correlation)
    by_reading: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    readings: Array = field(default_factory=lambda: np.zeros(0))
    record: float = 1.0

    @property
    def p_value(self) -> float:
        """Chance of such a likelihood ratio if records of one posture share nothing (Self, Liang
        1987, JASA 82).
        """
        if not self.relative:
            return 1.0
        return 0.5 * float(chi2_sf(2.0 * self.log_ratio, 1))

    @property
    def sizes(self) -> SharedSizes:
        """Of the shared error."""
        return SharedSizes(self.ratio, self.reading)

    @property
    def relative(self) -> float:
        """Standard deviation of the shared error over that of a record."""
        return self.sizes.relative

    @staticmethod
    def groups_of(fit: Fit, whitening: Array) -> HeldPostures:
        """The groups of the records that count, which share nothing but what is stated of their
        readings.

        Args:
            fit: the fit.
            whitening: of each record (n, 3, 3) [1/m], or (n, 6, 6).
        """
        counts = fit.used & fit.observations.has_target
        group = np.full(len(counts), -1, dtype=np.intp)
        postures = posture_numbers(fit.problem.measurements.q, NEAR)
        pairs = np.stack([postures, fit.observations.seat], axis=1)[counts]
        _, first, number = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
        group[counts] = number.ravel()
        numbers = fit.observations.counts[counts][first]
        count = np.bincount(group[counts])
        groups = HeldPostures(group, count.astype(np.float64), numbers.astype(np.float64))
        return groups._with_readings(fit, whitening) if groups.repeat else groups

    def _with_readings(self, fit: Fit, whitening: Array) -> HeldPostures:
        """The same with what the readings displace."""
        inside = self.group >= 0
        of_counted = whitening * inside[:, None, None]
        correlation = fit.noise.correlation(of_counted)
        readings = _reading_units(fit)
        by_reading = fit.problem.reading_jacobian(fit.point.x, fit.point.frame) * readings
        by_reading = correlation.whitened(of_counted @ by_reading)
        size = np.sqrt(np.square(by_reading).sum() / max(self.numbers @ self.count, 1.0))
        if not size > 0.0:
            return replace(self, correlation=correlation)
        return replace(
            self, correlation=correlation, by_reading=by_reading / size, readings=readings / size
        )

    @property
    def repeat(self) -> bool:
        """Whether any posture has several records."""
        return bool(self.count.sum() > self.count.size)

    def with_error(self, sizes: SharedSizes) -> HeldPostures:
        """The same groups with a shared error of these sizes."""
        return replace(self, ratio=sizes.ratio, reading=sizes.reading, log_ratio=0.0, record=1.0)

    def likeliest(self, residual: Array, dof: float) -> HeldPostures:
        """The same groups, which share nothing here, with the likeliest shared error.

        The sizes are restricted maximum likelihood estimates (Patterson, Thompson 1971, Biometrika
        58) with all fitted parameters among what the groups share. An error of the readings is to
        be clearly more probable than one of the noise's shape, and than readings that scatter from
        record to record.

        Args:
            residual: whitened record by record (n, k).
            dof: degrees of freedom that are left.
        """
        shared = _Likelihood.of(self, residual, dof)
        nothing = Estimate(shared.of_sizes(SharedSizes()), SharedSizes())
        alike = max(nothing, shared.like_noise)
        if not self.by_reading.size:
            return self._with(alike, nothing, shared)
        readings = shared.like_readings
        if shared.like_both.log_likelihood > readings.log_likelihood + THRESHOLDS.readings:
            readings = shared.like_both
        apart = _Likelihood.of(self.apart, residual, dof).like_readings
        other = max(alike, apart)
        if readings.log_likelihood > other.log_likelihood + THRESHOLDS.readings:
            return self._with(readings, max(nothing, apart), shared)
        return self._with(alike, nothing, shared)

    def _with(self, estimate: Estimate, nothing: Estimate, by: _Likelihood) -> HeldPostures:
        """The same groups with what was found, over nothing that is shared."""
        log_ratio = estimate.log_likelihood - nothing.log_likelihood
        record = by.record(estimate.sizes) if log_ratio > 0.0 else 1.0
        return replace(self.with_error(estimate.sizes), log_ratio=log_ratio, record=record)

    @property
    def apart(self) -> HeldPostures:
        """Each record a group of its own."""
        inside = self.group >= 0
        group = np.where(inside, np.cumsum(inside) - 1, -1)
        numbers = self.numbers[self.group[inside]]
        return replace(self, group=group, count=np.ones(numbers.size), numbers=numbers)

    def log_density(self, dof: float) -> float:
        """What the shared error adds to the log likelihood beside χ², with ``dof`` degrees of
        freedom left.
        """
        of_shared = self.restricted(float(self._log_volume.sum()), self.sizes, dof)
        return of_shared - dof * float(np.log(self.record))

    def restricted(self, log_volume: float, sizes: SharedSizes, dof: float) -> float:
        """The same of a log determinant, all fitted parameters being among what groups share."""
        directions = self.directions(sizes)
        fitted = float(self.numbers @ self.count) - dof
        return -0.5 * log_volume * max(directions - fitted, 1.0) / directions

    def directions(self, sizes: SharedSizes) -> float:
        """Number of directions of the residuals in which an error of these sizes is shared."""
        count = self.by_reading.shape[2] if sizes.reading else 0
        alone = bool(count and not sizes.ratio)
        of_noise = np.zeros_like(self.numbers) if alone else self.numbers
        numbers = self.numbers * self.count
        shared = np.minimum(of_noise + count, numbers)
        return float(shared.sum())

    @cached_property
    def _log_volume(self) -> Array:
        """Log determinant of the covariance of each group over that of independent records
        (groups,).
        """
        return _Columns.of(self, self.width).log_volume(self.sizes)

    @property
    def width(self) -> int:
        """Numbers of a residual; 3 where nothing is known of readings."""
        return self.by_reading.shape[1] or 3

    def is_about(self, other: HeldPostures) -> bool:
        """Whether the error of the same postures is about another one, or small beside that of a
        record in both.
        """
        change = (self._log_volume - other._log_volume) / self.numbers
        return bool(abs(change.mean()) < SAME_LOG_VARIANCE)

    @cached_property
    def _sum(self) -> csr_array:
        inside = np.flatnonzero(self.group >= 0)
        shape = (len(self.count), len(self.group))
        return csr_array((np.ones(inside.size), (self.group[inside], inside)), shape=shape)

    def sums(self, rows: Array) -> Array:
        """Sum of the rows (n, …) of each group (groups, …)."""
        flat = rows.reshape(len(rows), -1)
        sums = np.asarray(self._sum @ flat)
        return sums.reshape(len(self.count), *rows.shape[1:])

    def with_all_of_a_group(self, chosen: Mask, used: Mask) -> Mask:
        """Some records (n,) and all used ones that share an error with any of them."""
        if not self.ratio:
            return chosen
        groups = np.unique(self.group[chosen & (self.group >= 0)])
        return np.asarray(chosen | (used & np.isin(self.group, groups)))

    def divided(self, records: Index, most: int) -> Iterator[Index]:
        """Some of the records in turn, about ``most`` at once; those of one group together."""
        order = records[np.argsort(self.group[records], kind="stable")]
        group = self.group[order]
        starts = np.flatnonzero((np.diff(group, prepend=-2) != 0) | (group < 0))
        first = 0
        while first < order.size:
            behind = starts[starts >= first + most]
            last = int(behind[0]) if behind.size else order.size
            yield order[first:last]
            first = last

    def take(self, records: Index) -> HeldPostures:
        """Those of some of the records, whole groups of them."""
        group = self.group[records]
        inside = group >= 0
        groups, local = np.unique(group[inside], return_inverse=True)
        group = np.full(group.size, -1, dtype=np.intp)
        group[inside] = local
        count = np.bincount(local, minlength=groups.size).astype(np.float64)
        by_reading = self.by_reading[records] if self.by_reading.size else self.by_reading
        return replace(
            self,
            group=group,
            count=count,
            numbers=self.numbers[groups],
            correlation=self.correlation.take(records),
            by_reading=by_reading,
        )

    def whitened(self, rows: Array) -> Array:
        """Rows (n, …), whitened record by record, with what records share whitened too.

        With the columns U of the shared error, ``(I + U Uᵀ)^-½``: the mean of a group of m, for
        example, has ``1 + m ratio²`` times the variance of independent records.
        """
        if not (self.relative or self.correlation.records):
            return rows
        whitened = self.correlation.whitened(rows.copy())
        if not self.relative:
            return whitened
        columns = _Columns.of(self, rows.shape[1])
        flat = whitened.reshape(*rows.shape[:2], -1)
        inside = self.group >= 0
        along = columns.weights(self.sizes) @ columns.sums(flat)
        flat[inside] -= columns.columns[inside] @ along[self.group[inside]]
        return whitened


def _reading_units(fit: Fit) -> Array:
    """Standard deviation of each reading beside those of the others (nq,) [rad; m where it slides]:
    as stated, else the same for all.

    A joint that slides moves tips by as much as one that turns does on the average.
    """
    stated = fit.problem.setup.encoder_noise
    if stated is not None and stated.any():
        return stated
    point = fit.point
    slides = fit.problem.model.arm.chain.prismatic
    shifts = fit.problem.reading_jacobian(point.x, point.frame)[fit.used, :3]
    levers = np.sqrt(np.square(shifts).sum(axis=1).mean(axis=0))
    turning = float(levers[~slides].mean()) if not slides.all() else 1.0
    return np.where(slides, turning, 1.0)


@dataclass(frozen=True, eq=False)
class _Columns:
    """Columns of the shared error, of the noise's shape and of the readings'.

    Attributes:
        held: the groups.
        columns: by one unit of each (n, k, k + nq).
        products: with one another (groups, k + nq, k + nq).
    """

    held: HeldPostures
    columns: Array
    products: Array

    @staticmethod
    def of(held: HeldPostures, width: int) -> _Columns:
        """Of residuals of so many numbers."""
        alike = held.correlation.whitened(np.tile(np.eye(width), (len(held.group), 1, 1)))
        of_readings = held.by_reading[:, :width]
        columns = np.concatenate([alike, of_readings], axis=2) if of_readings.size else alike
        squares = columns.transpose(0, 2, 1) @ columns
        return _Columns(held, columns, held.sums(squares))

    def sums(self, rows: Array) -> Array:
        """Products with rows (n, k, c), group by group (groups, k + nq, c)."""
        transposed = self.columns.transpose(0, 2, 1)
        return self.held.sums(transposed @ rows)

    def scales(self, sizes: SharedSizes) -> Array:
        """Size of each column (k + nq,)."""
        width = self.columns.shape[1]
        of_readings = self.columns.shape[2] - width
        return np.repeat([sizes.ratio, sizes.reading], [width, of_readings])

    def _spectra(self, sizes: SharedSizes) -> tuple[Array, Array]:
        """Variances of the shared error and directions, among the scaled columns."""
        scales = self.scales(sizes)
        values, vectors = np.linalg.eigh(self.products * scales * scales[:, None])
        return np.maximum(values, 0.0), vectors

    def weights(self, sizes: SharedSizes) -> Array:
        """What ``(I + U Uᵀ)^-½`` takes out by the products with the columns (groups, k + nq, k +
        nq).
        """
        values, vectors = self._spectra(sizes)
        deviations = np.sqrt(1.0 + values)
        parts = 1.0 / (deviations * (1.0 + deviations))
        scaled = self.scales(sizes)[:, None] * vectors
        return np.asarray((scaled * parts[:, None, :]) @ scaled.transpose(0, 2, 1))

    def log_volume(self, sizes: SharedSizes) -> Array:
        """Log determinant of each group's covariance over that of independent records (groups,).

        Of the noise's shape by the numbers that a record states.
        """
        values, _ = self._spectra(sizes)
        of_mean = np.log1p(self.held.count * sizes.ratio**2)
        unstated = self.columns.shape[1] - self.held.numbers
        return np.asarray(np.log1p(values).sum(axis=1) - unstated * of_mean)


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Log likelihood of residuals by the sizes of what groups share.

    Attributes:
        columns: of the shared error.
        sums: products of the residuals with them (groups, k + nq).
        square: of the residuals.
        dof: degrees of freedom that are left.
    """

    columns: _Columns
    sums: Array
    square: float
    dof: float

    @staticmethod
    def of(held: HeldPostures, residual: Array, dof: float) -> _Likelihood:
        """Of residuals that are whitened record by record (n, k)."""
        inside = (held.group >= 0)[:, None]
        rows = held.correlation.whitened(np.where(inside, residual, 0.0))
        columns = _Columns.of(held, rows.shape[1])
        sums = columns.sums(rows[:, :, None])[:, :, 0]
        return _Likelihood(columns, sums, float(np.square(rows).sum()), dof)

    def chi2(self, sizes: SharedSizes) -> float:
        """Of the residuals by their whole covariance."""
        scales = self.columns.scales(sizes)
        inside = self.columns.products * scales * scales[:, None] + np.eye(scales.size)
        along = (self.sums * scales)[:, :, None]
        return self.square - float((along * np.linalg.solve(inside, along)).sum())

    def _whole(self, sizes: SharedSizes) -> float:
        """Degrees of freedom of all residuals, those inside groups at least."""
        held = self.columns.held
        inside = float(held.numbers @ held.count) - held.directions(sizes)
        return max(self.dof, inside + 1.0)

    def record(self, sizes: SharedSizes) -> float:
        """Standard deviation of a record beside what it shares, in units of its noise."""
        chi2 = max(self.chi2(sizes), NO_RESIDUAL)
        return float(np.sqrt(chi2 / self._whole(sizes)))

    def of_sizes(self, sizes: SharedSizes) -> float:
        """Restricted log likelihood, the variance of a record at its best."""
        log_chi2 = float(np.log(max(self.chi2(sizes), NO_RESIDUAL)))
        log_volume = float(self.columns.log_volume(sizes).sum())
        of_volume = self.columns.held.restricted(log_volume, sizes, self.dof)
        return of_volume - 0.5 * self._whole(sizes) * log_chi2

    @cached_property
    def like_noise(self) -> Estimate:
        """With the likeliest error of the noise's shape alone."""
        return self._best_of_one(lambda size: SharedSizes(ratio=size))

    @cached_property
    def like_readings(self) -> Estimate:
        """With the likeliest error of the readings alone."""
        return self._best_of_one(lambda size: SharedSizes(reading=size))

    def _best_of_one(self, sizes_of: Callable[[float], SharedSizes]) -> Estimate:
        def loss(log_size: float) -> float:
            return -self.of_sizes(sizes_of(float(np.exp(log_size))))

        best = scipy.optimize.minimize_scalar(loss, bounds=np.log(RATIOS), method="bounded")
        return Estimate(-float(best.fun), sizes_of(float(np.exp(best.x))))

    @cached_property
    def like_both(self) -> Estimate:
        """With the likeliest errors of both."""

        def loss(log_sizes: Array) -> float:
            return -self.of_sizes(SharedSizes(*np.exp(log_sizes).tolist()))

        start = np.log([self.like_noise.sizes.ratio, self.like_readings.sizes.reading])
        bounds = [tuple(np.log(RATIOS))] * 2
        best = scipy.optimize.minimize(loss, start, method="Nelder-Mead", bounds=bounds)
        return Estimate(-float(best.fun), SharedSizes(*np.exp(best.x).tolist()))


@dataclass(frozen=True, eq=False)
class RecordNoise:
    """The noise of records: what gives each residual unit variance, and what records of one posture
    share.

    Attributes:
        whitening: (n, 3, 3) [1/m], with orientations (n, 6, 6).
        postures: records that share an error.
    """

    whitening: Array
    postures: HeldPostures

    def whitened(self, deviations: Array) -> Array:
        """Deviations (n, 3 or 6, …) [m, rad] in units of the noise, with what records share."""
        flat = deviations.reshape(*deviations.shape[:2], -1)
        rows = self.postures.whitened(self.whitening @ flat)
        return rows.reshape(deviations.shape)

    def independent(self, deviations: Array) -> Array:
        """Deviations (n, 3 or 6) [m, rad] as those of records that share nothing are."""
        whitened = self.whitened(deviations)
        return np.asarray(np.einsum("nij,nj->ni", self._unwhitening, whitened))

    def shared_size(self, fit: Fit) -> float:
        """Root mean square displacement of tips by the shared error, for a variance of one [m]."""
        postures = self.postures
        covariances = postures.ratio**2 * self.covariances
        if postures.reading:
            readings = postures.record * postures.reading * postures.readings
            point = fit.point
            shifts = fit.problem.reading_jacobian(point.x, point.frame) * readings
            covariances = covariances + shifts @ shifts.transpose(0, 2, 1)
        return fit.distance_of(covariances)

    @property
    def covariances(self) -> Array:
        """Of each residual but for what it shares (n, 3, 3) [m²], or (n, 6, 6)."""
        inverse = self._unwhitening
        return inverse @ inverse.transpose(0, 2, 1)

    @property
    def _unwhitening(self) -> Array:
        """What the whitening is undone by, where it does not leave out a part (n, k, k) [m]."""
        inverse = np.linalg.pinv(self.whitening, rcond=LEFT_OUT)
        return np.asarray(inverse, np.float64)

    def added_covariance(self, fit: Fit, variance: float) -> Array:
        """What the shared error adds to the covariance of a fit's parameters that took records as
        independent (p, p) [units].

        ``A⁻¹ Jᵀ W (V - W⁻¹) W J A⁻¹`` with the covariance V of the records and the fit's weights W
        (Liang, Zeger 1986, Biometrika 73), where that is positive.

        Args:
            fit: the fit.
            variance: factor on the variances of this noise.
        """
        postures = self.postures
        if not postures.relative:
            return np.zeros((fit.problem.scales.size,) * 2)
        has_target = fit.observations.has_target
        width = self.whitening.shape[1]
        steps = fit.system.steps(fit.unknown)
        rows = np.zeros((len(has_target), width, steps.shape[1]))
        of_records = fit.system.jacobian[: width * has_target.sum()]
        rows[has_target] = (of_records @ steps).reshape(-1, width, steps.shape[1])
        weights = np.sqrt(fit.weights)[:, None, None]
        weighed = fit.noise.correlation(fit.noise.whitening * weights).weighed(rows.copy())
        root = fit.noise.whitening @ self._unwhitening
        in_units = np.sqrt(variance) * root.transpose(0, 2, 1) @ weighed
        in_units = postures.correlation.weighed_back(in_units)
        columns = _Columns.of(postures, width)
        shared = columns.scales(postures.sizes)[:, None] * columns.sums(in_units)
        more = _squared(in_units) + _squared(shared) - _squared(rows)
        values, vectors = np.linalg.eigh(more)
        along = steps @ vectors
        return np.asarray(along * np.maximum(values, 0.0) @ along.T)

    @staticmethod
    def of(whitening: Array, postures: HeldPostures, stated: bool) -> RecordNoise:
        """Of records that share an error; beside it they have the noise that the whitening states,
        or of which the size is found.
        """
        record = 1.0 if stated else postures.record
        return RecordNoise(whitening / record, replace(postures, record=record))

    @staticmethod
    def alone(whitening: Array) -> RecordNoise:
        """Of records that share nothing."""
        ones = np.ones(len(whitening))
        return RecordNoise(whitening, HeldPostures(np.arange(ones.size), ones, ones))

    @staticmethod
    def of_fit(fit: Fit) -> RecordNoise:
        """Of the noise of a fit, of which records share what is stated of their readings."""
        noise = RecordNoise.alone(fit.noise.whitening)
        counts = fit.used & fit.observations.has_target
        correlation = fit.noise.correlation(noise.whitening * counts[:, None, None])
        return replace(noise, postures=replace(noise.postures, correlation=correlation))


def _squared(rows: Array) -> Array:
    """Sum of ``Rᵀ R`` over rows (n, k, c): (c, c)."""
    stacked = rows.reshape(-1, rows.shape[-1])
    return stacked.T @ stacked
