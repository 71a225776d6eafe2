"""Faults of the size in which workshops meet them, drawn by a seed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blind.chains import Chain
from blind.conditions import Conditions
from blind.kinematics import Array
from blind.machine import Machine
from blind.outside import DEPENDS_ON
from blind.plans import SEATS
from blind.truth import Hidden

Range = tuple[float, float]
SMALLEST = 8e-6
"""What is left to the seed is drawn among the places where the fault moves the tip by so much (rms)
at least [m].
"""

PER_JOINT = (
    "encoder_eccentricity", "encoder_ellipticity", "joint_periodic_error", "joint_error_curve",
    "encoder_gain", "encoder_slip", "joint_hysteresis", "zero_drift", "joint_compliance",
    "bearing_tilt",
)  # fmt: skip
PER_TUBE = ("link_bending", "torsional_windup")
WHOLE_ARM = ("base_compliance", "thermal_expansion", "stylus_bending", "stylus_offset")
SHOULDER = ("counterbalance",)
GEOMETRY = ("joint_zero_offset", "link_length", "joint_distance", "link_twist")
CAUSES = (*PER_JOINT, *PER_TUBE, *SHOULDER, *WHOLE_ARM, *GEOMETRY, "seat_error", "unexplained")
ANY = (*PER_JOINT, "link_bending", "base_compliance", "thermal_expansion")
"""What ``draw(cause="any")`` chooses from; the others are near-copies of these or of geometry, or
want special plans.
"""

SIZES: dict[str, dict[str, Range]] = {
    "encoder_eccentricity": {"amplitude_rad": (0.8e-4, 2.5e-4)},
    "encoder_ellipticity": {"amplitude_rad": (0.8e-4, 2.5e-4)},
    "joint_periodic_error": {"amplitude_rad": (0.5e-4, 1.5e-4)},
    "encoder_gain": {"gain": (0.4e-4, 1.0e-4)},
    "encoder_slip": {"step_rad": (1.0e-4, 2.5e-4)},
    "joint_hysteresis": {"half_width_rad": (0.6e-4, 2.0e-4)},
    "zero_drift": {"drift_rad": (1.0e-4, 2.5e-4)},
    "joint_compliance": {"compliance_rad_per_nm": (1.0e-5, 3.0e-5)},
    "bearing_tilt": {"compliance_rad_per_nm": (1.0e-5, 3.0e-5)},
    "link_bending": {"flexibility_rad_per_nm2": (3.0e-5, 8.0e-5)},
    "torsional_windup": {"compliance_rad_per_nm": (1.0e-5, 3.0e-5)},
    "counterbalance": {"level_turn_rad": (0.8e-4, 2.0e-4)},
    "base_compliance": {"compliance_rad_per_nm": (6.0e-6, 2.0e-5)},
    "thermal_expansion": {"expansion_per_k": (12.0e-6, 26.0e-6)},
    "stylus_bending": {"level_sag_mm": (0.01, 0.03)},
    "joint_zero_offset": {"offset_rad": (0.8e-4, 2.0e-4)},
    "link_length": {"a_mm": (0.05, 0.15)},
    "joint_distance": {"d_mm": (0.05, 0.15)},
    "link_twist": {"alpha_rad": (0.8e-4, 2.0e-4)},
}
"""What is drawn between the two numbers and multiplied by the size."""

EITHER_SIGN = {
    "encoder_gain",
    "encoder_slip",
    "joint_hysteresis",
    "zero_drift",
    "counterbalance",
    *GEOMETRY,
}
ORDERS = (3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 32)


def rows_for(cause: str, arm: Chain) -> list[int | None]:
    """Rows (from 1) at which the cause can sit; [None] for causes of the whole arm."""
    if cause in PER_JOINT:
        return [int(i) + 1 for i in np.flatnonzero(arm.moving)]
    if cause in PER_TUBE:
        return list(arm.tubes())
    if cause == "thermal_expansion":
        return [None, *arm.tubes()]
    if cause in SHOULDER:
        return [2]
    if cause in GEOMETRY:
        return list(range(1, arm.rows + 1))
    return [None]


def hide(
    rng: np.random.Generator,
    arm: Chain,
    cause: str,
    joint: int | None,
    size: float,
    clock: tuple[float, float],
) -> Hidden:
    """A fault of the cause; ``clock`` is the first and last time of the run [s].

    Raises:
        ValueError: the cause is not one of :data:`CAUSES` (or ``unexplained:kind``).
    """
    name, _, kind = cause.partition(":")
    if name not in CAUSES or (kind and kind not in DEPENDS_ON):
        raise ValueError(
            f"cause {cause!r}, expected one of {', '.join(CAUSES)}, or "
            f"unexplained:{'|'.join(DEPENDS_ON)}"
        )
    if name == "unexplained":
        return _outside(rng, arm, kind or str(rng.choice(list(DEPENDS_ON))), size, clock)
    p: dict[str, Any] = {}
    for parameter, (low, high) in SIZES.get(name, {}).items():
        sign = rng.choice([-1.0, 1.0]) if name in EITHER_SIGN else 1.0
        p[parameter] = float(sign * size * rng.uniform(low, high))
    return Hidden(name, joint, p | _beside(rng, name, size, clock))


@dataclass(frozen=True)
class Wanted:
    """What is to be hidden: the first cause (``any``: drawn) at a row (None: drawn), of a size in
    workshops' sizes, or with ``value`` as its parameter itself; how many faults in all; the number
    of seats where a seat error is drawn among them.
    """

    cause: str
    joint: int | None = None
    size: float = 1.0
    count: int = 1
    value: float | None = None
    seats: int | None = None


def hide_all(
    rng: np.random.Generator,
    machine: Machine,
    q: Array,
    conditions: Conditions,
    wanted: Wanted,
    others: Callable[[set[str]], Sequence[str]],
) -> tuple[Hidden, ...]:
    """Faults at different rows; what is left to the seed is drawn among the places where a fault of
    size 1 would be felt, and from the causes that ``others`` gives beside those hidden already.
    Fewer than wanted where none is felt.
    """
    some = np.unique(np.linspace(0, len(q) - 1, min(len(q), 60)).astype(int))
    felt, where = q[some], conditions.take(some)
    clock = (float(conditions.time[0]), float(conditions.time[-1]))
    hidden: list[Hidden] = []
    for _ in range(50):
        if len(hidden) == wanted.count:
            break
        first = not hidden
        given = first and wanted.cause != "any"
        cause = wanted.cause if given else str(rng.choice(others({h.cause for h in hidden})))
        rows = (
            [wanted.joint] if first and wanted.joint is not None else rows_for(cause, machine.arm)
        )
        rows = [
            row
            for row in rows
            if not any(h.cause == cause or (row is not None and h.joint == row) for h in hidden)
        ]
        stream = int(rng.integers(2**31))

        def fault(row: int | None, size: float, cause: str = cause, stream: int = stream) -> Hidden:
            made = hide(np.random.default_rng(stream), machine.arm, cause, row, size, clock)
            if cause == "seat_error" and wanted.seats is not None:
                return replace(
                    made, parameters={**made.parameters, "seat": f"P{stream % wanted.seats + 1}"}
                )
            return made

        rows = [
            row
            for row in rows
            if len(rows) == 1 or machine.moves(fault(row, 1.0), felt, where) >= SMALLEST
        ]
        if rows:
            chosen = fault(rows[int(rng.integers(len(rows)))], wanted.size)
            if given and wanted.value is not None:
                chosen = replace(
                    chosen, parameters={**chosen.parameters, next(iter(SIZES[cause])): wanted.value}
                )
            hidden.append(chosen)
    return tuple(hidden)


def _beside(
    rng: np.random.Generator, cause: str, size: float, clock: tuple[float, float]
) -> dict[str, Any]:
    """Parameters of a cause that are not in :data:`SIZES`."""
    if cause in ("encoder_eccentricity", "encoder_ellipticity", "joint_periodic_error"):
        phase = {"phase_rad": float(rng.uniform(-np.pi, np.pi))}
        return phase | (
            {"order": int(rng.choice(ORDERS))} if cause == "joint_periodic_error" else {}
        )
    if cause == "encoder_slip":
        return {"time_s": float(clock[0] + rng.uniform(0.25, 0.75) * (clock[1] - clock[0]))}
    if cause == "zero_drift":
        return {"time_constant_s": float(np.clip(rng.uniform(0.1, 0.3) * clock[1], 600.0, 5400.0))}
    if cause == "joint_error_curve":  # narrow bumps of both signs in irregular places
        count = int(rng.integers(4, 7))
        gaps = rng.uniform(0.5, 1.5, count)
        return {
            "centres_rad": rng.uniform(0.0, 2.0 * np.pi)
            + 2.0 * np.pi * np.cumsum(gaps) / gaps.sum(),
            "widths_rad": rng.uniform(0.12, 0.35, count),
            "heights_rad": size
            * rng.uniform(1.2e-4, 2.5e-4, count)
            * rng.choice([-1.0, 1.0], count),
        }
    if cause in ("seat_error", "stylus_offset"):
        seat = {"seat": f"P{rng.integers(1, SEATS + 1)}"} if cause == "seat_error" else {}
        vector = size * _direction(rng) * rng.uniform(0.1, 0.3)
        return seat | dict(zip(("x_mm", "y_mm", "z_mm"), vector.tolist(), strict=True))
    return {}


def _direction(rng: np.random.Generator) -> np.ndarray:
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def _outside(
    rng: np.random.Generator, arm: Chain, kind: str, size: float, clock: tuple[float, float]
) -> Hidden:
    p: dict[str, Any] = {}
    depends_on = DEPENDS_ON[kind]
    if kind == "joint_product":
        j, k = [(2, 4), (4, 2), (1, 3), (3, 4), (4, 5)][rng.integers(5)]
        p = {
            "joints": (j, k),
            "phases_rad": rng.uniform(0.0, np.pi, 2),
            "amplitude_rad": size * rng.uniform(1.5e-4, 3.0e-4),
        }
        depends_on = tuple(name.format(j=j, k=k) for name in depends_on)
    elif kind == "humidity":
        p = {"per_pct": size * rng.choice([-1.0, 1.0]) * rng.uniform(1.2e-5, 2.0e-5)}
    elif kind == "operator":
        p = {"shift_m": size * _direction(rng) * rng.uniform(0.8e-4, 2.0e-4)}
    elif kind == "frame_walk":
        walk = np.cumsum(rng.standard_normal((60, 3)), axis=0)
        walk -= walk.mean(axis=0)
        p = {
            "knots_s": np.linspace(0.0, clock[1], 60),
            "walk_m": size * rng.uniform(5e-5, 1e-4) * walk / walk.std(),
        }
    elif kind == "tip_field":
        azimuth = float(rng.uniform(arm.limits[:, 0], arm.limits[:, 1])[0])
        reach = np.abs(arm.spans()).sum() / 2.0
        centre = reach * 0.6 * np.array([np.cos(azimuth), np.sin(azimuth), rng.uniform(-0.4, 0.4)])
        p = {
            "centre_m": centre,
            "width_m": 0.3,
            "shift_m": size * _direction(rng) * rng.uniform(2.0e-4, 4.0e-4),
        }
    return Hidden("unexplained", None, {"kind": kind, **p}, depends_on=depends_on)
