"""Postures, accuracy, calibration and diagnosis of articulated-arm coordinate measuring machines,
with Pinocchio.

Python loads each name of ``__init__.pyi`` at its first use, so that commands start quickly.
"""

from collections.abc import Callable
from types import ModuleType
from typing import Any

import lazy_loader

from aacmm_pin._support import display

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.2.0"


def _report() -> ModuleType:
    from aacmm_pin.report import results  # loads what draws

    return results


def _sentence() -> Callable[[Any], str]:
    from aacmm_pin.report.messages import sentence

    return sentence


display.reported_by(_report, _sentence)
