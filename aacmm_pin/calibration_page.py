"""A calibration as one self-contained HTML page."""
from aacmm_pin.calibration import Calibration
from typing import Any
def calibration_page(result: Calibration, summary: dict[str, Any], when: str) -> str:
    return ""
