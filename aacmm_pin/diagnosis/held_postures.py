"""Held postures: records of one posture at one target share an error, which is a variance component
of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin.calibration import Fit
from aacmm_pin.measurements import posture_numbers

RATIOS = (1e-3, 1e3)
"""Standard deviation of the error of a posture over that of a record, at least and at most."""
NEAR = 0.02
"""Postures whose readings differ by no more than this in any joint may share an error: a hand holds
an arm no better [rad; m where a joint slides]. Where nothing is shared, this costs nothing.
"""
LEFT_OUT = 1e-10
"""Parts of a whitening that are smaller than this, beside the largest, are rounding."""
SAME_LOG_VARIANCE = 0.1
"""Log variances of the means that differ by less are about the same."""


@dataclass(frozen=True, eq=False)
class HeldPostures:
    """Groups of records of one posture and one seat, and the error that each group shares.

    Attributes:
        group: number of the group of each record, -1 of those that do not count (n,).
        count: records of each group (groups,).
        numbers: how many numbers a record of each group states (groups,).
        ratio: standard deviation of the shared error over that of a record, both in units of the
            records' noise.
        log_ratio: log likelihood with the shared error over that without.
    """

    group: Index
    count: Array
    numbers: Array
    ratio: float = 0.0
    log_ratio: float = 0.0

    @property
    def p_value(self) -> float:
        """Chance of such a likelihood ratio if records of one posture share nothing (Self, Liang
        1987, JASA 82).
        """
        if not self.ratio:
            return 1.0
        return 0.5 * float(chi2_sf(2.0 * self.log_ratio, 1))

    @staticmethod
    def groups_of(fit: Fit) -> HeldPostures:
        """The groups of the records that count, which share nothing."""
        counts = fit.used & fit.observations.has_target
        group = np.full(len(counts), -1, dtype=np.intp)
        postures = posture_numbers(fit.problem.measurements.q, NEAR)
        pairs = np.stack([postures, fit.observations.seat], axis=1)[counts]
        _, first, number = np.unique(pairs, axis=0, return_index=True, return_inverse=True)
        group[counts] = number.ravel()
        numbers = fit.observations.counts[counts][first]
        count = np.bincount(group[counts])
        return HeldPostures(group, count.astype(np.float64), numbers.astype(np.float64))

    @property
    def repeat(self) -> bool:
        """Whether any posture has several records."""
        return bool(self.count.sum() > self.count.size)

    def with_error(self, ratio: float) -> HeldPostures:
        """The same groups with a shared error of this ratio."""
        return replace(self, ratio=ratio, log_ratio=0.0)

    def likeliest(self, residual: Array, dof: float) -> HeldPostures:
        """The same groups, which share nothing here, with the likeliest shared error.

        The ratio is the restricted maximum likelihood estimate (Patterson, Thompson 1971,
        Biometrika 58) with all fitted parameters shared between the means of the groups.

        Args:
            residual: whitened record by record (n, k).
            dof: degrees of freedom that are left.
        """
        means = self._means(residual)
        inside = self.group >= 0
        within = float(np.square(residual[inside] - means[self.group[inside]]).sum())
        squares = self.count * np.square(means).sum(axis=1)
        whole = max(dof, self._dof_within + 1.0)

        def deviance(log_ratio: float) -> float:
            there = self.with_error(float(np.exp(log_ratio)))
            chi2 = within + float((squares / there.scale).sum())
            of_residuals = whole * float(np.log(max(chi2, 1e-300)))
            return of_residuals - 2.0 * there.log_density(dof)

        best = scipy.optimize.minimize_scalar(deviance, bounds=np.log(RATIOS), method="bounded")
        log_ratio = 0.5 * (deviance(-np.inf) - float(best.fun))
        if log_ratio <= 0.0:
            return self
        return replace(self, ratio=float(np.exp(best.x)), log_ratio=log_ratio)

    @property
    def scale(self) -> Array:
        """Variance of the mean of each group over that of independent records (groups,)."""
        return 1.0 + self.count * self.ratio**2

    @property
    def _dof_within(self) -> float:
        """Degrees of freedom of the differences inside groups."""
        return float(self.numbers @ (self.count - 1.0))

    def log_density(self, dof: float) -> float:
        """What the shared error adds to the log likelihood beside χ², with ``dof`` degrees of
        freedom left.
        """
        of_means = max(dof - self._dof_within, 1.0)
        log_scale = np.average(np.log(self.scale), weights=self.numbers)
        return -0.5 * of_means * float(log_scale)

    def is_about(self, other: HeldPostures) -> bool:
        """Whether the error of the same postures is about another one, or small beside that of a
        record in both.
        """
        change = np.log(self.scale / other.scale).mean()
        return bool(abs(change) < SAME_LOG_VARIANCE)

    def sums(self, rows: Array) -> Array:
        """Sum of the rows (n, …) of each group (groups, …)."""
        found = np.zeros((len(self.count), *rows.shape[1:]))
        inside = self.group >= 0
        np.add.at(found, self.group[inside], rows[inside])
        return found

    def _means(self, rows: Array) -> Array:
        return (self.sums(rows).T / self.count).T

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

    def whitened(self, rows: Array, records: Index | slice = slice(None)) -> Array:
        """Rows (n, …) of some records, whitened record by record, with the shared error whitened
        too; of a group all of these or none.

        The mean of a group of m has ``1 + m ratio²`` times the variance of independent records; the
        rest is as it was.
        """
        if not self.ratio:
            return rows
        number = self.group[records]
        inside = number >= 0
        groups, local = np.unique(number[inside], return_inverse=True)
        means = np.zeros((groups.size, *rows.shape[1:]))
        np.add.at(means, local, rows[inside])
        share = (1.0 - 1.0 / np.sqrt(self.scale[groups])) / self.count[groups]
        taken = (share * means.T).T[local]
        found = rows.copy()
        found[inside] -= taken
        return found


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
        if not self.postures.ratio:
            return np.zeros((fit.problem.scales.size,) * 2)
        has_target = fit.observations.has_target
        width = self.whitening.shape[1]
        steps = fit.system.steps(fit.unknown)
        rows = np.zeros((len(has_target), width, steps.shape[1]))
        of_records = fit.system.jacobian[: width * has_target.sum()]
        rows[has_target] = (of_records @ steps).reshape(-1, width, steps.shape[1])
        root = fit.noise.whitening @ self._unwhitening
        in_units = np.sqrt(variance) * root.transpose(0, 2, 1) @ rows
        shared = self.postures.ratio * self.postures.sums(in_units)
        more = _squared(in_units) + _squared(shared) - _squared(rows)
        values, vectors = np.linalg.eigh(more)
        along = steps @ vectors
        return np.asarray(along * np.maximum(values, 0.0) @ along.T)

    @staticmethod
    def alone(whitening: Array) -> RecordNoise:
        """Of records that share nothing."""
        ones = np.ones(len(whitening))
        return RecordNoise(whitening, HeldPostures(np.arange(ones.size), ones, ones))


def _squared(rows: Array) -> Array:
    """Sum of ``Rᵀ R`` over rows (n, k, c): (c, c)."""
    stacked = rows.reshape(-1, rows.shape[-1])
    return stacked.T @ stacked
