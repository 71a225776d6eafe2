from .calibration_design import CalibrationPlan, plan_calibration
from .detection_power import Power
from .plan import POOL_SIZE, Reference, plan_measurements
from .result import MeasurementPlan, Tried

__all__ = [
    "POOL_SIZE",
    "CalibrationPlan",
    "MeasurementPlan",
    "Power",
    "Reference",
    "Tried",
    "plan_calibration",
    "plan_measurements",
]
