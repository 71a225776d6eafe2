"""Faults that no cause of the contract describes, and the small terms that every real arm has
beside its faults.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from blind.chains import Chain
from blind.conditions import Conditions
from blind.encoders import Parameters, bumps
from blind.kinematics import Array

DEPENDS_ON = {
    "joint_product": ("theta{j}", "theta{k}"),
    "humidity": ("humidity_pct",),
    "operator": ("operator",),
    "frame_walk": ("time_s",),
    "tip_field": ("x_mm", "y_mm", "z_mm"),
}
"""Kinds of ``unexplained``, and the columns they depend on."""


def joint_product(angles: Array, p: Parameters) -> Array:
    """(n,) term of joint j that depends on two: A sin(m θj - a) (sin(θk - b) - c); m is one, c zero
    unless stated.
    """
    j, k = p["joints"]
    a, b = p["phases_rad"]
    own = np.sin(p.get("order", 1) * angles[:, j - 1] - a)
    return np.asarray(
        p["amplitude_rad"] * own * (np.sin(angles[:, k - 1] - b) - p.get("mean", 0.0))
    )


def other_joint(angles: Array, p: Parameters) -> Array:
    """(n,) term of joint j that depends on joint k alone: A sin(m θk - b)."""
    k = p["joints"][1]
    return np.asarray(p["amplitude_rad"] * np.sin(p["order"] * angles[:, k - 1] - p["phase_rad"]))


def loaded_gear(angles: Array, torque: Array, p: Parameters) -> Array:
    """(n,) term of a joint: a wave over its angle by the torque (n, R) [N·m] of its load, A (τ - c)
    sin(m θ - a).

    c is the part of τ that the joint's own angle gives.
    """
    i = p["joints"][0] - 1
    wave = np.sin(p["order"] * angles[:, i] - p["phase_rad"])
    own = first_order(angles[:, i]) @ np.asarray(p["own_nm"])
    return np.asarray(p["amplitude_rad_per_nm"] * (torque[:, i] - own) * wave)


def first_order(angle: Array) -> Array:
    """(n, 3): one, cosine and sine of an angle (n,)."""
    return np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)


def branch(conditions: Conditions, p: Parameters) -> Array:
    """(n,) term of a joint: one sign by either direction of approach."""
    return np.asarray(p["half_width_rad"] * conditions.approach[:, p["joints"][0] - 1])


def swelling(p: Parameters, conditions: Conditions) -> Array:
    """(n,) relative growth of the tubes with humidity."""
    return np.asarray(p["per_pct"] * (conditions.humidity - 48.0))


def shift(p: Parameters, tip: Array, conditions: Conditions) -> Array:
    """(n, 3) what is added to the coordinates of the tip."""
    if p["kind"] == "operator":
        return np.where(conditions.operator[:, None] == 1, np.asarray(p["shift_m"]), 0.0)
    if p["kind"] == "column":
        return ((conditions.humidity - 48.0) / 7.0)[:, None] * np.asarray(p["shift_m"])
    if p["kind"] == "posture":
        return np.asarray(p["shift_m"])[conditions.posture]
    if p["kind"] == "frame_walk":
        walk = np.asarray(p["walk_m"])
        return np.stack(
            [np.interp(conditions.time, p["knots_s"], walk[:, axis]) for axis in range(3)], axis=1
        )
    if p["kind"] == "tip_field":
        distance = np.linalg.norm(tip - np.asarray(p["centre_m"]), axis=1)
        return np.asarray(np.exp(-0.5 * (distance / p["width_m"]) ** 2)[:, None] * p["shift_m"])
    return np.zeros_like(tip)


@dataclass(frozen=True, eq=False)
class SmallTerms:
    """For each joint a smooth curve of little bumps and a ripple of high order; 1 to 2 µm rms at
    the tip in all.
    """

    smooth: tuple[Parameters, ...]
    ripple_order: Array
    ripple_phase: Array
    ripple: Array

    @staticmethod
    def of(rng: np.random.Generator, arm: Chain) -> SmallTerms:
        total, rows = rng.uniform(1.0e-6, 2.0e-6), arm.rows
        levers = arm.jacobian(
            rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (200, len(arm.limits)))
        )
        lever = float(np.sqrt((levers**2).sum(axis=(1, 2)).mean()))
        ripple = rng.uniform(3.0e-6, 5.0e-6, rows) / 2.0  # from peak to peak
        share = rng.uniform(0.6, 0.9)
        ripple *= np.sqrt(share) * total / (lever * float(np.sqrt(np.mean(ripple**2 / 2.0))))
        smooth = tuple(_smooth(rng, np.sqrt(1.0 - share) * total / lever) for _ in range(rows))
        return SmallTerms(
            smooth,
            rng.integers(90, 400, rows).astype(float),
            rng.uniform(0.0, 2.0 * np.pi, rows),
            ripple,
        )

    def added(self, angles: Array, conditions: Conditions) -> Array:
        """(n, R) angles with the small terms."""
        out = angles + self.ripple * np.cos(self.ripple_order * angles - self.ripple_phase)
        for i, curve in enumerate(self.smooth):
            out[:, i] += bumps(angles[:, i], curve, conditions, i + 1) - angles[:, i]
        return out


def _smooth(rng: np.random.Generator, rms: float) -> Parameters:
    """Bumps of random height on eight places of the turn, scaled to the given rms over it [rad]."""
    curve = {
        "centres_rad": rng.uniform(0.0, 2.0 * np.pi, 8),
        "widths_rad": rng.uniform(0.3, 0.8, 8),
        "heights_rad": rng.standard_normal(8),
    }
    turn = np.linspace(0.0, 2.0 * np.pi, 361)[:-1]
    values = (
        np.exp(
            -0.5
            * (2.0 * np.sin(0.5 * (turn[:, None] - curve["centres_rad"])) / curve["widths_rad"])
            ** 2
        )
        @ curve["heights_rad"]
    )
    return curve | {"heights_rad": curve["heights_rad"] * rms / values.std()}
