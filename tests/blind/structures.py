"""Structure of a given size that no cause of the contract describes, in the names of what it
depends on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from blind.chains import Chain
from blind.conditions import Conditions
from blind.kinematics import Array
from blind.machine import Machine
from blind.outside import first_order
from blind.truth import Hidden
from blind.workshop import SMALLEST

AMPLITUDES = {
    "joint_product": "amplitude_rad",
    "other_joint": "amplitude_rad",
    "loaded_gear": "amplitude_rad_per_nm",
    "branch": "half_width_rad",
    "tip_field": "shift_m",
    "humidity": "per_pct",
    "operator": "shift_m",
    "column": "shift_m",
    "posture": "shift_m",
}
"""Kinds, and the parameter that each is proportional to."""
ANGLE = 2e-4
"""Of a joint's structure before it has its size [rad]."""
LOAD_NM = 5.0
WIDTHS = (0.5, 0.8)
"""Of a field in the room, over the rms distance of the tips from their middle: it has many records
in it.
"""
GEAR_ORDERS = (2, 3, 4, 6)
TRIES = 100


def structure(
    rng: np.random.Generator,
    machine: Machine,
    kind: str,
    q: Array,
    conditions: Conditions,
    rms: float,
) -> Hidden:
    """Structure of a kind that moves the tip by ``rms`` [m] over the records q (n, nq) [rad].

    Raises:
        ValueError: the kind moves nothing in these records.
    """
    for _ in range(TRIES):
        drawn = _drawn(rng, machine, kind, q, conditions)
        if machine.moves(drawn, q, conditions) > SMALLEST:
            break
    else:
        raise ValueError(f"{kind}: moves the tip by less than {1e6 * SMALLEST:g} µm at every joint")
    for _ in range(3):  # what it does is proportional to first order
        drawn = _scaled(drawn, rms / machine.moves(drawn, q, conditions))
    return drawn


def _scaled(drawn: Hidden, factor: float) -> Hidden:
    name = AMPLITUDES[drawn.parameters["kind"]]
    return replace(
        drawn, parameters={**drawn.parameters, name: factor * np.asarray(drawn.parameters[name])}
    )


def _drawn(
    rng: np.random.Generator, machine: Machine, kind: str, q: Array, conditions: Conditions
) -> Hidden:
    if kind in ("joint_product", "other_joint", "loaded_gear", "branch"):
        return _of_joints(rng, machine, kind, q, conditions)
    parameters, depends_on = _of_tip(rng, machine.arm, kind, q, conditions)
    return Hidden("unexplained", None, {"kind": kind, **parameters}, depends_on=depends_on)


def _of_joints(
    rng: np.random.Generator, machine: Machine, kind: str, q: Array, conditions: Conditions
) -> Hidden:
    """Of one joint, or of two; what a joint does is named by the angles that it depends on.

    What a wave is multiplied by has nothing that is constant or depends on the wave's own joint:
    the library has that.
    """
    joints = rng.permutation(np.flatnonzero(machine.arm.moving) + 1)[:2].tolist()
    phases = rng.uniform(0.0, 2.0 * np.pi, 2)
    p: dict[str, Any] = {"kind": kind, "joints": joints}
    if kind == "joint_product":
        p |= {
            "amplitude_rad": ANGLE,
            "phases_rad": phases,
            "order": int(rng.choice([1, 1, *GEAR_ORDERS])),
        }
        p |= {"mean": float(np.sin(machine.arm.all_angles(q)[:, joints[1] - 1] - phases[1]).mean())}
    elif kind == "other_joint":
        p |= {"amplitude_rad": ANGLE, "phase_rad": phases[0], "order": int(rng.integers(1, 4))}
        joints = joints[1:]
    elif kind == "loaded_gear":
        p |= {
            "amplitude_rad_per_nm": ANGLE / LOAD_NM,
            "phase_rad": phases[0],
            "order": int(rng.choice(GEAR_ORDERS)),
        }
        p |= {"own_nm": _own_torque(machine, joints[0] - 1, q, conditions)}
        joints = joints[:1]
    else:
        p |= {"half_width_rad": ANGLE}
        joints = joints[:1]
    return Hidden("unexplained", None, p, depends_on=tuple(f"joint {joint}" for joint in joints))


def _own_torque(machine: Machine, row: int, q: Array, conditions: Conditions) -> Array:
    """Coefficients (3,) [N·m] of the torque of a joint over its own angle, by least squares over
    the records.
    """
    own = first_order(machine.arm.all_angles(q)[:, row])
    return np.asarray(np.linalg.lstsq(own, machine.load(q, conditions)[:, row], rcond=None)[0])


def _of_tip(
    rng: np.random.Generator, arm: Chain, kind: str, q: Array, conditions: Conditions
) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """Parameters of what shifts the tip, and names of what it depends on."""
    if kind == "humidity":
        return {"per_pct": 1.5e-5}, ("humidity_pct",)
    if kind == "posture":
        return {"shift_m": 1e-4 * rng.standard_normal((int(conditions.posture.max()) + 1, 3))}, ()
    direction = rng.standard_normal(3)
    shift = {"shift_m": 3e-4 * direction / np.linalg.norm(direction)}
    if kind == "operator":
        return shift, ("operator",)
    if kind == "column":
        return shift, ("humidity_pct",)
    tips = arm.tips(q)
    spread = np.sqrt(((tips - tips.mean(axis=0)) ** 2).sum(axis=1).mean())
    centre = tips[rng.integers(len(tips))]
    return shift | {"centre_m": centre, "width_m": float(spread * rng.uniform(*WIDTHS))}, (
        "x",
        "y",
        "z",
    )
