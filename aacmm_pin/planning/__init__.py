"""What to measure next: records that tell causes of error apart."""

from aacmm_pin.planning.detection_power import Power
from aacmm_pin.planning.plan import advice, plan_measurements
from aacmm_pin.planning.result import MeasurementPlan, Tried

__all__ = ["MeasurementPlan", "Power", "Tried", "advice", "plan_measurements"]
