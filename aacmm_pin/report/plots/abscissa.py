"""Abscissa of the figure of each cause, with a default for causes of plugins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.effects import Effect, State

BINS_OF_CAUSE = {"joint_error_curve": 72}
"""Into how many parts of what it depends on the records of a cause may be gathered."""
OTHER_BINS = 18
ORDER_FIELDS = {"joint_periodic_error": "order"}
"""Field of a cause with its periods per turn."""
FOLDED = 3.0
"""Waves of a higher order are drawn over one period; over a whole turn they would be a band."""
LOADS = {
    "base_compliance": "moment of the weight about the base",
    "bearing_tilt": "moment of the weight across the axis",
    "counterbalance": "horizontal part of the body",
    "joint_compliance": "moment of the weight about the axis",
    "link_bending": "bending load of the tube",
    "probe_bending": "probe direction across the stylus",
    "stylus_bending": "horizontal part of the stylus",
    "torsional_windup": "moment of the weight about the tube",
}
"""What one parameter of a cause is multiplied by."""


def bins(effect: Effect) -> int:
    """Into how many parts of what it depends on the records may be gathered."""
    return BINS_OF_CAUSE.get(effect.cause, OTHER_BINS)


def load_words(effect: Effect) -> str:
    """What its parameter is multiplied by; a cause of others may state it as ``load``."""
    if "torque" in effect.needs:
        return "negative measured torque"
    default = getattr(effect, "load", "load")
    return LOADS.get(effect.cause, default)


def period(effect: Effect) -> float | None:
    """Period over the angle of its joint into which its picture is folded [rad]; None for none."""
    field = ORDER_FIELDS.get(effect.cause)
    order = 0.0 if field is None else float(getattr(effect, field))
    return 2 * np.pi / order if order > FOLDED else None


def abscissa(effect: Effect, state: State) -> tuple[Array, str] | None:
    """What it depends on in every record (n,), and the words and unit of that axis.

    None for an effect that is drawn over its load.
    """
    conditions, row = state.conditions, effect.row
    if "time" in effect.needs:
        return conditions.require("time", effect.label) / 60.0, "time [min]"
    if "temperature" in effect.needs and conditions.temperature is not None:
        return conditions.temperature, "temperature [°C]"
    if "approach" in effect.needs and row is not None:
        approach = conditions.require("approach", effect.label)
        return approach[:, state.joint(row)], "direction of the last motion [1]"
    if row is None or not is_of_angle(effect, state):
        return None
    angle, folded = state.angle(row), period(effect)
    if folded is None:
        unit, size = unit_of_angle(state, row)
        return angle / size, f"joint {row} [{unit}]"
    words = f"joint {row}, folded into one period of {folded / DEG:.4g}° [°]"
    return np.mod(angle, folded) / DEG, words


def is_of_angle(effect: Effect, state: State) -> bool:
    """Whether it is a function of the angle of its own joint alone."""
    row, of_joint = effect.row, effect.location_field() == "joint"
    if row is None or not of_joint or effect.elastic or effect.needs:
        return False
    number = state.joint(row)
    alone = np.zeros_like(state.q)
    alone[:, number] = state.q[:, number]
    whole, own = effect.displacements(state), effect.displacements(replace(state, q=alone))
    return len(whole) == 1 and np.array_equal(whole[0].columns, own[0].columns)


def unit_of_angle(state: State, row: int) -> tuple[str, float]:
    """Unit in which people read the indication of ``row``, and one of it in SI."""
    slides = state.slides(row)
    return ("mm", MM) if slides else ("°", DEG)
