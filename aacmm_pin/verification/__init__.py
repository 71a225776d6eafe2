"""Whether an arm meets its specification: figures of two standards, by public descriptions,
planned, predicted, judged.
"""

from aacmm_pin.verification.accept import AcceptanceResult, accept
from aacmm_pin.verification.history import ControlChart, History
from aacmm_pin.verification.prediction import PredictedAcceptance, predict_acceptance
from aacmm_pin.verification.procedure import Procedure, acceptance_procedure

__all__ = [
    "AcceptanceResult",
    "ControlChart",
    "History",
    "PredictedAcceptance",
    "Procedure",
    "accept",
    "acceptance_procedure",
    "predict_acceptance",
]
