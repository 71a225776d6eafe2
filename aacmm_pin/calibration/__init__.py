"""Calibration: parameters of an arm from measurements, with covariance and held-out residuals.

It also finds mistakes in files, such as a wrong sign, column, unit or frame.
"""

from aacmm_pin.calibration.calibrate import calibrate
from aacmm_pin.calibration.calibrated_arm import HeldEffects, calibrated_model, is_of_setup
from aacmm_pin.calibration.comparison import Comparison, compare
from aacmm_pin.calibration.cross_validation import HeldOut, rms, rms_residual
from aacmm_pin.calibration.estimation import information_of_seats
from aacmm_pin.calibration.fit import MISFIT, NO_SCATTER, Fit
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.calibration.input_mistakes import (
    first_fit,
    mistakes_of,
)
from aacmm_pin.calibration.least_squares import (
    inverse_of_factor,
    lower_factor,
    remaining_triangle,
    solve_lower,
)
from aacmm_pin.calibration.linearisation import SeatElimination
from aacmm_pin.calibration.noise_model import Correlation, NoiseModel, Scatters, observations_of
from aacmm_pin.calibration.parameter_vector import ParameterVector, geometric_parameters
from aacmm_pin.calibration.parameters import ASSEMBLED, problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.repeatability import FEWEST_CYCLES, Repeatability, repeatability_of
from aacmm_pin.calibration.result import (
    UNCHANGED,
    BasePlacement,
    Calibration,
    base_is_open,
    base_placements,
    residuals_by_record,
)
from aacmm_pin.calibration.session_frames import in_first_frame, session_notes
from aacmm_pin.calibration.setup import ReferenceFrame, Setup, Target
from aacmm_pin.calibration.shared_exclusions import Exclusions, exclusions_of

__all__ = [
    "ASSEMBLED",
    "FEWEST_CYCLES",
    "MISFIT",
    "NO_SCATTER",
    "UNCHANGED",
    "BasePlacement",
    "Calibration",
    "Comparison",
    "Correlation",
    "Exclusions",
    "Fit",
    "Frame",
    "HeldEffects",
    "HeldOut",
    "NoiseModel",
    "Observability",
    "ParameterVector",
    "Problem",
    "ReferenceFrame",
    "Repeatability",
    "Scatters",
    "SeatElimination",
    "Setup",
    "Target",
    "base_is_open",
    "base_placements",
    "calibrate",
    "calibrated_model",
    "compare",
    "exclusions_of",
    "first_fit",
    "geometric_parameters",
    "in_first_frame",
    "information_of_seats",
    "inverse_of_factor",
    "is_of_setup",
    "lower_factor",
    "mistakes_of",
    "observations_of",
    "problem_of",
    "registered",
    "remaining_triangle",
    "repeatability_of",
    "residuals_by_record",
    "rms",
    "rms_residual",
    "session_notes",
    "solve_lower",
]
