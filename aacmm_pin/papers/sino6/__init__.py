"""The paper beside us: SINO6, its equations and its tables, each next to what exact geometry gives.

Xu You, Gao Qun, Yu Limin, Xu Wei, Zheng Zhenxing, "Position accuracy forecast of different configuration based on the
inverse kinematics algorithm of offset orthogonal AACMM", Chinese Journal of Scientific Instrument 40 (2019),
doi:10.19650/j.cnki.cjsi.J1905059.

- ``tables``: Tables 1 to 3 as printed.
- ``nominal``, ``equations``: the offset-orthogonal arm and equations (2) to (13), corrected; ``misprints``: what was
  corrected and how large each slip is.
- ``exact_circle``: all configurations at a swivel angle; ``table2``: the printed counts made again, and the exact ones.
- ``seat_configurations``, ``table3``: the measured spreads beside predictions.
- ``figures``: pictures of both (imports matplotlib, so it is not imported here).
"""

from aacmm_pin.papers.sino6.exact_circle import SwivelConfigurations, configurations_at_swivel
from aacmm_pin.papers.sino6.misprints import misprints
from aacmm_pin.papers.sino6.nominal import NominalArm, sino6_nominal
from aacmm_pin.papers.sino6.table2 import Table2, reproduce_table2
from aacmm_pin.papers.sino6.table3 import Table3, implied_counts, predict_table3
from aacmm_pin.papers.sino6.tables import printed_points, printed_table1, printed_table2, printed_table3

__all__ = [
    "NominalArm",
    "SwivelConfigurations",
    "Table2",
    "Table3",
    "configurations_at_swivel",
    "implied_counts",
    "misprints",
    "predict_table3",
    "printed_points",
    "printed_table1",
    "printed_table2",
    "printed_table3",
    "reproduce_table2",
    "sino6_nominal",
]
