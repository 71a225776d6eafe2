"""What could be known at best: by one who knows the noise, the library of causes and the plant, but neither arm nor fault.

Residuals ``r = Z η + G β + ε`` are whitened by ``Σ = σ² I + s² J Jᵀ``. Z holds the DH values with their calibration as
prior, the frame where it is unknown, and unknown seats tied by their bars. With M the projection off Z, the power to see a
fault that moves the records by g is that of ``λ = |M g|²``. G comes from finite differences of the plant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from blind import plans, workshop
from blind.kinematics import Array
from blind.machine import Machine
from blind.plant import ENCODER_NOISE, REFERENCE_NOISE, Draw
from blind.truth import Hidden

BAR_NOISE = 1e-6
STEP = 1e-2
"""Of finite differences, in typical sizes of the parameter."""
SPLIT = 14
"""Bumps round a turn that stand for any curve."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A cause with everything fixed that is not linear in it; one small fault for each of its columns."""

    key: str
    faults: tuple[Hidden, ...]


class Oracle:
    """Of one draw; records that are outliers are left out, as one who knows would."""

    def __init__(self, drawn: Draw) -> None:
        good = np.setdiff1d(np.arange(len(drawn.read)), drawn.outliers)
        self.q, self.conditions = drawn.read[good], drawn.conditions.take(good)
        arm = drawn.plant.machine.arm
        self.nominal = Machine(arm, arm.values)
        self.real = drawn.plant.machine
        self.plan, self.seats, self.external = drawn.plan, drawn.seats, bool(np.any(drawn.plant.frame[1]))
        j = self.nominal.jacobian(self.q)
        self.whiten = np.linalg.inv(
            np.linalg.cholesky(REFERENCE_NOISE**2 * np.eye(3) + ENCODER_NOISE**2 * j @ j.transpose(0, 2, 1))
        )
        self.plain = self.nominal.observed(self.q, self.conditions)
        nuisance = self._nuisance()
        self.extra = len(nuisance) - 3 * len(self.q)
        u, s, _ = np.linalg.svd(nuisance / np.linalg.norm(nuisance, axis=0), full_matrices=False)
        self.basis = u[:, s > 1e-10 * s[0]]
        self.residual = self.projected(drawn.reference[good] - self.plain)

    def projected(self, shift: Array) -> Array:
        """M times the whitened shifts of the records (n, 3) [m]."""
        column = np.concatenate([np.einsum("nij,nj->ni", self.whiten, shift).ravel(), np.zeros(self.extra)])
        return np.asarray(column - self.basis @ (self.basis.T @ column))

    def power(self, fault: Hidden) -> tuple[float, float]:
        """λ of a hidden fault, and the fraction |M g| / |g| that the nuisance leaves."""
        shift = self._shift(fault)
        whole = np.einsum("nij,nj->ni", self.whiten, shift)
        left = self.projected(shift)
        return float(left @ left), float(np.linalg.norm(left) / np.linalg.norm(whole))

    def probabilities(self, candidates: Iterator[Candidate] | None = None) -> dict[str, float]:
        """Of ``none`` and of each cause alone. Beforehand ``none`` is as likely as all causes together, all causes are alike
        and their sizes are normal with those of workshops.
        """
        log: dict[str, list[float]] = {}
        for candidate in candidates or library(self.nominal, self.plan, float(self.conditions.time[-1])):
            log.setdefault(candidate.key, []).append(self._log_evidence(candidate))
        of_cause = {key: float(np.logaddexp.reduce(values) - np.log(len(values))) for key, values in log.items()}
        of_cause["none"] = float(np.log(len(of_cause)))
        total = np.logaddexp.reduce(list(of_cause.values()))
        return {key: float(np.exp(value - total)) for key, value in sorted(of_cause.items(), key=lambda kv: -kv[1])}

    def aliases(self, fault: Hidden, least: float = 0.95) -> dict[str, float]:
        """Other causes that could say the same: cosine of their columns with what the fault leaves in the residuals."""
        left = self.projected(self._shift(fault))
        found: dict[str, float] = {}
        for candidate in library(self.nominal, self.plan, float(self.conditions.time[-1])):
            basis, _ = np.linalg.qr(self._columns(candidate))
            cosine = float(np.linalg.norm(basis.T @ left) / np.linalg.norm(left))
            if candidate.key != fault.key and cosine > max(least, found.get(candidate.key, 0.0)):
                found[candidate.key] = cosine
        return dict(sorted(found.items(), key=lambda kv: -kv[1]))

    def _shift(self, fault: Hidden) -> Array:
        """What a hidden fault moves the records by, exactly, beside all others."""
        others = [f for f in self.real.faults if f is not fault]
        with_it = self.real.with_faults([*others, fault]).observed(self.q, self.conditions)
        return with_it - self.real.with_faults(others).observed(self.q, self.conditions)

    def _columns(self, candidate: Candidate) -> Array:
        """M G, in typical sizes of the parameters."""
        moved = [self.nominal.with_faults([fault]).observed(self.q, self.conditions) for fault in candidate.faults]
        return np.stack([self.projected((m - self.plain) / STEP) for m in moved], axis=1)

    def _log_evidence(self, candidate: Candidate) -> float:
        g = self._columns(candidate)
        precision = np.eye(g.shape[1]) + g.T @ g
        b = g.T @ self.residual
        return float(0.5 * (b @ np.linalg.solve(precision, b) - np.linalg.slogdet(precision)[1]))

    def _nuisance(self) -> Array:
        """Z with the rows of its priors below the records."""
        n, arm = len(self.q), self.nominal.arm
        columns, priors = [], []
        for row, kind in np.argwhere(arm.half_width > 0.0):
            u = arm.half_width[row, kind] / np.sqrt(3.0)
            values = arm.values.copy()
            values[row, kind] += STEP * u
            columns.append((Machine(arm, values).observed(self.q, self.conditions) - self.plain) / STEP)
            priors.append(1.0)
        if self.external:
            columns += [np.broadcast_to(axis, (n, 3)) for axis in np.eye(3)]
            columns += [np.cross(axis, self.plain) for axis in np.eye(3)]
        unknown = plans.SEATS if self.plan == "unknown-seats" else 0
        columns += [np.where(self.conditions.seat[:, None] == s, axis, 0.0) for s in range(unknown) for axis in np.eye(3)]
        records = np.stack([np.einsum("nij,nj->ni", self.whiten, c).ravel() for c in columns], axis=1)
        prior = np.zeros((len(priors), len(columns)))
        np.fill_diagonal(prior, priors)
        return np.concatenate([records, prior, self._bars(len(columns), unknown)])

    def _bars(self, width: int, unknown: int) -> Array:
        """The known lengths: the seats of a bar do not move along it against each other."""
        if not unknown or self.seats is None:
            return np.zeros((0, width))
        rows = np.zeros((len(self.seats.bars), width))
        for row, (a, b) in zip(rows, self.seats.bars, strict=True):
            along = self.seats.points[a] - self.seats.points[b]
            along /= np.linalg.norm(along) * BAR_NOISE
            start = width - 3 * unknown
            row[start + 3 * a : start + 3 * a + 3], row[start + 3 * b : start + 3 * b + 3] = along, -along
        return rows


def library(machine: Machine, plan: str, last: float) -> Iterator[Candidate]:
    """Every cause at every place, with grids of what is not linear in it."""
    arm = machine.arm
    for cause in (
        *workshop.PER_JOINT,
        *workshop.PER_TUBE,
        *workshop.SHOULDER,
        "base_compliance",
        "thermal_expansion",
        "stylus_bending",
    ):
        rows = workshop.rows_for(cause, arm)
        for row in [*rows, *arm.tubes()] if cause == "thermal_expansion" else rows:
            key = cause if row is None else f"{cause}:{row}"
            for faults in _variants(cause, last):
                yield Candidate(key, tuple(Hidden(cause, row, p) for p in faults))
    if plan == "seats":
        for s in range(1, plans.SEATS + 1):
            unit = [dict(zip(("x_mm", "y_mm", "z_mm"), v, strict=True)) for v in 0.12 * STEP * np.eye(3)]
            yield Candidate(f"seat_error:P{s}", tuple(Hidden("seat_error", None, {"seat": f"P{s}", **p}) for p in unit))


def _variants(cause: str, last: float) -> Iterator[list[dict[str, Any]]]:
    if cause == "joint_error_curve":
        centres = np.arange(SPLIT) * 2.0 * np.pi / SPLIT
        yield [{"centres_rad": [c], "widths_rad": [0.3], "heights_rad": [STEP * 1e-4]} for c in centres]
        return
    ((name, (low, high)),) = workshop.SIZES[cause].items()
    unit = {name: STEP * 0.5 * (low + high)}
    if "amplitude_rad" in unit:
        orders = [{"order": k} for k in workshop.ORDERS] if cause == "joint_periodic_error" else [{}]
        for order in orders:
            yield [{**unit, **order, "phase_rad": phase} for phase in (0.0, 0.5 * np.pi)]
    elif cause == "encoder_slip":
        yield from ([{**unit, "time_s": t}] for t in np.linspace(0.2, 0.8, 25) * last)
    elif cause == "zero_drift":
        yield from ([{**unit, "time_constant_s": t}] for t in np.geomspace(600.0, 5400.0, 6))
    else:
        yield [unit]
