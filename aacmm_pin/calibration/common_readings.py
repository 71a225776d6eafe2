"""Targets that were measured at one reading of the encoders share its noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.measurements import Measurements, Observations

INDEPENDENT_PART = 1e-9
"""Least independent part of a record's variance, which gives the rest an inverse."""


def records_sharing_readings(
    measurements: Measurements, observations: Observations
) -> tuple[Index, ...]:
    """Records of one reading, each of another target, at one seat or none, for each number m of
    them (groups, m). A target measured again in a posture was read again.
    """
    marker = measurements.conditions.marker
    if marker is None:
        return ()
    columns = [f"reading {k}" for k in range(measurements.nq)]
    table = pd.DataFrame(measurements.readings, columns=columns)
    table = table.assign(seat=observations.seat, marker=marker)[observations.has_target]
    repeat = table.groupby([*columns, "seat", "marker"], sort=False).cumcount()
    table = table.assign(repeat=repeat)
    reading = table.groupby([*columns, "seat", "repeat"], sort=False).ngroup().to_numpy()
    order = np.argsort(reading, kind="stable")
    count = np.bincount(reading)
    first = np.cumsum(count) - count
    groups = []
    for size in np.unique(count[count > 1]).tolist():
        positions = first[count == size][:, None] + np.arange(size)
        groups.append(table.index.to_numpy()[order[positions]])
    return tuple(groups)


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation of whitened records that share a reading: ``R = L Lᵀ`` group by group. Rows of
    tips come first: turns are whitened given all tips.

    Attributes:
        records: (groups, m), for each number m of records in a group.
        factors: L of each (groups, m k, m k).
    """

    records: tuple[Index, ...] = ()
    factors: tuple[Array, ...] = ()

    @staticmethod
    def of(records: tuple[Index, ...], by_reading: Array) -> Correlation:
        """From whitened displacements by one u of each reading (n, k, nq); zero does not count."""
        n, width, nq = by_reading.shape
        flat = by_reading.reshape(n * width, nq)
        factors = []
        for group in records:
            columns = flat[_row_numbers(group, width)]
            covariance = (1.0 - INDEPENDENT_PART) * columns @ columns.transpose(0, 2, 1)
            record_of_row = np.tile(np.repeat(np.arange(group.shape[1]), 3), width // 3)
            covariance[:, record_of_row[:, None] == record_of_row] = 0.0
            factors.append(np.asarray(np.linalg.cholesky(covariance + np.eye(record_of_row.size))))
        return Correlation(records, tuple(factors))

    def take(self, chosen: Index) -> Correlation:
        """Of some records, whole groups of them."""
        if not self.records:
            return self
        new_numbers = np.full(max(int(group.max()) for group in self.records) + 1, -1)
        inside = chosen < new_numbers.size
        new_numbers[chosen[inside]] = np.flatnonzero(inside)
        records = []
        factors = []
        for group, factor in zip(self.records, self.factors, strict=True):
            is_whole = (new_numbers[group] >= 0).all(axis=1)
            records.append(new_numbers[group[is_whole]])
            factors.append(factor[is_whole])
        return Correlation(tuple(records), tuple(factors))

    def whitened(self, rows: Array) -> Array:
        """``L⁻¹`` times rows (n, k, …), in place."""
        return self._applied(self._inverses, rows)

    def whitened_back(self, rows: Array) -> Array:
        """``L`` times rows (n, k, …), in place."""
        return self._applied(self.factors, rows)

    def weighed(self, rows: Array) -> Array:
        """``L⁻ᵀ`` times rows (n, k, …), in place."""
        return self._applied(_transposed(self._inverses), rows)

    def weighed_back(self, rows: Array) -> Array:
        """``Lᵀ`` times rows (n, k, …), in place."""
        return self._applied(_transposed(self.factors), rows)

    @cached_property
    def _inverses(self) -> tuple[Array, ...]:
        return tuple(np.asarray(np.linalg.inv(factor)) for factor in self.factors)

    def _applied(self, matrices: tuple[Array, ...], rows: Array) -> Array:
        width = rows.shape[1]
        flat = rows.reshape(len(rows) * width, int(np.prod(rows.shape[2:])))
        for group, matrix in zip(self.records, matrices, strict=True):
            numbers = _row_numbers(group, width)
            # Tips come first: for rows of tips alone, the upper left part of a factor is theirs.
            size = numbers.shape[1]
            flat[numbers] = matrix[:, :size, :size] @ flat[numbers]
        return flat.reshape(rows.shape)


def _row_numbers(records: Index, width: int) -> Index:
    """Of records in groups (groups, m), tips before turns: (groups, m width)."""
    first = width * records[:, :, None]
    parts = [first + np.arange(3 * part, 3 * part + 3) for part in range(width // 3)]
    return np.concatenate([part.reshape(len(records), -1) for part in parts], axis=1)


def _transposed(matrices: tuple[Array, ...]) -> tuple[Array, ...]:
    return tuple(matrix.transpose(0, 2, 1) for matrix in matrices)
