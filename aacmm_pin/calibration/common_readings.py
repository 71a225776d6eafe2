"""Targets that were measured at one reading of the encoders share its noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array, Index
from aacmm_pin.measurements import Measurements, Observations

INDEPENDENT_PART = 1e-9
"""Least independent part of a record's variance, which gives the rest an inverse."""


def records_sharing_readings(measurements: Measurements, observations: Observations) -> Index:
    """Records of one reading, each of another target, at one seat or none (groups, m); -1 where a
    group has fewer than m. A target measured again in a posture was read again.
    """
    marker = measurements.conditions.marker
    if marker is None:
        return np.empty((0, 0), dtype=np.intp)
    columns = [f"reading {k}" for k in range(measurements.nq)]
    table = pd.DataFrame(measurements.readings, columns=columns)
    table = table.assign(seat=observations.seat, marker=marker)[observations.has_target]
    repeat = table.groupby([*columns, "seat", "marker"], sort=False).cumcount()
    readings = table.assign(repeat=repeat).groupby([*columns, "seat", "repeat"], sort=False)
    reading, place = readings.ngroup().to_numpy(), readings.cumcount().to_numpy()
    groups = np.full((reading.max(initial=-1) + 1, place.max(initial=0) + 1), -1)
    groups[reading, place] = table.index
    return groups[(groups[:, 1:] >= 0).any(axis=1)]


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation of whitened records that share a reading: ``R = L Lᵀ`` group by group. Rows of
    tips come first: turns are whitened given all tips.

    Attributes:
        records: see :func:`records_sharing_readings` (groups, m).
        factors: L of each (groups, m k, m k).
    """

    records: Index = field(default_factory=lambda: np.empty((0, 0), dtype=np.intp))
    factors: Array = field(default_factory=lambda: np.empty((0, 0, 0)))

    @staticmethod
    def of(records: Index, by_reading: Array) -> Correlation:
        """From whitened displacements by one u of each reading (n, k, nq); zero does not count."""
        n, width, nq = by_reading.shape
        displacements = _rows_of(by_reading.reshape(n * width, nq), _row_numbers(records, width))
        covariance = (1.0 - INDEPENDENT_PART) * displacements @ displacements.transpose(0, 2, 1)
        record_of_row = np.tile(np.repeat(np.arange(records.shape[1]), 3), width // 3)
        covariance[:, record_of_row[:, None] == record_of_row] = 0.0
        factors = np.asarray(np.linalg.cholesky(covariance + np.eye(record_of_row.size)))
        return Correlation(records, factors)

    def take(self, chosen: Index) -> Correlation:
        """Of some records, whole groups of them."""
        if not self.records.size:
            return self
        new_numbers = np.full(max(self.records.max(), chosen.max(initial=0)) + 1, -1)
        new_numbers[chosen] = np.arange(chosen.size)
        records = np.where(self.records >= 0, new_numbers[self.records], -1)
        is_chosen = records[:, 0] >= 0
        return Correlation(records[is_chosen], self.factors[is_chosen])

    def whitened(self, rows: Array) -> Array:
        """``L⁻¹`` times rows (n, k, …), in place."""
        return self._applied(self._inverses, rows)

    def whitened_back(self, rows: Array) -> Array:
        """``L`` times rows (n, k, …), in place."""
        return self._applied(self.factors, rows)

    def weighed(self, rows: Array) -> Array:
        """``L⁻ᵀ`` times rows (n, k, …), in place."""
        return self._applied(self._inverses.transpose(0, 2, 1), rows)

    def weighed_back(self, rows: Array) -> Array:
        """``Lᵀ`` times rows (n, k, …), in place."""
        return self._applied(self.factors.transpose(0, 2, 1), rows)

    @cached_property
    def _inverses(self) -> Array:
        return np.asarray(np.linalg.inv(self.factors))

    def _applied(self, matrices: Array, rows: Array) -> Array:
        if not self.records.size:
            return rows
        width = rows.shape[1]
        flat = rows.reshape(len(rows) * width, int(np.prod(rows.shape[2:])))
        numbers = _row_numbers(self.records, width)
        inside = numbers >= 0
        # Tips come first: for rows of tips alone, the upper left part of a factor is theirs.
        size = numbers.shape[1]
        flat[numbers[inside]] = (matrices[:, :size, :size] @ _rows_of(flat, numbers))[inside]
        return flat.reshape(rows.shape)


def _row_numbers(records: Index, width: int) -> Index:
    """Of records in groups (groups, m), tips before turns: (groups, m width); negative for none."""
    first = width * records[:, :, None]
    parts = [first + np.arange(3 * part, 3 * part + 3) for part in range(width // 3)]
    return np.concatenate(parts, axis=1).reshape(len(records), width * records.shape[1])


def _rows_of(flat: Array, numbers: Index) -> Array:
    """Rows (groups, m, c) of ``flat`` (n, c); zero for negative numbers."""
    return np.where(numbers[:, :, None] >= 0, flat[numbers], 0.0)
