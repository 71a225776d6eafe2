from .calibration_design import CalibrationPlan, plan_calibration
from .measurement_plan import MeasurementPlan
from .plan import POOL_SIZE, PlannedScheme, plan_measurements

__all__ = [
    "POOL_SIZE",
    "CalibrationPlan",
    "MeasurementPlan",
    "PlannedScheme",
    "plan_calibration",
    "plan_measurements",
]
