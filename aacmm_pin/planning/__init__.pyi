from .calibration_design import CalibrationPlan, plan_calibration
from .measurement_plan import MeasurementPlan, Tried
from .plan import POOL_SIZE, PlannedScheme, plan_measurements
from .separability import Power

__all__ = [
    "POOL_SIZE",
    "CalibrationPlan",
    "MeasurementPlan",
    "PlannedScheme",
    "Power",
    "Tried",
    "plan_calibration",
    "plan_measurements",
]
