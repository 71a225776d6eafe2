"""Calibration: parameters of an arm from measurements, with covariance, identifiability and
held-out residuals.
"""

from aacmm_pin.calibration.calibrate import calibrate
from aacmm_pin.calibration.calibrated_arm import calibrated_model
from aacmm_pin.calibration.comparison import Comparison, compare
from aacmm_pin.calibration.cross_validation import HeldOut
from aacmm_pin.calibration.fit import Fit
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.calibration.linear_model import (
    RowBlock,
    SeatElimination,
    remaining_triangle,
    seat_columns,
)
from aacmm_pin.calibration.result import Calibration

__all__ = [
    "Calibration",
    "Comparison",
    "Fit",
    "HeldOut",
    "Observability",
    "RowBlock",
    "SeatElimination",
    "calibrate",
    "calibrated_model",
    "compare",
    "remaining_triangle",
    "seat_columns",
]
