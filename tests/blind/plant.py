"""Measurement files with a hidden fault: ``draw(seed, cause=...)`` makes the file and keeps the
truth for afterwards.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blind import chains, plans, table, workshop
from blind.chains import Chain
from blind.conditions import SESSIONS, Conditions, run
from blind.kinematics import Array, rotation
from blind.machine import Machine
from blind.outside import SmallTerms
from blind.truth import Hidden

ENCODER_NOISE = 8e-6
REFERENCE_NOISE = 12e-6
OUTLIER_M = (0.2e-3, 50e-3)


@dataclass(frozen=True, eq=False)
class Sample:
    """Records of one run.

    Attributes:
        read: indications as noted (n, nq) [rad].
        reference: coordinates as noted (n, 3) [m]; NaN where unknown.
        touched: what they would be for a known reference without noise at the indications as noted
            (n, 3) [m].
        conditions: of each record.
        outliers: records (from 0) that are outliers.
        plan: name of the plan.
        seats: the seats, None in free space.
    """

    read: Array
    reference: Array
    touched: Array
    noted: Array
    conditions: Conditions
    outliers: tuple[int, ...]
    plan: str
    seats: plans.Seats | None

    @property
    def csv_text(self) -> str:
        """The measurement file."""
        c, n, unknown = self.conditions, len(self.read), self.plan == "unknown-seats"
        columns: dict[str, Sequence[str]] = {
            "record": [str(i) for i in range(n)],
            "session": [f"S{i + 1}" for i in c.session],
            "operator": ["AB"[i] for i in c.operator],
            "time_s": table.fixed(c.time, 1),
            **table.angles(self.read),
            **({} if unknown else table.coordinates(self.noted)),
        }
        if self.seats is not None:
            columns["seat"] = [f"P{i + 1}" for i in c.seat]
        if self.seats is not None and unknown:
            columns |= table.bars(c.seat, self.seats.bars, self.seats.lengths())
        columns["temperature_c"] = table.fixed(c.temperature_reading, 2)
        columns |= table.approaches(c, np.ones(c.approach.shape[1], dtype=bool))
        return table.csv(columns | {"humidity_pct": table.fixed(c.humidity, 1)})

    def write(self, path: Path | str) -> Path:
        path = Path(path)
        path.write_text(self.csv_text, encoding="utf-8")
        return path

    @property
    def oracle_rms(self) -> float:
        """Noise floor [m]: rms distance of the references from what one says who knows the plant,
        without the outliers.
        """
        good = np.setdiff1d(np.arange(len(self.read)), self.outliers)
        return float(np.sqrt(((self.reference - self.touched)[good] ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class Plant:
    """A machine in its room; what a run of it needs beside a number of records."""

    seed: int
    machine: Machine
    plan: str
    records: int
    seats: plans.Seats | None
    frame: tuple[Array, Array]
    small_terms: bool

    def rng(self, stream: str, index: int = 0) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(stream.encode()), index])

    def route(self, index: int, n: int) -> tuple[Array, Conditions]:
        """Postures and conditions of run number ``index``; its clock lasts as long as that of the
        first run.
        """
        rng, arm = self.rng("route", index), self.machine.arm
        if self.seats is None:
            seat, session, q = (
                np.full(n, -1),
                np.arange(n) * SESSIONS // n,
                plans.free_postures(rng, arm, n),
            )
        else:
            seat, session = plans.visits(n)
            q = plans.seat_postures(rng, arm, self.seats, seat)
        return q, run(rng, arm, seat, session, self.records / n, self.small_terms)

    def sample(self, index: int, n: int, outliers: float = 0.0) -> Sample:
        """Run number ``index`` with n records."""
        q, conditions = self.route(index, n)
        noise = self.rng("noise", index)
        encoder = ENCODER_NOISE * noise.standard_normal(q.shape)
        reference_noise = REFERENCE_NOISE * noise.standard_normal((n, 3))
        jumps = Jumps.of(self.rng("outliers", index), self.machine, q, round(outliers * n))
        if self.seats is None:
            reference = self.machine.observed(q, conditions) + reference_noise + jumps.contact
        else:
            reference = self.seats.points[conditions.seat]
            q = self.machine.touching(q, conditions, reference + reference_noise + jumps.contact)
        read = q + encoder + jumps.angle
        turn, shift = self.frame
        return Sample(
            read=read,
            reference=reference,
            touched=self.machine.observed(read, conditions),
            noted=reference @ turn.T + shift,
            conditions=conditions,
            outliers=tuple(jumps.records.tolist()),
            plan=self.plan,
            seats=self.seats,
        )


@dataclass(frozen=True, eq=False)
class Jumps:
    """Outliers: a contact that slipped or a reference that is wrong (n, 3) [m], or one wrong angle
    (n, nq) [rad].
    """

    records: NDArray[np.int_]
    contact: Array
    angle: Array

    @staticmethod
    def of(rng: np.random.Generator, machine: Machine, q: Array, count: int) -> Jumps:
        records = np.sort(rng.choice(len(q), count, replace=False))
        contact, angle = np.zeros((len(q), 3)), np.zeros_like(q)
        levers = np.linalg.norm(machine.jacobian(q), axis=1)
        limits = machine.arm.limits.mean(axis=1)
        for i in records:
            jump = np.exp(rng.uniform(*np.log(OUTLIER_M)))
            long_enough = np.flatnonzero(levers[i] > 0.1)
            if rng.uniform() < 0.5 and len(long_enough):
                j = rng.choice(long_enough)
                angle[i, j] = -np.sign(q[i, j] - limits[j]) * jump / levers[i, j]
            else:
                direction = rng.standard_normal(3)
                contact[i] = jump * direction / np.linalg.norm(direction)
        return Jumps(records, contact, angle)


@dataclass(frozen=True, eq=False)
class Draw(Sample):
    """The first run of a plant: its faults, the largest first, and the deviations of the DH values
    (R, 4) [m, m, rad, rad] from the arm file; ``plant.sample(1, n)`` is another run, of new
    postures and noise.
    """

    plant: Plant
    hidden: tuple[Hidden, ...]
    geometry: Array


def draw(
    seed: int,
    cause: str | None = None,
    joint: int | None = None,
    size: float = 1.0,
    count: int = 1,
    plan: str = "free",
    records: int = 300,
    outliers: float = 0.0,
    twin: bool = False,
    *,
    small_terms: bool = True,
    external: bool = False,
    shifts: Mapping[tuple[int, str], float] | None = None,
) -> Draw:
    """A measurement file from a seed.

    Args:
        seed: of everything.
        cause: what is hidden: a name of the contract, ``unexplained`` or ``unexplained:kind`` (see
            :mod:`blind.outside`), ``any`` of :data:`blind.workshop.ANY`, or None for a sound arm.
        joint: row from 1; None: drawn, where the cause has a row.
        size: factor on the sizes of :data:`blind.workshop.SIZES`.
        count: how many faults; further ones are ``any`` others.
        plan: ``free`` (tracker), ``seats`` (ten known ones) or ``unknown-seats`` (five bars of
            known length).
        records: how many.
        outliers: fraction of the records.
        twin: the same run of the same arm with the fault switched off.
        small_terms: False for an arm without any term beside its fault, and a true thermometer.
        external: references in a frame of their own.
        shifts: further deviations of DH values from the arm file, in standard uncertainties
            (half-width / √3), by row and kind, such as ``{(4, "theta_offset"): 9.0}``.
    """
    if plan not in plans.PLANS:
        raise ValueError(f"plan {plan!r}, expected one of {', '.join(plans.PLANS)}")
    arm = chains.read()
    geometry = _geometry(np.random.default_rng([seed, 1]), arm, shifts or {})
    seats = None if plan == "free" else plans.choose_seats(np.random.default_rng([seed, 2]), arm)
    small = SmallTerms.of(np.random.default_rng([seed, 3]), arm) if small_terms else None
    machine = Machine(arm, geometry, (), small)
    frame = _frame(np.random.default_rng([seed, 4])) if external else (np.eye(3), np.zeros(3))
    plant = Plant(seed, machine, plan, records, seats, frame, small_terms)
    if cause is not None and not twin:
        wanted = workshop.Wanted(cause, joint, size, count)
        hidden = workshop.hide_all(
            np.random.default_rng([seed, 5]), machine, *plant.route(0, records), wanted, _others
        )
        if len(hidden) < count:
            raise ValueError(f"{cause} is felt nowhere on this arm")
        plant = replace(plant, machine=machine.with_faults(hidden))
    sample = plant.sample(0, records, outliers)
    hidden = plant.machine.sized(sample.read, sample.conditions)
    return Draw(**vars(sample), plant=plant, hidden=hidden, geometry=geometry)


def _others(hidden: set[str]) -> list[str]:
    return [cause for cause in workshop.ANY if cause not in hidden]


def _geometry(
    rng: np.random.Generator, arm: Chain, shifts: Mapping[tuple[int, str], float]
) -> Array:
    geometry = arm.half_width * rng.uniform(-1.0, 1.0, arm.half_width.shape)
    for (row, kind), multiple in shifts.items():
        column = chains.KINDS.index(kind)
        geometry[row - 1, column] += multiple * arm.half_width[row - 1, column] / np.sqrt(3.0)
    return geometry


def _frame(rng: np.random.Generator) -> tuple[Array, Array]:
    return rotation(rng.uniform(-1.5, 1.5, 3)), rng.uniform(-2.0, 2.0, 3)
