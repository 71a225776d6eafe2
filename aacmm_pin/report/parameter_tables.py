"""Parameters of a calibration compared with stated bounds."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration import Calibration
from aacmm_pin.report.numbers import quantity, small_unit


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


def readable_parameters(result: Calibration) -> pd.DataFrame:
    """The table for readers: values with unit as text; changes and uncertainties in the unit
    ``in``.
    """
    table = parameter_table(result)
    largest = table[["change", "stated"]].abs().max(axis=1)
    units = [*map(small_unit, table["unit"], table["U"].where(table["U"] > 0, largest))]
    together = table["known"] == "in combination"
    values = [*map(quantity, table["after"], table["unit"])]
    readable = table[["parameter"]].assign(value=np.where(together, "–", values))
    readable["in"] = [unit for unit, _ in units]
    factors = np.array([factor for _, factor in units])
    shown = table.assign(change=table["change"].where(~together))
    numbers = shown[["change", "stated", "u", "U"]].mul(factors, axis=0)
    return pd.concat([readable, numbers, table[["known", "beyond"]]], axis=1)


def decimals(table: pd.DataFrame) -> str:
    """Format of changes and uncertainties of :func:`readable_parameters`: two digits of the smaller
    u.
    """
    u = table["u"].to_numpy()
    smaller = float(np.quantile(u[u > 0], 0.25)) if (u > 0).any() else 1.0
    before = int(np.floor(np.log10(smaller)))
    return f"z.{min(6, max(1, 1 - before))}f"
