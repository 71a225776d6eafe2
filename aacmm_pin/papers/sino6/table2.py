"""Table 2 of the paper made again, and beside it what exact geometry says about the same cells.

**How the paper's counts come about** (an assumption, as the text does not say it; nothing in it is tuned): the 48 × 48
regions are a grid in *joint* space, θ1 = θ3 = 0 and θ2, θ4 at -π + i π/49, i = 1 … 48; each cell's working point is where
this "highest" configuration reaches. Its configuration circle is walked in seven equal steps of θ2 from the highest to the
lowest configuration: the two ends stand for one sector each, the five steps between for a mirror-image pair each. A step
counts if θ2 >= -π and a pair exists by (11) and (13), that is both cosines lie within ±1; θ4 of a pair is not checked.
Where the triangle of the lowest configuration does not close, its angle thek2 is taken as zero, as the real part of a
complex inverse cosine would be, and the lowest end does not count.

**Why these counts are too small.** Near the base axis the elbow's circle encloses the vertical through the shoulder. Then
θ2 does not run from one end of the circle to the other: its true extreme lies on the far side, 180° minus the planar one,
and is reached with the base turned by about 180°. The steps in θ2 beyond that extreme belong to no configuration, so they
never were theoretical configurations either, while the real ones with the turned base are not looked at. The low flexibility
near the axis is made by the choice of the parameter; see :attr:`Table2.classes`. What the limits do take away is a cap
around one pole of the base axis, where θ2 would have to pass -π, and the folded rim, where θ4 would.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from aacmm_pin._support.checks import Array
from aacmm_pin._support.progress import watched
from aacmm_pin._support.shown import Shown
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.papers.sino6 import equations as eq
from aacmm_pin.papers.sino6.exact_circle import configurations_at_swivel
from aacmm_pin.papers.sino6.nominal import NominalArm, sino6_nominal
from aacmm_pin.papers.sino6.tables import printed_table2

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRID = 48
"""Cells along each of θ2 and θ4."""
SECTORS = 12
"""Sectors of the circle; the seven steps of θ2 stand for 1 + 5·2 + 1 of them."""


@dataclass(frozen=True, eq=False)
class Table2(Shown):
    """Table 2 as printed, reproduced, and exact.

    Attributes:
        counts: working_sectors (0 to 12) and the number of cells: paper_cells, reproduced_cells, exact_cells.
        cells: one row a cell: theta2_deg, theta4_deg, x_mm, z_mm (DH base frame), reproduced_sectors, exact_sectors,
            behind_axis (the point, as seen from the elbow of the cell's own posture), steps_past_limit and
            steps_without_configuration (of the seven), lowest_closes.
    """

    counts: pd.DataFrame
    cells: pd.DataFrame

    @property
    def total_variation(self) -> float:
        """Half the sum of the differences between printed and reproduced shares of cells: 0 equal, 1 disjoint."""
        return self._distance_to_paper("reproduced_cells")

    @property
    def exact_total_variation(self) -> float:
        """The same between the printed and the exact shares."""
        return self._distance_to_paper("exact_cells")

    @property
    def mean_flexibility(self) -> dict[str, float]:
        """Mean of ζ over the cells, by the names ``paper``, ``reproduced``, ``exact``."""
        sectors = self.counts["working_sectors"].to_numpy() / SECTORS
        return {name: _mean(sectors, self.counts[f"{name}_cells"]) for name in ("paper", "reproduced", "exact")}

    @property
    def classes(self) -> pd.DataFrame:
        """What becomes of each class of the reproduced table under exact geometry, one row a class.

        Columns: reproduced_sectors, cells, behind_axis (number of cells), steps_without_configuration and
        steps_past_limit (means, of seven), exact_fraction (mean over the cells).
        """
        grouped = self.cells.groupby("reproduced_sectors")
        return pd.DataFrame(
            {
                "cells": grouped.size(),
                "behind_axis": grouped["behind_axis"].sum(),
                "steps_without_configuration": grouped["steps_without_configuration"].mean(),
                "steps_past_limit": grouped["steps_past_limit"].mean(),
                "exact_fraction": grouped["exact_sectors"].mean() / SECTORS,
            }
        ).reset_index()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Cells by their working sectors, see :func:`aacmm_pin.papers.sino6.figures.draw_table2`."""
        from aacmm_pin.papers.sino6.figures import draw_table2  # matplotlib is loaded only to draw

        return draw_table2(self, ax)

    def _distance_to_paper(self, column: str) -> float:
        paper, other = self.counts["paper_cells"], self.counts[column]
        return float(0.5 * (paper / paper.sum() - other / other.sum()).abs().sum())


def reproduce_table2(arm: NominalArm | None = None, grid: int = GRID, *, progress: bool = True) -> Table2:
    """Table 2 by the assumption in the module's docstring, and by exact geometry on the same cells.

    Args:
        arm: the nominal arm; default SINO6.
        grid: cells along each of θ2 and θ4.
        progress: show a bar in a notebook, or on stderr at a terminal.
    """
    arm = arm or sino6_nominal()
    theta2, theta4, points = generating_grid(arm, grid)
    walk = _walk_in_theta2(arm, points, theta2, theta4)
    cells = pd.DataFrame(
        {
            "theta2_deg": theta2 / DEG,
            "theta4_deg": theta4 / DEG,
            "x_mm": points[:, 0] / MM,
            "z_mm": points[:, 2] / MM,
            **walk,
            "exact_sectors": _exact_by_rows(arm, points, grid, progress),
            "behind_axis": points[:, 0] < 0.0,  # the elbow is in front of the base axis, P behind it
        }
    )
    counts = pd.DataFrame({"working_sectors": np.arange(SECTORS + 1)})
    paper = printed_table2().set_index("working_sectors")["cells"]
    counts["paper_cells"] = counts["working_sectors"].map(paper).fillna(0).astype(int)
    for name in ("reproduced", "exact"):
        counts[f"{name}_cells"] = np.bincount(cells[f"{name}_sectors"], minlength=SECTORS + 1)
    return Table2(counts, cells)


def generating_grid(arm: NominalArm, grid: int = GRID) -> tuple[Array, Array, Array]:
    """θ2 and θ4 at the interior nodes of [-π, 0]², (n,) [rad] each, and the points reached with θ1 = θ3 = 0, (n, 3) [m]."""
    nodes = np.arange(1, grid + 1) * np.pi / (grid + 1) - np.pi
    theta2, theta4 = (angle.ravel() for angle in np.meshgrid(nodes, nodes, indexing="ij"))
    zero = np.zeros_like(theta2)
    return theta2, theta4, arm.dh.positions(np.column_stack([zero, theta2, zero, theta4, zero]))


def _walk_in_theta2(arm: NominalArm, points: Array, theta2: Array, theta4: Array) -> dict[str, NDArray[np.generic]]:
    """The paper's walk over the circle: columns of :attr:`Table2.cells`, (n,) each."""
    parts = eq.theta2_sweep_parts(arm, points, theta4)
    lowest_closes = eq.lowest_exists(arm, points)
    sweep = np.where(lowest_closes[:, None], parts, np.nan_to_num(parts)).sum(axis=1)
    steps = theta2 - np.linspace(0.0, 1.0, 1 + SECTORS // 2)[:, None] * sweep
    within = steps >= -np.pi
    exists = np.stack([_pair_exists(arm, points, step) for step in steps])
    exists[0], exists[-1] = True, lowest_closes
    sectors = np.full(len(steps), 2)
    sectors[[0, -1]] = 1
    return {
        "reproduced_sectors": sectors @ (within & exists),
        "steps_past_limit": (~within).sum(axis=0),
        "steps_without_configuration": (~exists).sum(axis=0),
        "lowest_closes": lowest_closes,
    }


def _pair_exists(arm: NominalArm, points: Array, theta2: Array) -> NDArray[np.bool_]:
    """Whether (11) and (13) have a real answer for this θ2 on the printed root: (n,)."""
    theta4 = eq.theta4_roots(arm, points, theta2)[:, 0]
    return np.asarray(np.abs(eq.cosine_theta1(arm, points, theta2, theta4)) <= 1.0)


def _exact_by_rows(arm: NominalArm, points: Array, grid: int, progress: bool) -> NDArray[np.int64]:
    """:func:`exact_sectors` of one θ2 after the other."""
    with watched(np.split(points, grid), progress, "Table 2, exact", "row") as rows:
        return np.concatenate([exact_sectors(arm, row) for row in rows])


def exact_sectors(arm: NominalArm, points: Array) -> NDArray[np.int64]:
    """How many of twelve swivel angles, 30° apart from the highest elbow on, have a true configuration: (n,).

    True means θ2 and θ4 in [-π, 0], θ1 and θ3 free. Configurations come in mirror images about the vertical plane through
    the point, so half of the circle is searched.
    """
    half = np.arange(SECTORS // 2 + 1) * 2.0 * np.pi / SECTORS
    found = configurations_at_swivel(arm, points, half)
    allowed = ((found.q[:, [1, 3]] <= 0.0) & (found.q[:, [1, 3]] >= -np.pi)).all(axis=1)
    works = np.zeros((len(points), half.size), dtype=np.int64)
    works[found.point[allowed], found.swivel[allowed]] = 1
    return np.asarray(2 * works.sum(axis=1) - works[:, 0] - works[:, -1])


def _mean(values: Array, weights: pd.Series) -> float:
    return float(np.average(values, weights=weights.to_numpy()))
