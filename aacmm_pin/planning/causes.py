"""The causes that a plan is to tell apart: by their labels, or all that an arm can have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.measuring_volume import joint_bounds
from aacmm_pin.effects import (
    CAUSES,
    BaseCompliance,
    BearingTilt,
    Counterbalance,
    Effect,
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    JointCompliance,
    JointHysteresis,
    LinkBending,
    ReferenceFrame,
    StylusBending,
    ThermalExpansion,
    TorsionalWindup,
)
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.geometry import JointDistance, JointPlacement, JointZeroOffset, LinkLength, LinkTilt, LinkTwist
from aacmm_pin.effects.tube import tubes
from aacmm_pin.errors import AacmmError, UnknownNameError

REFITTED = (JointZeroOffset, LinkLength, JointDistance, LinkTwist, LinkTilt, JointPlacement, ReferenceFrame)
"""What a diagnosis refits anyway, so that it is no cause to be told from another."""
PLACES = ("joint", "link", "seat", "marker")
MOST_VALUES = 6
"""A label states the values of so many parameters at most."""
CURVE = 24
"""Coefficients of an error curve of which nobody says how many it has."""


def cause_of(label: str, model: ErrorModel, torques: bool = False) -> Effect:
    """The cause that a label names, such as ``joint_compliance:2`` or ``joint_periodic_error:6,order=7,amplitude_rad=2e-5``.

    Without parameters it has the values of the same cause of the model, if there is one; else all are zero, which stands for
    a typical size.

    Args:
        label: cause, place, what tells several of one cause at one place apart (``Effect.key``), and parameters.
        model: the arm.
        torques: the records have measured torques, which a compliance then uses.

    Raises:
        UnknownNameError: an unknown cause or field.
        AacmmError: a field is missing or of no use.
    """
    cause, _, rest = label.partition(":")
    if cause not in CAUSES:
        raise UnknownNameError("cause", cause, list(CAUSES), "as in encoder_eccentricity:3")
    kind = CAUSES[cause]
    fields: dict[str, Any] = {}
    parameters: dict[str, float] = {}
    for item in filter(None, rest.split(",")):
        name, equals, value = item.partition("=")
        if not equals:
            name, value = next((n for n in PLACES if n in kind.structure()), "place"), item
        if name in kind.structure():
            fields[name] = _field(name, value)
        else:
            parameters[name] = _number(label, name, value)
    if torques and kind is JointCompliance:
        fields.setdefault("torque", "measured")
    if cause == "joint_error_curve" and isinstance(joint := fields.get("joint"), int):
        fields = _range_of(model.arm, joint) | fields
    try:
        effect = kind.from_description(fields, parameters)
    except UnknownNameError as error:
        raise UnknownNameError(f"name for {cause}", error.name, [*kind.structure(), *error.known], f"in {label!r}") from None
    except AacmmError as error:
        raise AacmmError(f"{label!r}: {error}; expected {_form(kind)}") from None
    same = [e for e in model.effects if identity(e) == identity(effect)]
    return same[0] if same and not parameters else effect


def label_of(effect: Effect) -> str:
    """The label by which :func:`cause_of` finds a cause again, with its values where they are few."""
    if not any(effect.values) or len(effect.terms) > MOST_VALUES:
        return effect.key
    values = ",".join(f"{name}={value:.4g}" for name, value in effect.described().items())
    return f"{effect.key}{',' if ':' in effect.key else ':'}{values}"


def _number(label: str, name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise AacmmError(f"{label!r}: {name} is {value!r}, expected a number") from None


def _field(name: str, value: str) -> Any:
    """Fields are numbers of rows, other numbers, or text; what is none of them the cause complains of."""
    kind: type[Any] = (
        int if name in ("joint", "link", "coefficients") else str if name in ("seat", "marker", "torque") else float
    )
    try:
        return kind(value)
    except ValueError:
        return value


def _range_of(arm: Arm, row: int) -> dict[str, Any]:
    rows = moving_rows(arm)
    lower, upper = joint_bounds(arm)[rows.index(row)] if row in rows else (-np.pi, np.pi)
    return {"lower_rad": float(lower) - 0.01, "upper_rad": float(upper) + 0.01, "coefficients": CURVE}


def _form(kind: type[Effect]) -> str:
    inner = [f"{n}=…" for n in kind.structure() if n in ("order", "time_s", "time_constant_s")]
    place = next((f":{n.upper()}" for n in PLACES if n in kind.structure()), "")
    return ",".join([f"{kind.cause}{place}", *inner])


def identity(effect: Effect) -> tuple[object, ...]:
    """Which cause it is and where it sits, whatever its values are."""
    return (effect.cause, *(getattr(effect, name) for name in effect.structure()))


def checked(effects: tuple[Effect, ...], arm: Arm) -> None:
    """Refuse causes that no plan can be about.

    Raises:
        AacmmError: one that is refitted anyway, one on a row that the arm does not have, or the same twice.
    """
    for effect in effects:
        if isinstance(effect, REFITTED):
            raise AacmmError(f"{effect.label} is refitted in every diagnosis, expected a cause that stands beside geometry")
        if effect.row is None:
            continue
        if not 1 <= effect.row <= arm.chain.rows:
            raise AacmmError(f"{effect.label}: {arm.name} has rows 1 to {arm.chain.rows}")
        if hasattr(effect, "joint") and effect.row not in moving_rows(arm):
            raise AacmmError(f"{effect.label}: row {effect.row} of {arm.name} is rigid, expected one with a joint")
    if len(effects) != len({identity(e) for e in effects}):
        raise AacmmError(f"{effects[0].key} is there twice, expected two different causes")


def moving_rows(arm: Arm) -> list[int]:
    """Rows that have a joint."""
    return [place // 2 for place in arm.chain.moving_axes()]


def usual_causes(arm: Arm) -> tuple[Effect, ...]:
    """Every cause that the arm can have, typical in size; but for those of time, which come once."""
    return tuple(effect.at(()) for effect in _usual(arm))


def _usual(arm: Arm) -> Iterator[Effect]:
    rows = moving_rows(arm)
    for row in rows:
        yield from (EncoderEccentricity(row), EncoderEllipticity(row), EncoderGain(row), JointHysteresis(row))
        if arm.masses is not None:
            yield from (JointCompliance(row), BearingTilt(row))
    if arm.masses is not None:
        yield BaseCompliance()
        for row in tubes(arm):
            yield from (LinkBending(row), TorsionalWindup(row))
    if len(rows) >= 2:
        yield Counterbalance(rows[1])
    yield ThermalExpansion()
    if arm.stylus_axis is not None:
        yield StylusBending()


def typical(effects: tuple[Effect, ...]) -> Array:
    """Usual magnitude of every parameter of the causes (c,) [units]."""
    return np.array([term.typical for effect in effects for term in effect.terms])
