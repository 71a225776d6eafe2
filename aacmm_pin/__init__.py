"""Postures, accuracy, calibration and diagnosis of articulated-arm coordinate measuring machines, on Pinocchio."""

from aacmm_pin.accuracy import AccuracyVolume, accuracy_volume, circle_accuracy
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.circle import Flexibility
from aacmm_pin.comprehensive import comprehensive_accuracy, configuration_weights
from aacmm_pin.conditions import Conditions
from aacmm_pin.configurations import ConfigurationCircle, configuration_circle, configuration_circles
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import Effect
from aacmm_pin.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.parameter import Parameter
from aacmm_pin.planning import MeasurementPlan, plan_measurements
from aacmm_pin.poses import Poses
from aacmm_pin.reaching_postures import ReachingPostures, reaching_postures
from aacmm_pin.single_point import SinglePoint, single_point_statistics
from aacmm_pin.virtual import simulate_measurements
from aacmm_pin.workspace import WorkspaceMap, map_workspace

__version__ = "0.1.0"

__all__ = [
    "AacmmError",
    "AccuracyVolume",
    "Arm",
    "Calibration",
    "Conditions",
    "ConfigurationCircle",
    "Diagnosis",
    "Effect",
    "ErrorModel",
    "Flexibility",
    "MeasurementPlan",
    "Measurements",
    "Parameter",
    "Poses",
    "ReachingPostures",
    "SinglePoint",
    "WorkspaceMap",
    "accuracy_volume",
    "calibrate",
    "circle_accuracy",
    "comprehensive_accuracy",
    "configuration_circle",
    "configuration_circles",
    "configuration_weights",
    "diagnose",
    "map_workspace",
    "plan_measurements",
    "reaching_postures",
    "simulate_measurements",
    "single_point_statistics",
]
