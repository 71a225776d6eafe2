"""The causes of error, one small class each. ``CAUSES`` finds a class by the name of its cause, ``register`` adds one."""

import re
from typing import TypeVar

from aacmm_pin.effects.compliance import BearingTilt, Counterbalance, JointCompliance, LinkBending, TorsionalWindup
from aacmm_pin.effects.effect import Displacement, Effect, Term
from aacmm_pin.effects.encoder import (
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    EncoderSlip,
    JointErrorCurve,
    JointPeriodicError,
)
from aacmm_pin.effects.geometry import JointDistance, JointPlacement, JointZeroOffset, LinkLength, LinkTilt, LinkTwist
from aacmm_pin.effects.mounting import BaseCompliance, ReferenceFrame, SeatError
from aacmm_pin.effects.probing import StylusBending, StylusOffset
from aacmm_pin.effects.thermal import ThermalExpansion
from aacmm_pin.effects.timing import JointHysteresis, ZeroDrift
from aacmm_pin.errors import AacmmError

CAUSES: dict[str, type[Effect]] = {
    effect.cause: effect
    for effect in (
        JointZeroOffset,
        LinkLength,
        JointDistance,
        LinkTwist,
        LinkTilt,
        JointPlacement,
        EncoderEccentricity,
        EncoderEllipticity,
        JointPeriodicError,
        JointErrorCurve,
        EncoderGain,
        EncoderSlip,
        JointCompliance,
        BearingTilt,
        JointHysteresis,
        ZeroDrift,
        TorsionalWindup,
        LinkBending,
        BaseCompliance,
        ThermalExpansion,
        Counterbalance,
        StylusOffset,
        StylusBending,
        SeatError,
        ReferenceFrame,
    )
}
"""Every cause by its name."""

_Own = TypeVar("_Own", bound=type[Effect])


def register(cause: _Own) -> _Own:
    """Make a cause of your own known by its name, to arm files, ``--effect``, plans and diagnoses; a decorator of its class.

    It lasts as long as the process: the program that reads an arm file with the cause registers it first. A class that is
    defined anew, as in a notebook, takes its own place.

    Raises:
        AacmmError: the name is of no use in a file, or another class has it.
    """
    name = getattr(cause, "cause", None)
    if not (isinstance(name, str) and re.fullmatch("[a-z][a-z0-9_]*", name)):
        raise AacmmError(f"{cause.__name__}: cause is {name!r}, expected a name of small letters, digits and _")
    there = CAUSES.get(name, cause)
    if (there.__module__, there.__qualname__) != (cause.__module__, cause.__qualname__):
        raise AacmmError(f"{cause.__name__}: the cause {name} is there already, {there.__module__}.{there.__qualname__}")
    CAUSES[name] = cause
    return cause


__all__ = [
    "CAUSES",
    "BaseCompliance",
    "BearingTilt",
    "Counterbalance",
    "Displacement",
    "Effect",
    "EncoderEccentricity",
    "EncoderEllipticity",
    "EncoderGain",
    "EncoderSlip",
    "JointCompliance",
    "JointDistance",
    "JointErrorCurve",
    "JointHysteresis",
    "JointPeriodicError",
    "JointPlacement",
    "JointZeroOffset",
    "LinkBending",
    "LinkLength",
    "LinkTilt",
    "LinkTwist",
    "ReferenceFrame",
    "SeatError",
    "StylusBending",
    "StylusOffset",
    "Term",
    "ThermalExpansion",
    "TorsionalWindup",
    "ZeroDrift",
    "register",
]
