"""The real arms as their makers describe them, built from published nominal dimensions; nothing
measured is in here.
"""

from __future__ import annotations

from aacmm_pin.arm import Arm
from tests.arm_files import by_table

QUARTER = 90.0
LIMIT = 361.0
"""Wide enough for every record; the Fanuc's wrist turns almost once either way [°]."""

Row = tuple[float, float, float]
"""a [mm], d [mm], alpha [°]."""

UR10: list[Row] = [(0, 127.3, QUARTER), (-612, 0, 0), (-572.3, 0, 0)]
UR10 += [(0, 163.941, QUARTER), (0, 115.7, -QUARTER), (0, 92.2, 0)]
PANDA: list[Row] = [(0, 333, 0), (0, 0, -QUARTER), (0, 316, QUARTER), (82.5, 0, QUARTER)]
PANDA += [(-82.5, 384, -QUARTER), (0, 0, QUARTER), (88, 107, QUARTER)]
"""Craig: a and alpha of the row before."""
IIWA14: list[Row] = [(0, 360, -QUARTER), (0, 0, QUARTER), (0, 420, QUARTER), (0, 0, -QUARTER)]
IIWA14 += [(0, 400, -QUARTER), (0, 0, QUARTER), (0, 126, 0)]
FANUC: list[Row] = [
    (312, 670, -QUARTER),
    (1075, 0, 2 * QUARTER),
    (225, 0, -QUARTER),
    (0, -1280, QUARTER),
    (0, 0, -QUARTER),
]
FANUC += [(0, -215, 0)]
"""Joints 3 to 6 turn against the base's axes: the rows before them point z the other way."""
FANUC_OFFSETS = [0, -QUARTER, 0, 0, 0, 0]
"""The upper arm stands upright at zero; x of its row points along it."""


def of_table(
    name: str, rows: list[Row], convention: str = "standard-dh", offsets: list[float] | None = None
) -> Arm:
    """An arm by its DH table; nobody states how well the numbers are known."""
    pairs = zip(rows, offsets or [0.0] * len(rows), strict=True)
    return by_table(name, [(*row, offset) for row, offset in pairs], LIMIT, convention)


def ur10() -> Arm:
    """Universal Robots UR10 (CB3)."""
    return of_table("UR10", UR10)


def panda() -> Arm:
    """Franka Emika Panda."""
    return of_table("Panda", PANDA, "modified-dh")


def iiwa14() -> Arm:
    """KUKA LBR iiwa 14 R820."""
    return of_table("iiwa 14", IIWA14)


def fanuc() -> Arm:
    """Fanuc R-2000iC/165F."""
    return of_table("R-2000iC", FANUC, offsets=FANUC_OFFSETS)
