"""Whether a named cause is the same as a hidden one in a file, and how much of the hidden one its
records show.

Residuals ``r = Z η + G β + ε`` are whitened by ``Σ = u² I + s² J Jᵀ``. Z holds what is fitted
anyway: geometry (with its bounds as prior where they are stated), the frame and the targets where
they are unknown, and seats that are not exactly known, tied by their bars. With M the projection
off Z, a fault that moves the records by g is seen by ``λ = |M g|²``, and another cause says the
same where the cosine of M g with its columns M G is near one. G comes from finite differences of
the plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import chi2, ncx2

from blind import workshop
from blind.kinematics import Array
from blind.machine import GEOMETRY
from blind.regimes import RegimeFile
from blind.truth import Hidden

TOLD_APART = 13.0
"""λ that a rival leaves from which two causes are told apart: in 90 % of such files their
likelihood ratio is above 19.
"""
SLIPS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Parts of the records before which a rival slips."""
DRIFTS = (600.0, 1800.0, 5400.0)
"""Time constants of a rival [s]."""
STEP = 1e-2
"""Of finite differences, in typical sizes of the parameter."""
SPLIT = 14
"""Bumps round a turn that stand for any curve."""
ALPHA = 1e-4
"""A chance of 0.01 that anything of about a hundred causes is seen where nothing is."""
ALIKE = 0.95
"""Cosine of the effects of two causes above which nobody could tell them apart."""


class Oracle:
    """Of one file; records that are outliers are left out, as one who knows would."""

    def __init__(self, file: RegimeFile) -> None:
        good = np.setdiff1d(np.arange(len(file.read)), file.outliers)
        self.file, self.good, self.real = file, good, file.machine
        self.q, self.conditions = file.read[good], file.conditions.take(good)
        self.nominal = replace(file.machine, values=file.machine.arm.exact, faults=(), small=None)
        j = self.nominal.jacobian(self.q)
        noise = (file.reference_u[good] ** 2)[:, None, None] * np.eye(
            3
        ) + file.encoder_u**2 * j @ j.transpose(0, 2, 1)
        self.whiten = np.linalg.inv(np.linalg.cholesky(noise))
        self.plain = self.nominal.observed(self.q, self.conditions)
        nuisance = self._nuisance()
        self.extra = len(nuisance) - 3 * len(self.q)
        scaled = nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-30)
        u, s, _ = np.linalg.svd(scaled, full_matrices=False)
        self.basis = u[:, s > 1e-10 * s[0]]

    def projected(self, shift: Array) -> Array:
        """M times the whitened shifts of the records (n, 3) [m]."""
        column = np.concatenate(
            [np.einsum("nij,nj->ni", self.whiten, shift).ravel(), np.zeros(self.extra)]
        )
        return np.asarray(column - self.basis @ (self.basis.T @ column))

    def visible(self, fault: Hidden, refitted: Sequence[Hidden] = ()) -> float:
        """λ of a hidden fault, beside all others, whose values are known unless they are
        ``refitted``.
        """
        left = self._left(fault, refitted)
        return float(left @ left)

    def rivals(self, fault: Hidden, refitted: Sequence[Hidden] = ()) -> dict[str, float]:
        """Other causes of the library that these records do not tell from a hidden one, and λ that
        each leaves of it.

        A free curve is none: it can do what any encoder does, at the price of its many parameters.
        """
        left = self._left(fault, refitted)
        beside = self._others(refitted)
        found: dict[str, float] = {}
        for rival in self._library:
            if rival.key == fault.key:
                continue
            basis = self._basis([*beside, *self._columns_of(_as_named(rival))])
            rest = float(left @ left - np.square(basis.T @ left).sum())
            found[rival.key] = min(rest, found.get(rival.key, np.inf))
        return {key: rest for key, rest in found.items() if rest < TOLD_APART}

    @cached_property
    def _library(self) -> list[Hidden]:
        """Every cause of the plant's library at every place, with each value of what is not
        linear.
        """
        causes = [cause for cause in workshop.SIZES if cause not in GEOMETRY]
        places = [
            (cause, row) for cause in causes for row in workshop.rows_for(cause, self.real.arm)
        ]
        return [Hidden(cause, row, inner) for cause, row in places for inner in self._inner(cause)]

    def _inner(self, cause: str) -> list[dict[str, float]]:
        """Values of what is not linear in a cause."""
        if cause == "joint_periodic_error":
            return [{"order": order} for order in workshop.ORDERS]
        if cause == "encoder_slip":
            return [{"time_s": float(time)} for time in np.quantile(self.conditions.time, SLIPS)]
        if cause == "zero_drift":
            return [{"time_constant_s": time} for time in DRIFTS]
        return [{}]

    def _left(self, fault: Hidden, refitted: Sequence[Hidden]) -> Array:
        """Of what a fault does, the part that neither the nuisance nor the refitted faults
        can do.
        """
        left = self.projected(self.real.shift_by(fault, self.q, self.conditions))
        columns = self._others(refitted)
        if not columns:
            return left
        basis = self._basis(columns)
        return np.asarray(left - basis @ (basis.T @ left))

    def _others(self, refitted: Sequence[Hidden]) -> list[Array]:
        """Columns of faults that are refitted."""
        return [column for other in refitted for column in self._columns_of(_as_named(other))]

    def power(self, fault: Hidden, refitted: Sequence[Hidden] = ()) -> float:
        """Chance that one who knows everything else sees the fault at :data:`ALPHA`."""
        parameters = max(1, len(self._columns_of(_as_named(fault))))
        return float(
            ncx2.sf(chi2.isf(ALPHA, parameters), parameters, self.visible(fault, refitted))
        )

    def cosine(self, fault: Hidden, finding: Mapping[str, Any]) -> float:
        """Of what a hidden fault leaves with the columns of a named cause; 0 where the plant has no
        such cause.
        """
        left = self.projected(self.real.shift_by(fault, self.q, self.conditions))
        columns = self._columns_of(finding)
        if not columns:
            return 0.0
        basis = self._basis(columns)
        return float(np.linalg.norm(basis.T @ left) / max(float(np.linalg.norm(left)), 1e-30))

    def _basis(self, columns: Sequence[Array]) -> Array:
        """Orthonormal, of what is left of the columns."""
        u, s, _ = np.linalg.svd(
            np.stack([self.projected(c) for c in columns], axis=1), full_matrices=False
        )
        return np.asarray(u[:, s > 1e-8 * max(s[0], 1e-30)])

    def _effects(self, faults: list[Hidden]) -> list[Array]:
        """What each moves the records by, in typical sizes of its parameter."""
        moved = [
            self.nominal.with_faults([fault]).observed(self.q, self.conditions) for fault in faults
        ]
        return [(m - self.plain) / STEP for m in moved]

    def _columns_of(self, finding: Mapping[str, Any]) -> list[Array]:
        """What a named cause moves the records by, a column for each of its parameters."""
        cause = str(finding["cause"])
        row = next(
            (int(finding[name]) for name in ("joint", "link") if finding.get(name) is not None),
            None,
        )
        if cause == "stylus_offset":
            return self._along_last_frame()
        if cause == "reference_frame":
            return self._frame()
        if cause == "seat_error":
            return self._seat(int(str(finding.get("seat", "P0"))[1:]) - 1)
        if cause in GEOMETRY and row is not None:
            return (
                [self._deviated(row - 1, GEOMETRY[cause][1])]
                if self.real.arm.typical.shape[1] == 4
                else []
            )
        if cause == "joint_placement" and row is not None:
            return [self._deviated(row - 1, k) for k in range(6)]
        if cause != "joint_error_curve" and cause not in workshop.SIZES:
            return []
        return self._effects(_small_faults(cause, row, finding))

    def _along_last_frame(self) -> list[Array]:
        return list(np.moveaxis(self.nominal.rest(self.q, self.conditions).last[:, :3, :3], 2, 0))

    def _frame(self) -> list[Array]:
        shifts = [np.broadcast_to(axis, (len(self.q), 3)) for axis in np.eye(3)]
        return [*shifts, *(np.cross(axis, self.plain) for axis in np.eye(3))]

    def _seat(self, number: int) -> list[Array]:
        return [np.where(self.conditions.seat[:, None] == number, axis, 0.0) for axis in np.eye(3)]

    def _deviated(self, row: int, kind: int) -> Array:
        values, step = self.real.arm.exact.copy(), STEP * self.real.arm.typical[row, kind]
        values[row, kind] += step
        return (
            replace(self.nominal, values=values).observed(self.q, self.conditions) - self.plain
        ) / step

    def _nuisance(self) -> Array:
        """Z with the rows of its priors below the records."""
        file, arm = self.file, self.real.arm
        stated = arm.half_width.any()
        places = np.argwhere((arm.half_width if stated else arm.typical) > 0.0)
        columns = [self._deviated(row, kind) for row, kind in places]
        priors = [
            np.sqrt(3.0) / arm.half_width[row, kind] if stated else 0.0 for row, kind in places
        ]
        columns += self._frame() if file.external else []
        for marker in range(file.targets):
            of_marker = (self.conditions.marker == marker)[:, None]
            columns += [np.where(of_marker, column, 0.0) for column in self._along_last_frame()]
        first = len(columns)
        for seat in range(len(file.fitted_seats)):
            columns += self._seat(seat)
        priors += [0.0] * (first - len(priors)) + [1.0 / file.seat_u] * (len(columns) - first)
        if file.posture_u:
            postures = np.unique(self.conditions.posture)
            held = self.conditions.posture[:, None] == postures
            columns += [np.where(of[:, None], axis, 0.0) for of in held.T for axis in np.eye(3)]
            priors += [1.0 / file.posture_u] * (3 * len(postures))
        records = np.stack(
            [np.einsum("nij,nj->ni", self.whiten, c).ravel() for c in columns], axis=1
        )
        bars = np.zeros((len(file.bars), len(columns)))
        for row, (a, b) in zip(bars, file.bars, strict=True):
            along = file.fitted_seats[a] - file.fitted_seats[b]
            along = along / (np.linalg.norm(along) * file.bar_u)
            row[first + 3 * a : first + 3 * a + 3], row[first + 3 * b : first + 3 * b + 3] = (
                along,
                -along,
            )
        return np.concatenate([records, np.diag(priors), bars])


def _as_named(fault: Hidden) -> dict[str, Any]:
    """A hidden fault as a diagnosis names it."""
    return {**fault.parameters, "cause": fault.cause, "joint": fault.joint}


def _small_faults(cause: str, row: int | None, inner: Mapping[str, Any]) -> list[Hidden]:
    """One small fault for each linear parameter of a cause, at the given values of what is not
    linear in it.
    """
    if cause == "joint_error_curve":
        centres = np.arange(SPLIT) * 2.0 * np.pi / SPLIT
        return [
            Hidden(
                cause, row, {"centres_rad": [c], "widths_rad": [0.3], "heights_rad": [STEP * 1e-4]}
            )
            for c in centres
        ]
    ((name, (low, high)),) = workshop.SIZES[cause].items()
    unit: dict[str, Any] = {name: STEP * 0.5 * (low + high)}
    if cause in INNER:
        of_inner, usual = INNER[cause]
        unit[of_inner] = usual if inner.get(of_inner) is None else inner[of_inner]
    phases = (
        [{"phase_rad": phase} for phase in (0.0, 0.5 * np.pi)] if name == "amplitude_rad" else [{}]
    )
    return [Hidden(cause, row, unit | phase) for phase in phases]


INNER: dict[str, tuple[str, float]] = {
    "joint_periodic_error": ("order", 3),
    "encoder_slip": ("time_s", 0.0),
    "zero_drift": ("time_constant_s", 1800.0),
}
"""Parameter that is not linear, and the value where none is stated."""
