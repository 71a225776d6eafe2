"""Which causes nobody could tell apart in a file of :mod:`blind.regimes`: the oracle's cosine, for any chain.

As in :mod:`blind.oracle`: the effects of two causes on the tip, by finite differences of the plant, whitened by the true
noise, after everything is projected out that is refitted anyway: geometry (with its bounds where stated), frame, seats and
targets. A cosine is with all columns of the other cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from blind import workshop
from blind.kinematics import Array
from blind.oracle import SPLIT, STEP
from blind.regimes import BAR_U, RegimeFile
from blind.truth import Hidden

LEAST = 0.95


class Likeness:
    """Of one file; gross errors are left out."""

    def __init__(self, file: RegimeFile) -> None:
        good = np.setdiff1d(np.arange(len(file.q)), file.outliers)
        self.file, self.q, self.conditions = file, file.q[good], file.conditions.take(good)
        self.real = file.rig
        self.nominal = replace(file.rig, values=file.rig.arm.exact, faults=(), small=None)
        j = self.nominal.jacobian(self.q)
        u = file.reference_u[good]
        noise = (u**2)[:, None, None] * np.eye(3) + file.regime.encoder_u**2 * j @ j.transpose(0, 2, 1)
        self.whiten = np.linalg.inv(np.linalg.cholesky(noise))
        self.plain = self.nominal.observed(self.q, self.conditions)
        nuisance = self._nuisance()
        self.extra = len(nuisance) - 3 * len(self.q)
        scaled = nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-30)
        left, s, _ = np.linalg.svd(scaled, full_matrices=False)
        self.basis = left[:, s > 1e-10 * s[0]]

    def visible(self, fault: Hidden) -> float:
        """λ: what the refit leaves of a hidden fault, squared, in standard uncertainties."""
        left = self._projected(self._shift(fault))
        return float(left @ left)

    def cosine(self, fault: Hidden, finding: Mapping[str, Any]) -> float:
        """Of what a hidden fault leaves with the columns of a named cause; 0 where the plant has no such cause."""
        left, columns = self._projected(self._shift(fault)), self._columns(finding)
        if not columns:
            return 0.0
        g = np.stack([self._projected(c) for c in columns], axis=1)
        u, s, _ = np.linalg.svd(g, full_matrices=False)
        basis = u[:, s > 1e-8 * max(s[0], 1e-30)]
        return float(np.linalg.norm(basis.T @ left) / max(float(np.linalg.norm(left)), 1e-30))

    def _projected(self, shift: Array) -> Array:
        column = np.concatenate([np.einsum("nij,nj->ni", self.whiten, shift).ravel(), np.zeros(self.extra)])
        return np.asarray(column - self.basis @ (self.basis.T @ column))

    def _shift(self, fault: Hidden) -> Array:
        others = [f for f in self.real.faults if f is not fault]
        with_it = self.real.with_faults([*others, fault]).observed(self.q, self.conditions)
        return with_it - self.real.with_faults(others).observed(self.q, self.conditions)

    def _columns(self, finding: Mapping[str, Any]) -> list[Array]:
        """What a named cause moves the records by, a column for each of its parameters."""
        cause = str(finding["cause"])
        row = next((finding[name] for name in ("joint", "link") if finding.get(name) is not None), None)
        if cause == "stylus_offset":
            return [self.nominal.rest(self.q, self.conditions).frames[:, -1, :3, k] for k in range(3)]
        if cause == "reference_frame":
            return self._frame()
        if cause == "seat_error":
            number = int(str(finding.get("seat", "P0"))[1:]) - 1
            return [np.where(self.conditions.seat[:, None] == number, axis, 0.0) for axis in np.eye(3)]
        kinds = {"link_length": 0, "joint_distance": 1, "link_twist": 2, "joint_zero_offset": 3}
        if cause in kinds and row is not None:
            return [self._deviated(int(row) - 1, kinds[cause])] if self.real.arm.typical.shape[1] == 4 else []
        if cause == "joint_placement" and row is not None:
            return [self._deviated(int(row) - 1, k) for k in range(6)]
        if cause not in workshop.CAUSES or not (cause == "joint_error_curve" or cause in workshop.SIZES):
            return []
        faults = [Hidden(cause, None if row is None else int(row), p) for p in _unit_faults(cause, finding)]
        return [(self.nominal.with_faults([f]).observed(self.q, self.conditions) - self.plain) / STEP for f in faults]

    def _frame(self) -> list[Array]:
        n = len(self.q)
        shifts = [np.broadcast_to(axis, (n, 3)) for axis in np.eye(3)]
        return [*shifts, *(np.cross(axis, self.plain) for axis in np.eye(3))]

    def _deviated(self, row: int, kind: int) -> Array:
        values, step = self.real.arm.exact, STEP * self.real.arm.typical[row, kind]
        values[row, kind] = step
        moved = replace(self.nominal, values=values).observed(self.q, self.conditions)
        return (moved - self.plain) / step

    def _nuisance(self) -> Array:
        """Columns of all that is refitted, with the rows of their priors below the records."""
        regime, arm = self.file.regime, self.real.arm
        columns, priors = [], []
        stated = arm.half_width.any()
        for row, kind in np.argwhere((arm.half_width if stated else arm.typical) > 0.0):
            columns.append(self._deviated(row, kind))
            priors.append(np.sqrt(3.0) / arm.half_width[row, kind] if stated else 0.0)
        if regime.external:
            columns += self._frame()
        if self.real.targets is not None:
            last = self.nominal.rest(self.q, self.conditions).frames[:, -1]
            for m in range(len(self.real.targets)):
                columns += [np.where(self.conditions.marker[:, None] == m, last[:, :3, k], 0.0) for k in range(3)]
        priors += [0.0] * (len(columns) - len(priors))
        first = len(columns)
        for s in range(len(self.file.seats)):
            columns += [np.where(self.conditions.seat[:, None] == s, axis, 0.0) for axis in np.eye(3)]
            priors += [1.0 / regime.reference_u if regime.evidence == "seats" else 0.0] * 3
        records = np.stack([np.einsum("nij,nj->ni", self.whiten, c).ravel() for c in columns], axis=1)
        bars = np.zeros((0, len(columns)))
        if regime.evidence == "bars":
            bars = np.zeros((len(self.file.seats) // 2, len(columns)))
            for number, row in enumerate(bars):
                along = self.file.seats[2 * number] - self.file.seats[2 * number + 1]
                along = along / (np.linalg.norm(along) * BAR_U)
                row[first + 6 * number : first + 6 * number + 6] = [*along, *-along]
        return np.concatenate([records, np.diag(priors), bars])


def _unit_faults(cause: str, finding: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One small fault for each linear parameter, at the inner parameters that the finding states."""
    if cause == "joint_error_curve":
        centres = np.arange(SPLIT) * 2.0 * np.pi / SPLIT
        return [{"centres_rad": [c], "widths_rad": [0.3], "heights_rad": [STEP * 1e-4]} for c in centres]
    ((name, (low, high)),) = workshop.SIZES[cause].items()
    unit: dict[str, Any] = {name: STEP * 0.5 * (low + high)}
    inner = {k: finding[k] for k in ("order", "time_s", "time_constant_s") if finding.get(k) is not None}
    defaults = {
        "joint_periodic_error": {"order": 3},
        "encoder_slip": {"time_s": 0.0},
        "zero_drift": {"time_constant_s": 1800.0},
    }
    unit |= {k: inner.get(k, v) for k, v in defaults.get(cause, {}).items()}
    if "amplitude_rad" in unit:
        return [unit | {"phase_rad": phase} for phase in (0.0, 0.5 * np.pi)]
    return [unit]
