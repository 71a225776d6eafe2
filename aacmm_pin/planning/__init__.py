"""What to measure next: records that tell causes of error apart, or most of the geometry."""

from aacmm_pin.planning.calibration_design import CalibrationPlan, plan_calibration
from aacmm_pin.planning.detection_power import Power
from aacmm_pin.planning.plan import Reference, plan_measurements
from aacmm_pin.planning.result import MeasurementPlan, Tried

__all__ = [
    "CalibrationPlan",
    "MeasurementPlan",
    "Power",
    "Reference",
    "Tried",
    "plan_calibration",
    "plan_measurements",
]
