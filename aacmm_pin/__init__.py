"""Postures, accuracy, calibration and diagnosis of articulated-arm coordinate measuring machines,
with Pinocchio.

Python loads each name of ``__init__.pyi`` at its first use, so that commands start quickly.
"""

import lazy_loader

from aacmm_pin._support import display

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.2.0"

display.reported_by(results="aacmm_pin.report.results", messages="aacmm_pin.report.messages")
