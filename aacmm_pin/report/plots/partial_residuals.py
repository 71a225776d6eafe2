"""Partial residuals: the amount of one cause by each record, with everything else in the extended
model as fitted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array, Mask
from aacmm_pin.calibration import Fit
from aacmm_pin.diagnosis import Diagnosis
from aacmm_pin.effects import (
    Conditions,
    Displacement,
    Effect,
    State,
    displaced,
    point_sensitivity,
    sensitivity,
)
from aacmm_pin.errors import AacmmError
from aacmm_pin.report.plots.abscissa import (
    abscissa,
    bins,
    is_of_angle,
    load_words,
    period,
    unit_of_angle,
)

MICRO = 1e-6
KIND_OF_UNIT = {"µm/m": "expansion", "µrad": "rotation", "µm": "translation"}
"""What an amount is, by its unit."""
DENSE = 1500
"""Points of a curve over an angle."""
AWAY = 0.02
"""A curve over an angle breaks off where the nearest record is farther than this part of the range.
"""


@dataclass(frozen=True, eq=False)
class PartialResidual:
    """The amount of a cause by each record that depends on it.

    Attributes:
        x: what the cause depends on, in the unit of ``x_label`` (n,).
        value, u: amount of the cause by each record, and its standard uncertainty, in the unit of
            ``y_label`` (n,).
        fitted: amount by the fitted cause (n,).
        curve: x and amount of the fitted cause, in the order in which a line joins them; nan where
            it breaks off (2, m).
        bins: into how many parts of x the records may be gathered.
    """

    x: Array
    x_label: str
    value: Array
    u: Array
    fitted: Array
    y_label: str
    curve: Array
    bins: int


@dataclass(frozen=True, eq=False)
class _Amount:
    """How much of a cause there is in each record, and how one unit of it moves the target.

    Attributes:
        amount: at the fitted values (n,) [rad, m, or m/m].
        unit: a millionth of what the amount is in: µrad of a turn, µm of a shift, µm/m of a strain.
        lever: displacement of the target by one unit of amount, in the base (n, 3).
        direction: twist of one unit, at one place in all records alike (6,); None where it varies.
    """

    amount: Array
    unit: str
    lever: Array
    direction: Array | None = None


def is_constant(effect: Effect, state: State) -> bool:
    """Whether the cause displaces every record alike, as a geometric value does: then it depends on
    nothing.
    """
    displacements = effect.displacements(state)
    return all(len(displacement.columns) == 1 for displacement in displacements)


def state_of(fit: Fit, q: Array | None = None, conditions: Conditions | None = None) -> State:
    """The arm as fitted, in the records of the fit or in others."""
    problem = fit.problem
    effects = (*problem.model.effects, *fit.effects)
    records, arm = problem.measurements, problem.model.arm
    own = conditions if conditions is not None else records.conditions
    return displaced(
        arm, effects, records.q if q is None else q, own, arm.place(), as_referenced=False
    )


def partial_residual(result: Diagnosis, effect: Effect) -> PartialResidual:
    """The amount of a cause of the extended model by each record, everything else as fitted.

    With L the displacement of the target per unit of the cause's amount a (such as a joint's
    angle), C the noise and e the residual of a record, its own estimate of the amount is ``a - (Lᵀ
    C⁻¹ e)/(Lᵀ C⁻¹ L)`` with u = ``(Lᵀ C⁻¹ L)^(-1/2)``: generalised least squares of one number
    (partial residual, Larsen, McCleary 1972, Technometrics 14).

    Args:
        result: the diagnosis.
        effect: the cause with its fitted values, as a finding has it.

    Raises:
        AacmmError: the cause displaces all records alike, so there is nothing to draw it over.
    """
    fit = result.extended
    state = state_of(fit)
    if is_constant(effect, state):
        raise AacmmError(
            f"{effect.label} displaces all records equally; expected a cause that depends on "
            "something"
        )
    found = _amount(effect, state)
    lever = found.lever @ fit.point.frame.rotation.T
    weighted = np.linalg.solve(fit.residual_noise[:, :3, :3], lever[:, :, None])[:, :, 0]
    information = np.einsum("ni,ni->n", lever, weighted)
    there = fit.used & (information > 1e-6 * np.nanmax(information))
    off = np.einsum("ni,ni->n", weighted, np.nan_to_num(fit.system.deviation))
    value = found.amount - off / np.where(there, information, 1.0)
    x, x_label = _covariate(effect, state, found)
    ordered = np.argsort(x[there], kind="stable")
    curve = np.stack([x[there][ordered], found.amount[there][ordered]])
    if is_of_angle(effect, state):
        curve = _over_angle(effect, state, found, there)
    return PartialResidual(
        x=x[there],
        x_label=x_label,
        value=value[there] / MICRO,
        u=information[there] ** -0.5 / MICRO,
        fitted=found.amount[there] / MICRO,
        y_label=_y_label(effect, found),
        curve=curve * np.array([[1.0], [1 / MICRO]]),
        bins=bins(effect),
    )


def _amount(effect: Effect, state: State) -> _Amount:
    """As a strain by temperature, as a turn or a shift about one place, or as the shift of the
    target by all places.
    """
    places, values = effect.displacements(state), np.array(effect.values)
    temperature = state.conditions.temperature
    if "temperature" in effect.needs and temperature is not None and len(values) == 1:
        amount, unit = values[0] * (temperature - state.arm.reference_temperature), "µm/m"
    elif len(places) == 1:
        columns = np.broadcast_to(places[0].columns, (state.n, 6, len(values)))
        direction = _common_direction(columns)
        if direction is not None:
            lever = point_sensitivity(
                state, Displacement(places[0].place, direction[None, :, None])
            )[:, :, 0]
            amount = _along(direction, columns, values)
            unit = "µrad" if direction[3:].any() else "µm"
            return _Amount(amount, unit, np.broadcast_to(lever, (state.n, 3)), direction)
        shift, turn = np.split(columns @ values, 2, axis=1)
        size, unit = (turn, "µrad") if turn.any() else (shift, "µm")
        amount = np.linalg.norm(size, axis=1) * (np.sign(values[0]) if len(values) == 1 else 1.0)
    else:
        amount, unit = np.linalg.norm(sensitivity(effect, state) @ values, axis=1), "µm"
    safe = np.where(amount == 0.0, np.inf, amount)
    return _Amount(amount, unit, (sensitivity(effect, state) @ values) / safe[:, None])


def _common_direction(columns: Array) -> Array | None:
    """Twist (6,) that all columns (n, 6, p) are multiples of, largest component positive; None if
    there is none.

    It turns by one radian, and shifts by what goes with that; where it does not turn, it shifts by
    one metre.
    """
    each = columns.transpose(1, 0, 2).reshape(6, -1)
    left, size, _ = np.linalg.svd(each, full_matrices=False)
    if size[0] == 0.0 or (size[1:] > 1e-9 * size[0]).any():
        return None
    first = left[:, 0]
    direction = np.where(np.abs(first) > 1e-9, first, 0.0)
    largest = direction[np.argmax(np.abs(direction))]
    length = float(np.linalg.norm(direction[3:])) or float(np.linalg.norm(direction))
    return np.asarray(direction * np.sign(largest) / length)


def _along(direction: Array, columns: Array, values: Array) -> Array:
    """How often the twist is in those of the values (n,)."""
    unit = direction / (direction @ direction)
    return np.asarray(np.einsum("i,nip,p->n", unit, columns, values))


def _covariate(effect: Effect, state: State, found: _Amount) -> tuple[Array, str]:
    """What the cause depends on, and its name with its unit."""
    over = abscissa(effect, state)
    if over is not None:
        return over
    if len(effect.values) == 1 and effect.values[0] and found.unit != "µm/m":
        unit = unit_of_load(effect.terms[0].unit, found.unit.removeprefix("µ"))
        return found.amount / effect.values[0], f"{load_words(effect)} [{unit}]"
    return found.amount / MICRO, f"fitted {KIND_OF_UNIT[found.unit]} [{found.unit}]"


def unit_of_load(unit: str, amount: str) -> str:
    """Unit of what a parameter of ``unit`` multiplies to give an ``amount`` [rad or m]:
    ``rad/(N·m)²`` gives ``(N·m)²``.
    """
    above, *below = re.split(r"/(?![^(]*\))", unit)  # at slashes outside brackets
    if above not in (amount, "1"):
        return f"{amount}/({unit})"
    if not below:
        return amount if above == "1" else "1"
    factors = [amount, *below] if above == "1" else below
    return "·".join(factors) if len(factors) > 1 else re.sub(r"^\(([^()]*)\)$", r"\1", factors[0])


def _over_angle(effect: Effect, state: State, found: _Amount, there: Mask) -> Array:
    """The fitted cause over the covered range of its joint, x [°, or mm] and amount (2, m)."""
    assert effect.row is not None
    assert found.direction is not None  # a function of one joint's angle turns about its axis
    number, folded = state.joint(effect.row), period(effect)
    angle = state.angle(effect.row)[there]
    grid = (
        np.linspace(0.0, folded, DENSE) if folded else np.linspace(angle.min(), angle.max(), DENSE)
    )
    q = np.zeros((DENSE, state.q.shape[1]))
    q[:, number] = grid
    (shown,) = effect.displacements(State(state.arm, q, Conditions(DENSE), state.target))
    amount = _along(found.direction, shown.columns, np.array(effect.values))
    if folded is None:  # where no record is near, nobody knows the curve
        ordered = np.sort(angle)
        after = np.clip(np.searchsorted(ordered, grid), 1, len(ordered) - 1)
        away = np.minimum(np.abs(grid - ordered[after - 1]), np.abs(ordered[after] - grid))
        amount[away > AWAY * np.ptp(ordered)] = np.nan
    return np.stack([grid / unit_of_angle(state, effect.row)[1], amount])


def _y_label(effect: Effect, found: _Amount) -> str:
    if effect.location_field() == "joint" and found.direction is not None:
        return (
            f"joint {'angle' if found.unit == 'µrad' else 'position'} minus reading [{found.unit}]"
        )
    return f"{KIND_OF_UNIT[found.unit]} [{found.unit}]"
