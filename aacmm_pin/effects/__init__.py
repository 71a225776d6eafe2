"""The causes of error, one small class each. ``CAUSES`` finds a class by the name of its cause."""

from aacmm_pin.effects.contact import StylusBending, StylusOffset
from aacmm_pin.effects.effect import Displacement, Effect, Term
from aacmm_pin.effects.elastic import BearingTilt, Counterbalance, JointCompliance, LinkBending, TorsionalWindup
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
from aacmm_pin.effects.thermal import ThermalExpansion
from aacmm_pin.effects.timing import JointHysteresis, ZeroDrift

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
]
