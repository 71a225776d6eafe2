"""Measurement files of many arms and kinds of evidence: :func:`regime_file` draws everything from
one seed.

Where :func:`blind.plant.draw` has one arm, three plans and three hundred records, this draws the
arm, what is stated of it, the evidence, its amount and noise, gross errors and what is hidden.
Words for the command line come with the file.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from blind import chains, plans, structures, table, workshop
from blind.chains import Chain
from blind.conditions import SESSIONS, Conditions, run
from blind.kinematics import Array, rotation
from blind.machine import Machine
from blind.outside import SmallTerms
from blind.plant import Jumps
from blind.truth import Hidden

ARMS = ("sino6", "standard-dh", "modified-dh", "ur5", "panda")
"""The bundled arm, arms of seven joints in both conventions, and robots by their URDF."""
EVIDENCE = ("free", "seats", "bars", "markers", "target")
"""A tracker at the tip, known seats, bars of known length, markers on the last body, one target at
an unknown place.
"""
ENCODER_U, REFERENCE_U = 8e-6, 12e-6
BAR_U = 2e-6
TORQUE_U_NM = (0.05, 0.3, 1.0)
"""A sensor in the joint, a good drive's current, a current with friction."""
PAYLOADS_KG = (0.0, 1.5, 3.0)
APART_M = 0.12
LEAST_LEVER_M = 0.03
"""At a seat every direction is reached with so much motion of the tip for a radian of the joints.
"""
SIZES = ((8, 19), (20, 60), (61, 300), (301, 3000))
"""Numbers of records, each class as likely as the next."""


@dataclass(frozen=True)
class Regime:
    """What is known beforehand of a file.

    Attributes:
        arm: one of :data:`ARMS`.
        stated: the arm states bounds of its geometry.
        masses: the arm states masses.
        evidence: one of :data:`EVIDENCE`.
        records: how many.
        seats: how many, of evidence ``seats`` and ``bars``.
        external: references in a frame of their own.
        torque: the file has torques, and payloads that nobody states.
        own_u: the file states the uncertainty of every reference, which differs from record to
            record.
        payload_by_session: a payload for each session, in place of one for each record.
        environment: the file has times, temperatures and directions of approach.
        approaches: the last of these too.
        noted: further columns of the file, of :data:`NOTED`.
        held: records of each posture, in one row or scattered.
        scattered: see ``held``.
        wobble: standard deviation of each reading of a held posture about it [rad].
        commanded: the file notes where the arm was sent, the same for each record of a posture, in
            place of readings.
        encoder_u: true noise of an encoder [rad].
        reference_u: true noise of a coordinate of a reference or contact [m].
        noise_stated: ``all``, ``reference`` or ``none``, on the command line.
        outliers: fraction of the records.
        faults: how many.
        cause: hidden first; ``any``: drawn.
        joint: of that; None: drawn.
        size: factor on the sizes of workshops.
        value: the size of the first fault itself, in the unit of its parameter, in place of a drawn
            one; None: drawn.
        places: causes and rows of all faults, in place of drawn ones.
        structure: kind outside the library, see :mod:`blind.structures`; empty: none.
        structure_size: of that, in rms at the tip over that of the noise.
    """

    arm: str
    stated: bool
    masses: bool
    evidence: str
    records: int
    seats: int = 0
    external: bool = False
    torque: bool = False
    payload_by_session: bool = False
    own_u: bool = False
    environment: bool = True
    approaches: bool = True
    noted: tuple[str, ...] = ()
    held: int = 1
    scattered: bool = False
    wobble: float = 0.0
    commanded: bool = False
    encoder_u: float = ENCODER_U
    reference_u: float = REFERENCE_U
    noise_stated: str = "all"
    outliers: float = 0.0
    faults: int = 1
    cause: str = "any"
    joint: int | None = None
    size: float = 1.0
    value: float | None = None
    places: tuple[tuple[str, int | None], ...] = ()
    structure: str = ""
    structure_size: float = 0.0

    @property
    def at_seats(self) -> bool:
        return self.evidence in ("seats", "bars")

    def chain(self) -> Chain:
        """The arm."""
        if self.arm == "sino6":
            return chains.read()
        if self.arm in chains.SEVEN:
            return chains.seven(self.arm, self.stated)
        return chains.robot(self.arm, *(ROBOT_BOUNDS if self.stated else (0.0, 0.0)))


ROBOT_BOUNDS = (2e-4, 5e-4)
"""Stated half-widths of the joint placements of a robot [m, rad]."""


@dataclass(frozen=True, eq=False)
class RegimeFile:
    """A measurement file, the arm's file where it has one, and what is hidden.

    Attributes:
        regime: what was drawn.
        files: name -> text.
        machine: the arm with its faults, the largest first.
        read: indications as noted (n, nq) [rad].
        conditions: of each record.
        outliers: records (from 0).
        reference_u: standard uncertainty of each record's reference or contact (n,) [m].
        seats: places of the seats (S, 3) [m]; none where there are none.
    """

    regime: Regime
    files: dict[str, str]
    machine: Machine
    read: Array
    conditions: Conditions
    outliers: tuple[int, ...]
    reference_u: Array
    seats: Array
    bar_u = BAR_U

    @property
    def hidden(self) -> tuple[Hidden, ...]:
        """Causes of the library."""
        return tuple(fault for fault in self.machine.faults if fault.cause != "unexplained")

    @property
    def structure(self) -> Hidden | None:
        """What no cause of the library describes."""
        return next((fault for fault in self.machine.faults if fault.cause == "unexplained"), None)

    @property
    def noise_rms(self) -> float:
        """What readings and references alone leave at the tip [m]."""
        return tip_noise(self.machine, self.read, self.encoder_u, self.reference_u)

    # --- what the records leave unknown (see :mod:`blind.oracle`)

    @property
    def encoder_u(self) -> float:
        return self.regime.encoder_u

    @property
    def external(self) -> bool:
        return self.regime.external

    @property
    def posture_u(self) -> float:
        """Standard uncertainty of each coordinate that is common to the records of a held posture
        [m]; 0: none.
        """
        structure = self.structure
        if structure is None or structure.parameters["kind"] != "posture":
            return 0.0
        return 1e-6 * structure.size_um / np.sqrt(3.0)

    @property
    def targets(self) -> int:
        return 0 if self.machine.targets is None else len(self.machine.targets)

    @property
    def fitted_seats(self) -> Array:
        return self.seats

    @property
    def seat_u(self) -> float:
        return self.regime.reference_u if self.regime.evidence == "seats" else np.inf

    @property
    def bars(self) -> NDArray[np.int_]:
        """Each is between two seats that follow each other (B, 2)."""
        return np.arange(self.regime.seats if self.regime.evidence == "bars" else 0).reshape(-1, 2)

    # --- for the command line

    def write(self, folder: Path) -> None:
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")

    def words(self, folder: Path) -> list[str]:
        """Arguments and options of ``aacmm-pin diagnose`` for the files in ``folder``."""
        r, mm = self.regime, 1e3
        data = str(folder / "data.csv")
        if r.arm in chains.ROBOTS:
            words = [
                "--urdf",
                str(chains.robot_file(r.arm)),
                "--frame",
                chains.ROBOTS[r.arm][1],
                data,
            ]
            if r.stated:
                words += ["--translation-half-width-mm", f"{mm * ROBOT_BOUNDS[0]:g}"]
                words += ["--rotation-half-width", f"{ROBOT_BOUNDS[1]:g}"]
        else:
            words = ["sino6" if r.arm == "sino6" else str(folder / "arm.toml"), data]
        if r.noise_stated == "all":
            words += ["--encoder-noise", f"{r.encoder_u:.6g}"]
        if r.noise_stated != "none":
            words += (
                ["--u-reference-mm", f"{mm * r.reference_u:.6g}"]
                if not r.own_u and r.evidence != "bars"
                else []
            )
            words += ["--probe-noise-mm", f"{mm * r.reference_u:.6g}"] if r.at_seats else []
            words += ["--u-bar-mm", f"{mm * BAR_U:g}"] if r.evidence == "bars" else []
        words += ["--reference-frame", "external"] if r.external else []
        return [*words, *(["--target", "unknown"] if r.evidence == "target" else [])]


def draw_regime(seed: int, most_records: int = SIZES[-1][1], **given: object) -> Regime:
    """A regime from a seed; what is given is not drawn, but changes nothing of the rest."""
    rng = np.random.default_rng([seed, 11])
    arm = str(given.get("arm", rng.choice(ARMS, p=[0.3, 0.25, 0.15, 0.15, 0.15])))
    robot = arm in chains.ROBOTS
    torque = bool(rng.uniform() < (0.5 if robot else 0.1)) and arm != "sino6"
    evidence = str(rng.choice(EVIDENCE, p=[0.4, 0.25, 0.15, 0.1, 0.1]))
    classes = [(low, min(high, most_records)) for low, high in SIZES if low <= most_records]
    low, high = classes[rng.integers(len(classes))]
    records = int(np.exp(rng.uniform(np.log(low), np.log(high + 1))))
    few = bool(rng.uniform() < 0.4)
    usual = bool(rng.uniform() < 0.6)
    encoder_u, reference_u = np.exp(rng.uniform(np.log([3e-6, 5e-6]), np.log([4e-5, 5e-5])))
    drawn: dict[str, object] = {
        "arm": arm,
        "stated": arm == "sino6" or bool(rng.uniform() < 0.6),
        "masses": arm == "sino6" or robot or bool(rng.uniform() < 0.6),
        "evidence": evidence,
        "records": records,
        "external": bool(rng.uniform() < 0.3),
        "torque": torque,
        "own_u": bool(rng.uniform() < 0.2),
        "environment": bool(rng.uniform() < 0.8),
        "encoder_u": ENCODER_U if usual else float(f"{encoder_u:.3g}"),
        "reference_u": REFERENCE_U if usual else float(f"{reference_u:.3g}"),
        "noise_stated": str(rng.choice(["all", "reference", "none"], p=[0.7, 0.15, 0.15])),
        "outliers": float(rng.choice([0.0, 0.03, 0.1], p=[0.6, 0.2, 0.2])),
        "faults": int(rng.choice([0, 1, 2], p=[0.25, 0.6, 0.15])),
    }
    drawn |= given
    kind, records = drawn["evidence"], int(str(drawn["records"]))
    if kind == "seats":
        drawn.setdefault("seats", 3 if few else min(int(rng.integers(4, 11)), max(3, records // 2)))
    elif kind == "bars":
        # Both ends are touched.
        drawn.setdefault("seats", 4 if few else 2 * min(int(rng.integers(2, 6)), records // 4))
    drawn["own_u"] = bool(drawn["own_u"]) and kind not in ("seats", "bars")
    drawn["external"] = bool(drawn["external"]) and kind != "bars"
    return Regime(**drawn)


def regime_file(seed: int, most_records: int = SIZES[-1][1], **given: object) -> RegimeFile:
    """Everything from a seed; ``given`` are fields of :class:`Regime` that are not drawn."""
    regime = draw_regime(seed, most_records, **given)

    def rng(stream: str) -> np.random.Generator:
        return np.random.default_rng([seed, zlib.crc32(stream.encode())])

    arm = regime.chain()
    bounds = np.where(arm.half_width.any(), arm.half_width, arm.typical)
    geometry = bounds * rng("geometry").uniform(-1.0, 1.0, bounds.shape)
    rig = Machine(
        arm, geometry, (), SmallTerms.of(rng("small"), arm), _targets(rng("targets"), regime)
    )
    q, conditions, seats = _route(rng("route"), rng("weather"), regime, rig)
    rig = rig.with_faults(_faults(rng("faults"), rig, regime, q, conditions))
    if regime.structure:
        rms = regime.structure_size * tip_noise(
            rig, q, regime.encoder_u, np.array([regime.reference_u])
        )
        outside = structures.structure(rng("structure"), rig, regime.structure, q, conditions, rms)
        rig = rig.with_faults([*rig.faults, outside])
    jumps = Jumps.of(rng("outliers"), rig, q, round(regime.outliers * len(q)))
    return _measured(rng("noise"), jumps, regime, rig, q, conditions, seats)


def _faults(
    rng: np.random.Generator, rig: Machine, regime: Regime, q: Array, conditions: Conditions
) -> tuple[Hidden, ...]:
    """Of the library."""
    if regime.places:
        clock = (float(conditions.time[0]), float(conditions.time[-1]))
        return tuple(
            workshop.hide(rng, rig.arm, cause, row, regime.size, clock)
            for cause, row in regime.places
        )
    wanted = workshop.Wanted(
        regime.cause, regime.joint, regime.size, regime.faults, regime.value, regime.seats
    )
    return workshop.hide_all(rng, rig, q, conditions, wanted, lambda _: causes_of(regime))


def tip_noise(machine: Machine, q: Array, encoder_u: float, reference_u: Array) -> float:
    """What noise of readings [rad] and of coordinates of references [m] leaves at the tip, rms over
    q (n, nq) [m].
    """
    readings = encoder_u**2 * (machine.jacobian(q) ** 2).sum(axis=(1, 2)).mean()
    return float(np.sqrt(readings + 3.0 * (reference_u**2).mean()))


def _route(
    rng: np.random.Generator, weather: np.random.Generator, regime: Regime, rig: Machine
) -> tuple[Array, Conditions, Array]:
    """Postures (n, nq) [rad], their conditions, and the places of the seats (S, 3) [m]."""
    n, arm = regime.records, rig.arm
    session, seats, seat = np.arange(n) * SESSIONS // n, np.zeros((0, 3)), np.full(n, -1)
    if regime.at_seats:
        seats, seat = _seats(rng, arm, regime), plans.round_trips(session, regime.seats)
        q = _at_seats(rng, arm, seats[seat])
    else:
        q = plans.free_postures(rng, arm, -(-n // regime.held))
    posture = np.arange(n) // regime.held
    if regime.scattered:
        posture = rng.permutation(posture)
    q = q if regime.at_seats else q[posture] + regime.wobble * rng.standard_normal((n, q.shape[1]))
    payload = rng.choice(PAYLOADS_KG, n) if regime.torque else np.zeros(n)
    if regime.payload_by_session:
        payload = rng.permutation(PAYLOADS_KG)[session]
    marker = rng.integers(0, 1 if rig.targets is None else len(rig.targets), n)
    conditions = replace(
        run(weather, arm, seat, session, 1.0, True), payload=payload, marker=marker, posture=posture
    )
    return q, conditions, seats


def _measured(
    noise: np.random.Generator,
    jumps: Jumps,
    regime: Regime,
    rig: Machine,
    q: Array,
    conditions: Conditions,
    seats: Array,
) -> RegimeFile:
    n = len(q)
    u = regime.reference_u * (np.exp(noise.uniform(-0.7, 0.9, n)) if regime.own_u else np.ones(n))
    encoder = regime.encoder_u * noise.standard_normal(q.shape)
    q = q - encoder if regime.commanded else q  # the arm misses the posture that is noted
    contact = u[:, None] * noise.standard_normal((n, 3)) + jumps.contact
    if regime.at_seats:
        places = seats + (
            regime.reference_u if regime.evidence == "seats" else 0.0
        ) * noise.standard_normal(seats.shape)
        q = rig.touching(q, conditions, seats[conditions.seat] + contact)
        reference = places[conditions.seat]
    else:
        reference = rig.observed(q, conditions) + contact
    torque = None
    if regime.torque:
        torque = rig.torque(q, conditions) + noise.choice(TORQUE_U_NM) * noise.standard_normal(
            q.shape
        )
    read = q + encoder + jumps.angle
    turn, shift = rotation(noise.uniform(-1.5, 1.5, 3)), noise.uniform(-2.0, 2.0, 3)
    if regime.external:
        reference = reference @ turn.T + shift
    bar_error = BAR_U * noise.standard_normal(max(1, regime.seats // 2))
    files: dict[str, str] = {}
    if regime.arm in chains.SEVEN:
        files["arm.toml"] = chains.seven_text(regime.arm, regime.stated, regime.masses)
    rig = rig.with_faults(rig.sized(read, conditions))
    file = RegimeFile(regime, files, rig, read, conditions, tuple(jumps.records.tolist()), u, seats)
    files["data.csv"] = _text(file, reference, torque, bar_error)
    return file


# --- where the arm goes


def _targets(rng: np.random.Generator, regime: Regime) -> Array | None:
    count = {"markers": 3, "target": 1}.get(regime.evidence)
    return None if count is None else rng.uniform(-0.12, 0.12, (count, 3))


def _seats(rng: np.random.Generator, arm: Chain, regime: Regime) -> Array:
    """Places within easy reach, some way apart (S, 3) [m]."""
    tips = arm.tips(plans.random_postures(rng, arm, 4000))
    reach = np.linalg.norm(tips - tips.mean(axis=0), axis=1)
    found: list[Array] = []
    for point in tips[reach < np.quantile(reach, 0.6)]:
        if len(found) < regime.seats and all(
            np.linalg.norm(point - other) > APART_M for other in found
        ):
            found.append(point)
    return np.array(found)


def _at_seats(rng: np.random.Generator, arm: Chain, places: Array) -> Array:
    """A posture for each of the places (n, 3), by Newton steps from random postures; within the
    limits (n, nq) [rad].
    """
    q = np.full((len(places), len(arm.limits)), np.nan)
    low, high = arm.limits[:, 0] + plans.MARGIN, arm.limits[:, 1] - plans.MARGIN
    for _ in range(1000):
        missing = np.flatnonzero(np.isnan(q[:, 0]))
        if not missing.size:
            return q
        tried = plans.random_postures(rng, arm, len(missing))
        for _ in range(12):
            j = arm.jacobian(tried)
            gap = places[missing] - arm.tips(tried)
            step = np.linalg.solve(j @ j.transpose(0, 2, 1) + 1e-6 * np.eye(3), gap[..., None])
            tried = tried + np.clip(np.einsum("nkj,nk->nj", j, step[..., 0]), -0.5, 0.5)
        gap = places[missing] - arm.tips(tried)
        good = (np.abs(gap).max(axis=1) < 1e-5) & ((tried > low) & (tried < high)).all(axis=1)
        # Gross errors can be reached.
        good &= np.linalg.svd(arm.jacobian(tried), compute_uv=False)[:, -1] > LEAST_LEVER_M
        q[missing[good]] = tried[good]
    raise ValueError(f"no posture found for {missing.size} of {len(places)} records")


# --- what is hidden


def causes_of(regime: Regime) -> list[str]:
    """Causes that can be hidden: those whose columns the file has, and whose loads the arm
    states.
    """
    causes = [
        "encoder_eccentricity",
        "encoder_ellipticity",
        "joint_periodic_error",
        "joint_error_curve",
        "encoder_gain",
    ]
    if regime.environment:
        causes += (
            ["encoder_slip", "zero_drift"]
            + ["joint_hysteresis"] * regime.approaches
            + ["thermal_expansion"]
        )
    causes += ["joint_compliance", "joint_compliance"] if regime.masses or regime.torque else []
    if regime.masses and not regime.torque:
        causes += ["bearing_tilt", "link_bending", "torsional_windup", "base_compliance"]
    if not regime.torque:
        causes.append("counterbalance")
    if regime.stated and regime.arm not in chains.ROBOTS and regime.evidence in ("free", "seats"):
        causes += ["stylus_bending", "stylus_offset", *workshop.GEOMETRY]
    if regime.evidence == "seats" and regime.records >= 4 * regime.seats and not regime.external:
        causes.append("seat_error")
    return causes


# --- the file

NOTED: dict[str, Callable[[Conditions], Sequence[str]]] = {
    "humidity_pct": lambda conditions: table.fixed(conditions.humidity, 1),
    "operator": lambda conditions: ["AB"[i] for i in conditions.operator],
    "payload_kg": lambda conditions: table.fixed(conditions.payload, 1),
}
"""Columns that no cause of the contract needs."""


def _text(file: RegimeFile, reference: Array, torque: Array | None, bar_error: Array) -> str:
    regime, conditions = file.regime, file.conditions
    columns: dict[str, Sequence[str]] = {**table.angles(file.read)}
    if regime.evidence != "bars":
        columns |= table.coordinates(reference)
    if regime.own_u:
        columns |= {
            name: table.fixed(file.reference_u, 6, 1e3) for name in ("u_x_mm", "u_y_mm", "u_z_mm")
        }
    if regime.at_seats:
        columns["seat"] = [f"P{s + 1}" for s in conditions.seat]
    if regime.evidence == "bars":
        length = np.linalg.norm(file.seats[0::2] - file.seats[1::2], axis=1) + bar_error
        columns |= table.bars(conditions.seat, file.bars, length)
    if regime.evidence == "markers":
        columns["marker"] = [f"M{m + 1}" for m in conditions.marker]
    if regime.environment:
        columns["time_s"] = table.fixed(conditions.time, 1)
        columns["temperature_c"] = table.fixed(conditions.temperature_reading, 2)
        columns["session"] = [f"S{s + 1}" for s in conditions.session]
    if regime.environment and regime.approaches:
        columns |= table.approaches(conditions, file.machine.arm.moving)
    columns |= {name: NOTED[name](conditions) for name in regime.noted}
    if torque is not None:
        columns |= {
            f"torque{k + 1}_nm": table.fixed(column, 4) for k, column in enumerate(torque.T)
        }
    return table.csv(columns)
