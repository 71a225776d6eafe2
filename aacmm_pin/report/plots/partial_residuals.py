"""Partial residuals: the amount of a cause in each record, and the abscissa of its picture."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import (
    Displacement,
    Effect,
    State,
    corrects_seat,
    displaced,
    point_sensitivity,
    sensitivity,
)

MICRO = 1e-6
KIND_OF_UNIT = {"µm/m": "expansion", "µrad": "rotation", "µm": "translation"}
"""Kinds of amounts by unit."""
FOLDED = 3.0
"""Waves of a higher order are drawn over one period."""
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
"""Quantities that parameters of causes multiply."""


@dataclass(frozen=True, eq=False)
class PartialResidual:
    """The amount of a cause in each record that depends on it.

    Attributes:
        x: quantity that the cause depends on, in the unit of ``x_label`` (n,).
        value, u: amount in each record, and its u, in the unit of ``y_label`` (n,).
        fitted: amount of the fitted cause (n,).
    """

    x: Array
    x_label: str
    value: Array
    u: Array
    fitted: Array
    y_label: str


@dataclass(frozen=True, eq=False)
class _Amount:
    """The fitted amount of a cause in each record (n,) [rad, m, or m/m], in millionths of ``unit``.

    Attributes:
        lever: displacement of the target by one unit, in the base (n, 3).
        has_direction: whether one unit is the same twist at one place in all records.
    """

    amount: Array
    unit: str
    lever: Array
    has_direction: bool = False


def varies(result: Diagnosis, finding: Finding) -> bool:
    """Whether a cause displaces records differently; a value of geometry or seats does not."""
    displacements = finding.effect.displacements(state_of(result.extended))
    # A displacement that is the same in all records has one row.
    constant = all(len(displacement.columns) == 1 for displacement in displacements)
    return not (constant or result.geometric(finding) or corrects_seat(finding.effect))


def state_of(fit: Fit) -> State:
    """The fitted arm in the records of the fit."""
    problem, arm = fit.problem, fit.problem.model.arm
    effects = (*problem.model.effects, *fit.effects)
    records = problem.measurements
    place = arm.place()
    return displaced(arm, effects, records.q, records.conditions, place, as_referenced=False)


def partial_residual(result: Diagnosis, effect: Effect) -> PartialResidual:
    """The amount of a cause of the extended model in each record, everything else as fitted.

    With the displacement L of the target per unit of the amount a, noise C and residual e of a
    record, the estimate is ``a - (Lᵀ C⁻¹ e)/(Lᵀ C⁻¹ L)`` with u = ``(Lᵀ C⁻¹ L)^(-1/2)``:
    generalised least squares (partial residual, Larsen, McCleary 1972, Technometrics 14).
    """
    fit = result.extended
    state = state_of(fit)
    cause = _amount(effect, state)
    lever = cause.lever @ fit.point.frame.rotation.T
    weighted = np.linalg.solve(fit.residual_noise[:, :3, :3], lever[:, :, None])[:, :, 0]
    information = np.einsum("ni,ni->n", lever, weighted)
    has_amount = fit.used & (information > 1e-6 * np.nanmax(information))
    residual = np.einsum("ni,ni->n", weighted, np.nan_to_num(fit.system.deviation))
    value = cause.amount[has_amount] - residual[has_amount] / information[has_amount]
    x, x_label = _abscissa(effect, state, cause)
    y_words = KIND_OF_UNIT[cause.unit]
    if effect.location_field() == "joint" and cause.has_direction:
        y_words = f"joint {'angle' if cause.unit == 'µrad' else 'position'} minus reading"
    return PartialResidual(
        x=x[has_amount],
        x_label=x_label,
        value=value / MICRO,
        u=information[has_amount] ** -0.5 / MICRO,
        fitted=cause.amount[has_amount] / MICRO,
        y_label=f"{y_words} [{cause.unit}]",
    )


def _amount(effect: Effect, state: State) -> _Amount:
    """As expansion by temperature, motion at one place, or displacement of the target."""
    displacements, values = effect.displacements(state), np.array(effect.values)
    target_displacement = sensitivity(effect, state) @ values
    temperature = state.conditions.temperature
    if "temperature" in effect.needs and temperature is not None and len(values) == 1:
        amount, unit = values[0] * (temperature - state.arm.reference_temperature), "µm/m"
    elif len(displacements) == 1:
        columns = np.broadcast_to(displacements[0].columns, (state.n, 6, len(values)))
        direction = _common_direction(columns)
        if direction is not None:
            twist = Displacement(displacements[0].place, direction[None, :, None])
            lever = np.broadcast_to(point_sensitivity(state, twist)[:, :, 0], (state.n, 3))
            # How often the common direction is in the displacement.
            amount = columns @ values @ direction / (direction @ direction)
            unit = "µrad" if direction[3:].any() else "µm"
            return _Amount(amount, unit, lever, has_direction=True)
        translation, rotation = np.split(columns @ values, 2, axis=1)
        motion, unit = (rotation, "µrad") if rotation.any() else (translation, "µm")
        sign = np.sign(values[0]) if len(values) == 1 else 1.0
        amount = np.linalg.norm(motion, axis=1) * sign
    else:
        amount, unit = np.linalg.norm(target_displacement, axis=1), "µm"
    nonzero = np.where(amount == 0.0, np.inf, amount)
    return _Amount(amount, unit, target_displacement / nonzero[:, None])


def _common_direction(columns: Array) -> Array | None:
    """Twist (6,) that all columns (n, 6, p) are multiples of, or None.

    It rotates by 1 rad, or else translates by 1 m; its largest component is positive.
    """
    twists = columns.transpose(0, 2, 1).reshape(-1, 6)
    if np.linalg.matrix_rank(twists, rtol=1e-9) != 1:
        return None
    longest = twists[np.linalg.norm(twists, axis=1).argmax()]
    length = np.linalg.norm(longest[3:]) or np.linalg.norm(longest)
    return np.asarray(longest / length * np.sign(longest[np.abs(longest).argmax()]))


def _abscissa(effect: Effect, state: State, cause: _Amount) -> tuple[Array, str]:
    """What the cause depends on in each record (n,), and the label."""
    conditions, row = state.conditions, effect.row
    if "time" in effect.needs:
        return conditions.require("time", effect.label) / 60.0, "time [min]"
    if "temperature" in effect.needs and conditions.temperature is not None:
        return conditions.temperature, "temperature [°C]"
    if "approach" in effect.needs and row is not None:
        approach = conditions.require("approach", effect.label)
        return approach[:, state.joint(row)], "direction of the last motion [1]"
    if row is not None and effect.function_of == "angle":
        order = float(getattr(effect, "order", 0.0))
        if order > FOLDED:
            period = 360.0 / order
            words = f"joint {row}, folded into one period of {period:.4g}° [°]"
            return np.mod(state.angle(row) / DEG, period), words
        unit, size = ("mm", MM) if state.slides(row) else ("°", DEG)
        return state.angle(row) / size, f"joint {row} [{unit}]"
    if len(effect.values) == 1 and effect.values[0] and cause.unit != "µm/m":
        unit = unit_of_load(effect.terms[0].unit, cause.unit.removeprefix("µ"))
        return cause.amount / effect.values[0], f"{load_words(effect)} [{unit}]"
    return cause.amount / MICRO, f"fitted {KIND_OF_UNIT[cause.unit]} [{cause.unit}]"


def load_words(effect: Effect) -> str:
    """The quantity that the parameter multiplies; your own cause may state it as ``load``."""
    if "torque" in effect.needs:
        return "negative measured torque"
    default = getattr(effect, "load", "load")
    return LOADS.get(effect.cause, default)


def unit_of_load(unit: str, amount: str) -> str:
    """Unit that times a ``unit`` gives that of the ``amount``: ``(N·m)²`` for ``rad/(N·m)²``."""
    numerator, _, denominator = unit.partition("/")
    if numerator != amount:
        return f"{amount}/({unit})"
    return re.sub(r"^\(([^()]*)\)$", r"\1", denominator) or "1"
