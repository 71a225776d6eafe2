"""The printed Tables 1 and 2 as data frames; units are in the column names.

Source: 六自由度关节式坐标测量机关节零位偏差的标定算法 (calibration of the joint zero offsets of a six-joint measuring arm),
2010.
"""

from __future__ import annotations

import importlib.resources

import pandas as pd


def printed_table1() -> pd.DataFrame:
    """DH values and true zero offsets of the simulated arm, one row a DH row, the stylus last [deg, mm].

    The link lengths a are as printed; the coordinates of Table 2 come out with a = 0 only, as in the bundled ``zero6``.
    """
    return _read("table1.csv")


def printed_postures() -> pd.DataFrame:
    """The nine postures of Table 2, three a run: joint angles [deg], reference coordinates, first position errors [mm].

    Corrected in one digit: the position error of run 2, point 3, which stands there as 39.30, is 39.303 here.
    """
    return _read("postures.csv")


def printed_table2() -> pd.DataFrame:
    """Table 2: zero offsets [deg] after each iteration of each run, and the position errors of its three points [mm]."""
    return _read("table2.csv")


def _read(name: str) -> pd.DataFrame:
    resource = importlib.resources.files("aacmm_pin.papers.zero_offset") / name
    with resource.open(encoding="utf-8") as file:
        return pd.read_csv(file, comment="#")
