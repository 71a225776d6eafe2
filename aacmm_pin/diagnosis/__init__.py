"""Diagnosis: what the simulation gets wrong, the cause, the extended model, and the gain."""

from aacmm_pin.diagnosis.cross_validation import Gain
from aacmm_pin.diagnosis.diagnose import diagnose
from aacmm_pin.diagnosis.odd_groups import OddGroup
from aacmm_pin.diagnosis.result import Diagnosis, Finding
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.unexplained import Unexplained

__all__ = ["Alias", "Diagnosis", "Finding", "Gain", "OddGroup", "Unexplained", "diagnose"]
