"""The paper beside us: SINO6, its equations and its tables, each next to what exact geometry gives.

Xu You, Gao Qun, Yu Limin, Xu Wei, Zheng Zhenxing, "Position accuracy forecast of different
configuration based on the inverse kinematics algorithm of offset orthogonal AACMM", Chinese Journal
of Scientific Instrument 40 (2019), doi:10.19650/j.cnki.cjsi.J1905059.
"""
