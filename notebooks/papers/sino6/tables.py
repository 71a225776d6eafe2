"""The printed Tables 1 to 3 as data frames, and the nominal arm of Table 1."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.dh import DHTable, table
from aacmm_pin.errors import UnsupportedArmError
from papers.read_table import read_table


def printed_table1() -> pd.DataFrame:
    """DH values of SINO6 and their half-widths, one row for each joint [mm, rad]."""
    return read_table("sino6_table1")


def printed_table2() -> pd.DataFrame:
    """Number of the 48 × 48 working regions by their number of working sectors, 1 to 12."""
    return read_table("sino6_table2")


def printed_table3() -> pd.DataFrame:
    """The six measured seats: coordinates, spread (eq. 16), spread of the marked part and of the
    rest (eq. 18) [mm].
    """
    return read_table("sino6_table3")


def printed_points() -> Array:
    """Coordinates of the six seats of Table 3 in the DH base frame, (6, 3) [m]."""
    return np.array(printed_table3()[["x_mm", "y_mm", "z_mm"]], dtype=np.float64) * MM


@dataclass(frozen=True)
class NominalArm:
    """Magnitudes of the four lengths of an arm with twists of ±90°.

    The paper mixes signed values and magnitudes. Only :attr:`dh` has the signs (a2 < 0, a3 > 0,
    d3 < 0, d5 < 0).

    Attributes:
        l2: offset of the axis of joint 3 from the shoulder, where the axes of joints 1 and 2 meet
            [m].
        l3: offset of the elbow (axis of joint 4) from the axis of joint 3 [m].
        d3: length of the upper tube, along the axis of joint 3 [m].
        d5: length of the fore tube, along the axis of joint 5 [m].
    """

    l2: float
    l3: float
    d3: float
    d5: float

    def __post_init__(self) -> None:
        if min(astuple(self)) <= 0:
            raise UnsupportedArmError(
                f"a length is not positive in {self}; expected magnitudes [m]"
            )

    @property
    def dh(self) -> DHTable:
        """Standard DH table of joints 1 to 5.

        The origin of frame 5 is the working point, and the origin of frame 3 is the elbow.
        """
        quarter = np.pi / 2
        a, d = (0.0, -self.l2, self.l3, 0.0, 0.0), (0.0, 0.0, -self.d3, 0.0, -self.d5)
        return table(np.column_stack([a, d, quarter * np.array([-1, 1, -1, 1, 1]), np.zeros(5)]))


def sino6_nominal() -> NominalArm:
    """The nominal SINO6, with the four lengths of Table 1 and ideal angles."""
    a, d = (np.abs(printed_table1()[column].to_numpy()) * MM for column in ("a_mm", "d_mm"))
    return NominalArm(l2=float(a[1]), l3=float(a[2]), d3=float(d[2]), d5=float(d[4]))
