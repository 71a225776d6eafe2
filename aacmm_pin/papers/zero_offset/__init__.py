"""The zero-offset paper beside us: its simulated calibration made again, number by number.

六自由度关节式坐标测量机关节零位偏差的标定算法 (calibration of the joint zero offsets of a six-joint measuring arm), 2010;
the arm is the bundled ``zero6``.
"""

from aacmm_pin.papers.zero_offset.comparison import comparison
from aacmm_pin.papers.zero_offset.gauss_newton import (
    MRAD,
    assembled_arm,
    iterations,
    printed_postures,
    printed_table1,
    printed_table2,
    rounding_residuals,
    simulated_run,
)

__all__ = [
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
