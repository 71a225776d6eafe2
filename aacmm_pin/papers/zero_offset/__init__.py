"""The zero-offset paper beside us: its simulated calibration made again, number by number.

六自由度关节式坐标测量机关节零位偏差的标定算法 (calibration of the joint zero offsets of a six-joint measuring arm), 2010;
the arm is the bundled ``zero6``.

- ``tables``: Tables 1 and 2 as printed.
- ``gauss_newton``: the paper's least squares, with and without its rounding to 1 mrad, and what the rounding leaves.
- ``figures``: pictures of its iterations and of what rounding leaves.
- ``comparison``: every number of Table 2, printed against computed.
"""

from aacmm_pin.papers.zero_offset.comparison import comparison
from aacmm_pin.papers.zero_offset.gauss_newton import (
    KEYING_SLIP,
    MRAD,
    assembled_arm,
    iterations,
    rounding_residuals,
    simulated_run,
)
from aacmm_pin.papers.zero_offset.tables import printed_postures, printed_table1, printed_table2

__all__ = [
    "KEYING_SLIP",
    "MRAD",
    "assembled_arm",
    "comparison",
    "iterations",
    "printed_postures",
    "printed_table1",
    "printed_table2",
    "rounding_residuals",
    "simulated_run",
]
