from .accuracy.comprehensive_accuracy import comprehensive_accuracy, configuration_weights
from .accuracy.length import LengthUncertainty, length_uncertainty
from .accuracy.volume import AccuracyVolume, accuracy_volume, circle_accuracy
from .accuracy.workspace import WorkspaceMap, map_workspace
from .arm.arm import Arm
from .arm.parameter import Parameter
from .arm.poses import Poses
from .calibration import Calibration, calibrate
from .calibration.random_arm import perturbed_model
from .diagnosis import Diagnosis, diagnose, diagnose_files
from .effects import Effect
from .effects.conditions import Conditions
from .effects.error_model import ErrorModel
from .errors import AacmmError
from .measurements.records import Measurements
from .measurements.simulation import simulate_measurements
from .planning import CalibrationPlan, MeasurementPlan, plan_calibration, plan_measurements
from .postures.configurations import ConfigurationCircle, configuration_circle
from .postures.curve_sampling import Flexibility
from .postures.general_ik import ReachingPostures, reaching_postures
from .report.verdicts import next_measurements
from .verification import (
    AcceptanceResult,
    Procedure,
    accept,
    acceptance_procedure,
)

__version__: str

__all__ = [
    "AacmmError",
    "AcceptanceResult",
    "AccuracyVolume",
    "Arm",
    "Calibration",
    "CalibrationPlan",
    "Conditions",
    "ConfigurationCircle",
    "Diagnosis",
    "Effect",
    "ErrorModel",
    "Flexibility",
    "LengthUncertainty",
    "MeasurementPlan",
    "Measurements",
    "Parameter",
    "Poses",
    "Procedure",
    "ReachingPostures",
    "WorkspaceMap",
    "accept",
    "acceptance_procedure",
    "accuracy_volume",
    "calibrate",
    "circle_accuracy",
    "comprehensive_accuracy",
    "configuration_circle",
    "configuration_weights",
    "diagnose",
    "diagnose_files",
    "length_uncertainty",
    "map_workspace",
    "next_measurements",
    "perturbed_model",
    "plan_calibration",
    "plan_measurements",
    "reaching_postures",
    "simulate_measurements",
]
