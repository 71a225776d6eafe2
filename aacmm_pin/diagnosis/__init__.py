"""Diagnosis: what the model gets wrong, the cause, the extended model, and the gain.

``candidates`` and ``covariates`` become columns (``design_matrix``) and inner products
(``gram_matrix``). ``linear_model`` and ``model_space`` state how probable a set of causes is.
``search`` finds the probable sets (``posterior``), and ``model_extension`` refits with them.
``diagnose`` runs all of it, and ``verdict`` judges.
"""

from aacmm_pin.diagnosis.budget import GEOMETRY, STRUCTURE, BudgetPart
from aacmm_pin.diagnosis.candidates import not_tried
from aacmm_pin.diagnosis.choice import Choice
from aacmm_pin.diagnosis.diagnose import diagnose
from aacmm_pin.diagnosis.diagnose_files import diagnose_files
from aacmm_pin.diagnosis.held_out_gain import Gain
from aacmm_pin.diagnosis.measurement_check import Check, check_measurements
from aacmm_pin.diagnosis.result import Diagnosis, Finding, Place, estimated, too_good
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.thresholds import THRESHOLDS
from aacmm_pin.diagnosis.unexplained import (
    OddGroup,
    RunOrder,
    ScatteredReadings,
    SharedError,
    Unexplained,
)

__all__ = [
    "GEOMETRY",
    "STRUCTURE",
    "THRESHOLDS",
    "Alias",
    "BudgetPart",
    "Check",
    "Choice",
    "Diagnosis",
    "Finding",
    "Gain",
    "OddGroup",
    "Place",
    "RunOrder",
    "ScatteredReadings",
    "SharedError",
    "Unexplained",
    "check_measurements",
    "diagnose",
    "diagnose_files",
    "estimated",
    "not_tried",
    "too_good",
]
