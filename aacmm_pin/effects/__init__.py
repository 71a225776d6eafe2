"""The causes of error, one small class each. ``CAUSES`` finds a class by the name of its cause, ``register`` adds one."""

from aacmm_pin.arm.chain import axis
from aacmm_pin.effects.cause_text import cause_of
from aacmm_pin.effects.causes import CAUSES, all_candidates, example, register
from aacmm_pin.effects.compliance import BearingTilt, Counterbalance, JointCompliance, LinkBending, TorsionalWindup
from aacmm_pin.effects.drift_and_hysteresis import JointHysteresis, ZeroDrift
from aacmm_pin.effects.effect import Displacement, Effect, Reading, Records, Term, about_axis, twist
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
from aacmm_pin.effects.state import State
from aacmm_pin.effects.thermal import ThermalExpansion

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
    "Reading",
    "Records",
    "ReferenceFrame",
    "SeatError",
    "State",
    "StylusBending",
    "StylusOffset",
    "Term",
    "ThermalExpansion",
    "TorsionalWindup",
    "ZeroDrift",
    "about_axis",
    "all_candidates",
    "axis",
    "cause_of",
    "example",
    "register",
    "twist",
]
