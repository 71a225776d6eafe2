from .cause_text import cause_of
from .causes import CAUSES, all_candidates, example, register
from .compliance import BearingTilt, Counterbalance, JointCompliance, LinkBending, TorsionalWindup
from .drift_and_hysteresis import JointHysteresis, ZeroDrift
from .effect import Displacement, Effect, Reading, Records, Term, about_axis, axis, twist
from .encoder import (
    EncoderEccentricity,
    EncoderEllipticity,
    EncoderGain,
    EncoderSlip,
    JointErrorCurve,
    JointPeriodicError,
)
from .geometry import JointDistance, JointPlacement, JointZeroOffset, LinkLength, LinkTilt, LinkTwist
from .mounting import BaseCompliance, ReferenceFrame, SeatError
from .probing import StylusBending, StylusOffset
from .state import State
from .thermal import ThermalExpansion

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
