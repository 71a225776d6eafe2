"""Equations and tables of the SINO6 paper, compared with exact geometry.

Xu You, Gao Qun, Yu Limin, Xu Wei, Zheng Zhenxing, "Position accuracy forecast of different
configuration based on the inverse kinematics algorithm of offset orthogonal AACMM", Chinese Journal
of Scientific Instrument 40 (2019), doi:10.19650/j.cnki.cjsi.J1905059.
"""
