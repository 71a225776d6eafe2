"""The printed Tables 1 to 3 as data frames, unchanged; units are in the column names.

Source: Xu You, Gao Qun, Yu Limin, Xu Wei, Zheng Zhenxing, Chinese Journal of Scientific Instrument 40 (2019),
doi:10.19650/j.cnki.cjsi.J1905059.
"""

from __future__ import annotations

import importlib.resources

import numpy as np
import pandas as pd

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM


def printed_table1() -> pd.DataFrame:
    """DH values of SINO6 and the half-widths of their calibration, one row a joint [mm, rad]."""
    return _read("table1.csv")


def printed_table2() -> pd.DataFrame:
    """Number of the 48 × 48 working regions by their number of working sectors, 1 to 12."""
    return _read("table2.csv")


def printed_table3() -> pd.DataFrame:
    """The six measured seats: coordinates, spread (eq. 16), spread of the marked part and of the rest (eq. 18) [mm]."""
    return _read("table3.csv")


def printed_points() -> Array:
    """Coordinates of the six seats of Table 3 in the DH base frame, (6, 3) [m]."""
    return np.array(printed_table3()[["x_mm", "y_mm", "z_mm"]], dtype=np.float64) * MM


def _read(name: str) -> pd.DataFrame:
    resource = importlib.resources.files("aacmm_pin.papers.sino6") / name
    with resource.open(encoding="utf-8") as file:
        return pd.read_csv(file, comment="#")
