"""The paper beside us: SINO6, its equations and its tables, each next to what exact geometry gives.

Xu You, Gao Qun, Yu Limin, Xu Wei, Zheng Zhenxing, "Position accuracy forecast of different configuration based on the
inverse kinematics algorithm of offset orthogonal AACMM", Chinese Journal of Scientific Instrument 40 (2019),
doi:10.19650/j.cnki.cjsi.J1905059.
"""

from aacmm_pin.papers.sino6.misprints import misprints
from aacmm_pin.papers.sino6.table2 import Table2, reproduce_table2
from aacmm_pin.papers.sino6.tables import (
    NominalArm,
    printed_points,
    printed_table1,
    printed_table2,
    printed_table3,
    sino6_nominal,
)

__all__ = [
    "NominalArm",
    "Table2",
    "misprints",
    "printed_points",
    "printed_table1",
    "printed_table2",
    "printed_table3",
    "reproduce_table2",
    "sino6_nominal",
]
