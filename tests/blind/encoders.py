"""From the indication of an encoder to the angle of its joint, exactly, for each fault an encoder
or its joint can have.

Every function takes the indication (n,) [rad], the parameters of the contract, the conditions and
the row from 1, and returns the angle (n,) [rad]. Where a fault is defined on the true angle (an
eccentric disc), the reading is inverted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from blind.conditions import Conditions
from blind.kinematics import Array

Parameters = Mapping[str, Any]


def inverted(reading: Callable[[Array], Array], indication: Array) -> Array:
    """The angle whose ``reading`` is the indication: x <- x + (indication - reading(x)) until it
    stands.
    """
    angle = indication.copy()
    for _ in range(50):
        step = indication - reading(angle)
        angle += step
        if np.abs(step).max(initial=0.0) < 1e-15 * max(1.0, float(np.abs(angle).max(initial=0.0))):
            break
    return angle


def eccentric_disc(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """A graduated disc whose centre runs round the axis at a distance ε times the radius of the
    head's circle.

    Seen from the centre of the disc, the head stands at atan2(-ε sin u, 1 - ε cos u) from where it
    seems to stand, u being the angle between eccentricity and head. To first order that is A
    cos(indication - phase) with A = ε.
    """
    ratio = p["amplitude_rad"]

    def reading(angle: Array) -> Array:
        u = angle - p["phase_rad"] - 0.5 * np.pi
        return np.asarray(angle + np.arctan2(ratio * np.sin(u), 1.0 - ratio * np.cos(u)))

    return inverted(reading, indication)


def elliptic_disc(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """Marks of a round scale on an elliptic rim: a mark at w from the long axis appears at atan(κ
    tan w), κ = 1 + 2 A.
    """
    stretch = 1.0 + 2.0 * p["amplitude_rad"]
    turned = 0.5 * (p["phase_rad"] + 0.5 * np.pi)

    def reading(angle: Array) -> Array:
        c, s = np.cos(angle - turned), np.sin(angle - turned)
        return np.asarray(angle + np.arctan2((stretch - 1.0) * s * c, c * c + stretch * s * s))

    return inverted(reading, indication)


def periodic(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """A cos(k indication - phase)."""
    return np.asarray(
        indication + p["amplitude_rad"] * np.cos(p["order"] * indication - p["phase_rad"])
    )


def bumps(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """Bumps round the turn: Gauss curves in the chord to their centres, so that a turn closes
    smoothly.
    """
    centres, widths, heights = (
        np.asarray(p[name]) for name in ("centres_rad", "widths_rad", "heights_rad")
    )
    chord = 2.0 * np.sin(0.5 * (indication[:, None] - centres))
    return np.asarray(indication + np.exp(-0.5 * (chord / widths) ** 2) @ heights)


def gain(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """Too many or too few pulses a turn: (1 + gain) indication."""
    return np.asarray(indication + p["gain"] * indication)


def slip(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """A step from time_s on."""
    return indication + np.where(conditions.time >= p["time_s"], p["step_rad"], 0.0)


def hysteresis(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """+ half_width where the joint came upwards, - where downwards."""
    return np.asarray(indication + p["half_width_rad"] * conditions.approach[:, joint - 1])


def warm_up(indication: Array, p: Parameters, conditions: Conditions, joint: int) -> Array:
    """drift (1 - exp(-t / time constant)), t from the first record's clock."""
    return np.asarray(
        indication - p["drift_rad"] * np.expm1(-conditions.time / p["time_constant_s"])
    )


ENCODER: dict[str, Callable[[Array, Parameters, Conditions, int], Array]] = {
    "encoder_eccentricity": eccentric_disc,
    "encoder_ellipticity": elliptic_disc,
    "joint_periodic_error": periodic,
    "joint_error_curve": bumps,
    "encoder_gain": gain,
    "encoder_slip": slip,
    "joint_hysteresis": hysteresis,
    "zero_drift": warm_up,
}
