"""Postures, accuracy, calibration and diagnosis of articulated-arm coordinate measuring machines, on Pinocchio."""

from types import ModuleType

from aacmm_pin._support import display
from aacmm_pin.accuracy.comprehensive_accuracy import comprehensive_accuracy, configuration_weights
from aacmm_pin.accuracy.single_point import SinglePoint, single_point_statistics
from aacmm_pin.accuracy.volume import AccuracyVolume, accuracy_volume, circle_accuracy
from aacmm_pin.accuracy.workspace import WorkspaceMap, map_workspace
from aacmm_pin.arm.arm import Arm
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.arm.poses import Poses
from aacmm_pin.calibration import Calibration, calibrate
from aacmm_pin.diagnosis import Diagnosis, diagnose
from aacmm_pin.effects import Effect
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.measurements.simulate import simulate_measurements
from aacmm_pin.planning import MeasurementPlan, plan_measurements
from aacmm_pin.postures.configurations import ConfigurationCircle, configuration_circle, configuration_circles
from aacmm_pin.postures.curve_sampling import Flexibility
from aacmm_pin.postures.general_ik import ReachingPostures, reaching_postures

__version__ = "0.1.0"


def _report() -> ModuleType:
    from aacmm_pin.report import results  # loads what draws

    return results


display.reported_by(_report)

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
