"""Parameters of a calibration compared with stated bounds."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration


def stated_half_widths(result: Calibration) -> Array:
    """Stated half-width of each parameter, or k u of a cause, k = 2 (p,) [SI]; nan if none."""
    vector = result.fit.problem.vector
    parameters = zip(vector.arm_parameters, vector.parameters, strict=True)
    stated = [of_arm or of_effect for of_arm, of_effect in parameters]
    return np.array([p.half_width or COVERAGE_FACTOR * p.u or np.nan for p in stated])


def parameter_table(result: Calibration) -> pd.DataFrame:
    """:attr:`Calibration.parameters` with the ``stated`` half-width, and ``beyond``: the change
    exceeds stated + U.

    A half-width is a bound and does not add in quadrature: √(stated² + U²) would mark some
    parameter of 14 in 40 arms drawn within their half-widths.
    """
    table = result.parameters
    stated = stated_half_widths(result) / np.where(table["unit"] == "mm", MM, 1.0)
    return table.assign(stated=stated, beyond=np.abs(table["change"]) > stated + table["U"])
