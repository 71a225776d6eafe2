"""Files as they come from robots in factories: no noise stated, no cause alone, markers, one day of
a clock.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from aacmm_pin._support.arrays import Array
from aacmm_pin.arm import Arm, DHTable, exp, load_arm_file
from aacmm_pin.effects import Conditions
from aacmm_pin.measurements import Measurements

ROBOT = Path(__file__).with_name("tool_robot.toml")
OPTIONS: dict[str, Any] = {"reference_frame": "external", "target": "unknown"}
"""What is said of such a file at the shell."""
CURVED, KNOTS = 5, 100
"""So many joints have an error curve through so many knots …"""
CURVE = 1e-4
"""… of this standard deviation [rad]."""
SCATTER = 2e-5
"""Standard deviation of every coordinate [m]."""
GEOMETRY_ERRORS = np.array([2e-4, 2e-4, 5e-4, 5e-4])
"""Standard deviations of the errors of a, d, alpha, theta_offset [m, m, rad, rad]."""
MARKER = 0.1
"""Standard deviation of each coordinate of a marker on the last body [m]."""
DAY_S = 13 * 3600.0
"""What the clock of a file covers [s]."""


def real_like(postures: int, markers: int = 1) -> tuple[Arm, Measurements]:
    """A robot of six joints by its file, and records of a tracker in a frame of its own: every
    marker in each posture.
    """
    file, rng = load_arm_file(str(ROBOT)), np.random.default_rng(4)
    q = rng.uniform(*file.limits.T, (postures, len(file.limits)))
    robot = with_errors(file.dh, rng)
    turns, places = robot.chain.walk(q + _curves(rng, q))
    own = rng.normal(size=(markers, 3)) * MARKER
    tips = places[-1][:, None] + np.einsum("nij,mj->nmi", turns[-1], own)
    frame = exp(rng.normal(size=(1, 6)))[0]
    seen = tips.reshape(-1, 3) @ frame[:3, :3].T + frame[:3, 3]
    conditions = Conditions(
        n=len(seen),
        time=np.repeat(np.linspace(0.0, DAY_S, postures), markers),
        marker=np.tile(np.array([f"M{k}" for k in range(markers)], dtype=object), postures)
        if markers > 1
        else None,
    )
    reference = seen + rng.normal(size=seen.shape) * SCATTER
    return Arm.from_file(file), Measurements.of(
        np.repeat(q, markers, axis=0), reference, conditions=conditions
    )


def with_errors(dh: DHTable, rng: np.random.Generator) -> DHTable:
    """A table whose values are all off."""
    a, d, alpha, theta = (rng.normal(size=(dh.rows, 4)) * GEOMETRY_ERRORS).T
    return replace(
        dh, a=dh.a + a, d=dh.d + d, alpha=dh.alpha + alpha, theta_offset=dh.theta_offset + theta
    )


def _curves(rng: np.random.Generator, q: Array) -> Array:
    """What the error curves add to readings (n, nq) [rad]."""
    found, knots = np.zeros_like(q), np.linspace(-np.pi, np.pi, KNOTS + 1)
    for joint in range(CURVED):
        heights = CURVE * rng.normal(size=KNOTS)
        found[:, joint] = CubicSpline(knots, np.append(heights, heights[0]), bc_type="periodic")(
            q[:, joint]
        )
    return found
